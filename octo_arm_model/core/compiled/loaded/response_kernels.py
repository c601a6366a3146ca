"""Kernels for the response of a loaded rod to several small wrenches, from its linearised system.

Arrays have one column for each wrench. Columns are the last axis, so that the innermost loops run
along contiguous memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.loaded.rod_state import RodState, copy_rows
from octo_arm_model.core.compiled.loaded.rod_tables import ElementTables
from octo_arm_model.core.compiled.loaded.state_kernels import find_wrench_of_tip_force
from octo_arm_model.core.compiled.loaded.system_kernels import System
from octo_arm_model.core.compiled.numerics.dense_kernels import solve_columns
from octo_arm_model.core.compiled.numerics.products import multiply
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray


class ResponseWork(NamedTuple):
    """Room for `respond` with a number of columns.

    Attributes:
        bends: k of all elements, (elements, 3 s, columns).
        ends: changes at the ends of all elements, (elements, 6, columns).
        carried: by point of an element, (s, 3 columns).
        moved: likewise.
        more: likewise by unknown, (3 s, columns).
        rows: that of `solve_columns`, (columns, 3 s).
        three: of three rows each, (4, 3, columns).
    """

    bends: FloatArray
    ends: FloatArray
    carried: FloatArray
    moved: FloatArray
    more: FloatArray
    rows: FloatArray
    three: FloatArray


def respond(
    tables: ElementTables,
    system: System,
    imbalance: FloatArray,
    change: FloatArray,
    turn: FloatArray,
) -> None:
    """Fill in the ``change`` of the twist (4, points, columns) under a small ``imbalance``.

    The compiled counterpart of `Linearised.solve`: it solves the linearised ``system`` for the
    wrenches ``imbalance`` (4, points, columns) in the axes of the cross sections. Also fills in
    the rotations ``turn`` of the cross sections, (3, points, columns) in base_frame [rad].
    """
    s, elements, columns = tables.weights.size, tables.step.size, imbalance.shape[2]
    work = ResponseWork(
        np.empty((elements, 3 * s, columns)), np.empty((elements, 6, columns)),
        np.empty((s, 3 * columns)), np.empty((s, 3 * columns)), np.empty((3 * s, columns)),
        np.empty((columns, 3 * s)), np.empty((4, 3, columns)),
    )  # fmt: skip
    respond_in(tables, system, imbalance, change, turn, work)


@borrows
def respond_in(
    tables: ElementTables, system: System, imbalance: FloatArray, change: FloatArray,
    turn: FloatArray, work: ResponseWork,
) -> None:  # fmt: skip
    """`respond` in the room of ``work``."""
    s, elements, columns = tables.weights.size, tables.step.size, imbalance.shape[2]
    own, ends, carried, moved, more = work.bends, work.ends, work.carried, work.moved, work.more
    before = work.three[3]
    at_points, rotation = system.at_points, system.rotation
    for element in range(elements):
        first, h, sides = element * s, tables.step[element], own[element]
        for j in range(s):
            for p in range(3):
                factor, start = -h * at_points[3 + p, first + j], p * columns
                for i in range(columns):
                    carried[j, start + i] = factor * imbalance[3, first + j, i]
        multiply(tables.to_end_columns, carried, moved)
        for j in range(s):
            at = first + j
            over = 1.0 / at_points[9, at]
            for p in range(3):
                a, b, c = rotation[p, 0, at], rotation[p, 1, at], rotation[p, 2, at]
                d, row, start = over * at_points[6 + p, at], p * s + j, p * columns
                for i in range(columns):
                    sides[row, i] = (
                        moved[j, start + i] + a * imbalance[0, at, i] + b * imbalance[1, at, i]
                        + c * imbalance[2, at, i] - d * imbalance[3, at, i]
                    )  # fmt: skip
        solve_columns(system.factors[element], system.pivots[element], sides, work.rows)
        multiply(system.to_moment[element].T, sides, before)
        for p in range(3):
            start = p * columns
            for i in range(columns):
                ends[element, p, i], ends[element, 3 + p, i] = 0.0, -before[p, i]
            for j in range(s):
                weight, row = tables.weights[j], p * s + j
                for i in range(columns):
                    ends[element, 3 + p, i] += weight * carried[j, start + i]
                for i in range(columns):
                    ends[element, p, i] += h * weight * sides[row, i]
    link_changes(system, ends, work.three)
    for element in range(elements):
        first, h, bends = element * s, tables.step[element], own[element]
        multiply(system.bends[element], ends[element], more)
        bends += more
        for p in range(3):
            angles = turn[p, first : first + s]
            multiply(tables.from_start_columns, bends[p * s : p * s + s], angles)
            for j in range(s):
                for i in range(columns):
                    angles[j, i] = ends[element, p, i] + h * angles[j, i]
        for j in range(s):
            at = first + j
            for p in range(3):
                a, b, c = rotation[0, p, at], rotation[1, p, at], rotation[2, p, at]
                for i in range(columns):
                    change[p, at, i] = (
                        a * bends[j, i] + b * bends[s + j, i] + c * bends[2 * s + j, i]
                    )
            over = 1.0 / at_points[9, at]
            a, b, c = over * at_points[0, at], over * at_points[1, at], over * at_points[2, at]
            d, e, f = over * at_points[6, at], over * at_points[7, at], over * at_points[8, at]
            for i in range(columns):
                change[3, at, i] = (
                    over * imbalance[3, at, i] + a * turn[0, at, i] + b * turn[1, at, i]
                    + c * turn[2, at, i] - d * bends[j, i] - e * bends[s + j, i]
                    - f * bends[2 * s + j, i]
                )  # fmt: skip


@borrows
def link_changes(system: System, ends: FloatArray, room: FloatArray) -> None:
    """Solve for the rotations Phi and changes of moment d m at the ``ends`` of all elements.

    ``ends`` (elements, 6, columns) is overwritten. On entry it has Phi at the last end and d m at
    the first end of each element by itself, for Phi = 0 at its first and d m = 0 at its last end.
    On return it has Phi at the first and d m at the last end of each element within the arm. The
    elements are eliminated from the tip to the base and substituted from the base to the tip.
    ``room`` is for (3, 3, columns).
    """
    elements, following, start, beyond = len(ends), room[0], room[1], room[2]
    start[:] = 0.0
    beyond[:] = 0.0
    for element in range(elements - 1, -1, -1):
        both, (turn, moment) = system.ends[element], (ends[element, :3], ends[element, 3:])
        add_three(both[:3, 3:], beyond, turn)
        following[:] = 0.0
        add_three(system.inverse[element], turn, following)
        copy_rows(following, turn)
        copy_rows(beyond, following)
        add_three(system.by_turn[element + 1], turn, following)
        add_three(both[3:, 3:], following, moment)
        beyond = moment
    for element in range(elements):
        turn, moment = ends[element, :3], ends[element, 3:]
        copy_rows(turn, following)
        add_three(system.on[element], start, following)
        copy_rows(start, turn)
        copy_rows(following, start)
        if element + 1 < elements:
            copy_rows(ends[element + 1, 3:], moment)
        else:
            moment[:] = 0.0
        add_three(system.by_turn[element + 1], following, moment)


@borrows
def add_three(matrix: FloatArray, rows: FloatArray, out: FloatArray) -> None:
    """Add the product of ``matrix`` (3, 3) with ``rows`` (3, columns) to ``out`` (3, columns)."""
    for i in range(3):
        a, b, c = matrix[i, 0], matrix[i, 1], matrix[i, 2]
        # Elements are indexed, since views of the rows take longer to make than one column.
        for j in range(out.shape[1]):
            out[i, j] += a * rows[0, j] + b * rows[1, j] + c * rows[2, j]


def tip_wrenches(tables: ElementTables, state: RodState) -> FloatArray:
    """Wrenches on all cross sections that unit wrenches on the tip make, (4, points, 6).

    Each is in the axes of its cross section. Columns 0 to 2 belong to unit forces along the axes
    of base_frame, 3 to 5 to moments about them of a unit force times the length of the arm.
    """
    count, rotation = state.twist.shape[1], state.rotation
    wrench, found, work = np.zeros((4, count, 6)), np.empty((4, count)), np.empty((13, count))
    for axis in range(3):
        find_wrench_of_tip_force(tables, state, axis, found, work)
        wrench[:, :, axis] = found
        for k in range(3):
            for i in range(count):
                wrench[k, i, 3 + axis] = rotation[axis, k, i] * tables.length
    return wrench
