"""Loaded rods in machine code: Newton's method as `loaded.newton` has it."""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.core.compiled.numba_build import newton
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
        count = shape.twist.shape[1]
        twist, a, b = np.array(shape.twist, order='C'), *map(np.array, shape.orientation)
        rotation, hessian = np.empty((3, 3, count)), np.empty((4, 4, count))
        force, moment = np.empty((3, count)), np.empty((3, count))
        imbalance, change = np.empty((4, count)), np.empty((4, 6, count))
        compliance = np.empty((6, 6))
        try:
            residual, iterations, strayed, sign = self._newton(
                self._tables, np.array(condition.tensions), np.array(condition.tip_wrench),
                float(condition.factor), tolerance, twist, a, b, rotation, force, moment,
                imbalance, hessian, compliance, change,
            )  # fmt: skip
        except np.linalg.LinAlgError:  # a singular system
            return Iterate(self._problem.state(condition, shape), 1, 0.0, None)
        state = State(
            condition, Shape(twist, Quaternions(a, b)), rotation, rotation[:, 0] * twist[3],
            moment, force, imbalance, hessian, residual,
        )  # fmt: skip
        answer = TipAnswer(compliance, change, sign) if sign else None
        return Iterate(state, iterations, strayed, answer)
