"""Lengths of tendons, and tensions that hold them, in machine code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.compiled.models.arm_tables import GridTables, own
from octo_arm_model.core.compiled.numba_build import find_lengths, wind
from octo_arm_model.core.compiled.section.section_tables import ExactTables
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.assembly import Results
from octo_arm_model.core.section.tendons.tendon_lengths import TendonLengths


class CompiledLengths:
    """Lengths of tendons that keep their places in the cross sections."""

    def __init__(
        self, lengths: TendonLengths, tables: ExactTables | None, grid: GridTables
    ) -> None:
        """Measure ``lengths``; ``tables`` of the model exact.

        Raises:
            Exception: whatever a numba that does not work raises.
        """
        sections = lengths.sections
        parts = [part[:, 0] for part in (sections.x, sections.y, sections.dx, sections.dy)]
        self._path: FloatArray = np.stack(parts, axis=1)
        self._weights: FloatArray = own(lengths.weights)
        self._widens = sections.law.widens
        self._find_lengths = find_lengths()
        self._tables, self._grid = tables, grid
        if tables is not None:
            self._wind = wind()
        lengths.under = self.under

    def under(self, twist: FloatArray, tensions: FloatArray | None) -> FloatArray:
        """A `Measure`."""
        found = np.empty(len(self._path))
        self._find_lengths(self._path, self._weights, self._widens, own(twist), found)
        return found

    def wind(
        self, given: FloatArray, driven: NDArray[np.bool_], tensions: FloatArray,
        changes: FloatArray, displacement: FloatArray, results: Results,
    ) -> bool:  # fmt: skip
        """See `winding_kernels.wind`; whether the tensions were found."""
        if self._tables is None:
            return False
        found = self._wind(
            self._tables, self._grid, self._path, self._weights, self._widens, given, driven,
            tensions, changes, displacement, results.twist, results.strains, results.position,
            results.quaternion,
        )  # fmt: skip
        results.residual[()], results.iterations[()] = found
        return bool(found[1] >= 0)
