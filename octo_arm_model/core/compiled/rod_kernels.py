"""Newton's method for a loaded rod: what `numba_build` compiles.

As `loaded.newton`, with cross sections as in `section_kernels` and the linearised equilibrium of
`system_kernels`.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.section_kernels import evaluate_sections
from octo_arm_model.core.compiled.system_kernels import find_system, respond, tip_wrenches
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


def turn_of(tables: RodTables, change: FloatArray) -> float:
    """How far a ``change`` (4, 1, points) turns the arm [rad]."""
    points, total = tables.weights.size, 0.0
    for i in range(change.shape[2]):
        square = change[0, 0, i] ** 2 + change[1, 0, i] ** 2 + change[2, 0, i] ** 2
        total += tables.step[i // points] * tables.weights[i % points] * np.sqrt(square)
    return total


def newton(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    tolerance: float, twist: FloatArray, a: ComplexArray, b: ComplexArray, rotation: FloatArray,
    force: FloatArray, moment: FloatArray, imbalance: FloatArray, hessian: FloatArray,
    compliance: FloatArray, change: FloatArray,
) -> tuple[float, int, float, int]:  # fmt: skip
    """Newton's method from ``twist`` (4, points) with orientations (a, b), as `loaded.newton`.

    Fills in the state it ends in and, where that is balanced, the ``compliance`` (6, 6) of the
    tip and the ``change`` (4, 6, points) that unit wrenches on it make, see `TipAnswer`.

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
    wrench = tip_wrenches(tables, twist, rotation)
    sign = respond(tables, rotation, inverse, bends, ends, to_moment, points_of, wrench, change)
    compliance[:] = 0.0
    for i in range(count):
        weight = tables.step[i // s] * tables.weights[i % s]
        for row in range(6):
            for column in range(6):
                for k in range(4):
                    compliance[row, column] += weight * wrench[k, row, i] * change[k, column, i]
    for element in range(elements):
        if np.linalg.slogdet(matrix[element])[0] < 0.0:
            sign = -sign
    return residual, iterations, strayed, sign
