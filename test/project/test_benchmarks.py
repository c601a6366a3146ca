"""Every benchmark runs, briefly; its results are not checked."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest
from checkout import ROOT

FOLDER = ROOT / 'benchmarks'
# Run by others.
PARTS = {'brief.py', 'loaded_bvp.py', 'soak.py', 'tip_force_scenario.py'}
BENCHMARKS = {path.name for path in FOLDER.glob('*.py')} - PARTS
NEEDED = {
    'bags.py': ['rosbags'],
    'estimator_node.py': ['rclpy'],
    'floods.py': ['rclpy'],
    'node.py': ['rclpy'],
    'viewer.py': ['rclpy', 'viser'],
}


@pytest.mark.endurance
@pytest.mark.parametrize('name', sorted(BENCHMARKS))
def test_every_benchmark_runs_to_its_end(
    name: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    for module in NEEDED.get(name, []):
        pytest.importorskip(module)
    if name == 'viewer.py' and not shutil.which('chromedriver'):
        pytest.skip('needs chromedriver')
    folder = tmp_path_factory.mktemp('b')  # A browser's socket has no room for a long path.
    done = subprocess.run(
        [sys.executable, '-W', 'error::DeprecationWarning:__main__', FOLDER / name, '--brief'],
        cwd=folder,
        env=dict(os.environ, TMPDIR=str(folder)),
        capture_output=True,
        text=True,
        timeout=1200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert 'Traceback' not in done.stderr
    assert len(done.stdout.splitlines()) > 3


def test_make_bench_runs_every_benchmark() -> None:
    (recipe,) = [
        part for part in (ROOT / 'Makefile').read_text().split('\n\n') if part.startswith('bench:')
    ]
    assert {name for name in BENCHMARKS if f'benchmarks/{name}' in recipe} == BENCHMARKS


def test_an_option_that_is_none_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, FOLDER / 'solvers.py', '--briefly'],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2 and '--briefly' in done.stderr
