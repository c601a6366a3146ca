"""The balance of every cross section by itself: an arm without loads, or under known wrenches."""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.arm.errors import ConvergenceError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.equilibrium import Problem
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.tables import Places, Tables, Work, work_arrays

TOLERANCE = 5e-11
_BY_NODE = ('body', 'tendons', 'active', 'reach', 'least_scale')


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


class Several:
    """Arms without loads at the nodes of a `Problem`, one after the other.

    Attributes:
        tables: of all nodes of all arms; elements and weights are those of one.
        work: for these.
    """

    def __init__(self, problem: Problem, arms: int) -> None:
        """Of so many ``arms``."""
        self._problem, own = problem, problem.tables
        tiled: dict[str, Any] = {
            name: np.concatenate([getattr(own, name)] * arms) for name in _BY_NODE
        }
        self.tables = own._replace(**tiled)
        self.work = work_arrays(self.tables, problem.strains, has_jacobian=False)

    def balance(self, tensions: FloatArray) -> tuple[FloatArray, float, int]:
        """See `balance_sections`, of arms under ``tensions`` (A, J) [N]."""
        local = np.repeat(tensions, self._problem.elements.s.size, axis=0)
        z = np.zeros((len(local), self._problem.strains))
        return z, *balance_sections(self._problem.form, self.tables, self.work, local, z)

    def poses(self, z: FloatArray, places: Places) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `loops.poses`."""
        self._problem.form.orientations(self.tables, z, self.work)
        return self._problem.form.poses(self.tables, z, places, self.work)
