"""Results of the statics: strains of a batch of arms."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.numerics.quaternion import Quaternions


class Shape(NamedTuple):
    """State of a loaded rod for continuation: strains and orientations at the points of the model.

    Attributes:
        twist: see `Solution`, (4 or 6, points).
        orientation: of the cross sections at the points, (points,).
    """

    twist: FloatArray
    orientation: Quaternions


class Solution(NamedTuple):
    """Solved statics of a batch of arms.

    Attributes:
        twist: motion of the frame per reference length, in its own axes: angular (1 + q) (tau,
            xi, k) [1/m], then linear 1 + q [-] along t (and shear along n and b, if any),
            (4 or 6, batch, nodes), or (4 or 6, nodes) of one arm.
        residual: relative residual of the model's equations, (batch,), or one for all.
        iterations: number of iterations, likewise.
        shape: of one loaded arm, for continuation.
        frames: position (..., stations, 3) [m] and orientation x, y, z, w (..., stations, 4) of
            the stations, where they are known better than from the twist at the nodes.
    """

    twist: FloatArray
    residual: FloatArray | float
    iterations: IntArray | int
    shape: Shape | None = None
    frames: tuple[FloatArray, FloatArray] | None = None

    def one(self) -> Solution:
        """The only arm of a batch, without the axis of the batch."""
        if self.twist.ndim == 2:
            return self
        return Solution(
            self.twist[:, 0],
            float(np.max(self.residual)),
            int(np.max(self.iterations)),
            self.shape,
        )
