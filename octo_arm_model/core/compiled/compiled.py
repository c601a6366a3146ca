"""The paper's models in machine code, many times as quick for one arm; see `numba_build`.

Shapes are those of NumPy to rounding.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.core.compiled.numba_build import find_shapes
from octo_arm_model.core.compiled.tables import Tables, march_tables, no_march, packed
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.models.closed_form import ClosedForm
from octo_arm_model.core.models.papers_model import PapersModel
from octo_arm_model.core.models.renda2012 import Renda2012
from octo_arm_model.core.models.statics import Statics
from octo_arm_model.core.rod.assembly import Results
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame


class Compiled:
    """Shapes of one arm by a model of the paper."""

    def __init__(self, statics: Statics, grid: StationGrid, base: Frame) -> None:
        """Tabulate the arm of ``statics`` on ``grid``, standing on ``base``.

        Raises:
            ModuleNotFoundError: if numba is not installed.
            Exception: whatever a numba that does not work raises.
        """
        assert isinstance(statics, PapersModel)
        self._find_shapes = find_shapes()
        equations = statics.equations
        assert isinstance(equations, ClosedForm | Renda2012)
        march = march_tables(equations.march) if isinstance(equations, Renda2012) else no_march()
        a, b = (complex(part) for part in base.rotation)
        tables = Tables(
            weights=packed(equations.weights.matrices),
            stiffness=np.array(equations.stiffness),
            march=march,
            step=grid.step,
            station_node=grid.station_node,
            base=np.array([*base.position, a.real, a.imag, b.real, b.imag]),
        )
        self._tables: Tables = _own(tables)

    @staticmethod
    def covers(statics: Statics) -> bool:
        """Whether the kernels cover the model and the arm.

        They do where tendons make neither mixed second moment nor routing torque, see
        `TendonSums`; the paper's make neither.
        """
        if not isinstance(statics, PapersModel):
            return False
        equations = statics.equations
        return isinstance(equations, ClosedForm | Renda2012) and equations.weights.is_plain

    def solve(self, tensions: FloatArray, results: Results) -> list[int]:
        """Solve for ``tensions`` (batch, tendons) [N] and fill in ``results``.

        Returns:
            Numbers of the arms that have no answer, and have to be solved otherwise.
        """
        strains, others = results.strains, results.arrays
        if results.is_one:
            strains = strains[:, np.newaxis]
            others = tuple(array[np.newaxis] for array in others)
        without = self._find_shapes(self._tables, tensions, results.twist, strains, *others)
        return np.flatnonzero(results.iterations < 0).tolist() if without else []


def _own(value: Any) -> Any:
    """A copy with arrays that can be written and lie in order: one type for the compiler."""
    if isinstance(value, np.ndarray):
        return np.array(value, order='C')
    return type(value)(*map(_own, value)) if hasattr(value, '_fields') else value
