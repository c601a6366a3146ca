"""How a loaded rod answers small wrenches: what `numba_build` compiles."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.dense_kernels import solve_transposed
from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.system_kernels import System
from octo_arm_model.core.hints import FloatArray


def respond(tables: RodTables, system: System, imbalance: FloatArray, change: FloatArray) -> None:
    """Fill in the ``change`` of twist (columns, 4, points) under an ``imbalance`` likewise."""
    s, elements, columns = tables.weights.size, tables.step.size, len(imbalance)
    own = np.empty((elements, columns, 3 * s))
    last, before = np.zeros((elements, columns, 3)), np.zeros((elements, columns, 3))
    carried = np.empty(s)
    at_points, rotation = system.at_points, system.rotation
    for element in range(elements):
        first, h = element * s, tables.step[element]
        stiffness = at_points[9, first : first + s]
        for c in range(columns):
            given = imbalance[c, :, first : first + s]
            for p in range(3):
                side = own[element, c, p * s : p * s + s]
                turned, mixed = rotation[p, :, first : first + s], at_points[6 + p, first:]
                across = at_points[3 + p, first:]
                for j in range(s):
                    side[j] = (
                        turned[0, j] * given[0, j] + turned[1, j] * given[1, j]
                        + turned[2, j] * given[2, j] - mixed[j] / stiffness[j] * given[3, j]
                    )  # fmt: skip
                    carried[j] = -h * across[j] * given[3, j]
                add_products(carried, tables.to_end_columns, side)
                for j in range(s):
                    before[element, c, p] += tables.weights[j] * carried[j]
        solve_transposed(system.factors[element], system.pivots[element], own[element])
        to_moment = system.to_moment[element]
        for c in range(columns):
            k = own[element, c]
            for p in range(3):
                value = 0.0
                for row in range(3 * s):
                    value += to_moment[p, row] * k[row]
                before[element, c, p] -= value
                value = 0.0
                for j in range(s):
                    value += tables.weights[j] * k[p * s + j]
                last[element, c, p] += h * value
    rest, known = np.zeros((elements + 1, 3)), np.empty((elements, 3))
    both, following, angle = np.empty(6), np.empty(3), np.empty((3, s))
    for c in range(columns):
        for element in range(elements - 1, -1, -1):
            ends, here, beyond = (
                system.ends[element],
                system.by_turn[element + 1],
                rest[element + 1],
            )
            for i in range(3):
                following[i] = last[element, c, i]
                for k in range(3):
                    following[i] += ends[i, 3 + k] * beyond[k]
            for i in range(3):
                known[element, i] = 0.0
                for k in range(3):
                    known[element, i] += system.inverse[element, i, k] * following[k]
            for i in range(3):
                following[i] = beyond[i]
                for k in range(3):
                    following[i] += here[i, k] * known[element, k]
            for i in range(3):
                rest[element, i] = before[element, c, i]
                for k in range(3):
                    rest[element, i] += ends[3 + i, 3 + k] * following[k]
        both[:3] = 0.0
        for element in range(elements):
            first, h, k = element * s, tables.step[element], own[element, c]
            for i in range(3):
                following[i] = known[element, i]
                for m in range(3):
                    following[i] += system.on[element, i, m] * both[m]
            for i in range(3):
                both[3 + i] = rest[element + 1, i]
                for m in range(3):
                    both[3 + i] += system.by_turn[element + 1, i, m] * following[m]
            add_products(both, system.bends[element], k)
            out, turned = change[c, :, first : first + s], rotation[:, :, first : first + s]
            for p in range(3):
                angle[p] = both[p]
                add_products(h * k[p * s : p * s + s], tables.from_start_columns, angle[p])
            across, mixed = at_points[:3, first:], at_points[6:9, first:]
            stiffness, given = at_points[9, first:], imbalance[c, 3, first:]
            for i in range(s):
                k_0, k_1, k_2 = k[i], k[s + i], k[2 * s + i]
                for p in range(3):
                    out[p, i] = (
                        turned[0, p, i] * k_0 + turned[1, p, i] * k_1 + turned[2, p, i] * k_2
                    )
                out[3, i] = (
                    given[i]
                    + across[0, i] * angle[0, i] - mixed[0, i] * k_0
                    + across[1, i] * angle[1, i] - mixed[1, i] * k_1
                    + across[2, i] * angle[2, i] - mixed[2, i] * k_2
                ) / stiffness[i]  # fmt: skip
            for i in range(3):
                both[i] = following[i]


def tip_wrenches(tables: RodTables, twist: FloatArray, rotation: FloatArray) -> FloatArray:
    """What unit wrenches on the tip do to all sections, (6, 4, points); moments over a length."""
    points, count = tables.weights.size, twist.shape[1]
    wrench = np.zeros((6, 4, count))
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
                wrench[column, 3, at] = rotation[column, 0, at]
                for k in range(3):
                    # The lever times the unit vector.
                    wrench[column, k, at] = (
                        rotation[n, k, at] * to_tip[m, i] - rotation[m, k, at] * to_tip[n, i]
                    )
                    wrench[3 + column, k, at] = rotation[column, k, at] * tables.length
    return wrench
