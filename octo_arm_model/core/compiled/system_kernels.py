"""The linearised equilibrium of a loaded rod: what `numba_build` compiles.

As `loaded.linearised`, element by element and without shear. Elements are linked from the tip to
the base by d m = P Phi + p.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.hints import FloatArray


def find_system(
    tables: RodTables, twist: FloatArray, rotation: FloatArray, force: FloatArray,
    moment: FloatArray, hessian: FloatArray, matrix: FloatArray, inverse: FloatArray,
    bends: FloatArray, ends: FloatArray, to_moment: FloatArray, points_of: FloatArray,
) -> None:  # fmt: skip
    """Fill in the linearised system about a state, as `Linearised` has it.

    ``matrix`` and ``inverse`` (elements, 3 s, 3 s) for s points in each, ``bends``
    (elements, 3 s, 6), ``ends`` (elements, 6, 6) from Phi at the first and d m at the last end to
    the others, ``to_moment`` (elements, 3, 3 s) and ``points_of`` (points, 10): t x n, n x t over
    the axial stiffness, what couples it to curvatures in base_frame, and the axial stiffness.
    """
    s = tables.weights.size
    by_turn, follow = np.empty((3, 3, s)), np.empty((3, 3, s))
    by_bend, bending = np.empty((3, 3, s)), np.empty((3, 3, s))
    turn_rows, sides = np.empty((s, 9)), np.empty((3 * s, 6))
    for element in range(tables.step.size):
        first, h = element * s, tables.step[element]
        for j in range(s):
            at = first + j
            stiffness = hessian[3, 3, at]
            over = 1.0 / stiffness
            own = points_of[at]
            for p in range(3):
                n, m = (p + 1) % 3, (p + 2) % 3
                across = rotation[n, 0, at] * force[m, at] - rotation[m, 0, at] * force[n, at]
                own[p], own[3 + p] = across, -across * over
                mixed = 0.0
                for q in range(3):
                    mixed += rotation[p, q, at] * hessian[q, 3, at]
                own[6 + p] = mixed
            own[9] = stiffness
            # n x (u' x Phi) = u' (n . Phi) - Phi (n . u'); u' is along the tangent.
            along = 0.0
            for p in range(3):
                along += force[p, at] * rotation[p, 0, at]
            stretch = twist[3, at]
            for p in range(3):
                for q in range(3):
                    by_turn[p, q, j] = (
                        own[3 + p] * own[q] - stretch * rotation[p, 0, at] * force[q, at]
                    )
                    by_bend[p, q, j] = own[3 + p] * own[6 + q]
                    follow[p, q, j] = -over * own[6 + p] * own[q]
                    value = 0.0
                    for k in range(3):
                        for m in range(3):
                            value += (
                                rotation[p, k, at]
                                * rotation[q, m, at]
                                * (
                                    hessian[k, m, at]
                                    - hessian[k, 3, at] * hessian[m, 3, at] * over
                                )
                            )
                    bending[p, q, j] = value
                by_turn[p, p, j] += stretch * along
            for p in range(3):
                n, m = (p + 1) % 3, (p + 2) % 3
                follow[m, n, j] += moment[p, at]
                follow[n, m, j] -= moment[p, at]
                for q in range(3):
                    turn_rows[j, 3 * p + q] = h * h * by_turn[p, q, j]
        twice = np.dot(tables.twice, turn_rows)
        own_matrix = matrix[element]
        for p in range(3):
            for q in range(3):
                for i in range(s):
                    for j in range(s):
                        own_matrix[p * s + i, q * s + j] = (
                            twice[i * s + j, 3 * p + q]
                            - h * tables.to_end[i, j] * by_bend[p, q, j]
                            - h * tables.from_start[i, j] * follow[p, q, i]
                        )
                    own_matrix[p * s + i, q * s + i] += bending[p, q, i]
                    side = follow[p, q, i]
                    for j in range(s):
                        side -= h * tables.to_end[i, j] * by_turn[p, q, j]
                    sides[p * s + i, q] = side
                    sides[p * s + i, 3 + q] = 1.0 if p == q else 0.0
                for j in range(s):
                    value = -by_bend[p, q, j] * tables.weights[j]
                    for i in range(s):
                        value += h * by_turn[p, q, i] * tables.weights[i] * tables.from_start[i, j]
                    to_moment[element, p, q * s + j] = h * value
        inverse[element] = np.linalg.inv(own_matrix)
        bends[element] = np.dot(inverse[element], sides)
        for column in range(6):
            for p in range(3):
                last, before = 0.0, 0.0
                for j in range(s):
                    last += tables.weights[j] * bends[element, p * s + j, column]
                for row in range(3 * s):
                    before -= to_moment[element, p, row] * bends[element, row, column]
                if column < 3:
                    for j in range(s):
                        before -= h * tables.weights[j] * by_turn[p, column, j]
                ends[element, p, column] = h * last + (1.0 if p == column else 0.0)
                ends[element, 3 + p, column] = before + (1.0 if 3 + p == column else 0.0)


def respond(
    tables: RodTables, rotation: FloatArray, inverse: FloatArray, bends: FloatArray,
    ends: FloatArray, to_moment: FloatArray, points_of: FloatArray, imbalance: FloatArray,
    change: FloatArray,
) -> int:  # fmt: skip
    """Fill in the ``change`` of twist (4, columns, points) under an ``imbalance`` likewise.

    Returns:
        The sign of the determinant that links the elements.
    """
    s, elements, columns = tables.weights.size, tables.step.size, imbalance.shape[1]
    own = np.empty((elements, 3 * s, columns))
    last, before = np.zeros((elements, 3, columns)), np.zeros((elements, 3, columns))
    carried = np.empty((3, s))
    sides = np.empty((3 * s, columns))
    for element in range(elements):
        first, h = element * s, tables.step[element]
        for c in range(columns):
            for j in range(s):
                at = first + j
                stretched = imbalance[3, c, at]
                for p in range(3):
                    side = -points_of[at, 6 + p] / points_of[at, 9] * stretched
                    for q in range(3):
                        side += rotation[p, q, at] * imbalance[q, c, at]
                    sides[p * s + j, c] = side
                    carried[p, j] = h * points_of[at, 3 + p] * stretched
            for p in range(3):
                for i in range(s):
                    total = 0.0
                    for j in range(s):
                        total += tables.to_end[i, j] * carried[p, j]
                    sides[p * s + i, c] -= total
                    before[element, p, c] -= tables.weights[i] * carried[p, i]
        own[element] = np.dot(inverse[element], sides)
        before[element] -= np.dot(to_moment[element], own[element])
        for c in range(columns):
            for p in range(3):
                for j in range(s):
                    last[element, p, c] += h * tables.weights[j] * own[element, p * s + j, c]
    # From the tip: d m = P Phi + p at the last end of each element.
    by_turn, rest = np.zeros((elements + 1, 3, 3)), np.zeros((elements + 1, 3, columns))
    on, known = np.empty((elements, 3, 3)), np.empty((elements, 3, columns))
    sign = 1
    for element in range(elements - 1, -1, -1):
        here, beyond = by_turn[element + 1], rest[element + 1]
        to_last = np.ascontiguousarray(ends[element, :3, 3:])
        system = np.eye(3) - np.dot(to_last, here)
        if np.linalg.det(system) < 0.0:
            sign = -sign
        on[element] = np.linalg.solve(system, np.ascontiguousarray(ends[element, :3, :3]))
        known[element] = np.linalg.solve(system, np.dot(to_last, beyond) + last[element])
        to_first = np.ascontiguousarray(ends[element, 3:, 3:])
        by_turn[element] = np.dot(to_first, np.dot(here, on[element])) + ends[element, 3:, :3]
        rest[element] = np.dot(to_first, np.dot(here, known[element]) + beyond) + before[element]
    turn = np.zeros((3, columns))
    both = np.empty((6, columns))
    for element in range(elements):
        first, h = element * s, tables.step[element]
        following = np.dot(on[element], turn) + known[element]
        both[:3] = turn
        both[3:] = np.dot(by_turn[element + 1], following) + rest[element + 1]
        k = own[element] + np.dot(bends[element], both)
        for c in range(columns):
            for i in range(s):
                at = first + i
                linear = imbalance[3, c, at]
                for p in range(3):
                    angle = turn[p, c]
                    for j in range(s):
                        angle += h * tables.from_start[i, j] * k[p * s + j, c]
                    linear += points_of[at, p] * angle - points_of[at, 6 + p] * k[p * s + i, c]
                change[3, c, at] = linear / points_of[at, 9]
                for p in range(3):
                    value = 0.0
                    for q in range(3):
                        value += rotation[q, p, at] * k[q * s + i, c]
                    change[p, c, at] = value
        turn = following
    return sign


def tip_wrenches(tables: RodTables, twist: FloatArray, rotation: FloatArray) -> FloatArray:
    """What unit wrenches on the tip do to all sections, (4, 6, points); moments over a length."""
    points, count = tables.weights.size, twist.shape[1]
    wrench = np.zeros((4, 6, count))
    beyond, to_tip = np.zeros(3), np.empty(3)
    for element in range(tables.step.size - 1, -1, -1):
        first, h = element * points, tables.step[element]
        for i in range(points):
            at = first + i
            for k in range(3):
                to_tip[k] = beyond[k]
                for j in range(points):
                    place = first + j
                    to_tip[k] += h * tables.to_end[i, j] * rotation[k, 0, place] * twist[3, place]
            for column in range(3):
                n, m = (column + 1) % 3, (column + 2) % 3
                wrench[3, column, at] = rotation[column, 0, at]
                for k in range(3):
                    # The lever times the unit vector.
                    wrench[k, column, at] = (
                        rotation[n, k, at] * to_tip[m] - rotation[m, k, at] * to_tip[n]
                    )
                    wrench[k, 3 + column, at] = rotation[column, k, at] * tables.length
        for k in range(3):
            for j in range(points):
                place = first + j
                beyond[k] += h * tables.weights[j] * rotation[k, 0, place] * twist[3, place]
    return wrench
