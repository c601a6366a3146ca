"""The node with friction: it remembers what tendons did, and says when it forgets."""

import itertools

import numpy as np
from clouds import profiles_of
from live_nodes import AFFORDED, CONFIG, CONFIG_FILE, hosting, tip_of
from numpy.testing import assert_allclose, assert_array_equal
from sensor_msgs.msg import PointCloud2

from octo_arm_model import Solver
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.ros.node.main import OctoArmNode

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
    with hosting(OctoArmNode, *AFFORDED, *options) as client:
        client.connect()
        profiles = client.hear(PointCloud2, 'tendon_tension_profiles')
        # From the start: time goes back.
        client.stamps = itertools.count(1)
        client.ask('tendon_tensions', HIGH)
        assert_allclose(tip_of(client.ask('tendon_tensions', LOW)), down.tip, atol=1e-9)
        assert_profiles(client, profiles, LOW, down)
        # A parameter that the balance does not depend on leaves the history as it is.
        assert client.change(markers_rate=10.0) == (True, '')
        assert_allclose(tip_of(client.ask('tendon_tensions', LOW)), down.tip, atol=1e-9)
        _, values = client.status('solver')
        assert values['friction history kept'] == 'True'
        forgotten = int(values['friction history forgotten after a gap'])
        client.stamps = itertools.count(100)
        assert_allclose(tip_of(client.ask('tendon_tensions', LOW)), fresh.tip, atol=1e-9)
        _, values = client.status('solver')
        assert int(values['friction history forgotten after a gap']) == forgotten + 1
        # Where a tendon sticks there are no derivatives: a listener does not cost the shape.
        assert client.change(tension_stddev=0.02) == (True, '')
        client.ask('tendon_tensions', HIGH)
        second = client.send('tendon_tensions', 0.999 * HIGH)
        shapes, tips = client.answers['backbone/path'], client.answers['tip_pose']
        client.wait(lambda: shapes[-1].header.stamp.sec == second, 'a shape')
        assert tips[-1].header.stamp.sec < second
        _, values = client.status('solver')
        assert values['shapes without tip_pose'] == '1'
        refused = (False, 'friction_memory is -1.0, expected a finite time >= 0 [s]')
        assert client.change(friction_memory=-1.0) == refused


def assert_profiles(client, profiles, tensions, expected):
    """The tensions along the tendons come with the shape, once the subscription is found."""
    client.stamps = itertools.count(1)

    def arrived():
        client.ask('tendon_tensions', HIGH)
        stamp = client.ask('tendon_tensions', tensions)[0].header.stamp
        client.spin()
        return profiles and profiles[-1].header.stamp == stamp

    client.wait(arrived, 'the tensions along the tendons')
    assert profiles[-1].header.frame_id == CONFIG.base_frame
    found = profiles_of(profiles[-1])
    assert_array_equal(found[:, 3], expected.s)
    assert_allclose(found[:, 4:], expected.tendon_tensions, rtol=1e-9, atol=1e-12)
    # Unloaded, tendons are tighter inside the arm than at the base.
    assert (found[5:, 4:] > 1.02 * found[0, 4:]).any()
