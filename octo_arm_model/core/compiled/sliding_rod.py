"""Loaded rods whose tendons have friction: Newton's method in machine code."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.compiled_rod import CompiledRod, quaternions_of, state_of
from octo_arm_model.core.compiled.friction_tables import friction_tables
from octo_arm_model.core.compiled.numba_build import find_sliding_balance
from octo_arm_model.core.compiled.tables import own
from octo_arm_model.core.loaded.friction import Sliding
from octo_arm_model.core.loaded.newton import Iterate
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.rod.solution import Shape


class SlidingRod:
    """`Newton` of one rod."""

    def __init__(self, rod: LoadedRod) -> None:
        """Tabulate ``rod``.

        Raises:
            Exception: whatever a numba that does not work raises.
        """
        self._compiled, self._newton = CompiledRod(rod), rod.newton
        self._friction = own(friction_tables(rod, None))
        self._find_balance = find_sliding_balance()
        self.frames = self._compiled.frames

    def newton(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """Iterate until the residual is within ``tolerance``."""
        tensions, before = own(condition.tensions), np.zeros((0, 0))
        if condition.before is not None:
            before = own(condition.before)
        tables, state = self._compiled.tables, state_of(shape)
        slip = np.full(tables.sections.transmission.shape, -1.0)
        systems, corrected = self._find_balance(
            tables, self._friction, tensions, before, own(condition.tip_wrench),
            float(condition.factor), tolerance, state, slip,
        )  # fmt: skip
        if systems < 0:
            return self._newton(condition, shape, tolerance)
        # With tensions that stay it is balanced, and only judged.
        near = Shape(state.twist, quaternions_of(state.turn))
        along = tables.sections.transmission
        held = condition._replace(tensions=(tensions > 0.0).astype(np.float64), before=None)
        found = self._compiled.newton(held, near, tolerance)
        sliding = Sliding(along[:, np.newaxis].copy(), slip[:, np.newaxis])
        return Iterate(
            found.state._replace(condition=condition, sliding=sliding),
            systems + found.iterations, corrected + found.corrected, found.system,
        )  # fmt: skip
