"""Several arms side by side, so that one call of a node function serves all of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.equilibrium import Problem
from octo_arm_model.rod.tables import Places, work_arrays
from octo_arm_model.rod.unloaded import balance_sections

_BY_NODE = ('body', 'tendons', 'active', 'reach', 'least_scale')


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
