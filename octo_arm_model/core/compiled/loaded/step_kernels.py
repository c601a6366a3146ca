"""Kernels for a Newton or chord step of a loaded rod: one solution of the linearised system."""

from __future__ import annotations

from octo_arm_model.core.compiled.loaded.rod_state import RodWork
from octo_arm_model.core.compiled.loaded.rod_tables import ElementTables
from octo_arm_model.core.compiled.loaded.system_kernels import System
from octo_arm_model.core.compiled.numerics.dense_kernels import solve_transposed
from octo_arm_model.core.compiled.numerics.products import add_each, multiply_rows
from octo_arm_model.core.compiled.numerics.references import borrows, inlined
from octo_arm_model.core.hints import FloatArray

Three = tuple[float, float, float]


@borrows
@inlined
def find_step(
    tables: ElementTables,
    system: System,
    imbalance: FloatArray,
    change: FloatArray,
    turn: FloatArray,
    work: RodWork,
) -> None:
    """Fill in the ``change`` of the twist (4, points) that removes a small ``imbalance``.

    It solves the linearised ``system`` for one wrench ``imbalance`` (4, points) in the axes of the
    cross sections. Also fills in the rotations ``turn`` of the cross sections, (3, points) in
    base_frame [rad]. `response_kernels.respond` does the same for several wrenches; here the
    innermost loops run along the points.
    """
    balance_elements(tables, system, imbalance, work)
    join_elements(tables, system, imbalance, (0.0, 0.0, 0.0), change, turn, work)


@borrows
def find_response_to_moment(
    tables: ElementTables, system: System, axis: int, nothing: FloatArray, change: FloatArray,
    turn: FloatArray, work: RodWork,
) -> None:  # fmt: skip
    """`find_step` for a unit moment on the tip about an ``axis`` of base_frame.

    It passes through all elements alike, so that none has anything to balance by itself.
    ``nothing`` (4, points) is zero.
    """
    work.rows[6:9] = 0.0
    work.ends[:] = 0.0
    unit = 1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0
    join_elements(tables, system, nothing, unit, change, turn, work)


@borrows
@inlined
def balance_elements(
    tables: ElementTables, system: System, imbalance: FloatArray, work: RodWork
) -> None:
    """Balance each element by itself, with Phi = 0 at its first and d m = 0 at its last end.

    Fills in its k in rows 6 to 8 of the room in ``work``, and Phi at its last and d m at its first
    end in the ``ends`` there.
    """
    s, elements, count = tables.weights.size, tables.step.size, imbalance.shape[1]
    given, weights, lengths = imbalance, tables.weights, tables.lengths
    local, rotation, room = system.at_points, system.rotation, work.rows
    ends, over = work.ends, room[9]
    for i in range(count):
        over[i] = 1.0 / local[9, i]
    # The same arrays along all points, and by element.
    rows, sums, bends = room[:3], room[3:6], room[6:9].reshape(elements, 3 * s)
    carried, k, more = (
        rows.reshape(3, elements, s), bends.reshape(elements, 3, s), sums.reshape(3, elements, s)
    )  # fmt: skip
    for p in range(3):
        out, by_force, force = rows[p], local[3 + p], given[3]
        for i in range(count):
            out[i] = -lengths[i] * by_force[i] * force[i]
    multiply_rows(rows, tables.to_end_columns, sums)
    for p in range(3):
        out, coupled, force = sums[p], local[6 + p], given[3]
        a, b, c = rotation[p, 0], rotation[p, 1], rotation[p, 2]
        for i in range(count):
            out[i] += (a[i] * given[0, i] + b[i] * given[1, i]) + (
                c[i] * given[2, i] - coupled[i] * (over[i] * force[i])
            )
    for element in range(elements):
        for p in range(3):
            for j in range(s):
                k[element, p, j] = more[p, element, j]
    solve_transposed(system.factors, system.pivots, bends.reshape(elements, 1, 3 * s))
    for element in range(elements):
        own, alone, moments = bends[element], ends[element], system.to_moment[element]
        # Six sums in one loop, since additions to one sum wait for each other.
        a, b, c, d, e, f = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(s):
            weight, turning = weights[j], tables.step[element] * weights[j]
            a, b, c = (
                a + turning * own[j], b + turning * own[s + j], c + turning * own[2 * s + j]
            )  # fmt: skip
            d, e, f = (
                d + weight * carried[0, element, j], e + weight * carried[1, element, j],
                f + weight * carried[2, element, j],
            )  # fmt: skip
        for j in range(3 * s):
            bend = own[j]
            d, e, f = d - moments[0, j] * bend, e - moments[1, j] * bend, f - moments[2, j] * bend
        alone[0], alone[1], alone[2], alone[3], alone[4], alone[5] = a, b, c, d, e, f


