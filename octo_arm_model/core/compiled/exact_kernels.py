"""Unloaded arms by the model exact: what `numba_build` compiles, as `models.exact` has it."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.frame_kernels import read_out
from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.compiled.minimum_kernels import find_minima
from octo_arm_model.core.compiled.section_tables import ExactTables
from octo_arm_model.core.compiled.tables import GridTables
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.models.exact import RESOLVED


def is_resolved(tables: ExactTables, twist: FloatArray) -> bool:
    """Whether the points resolve deviations ``twist`` (4, points), as `Exact` asks."""
    count = tables.tail.shape[0]
    size, last = np.zeros(4), np.zeros(4)
    for k in range(4):
        for first in range(0, twist.shape[1], count):
            one, other = 0.0, 0.0
            for i in range(count):
                value = twist[k, first + i]
                size[k] = max(size[k], abs(value))
                one += value * tables.tail[i, 0]
                other += value * tables.tail[i, 1]
            last[k] = max(last[k], abs(one), abs(other))
    angular = max(size[0], size[1], size[2])
    for k in range(4):
        if last[k] > RESOLVED * (angular if k < 3 else size[3]):
            return False
    return True


def find_exact_twist(
    tables: ExactTables, tensions: FloatArray, twist: FloatArray
) -> tuple[float, int]:
    """Fill in the ``twist`` (4, nodes); returns what `find_minima` does."""
    points = tables.tail.shape[0]
    coarse = np.empty((4, tables.sections.axial.size))
    residual, steps = find_minima(tables.sections, tensions, coarse)
    if steps < 0:
        return residual, steps
    # Deviations are interpolated, so that an arm without tensions stays exactly as it was.
    for i in range(coarse.shape[1]):
        coarse[3, i] -= 1.0
    if not is_resolved(tables, coarse):
        return find_minima(tables.at_nodes, tensions, twist)
    twist[:] = 0.0
    done = 0
    for panel, first, count in tables.runs:
        matrix = tables.to_nodes[done : done + points * count].reshape(points, count)
        for k in range(4):
            row = coarse[k, panel * points : (panel + 1) * points]
            add_products(row, matrix, twist[k, first : first + count])
        done += points * count
    for i in range(twist.shape[1]):
        twist[3, i] += 1.0
    return residual, steps


def find_exact_shapes(
    tables: ExactTables, grid: GridTables, tensions: FloatArray, twist: FloatArray,
    strains: FloatArray, position: FloatArray, quaternion: FloatArray, residual: FloatArray,
    iterations: IntArray,
) -> int:  # fmt: skip
    """As `kernels.find_shapes`, by the model exact.

    An entry of its own, as every table that is passed makes a call slower.
    """
    without = 0
    for arm in range(len(tensions)):
        residual[arm], iterations[arm] = find_exact_twist(tables, tensions[arm], twist)
        if iterations[arm] >= 0:
            read_out(grid, twist, strains[:, arm], position[arm], quaternion[arm])
        else:
            without += 1
    return without
