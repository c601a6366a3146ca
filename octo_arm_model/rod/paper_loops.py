"""The node function of the paper's models as loops for numba; `arrays` has it for NumPy."""

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.compiled import compiled, helper, inlined
from octo_arm_model.rod.section_formulas import paper_jump, paper_moments, paper_slope, paper_twist
from octo_arm_model.rod.tables import PaperTables

MOST_PAPER_SWEEPS, SWEEPS_A_CHECK = 60, 2  # see `arrays`
_twist, _slope, _moments = inlined(paper_twist), inlined(paper_slope), inlined(paper_moments)
_jump = inlined(paper_jump)


@inlined
def _seven(a: FloatArray, i: int) -> tuple[float, float, float, float, float, float, float]:
    return a[0, i], a[1, i], a[2, i], a[3, i], a[4, i], a[5, i], a[6, i]


@inlined
def _four(a: FloatArray, i: int) -> tuple[float, float, float, float]:
    return a[0, i], a[1, i], a[2, i], a[3, i]


@compiled
def paper_twists(
    tables: PaperTables, sums: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Return the twists of cross sections by one of the paper's models, see `papers`.

    The ``sums`` (A, 7, P) are over the tendons of A arms at P places. Equation (10), if any, is
    swept until its solution changes by less than ``tolerance`` times the largest moment in the
    arm.

    Returns:
        Twists (A, P, 4); and for each arm the last change, the largest number of sweeps in an
        element, and an element that did not converge, or -1, (A, 3).
    """
    arms, places = sums.shape[0], sums.shape[2]
    twist, outcome, p = np.empty((arms, places, 4)), np.zeros((arms, 3)), np.zeros((3, places))
    stiffness, points = tables.stiffness, tables.backwards.shape[1]
    end, solution = np.empty(3), np.empty((3, points + 1))
    buffers = end, solution, np.empty((7, points)), np.empty((3, points))
    for arm in range(arms):
        outcome[arm, 2] = -1.0
        arm_sums = sums[arm]
        p[:] = tables.rest
        if tables.swept:
            _imbalances(tables, arm_sums, tolerance, buffers, p, outcome[arm])
        for i in range(places):
            strains = _twist(_seven(arm_sums, i), _four(stiffness, i), (p[0, i], p[1, i], p[2, i]))
            for c in range(4):
                twist[arm, i, c] = strains[c]
    return twist, outcome


@helper
def _imbalances(
    tables: PaperTables,
    sums: FloatArray,
    tolerance: float,
    buffers: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    p: FloatArray,
    outcome: FloatArray,
) -> None:
    """Compute the imbalance p (3, P) [N m] of one arm at nodes and stations."""
    points, stations, largest = tables.backwards.shape[1], tables.stations, 1e-300
    end, solution, slopes, rates = buffers
    for i in range(stations.between.shape[1]):
        largest = max(largest, abs(sums[1, i]), abs(sums[2, i]))
    for c in range(3):
        end[c] = 0.0
    for e in range(tables.swept - 1, -1, -1):
        place, first = tables.anchorage[e], e * points
        if place >= 0:
            _cross_anchorage(tables.stiffness, sums, place, end)
        for i in range(points):
            coefficients = _slope(_four(tables.stiffness, first + i), _seven(sums, first + i))
            for c in range(7):
                slopes[c, i] = coefficients[c]
        change, count = _sweep(tables, e, slopes, tolerance * largest, end, rates, solution)
        if outcome[2] < 0.0 and not change <= tolerance * largest:
            outcome[2] = e
        if not change / largest <= outcome[0]:
            outcome[0] = change / largest
        outcome[1] = max(outcome[1], count)
        for c in range(3):
            for i in range(points):
                p[c, first + i] = solution[c, i]
            end[c] = solution[c, points]
    nodes = stations.between.shape[1]
    for place in range(stations.element.size):
        first = stations.element[place] * points
        for c in range(3):
            value = 0.0
            if first < tables.swept * points:
                for i in range(first, first + points):
                    value += stations.between[place, i] * p[c, i]
            p[c, nodes + place] = value


@helper
def _cross_anchorage(stiffness: FloatArray, sums: FloatArray, place: int, p: FloatArray) -> None:
    """Replace the imbalance p (3,) beyond an anchorage by that on its side to the base."""
    k = _four(stiffness, place)
    (f, d), (f_tip, d_tip) = _moments(_seven(sums, place)), _moments(_seven(sums, place + 1))
    for c in range(3):
        p[c] = _jump(k[1 if c == 0 else 2], (f[c], d[c]), (f_tip[c], d_tip[c]), p[c])


@helper
def _sweep(
    tables: PaperTables,
    e: int,
    slopes: FloatArray,
    allowed: float,
    end: FloatArray,
    rates: FloatArray,
    p: FloatArray,
) -> tuple[float, int]:
    """Compute the imbalance p (3, p + 1) of an element from its end; return change and sweeps.

    ``rates`` (3, p) becomes p'.
    """
    points = slopes.shape[1]
    for c in range(3):
        p[c] = end[c]
    change, count = np.inf, 0
    while not (change <= allowed and count % SWEEPS_A_CHECK == 0) and count < MOST_PAPER_SWEEPS:
        count += 1
        for i in range(points):
            n, b = p[1, i], p[2, i]
            rates[0, i] = (slopes[2, i] * b + slopes[1, i]) * n - slopes[0, i] * b
        change = _integrate_back(tables, e, rates[0], end[0], p[0])
        for i in range(points):
            rates[1, i] = (slopes[5, i] * p[2, i] + slopes[3, i]) * p[0, i]
            rates[2, i] = (slopes[6, i] * p[1, i] + slopes[4, i]) * p[0, i]
        for c in range(1, 3):
            step = _integrate_back(tables, e, rates[c], end[c], p[c])
            if not step <= change:
                change = step
    return change, count


@helper
def _integrate_back(
    tables: PaperTables, e: int, rate: FloatArray, end: float, p: FloatArray
) -> float:
    """Integrate the ``rate`` (p,) of ``p`` (p + 1,) back from its ``end``; return the change."""
    change = 0.0
    for i in range(p.size):
        value = 0.0
        for k in range(rate.size):
            value += tables.backwards[i, k] * rate[k]
        value = end - tables.lengths[e] * value
        step = abs(value - p[i])
        if not step <= change:
            change = step
        p[i] = value
    return change
