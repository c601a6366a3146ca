"""The linearised equilibrium of a loaded rod: what `numba_build` compiles.

As `loaded.linearised`, element by element and without shear. Elements are linked from the tip to
the base by d m = P Phi + p. Unknowns of an element are component by component, points in order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.dense_kernels import factorise, invert_three, solve_transposed
from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.state_kernels import RodState
from octo_arm_model.core.hints import FloatArray, IntArray


class System(NamedTuple):
    """The linearised equilibrium of elements with s points each.

    Attributes:
        factors: of the transposed matrices of all elements, (elements, 3 s, 3 s).
        pivots: exchanges of their rows, (elements, 3 s).
        bends: k by Phi at the first and d m at the last end of each, (elements, 6, 3 s).
        ends: from these to Phi at the last and d m at the first end, (elements, 6, 6).
        to_moment: from k to the change of moment along each, negative, (elements, 3, 3 s).
        inverse: of what links Phi at the last end to that at the first, (elements, 3, 3).
        on: from Phi at the first to that at the last end, (elements, 3, 3).
        by_turn: P at the ends of all elements, (elements + 1, 3, 3).
        at_points: t x n, n x t over the axial stiffness, what couples it to curvatures in
            base_frame, and the axial stiffness, (10, points).
        rotation: orientations that it is linearised about, (3, 3, points).
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


def empty_system(tables: RodTables) -> System:
    """Room for a system."""
    return system_of(tables.step.size, tables.weights.size)


def system_of(elements: int, s: int) -> System:
    """Room for a system of so many elements with s points each."""
    return System(
        np.empty((elements, 3 * s, 3 * s)), np.empty((elements, 3 * s), np.int64),
        np.empty((elements, 6, 3 * s)), np.empty((elements, 6, 6)),
        np.empty((elements, 3, 3 * s)), np.empty((elements, 3, 3)), np.empty((elements, 3, 3)),
        np.zeros((elements + 1, 3, 3)), np.empty((10, elements * s)),
        np.empty((3, 3, elements * s)),
    )  # fmt: skip


def find_terms(
    state: RodState, first: int, at_points: FloatArray, by_turn: FloatArray, by_bend: FloatArray,
    follow: FloatArray, bending: FloatArray,
) -> None:  # fmt: skip
    """Fill in what Phi and k do at the points from ``first`` on, each (3, 3, s)."""
    rotation, force, moment, hessian = state.rotation, state.force, state.moment, state.hessian
    mixed, across, carried = np.empty(3), np.empty(3), np.empty(3)
    condensed, half = np.empty((3, 3)), np.empty((3, 3))
    for j in range(by_turn.shape[2]):
        at = first + j
        stiffness = hessian[3, 3, at]
        over = 1.0 / stiffness
        # n x (u' x Phi) = u' (n . Phi) - Phi (n . u'); u' is along the tangent.
        along = 0.0
        for p in range(3):
            n, m = (p + 1) % 3, (p + 2) % 3
            across[p] = rotation[n, 0, at] * force[m, at] - rotation[m, 0, at] * force[n, at]
            carried[p] = -across[p] * over
            mixed[p] = (
                rotation[p, 0, at] * hessian[0, 3, at]
                + rotation[p, 1, at] * hessian[1, 3, at]
                + rotation[p, 2, at] * hessian[2, 3, at]
            )
            along += force[p, at] * rotation[p, 0, at]
            at_points[p, at], at_points[3 + p, at] = across[p], carried[p]
            at_points[6 + p, at] = mixed[p]
        at_points[9, at] = stiffness
        stretch = state.twist[3, at]
        for k in range(3):
            for m in range(k, 3):
                value = hessian[k, m, at] - hessian[k, 3, at] * hessian[m, 3, at] * over
                condensed[k, m] = condensed[m, k] = value
        for p in range(3):
            for m in range(3):
                half[p, m] = (
                    rotation[p, 0, at] * condensed[0, m]
                    + rotation[p, 1, at] * condensed[1, m]
                    + rotation[p, 2, at] * condensed[2, m]
                )
        for p in range(3):
            for q in range(3):
                by_turn[p, q, j] = (
                    carried[p] * across[q] - stretch * rotation[p, 0, at] * force[q, at]
                )
                by_bend[p, q, j] = carried[p] * mixed[q]
                follow[p, q, j] = -over * mixed[p] * across[q]
                bending[p, q, j] = (
                    half[p, 0] * rotation[q, 0, at]
                    + half[p, 1] * rotation[q, 1, at]
                    + half[p, 2] * rotation[q, 2, at]
                )
            by_turn[p, p, j] += stretch * along
        for p in range(3):
            n, m = (p + 1) % 3, (p + 2) % 3
            follow[m, n, j] += moment[p, at]
            follow[n, m, j] -= moment[p, at]


