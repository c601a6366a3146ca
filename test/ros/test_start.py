"""The node of a program that only looks on: what remains when it is no longer needed."""

import subprocess
import sys

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import DEADLINE, environment, new_domain

_PROGRAM = """
from pathlib import Path
import rclpy
from octo_arm_model.ros.client.client import POSES, ArmClient
from octo_arm_model.ros.start import client_node

def threads():
    names = {path.read_text().strip() for path in Path('/proc/self/task').glob('*/comm')}
    return {name for name in names if name.startswith('dds.')} - {'dds.shm.wdog'}

assert not threads()
try:
    with client_node('looks_on') as node:
        client = ArmClient(node)
        client.listen(POSES)
        assert threads()
        raise KeyError('ends the block')
except KeyError:
    assert not threads(), threads()
    assert not rclpy.ok()
print('done')
"""


def test_no_thread_of_the_middleware_outlives_the_node_of_a_client():
    done = subprocess.run(
        [sys.executable, '-c', _PROGRAM],
        env=environment(new_domain()),
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    assert (done.returncode, done.stdout) == (0, 'done\n'), done.stderr
