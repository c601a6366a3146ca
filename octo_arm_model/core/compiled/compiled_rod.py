"""Loaded rods in machine code: Newton's method as `loaded.newton` has it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.core.compiled.numba_build import newton
from octo_arm_model.core.compiled.tables import rod_tables
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.equilibrium import Condition, Equilibrium, State
from octo_arm_model.core.loaded.linearised import Response
from octo_arm_model.core.loaded.newton import Iterate
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.solution import Shape


class TipResponse(NamedTuple):
    """The answer to unit wrenches on the tip, found together with the state.

    Attributes:
        sign: of the determinant of the system.
        response: to forces and to moments over a length.
    """

    sign: int
    response: Response

    def solve(self, imbalance: FloatArray) -> Response:
        """The response, whatever ``imbalance``: it is asked for no other."""
        return self.response


class CompiledNewton:
    """`Newton` for one rod."""

    def __init__(self, problem: Equilibrium, own: Any) -> None:
        """Tabulate ``problem``; ``own`` makes tables ready for the compiler.

        Raises:
            Exception: whatever a numba that does not work raises.
        """
        self._problem, self._tables, self._newton = problem, own(rod_tables(problem)), newton()

    def __call__(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """Iterate until the residual is within ``tolerance``."""
        count = shape.twist.shape[1]
        twist, a, b = np.array(shape.twist, order='C'), *map(np.array, shape.orientation)
        rotation, hessian = np.empty((3, 3, count)), np.empty((4, 4, count))
        force, moment = np.empty((3, count)), np.empty((3, count))
        imbalance, change = np.empty((4, count)), np.empty((4, 6, count))
        wrench = np.empty((4, 6, count))
        residual, iterations, strayed, sign = self._newton(
            self._tables, np.array(condition.tensions), np.array(condition.tip_wrench),
            float(condition.factor), tolerance, twist, a, b, rotation, force, moment, imbalance,
            hessian, wrench, change,
        )  # fmt: skip
        state = State(
            condition, Shape(twist, Quaternions(a, b)), rotation, rotation[:, 0] * twist[3],
            moment, force, imbalance, hessian, residual,
        )  # fmt: skip
        system = None
        if sign:
            turn = np.zeros((3, 6, count))
            system = TipResponse(sign * self._problem.unloaded_sign, Response(change, turn))
        return Iterate(state, iterations, strayed, system)
