"""Unit tangents of tendons in the axes of the cross sections, from the twist of the frame.

A tendon at offset r w(lambda) runs along u = (lambda, v_n, v_b) + kappa x w r + w r'; see
`energy` for the letters.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number
from octo_arm_model.core.section.energy import SectionEnergy


def curvature(
    t: Number, n: Number, b: Number, e_t: Number, e_n: Number, e_b: Number,
    slope_t: Number, slope_n: Number, slope_b: Number,
) -> tuple[Number, Number, Number]:  # fmt: skip
    """Derivative e' + kappa x e of the unit tangent e by s, from the angular twist (t, n, b)."""
    return (
        slope_t + (n * e_b - b * e_n),
        slope_n + (b * e_t - t * e_b),
        slope_b + (t * e_n - n * e_t),
    )


def kink_angle(t: Number, n: Number, b: Number) -> Number:
    """Angle [rad] between unit tangents that differ by (t, n, b)."""
    return 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(t * t + n * n + b * b), 1.0))


class Tangents(NamedTuple):
    """Tangents of all tendons at all nodes.

    Attributes:
        unit: components along t, n and b, (3, tendons, batch, nodes).
        stretch: |u|, (tendons, batch, nodes).
    """

    unit: FloatArray
    stretch: FloatArray

    def turned(self, change: FloatArray) -> FloatArray:
        """Change of ``unit`` by a ``change`` of u, (3, tendons, batch, nodes)."""
        along = np.einsum('i...,i...->...', self.unit, change)
        return np.asarray((change - self.unit * along) / self.stretch)


def tangents(energy: SectionEnergy, twist: FloatArray) -> Tangents:
    """`Tangents` of the tendons of ``energy`` under ``twist`` (4 or 6, batch, nodes)."""
    width, _, _ = energy.widening(twist[3])
    x, y, dx, dy = energy.x, energy.y, energy.dx, energy.dy
    t, n, b = width * twist[:3]
    along = n * y
    u = np.empty((3, *along.shape))
    np.add(along - b * x, twist[3], out=u[0])
    np.subtract(width * dx, t * y, out=u[1])
    np.add(width * dy, t * x, out=u[2])
    if len(twist) == 6:
        u[1:] += twist[4:, np.newaxis]
    length = np.sqrt(np.add.reduce(u * u))
    u /= length
    return Tangents(u, length)


def direction_by_twist(energy: SectionEnergy, twist: FloatArray, change: FloatArray) -> FloatArray:
    """Change of u (3, tendons, columns, nodes) by a ``change`` (n, columns, nodes) of ``twist``.

    For one arm, ``twist`` (n, 1, nodes).
    """
    width, slope, _ = energy.widening(twist[3])
    x, y, dx, dy = energy.x, energy.y, energy.dx, energy.dy
    t, n, b = twist[:3]
    d_t, d_n, d_b, d_stretch = change[:4]
    wider = slope * d_stretch
    u = np.empty((3, len(x), *change.shape[1:]))
    u[0] = d_stretch + wider * (n * y - b * x) + width * (d_n * y - d_b * x)
    u[1] = wider * (dx - t * y) - width * d_t * y
    u[2] = wider * (dy + t * x) + width * d_t * x
    if len(change) == 6:
        u[1:] += change[4:, np.newaxis]
    return u
