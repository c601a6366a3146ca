"""Loaded rods in machine code: Newton's method as `loaded.newton` has it."""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.core.compiled.numba_build import newton
from octo_arm_model.core.compiled.rod_kernels import empty_state
from octo_arm_model.core.compiled.rod_tables import rod_tables
from octo_arm_model.core.loaded.equilibrium import Equilibrium
from octo_arm_model.core.loaded.linearised import TipAnswer
from octo_arm_model.core.loaded.newton import Iterate
from octo_arm_model.core.loaded.state import Condition, State
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.solution import Shape


class CompiledNewton:
    """`Newton` for one rod."""

    def __init__(self, problem: Equilibrium, own: Any) -> None:
        """Tabulate ``problem``; ``own`` makes tables ready for the compiler.

        Raises:
            Exception: whatever a numba that does not work raises.
        """
        self._problem, self._tables = problem, own(rod_tables(problem))
        self._newton = newton()

    def __call__(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """Iterate until the residual is within ``tolerance``."""
        state = empty_state(shape.twist.shape[1])
        a, b = shape.orientation
        state.twist[:] = shape.twist
        turn = state.turn
        turn[0], turn[1], turn[2], turn[3] = a.real, a.imag, b.real, b.imag
        compliance, change = np.empty((6, 6)), np.empty((6, *state.twist.shape))
        residual, iterations, strayed, sign, is_definite = self._newton(
            self._tables, np.array(condition.tensions), np.array(condition.tip_wrench),
            float(condition.factor), tolerance, state, compliance, change,
        )  # fmt: skip
        rotation = state.rotation
        found = State(
            condition,
            Shape(state.twist, Quaternions(turn[0] + 1j * turn[1], turn[2] + 1j * turn[3])),
            rotation, rotation[:, 0] * state.twist[3], state.moment, state.force,
            state.imbalance, state.hessian, residual,
        )  # fmt: skip
        answer = None
        if sign:
            answer = TipAnswer(compliance, change.transpose(1, 0, 2), sign, is_definite)
        return Iterate(found, iterations, strayed, answer)
