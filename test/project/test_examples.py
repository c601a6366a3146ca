"""The examples run as they stand."""

import subprocess
import sys

import pytest
from checkout import ROOT

EXAMPLES = sorted((ROOT / 'examples').glob('[1-467]_*.py'))


@pytest.mark.parametrize('example', EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(example):
    ran = subprocess.run(
        [sys.executable, example], cwd=ROOT, capture_output=True, text=True, timeout=600
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout


@pytest.mark.endurance
def test_the_loop_closes():
    pytest.importorskip('rclpy', reason='needs ROS 2')
    pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
    from live_nodes import environment, new_domain

    ran = subprocess.run(
        [sys.executable, ROOT / 'examples' / '5_control_loop.py', '6'],
        cwd=ROOT,
        env=environment(new_domain()),
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert ran.returncode == 0, ran.stderr
    assert float(ran.stdout.splitlines()[-1].split()[3]) < 10.0  # [mm], of a circle of 50 mm
