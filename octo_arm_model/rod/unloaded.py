"""The balance of every cross section by itself: an arm without loads, or under known wrenches."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.errors import ConvergenceError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.tables import Tables, Work

TOLERANCE = 5e-11


def balance_sections(
    form: Form, tables: Tables, work: Work, tensions: FloatArray, z: FloatArray
) -> tuple[float, int]:
    """Bring the twists ``z`` (n, m) to balance under ``tensions`` (n, J) [N] alone.

    From where they are, or from those of parallel tendons where they are zero.

    Returns:
        Residual and number of steps.

    Raises:
        ConvergenceError: if it does not converge.
    """
    left, steps = form.balance(tables, z, tensions, np.zeros_like(z), TOLERANCE, work)
    if not left <= TOLERANCE:
        raise ConvergenceError('the balance of the cross sections', left, steps)
    return left, steps


def straight_twists(strains: int) -> FloatArray:
    """Twist (m,) of the straight rod."""
    return np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])[:strains]
