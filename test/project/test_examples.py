"""Runs of the examples, benchmarks and simulated laboratories."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from checkout import ROOT

sys.path.insert(0, str(ROOT / 'validation'))

from laboratories import KINDS, Truth, laboratory, outcome, shapes_of
from two_tendons import TIPS, fall

EXAMPLES = sorted(set((ROOT / 'examples').glob('*.py')) - set((ROOT / 'examples').glob('5_*')))
# Checks of the numbers that an example prints, in their order.
CHECKS: dict[str, Callable[[list[float]], bool]] = {
    '8_ringing': lambda said: np.allclose(said[:2], said[2:], rtol=0.02),
    '9_tip_controller': lambda said: said[2] < 1.5 and 4.0 * said[3] < said[1],
    '10_lqr': lambda said: 2.0 * said[-1] < said[-2],
    '11_octopus_reach': lambda said: (
        sorted(said[4::3]) == said[4::3] and said[-2] > said[1] + 50.0
    ),
    '12_learned_reach': lambda said: said[2] < 0.3 * said[0],
    '14_contact': lambda said: said[3::5][:3] == sorted(said[3::5][:3]) and said[13] > 50.0,
    '13_fibre_strain': lambda said: np.allclose(said, [0.0, 0.0, 4.0], atol=0.1),
}


def run(*words: object, cwd: Path = ROOT, **variables: str) -> str:
    """Run a program of Python to its end; return what it printed."""
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=cwd,
        env=os.environ | variables,
        capture_output=True,
        text=True,
        timeout=1200,
    )
    assert done.returncode == 0 and 'Traceback' not in done.stderr, done.stderr
    return done.stdout


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(example):
    printed = run(example)
    assert printed
    numbers = [float(number) for number in re.findall(r'-?\d+\.\d+', printed)]
    assert CHECKS.get(example.stem, bool)(numbers), printed


@pytest.mark.endurance
def test_control_loop_converges():
    pytest.importorskip('rclpy', reason='needs ROS 2')
    pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
    from live_nodes import environment, new_domain

    printed = run(ROOT / 'examples' / '5_control_loop.py', 6, **environment(new_domain()))
    assert float(printed.splitlines()[-1].split()[3]) < 10.0  # error [mm] on a circle of 50 mm


FOLDER = ROOT / 'benchmarks'
# Modules of other benchmarks, and the test of endurance.
PARTS = {'brief.py', 'loaded_bvp.py', 'soak.py', 'soak_motion.py'}
BENCHMARKS = {path.name for path in FOLDER.glob('*.py')} - PARTS
NEED_ROS = ('estimator_node.py', 'floods.py', 'node.py')


@pytest.mark.endurance
@pytest.mark.parametrize('name', sorted(BENCHMARKS))
def test_benchmark_runs(name, tmp_path_factory):
    if name in NEED_ROS:
        pytest.importorskip('rclpy')
    folder = tmp_path_factory.mktemp('b')
    words = '-W', 'error::DeprecationWarning:__main__', FOLDER / name, '--brief'
    assert len(run(*words, cwd=folder, TMPDIR=str(folder)).splitlines()) > 3


@pytest.mark.endurance
def test_short_soak_passes(capfd, monkeypatch):
    pytest.importorskip('rclpy', reason='needs ROS 2')
    pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
    monkeypatch.syspath_prepend(FOLDER)
    import soak

    rows = soak.run(0.004)
    outcome = dict(row[-2:] for row in rows)
    assert outcome['killed and started again'].startswith('answers after')
    assert 'no wrong shape' in outcome['5 changes of parameters']
    assert ' answered (' in outcome['everything recorded at 100 Hz']
    assert rows[6][1].startswith('0 failed steps')


def test_simulated_laboratory_has_the_described_properties():
    recording, young = laboratory(Truth('closed_form'), KINDS['right model'], 3)
    assert 0.85 * 1.1e5 <= young <= 1.2 * 1.1e5
    shapes = shapes_of(recording).shapes
    assert len(shapes) == 10
    # A fifth of the frames is lost; most readings of slack tendons are within the deadband.
    assert 0.7 < len(recording.frames) / (10.0 * recording.tension_time[-1]) < 0.9
    assert all(0.0 <= shape.window.tensions[1] < 1e-3 for shape in shapes)


def test_interval_of_the_right_model_is_narrow_and_accurate():
    result = outcome(Truth('closed_form'), KINDS['right model, no friction'], 0)
    assert result.half_width < 0.01
    assert abs(result.error) < 2.0 * result.half_width


def test_trajectory_of_two_tendons_converges_and_equals_published_ones():
    tips = fall(0, 5e-3)
    assert np.linalg.norm(tips - fall(1, 1e-2), axis=1).max() < 1e-4
    distances = {name: np.linalg.norm(tips - other, axis=1) for name, other in TIPS.items()}
    assert distances['SoRoMoX'].max() < 6e-3 and distances['SoRoSim'].max() < 6e-3
    assert distances['SoRoSim'][0] < 1e-4 and distances['PyElastica'].max() > 0.1
