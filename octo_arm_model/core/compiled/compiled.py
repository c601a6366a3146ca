"""The paper's models solved by compiled kernels, many times faster for one arm; see `numba_build`.

The results are those of NumPy up to rounding.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.models.arm_tables import (
    GridTables,
    PapersTables,
    grid_tables,
    own,
    papers_tables,
)
from octo_arm_model.core.compiled.numba_build import find_shapes, read_out
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.models.closed_form import ClosedForm
from octo_arm_model.core.models.papers_model import PapersModel
from octo_arm_model.core.models.renda2012 import Renda2012
from octo_arm_model.core.models.statics import Statics
from octo_arm_model.core.rod.assembly import Results
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame


class Compiled:
    """Shapes of one arm under given tensions."""

    def __init__(self, statics: Statics, grid: StationGrid, base: Frame) -> None:
        """Tabulate the arm of ``statics`` on ``grid``, with the base in the pose ``base``.

        Raises:
            ModuleNotFoundError: if numba is not installed.
            Exception: any error of a numba that does not work.
        """
        assert isinstance(statics, PapersModel)
        assert isinstance(statics.equations, ClosedForm | Renda2012)
        self._read_out = read_out()
        self._grid: GridTables = own(grid_tables(grid, base))
        self._find_shapes = find_shapes()
        self._tables: PapersTables = own(papers_tables(statics.equations))

    def read_out(
        self, twist: FloatArray, strains: FloatArray, position: FloatArray, quaternion: FloatArray
    ) -> None:
        """`ReadOut` of `Results`: the stations of one arm under ``twist`` (4, nodes)."""
        self._read_out(self._grid, own(twist), strains, position, quaternion)

    @staticmethod
    def covers(statics: Statics) -> bool:
        """Whether the kernels cover the model and the arm.

        The paper's models without mixed second moment and routing torque, see `TendonSums`, and
        without friction.
        """
        if not isinstance(statics, PapersModel):
            return False
        equations = statics.equations
        return isinstance(equations, ClosedForm | Renda2012) and equations.weights.is_plain

    def solve(self, tensions: FloatArray, results: Results) -> list[int]:
        """Solve for ``tensions`` (batch, tendons) [N] and fill in ``results``.

        Returns:
            Indices of the arms for which the kernels did not converge.
        """
        strains, arrays = results.batch
        failures = self._find_shapes(
            self._tables, self._grid, tensions, results.twist, strains, *arrays
        )
        return np.flatnonzero(results.iterations < 0).tolist() if failures else []
