"""Kernels for the orientations along a loaded rod: the compiled counterpart of `kinematics`.

They integrate unit quaternions w, x, y, z at the collocation points from the twist there.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.loaded.rod_tables import ElementTables
from octo_arm_model.core.compiled.numerics.products import multiply_rows
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray

MOST_SWEEPS = 60
TURN_ROWS = 17  # rows of the room that `find_turn` needs
# Tolerance of the sum of squares of the defects before the last sweep, which reduces the defects
# a millionfold.
DEFECTS = 1e-17
MOST_DEFECTS = 1e-6  # largest such tolerance, for Newton iterates far from equilibrium


@borrows
def find_rate(twist: FloatArray, half: FloatArray, turn: FloatArray, rate: FloatArray) -> None:
    """Fill in ``rate`` (4, n), the derivatives of the quaternions ``turn`` (4, n).

    They are by the coordinate within an element of length one. With the angular rows w of
    ``twist`` and with ``half`` (n,), half the length of the element of each point [m], the
    derivative is the quaternion product Q w times ``half``.
    """
    a, b, c, d = turn[0], turn[1], turn[2], turn[3]
    kappa_t, kappa_n, kappa_b = twist[0], twist[1], twist[2]
    w, x, y, z = rate[0], rate[1], rate[2], rate[3]
    for j in range(half.size):
        t, n, m = half[j] * kappa_t[j], half[j] * kappa_n[j], half[j] * kappa_b[j]
        w[j] = -b[j] * t - c[j] * n - d[j] * m
        x[j] = a[j] * t + c[j] * m - d[j] * n
        y[j] = a[j] * n + d[j] * t - b[j] * m
        z[j] = a[j] * m + b[j] * n - c[j] * t


def solve_turn(
    tables: ElementTables, twist: FloatArray, half: FloatArray, first: int, turn: FloatArray
) -> None:
    """Solve the collocated equations of `find_turn` directly in one element.

    ``first`` is the number of its first point. Fills in the columns of this element in ``turn``
    (4, points): quaternions relative to the orientation at the start of the element, NaN where the
    ``twist`` is not finite.
    """
    s = tables.weights.size
    last = first + s
    system, right = np.eye(4 * s), np.zeros(4 * s)
    right[:s] = 1.0
    unit, rate = np.zeros((4, s)), np.empty((4, s))
    for k in range(4):
        unit[:] = 0.0
        unit[k] = 1.0
        find_rate(twist[:, first:last], half[first:last], unit, rate)
        for m in range(4):
            for i in range(s):
                for j in range(s):
                    system[m * s + i, k * s + j] -= tables.from_start[i, j] * rate[m, j]
    if not np.isfinite(system.sum()):
        turn[:, first:last] = np.nan
        return
    found = np.linalg.solve(system, right)
    for k in range(4):
        turn[k, first:last] = found[k * s : k * s + s]


@borrows
def find_turn(
    tables: ElementTables, twist: FloatArray, tolerance: float, turn: FloatArray, work: FloatArray
) -> float:
    """Fill in the quaternions ``turn`` (4, points) of a rod with ``twist`` (4, points).

    The compiled counterpart of `kinematics.frames`. The quaternions Q relative to the start of an
    element solve the collocated equations

        Q = 1 + (integral of Q w / 2)

    with the angular part w of the twist. The iteration begins at the given ``turn``. Each sweep
    computes the defect D of the equations, right-hand side less Q, and adds the correction

        e = D + g Q    g' = (D w / 2) Q^-1,

    in which g carries the defect along the element. The correction is exact but for the error of Q
    and of quadrature, so that few sweeps suffice. Where the defects do not converge, for large
    twists, `solve_turn` solves the linear equations. Then `chain` composes the quaternions of the
    elements from the base to the tip.

    Quaternions are normalised at the ends of elements only, not at the points, so that a solution
    given as the start satisfies the equations. ``work`` is room for (`TURN_ROWS`, points).

    Returns:
        Sum of squares of the defects before the last sweep, at most ``tolerance``; 0 where the
        linear equations were solved.
    """
    s, elements, count = tables.weights.size, tables.step.size, turn.shape[1]
    rate, defect, more, raw, half = work[:4], work[4:8], work[8:12], work[12:16], work[16]
    integrals, size = tables.from_start_columns, np.inf
    for j in range(count):
        half[j] = 0.5 * tables.lengths[j]
    from_starts(tables, twist, half, turn, rate, raw)
    for _ in range(MOST_SWEEPS):
        find_rate(twist, half, raw, rate)
        multiply_rows(rate, integrals, defect)
        for k in range(4):
            out, found, start = defect[k], raw[k], 0.0 if k else 1.0
            for j in range(count):
                out[j] += start - found[j]
        size = sum_of_squares(defect)
        find_rate(twist, half, defect, rate)
        times_inverse(rate, raw, rate)
        multiply_rows(rate, integrals, more)
        add_product(more, raw, defect)
        raw += defect
        if size <= tolerance:
            break
    if not size <= tolerance:
        for element in range(elements):
            solve_turn(tables, twist, half, element * s, raw)
        size = 0.0
    find_rate(twist, half, raw, rate)
    chain(tables, raw, rate, turn)
    return size


@borrows
def sum_of_squares(rows: FloatArray) -> float:
    """Sum of squares of all elements of ``rows`` (4, n)."""
    # Four independent sums, since each addition to one sum waits for the previous addition.
    a, b, c, d = rows[0], rows[1], rows[2], rows[3]
    e, f, g, h = 0.0, 0.0, 0.0, 0.0
    for j in range(a.size):
        e, f, g, h = e + a[j] * a[j], f + b[j] * b[j], g + c[j] * c[j], h + d[j] * d[j]
    return (e + f) + (g + h)


@borrows
def from_starts(
    tables: ElementTables, twist: FloatArray, half: FloatArray, turn: FloatArray, rate: FloatArray,
    raw: FloatArray,
) -> None:  # fmt: skip
    """Fill in ``raw`` (4, points), ``turn`` relative to the starts of elements, approximately.

    The quaternion at the start of an element is that at its first point less the integral, by
    quadrature, of the derivatives of ``turn``. These are filled in as ``rate`` (4, points).
    """
    s = tables.weights.size
    find_rate(twist, half, turn, rate)
    for element in range(tables.step.size):
        first = element * s
        w, x, y, z = turn[0, first], turn[1, first], turn[2, first], turn[3, first]
        for j in range(s):
            part = tables.from_start_columns[j, 0]
            w -= part * rate[0, first + j]
            x -= part * rate[1, first + j]
            y -= part * rate[2, first + j]
            z -= part * rate[3, first + j]
        turn_all(w, -x, -y, -z, turn[:, first : first + s], raw[:, first : first + s])


@borrows
def turn_all(w: float, x: float, y: float, z: float, turn: FloatArray, out: FloatArray) -> None:
    """Fill in ``out`` (4, n), the products of one quaternion w, x, y, z with each ``turn``."""
    for j in range(turn.shape[1]):
        out[0, j], out[1, j], out[2, j], out[3, j] = product(
            w, x, y, z, turn[0, j], turn[1, j], turn[2, j], turn[3, j]
        )


@borrows
def product(
    w: float, x: float, y: float, z: float, a: float, b: float, c: float, d: float
) -> tuple[float, float, float, float]:
    """Return the product of the quaternions w, x, y, z and a, b, c, d."""
    return (
        w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a,
    )  # fmt: skip


@borrows
def chain(tables: ElementTables, raw: FloatArray, rate: FloatArray, turn: FloatArray) -> None:
    """Fill in quaternions ``turn`` (4, points) from ``raw``, those relative to element starts.

    The quaternion at the end of an element follows by quadrature of ``rate`` (4, points), the
    derivatives of ``raw``. It is normalised and multiplies the quaternions of the next element.
    """
    s, weights = tables.weights.size, tables.weights
    w, x, y, z = tables.base[0], tables.base[1], tables.base[2], tables.base[3]
    for element in range(tables.step.size):
        first = element * s
        turn_all(w, x, y, z, raw[:, first : first + s], turn[:, first : first + s])
        a, b, c, d = 1.0, 0.0, 0.0, 0.0
        for j in range(s):
            weight, point = weights[j], first + j
            a, b = a + weight * rate[0, point], b + weight * rate[1, point]
            c, d = c + weight * rate[2, point], d + weight * rate[3, point]
        w, x, y, z = unit(*product(w, x, y, z, a, b, c, d))


@borrows
def unit(w: float, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the quaternion w, x, y, z divided by its norm."""
    over = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
    return over * w, over * x, over * y, over * z


