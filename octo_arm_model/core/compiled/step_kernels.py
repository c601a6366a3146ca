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
    s, elements = tables.weights.size, tables.step.size
    bends, ends = np.empty((elements, 3 * s)), np.zeros((elements, 6))
    own, carried, local, rotation = np.empty(3 * s), np.empty(s), system.at_points, system.rotation
    over = 1.0 / local[9]
    stretched = imbalance[3] * over
    for element in range(elements):
        first, h, alone = element * s, tables.step[element], ends[element]
        for p in range(3):
            side = own[p * s : p * s + s]
            for j in range(s):
                at = first + j
                side[j] = (
                    rotation[p, 0, at] * imbalance[0, at] + rotation[p, 1, at] * imbalance[1, at]
                    + rotation[p, 2, at] * imbalance[2, at] - local[6 + p, at] * stretched[at]
                )  # fmt: skip
                carried[j] = -h * local[3 + p, at] * imbalance[3, at]
            add_products(carried, tables.to_end_columns, side)
            for j in range(s):
                alone[3 + p] += tables.weights[j] * carried[j]
        solve_transposed(system.factors[element], system.pivots[element], own.reshape(1, 3 * s))
        bends[element] = own
        for p in range(3):
            row = system.to_moment[element, p]
            for j in range(3 * s):
                alone[3 + p] -= row[j] * own[j]
            for j in range(s):
                alone[p] += h * tables.weights[j] * own[p * s + j]
    link_changes(system, ends.reshape(elements, 6, 1))
    for element in range(elements):
        first, h, k = element * s, tables.step[element], bends[element]
        add_products(ends[element], system.bends[element], k)
        for p in range(3):
            angles = turn[p, first : first + s]
            angles[:] = ends[element, p]
            for j in range(s):
                carried[j] = h * k[p * s + j]
            add_products(carried, tables.from_start_columns, angles)
        for j in range(s):
            at, k_0, k_1, k_2 = first + j, k[j], k[s + j], k[2 * s + j]
            for p in range(3):
                change[p, at] = (
                    rotation[0, p, at] * k_0 + rotation[1, p, at] * k_1 + rotation[2, p, at] * k_2
                )
            change[3, at] = stretched[at] + over[at] * (
                local[0, at] * turn[0, at] + local[1, at] * turn[1, at]
                + local[2, at] * turn[2, at]
                - local[6, at] * k_0 - local[7, at] * k_1 - local[8, at] * k_2
            )  # fmt: skip
