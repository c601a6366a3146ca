"""The tube and the arrow in the scene."""

import math

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')

from octo_arm_model import Solver, load_config
from octo_arm_model.analysis.drawing import UncertaintyDrawing
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.viewer.numbers import pushed
from octo_arm_model.viewer.scene import UncertaintyScene
from octo_arm_model.wire.estimate import BackboneCovariance

ARM = load_config(preset_path('renda2012_prototype')).arm
SOLVER = Solver(ARM, 'exact', 21)
SHAPE = SOLVER.solve([[1.0, 0.4, 0.3, 0.5]])
FORCE = np.array([0.0, -0.006, 0.01])


def known(place, stddev=1e-3):
    pose = np.tile(1e-6 * np.eye(6), (21, 1, 1))
    return BackboneCovariance(SHAPE.s, pose, place, stddev**2 * np.eye(6))


def test_what_is_drawn_is_what_is_known(server):
    server.scene.reset()
    scene = UncertaintyScene(server.scene, SOLVER)
    drawing = UncertaintyDrawing(ARM, SHAPE.s, sides=24)

    def mesh(name):
        return server.scene.get_handle_by_name(f'/estimate/{name}')

    station = 13
    scene.show(SHAPE.position, SHAPE.quaternion, known(float(SHAPE.s[station])), FORCE)
    tube = drawing.tube(SHAPE.position, SHAPE.quaternion, known(0.0).pose[:, :3, :3])
    np.testing.assert_allclose(mesh('tube').vertices, tube, atol=1e-7)
    arrow = drawing.arrow(SHAPE.position[station], FORCE, 1e-6 * np.eye(3))
    np.testing.assert_allclose(mesh('force').vertices, arrow.shaft, atol=1e-7)
    np.testing.assert_allclose(mesh('cone').vertices, arrow.cone, atol=1e-7)
    assert mesh('tube').visible and mesh('force').visible and mesh('cone').visible
    # A force that may as well be none is not drawn, nor is one that is not known.
    for unknown in (0.1 * FORCE, None):
        scene.show(SHAPE.position, SHAPE.quaternion, known(0.1), unknown)
        assert mesh('tube').visible
        assert not mesh('force').visible and not mesh('cone').visible
    # That of a current acts everywhere, and is drawn at the middle.
    scene.show(SHAPE.position, SHAPE.quaternion, known(math.nan), FORCE)
    moved = mesh('cone').vertices[-2]
    np.testing.assert_allclose(moved, SHAPE.position[10], atol=1e-4)
    scene.hide()
    assert not mesh('tube').visible


def test_what_is_of_another_arm_is_not_drawn(server):
    server.scene.reset()
    scene = UncertaintyScene(server.scene, SOLVER)
    scene.show(SHAPE.position[1:], SHAPE.quaternion[1:], known(0.1), FORCE)
    assert server.scene.get_handle_by_name('/estimate/tube') is None


def test_a_force_is_told_in_millinewtons_with_its_place():
    text = pushed(FORCE, known(0.12))
    assert '-6.0 &plusmn; 1.0' in text and '10.0 &plusmn; 1.0' in text
    assert 'mN at s = 120 mm' in text
    assert 'all along' in pushed(FORCE, known(math.nan))