@borrows
@inlined
def join_elements(
    tables: ElementTables, system: System, imbalance: FloatArray, tip: Three, change: FloatArray,
    turn: FloatArray, work: RodWork,
) -> None:  # fmt: skip
    """Join elements that are balanced by themselves, with a change of moment at the ``tip``.

    They are those of `balance_elements`. Fills in ``change`` and ``turn`` of `find_step`.
    """
    s, elements, count = tables.weights.size, tables.step.size, imbalance.shape[1]
    given, found, lengths = imbalance, change, tables.lengths
    local, rotation, room, ends = system.at_points, system.rotation, work.rows, work.ends
    rows, sums, bends = room[:3], room[3:6], room[6:9].reshape(elements, 3 * s)
    carried, k, more = (
        rows.reshape(3, elements, s), bends.reshape(elements, 3, s), sums.reshape(3, elements, s)
    )  # fmt: skip
    link_step(system, tip, ends)
    add_each(ends, system.bends, bends)
    for element in range(elements):
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
    multiply_rows(rows, tables.from_start_columns, sums)
    for p in range(3):
        angle, across, out = sums[p], local[p], turn[p]
        for element in range(elements):
            for j in range(s):
                more[p, element, j] += ends[element, p]
        for i in range(count):
            out[i] = angle[i]
            stretched[i] += across[i] * angle[i]
    axial = local[9]
    for i in range(count):
        stretched[i] /= axial[i]


@borrows
def link_step(system: System, tip: Three, ends: FloatArray) -> None:
    """Solve for the rotations Phi and changes of moment d m at the ``ends`` of all elements.

    ``ends`` (elements, 6) is overwritten. On entry it has Phi at the last end and d m at the first
    end of each element by itself; on return Phi at the first and d m at the last end within the
    arm, with d m at the ``tip``. `response_kernels.link_changes` does the same for several
    columns, without that.
    """
    moment = tip
    for element in range(len(ends) - 1, -1, -1):
        own, both, here = ends[element], system.ends[element], system.by_turn[element + 1]
        beyond = moment
        turn = plus_three(both[:3, 3:], beyond, (own[0], own[1], own[2]))
        turn = plus_three(system.inverse[element], turn, (0.0, 0.0, 0.0))
        own[0], own[1], own[2] = turn
        turn = plus_three(here, turn, beyond)
        moment = plus_three(both[3:, 3:], turn, (own[3], own[4], own[5]))
        own[3], own[4], own[5] = beyond
    start = 0.0, 0.0, 0.0
    for element in range(len(ends)):
        own = ends[element]
        following = plus_three(system.on[element], start, (own[0], own[1], own[2]))
        own[0], own[1], own[2] = start
        moment = plus_three(system.by_turn[element + 1], following, (own[3], own[4], own[5]))
        own[3], own[4], own[5] = moment
        start = following


@borrows
def plus_three(matrix: FloatArray, row: Three, more: Three) -> Three:
    """Return the product of a ``matrix`` (3, 3) with ``row`` plus ``more``."""
    a, b, c = row
    return (
        more[0] + (matrix[0, 0] * a + matrix[0, 1] * b + matrix[0, 2] * c),
        more[1] + (matrix[1, 0] * a + matrix[1, 1] * b + matrix[1, 2] * c),
        more[2] + (matrix[2, 0] * a + matrix[2, 1] * b + matrix[2, 2] * c),
    )
