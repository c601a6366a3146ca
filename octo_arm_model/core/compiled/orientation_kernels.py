"""Orientations along a loaded rod: what `numba_build` compiles, as `kinematics` has them."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.hints import FloatArray

_MOST_SWEEPS = 60
# Sum of squares of the defects that the last sweep takes out, which leaves a millionth of them.
_SETTLED = 1e-17


def find_rate(
    twist: FloatArray, first: int, half: float, turn: FloatArray, rate: FloatArray
) -> None:
    """Fill in the ``rate`` (4, s) of ``turn`` at points from ``first`` on, times 2 ``half``."""
    a, b, c, d = turn[0], turn[1], turn[2], turn[3]
    for j in range(turn.shape[1]):
        at = first + j
        t, n, m = half * twist[0, at], half * twist[1, at], half * twist[2, at]
        rate[0, j] = -b[j] * t - c[j] * n - d[j] * m
        rate[1, j] = a[j] * t + c[j] * m - d[j] * n
        rate[2, j] = a[j] * n + d[j] * t - b[j] * m
        rate[3, j] = a[j] * m + b[j] * n - c[j] * t


def solve_turn(
    tables: RodTables, twist: FloatArray, element: int, start: FloatArray, turn: FloatArray
) -> None:
    """Fill in ``turn`` (4, s) of one ``element`` from its ``start`` (4,)."""
    s = turn.shape[1]
    first, half = element * s, 0.5 * tables.step[element]
    system, right = np.eye(4 * s), np.empty(4 * s)
    unit, rate = np.zeros((4, s)), np.empty((4, s))
    for k in range(4):
        right[k * s : k * s + s] = start[k]
        unit[:] = 0.0
        unit[k] = 1.0
        find_rate(twist, first, half, unit, rate)
        for m in range(4):
            for i in range(s):
                for j in range(s):
                    system[m * s + i, k * s + j] -= tables.from_start[i, j] * rate[m, j]
    if not np.isfinite(system.sum()):
        turn[:] = np.nan
        return
    found = np.linalg.solve(system, right)
    for k in range(4):
        turn[k] = found[k * s : k * s + s]


def find_turn(tables: RodTables, twist: FloatArray, turn: FloatArray) -> None:
    """Fill in orientations ``turn`` (4, points) under ``twist``, as `kinematics.frames`.

    The collocated equations Q = Q_0 + (integral of Q w / 2) are swept from what is given. A defect
    D of theirs is taken out together with what it does further on in the element,

        e = D + g Q    g' = (D w / 2) Q^-1,

    exact but for the error of Q and of quadrature: few sweeps are enough. Where the twist is so
    large that they are not, the equations of the element are solved. What is given is first
    turned with the start of its element.
    """
    s = tables.weights.size
    rate, defect, more = np.empty((4, s)), np.empty((4, s)), np.empty((4, s))
    start, raw = tables.base.copy(), np.empty((4, s))
    for element in range(tables.step.size):
        first, half = element * s, 0.5 * tables.step[element]
        raw[:] = turn[:, first : first + s]
        turn_with(tables, twist, first, half, start, raw, rate)
        size = 0.0
        for _ in range(_MOST_SWEEPS):
            find_rate(twist, first, half, raw, rate)
            size = 0.0
            for k in range(4):
                out = defect[k]
                out[:] = start[k] - raw[k]
                add_products(rate[k], tables.from_start_columns, out)
                for i in range(s):
                    size += out[i] ** 2
            find_rate(twist, first, half, defect, rate)
            times_inverse(rate, raw, rate)
            more[:] = 0.0
            for k in range(4):
                add_products(rate[k], tables.from_start_columns, more[k])
            add_product(more, raw, defect)
            raw += defect
            if size <= _SETTLED:
                break
        if not size <= _SETTLED:
            solve_turn(tables, twist, element, start, raw)
        find_rate(twist, first, half, raw, rate)
        for k in range(4):
            for j in range(s):
                start[k] += tables.weights[j] * rate[k, j]
        for i in range(s):
            square = raw[0, i] ** 2 + raw[1, i] ** 2 + raw[2, i] ** 2 + raw[3, i] ** 2
            over = 1.0 / np.sqrt(square)
            for k in range(4):
                turn[k, first + i] = over * raw[k, i]


def times_inverse(one: FloatArray, other: FloatArray, out: FloatArray) -> None:
    """Fill in products of quaternions, one times the conjugate of the other, (4, n) each."""
    for j in range(one.shape[1]):
        a, b, c, d = one[0, j], one[1, j], one[2, j], one[3, j]
        w, x, y, z = other[0, j], other[1, j], other[2, j], other[3, j]
        out[0, j], out[1, j] = a * w + b * x + c * y + d * z, b * w - a * x - c * z + d * y
        out[2, j], out[3, j] = c * w - a * y + b * z - d * x, d * w - a * z - b * y + c * x


def add_product(one: FloatArray, other: FloatArray, out: FloatArray) -> None:
    """Add products of quaternions, (4, n) each."""
    for j in range(one.shape[1]):
        a, b, c, d = one[0, j], one[1, j], one[2, j], one[3, j]
        w, x, y, z = other[0, j], other[1, j], other[2, j], other[3, j]
        out[0, j] += a * w - b * x - c * y - d * z
        out[1, j] += a * x + b * w + c * z - d * y
        out[2, j] += a * y - b * z + c * w + d * x
        out[3, j] += a * z + b * y - c * x + d * w


def turn_by(angle: FloatArray, turn: FloatArray, out: FloatArray) -> None:
    """Fill in orientations ``turn`` (4, n) turned by small angles (3, n) in base_frame [rad]."""
    for j in range(turn.shape[1]):
        b, c, d = 0.5 * angle[0, j], 0.5 * angle[1, j], 0.5 * angle[2, j]
        w, x, y, z = turn[0, j], turn[1, j], turn[2, j], turn[3, j]
        over = 1.0 / np.sqrt(1.0 + (b * b + c * c + d * d))
        out[0, j] = over * (w - b * x - c * y - d * z)
        out[1, j] = over * (x + b * w + c * z - d * y)
        out[2, j] = over * (y - b * z + c * w + d * x)
        out[3, j] = over * (z + b * y - c * x + d * w)


def turn_with(
    tables: RodTables, twist: FloatArray, first: int, half: float, start: FloatArray,
    raw: FloatArray, rate: FloatArray,
) -> None:  # fmt: skip
    """Turn the orientations ``raw`` (4, s) as a whole, to begin nearly with ``start`` (4,)."""
    find_rate(twist, first, half, raw, rate)
    begin, whole = np.empty((4, 1)), np.zeros((4, raw.shape[1]))
    for k in range(4):
        begin[k, 0] = raw[k, 0]
        for j in range(tables.weights.size):
            begin[k, 0] -= tables.from_start_columns[j, 0] * rate[k, j]
    times_inverse(start.reshape(4, 1), begin, begin)
    for k in range(4):
        rate[k] = begin[k, 0]
    add_product(rate, raw, whole)
    raw[:] = whole


def find_rotation(turn: FloatArray, rotation: FloatArray) -> None:
    """Fill in the matrices (3, 3, points) of orientations."""
    for i in range(turn.shape[1]):
        w, x, y, z = turn[0, i], turn[1, i], turn[2, i], turn[3, i]
        rotation[0, 0, i] = 1.0 - 2.0 * (y * y + z * z)
        rotation[0, 1, i], rotation[1, 0, i] = 2.0 * (x * y - z * w), 2.0 * (x * y + z * w)
        rotation[0, 2, i], rotation[2, 0, i] = 2.0 * (x * z + y * w), 2.0 * (x * z - y * w)
        rotation[1, 1, i] = 1.0 - 2.0 * (x * x + z * z)
        rotation[1, 2, i], rotation[2, 1, i] = 2.0 * (y * z - x * w), 2.0 * (y * z + x * w)
        rotation[2, 2, i] = 1.0 - 2.0 * (x * x + y * y)