def find_system(tables: RodTables, state: RodState, system: System) -> int:
    """Fill in the linearised ``system`` about a ``state``.

    Returns:
        The sign of its determinant, 1 or -1; 0 where it is singular.
    """
    s = tables.weights.size
    by_turn, follow = np.empty((3, 3, s)), np.empty((3, 3, s))
    by_bend, bending = np.empty((3, 3, s)), np.empty((3, 3, s))
    twice, rates = np.empty(s * s), np.empty(s)
    system.rotation[:] = state.rotation
    sign = 1
    for element in range(tables.step.size):
        h = tables.step[element]
        find_terms(state, element * s, system.at_points, by_turn, by_bend, follow, bending)
        matrix, sides = system.factors[element], system.bends[element]
        to_moment = system.to_moment[element]
        for p in range(3):
            for q in range(3):
                side, out = sides[q, p * s : p * s + s], to_moment[p, q * s : q * s + s]
                followed, bends, local = follow[p, q], by_bend[p, q], bending[p, q]
                for j in range(s):
                    rates[j] = -h * by_turn[p, q, j]
                    side[j] = followed[j]
                    out[j] = -h * bends[j] * tables.weights[j]
                add_products(rates, tables.to_end_columns, side)
                sides[3 + q, p * s : p * s + s] = 1.0 if p == q else 0.0
                for j in range(s):
                    rates[j] *= -h
                twice[:] = 0.0
                add_products(rates, tables.twice, twice)
                for j in range(s):
                    rates[j] *= tables.weights[j]
                add_products(rates, tables.from_start, out)
                for j in range(s):
                    row, first = matrix[q * s + j, p * s : p * s + s], j * s
                    ahead, behind = tables.to_end_columns[j], tables.from_start_columns[j]
                    bend = by_bend[p, q, j]
                    for i in range(s):
                        row[i] = twice[first + i] - h * (ahead[i] * bend + behind[i] * followed[i])
                    row[j] += local[j]
        own = factorise(matrix, system.pivots[element])
        if own == 0:
            return 0
        sign *= own
        solve_transposed(matrix, system.pivots[element], sides)
        ends = system.ends[element]
        for column in range(6):
            # Sums side by side, since each waits for the one before.
            side, last_0, last_1, last_2 = sides[column], 0.0, 0.0, 0.0
            before_0, before_1, before_2 = 0.0, 0.0, 0.0
            for j in range(s):
                weight = h * tables.weights[j]
                last_0 += weight * side[j]
                last_1 += weight * side[s + j]
                last_2 += weight * side[2 * s + j]
                if column < 3:
                    before_0 -= weight * by_turn[0, column, j]
                    before_1 -= weight * by_turn[1, column, j]
                    before_2 -= weight * by_turn[2, column, j]
            for row in range(3 * s):
                before_0 -= to_moment[0, row] * side[row]
                before_1 -= to_moment[1, row] * side[row]
                before_2 -= to_moment[2, row] * side[row]
            ends[0, column], ends[1, column], ends[2, column] = last_0, last_1, last_2
            ends[3, column], ends[4, column], ends[5, column] = before_0, before_1, before_2
            ends[column, column] += 1.0
    return sign * link(system)


def link(system: System) -> int:
    """Link the elements, from the tip: d m = P Phi + p at the last end of each.

    Returns:
        The sign of the determinant, 0 where it is singular.
    """
    sign, linked, beyond = 1, np.empty((3, 3)), np.empty((3, 3))
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
