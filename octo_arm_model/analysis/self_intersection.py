"""Check of a shape for self-intersection, as no model here has contact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray

_LEAST = 1e-30  # [m^2] lower bound of a squared length that is divided by


class Overlap(NamedTuple):
    """Two points of the backbone that are nearer to each other than the sum of their radii.

    Attributes:
        depth: sum of the radii less the distance [m].
        s: arc coordinates of both, that nearer to the base first [m].
    """

    depth: float
    s: tuple[float, float]


def deepest_overlap(s: FloatArray, position: FloatArray, radius: FloatArray) -> Overlap | None:
    """The overlap of largest depth of the body about a backbone; None where there is none.

    Pairs of segments between stations overlap whose centre lines are nearer to each other than
    the sum of their radii. Neighbours are excluded: pairs nearer along the backbone than half the
    circumference of the body. In the tightest possible bend, whose radius is that of the body,
    this is where the backbone has turned back and is one diameter away; so a wider bend never
    overlaps, and a tighter one does where it turns as far.

    Args:
        s: arc coordinate of the stations [m], (stations,).
        position: their positions [m], (stations, 3).
        radius: of the body there [m], (stations,).
    """
    start, along = position[:-1], np.diff(position, axis=0)
    reached = np.append(0.0, np.cumsum(np.linalg.norm(along, axis=1)))
    first, second = np.triu_indices(len(along), 2)
    # Bounding spheres first: few pairs are near enough.
    middle, half = start + 0.5 * along, 0.5 * np.diff(reached)
    thick = np.maximum(radius[:-1], radius[1:])
    apart = np.linalg.norm(middle[second] - middle[first], axis=1)
    is_near = apart < (thick + half)[first] + (thick + half)[second]
    first, second = first[is_near], second[is_near]
    if not first.size:
        return None
    at_first, at_second = _nearest(start[first], along[first], start[second], along[second])
    between = start[second] + at_second[:, np.newaxis] * along[second]
    between -= start[first] + at_first[:, np.newaxis] * along[first]
    radii = _within(radius, first, at_first) + _within(radius, second, at_second)
    separation = _within(reached, second, at_second) - _within(reached, first, at_first)
    depth = radii - np.linalg.norm(between, axis=1)
    depth[separation < 0.5 * np.pi * radii] = -np.inf
    worst = int(np.argmax(depth))
    if depth[worst] <= 0.0:
        return None
    ends = (_within(s, first, at_first)[worst], _within(s, second, at_second)[worst])
    return Overlap(float(depth[worst]), (float(ends[0]), float(ends[1])))


def _within(values: FloatArray, segment: FloatArray, part: FloatArray) -> FloatArray:
    """``values`` (stations,) at a ``part`` (pairs,) of each ``segment``, linear between them."""
    return np.asarray((1.0 - part) * values[segment] + part * values[segment + 1])


def _nearest(
    a: FloatArray, u: FloatArray, b: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Parameters x and y of the nearest points of segments a + x u and b + y v, each (pairs, 3).

    Ericson, Real-Time Collision Detection (2005), section 5.1.9.
    """
    offset = a - b
    uu, vv, uv = (np.sum(p * q, axis=1) for p, q in ((u, u), (v, v), (u, v)))
    uo, vo = np.sum(u * offset, axis=1), np.sum(v * offset, axis=1)
    uu, vv = np.maximum(uu, _LEAST), np.maximum(vv, _LEAST)
    determinant = uu * vv - uv * uv
    is_skew = determinant > 1e-12 * uu * vv
    x = np.where(is_skew, (uv * vo - uo * vv) / np.where(is_skew, determinant, 1.0), 0.0)
    x = np.clip(x, 0.0, 1.0)
    y = np.clip((uv * x + vo) / vv, 0.0, 1.0)
    # The x nearest to the clipped y.
    return np.clip((uv * y - uo) / uu, 0.0, 1.0), y