@borrows
def normalise(turn: FloatArray) -> None:
    """Divide each of the quaternions ``turn`` (4, n) by its norm, in place."""
    a, b, c, d = turn[0], turn[1], turn[2], turn[3]
    for j in range(a.size):
        a[j], b[j], c[j], d[j] = unit(a[j], b[j], c[j], d[j])


@borrows
def times_inverse(one: FloatArray, other: FloatArray, out: FloatArray) -> None:
    """Fill in ``out``: quaternions ``one`` times the conjugates of ``other``, (4, n) each."""
    a, b, c, d = one[0], one[1], one[2], one[3]
    w, x, y, z = other[0], other[1], other[2], other[3]
    o_0, o_1, o_2, o_3 = out[0], out[1], out[2], out[3]
    for j in range(a.size):
        e, f, g, h = a[j], b[j], c[j], d[j]
        o_0[j] = e * w[j] + f * x[j] + g * y[j] + h * z[j]
        o_1[j] = f * w[j] - e * x[j] - g * z[j] + h * y[j]
        o_2[j] = g * w[j] - e * y[j] + f * z[j] - h * x[j]
        o_3[j] = h * w[j] - e * z[j] - f * y[j] + g * x[j]


@borrows
def add_product(one: FloatArray, other: FloatArray, out: FloatArray) -> None:
    """Add to ``out`` the products of quaternions ``one`` and ``other``, (4, n) each."""
    a, b, c, d = one[0], one[1], one[2], one[3]
    w, x, y, z = other[0], other[1], other[2], other[3]
    o_0, o_1, o_2, o_3 = out[0], out[1], out[2], out[3]
    for j in range(a.size):
        e, f, g, h = product(a[j], b[j], c[j], d[j], w[j], x[j], y[j], z[j])
        o_0[j], o_1[j], o_2[j], o_3[j] = o_0[j] + e, o_1[j] + f, o_2[j] + g, o_3[j] + h


