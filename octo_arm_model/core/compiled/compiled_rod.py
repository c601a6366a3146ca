"""Loaded rods in machine code: Newton's method and what is read out, as `loaded` has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.core.compiled.numba_build import find_minima, find_turn, newton, read_rod
from octo_arm_model.core.compiled.rod_tables import rod_tables
from octo_arm_model.core.compiled.state_kernels import empty_state
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.linearised import TipAnswer
from octo_arm_model.core.loaded.newton import Iterate
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.state import Condition, State
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.solution import Shape


class CompiledRod:
    """`Newton` and `ReadOut` of one rod."""

    def __init__(self, rod: LoadedRod, own: Any) -> None:
        """Tabulate ``rod``; ``own`` makes tables ready for the compiler.

        Raises:
            Exception: whatever a numba that does not work raises.
        """
        self._tables = own(rod_tables(rod))
        self._nodes, self._stations = rod.nodes.element.size, rod.stations.element.size
        self._newton, self._read_out = newton(), read_rod()
        self._find_turn, self._find_minima = find_turn(), find_minima()
        self._minimum = rod.minimum  # which says why there is none

    def frames(self, angular: FloatArray) -> Quaternions:
        """`Frames` of the rod."""
        turn = np.zeros((4, angular.shape[1]))
        twist = np.zeros_like(turn)
        twist[:3] = angular
        turn[0] = 1.0
        self._find_turn(self._tables, twist, turn)
        return _quaternions(turn)

    def minimum(self, tensions: FloatArray) -> FloatArray:
        """`Minimum` of the rod.

        Raises:
            SolveError: if there is none.
        """
        sections = self._tables.sections
        twist = np.empty((4, sections.axial.size))
        _, steps = self._find_minima(sections, np.array(tensions), twist)
        return self._minimum(tensions) if steps < 0 else twist

    def read_out(self, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`ReadOut` of the rod."""
        count = self._stations
        twist, position = np.empty((4, self._nodes)), np.empty((count, 3))
        quaternion = np.empty((count, 4))
        # Arrays of a `Backbone`, which is followed from, cannot be written.
        shape = state.shape
        self._read_out(
            self._tables, np.array(shape.twist), *map(np.array, shape.orientation),
            np.ascontiguousarray(state.rotation), twist, position, quaternion,
        )  # fmt: skip
        return twist, position, quaternion

    def newton(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
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
            Shape(state.twist, _quaternions(turn)),
            rotation, rotation[:, 0] * state.twist[3], state.moment, state.force,
            state.imbalance, state.hessian, residual,
        )  # fmt: skip
        answer = None
        if sign:
            answer = TipAnswer(compliance, change.transpose(1, 0, 2), sign, is_definite)
        return Iterate(found, iterations, strayed, answer)


def _quaternions(turn: FloatArray) -> Quaternions:
    """Of components w, x, y, z (4, points)."""
    return Quaternions(turn[0] + 1j * turn[1], turn[2] + 1j * turn[3])
