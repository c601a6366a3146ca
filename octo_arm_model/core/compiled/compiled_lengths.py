"""Tendon lengths, and tensions for prescribed displacements, by compiled kernels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.compiled.kernel_compiler import entry_point
from octo_arm_model.core.compiled.models.arm_tables import GridTables, own
from octo_arm_model.core.compiled.models.winding_kernels import (
    FOUND,
    MOST_STEPS,
    ON_THE_WAY,
    PROGRESS,
    Reeled,
    Winches,
)
from octo_arm_model.core.compiled.numba_build import find_lengths, first_step, next_step, wind
from octo_arm_model.core.compiled.section.section_tables import ExactTables
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.budget import Spending
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.rod.assembly import Results
from octo_arm_model.core.rod.solution import Shape, Solution
from octo_arm_model.core.section.tendons.tendon_lengths import TendonLengths


class CompiledLengths:
    """Lengths of tendons without compliant sheaths."""

    def __init__(
        self, lengths: TendonLengths, tables: ExactTables | None, grid: GridTables
    ) -> None:
        """Replace the `Measure` of ``lengths``; ``tables`` are None unless the model is exact.

        Raises:
            Exception: any error of a numba that does not work.
        """
        sections = lengths.sections
        parts = [part[:, 0] for part in (sections.x, sections.y, sections.dx, sections.dy)]
        self._path: FloatArray = np.stack(parts, axis=1)
        self._weights: FloatArray = own(lengths.weights)
        self._widens = sections.law.widens
        self._find_lengths = find_lengths()
        self._tables, self._grid = tables, grid
        if tables is not None:
            kernels = wind(), first_step(), next_step()
            self._wind, self._first_step, self._next_step = map(entry_point, kernels)
        lengths.under = self.under

    def under(self, twist: FloatArray, tensions: FloatArray | None) -> FloatArray:
        """A `Measure`."""
        found = np.empty(len(self._path))
        self._find_lengths(self._path, self._weights, self._widens, own(twist), found)
        return found

    def winches(self, given: FloatArray, driven: NDArray[np.bool_]) -> Winches:
        """`Winches` of the tendons."""
        return Winches(self._path, self._weights, self._widens, given, driven)

    def wind(self, winches: Winches, reeled: Reeled, results: Results) -> bool:
        """As `winding_kernels.wind`; returns whether it converged."""
        if self._tables is None:
            return False
        found = self._wind(
            self._tables, self._grid, winches, reeled, results.twist, results.strains,
            results.position, results.quaternion,
        )  # fmt: skip
        results.residual[()], results.iterations[()] = found
        return bool(found[1] >= 0)

    def wind_loaded(
        self, winches: Winches, reeled: Reeled, tip_wrench: FloatArray, rod: LoadedRod,
        start: Shape, spending: Spending,
    ) -> Solution | None:  # fmt: skip
        """As `wind`, for a loaded ``rod`` from the shape ``start``; None without convergence.

        Raises:
            ContinuationError: if the budget is spent.
            SolveError: if a tendon is pressed out of the body.
        """
        if self._tables is None or rod.settle is None:
            return None
        shape, step = start, np.zeros_like(reeled.tensions)
        last = self._first_step(winches, reeled, step)
        for number in range(0 if math.isnan(last) else MOST_STEPS):
            condition = Condition(reeled.tensions, tip_wrench, 1.0)
            found = rod.settle(condition, shape, spending)
            if not isinstance(found, Solution) or found.shape is None:
                return None
            shape, progress = found.shape, PROGRESS if number else 1.0
            last, verdict = self._next_step(winches, reeled, found.twist, progress, last, step)
            if verdict != ON_THE_WAY:
                return found if verdict == FOUND else None
        return None
