"""The balance of a loaded rod: what `numba_build` compiles, as `Equilibrium` has it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.loaded.orientation_kernels import find_rotation
from octo_arm_model.core.compiled.loaded.rod_tables import ElementTables, RodTables
from octo_arm_model.core.compiled.section.section_kernels import evaluate_sections
from octo_arm_model.core.hints import FloatArray


class RodState(NamedTuple):
    """A loaded rod as `State` has it.

    Attributes:
        twist: (4, points).
        turn: orientation w, x, y, z of the points, (4, points).
        rotation: the same as matrices, (3, 3, points).
        force: of what lies beyond, in base_frame, (3, points) [N].
        moment: likewise [N m].
        imbalance: in the axes of the cross sections, (4, points).
        hessian: of the energy by the twist, (4, 4, points).
    """

    twist: FloatArray
    turn: FloatArray
    rotation: FloatArray
    force: FloatArray
    moment: FloatArray
    imbalance: FloatArray
    hessian: FloatArray


def empty_state(count: int) -> RodState:
    """Room for a state of ``count`` points."""
    return RodState(
        np.empty((4, count)), np.empty((4, count)), np.empty((3, 3, count)),
        np.empty((3, count)), np.empty((3, count)), np.empty((4, count)),
        np.empty((4, 4, count)),
    )  # fmt: skip


def copy_state(state: RodState, out: RodState) -> None:
    """Copy ``state`` to ``out``."""
    out.twist[:], out.turn[:], out.rotation[:] = state.twist, state.turn, state.rotation
    out.force[:], out.moment[:] = state.force, state.moment
    out.imbalance[:], out.hessian[:] = state.imbalance, state.hessian


def find_wrench(
    tables: ElementTables, state: RodState, force: FloatArray, moment: FloatArray, tip: FloatArray,
    wrench: FloatArray,
) -> None:  # fmt: skip
    """Fill in the ``wrench`` (4, points) in the axes of the cross sections.

    From the ``force`` beyond them and the ``moment`` (3, points) without its levers, which are
    added to it together with the moment at the ``tip`` (3,).
    """
    s, elements, rotation = tables.weights.size, tables.step.size, state.rotation
    carried, levers, stretch = np.empty(force.shape), np.empty(force.shape), state.twist[3]
    lengths = tables.lengths
    for k in range(3):
        n, m = (k + 1) % 3, (k + 2) % 3
        out, t_n, t_m, f_n, f_m = carried[k], rotation[n, 0], rotation[m, 0], force[n], force[m]
        for i in range(stretch.size):
            out[i] = lengths[i] * stretch[i] * (t_n[i] * f_m[i] - t_m[i] * f_n[i])
    by_element, each = carried.reshape(3, elements, s), (3 * elements, s)
    np.dot(carried.reshape(each), tables.to_end_columns, levers.reshape(each))
    totals, lever = moment.reshape(3, elements, s), levers.reshape(3, elements, s)
    for k in range(3):
        beyond = tip[k]
        for element in range(elements - 1, -1, -1):
            here = 0.0
            for j in range(s):
                totals[k, element, j] += lever[k, element, j] + beyond
                here += tables.weights[j] * by_element[k, element, j]
            beyond += here
    into_axes(rotation, force, moment, wrench)


def into_axes(
    rotation: FloatArray, force: FloatArray, moment: FloatArray, wrench: FloatArray
) -> None:
    """Fill in the ``wrench`` (4, n) on cross sections of orientations ``rotation`` (3, 3, n)."""
    for k in range(4):
        # The moment about each axis, and the force along the tangent.
        axis, vector, row = k % 3, moment if k < 3 else force, wrench[k]
        a, b, c = rotation[0, axis], rotation[1, axis], rotation[2, axis]
        v_0, v_1, v_2 = vector[0], vector[1], vector[2]
        for i in range(row.size):
            row[i] = a[i] * v_0[i] + b[i] * v_1[i] + c[i] * v_2[i]


def find_state(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float, state: RodState
) -> float:
    """Fill in what follows from twist and orientations as `Equilibrium.state` does.

    Returns:
        The residual.
    """
    count, imbalance = state.twist.shape[1], state.imbalance
    find_rotation(state.turn, state.rotation)
    scale, gradient = np.empty((4, count)), np.empty((4, count))
    evaluate_sections(tables.sections, tensions, state.twist, gradient, state.hessian, scale)
    for k in range(3):
        force, moment, on_tip = state.force[k], state.moment[k], tip_wrench[k]
        dead_force, dead_moment = tables.force[k], tables.moment[k]
        for i in range(count):
            force[i] = factor * dead_force[i] + on_tip
        for i in range(count):
            moment[i] = factor * dead_moment[i]
    find_wrench(tables.elements, state, state.force, state.moment, tip_wrench[3:], imbalance)
    outside = largest_in_rows(imbalance)
    for k in range(4):
        left, inside, of, beyond = imbalance[k], gradient[k], scale[k], outside[k]
        for i in range(count):
            left[i] -= inside[i]
            of[i] = left[i] / (of[i] + beyond)
    residuals = largest_in_rows(scale)
    return max(max(residuals[0], residuals[1]), max(residuals[2], residuals[3]))


def largest_in_rows(rows: FloatArray) -> tuple[float, float, float, float]:
    """The largest magnitude in each row of ``rows`` (4, n); NaN where one is NaN or infinite."""
    # Rows side by side, since each comparison waits for the one before.
    a, b, c, d = rows[0], rows[1], rows[2], rows[3]
    e, f, g, h = 0.0, 0.0, 0.0, 0.0
    p, q, r, s = 0.0, 0.0, 0.0, 0.0
    for i in range(a.size):
        e, f, g, h = max(e, abs(a[i])), max(f, abs(b[i])), max(g, abs(c[i])), max(h, abs(d[i]))
        p, q, r, s = p + a[i], q + b[i], r + c[i], s + d[i]
    if np.isfinite((p + q) + (r + s)):
        return e, f, g, h
    return np.nan, np.nan, np.nan, np.nan
