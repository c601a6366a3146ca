"""Newton's method for a loaded rod: what `numba_build` compiles.

As `loaded.newton` with `loaded.linearised`, element by element and without shear; cross sections
as in `section_kernels`. Elements are linked from the tip to the base by d m = P Phi + p.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.section_kernels import evaluate_sections
from octo_arm_model.core.compiled.tables import RodTables
from octo_arm_model.core.hints import ComplexArray, FloatArray
from octo_arm_model.core.loaded.newton import MOST, NEAR, PROGRESS, QUICK, UPHILL
from octo_arm_model.core.numerics.quaternion import product


def find_frames(tables: RodTables, twist: FloatArray, a: ComplexArray, b: ComplexArray) -> None:
    """Fill in orientations (a, b) at the points under ``twist``, as `kinematics.frames`."""
    points = tables.weights.size
    size = 2 * points
    system, start = np.empty((size, size), np.complex128), np.zeros(size, np.complex128)
    start[::2] = 1.0
    a_0, b_0 = complex(tables.base[0], tables.base[1]), complex(tables.base[2], tables.base[3])
    for element in range(tables.step.size):
        first, half = element * points, 0.5 * tables.step[element]
        for j in range(points):
            at = first + j
            same = complex(0.0, half * twist[0, at])
            other = complex(half * twist[1, at], half * twist[2, at])
            for i in range(points):
                weight = -tables.from_start[i, j]
                system[2 * i, 2 * j] = weight * same
                system[2 * i + 1, 2 * j] = weight * other
                system[2 * i, 2 * j + 1] = -weight * np.conj(other)
                system[2 * i + 1, 2 * j + 1] = weight * np.conj(same)
        for i in range(size):
            system[i, i] += 1.0
        found = np.linalg.solve(system, start)
        x_1, y_1 = complex(1.0, 0.0), complex(0.0, 0.0)
        for j in range(points):
            at, x, y = first + j, found[2 * j], found[2 * j + 1]
            same = complex(0.0, half * twist[0, at])
            other = complex(half * twist[1, at], half * twist[2, at])
            x_1 += tables.weights[j] * (x * same - y * np.conj(other))
            y_1 += tables.weights[j] * (x * other + y * np.conj(same))
            turned = product(a_0, b_0, x, y)
            length = np.sqrt(abs(turned[0]) ** 2 + abs(turned[1]) ** 2)
            a[at], b[at] = turned[0] / length, turned[1] / length
        a_0, b_0 = product(a_0, b_0, x_1, y_1)


def find_rotation(a: ComplexArray, b: ComplexArray, rotation: FloatArray) -> None:
    """Fill in the matrices (3, 3, points) of orientations."""
    for i in range(a.size):
        w, x, y, z = a[i].real, a[i].imag, b[i].real, b[i].imag
        rotation[0, 0, i] = 1.0 - 2.0 * (y * y + z * z)
        rotation[0, 1, i], rotation[1, 0, i] = 2.0 * (x * y - z * w), 2.0 * (x * y + z * w)
        rotation[0, 2, i], rotation[2, 0, i] = 2.0 * (x * z + y * w), 2.0 * (x * z - y * w)
        rotation[1, 1, i] = 1.0 - 2.0 * (x * x + z * z)
        rotation[1, 2, i], rotation[2, 1, i] = 2.0 * (y * z - x * w), 2.0 * (y * z + x * w)
        rotation[2, 2, i] = 1.0 - 2.0 * (x * x + y * y)


def find_state(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    twist: FloatArray, a: ComplexArray, b: ComplexArray, rotation: FloatArray, force: FloatArray,
    moment: FloatArray, imbalance: FloatArray, hessian: FloatArray,
) -> float:  # fmt: skip
    """Fill in the state of ``twist`` as `Equilibrium.state` does; returns the residual."""
    points, count = tables.weights.size, twist.shape[1]
    find_rotation(a, b, rotation)
    scale, gradient = np.empty((4, count)), np.empty((4, count))
    evaluate_sections(tables.sections, tensions, twist, gradient, hessian, scale)
    carried = np.empty((3, points))
    beyond = tip_wrench[3:].copy()
    for element in range(tables.step.size - 1, -1, -1):
        first, h = element * points, tables.step[element]
        for j in range(points):
            at = first + j
            for k in range(3):
                force[k, at] = factor * tables.force[k, at] + tip_wrench[k]
            for k in range(3):
                n, m = (k + 1) % 3, (k + 2) % 3
                carried[k, j] = (
                    h
                    * twist[3, at]
                    * (rotation[n, 0, at] * force[m, at] - rotation[m, 0, at] * force[n, at])
                )
        for k in range(3):
            for i in range(points):
                total = beyond[k] + factor * tables.moment[k, first + i]
                for j in range(points):
                    total += tables.to_end[i, j] * carried[k, j]
                moment[k, first + i] = total
            for j in range(points):
                beyond[k] += tables.weights[j] * carried[k, j]
    outside = np.zeros(4)
    for i in range(count):
        for k in range(3):
            wrench = 0.0
            for m in range(3):
                wrench += rotation[m, k, i] * moment[m, i]
            imbalance[k, i] = wrench
            outside[k] = max(outside[k], abs(wrench))
        wrench = 0.0
        for m in range(3):
            wrench += rotation[m, 0, i] * force[m, i]
        imbalance[3, i] = wrench
        outside[3] = max(outside[3], abs(wrench))
    residual, total = 0.0, 0.0
    for k in range(4):
        for i in range(count):
            imbalance[k, i] -= gradient[k, i]
            residual = max(residual, abs(imbalance[k, i]) / (scale[k, i] + outside[k]))
            total += imbalance[k, i]
    return residual if np.isfinite(total) else np.nan


def find_system(
    tables: RodTables, twist: FloatArray, rotation: FloatArray, force: FloatArray,
    moment: FloatArray, hessian: FloatArray, matrix: FloatArray, inverse: FloatArray,
    bends: FloatArray, ends: FloatArray, to_moment: FloatArray, points_of: FloatArray,
) -> None:  # fmt: skip
    """Fill in the linearised system about a state, as `Linearised` has it.

    ``matrix`` and ``inverse`` (elements, 3 s, 3 s) for s points in each, ``bends``
    (elements, 3 s, 6), ``ends`` (elements, 6, 6) from Phi at the first and d m at the last end to
    the others, ``to_moment`` (elements, 3, 3 s) and ``points_of`` (points, 10): t x n, n x t over
    the axial stiffness, what couples it to curvatures in base_frame, and the axial stiffness.
    """
    s = tables.weights.size
    by_turn, follow = np.empty((3, 3, s)), np.empty((3, 3, s))
    by_bend, bending = np.empty((3, 3, s)), np.empty((3, 3, s))
    turn_rows, sides = np.empty((s, 9)), np.empty((3 * s, 6))
    for element in range(tables.step.size):
        first, h = element * s, tables.step[element]
        for j in range(s):
            at = first + j
            stiffness = hessian[3, 3, at]
            over = 1.0 / stiffness
            own = points_of[at]
            for p in range(3):
                n, m = (p + 1) % 3, (p + 2) % 3
                across = rotation[n, 0, at] * force[m, at] - rotation[m, 0, at] * force[n, at]
                own[p], own[3 + p] = across, -across * over
                mixed = 0.0
                for q in range(3):
                    mixed += rotation[p, q, at] * hessian[q, 3, at]
                own[6 + p] = mixed
            own[9] = stiffness
            # n x (u' x Phi) = u' (n . Phi) - Phi (n . u'); u' is along the tangent.
            along = 0.0
            for p in range(3):
                along += force[p, at] * rotation[p, 0, at]
            stretch = twist[3, at]
            for p in range(3):
                for q in range(3):
                    by_turn[p, q, j] = (
                        own[3 + p] * own[q] - stretch * rotation[p, 0, at] * force[q, at]
                    )
                    by_bend[p, q, j] = own[3 + p] * own[6 + q]
                    follow[p, q, j] = -over * own[6 + p] * own[q]
                    value = 0.0
                    for k in range(3):
                        for m in range(3):
                            value += (
                                rotation[p, k, at]
                                * rotation[q, m, at]
                                * (
                                    hessian[k, m, at]
                                    - hessian[k, 3, at] * hessian[m, 3, at] * over
                                )
                            )
                    bending[p, q, j] = value
                by_turn[p, p, j] += stretch * along
            for p in range(3):
                n, m = (p + 1) % 3, (p + 2) % 3
                follow[m, n, j] += moment[p, at]
                follow[n, m, j] -= moment[p, at]
                for q in range(3):
                    turn_rows[j, 3 * p + q] = h * h * by_turn[p, q, j]
        twice = np.dot(tables.twice, turn_rows)
        own_matrix = matrix[element]
        for p in range(3):
            for q in range(3):
                for i in range(s):
                    for j in range(s):
                        own_matrix[p * s + i, q * s + j] = (
                            twice[i * s + j, 3 * p + q]
                            - h * tables.to_end[i, j] * by_bend[p, q, j]
                            - h * tables.from_start[i, j] * follow[p, q, i]
                        )
                    own_matrix[p * s + i, q * s + i] += bending[p, q, i]
                    side = follow[p, q, i]
                    for j in range(s):
                        side -= h * tables.to_end[i, j] * by_turn[p, q, j]
                    sides[p * s + i, q] = side
                    sides[p * s + i, 3 + q] = 1.0 if p == q else 0.0
                for j in range(s):
                    value = -by_bend[p, q, j] * tables.weights[j]
                    for i in range(s):
                        value += h * by_turn[p, q, i] * tables.weights[i] * tables.from_start[i, j]
                    to_moment[element, p, q * s + j] = h * value
        inverse[element] = np.linalg.inv(own_matrix)
        bends[element] = np.dot(inverse[element], sides)
        for column in range(6):
            for p in range(3):
                last, before = 0.0, 0.0
                for j in range(s):
                    last += tables.weights[j] * bends[element, p * s + j, column]
                for row in range(3 * s):
                    before -= to_moment[element, p, row] * bends[element, row, column]
                if column < 3:
                    for j in range(s):
                        before -= h * tables.weights[j] * by_turn[p, column, j]
                ends[element, p, column] = h * last + (1.0 if p == column else 0.0)
                ends[element, 3 + p, column] = before + (1.0 if 3 + p == column else 0.0)


def respond(
    tables: RodTables, rotation: FloatArray, inverse: FloatArray, bends: FloatArray,
    ends: FloatArray, to_moment: FloatArray, points_of: FloatArray, imbalance: FloatArray,
    change: FloatArray,
) -> int:  # fmt: skip
    """Fill in the ``change`` of twist (4, columns, points) under an ``imbalance`` likewise.

    Returns:
        The sign of the determinant that links the elements.
    """
    s, elements, columns = tables.weights.size, tables.step.size, imbalance.shape[1]
    own = np.empty((elements, 3 * s, columns))
    last, before = np.zeros((elements, 3, columns)), np.zeros((elements, 3, columns))
    carried = np.empty((3, s))
    sides = np.empty((3 * s, columns))
    for element in range(elements):
        first, h = element * s, tables.step[element]
        for c in range(columns):
            for j in range(s):
                at = first + j
                stretched = imbalance[3, c, at]
                for p in range(3):
                    side = -points_of[at, 6 + p] / points_of[at, 9] * stretched
                    for q in range(3):
                        side += rotation[p, q, at] * imbalance[q, c, at]
                    sides[p * s + j, c] = side
                    carried[p, j] = h * points_of[at, 3 + p] * stretched
            for p in range(3):
                for i in range(s):
                    total = 0.0
                    for j in range(s):
                        total += tables.to_end[i, j] * carried[p, j]
                    sides[p * s + i, c] -= total
                    before[element, p, c] -= tables.weights[i] * carried[p, i]
        own[element] = np.dot(inverse[element], sides)
        before[element] -= np.dot(to_moment[element], own[element])
        for c in range(columns):
            for p in range(3):
                for j in range(s):
                    last[element, p, c] += h * tables.weights[j] * own[element, p * s + j, c]
    # From the tip: d m = P Phi + p at the last end of each element.
    by_turn, rest = np.zeros((elements + 1, 3, 3)), np.zeros((elements + 1, 3, columns))
    on, known = np.empty((elements, 3, 3)), np.empty((elements, 3, columns))
    sign = 1
    for element in range(elements - 1, -1, -1):
        here, beyond = by_turn[element + 1], rest[element + 1]
        to_last = np.ascontiguousarray(ends[element, :3, 3:])
        system = np.eye(3) - np.dot(to_last, here)
        if np.linalg.det(system) < 0.0:
            sign = -sign
        on[element] = np.linalg.solve(system, np.ascontiguousarray(ends[element, :3, :3]))
        known[element] = np.linalg.solve(system, np.dot(to_last, beyond) + last[element])
        to_first = np.ascontiguousarray(ends[element, 3:, 3:])
        by_turn[element] = np.dot(to_first, np.dot(here, on[element])) + ends[element, 3:, :3]
        rest[element] = np.dot(to_first, np.dot(here, known[element]) + beyond) + before[element]
    turn = np.zeros((3, columns))
    both = np.empty((6, columns))
    for element in range(elements):
        first, h = element * s, tables.step[element]
        following = np.dot(on[element], turn) + known[element]
        both[:3] = turn
        both[3:] = np.dot(by_turn[element + 1], following) + rest[element + 1]
        k = own[element] + np.dot(bends[element], both)
        for c in range(columns):
            for i in range(s):
                at = first + i
                linear = imbalance[3, c, at]
                for p in range(3):
                    angle = turn[p, c]
                    for j in range(s):
                        angle += h * tables.from_start[i, j] * k[p * s + j, c]
                    linear += points_of[at, p] * angle - points_of[at, 6 + p] * k[p * s + i, c]
                change[3, c, at] = linear / points_of[at, 9]
                for p in range(3):
                    value = 0.0
                    for q in range(3):
                        value += rotation[q, p, at] * k[q * s + i, c]
                    change[p, c, at] = value
        turn = following
    return sign


def turn_of(tables: RodTables, change: FloatArray) -> float:
    """How far a ``change`` (4, 1, points) turns the arm [rad]."""
    points, total = tables.weights.size, 0.0
    for i in range(change.shape[2]):
        square = change[0, 0, i] ** 2 + change[1, 0, i] ** 2 + change[2, 0, i] ** 2
        total += tables.step[i // points] * tables.weights[i % points] * np.sqrt(square)
    return total


def tip_wrenches(tables: RodTables, twist: FloatArray, rotation: FloatArray) -> FloatArray:
    """What unit wrenches on the tip do to all sections, (4, 6, points); moments over a length."""
    points, count = tables.weights.size, twist.shape[1]
    wrench = np.zeros((4, 6, count))
    beyond, to_tip = np.zeros(3), np.empty(3)
    for element in range(tables.step.size - 1, -1, -1):
        first, h = element * points, tables.step[element]
        for i in range(points):
            at = first + i
            for k in range(3):
                to_tip[k] = beyond[k]
                for j in range(points):
                    place = first + j
                    to_tip[k] += h * tables.to_end[i, j] * rotation[k, 0, place] * twist[3, place]
            for column in range(3):
                n, m = (column + 1) % 3, (column + 2) % 3
                wrench[3, column, at] = rotation[column, 0, at]
                for k in range(3):
                    # The lever times the unit vector.
                    wrench[k, column, at] = (
                        rotation[n, k, at] * to_tip[m] - rotation[m, k, at] * to_tip[n]
                    )
                    wrench[k, 3 + column, at] = rotation[column, k, at] * tables.length
        for k in range(3):
            for j in range(points):
                place = first + j
                beyond[k] += h * tables.weights[j] * rotation[k, 0, place] * twist[3, place]
    return wrench


def newton(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    tolerance: float, twist: FloatArray, a: ComplexArray, b: ComplexArray, rotation: FloatArray,
    force: FloatArray, moment: FloatArray, imbalance: FloatArray, hessian: FloatArray,
    wrench: FloatArray, change: FloatArray,
) -> tuple[float, int, float, int]:  # fmt: skip
    """Newton's method from ``twist`` (4, points) with orientations (a, b), as `loaded.newton`.

    Fills in the state it ends in and, where that is balanced, the ``wrench`` of unit wrenches on
    the tip and the ``change`` (4, 6, points) that they make.

    Returns:
        Residual, number of iterations, how far all but the first have turned the arm [rad], and
        the sign of the determinant of the system; 0 where there is none.
    """
    s, elements, count = tables.weights.size, tables.step.size, twist.shape[1]
    matrix, inverse = np.empty((elements, 3 * s, 3 * s)), np.empty((elements, 3 * s, 3 * s))
    bends, ends = np.empty((elements, 3 * s, 6)), np.empty((elements, 6, 6))
    to_moment, points_of = np.empty((elements, 3, 3 * s)), np.empty((count, 10))
    side, step = np.empty((4, 1, count)), np.empty((4, 1, count))
    residual = find_state(
        tables, tensions, tip_wrench, factor, twist, a, b, rotation, force, moment, imbalance,
        hessian,
    )  # fmt: skip
    new, new_a, new_b = np.empty_like(twist), np.empty_like(a), np.empty_like(b)
    new_rotation, new_force = np.empty_like(rotation), np.empty_like(force)
    new_moment, new_imbalance = np.empty_like(moment), np.empty_like(imbalance)
    new_hessian = np.empty_like(hessian)
    strayed, iterations, is_near, has_system = 0.0, 0, False, False
    while residual > tolerance and iterations < MOST:
        if not (has_system and is_near):
            find_system(
                tables, twist, rotation, force, moment, hessian, matrix, inverse, bends, ends,
                to_moment, points_of,
            )  # fmt: skip
            has_system = True
        side[:, 0] = imbalance
        respond(tables, rotation, inverse, bends, ends, to_moment, points_of, side, step)
        iterations += 1
        new[:] = twist + step[:, 0]
        find_frames(tables, new, new_a, new_b)
        found = find_state(
            tables, tensions, tip_wrench, factor, new, new_a, new_b, new_rotation, new_force,
            new_moment, new_imbalance, new_hessian,
        )  # fmt: skip
        if not found <= (PROGRESS if iterations > 1 else UPHILL) * residual:
            return residual, iterations, strayed, 0
        is_near = found <= NEAR and found <= QUICK * residual
        residual = found
        twist[:], a[:], b[:] = new, new_a, new_b
        rotation[:], force[:], moment[:] = new_rotation, new_force, new_moment
        imbalance[:], hessian[:] = new_imbalance, new_hessian
        if iterations > 1:
            strayed += turn_of(tables, step)
    if not residual <= tolerance:
        return residual, iterations, strayed, 0
    if not has_system:
        find_system(
            tables, twist, rotation, force, moment, hessian, matrix, inverse, bends, ends,
            to_moment, points_of,
        )  # fmt: skip
    wrench[:] = tip_wrenches(tables, twist, rotation)
    sign = respond(tables, rotation, inverse, bends, ends, to_moment, points_of, wrench, change)
    for element in range(elements):
        if np.linalg.slogdet(matrix[element])[0] < 0.0:
            sign = -sign
    return residual, iterations, strayed, sign
