"""Poses of the bases of the eight arms of an octopus."""

from __future__ import annotations

import math

ARMS = 8
RADIUS = 0.05  # of the circle of their bases [m]


def base_pose(number: int, radius: float = RADIUS) -> tuple[list[float], list[float]]:
    """Position [m] and quaternion x, y, z, w of the base of arm ``number``, from 1 on.

    The bases are on a circle in the plane x, y of the body, the first on its x axis. Every arm
    points outwards; its n is along the circle, its b along z of the body.
    """
    angle = 2.0 * math.pi * (number - 1) / ARMS
    position = [radius * math.cos(angle), radius * math.sin(angle), 0.0]
    return position, [0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)]
