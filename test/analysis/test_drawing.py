"""What is drawn: tubes and arrows of what is probable, colours of tensions, bases of arms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from octo_arm_model import Arm, Discs, Material, RectangularBody, Section, Solver, load_config
from octo_arm_model.analysis.drawing import (
    ARROW_TRIANGLES,
    CONE_TRIANGLES,
    CORNERS,
    INSIDE,
    Drawing,
    UncertaintyDrawing,
)
from octo_arm_model.config.parameter_files import preset_path

CONFIG = load_config(preset_path('renda2012_prototype'))
SOLVER = CONFIG.solver('exact', 21)
SHAPE = SOLVER.solve([[1.0, 0.4, 0.3, 0.5]])
DRAWING = UncertaintyDrawing(CONFIG.arm, SHAPE.s)
FORCE = np.array([0.002, -0.004, 0.008])
COUNT = 40_000


def covariance(seed: int, scale: float) -> np.ndarray:
    root = scale * np.random.default_rng(seed).normal(size=(3, 3))
    return root @ root.T


def test_tendons_are_straight_between_discs():
    arm = dataclasses.replace(CONFIG.arm, discs=Discs.evenly(4, CONFIG.arm.length))
    shape = Solver(arm, 'exact', 21).solve([[0.3, 0.1, 0.0, 0.1]])
    drawn = Drawing(arm, shape.s).draw(shape.position, shape.quaternion, shape.q)
    for path in drawn.tendons:
        steps = np.diff(path, axis=0).reshape(4, 5, 3)
        assert_allclose(steps, np.repeat(steps[:, :1], 5, axis=1), atol=1e-12)
        assert np.linalg.norm(np.cross(steps[0, 0], steps[1, 0])) > 1e-6 * arm.length**2


def test_the_body_ends_within_the_tube_as_often_as_is_said():
    given = np.stack([covariance(number, 1e-3) for number in range(21)])
    tube = DRAWING.tube(SHAPE.position, SHAPE.quaternion, given)
    rings = tube[:-2].reshape(-1, 21, 3)
    for station in (0, 7, 20):
        moved = np.random.default_rng(1).multivariate_normal(np.zeros(3), given[station], COUNT)
        for corner in rings[::4, station] - SHAPE.position[station]:
            reach = np.linalg.norm(corner)
            radius = 1.03 * float(CONFIG.arm.body.radius(SHAPE.s[station]))
            inside = np.abs(moved @ corner / reach) <= reach - radius
            # Four standard errors of a share.
            assert inside.mean() == pytest.approx(
                INSIDE, abs=4.0 * np.sqrt(INSIDE * (1.0 - INSIDE) / COUNT)
            )


def test_the_cone_holds_as_much_of_the_directions_as_is_said():
    given = covariance(3, 1e-3)
    arrow = DRAWING.arrow(np.zeros(3), FORCE, given)
    assert arrow is not None
    # Where the plane through its end cuts the probable forces, which are drawn to its scale.
    scale = np.linalg.norm(arrow.end) / np.linalg.norm(FORCE)
    assert_allclose(arrow.end, scale * FORCE, rtol=1e-12)
    along = FORCE / np.linalg.norm(FORCE)
    rim = arrow.cone[:CORNERS] - arrow.end
    assert_allclose(rim @ along, 0.0, atol=1e-12)
    samples = np.random.default_rng(2).multivariate_normal(np.zeros(3), scale**2 * given, COUNT)
    axes = np.linalg.svd(along[np.newaxis])[2][1:]
    # A point is within an ellipse if it is within the linear image that makes that a circle.
    ellipse = rim @ axes.T
    basis = np.stack([ellipse[0], ellipse[CORNERS // 4]], axis=1)
    inside = np.linalg.norm(np.linalg.solve(basis, axes @ samples.T), axis=0) <= 1.0
    assert inside.mean() == pytest.approx(
        INSIDE, abs=4.0 * np.sqrt(INSIDE * (1.0 - INSIDE) / COUNT)
    )


def test_a_force_that_may_be_none_has_no_arrow():
    given = np.diag([0.01, 0.002, 0.004]) ** 2
    assert DRAWING.arrow(np.zeros(3), 0.5 * FORCE, given) is None
    assert DRAWING.arrow(np.zeros(3), 2.0 * FORCE, given) is not None


def test_arrows_grow_with_the_force_up_to_a_length_and_turn_with_it():
    given = 1e-12 * np.eye(3)
    lengths = [
        np.linalg.norm(DRAWING.arrow(np.zeros(3), part * FORCE, given).end)
        for part in (1.0, 2.0, 1e6)
    ]
    assert lengths[1] == pytest.approx(2.0 * lengths[0])
    assert lengths[2] == pytest.approx(0.6 * CONFIG.arm.length)
    turn = Rotation.from_rotvec([0.3, 1.0, -0.5])
    start = np.array([0.1, 0.2, 0.3])
    one = DRAWING.arrow(start, FORCE, given)
    other = DRAWING.arrow(start, turn.apply(FORCE), given)
    assert_allclose(turn.apply(one.end - start), other.end - start, atol=1e-12)
    assert ARROW_TRIANGLES.max() == len(one.shaft) - 1
    assert CONE_TRIANGLES.max() == len(one.cone) - 1


def test_a_strip_is_drawn_with_its_corners():
    body = RectangularBody(0.3, 0.02, 0.006)
    solver = Solver(Arm(Material(1e5), body, (Section(0.3, 0.002, 0.002),)), 'exact', 2)
    found = solver.solve(np.zeros((1, 4)))
    drawing = Drawing(solver.arm, solver.grid.s)
    drawn = drawing.draw(found.position, found.quaternion, found.q)
    corners = drawn.vertices[:-2].reshape(-1, 2, 3)[::3, 1]
    assert_allclose(
        corners[:, 1:], [[0.01, 0.003], [-0.01, 0.003], [-0.01, -0.003], [0.01, -0.003]]
    )
    a, b, c = drawn.vertices[drawing.triangles].swapaxes(0, 1)
    # Triangles anticlockwise from outside enclose the volume of the body.
    volume = np.einsum('ij,ij->', a, np.cross(b, c)) / 6.0
    assert_allclose(volume, 0.3 * 0.02 * 0.006)
