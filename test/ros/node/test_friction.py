"""The node with friction: it remembers what tendons did, and says when it forgets."""

import itertools

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import CONFIG, CONFIG_FILE, running, tip_of

from octo_arm_model import Solver
from octo_arm_model.config.config import Config, load_parameters

pytestmark = pytest.mark.slow

HIGH = np.full((3, 4), 0.02) + [[0.0], [0.0], [1.0]] * np.array([1.0, 0.5, 0.0, 0.0])
LOW = 0.5 * HIGH
SETTINGS = {'model': 'exact', 'tendons.friction': [0.2], 'friction_memory': 5.0}


def test_a_loop_has_two_shapes_and_a_gap_ends_the_memory():
    given = Config.from_parameters(load_parameters(CONFIG_FILE) | SETTINGS)
    assert given.arm.friction == len(CONFIG.arm.tendons) * (0.2,)
    solver: Solver = given.solver(compiled=None)
    up, fresh = solver.solve(HIGH), solver.solve(LOW)
    down = solver.follow(LOW, up)
    assert np.linalg.norm(down.tip - fresh.tip) > 1e-3
    options = [
        word
        for name, value in SETTINGS.items()
        for word in ('-p', f'{name}:={value}'.replace(' ', ''))
    ]
    with running('ros.node.main', *options) as client:
        client.connect()
        # From the start: time goes back.
        client.stamps = itertools.count(1)
        client.ask('tendon_tensions', HIGH)
        np.testing.assert_allclose(tip_of(client.ask('tendon_tensions', LOW)), down.tip, atol=1e-9)
        _, values = client.status('solver')
        assert values['friction history kept'] == 'True'
        forgotten = int(values['friction history forgotten after a gap'])
        client.stamps = itertools.count(100)
        np.testing.assert_allclose(
            tip_of(client.ask('tendon_tensions', LOW)), fresh.tip, atol=1e-9
        )
        _, values = client.status('solver')
        assert int(values['friction history forgotten after a gap']) == forgotten + 1
        refused = (False, 'friction_memory is -1.0, expected a finite time >= 0 [s]')
        assert client.change(friction_memory=-1.0) == refused
