"""Kernels that linearise the equilibrium of a loaded rod and factorise the linear system.

They are the compiled counterpart of `loaded.linearised`, for rods without shear. As there, Phi are
small rotations of the cross sections, k = Phi' their derivatives and d m changes of the moment,
all in base_frame. Instead of a banded system, the elements are eliminated one by one from the tip
to the base, with d m = P Phi + p at the last end of each. The unknowns k of an element are ordered
by component first and by point second.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.loaded.rod_state import RodState, copy_rows
from octo_arm_model.core.compiled.loaded.rod_tables import ElementTables
from octo_arm_model.core.compiled.numerics.dense_kernels import (
    factorise,
    invert_three,
    solve_transposed,
)
from octo_arm_model.core.compiled.numerics.products import multiply_rows
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray, IntArray


class System(NamedTuple):
    """The linearised equilibrium of elements with s points each.

    Attributes:
        factors: LU factors of the transposed matrices of all elements, (elements, 3 s, 3 s).
        pivots: row exchanges of these factors, (elements, 3 s).
        bends: derivatives of k by Phi at the first end (rows 0 to 2) and by d m at the last end
            (rows 3 to 5) of each element, (elements, 6, 3 s).
        ends: matrices from Phi at the first and d m at the last end of each element to Phi at the
            last and d m at the first end, (elements, 6, 6).
        to_moment: matrices from k, with Phi = 0 at the first end, to d m at the last end less d m
            at the first end, (elements, 3, 3 s).
        inverse: inverse of 1 - E P with P at the last end and E the block of ``ends`` from d m at
            the last end to Phi there, (elements, 3, 3).
        on: matrices from Phi at the first end to Phi at the last end, (elements, 3, 3).
        by_turn: P at the ends of all elements, (elements + 1, 3, 3).
        at_points: t x n (rows 0 to 2), n x t over the axial stiffness (3 to 5), the coupling of
            the axial force to the curvatures in base_frame (6 to 8), and the axial stiffness (9),
            with the tangent t and the force n, (10, points).
        rotation: orientations of the state that the system is linearised about, (3, 3, points).
    """

    factors: FloatArray
    pivots: IntArray
    bends: FloatArray
    ends: FloatArray
    to_moment: FloatArray
    inverse: FloatArray
    on: FloatArray
    by_turn: FloatArray
    at_points: FloatArray
    rotation: FloatArray


def empty_system(tables: ElementTables) -> System:
    """Allocate an uninitialised `System` for the elements of ``tables``."""
    return system_of(tables.step.size, tables.weights.size)


def system_of(elements: int, s: int) -> System:
    """Allocate an uninitialised `System` for a number of ``elements`` with ``s`` points each."""
    return System(
        np.empty((elements, 3 * s, 3 * s)), np.empty((elements, 3 * s), np.int64),
        np.empty((elements, 6, 3 * s)), np.empty((elements, 6, 6)),
        np.empty((elements, 3, 3 * s)), np.empty((elements, 3, 3)), np.empty((elements, 3, 3)),
        np.zeros((elements + 1, 3, 3)), np.empty((10, elements * s)),
        np.empty((3, 3, elements * s)),
    )  # fmt: skip


@borrows
def find_terms(
    state: RodState, at_points: FloatArray, by_turn: FloatArray, by_bend: FloatArray,
    follow: FloatArray, bending: FloatArray, room: FloatArray,
) -> None:  # fmt: skip
    """Fill in the coefficients of Phi and k in the linearised equations, each (3, 3, points).

    With the change of stretch eliminated, the equations at a point are

        d m' = ``by_turn`` Phi - ``by_bend`` k    ``bending`` k = d m + ``follow`` Phi + ...

    ``at_points`` (10, points) is filled in as well, see `System`. ``room`` is for (14, points).
    """
    rotation, force, moment, hessian = state.rotation, state.force, state.moment, state.hessian
    stretch, count = state.twist[3], state.twist.shape[1]
    over, along, half = room[0], room[1], room[2:5]
    condensed, stiffness = room[5:].reshape(3, 3, count), at_points[9]
    for i in range(count):
        along[i] = 0.0
        stiffness[i] = hessian[3, 3, i]
        over[i] = 1.0 / stiffness[i]
    for p in range(3):
        n, m = (p + 1) % 3, (p + 2) % 3
        across, carried = at_points[p], at_points[3 + p]
        t_p, t_n, t_m = rotation[p, 0], rotation[n, 0], rotation[m, 0]
        f_p, f_n, f_m = force[p], force[n], force[m]
        for i in range(count):
            across[i] = t_n[i] * f_m[i] - t_m[i] * f_n[i]
            carried[i] = -across[i] * over[i]
            along[i] += stretch[i] * (f_p[i] * t_p[i])
        mixed, a, b, c = at_points[6 + p], rotation[p, 0], rotation[p, 1], rotation[p, 2]
        h_0, h_1, h_2 = hessian[0, 3], hessian[1, 3], hessian[2, 3]
        for i in range(count):
            mixed[i] = a[i] * h_0[i] + b[i] * h_1[i] + c[i] * h_2[i]
        for k in range(3):
            out, own, one, other = condensed[p, k], hessian[p, k], hessian[p, 3], hessian[k, 3]
            for i in range(count):
                out[i] = own[i] - one[i] * other[i] * over[i]
    for p in range(3):
        a, b, c = rotation[p, 0], rotation[p, 1], rotation[p, 2]
        for k in range(3):
            row, c_0, c_1, c_2 = half[k], condensed[0, k], condensed[1, k], condensed[2, k]
            for i in range(count):
                row[i] = a[i] * c_0[i] + b[i] * c_1[i] + c[i] * c_2[i]
        h_0, h_1, h_2 = half[0], half[1], half[2]
        carried, mixed = at_points[3 + p], at_points[6 + p]
        for q in range(3):
            across, with_bend, f_q = at_points[q], at_points[6 + q], force[q]
            d, e, f = rotation[q, 0], rotation[q, 1], rotation[q, 2]
            turns, bends = by_turn[p, q], by_bend[p, q]
            for i in range(count):
                # n x (u' x Phi) = u' (n . Phi) - Phi (n . u'); u' is along the tangent a.
                turns[i] = carried[i] * across[i] - stretch[i] * a[i] * f_q[i]
                bends[i] = carried[i] * with_bend[i]
            follows, local = follow[p, q], bending[p, q]
            for i in range(count):
                follows[i] = -over[i] * mixed[i] * across[i]
                local[i] = h_0[i] * d[i] + h_1[i] * e[i] + h_2[i] * f[i]
    for p in range(3):
        n, m = (p + 1) % 3, (p + 2) % 3
        turns, more, less, about = by_turn[p, p], follow[m, n], follow[n, m], moment[p]
        for i in range(count):
            turns[i] += along[i]
            more[i] += about[i]
            less[i] -= about[i]


def find_system(tables: ElementTables, state: RodState, system: System) -> int:
    """Fill in the ``system``, the equilibrium linearised about a ``state`` and factorised.

    Returns:
        The sign of the determinant of the system, 1 or -1; 0 where it is singular.
    """
    s, count = tables.weights.size, state.twist.shape[1]
    return assemble(
        tables, state, system, np.empty((7, 3, 3, count)), np.empty((3, 3, s * count)),
        np.empty((14, count)),
    )  # fmt: skip


@borrows
def assemble(
    tables: ElementTables, state: RodState, system: System, work: FloatArray, twice: FloatArray,
    room: FloatArray,
) -> int:  # fmt: skip
    """`find_system` in ``work`` (7, 3, 3, points), ``twice`` (3, 3, s points) and ``room``.

    ``room`` is that of `find_terms`, and s the number of points in an element.
    """
    s, elements = tables.weights.size, tables.step.size
    by_turn, by_bend, follow, bending, weighted, first_turns, last_turns = (
        work[0], work[1], work[2], work[3], work[4], work[5], work[6]
    )  # fmt: skip
    find_terms(state, system.at_points, by_turn, by_bend, follow, bending, room)
    # From here on the axes are row, column, element and point of the element.
    turns, bends = by_turn.reshape(3, 3, elements, s), by_bend.reshape(3, 3, elements, s)
    follows, local = follow.reshape(3, 3, elements, s), bending.reshape(3, 3, elements, s)
    parts, weights = weighted.reshape(3, 3, elements, s), tables.weights
    for p in range(3):
        copy_rows(state.rotation[p], system.rotation[p])
        for q in range(3):
            for element in range(elements):
                for j in range(s):
                    turns[p, q, element, j] *= -tables.step[element]
                    parts[p, q, element, j] = turns[p, q, element, j] * weights[j]
    multiply_rows(by_turn, tables.to_end_columns, first_turns)
    multiply_rows(by_turn, tables.twice, twice)
    multiply_rows(weighted, tables.from_start, last_turns)
    side, out = first_turns.reshape(3, 3, elements, s), last_turns.reshape(3, 3, elements, s)
    both = twice.reshape(3, 3, elements, s, s)
    matrices = system.factors.reshape(elements, 3, s, 3, s)
    right = system.bends.reshape(elements, 6, 3, s)
    to_moment = system.to_moment.reshape(elements, 3, 3, s)
    ahead, behind = tables.to_end_columns, tables.from_start_columns
    sign = 1
    for element in range(elements):
        h = tables.step[element]
        for p in range(3):
            for q in range(3):
                for j in range(s):
                    bend = bends[p, q, element, j]
                    right[element, q, p, j] = side[p, q, element, j] + follows[p, q, element, j]
                    right[element, 3 + q, p, j] = 1.0 if p == q else 0.0
                    to_moment[element, p, q, j] = -h * (out[p, q, element, j] + bend * weights[j])
                for j in range(s):
                    bend = bends[p, q, element, j]
                    for i in range(s):
                        matrices[element, q, j, p, i] = -h * (
                            both[p, q, element, j, i] + ahead[j, i] * bend
                            + behind[j, i] * follows[p, q, element, i]
                        )  # fmt: skip
                    matrices[element, q, j, p, j] += local[p, q, element, j]
        own = condense(
            h, weights, turns[:, :, element], system.factors[element],
            system.pivots[element], system.bends[element], system.to_moment[element],
            system.ends[element],
        )  # fmt: skip
        if own == 0:
            return 0
        sign *= own
    return sign * link(system, room)


@borrows
def condense(
    h: float, weights: FloatArray, turns: FloatArray, matrix: FloatArray, pivots: IntArray,
    bends: FloatArray, to_moment: FloatArray, ends: FloatArray,
) -> int:  # fmt: skip
    """Factorise the ``matrix`` of an element of length ``h`` and eliminate its ``bends``.

    ``turns`` (3, 3, s) is the coefficient of Phi in d m' at its points, times minus its length.
    ``matrix``, ``pivots``, ``bends``, ``to_moment`` and ``ends`` are the arrays of `System` for
    this element: ``matrix`` is overwritten by its factors, ``bends`` by the solutions for the
    right-hand sides that it has on entry, and ``ends`` is filled in.

    Returns:
        The sign of the determinant, 0 where it is singular.
    """
    s, sign = weights.size, factorise(matrix, pivots)
    if sign == 0:
        return 0
    n = 3 * s
    solve_transposed(matrix.reshape(1, n, n), pivots.reshape(1, n), bends.reshape(1, 6, n))
    for column in range(6):
        # Six sums in one loop, since additions to one sum wait for each other.
        side, last_0, last_1, last_2 = bends[column], 0.0, 0.0, 0.0
        before_0, before_1, before_2 = 0.0, 0.0, 0.0
        for j in range(s):
            weight = h * weights[j]
            last_0 += weight * side[j]
            last_1 += weight * side[s + j]
            last_2 += weight * side[2 * s + j]
            if column < 3:
                before_0 += weights[j] * turns[0, column, j]
                before_1 += weights[j] * turns[1, column, j]
                before_2 += weights[j] * turns[2, column, j]
        for row in range(3 * s):
            before_0 -= to_moment[0, row] * side[row]
            before_1 -= to_moment[1, row] * side[row]
            before_2 -= to_moment[2, row] * side[row]
        ends[0, column], ends[1, column], ends[2, column] = last_0, last_1, last_2
        ends[3, column], ends[4, column], ends[5, column] = before_0, before_1, before_2
        ends[column, column] += 1.0
    return sign


@borrows
def link(system: System, room: FloatArray) -> int:
    """Eliminate the elements from the tip to the base, with d m = P Phi + p at each last end.

    Fills in ``inverse``, ``on`` and ``by_turn`` of the ``system`` from its ``ends``. ``room`` is
    that of `find_terms`.

    Returns:
        The sign of the product of the determinants of the eliminated matrices, 0 where one of them
        is singular.
    """
    # Of each row the first three.
    sign, linked, beyond = 1, room[:3], room[3:6]
    system.by_turn[-1] = 0.0
    for element in range(len(system.ends) - 1, -1, -1):
        ends, here = system.ends[element], system.by_turn[element + 1]
        inverse, on = system.inverse[element], system.on[element]
        for i in range(3):
            for j in range(3):
                value = 0.0
                for k in range(3):
                    value += ends[i, 3 + k] * here[k, j]
                linked[i, j] = (1.0 if i == j else 0.0) - value
        determinant = invert_three(linked, inverse)
        if not abs(determinant) > 0.0:
            return 0
        if determinant < 0.0:
            sign = -sign
        for i in range(3):
            for j in range(3):
                value = 0.0
                for k in range(3):
                    value += inverse[i, k] * ends[k, j]
                on[i, j] = value
        for i in range(3):
            for j in range(3):
                value = 0.0
                for k in range(3):
                    value += here[i, k] * on[k, j]
                beyond[i, j] = value
        for i in range(3):
            for j in range(3):
                value = ends[3 + i, j]
                for k in range(3):
                    value += ends[3 + i, 3 + k] * beyond[k, j]
                system.by_turn[element, i, j] = value
    return sign
