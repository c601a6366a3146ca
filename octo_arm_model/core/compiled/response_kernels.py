"""How a loaded rod answers small wrenches: what `numba_build` compiles.

Columns, one for each wrench, come last: what belongs to a point is a few numbers for all of them.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.dense_kernels import solve_columns
from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.system_kernels import System
from octo_arm_model.core.hints import FloatArray


def respond(
    tables: RodTables, system: System, imbalance: FloatArray, change: FloatArray, turn: FloatArray
) -> None:
    """Fill in the ``change`` of twist (4, points, columns) under an ``imbalance`` likewise.

    And the rotation ``turn`` of the cross sections, (3, points, columns) in base_frame [rad].
    """
    s, elements, columns = tables.weights.size, tables.step.size, imbalance.shape[2]
    own, ends = np.empty((elements, 3 * s, columns)), np.zeros((elements, 6, columns))
    carried, moved = np.empty((s, columns)), np.empty((s, columns))
    at_points, rotation = system.at_points, system.rotation
    for element in range(elements):
        first, h, sides = element * s, tables.step[element], own[element]
        for p in range(3):
            before = ends[element, 3 + p]
            for j in range(s):
                at = first + j
                a, b, c = rotation[p, 0, at], rotation[p, 1, at], rotation[p, 2, at]
                d = at_points[6 + p, at] / at_points[9, at]
                e, weight = -h * at_points[3 + p, at], tables.weights[j]
                g_0, g_1 = imbalance[0, at], imbalance[1, at]
                g_2, g_3 = imbalance[2, at], imbalance[3, at]
                side, out = sides[p * s + j], carried[j]
                for i in range(columns):
                    side[i] = a * g_0[i] + b * g_1[i] + c * g_2[i] - d * g_3[i]
                    out[i] = e * g_3[i]
                    before[i] += weight * out[i]
            np.dot(tables.to_end_columns.T, carried, moved)
            for j in range(s):
                side, more = sides[p * s + j], moved[j]
                for i in range(columns):
                    side[i] += more[i]
        solve_columns(system.factors[element], system.pivots[element], sides)
        for p in range(3):
            last, before = ends[element, p], ends[element, 3 + p]
            for j in range(3 * s):
                weight, k = system.to_moment[element, p, j], sides[j]
                for i in range(columns):
                    before[i] -= weight * k[i]
            for j in range(s):
                weight, k = h * tables.weights[j], sides[p * s + j]
                for i in range(columns):
                    last[i] += weight * k[i]
    link_changes(system, ends)
    for element in range(elements):
        first, h, bends = element * s, tables.step[element], own[element]
        bends += np.dot(system.bends[element].T, ends[element])
        for p in range(3):
            np.dot(tables.from_start, bends[p * s : p * s + s], moved)
            for j in range(s):
                angle, more, start = turn[p, first + j], moved[j], ends[element, p]
                for i in range(columns):
                    angle[i] = start[i] + h * more[i]
        for j in range(s):
            at = first + j
            k_0, k_1, k_2 = bends[j], bends[s + j], bends[2 * s + j]
            for p in range(3):
                a, b, c = rotation[0, p, at], rotation[1, p, at], rotation[2, p, at]
                out = change[p, at]
                for i in range(columns):
                    out[i] = a * k_0[i] + b * k_1[i] + c * k_2[i]
            over = 1.0 / at_points[9, at]
            a, b, c = over * at_points[0, at], over * at_points[1, at], over * at_points[2, at]
            d, e, f = over * at_points[6, at], over * at_points[7, at], over * at_points[8, at]
            t_0, t_1, t_2 = turn[0, at], turn[1, at], turn[2, at]
            out, given = change[3, at], imbalance[3, at]
            for i in range(columns):
                out[i] = (
                    over * given[i] + a * t_0[i] + b * t_1[i] + c * t_2[i]
                    - d * k_0[i] - e * k_1[i] - f * k_2[i]
                )  # fmt: skip


def link_changes(system: System, ends: FloatArray) -> None:
    """From what each element does alone to what all do together, at the ``ends`` of each.

    (elements, 6, columns): first changes of Phi at the last and of d m at the first end; what
    comes out is Phi at the first and d m at the last end.
    """
    elements, _, columns = ends.shape
    rest, known = np.zeros((elements + 1, 3)), np.empty((elements, 3))
    start, following = np.empty(3), np.empty(3)
    for c in range(columns):
        for element in range(elements - 1, -1, -1):
            both, here, beyond = (
                system.ends[element],
                system.by_turn[element + 1],
                rest[element + 1],
            )
            for i in range(3):
                following[i] = ends[element, i, c]
                for k in range(3):
                    following[i] += both[i, 3 + k] * beyond[k]
            for i in range(3):
                known[element, i] = 0.0
                for k in range(3):
                    known[element, i] += system.inverse[element, i, k] * following[k]
            for i in range(3):
                following[i] = beyond[i]
                for k in range(3):
                    following[i] += here[i, k] * known[element, k]
            for i in range(3):
                rest[element, i] = ends[element, 3 + i, c]
                for k in range(3):
                    rest[element, i] += both[3 + i, 3 + k] * following[k]
        start[:] = 0.0
        for element in range(elements):
            for i in range(3):
                following[i] = known[element, i]
                for m in range(3):
                    following[i] += system.on[element, i, m] * start[m]
            for i in range(3):
                value = rest[element + 1, i]
                for m in range(3):
                    value += system.by_turn[element + 1, i, m] * following[m]
                ends[element, i, c], ends[element, 3 + i, c] = start[i], value
            start[:] = following


def tip_wrenches(tables: RodTables, twist: FloatArray, rotation: FloatArray) -> FloatArray:
    """What unit wrenches on the tip do to all sections, (4, points, 6); moments over a length."""
    points, count = tables.weights.size, twist.shape[1]
    wrench = np.zeros((4, count, 6))
    beyond, to_tip, carried = np.zeros(3), np.empty((3, points)), np.empty(points)
    for element in range(tables.step.size - 1, -1, -1):
        first, h = element * points, tables.step[element]
        for k in range(3):
            for j in range(points):
                carried[j] = h * rotation[k, 0, first + j] * twist[3, first + j]
            to_tip[k] = beyond[k]
            add_products(carried, tables.to_end_columns, to_tip[k])
            for j in range(points):
                beyond[k] += tables.weights[j] * carried[j]
        for column in range(3):
            n, m = (column + 1) % 3, (column + 2) % 3
            for i in range(points):
                at = first + i
                wrench[3, at, column] = rotation[column, 0, at]
                for k in range(3):
                    # The lever times the unit vector.
                    wrench[k, at, column] = (
                        rotation[n, k, at] * to_tip[m, i] - rotation[m, k, at] * to_tip[n, i]
                    )
                    wrench[k, at, 3 + column] = rotation[column, k, at] * tables.length
    return wrench
