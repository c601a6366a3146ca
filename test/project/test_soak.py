"""A short run of `benchmarks/soak.py`, the node under abuse."""

import sys

import pytest
from checkout import ROOT

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

sys.path.insert(0, str(ROOT / 'benchmarks'))

import soak

pytestmark = pytest.mark.endurance


def test_the_node_stands_abuse(capfd):
    rows = soak.run(0.004)
    outcome = dict(row[-2:] for row in rows)
    assert outcome['killed and started again'].endswith('s later')
    assert 'no wrong shape' in outcome['5 changes of parameters']
    assert ' answered (' in outcome['everything recorded at 100 Hz']
    assert len(rows) == 6
