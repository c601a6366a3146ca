"""Loaded rods in machine code: Newton's method and what is read out, as `loaded` has them."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.numba_build import (
    differentiate,
    differentiate_tip,
    find_minima,
    find_turn,
    newton,
    read_rod,
)
from octo_arm_model.core.compiled.rod_tables import RodTables, parameter_tables, rod_tables
from octo_arm_model.core.compiled.state_kernels import RodState, empty_state
from octo_arm_model.core.compiled.tables import own
from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.linearised import TipAnswer
from octo_arm_model.core.loaded.newton import Iterate
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.state import Condition, State
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.solution import Shape

_NO_LOADS = np.zeros((0, 3, 0)), np.zeros((0, 3, 0))


class CompiledRod:
    """`Newton` and `ReadOut` of one rod."""

    def __init__(self, rod: LoadedRod) -> None:
        """Tabulate ``rod``.

        Raises:
            Exception: whatever a numba that does not work raises.
        """
        self._tables, self._parameters = own(rod_tables(rod)), own(parameter_tables(rod))
        self._loads = rod.equilibrium.loads
        self._nodes, self._stations = rod.nodes.element.size, rod.stations.element.size
        self._newton, self._read_out = newton(), read_rod()
        self._differentiate, self._differentiate_tip = differentiate(), differentiate_tip()
        self._find_turn, self._find_minima = find_turn(), find_minima()
        self._minimum = rod.minimum  # which says why there is none

    @property
    def tables(self) -> RodTables:
        """The rod, under loads as large as they are now."""
        if self._loads.scaled is not None:
            dead = self._loads.dead
            self._tables.force[:], self._tables.moment[:] = dead.force, dead.moment
        return self._tables

    def frames(self, angular: FloatArray) -> Quaternions:
        """`Frames` of the rod."""
        turn = np.zeros((4, angular.shape[1]))
        twist = np.zeros_like(turn)
        twist[:3] = angular
        turn[0] = 1.0
        self._find_turn(self.tables, twist, turn)
        return quaternions_of(turn)

    def minimum(self, tensions: FloatArray) -> FloatArray:
        """`Minimum` of the rod.

        Raises:
            SolveError: if there is none.
        """
        sections = self.tables.sections
        twist = np.empty((4, sections.axial.size))
        _, steps = self._find_minima(sections, own(tensions), twist)
        return self._minimum(tensions) if steps < 0 else twist

    def read_out(self, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`ReadOut` of the rod."""
        count = self._stations
        twist, position = np.empty((4, self._nodes)), np.empty((count, 3))
        quaternion = np.empty((count, 4))
        balanced, condition = state_of(state.shape), state.condition
        balanced.rotation[:], balanced.force[:] = state.rotation, state.force
        self._read_out(
            self.tables, own(condition.tensions), own(condition.tip_wrench), balanced,
            twist, position, quaternion,
        )  # fmt: skip
        return twist, position, quaternion

    def differentiate(
        self, condition: Condition, shape: Shape, dead: tuple[FloatArray, FloatArray] | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`Differentiate` of the rod."""
        tensions = condition.tensions
        columns = len(dead[0]) if dead else 2 * tensions.size + 8
        pose = np.empty((self._stations, 6, columns))
        strain = np.empty((self._stations, 4, columns))
        length = np.empty((tensions.size, columns))
        self._check(
            self._differentiate(
                self.tables, self._parameters, own(tensions), own(condition.tip_wrench),
                state_of(shape), *(dead or _NO_LOADS), pose, strain, length,
            )
        )  # fmt: skip
        return pose, strain, length

    def differentiate_tip(self, condition: Condition, shape: Shape) -> FloatArray:
        """`DifferentiateTip` of the rod."""
        tensions = condition.tensions
        tip = np.empty((6, 2 * tensions.size + 2))
        self._check(
            self._differentiate_tip(
                self.tables, self._parameters, own(tensions), own(condition.tip_wrench),
                state_of(shape), tip,
            )
        )  # fmt: skip
        return tip

    @staticmethod
    def _check(sign: int) -> None:
        if sign == 0:
            raise ConvergenceError('the balance under load', np.inf, 0)

    def newton(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """Iterate until the residual is within ``tolerance``."""
        state = state_of(shape)
        compliance, change = np.empty((6, 6)), np.empty((*state.twist.shape, 6))
        residual, iterations, strayed, sign, is_definite = self._newton(
            self.tables, own(condition.tensions), own(condition.tip_wrench),
            float(condition.factor), tolerance, state, compliance, change,
        )  # fmt: skip
        rotation = state.rotation
        found = State(
            condition,
            Shape(state.twist, quaternions_of(state.turn)),
            rotation, rotation[:, 0] * state.twist[3], state.moment, state.force,
            state.imbalance, state.hessian, residual,
        )  # fmt: skip
        answer = None
        if sign:
            answer = TipAnswer(compliance, change.transpose(0, 2, 1), sign, is_definite)
        return Iterate(found, iterations, strayed, answer)


def state_of(shape: Shape) -> RodState:
    """Room for a state, of which ``shape`` is known."""
    state = empty_state(shape.twist.shape[1])
    state.twist[:], state.turn[:] = shape.twist, _turn(shape.orientation)
    return state


def quaternions_of(turn: FloatArray) -> Quaternions:
    """Of components w, x, y, z (4, points)."""
    return Quaternions(turn[0] + 1j * turn[1], turn[2] + 1j * turn[3])


def _turn(orientation: Quaternions) -> FloatArray:
    """Components w, x, y, z (4, points)."""
    a, b = orientation
    return np.array([a.real, a.imag, b.real, b.imag])
