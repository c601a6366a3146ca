"""Newton's step of a loaded rod: what `numba_build` compiles."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.loaded.response_kernels import link_changes
from octo_arm_model.core.compiled.loaded.rod_tables import RodTables
from octo_arm_model.core.compiled.loaded.system_kernels import System
from octo_arm_model.core.compiled.numerics.dense_kernels import solve_transposed
from octo_arm_model.core.compiled.numerics.products import add_products
from octo_arm_model.core.hints import FloatArray


def find_step(
    tables: RodTables, system: System, imbalance: FloatArray, change: FloatArray, turn: FloatArray
) -> None:
    """Fill in the ``change`` of twist (4, points) under one ``imbalance`` likewise.

    And the rotation ``turn`` of the cross sections, (3, points) in base_frame [rad]. What
    `response_kernels.respond` does for many, with loops along the points.
    """
    s, elements, count = tables.weights.size, tables.step.size, imbalance.shape[1]
    given, found, weights, lengths = imbalance, change, tables.weights, tables.lengths
    local, rotation, over = system.at_points, system.rotation, 1.0 / system.at_points[9]
    bends, ends = np.empty((elements, 3 * s)), np.empty((elements, 6))
    # Along all points, and by element.
    rows, sums = np.empty((3, count)), np.empty((3, count))
    each = 3 * elements, s
    flat, summed = rows.reshape(each), sums.reshape(each)
    carried, k, more = (
        rows.reshape(3, elements, s), bends.reshape(elements, 3, s), sums.reshape(3, elements, s)
    )  # fmt: skip
    for p in range(3):
        out, by_force, force = rows[p], local[3 + p], given[3]
        for i in range(count):
            out[i] = -lengths[i] * by_force[i] * force[i]
    np.dot(flat, tables.to_end_columns, summed)
    for p in range(3):
        out, coupled, force = sums[p], local[6 + p], given[3]
        a, b, c = rotation[p, 0], rotation[p, 1], rotation[p, 2]
        for i in range(count):
            out[i] += (a[i] * given[0, i] + b[i] * given[1, i]) + (
                c[i] * given[2, i] - coupled[i] * (over[i] * force[i])
            )
    for element in range(elements):
        own, alone = bends[element], ends[element]
        for p in range(3):
            for j in range(s):
                k[element, p, j] = more[p, element, j]
        solve_transposed(system.factors[element], system.pivots[element], own.reshape(1, 3 * s))
        for p in range(3):
            row, total, before, bent = system.to_moment[element, p], 0.0, 0.0, 0.0
            for j in range(3 * s):
                total += row[j] * own[j]
            for j in range(s):
                before += weights[j] * carried[p, element, j]
                bent += weights[j] * k[element, p, j]
            alone[p], alone[3 + p] = tables.step[element] * bent, before - total
    link_changes(system, ends.reshape(elements, 6, 1))
    for element in range(elements):
        add_products(ends[element], system.bends[element], bends[element])
        for p in range(3):
            for j in range(s):
                carried[p, element, j] = k[element, p, j]
    k_0, k_1, k_2 = rows[0], rows[1], rows[2]
    for p in range(3):
        a, b, c, out = rotation[0, p], rotation[1, p], rotation[2, p], found[p]
        for i in range(count):
            out[i] = a[i] * k_0[i] + b[i] * k_1[i] + c[i] * k_2[i]
    stretched = found[3]
    for i in range(count):
        stretched[i] = given[3, i] - (
            local[6, i] * k_0[i] + local[7, i] * k_1[i] + local[8, i] * k_2[i]
        )
    for p in range(3):
        out = rows[p]
        for i in range(count):
            out[i] *= lengths[i]
    np.dot(flat, tables.from_start_columns, summed)
    for p in range(3):
        angle, across, out = sums[p], local[p], turn[p]
        for element in range(elements):
            for j in range(s):
                more[p, element, j] += ends[element, p]
        for i in range(count):
            out[i] = angle[i]
            stretched[i] += across[i] * angle[i]
    for i in range(count):
        stretched[i] *= over[i]
