"""Kernels of the model exact for unloaded arms, as in `models.unloaded_exact`."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.models.arm_tables import GridTables
from octo_arm_model.core.compiled.models.frame_kernels import read_out
from octo_arm_model.core.compiled.numerics.products import add_runs
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.compiled.section.minimum_kernels import find_some_minima
from octo_arm_model.core.compiled.section.section_tables import ExactTables
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.models.unloaded_exact import RESOLVED


@borrows
def find_tails(tables: ExactTables, twist: FloatArray, tail: FloatArray, size: FloatArray) -> None:
    """Fill in ``tail`` (4, panels), the larger of the last two Chebyshev coefficients in a panel.

    Of ``twist`` (4, points), the deviation from the unloaded arm. Its ``size`` (4,), the scale of
    the coefficients, is filled in, too: one value for the three angular components.
    """
    count = tables.tail.shape[0]
    for k in range(4):
        size[k] = 0.0
        for panel in range(tail.shape[1]):
            one, other = 0.0, 0.0
            for i in range(count):
                value = twist[k, panel * count + i]
                size[k] = max(size[k], abs(value))
                one += value * tables.tail[i, 0]
                other += value * tables.tail[i, 1]
            tail[k, panel] = max(abs(one), abs(other))
    size[:3] = max(size[0], size[1], size[2])


def refine(
    tables: ExactTables, panel: int, tensions: FloatArray, twist: FloatArray
) -> tuple[float, int]:
    """Minimise the energy at the nodes of one ``panel``, from the ``twist`` (4, nodes) there.

    Returns:
        As `find_minima`.
    """
    at_nodes = np.empty((4, tables.at_nodes.axial.size))
    start, stop = tables.node_blocks[panel]
    place = 0
    for number, first, count in tables.runs:
        if number == panel:
            at_nodes[:, place : place + count] = twist[:, first : first + count]
        place += count
    residual, steps = find_some_minima(tables.at_nodes, start, stop, tensions, at_nodes, True)
    place = 0
    for number, first, count in tables.runs:
        if number == panel:
            twist[:, first : first + count] = at_nodes[:, place : place + count]
        place += count
    return residual, steps


def find_exact_twist(
    tables: ExactTables, tensions: FloatArray, is_near: bool, coarse: FloatArray,
    twist: FloatArray,
) -> tuple[float, int]:  # fmt: skip
    """Fill in the ``twist`` (4, nodes), and ``coarse`` (4, points) at the Chebyshev points.

    If ``is_near``, ``coarse`` is given as the start. Returns as `find_some_minima`.
    """
    points, sections = tables.tail.shape[0], tables.sections
    residual, steps = find_some_minima(
        sections, 0, len(sections.blocks), tensions, coarse, is_near
    )
    if steps < 0:
        return residual, steps
    # Deviations are interpolated, so that an arm without tensions is exactly undeformed.
    for i in range(coarse.shape[1]):
        coarse[3, i] -= 1.0
    tail, size = np.empty((4, len(tables.node_blocks))), np.empty(4)
    find_tails(tables, coarse, tail, size)
    twist[:] = 0.0
    add_runs(tables.runs, tables.to_nodes, points, coarse, twist)
    for i in range(twist.shape[1]):
        twist[3, i] += 1.0
    for i in range(coarse.shape[1]):
        coarse[3, i] += 1.0
    taken = steps
    for panel in range(tail.shape[1]):
        is_resolved = not tables.uneven[panel]
        for k in range(4):
            is_resolved &= tail[k, panel] <= RESOLVED * size[k]
        if not is_resolved:
            left, more = refine(tables, panel, tensions, twist)
            if more < 0:
                return left, -1
            residual, taken = max(residual, left), max(taken, steps + more)
    return residual, taken


def find_exact_shapes(
    tables: ExactTables, grid: GridTables, tensions: FloatArray, twist: FloatArray,
    strains: FloatArray, position: FloatArray, quaternion: FloatArray, residual: FloatArray,
    iterations: IntArray,
) -> int:  # fmt: skip
    """As `paper_kernels.find_shapes`, by the model exact.

    A separate entry point, as every table that is passed adds to the time of a call.
    """
    failures, coarse = 0, np.empty((4, tables.sections.axial.size))
    for arm in range(len(tensions)):
        residual[arm], iterations[arm] = find_exact_twist(
            tables, tensions[arm], False, coarse, twist
        )
        if iterations[arm] >= 0:
            read_out(grid, twist, strains[:, arm], position[arm], quaternion[arm])
        else:
            failures += 1
    return failures
