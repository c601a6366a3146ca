"""Arms without loads whose tendons have friction, in machine code."""

from __future__ import annotations

import functools

import numpy as np

from octo_arm_model.core.compiled.friction.friction_tables import FrictionTables, friction_tables
from octo_arm_model.core.compiled.friction.sliding_kernels import UNRESOLVED, remembered
from octo_arm_model.core.compiled.kernel_compiler import entry_point
from octo_arm_model.core.compiled.models.arm_tables import GridTables, own
from octo_arm_model.core.compiled.numba_build import find_sliding_shapes
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.kept_balances import KeptBalances
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.models.sliding import CUTS
from octo_arm_model.core.models.sliding_closed_form import SlidingClosedForm
from octo_arm_model.core.rod.assembly import Results
from octo_arm_model.core.rod.solution import TendonTensions

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
        stations = np.zeros((*position.shape[:2], tensions.shape[1]))
        level = 0 if before is None else self._rods.level_of(before)
        known = None if before is None else self._kept.about(before)
        while True:
            tables = self._tables(level)
            at_level = self._rods.at_level(before, level)
            held = _NOTHING if at_level is None else own(at_level)
            points = np.empty(tables.transmission.shape)
            memory = _NOTHING
            if results.is_one:
                pulled = int(np.count_nonzero(tensions))
                memory = np.empty((remembered(pulled), tables.lengths.size))
            without = self._find_shapes(
                tables, self._grid, own(tensions), held, level + 1 < len(CUTS), results.twist,
                strains, position, quaternion, residual, iterations, points, stations,
                _NOTHING if known is None or at_level is not before else known, memory,
            )  # fmt: skip
            if not without or not (iterations == UNRESOLVED).any():
                break
            level += 1
        at_stations = stations.transpose(2, 0, 1)
        if results.is_one:
            if not without:
                self._kept.keep(points, memory)
            results.add_tendons((), TendonTensions(points, at_stations[:, 0]))
        else:
            results.add_tendons(slice(None), TendonTensions(points[:, np.newaxis], at_stations))
        return np.flatnonzero(iterations < 0).tolist() if without else []
