"""Derivatives by machine code are those of the very shape that they are asked for."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model import Arm, Body, Material, Section, Solver

pytest.importorskip('numba')

COLUMN = Arm(Material(1e5), Body(0.4, 0.01, 0.01), (Section(0.4, 0.005, 0.005),))
EULER = 1e5 * np.pi**3 * 0.01**4 / (16.0 * 0.4**2)  # [N], of a column that is held at its base


@pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
@pytest.mark.parametrize(
    ('tension', 'part'), [(0.5, 0.5), (0.5, 0.507), (0.5075, 0.5), (0.9, 0.5)]
)
def test_they_are_also_where_steps_turn_nothing(law: str, tension: float, part: float) -> None:
    # A straight arm is followed without a turn that would tell of the steps made.
    machine, numpy = (
        Solver(COLUMN, 'exact', 31, material=law, compiled=is_compiled)
        for is_compiled in (True, False)
    )
    begin = machine.solve(np.full((1, 4), 0.5), (-0.5 * EULER, 0.0, 0.0, 0.0, 0.0, 0.0))
    tensions, wrench = np.full((1, 4), tension), (-part * EULER, 0.0, 0.0, 0.0, 0.0, 0.0)
    found = begin if (tension, part) == (0.5, 0.5) else machine.follow(tensions, begin, wrench)
    one, other = machine.sensitivity(found), numpy.sensitivity(numpy.solve(tensions, wrench))
    for name in ('by_tension', 'by_youngs_modulus', 'by_tip_wrench', 'by_offset'):
        a, b = getattr(one, name).pose, getattr(other, name).pose
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-8 * np.abs(b).max(), err_msg=name)
