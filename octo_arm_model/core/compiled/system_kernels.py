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


def empty_system(tables: RodTables) -> System:
    """Room for a system."""
    elements, s = tables.step.size, tables.weights.size
    return System(
        np.empty((elements, 3 * s, 3 * s)), np.empty((elements, 3 * s), np.int64),
        np.empty((elements, 6, 3 * s)), np.empty((elements, 6, 6)),
        np.empty((elements, 3, 3 * s)), np.empty((elements, 3, 3)), np.empty((elements, 3, 3)),
        np.zeros((elements + 1, 3, 3)), np.empty((10, elements * s)),
    )  # fmt: skip


def find_terms(
    twist: FloatArray, rotation: FloatArray, force: FloatArray, moment: FloatArray,
    hessian: FloatArray, first: int, at_points: FloatArray, by_turn: FloatArray,
    by_bend: FloatArray, follow: FloatArray, bending: FloatArray,
) -> None:  # fmt: skip
    """Fill in what Phi and k do at the points from ``first`` on, each (3, 3, s)."""
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
        stretch = twist[3, at]
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


def find_system(
    tables: RodTables, twist: FloatArray, rotation: FloatArray, force: FloatArray,
    moment: FloatArray, hessian: FloatArray, system: System,
) -> int:  # fmt: skip
    """Fill in the linearised ``system`` about a state.

    Returns:
        The sign of its determinant, 1 or -1; 0 where it is singular.
    """
    s = tables.weights.size
    by_turn, follow = np.empty((3, 3, s)), np.empty((3, 3, s))
    by_bend, bending = np.empty((3, 3, s)), np.empty((3, 3, s))
    turned, twice = np.empty((9 * s, s)), np.empty((9 * s, s))
    sign = 1
    for element in range(tables.step.size):
        h = tables.step[element]
        find_terms(
            twist, rotation, force, moment, hessian, element * s, system.at_points, by_turn,
            by_bend, follow, bending,
        )  # fmt: skip
        for p in range(3):
            for q in range(3):
                rates = by_turn[p, q]
                for j in range(s):
                    row, weights = turned[(3 * p + q) * s + j], tables.from_start_columns[j]
                    for i in range(s):
                        row[i] = h * h * weights[i] * rates[i]
        np.dot(turned, tables.to_end_columns, twice)
        matrix = system.factors[element]
        for p in range(3):
            for q in range(3):
                followed = follow[p, q]
                for j in range(s):
                    out, row = matrix[q * s + j, p * s : p * s + s], twice[(3 * p + q) * s + j]
                    ahead, behind = tables.to_end_columns[j], tables.from_start_columns[j]
                    bend = by_bend[p, q, j]
                    for i in range(s):
                        out[i] = row[i] - h * (ahead[i] * bend + behind[i] * followed[i])
                    out[j] += bending[p, q, j]
        sides, to_moment = system.bends[element], system.to_moment[element]
        for p in range(3):
            for q in range(3):
                side = sides[q, p * s : p * s + s]
                side[:] = follow[p, q]
                add_products(-h * by_turn[p, q], tables.to_end_columns, side)
                sides[3 + q, p * s : p * s + s] = 1.0 if p == q else 0.0
                out = to_moment[p, q * s : q * s + s]
                out[:] = -h * by_bend[p, q] * tables.weights
                add_products(h * h * by_turn[p, q] * tables.weights, tables.from_start, out)
        own = factorise(matrix, system.pivots[element])
        if own == 0:
            return 0
        sign *= own
        solve_transposed(matrix, system.pivots[element], sides)
        ends = system.ends[element]
        for column in range(6):
            for p in range(3):
                last, before = 0.0, 0.0
                for j in range(s):
                    last += tables.weights[j] * sides[column, p * s + j]
                for row in range(3 * s):
                    before -= to_moment[p, row] * sides[column, row]
                if column < 3:
                    for j in range(s):
                        before -= h * tables.weights[j] * by_turn[p, column, j]
                ends[p, column] = h * last + (1.0 if p == column else 0.0)
                ends[3 + p, column] = before + (1.0 if 3 + p == column else 0.0)
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


def respond(
    tables: RodTables, rotation: FloatArray, system: System, imbalance: FloatArray,
    change: FloatArray,
) -> None:  # fmt: skip
    """Fill in the ``change`` of twist (columns, 4, points) under an ``imbalance`` likewise."""
    s, elements, columns = tables.weights.size, tables.step.size, len(imbalance)
    own = np.empty((elements, columns, 3 * s))
    last, before = np.zeros((elements, columns, 3)), np.zeros((elements, columns, 3))
    carried = np.empty(s)
    at_points = system.at_points
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
