"""Results of the statics: strains of a batch of arms."""

from __future__ import annotations

from collections.abc import Sequence
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


class TendonTensions(NamedTuple):
    """Tensions of tendons with friction along them.

    Attributes:
        points: tensions at the points of the model [N], (tendons, batch, points), or (tendons,
            points) of one arm. Where the arms of a batch were solved one by one, on points that
            may differ, those of the last arm alone.
        stations: tensions at the stations [N], (tendons, batch, stations), or (tendons, stations).
    """

    points: FloatArray
    stations: FloatArray


class Solution(NamedTuple):
    """Solved statics of a batch of arms.

    Attributes:
        twist: motion of the frame per reference length, in its own axes: angular (1 + q) (tau,
            xi, k) [1/m], then linear 1 + q [-] along t (and shear along n and b, if any),
            (4 or 6, batch, nodes), or (4 or 6, nodes) of one arm.
        residual: relative residual of the model's equations [-], (batch,), or one for all arms.
        iterations: number of iterations, (batch,), or one for all arms.
        shape: state of a single loaded arm, for continuation.
        frames: position (..., stations, 3) [m] and orientation x, y, z, w (..., stations, 4) of
            the stations, where the model has them more accurately than by integrating the twist.
        tendons: tensions along the tendons, where these have friction.
        strains: strains of one arm at the stations, as in `Results`; None to compute them there.
    """

    twist: FloatArray
    residual: FloatArray | float
    iterations: IntArray | int
    shape: Shape | None = None
    frames: tuple[FloatArray, FloatArray] | None = None
    tendons: TendonTensions | None = None
    strains: FloatArray | None = None

    def one(self) -> Solution:
        """Solution of the only arm of a batch, without the axis of the batch."""
        if self.twist.ndim == 2:
            return self
        return Solution(
            self.twist[:, 0],
            np.asarray(self.residual).item(),
            np.asarray(self.iterations).item(),
            self.shape,
            self.frames and (self.frames[0][0], self.frames[1][0]),
            self.tendons and TendonTensions(*(part[:, 0] for part in self.tendons)),
        )


def stacked(found: Sequence[Solution]) -> Solution:
    """Combine solutions of single loaded arms into that of a batch."""
    frames = [one.frames for one in found if one.frames is not None]
    along = [one.tendons for one in found if one.tendons is not None]
    tendons = None
    if along:
        # Shape and point tensions are those of the last arm: points differ between arms.
        stations = np.stack([one.stations for one in along], axis=1)
        tendons = TendonTensions(along[-1].points[:, np.newaxis], stations)
    position, quaternion = zip(*frames, strict=True)
    return Solution(
        np.stack([one.twist for one in found], axis=1),
        np.array([one.residual for one in found]),
        np.array([one.iterations for one in found]),
        found[-1].shape,
        (np.stack(position), np.stack(quaternion)),
        tendons,
    )
