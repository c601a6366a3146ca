"""Arms without loads whose tendons have friction, in machine code."""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.compiled.friction.friction_kernels import remembered
from octo_arm_model.core.compiled.friction.friction_tables import FrictionTables, friction_tables
from octo_arm_model.core.compiled.friction.sliding_kernels import UNRESOLVED
from octo_arm_model.core.compiled.kernel_compiler import entry_point
from octo_arm_model.core.compiled.models.arm_tables import GridTables, own
from octo_arm_model.core.compiled.numba_build import find_sliding_shapes
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.kept_balances import KeptBalances
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.models.sliding_closed_form import SlidingClosedForm
from octo_arm_model.core.rod.assembly import Results

_NOTHING = np.zeros((0, 0))


class CompiledSliding:
    """Shapes of one arm under its tendons alone, as `Rods` finds them."""

    def __init__(self, statics: Exact | SlidingClosedForm, grid: GridTables) -> None:
        """Tabulate the arm of ``statics``.

        Raises:
            Exception: whatever a numba that does not work raises.
        """
        self._find_shapes = entry_point(find_sliding_shapes())
        self._grid, self._rods = grid, statics.rods
        at_nodes = None if isinstance(statics, Exact) else statics.sections

        def tables(level: int) -> FrictionTables:
            made: FrictionTables = own(friction_tables(self._rods.rod(level), at_nodes))
            return made

        self._tables = functools.lru_cache(tables)
        self._tables(0)
        self._kept: KeptBalances[FloatArray] = KeptBalances()

    def solve(
        self, tensions: FloatArray, before: FloatArray | None, results: Results
    ) -> list[int]:
        """As `Compiled.solve`; tendons slide from tensions ``before`` (tendons, points) [N]."""
        strains, (position, quaternion, residual, iterations) = results.batch
        count, tendons = tensions.shape
        stations = np.zeros((count, position.shape[1], tendons))
        level, known, held = 0, _NOTHING, _NOTHING
        if before is not None:
            level, held = self._rods.level_of(before), np.ascontiguousarray(before, float)
            kept = self._kept.about(before)
            known = _NOTHING if kept is None else kept
        memory = _NOTHING
        while True:
            tables = self._tables(level)
            points = np.empty(tables.transmission.shape)
            if results.is_one:
                pulled = int(np.count_nonzero(tensions))
                memory = np.empty((remembered(pulled), points[0].size))
            without = self._find_shapes(
                tables, self._grid, tensions, held, results.twist, strains,
                position, quaternion, residual, iterations, points, stations, known, memory,
            )  # fmt: skip
            if not without or not (iterations == UNRESOLVED).any():
                break
            level, known = level + 1, _NOTHING
            if before is not None:
                held = own(self._rods.at_level(before, level))
        if results.is_one and not without:
            self._kept.keep(points, memory)
        results.set_tendons(points, stations)
        return np.flatnonzero(iterations < 0).tolist() if without else []
