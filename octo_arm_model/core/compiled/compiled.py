"""The paper's models in machine code, many times as quick for one arm; see `machine_code`.

Shapes are those of NumPy to rounding, which is not to the last bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.core.compiled.numba_build import find_shapes
from octo_arm_model.core.compiled.tables import Tables, march_tables, no_march, packed
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.models.closed_form import ClosedForm
from octo_arm_model.core.models.renda2012 import Renda2012
from octo_arm_model.core.rod.assembly import Results
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame


class Compiled:
    """Shapes of one arm by a model of the paper."""

    def __init__(self, statics: ClosedForm | Renda2012, grid: StationGrid, base: Frame) -> None:
        """Tabulate the arm of ``statics`` on ``grid``, standing on ``base``.

        Raises:
            ModuleNotFoundError: if numba is not installed.
            Exception: whatever a numba that does not work raises.
        """
        self._find_shapes = find_shapes()
        march = march_tables(statics.march) if isinstance(statics, Renda2012) else no_march()
        a, b = (complex(part) for part in base.rotation)
        tables = Tables(
            weights=packed(statics.weights.matrices),
            stiffness=np.array(statics.stiffness),
            march=march,
            step=grid.step,
            station_node=grid.station_node,
            base=np.array([*base.position, a.real, a.imag, b.real, b.imag]),
        )
        self._tables: Tables = _own(tables)

    @classmethod
    def of(
        cls, statics: ClosedForm | Renda2012, grid: StationGrid, base: Frame
    ) -> Compiled | None:
        """`Compiled`, if the loops cover the arm.

        They do where tendons make neither mixed second moment nor routing torque, see
        `TendonSums`; the paper's make neither.

        Raises:
            ModuleNotFoundError: if numba is not installed.
            Exception: whatever a numba that does not work raises.
        """
        return cls(statics, grid, base) if statics.weights.is_plain else None

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
