"""Second derivatives of the tip by a state, from those by forces on it and by all else."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.state.state_change import StateChange
from octo_arm_model.estimation.state.unknowns import State


class CurvedTip:
    """Where the components of a state are among what `tip_curvature` is by."""

    def __init__(self, state: State) -> None:
        """Of ``state``, whose forces on the tip come first."""
        force = np.arange(state.size)[state.tip_force]
        self._others = np.setdiff1d(state.shaping, force)
        each = np.concatenate([force, self._others])
        # In a matrix (n, n) as one row.
        self._where = (each[:, np.newaxis] * state.size + each).ravel()
        self._size, self._skipped = state.size, 3 - force.size

    def columns(self, change: StateChange, by_tip_force: FloatArray) -> FloatArray:
        """Change of pose by forces on the tip, and by components of the state that are none.

        (stations, 6, 3 + k), with ``by_tip_force`` (stations, 6, 3) per newton.
        """
        return np.concatenate([by_tip_force, change.pose.take(self._others, axis=2)], axis=2)

    def by_state(self, second: FloatArray, ratio: float) -> FloatArray:
        """Second derivatives (3, n, n) by the state, from ``second`` (3, 3 + k, 3 + k).

        The latter is by the `columns`, and is overwritten; forces of the state act divided by
        ``ratio``.
        """
        if ratio != 1.0:
            second[:, :3] /= ratio
            second[:, :, :3] /= ratio
        some = second[:, self._skipped :, self._skipped :]
        found = np.zeros((3, self._size * self._size))
        found[:, self._where] = some.reshape(3, -1)
        return found.reshape(3, self._size, self._size)
