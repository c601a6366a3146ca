"""Orientations by sweeps, as plain Python, against the collocated equations solved at once."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model import Arm, Body, Material, Section
from octo_arm_model.core.compiled.loaded.orientation_kernels import (
    DEFECTS,
    TURN_ROWS,
    find_turn,
    normalise,
)
from octo_arm_model.core.compiled.loaded.rod_tables import no_rod
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.loaded.kinematics import frames
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.rod.stations import StationGrid

ARM = Arm(Material(1e5), Body(0.4, 0.015, 0.006), (Section(0.4, 0.01, 0.006),))


# In the second case integrals of integrals are not small.
@pytest.mark.parametrize('size', [20.0, 2000.0])
def test_orientations_are_those_of_the_collocated_equations(size: float) -> None:
    own = Collocation(ARM, StationGrid.build(ARM, 21), (), 1, 10)
    base = Quaternions.from_xyzw(np.array([0.5, -0.5, 0.5, 0.5]))
    twist = np.ones((4, own.s.size))
    twist[:3] = size * np.stack([np.cos(9.0 * own.s), np.sin(7.0 * own.s), 1.0 - own.s])
    tables = no_rod().elements._replace(
        from_start=own.rule.from_start, from_start_columns=own.rule.from_start.T.copy(),
        weights=own.rule.weights, step=own.step, lengths=np.repeat(own.step, own.rule.points.size),
        base=np.array([0.5, 0.5, -0.5, 0.5]),
    )  # fmt: skip
    turn, work = np.zeros((4, own.s.size)), np.empty((TURN_ROWS, own.s.size))
    turn[0] = 1.0
    with np.errstate(over='ignore', invalid='ignore'):
        assert find_turn(tables, twist, DEFECTS, turn, work) <= DEFECTS
    # From what solves the equations there is nothing to do.
    again = turn.copy()
    assert find_turn(tables, twist, 1.0, again, work) <= DEFECTS
    np.testing.assert_allclose(again, turn, atol=1e-12)
    normalise(turn)
    expected = frames(twist[:3], own, base)
    np.testing.assert_allclose(turn[0] + 1j * turn[1], expected.a, atol=1e-10)
    np.testing.assert_allclose(turn[2] + 1j * turn[3], expected.b, atol=1e-10)
