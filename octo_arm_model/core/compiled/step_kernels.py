"""Newton's step of a loaded rod: what `numba_build` compiles."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.dense_kernels import solve_transposed
from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.compiled.response_kernels import link_changes
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.system_kernels import System
from octo_arm_model.core.hints import FloatArray


def find_step(
    tables: RodTables, system: System, imbalance: FloatArray, change: FloatArray, turn: FloatArray
) -> None:
    """Fill in the ``change`` of twist (4, points) under one ``imbalance`` likewise.

    And the rotation ``turn`` of the cross sections, (3, points) in base_frame [rad]. What
    `response_kernels.respond` does for many, with loops along the points.
    """
    s, elements, weights = tables.weights.size, tables.step.size, tables.weights
    bends, ends = np.empty((elements, 3 * s)), np.empty((elements, 6))
    carried, more = np.empty((elements, 3, s)), np.empty((elements, 3, s))
    k, each = bends.reshape(elements, 3, s), (3 * elements, s)
    flat, summed = carried.reshape(each), more.reshape(each)
    # By element, and point of it.
    local, rotation = (
        system.at_points.reshape(10, elements, s),
        system.rotation.reshape(3, 3, elements, s),
    )
    given, found = imbalance.reshape(4, elements, s), change.reshape(4, elements, s)
    angles, stretched = turn.reshape(3, elements, s), given[3] / local[9]
    for element in range(elements):
        for p in range(3):
            for j in range(s):
                carried[element, p, j] = (
                    -tables.step[element] * local[3 + p, element, j] * given[3, element, j]
                )
    np.dot(flat, tables.to_end_columns, summed)
    for element in range(elements):
        for p in range(3):
            total = 0.0
            for j in range(s):
                k[element, p, j] = more[element, p, j] + (
                    rotation[p, 0, element, j] * given[0, element, j]
                    + rotation[p, 1, element, j] * given[1, element, j]
                    + rotation[p, 2, element, j] * given[2, element, j]
                    - local[6 + p, element, j] * stretched[element, j]
                )
                total += weights[j] * carried[element, p, j]
            ends[element, 3 + p] = total
    for element in range(elements):
        own, alone = bends[element], ends[element]
        solve_transposed(system.factors[element], system.pivots[element], own.reshape(1, 3 * s))
        for p in range(3):
            row, total, bent = system.to_moment[element, p], 0.0, 0.0
            for j in range(3 * s):
                total += row[j] * own[j]
            for j in range(s):
                bent += weights[j] * k[element, p, j]
            alone[p] = tables.step[element] * bent
            alone[3 + p] -= total
    link_changes(system, ends.reshape(elements, 6, 1))
    for element in range(elements):
        add_products(ends[element], system.bends[element], bends[element])
        for p in range(3):
            for j in range(s):
                carried[element, p, j] = tables.step[element] * k[element, p, j]
    np.dot(flat, tables.from_start_columns, summed)
    for element in range(elements):
        for p in range(3):
            for j in range(s):
                angles[p, element, j] = ends[element, p] + more[element, p, j]
                found[p, element, j] = (
                    rotation[0, p, element, j] * k[element, 0, j]
                    + rotation[1, p, element, j] * k[element, 1, j]
                    + rotation[2, p, element, j] * k[element, 2, j]
                )
        for j in range(s):
            found[3, element, j] = (
                stretched[element, j]
                + (
                    local[0, element, j] * angles[0, element, j]
                    + local[1, element, j] * angles[1, element, j]
                    + local[2, element, j] * angles[2, element, j]
                    - local[6, element, j] * k[element, 0, j]
                    - local[7, element, j] * k[element, 1, j]
                    - local[8, element, j] * k[element, 2, j]
                )
                / local[9, element, j]
            )
