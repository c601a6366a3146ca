"""Uncertainty of a shape and of a force on it as triangles: a tube, an arrow and its cone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.analysis.geometry.arm_mesh import (
    SIDES,
    ring_stations,
    tube_triangles,
    unit_circle,
)
from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.stiffness import bending_force
from octo_arm_model.rod.interpolation import interpolated
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.rod.sensitivity import chi_square_limit

INSIDE = 0.95  # probability of what is drawn to hold the truth
_ONE, _TWO, _THREE = (chi_square_limit(INSIDE, size) for size in (1, 2, 3))
# A force that moves the tip by _BENT of the length is drawn as _LENGTH of it.
_BENT, _LENGTH = 0.2, 0.3
_LONGEST = 0.6  # of the length
_RIM = 1.03  # tubes are wider than the body, as coincident surfaces flicker
SHAFT = 0.008  # radius of an arrow, relative to the length of the arm
_HEAD, _WIDER = 0.25, 2.5  # of an arrow: its part of the length, and its radius over the shaft's
CORNERS = 24  # of cones and arrows


class Arrow(NamedTuple):
    """A force and how well it is known.

    Attributes:
        start, end: of the arrow [m], (3,).
        shaft: vertices of the arrow, joined by `ARROW_TRIANGLES`, (vertices, 3) [m].
        cone: vertices of the cone of the directions that the force may have, from ``start`` on,
            joined by `CONE_TRIANGLES`, (vertices, 3) [m].
    """

    start: FloatArray
    end: FloatArray
    shaft: FloatArray
    cone: FloatArray


class UncertaintyDrawing:
    """Tubes about shapes of one arm, and arrows of forces on it.

    Attributes:
        triangles: vertices of each triangle of a tube, (triangles, 3).
    """

    def __init__(self, arm: Arm, s: FloatArray, *, sides: int = SIDES) -> None:
        """Prepare for ``arm`` and stations ``s`` (stations,) [m]; ``sides`` as in `Drawing`."""
        self._rings = ring_stations(s.size)
        self._s = s
        self._radius = _RIM * arm.body.radius(s[self._rings])
        self._circle = unit_circle(sides)
        self.triangles = tube_triangles(self._rings.size, sides)
        self._scale = _LENGTH * arm.length / bending_force(arm, _BENT)
        self._longest, self._shaft = _LONGEST * arm.length, SHAFT * arm.length

    def tube(
        self, position: FloatArray, quaternion: FloatArray, covariance: FloatArray
    ) -> FloatArray:
        """Vertices (vertices, 3) [m] of the tube within which the body is.

        In each direction across the arm, where a cross section ends with a probability of
        `INSIDE`.

        Args:
            position: of the stations [m], (stations, 3).
            quaternion: their orientation x, y, z, w, (stations, 4).
            covariance: of their positions [m^2], (stations, 3, 3).
        """
        centre = position[self._rings]
        frame = axes_of(quaternion[self._rings])
        out = np.einsum('xar,ak->krx', frame[:, 1:], self._circle)
        variance = np.einsum('krx,rxy,kry->kr', out, covariance[self._rings], out)
        reach = self._radius + np.sqrt(_ONE * np.maximum(variance, 0.0))
        surface = centre + reach[..., np.newaxis] * out
        return np.concatenate([surface.reshape(-1, 3), centre[[0, -1]]])

    def place(self, position: FloatArray, s: float) -> FloatArray:
        """Where a force at ``s`` [m] acts, (3,) [m]; ``position`` is as that of `tube`.

        The resultant of a current, whose ``s`` is NaN, acts everywhere and is drawn at the middle.
        """
        at = 0.5 * self._s[-1] if np.isnan(s) else s
        return interpolated(at, self._s, position)

    def arrow(self, start: FloatArray, force: FloatArray, covariance: FloatArray) -> Arrow | None:
        """The arrow of a ``force`` (3,) [N] of ``covariance`` (3, 3) from ``start`` (3,) on [m].

        None where no force at all is as well within `INSIDE` of what is probable.
        """
        size = float(np.linalg.norm(force))
        if not size or force @ np.linalg.pinv(covariance) @ force <= _THREE:
            return None
        scale = min(self._scale, self._longest / size)
        along = force / size
        across = np.linalg.svd(along[np.newaxis])[2][1:]
        values, axes = np.linalg.eigh(across @ covariance @ across.T)
        reach = scale * np.sqrt(_TWO * np.maximum(values, 0.0))
        end = start + scale * force
        around = unit_circle(CORNERS)
        rim = end + (axes @ (reach[:, np.newaxis] * around)).T @ across
        cone = np.concatenate([rim, [start, end]])
        neck = end - _HEAD * (end - start)
        rings = [
            middle + radius * (around.T @ across)
            for middle, radius in (
                (start, self._shaft), (neck, self._shaft), (neck, _WIDER * self._shaft),
                (end, 0.0),
            )
        ]  # fmt: skip
        sides = np.stack(rings, axis=1).reshape(-1, 3)
        return Arrow(start, end, np.concatenate([sides, [start, end]]), cone)


ARROW_TRIANGLES: IntArray = tube_triangles(4, CORNERS)
_NEXT = np.roll(np.arange(CORNERS), -1)
CONE_TRIANGLES: IntArray = np.concatenate([
    np.stack([np.arange(CORNERS), _NEXT, np.full(CORNERS, middle)], axis=1)
    for middle in (CORNERS, CORNERS + 1)
])  # fmt: skip