@borrows
def turn_by(angle: FloatArray, turn: FloatArray, out: FloatArray) -> None:
    """Fill in ``out`` (4, n), quaternions ``turn`` (4, n) rotated by small angles.

    ``angle`` (3, n) are the rotation vectors in base_frame [rad]. The products are divided by the
    norm of the rotation, so that they keep the norm of ``turn``.
    """
    for j in range(turn.shape[1]):
        b, c, d = 0.5 * angle[0, j], 0.5 * angle[1, j], 0.5 * angle[2, j]
        w, x, y, z = turn[0, j], turn[1, j], turn[2, j], turn[3, j]
        over = 1.0 / np.sqrt(1.0 + (b * b + c * c + d * d))
        out[0, j] = over * (w - b * x - c * y - d * z)
        out[1, j] = over * (x + b * w + c * z - d * y)
        out[2, j] = over * (y - b * z + c * w + d * x)
        out[3, j] = over * (z + b * y - c * x + d * w)


@borrows
def find_rotation(turn: FloatArray, rotation: FloatArray) -> None:
    """Fill in the matrices ``rotation`` (3, 3, points) of quaternions ``turn`` of any norm."""
    for i in range(turn.shape[1]):
        w, x, y, z = turn[0, i], turn[1, i], turn[2, i], turn[3, i]
        f = 2.0 / ((w * w + x * x) + (y * y + z * z))
        rotation[0, 0, i] = 1.0 - f * (y * y + z * z)
        rotation[0, 1, i], rotation[1, 0, i] = f * (x * y - z * w), f * (x * y + z * w)
        rotation[0, 2, i], rotation[2, 0, i] = f * (x * z + y * w), f * (x * z - y * w)
        rotation[1, 1, i] = 1.0 - f * (x * x + z * z)
        rotation[1, 2, i], rotation[2, 1, i] = f * (y * z - x * w), f * (y * z + x * w)
        rotation[2, 2, i] = 1.0 - f * (x * x + y * y)
