"""The node function of the paper's models as loops for numba; `paper_arrays` for NumPy."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.compiled import compiled, helper
from octo_arm_model.rod.tables import PaperTables

MOST_PAPER_SWEEPS, SWEEPS_A_CHECK = 60, 2  # see `paper_arrays`


@compiled
def paper_twists(
    tables: PaperTables, sums: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Twists of cross sections that balance their tendons as in the paper, see `paper_equations`.

    From ``sums`` (A, 7, P) over the tendons of A arms at P places. Where moments are not in
    balance, equation (10) is swept until its solution changes by less than ``tolerance`` times
    the largest moment in the arm.

    Returns:
        Twists (A, P, 4), and of each arm that change, the most sweeps in an element, and the
        element that did not converge, or -1, (A, 3).
    """
    arms, places = sums.shape[0], sums.shape[2]
    twist, outcome, p = np.empty((arms, places, 4)), np.zeros((arms, 3)), np.zeros((3, places))
    stiffness = tables.stiffness
    for arm in range(arms):
        outcome[arm, 2] = -1.0
        own = sums[arm]
        p[:] = tables.rest
        if tables.swept:
            _imbalances(tables, own, tolerance, p, outcome[arm])
        for i in range(places):
            n, b, nn, bb, mixed = own[1, i], own[2, i], own[3, i], own[4, i], own[5, i]
            about_n, about_b = stiffness[2, i] + bb, stiffness[3, i] + nn
            moment_n, moment_b = p[1, i] - b, p[2, i] + n
            over = 1.0 / (about_n * about_b - mixed * mixed)
            xi = (about_b * moment_n + mixed * moment_b) * over
            k = (about_n * moment_b + mixed * moment_n) * over
            stretch = (k * n - xi * b - own[0, i]) / stiffness[0, i] + 1.0
            tau = (p[0, i] - own[6, i]) / (stiffness[1, i] + (nn + bb))
            twist[arm, i, 0], twist[arm, i, 1] = tau * stretch, xi * stretch
            twist[arm, i, 2], twist[arm, i, 3] = k * stretch, stretch
    return twist, outcome


@helper
def _imbalances(
    tables: PaperTables, sums: FloatArray, tolerance: float, p: FloatArray, outcome: FloatArray
) -> None:
    """Fill in the imbalance p (3, P) [N m] of one arm at nodes and stations."""
    points, stations = tables.backwards.shape[1], tables.stations
    largest = 1e-300
    for i in range(stations.between.shape[1]):
        largest = max(largest, abs(sums[1, i]), abs(sums[2, i]))
    end, room, slopes = np.zeros(3), np.empty((3, points + 1)), np.empty((7, points))
    for e in range(tables.swept - 1, -1, -1):
        at, first = tables.anchorage[e], e * points
        if at >= 0:
            _jump(tables.stiffness[:, at], sums[:, at], sums[:, at + 1], end)
        _slope_coefficients(tables.stiffness, sums, first, slopes)
        change, count = _sweep(tables, e, slopes, tolerance * largest, end, room)
        if outcome[2] < 0.0 and not change <= tolerance * largest:
            outcome[2] = e
        if not change / largest <= outcome[0]:
            outcome[0] = change / largest
        outcome[1] = max(outcome[1], count)
        for c in range(3):
            for i in range(points):
                p[c, first + i] = room[c, i]
            end[c] = room[c, points]
    nodes = stations.between.shape[1]
    for at in range(stations.element.size):
        first = stations.element[at] * points
        for c in range(3):
            value = 0.0
            if first < tables.swept * points:
                for i in range(first, first + points):
                    value += stations.between[at, i] * p[c, i]
            p[c, nodes + at] = value


@helper
def _jump(stiffness: FloatArray, base: FloatArray, tip: FloatArray, p: FloatArray) -> None:
    """Imbalance at the side of an anchorage to the base by (11), from that at the other."""
    for c in range(3):
        k = stiffness[1] if c == 0 else stiffness[2]
        f, d = _moment(base, c)
        f_tip, d_tip = _moment(tip, c)
        omega = (f_tip + p[c]) / (k + d_tip) + (f - f_tip) / (k + (d - d_tip))
        p[c] = omega * (k + d) - f


@helper
def _moment(sums: FloatArray, c: int) -> tuple[float, float]:
    """Component ``c`` of F and of the diagonal of D, see `paper_equations`."""
    if c == 0:
        return 0.0, sums[3] + sums[4]
    return (-sums[2], sums[4]) if c == 1 else (sums[1], sums[3])


@helper
def _slope_coefficients(
    stiffness: FloatArray, sums: FloatArray, first: int, out: FloatArray
) -> None:
    """Coefficients (7, p) of p' in the element of nodes from ``first`` on."""
    for i in range(out.shape[1]):
        torsion, bending = stiffness[1, first + i], stiffness[2, first + i]
        n, b = sums[1, first + i], sums[2, first + i]
        nn, bb = sums[3, first + i], sums[4, first + i]
        c_t, c_n, c_b = 1.0 / (torsion + (nn + bb)), 1.0 / (bending + bb), 1.0 / (bending + nn)
        xi, k, c = -c_n * b, c_b * n, (bending + (nn + bb)) * c_t
        out[0, i], out[1, i], out[2, i] = xi, k, (bb - nn) * c_n * c_b
        out[3, i], out[4, i] = -c * k, c * xi
        out[5, i], out[6, i] = -bb * c_t * c_b, nn * c_t * c_n


@helper
def _sweep(
    tables: PaperTables, e: int, slopes: FloatArray, allowed: float, end: FloatArray,
    p: FloatArray,
) -> tuple[float, int]:  # fmt: skip
    """Imbalance p (3, p + 1) at the points and the start of an element, from that at its end.

    Returns:
        Its last change [N m] and the number of sweeps.
    """
    points = slopes.shape[1]
    rate, aside = np.empty(points), np.empty((2, points))
    for c in range(3):
        p[c] = end[c]
    change, count = np.inf, 0
    while not (change <= allowed and count % SWEEPS_A_CHECK == 0) and count < MOST_PAPER_SWEEPS:
        count += 1
        for i in range(points):
            n, b = p[1, i], p[2, i]
            rate[i] = (slopes[2, i] * b + slopes[1, i]) * n - slopes[0, i] * b
        change = _integrate_back(tables, e, rate, end[0], p[0])
        for i in range(points):
            aside[0, i] = (slopes[5, i] * p[2, i] + slopes[3, i]) * p[0, i]
            aside[1, i] = (slopes[6, i] * p[1, i] + slopes[4, i]) * p[0, i]
        for c in range(2):
            moved = _integrate_back(tables, e, aside[c], end[1 + c], p[1 + c])
            if not moved <= change:
                change = moved
    return change, count


@helper
def _integrate_back(
    tables: PaperTables, e: int, rate: FloatArray, end: float, p: FloatArray
) -> float:
    """``p`` (p + 1,) from its ``rate`` at the points of an element and its ``end``; the change."""
    change = 0.0
    for i in range(p.size):
        value = 0.0
        for k in range(rate.size):
            value += tables.backwards[i, k] * rate[k]
        value = end - tables.lengths[e] * value
        moved = abs(value - p[i])
        if not moved <= change:
            change = moved
        p[i] = value
    return change
