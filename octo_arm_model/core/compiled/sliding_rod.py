"""Loaded rods whose tendons have friction: Newton's method in machine code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.compiled_rod import CompiledRod, quaternions_of, state_of
from octo_arm_model.core.compiled.friction_tables import FrictionTables, friction_tables
from octo_arm_model.core.compiled.numba_build import find_sliding_balance, slide
from octo_arm_model.core.compiled.rod_kernels import ANY_READINGS, READINGS
from octo_arm_model.core.compiled.system_kernels import system_of
from octo_arm_model.core.compiled.tables import own
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.budget import Spending
from octo_arm_model.core.loaded.continuation import MOST_CORRECTED, TOLERANCE
from octo_arm_model.core.loaded.friction import Sliding
from octo_arm_model.core.loaded.newton import Iterate
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.rod.solution import Shape, Solution, TendonTensions

_NOTHING = np.zeros((0, 0))


class _Found(NamedTuple):
    """A balance.

    Attributes:
        held: its condition with tensions that stay, those of the tables.
        shape: its shape.
        slip: as in `Sliding`, (tendons, points).
        systems: iterations of Newton's method.
        corrected: how far all but the first have turned the arm [rad].
        is_resolved: whether elements are as fine as tensions along tendons need.
        sticks: whether any tendon sticks, where strains have a kink that no elements resolve.
    """

    held: Condition
    shape: Shape
    slip: FloatArray
    systems: int
    corrected: float
    is_resolved: bool
    sticks: bool


class SlidingRod:
    """`Newton` and `Settle` of one rod."""

    def __init__(self, rod: LoadedRod) -> None:
        """Tabulate ``rod``.

        Raises:
            Exception: whatever a numba that does not work raises.
        """
        self._compiled, self._newton, self._points = CompiledRod(rod), rod.newton, rod.points
        friction: FrictionTables = own(friction_tables(rod, None))
        self._friction = friction._replace(sections=self._compiled.tables.sections)
        self._find_balance, self._slide = find_sliding_balance(), slide()
        self._unloaded = rod.slide  # which says why there is none
        self._no_system = system_of(0, 0)
        self.frames = self._compiled.frames

    def slide(self, tensions: FloatArray, before: FloatArray | None) -> FloatArray:
        """`Slide` of the rod.

        Raises:
            SolveError: if there is none.
        """
        held, twist = _NOTHING if before is None else own(before), np.empty((4, self._points))
        _, sweeps, _ = self._slide(self._friction, own(tensions), held, twist, _NOTHING, _NOTHING)
        return self._unloaded(tensions, before) if sweeps < 0 else twist

    def newton(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """Iterate until the residual is within ``tolerance``."""
        balance = self._balance(condition, shape, tolerance)
        if balance is None:
            return self._newton(condition, shape, tolerance)
        # With tensions that stay it is balanced, and only judged.
        found = self._compiled.newton(balance.held, balance.shape, tolerance)
        along = self._compiled.tables.sections.transmission
        sliding = Sliding(along[:, np.newaxis].copy(), balance.slip[:, np.newaxis])
        return Iterate(
            found.state._replace(condition=condition, sliding=sliding),
            balance.systems + found.iterations, balance.corrected + found.corrected, found.system,
        )  # fmt: skip

    def settle(
        self, wanted: Condition, shape: Shape, spending: Spending
    ) -> Solution | Shape | None:
        """`Settle` of the rod."""
        balance = self._balance(wanted, shape, TOLERANCE)
        if balance is None:
            return None
        spending.add(balance.systems, 0.0, TOLERANCE, balance.shape.twist)
        if balance.corrected > MOST_CORRECTED:
            return None
        kind = ANY_READINGS if balance.sticks else READINGS
        solution = self._compiled.settle(balance.held, balance.shape, spending, kind)
        if not isinstance(solution, Solution):
            return solution
        if not (balance.sticks or balance.is_resolved):
            return solution.shape
        tables = self._compiled.tables
        along, at_stations = tables.sections.transmission, tables.station_sections.transmission
        return solution._replace(tendons=TendonTensions(along.copy(), at_stations.copy()))

    def _balance(self, condition: Condition, shape: Shape, tolerance: float) -> _Found | None:
        """`find_sliding_balance`."""
        tensions = own(condition.tensions)
        before = _NOTHING if condition.before is None else own(condition.before)
        tables, tip_wrench = self._compiled.tables, own(condition.tip_wrench)
        slip = np.empty_like(tables.sections.transmission)
        near = self._compiled.system_about(shape)
        for known in (None,) if near is None else (near, None):
            state = state_of(shape)
            systems, corrected, sticks, is_resolved = self._find_balance(
                tables, self._friction, tensions, before, tip_wrench, float(condition.factor),
                tolerance, known is not None, known or self._no_system, state, slip,
            )  # fmt: skip
            if systems >= 0:
                held = condition._replace(tensions=np.sign(tensions), before=None)
                found = Shape(state.twist, quaternions_of(state.turn))
                return _Found(held, found, slip, systems, corrected, is_resolved, sticks)
        return None
