"""Kernels for the equations of equilibrium of a loaded rod: counterpart of `Equilibrium`.

They compute the forces and moments of the loads on all cross sections and what these leave
unbalanced, from the twist and the orientations at the collocation points.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.loaded.orientation_kernels import find_rotation
from octo_arm_model.core.compiled.loaded.rod_state import RodState, RodWork
from octo_arm_model.core.compiled.loaded.rod_tables import ElementTables, RodTables
from octo_arm_model.core.compiled.numerics.products import multiply_rows
from octo_arm_model.core.compiled.numerics.references import borrows, inlined
from octo_arm_model.core.compiled.section.section_kernels import evaluate_blocks
from octo_arm_model.core.hints import FloatArray


@borrows
@inlined
def find_wrench(
    tables: ElementTables, state: RodState, force: FloatArray, moment: FloatArray, tip: FloatArray,
    wrench: FloatArray, work: FloatArray,
) -> None:  # fmt: skip
    """Fill in the ``wrench`` (4, points) of the loads in the axes of the cross sections.

    ``force`` and ``moment`` (3, points) are the resultants of the forces and free moments beyond
    each point, in base_frame. The moments of the forces about each point and the moment at the
    ``tip`` (3,) are added to ``moment``, in place. ``work`` is room for (6, points).
    """
    s, elements, rotation = tables.weights.size, tables.step.size, state.rotation
    carried, levers, stretch, lengths = work[:3], work[3:6], state.twist[3], tables.lengths
    for k in range(3):
        n, m = (k + 1) % 3, (k + 2) % 3
        out, t_n, t_m, f_n, f_m = carried[k], rotation[n, 0], rotation[m, 0], force[n], force[m]
        for i in range(stretch.size):
            out[i] = lengths[i] * stretch[i] * (t_n[i] * f_m[i] - t_m[i] * f_n[i])
    multiply_rows(carried, tables.to_end_columns, levers)
    by_element, lever = carried.reshape(3, elements, s), levers.reshape(3, elements, s)
    totals = moment.reshape(3, elements, s)
    for k in range(3):
        beyond = tip[k]
        for element in range(elements - 1, -1, -1):
            here = 0.0
            for j in range(s):
                totals[k, element, j] += lever[k, element, j] + beyond
                here += tables.weights[j] * by_element[k, element, j]
            beyond += here
    into_axes(rotation, force, moment, wrench)


@borrows
def find_wrench_of_tip_force(
    tables: ElementTables, state: RodState, axis: int, wrench: FloatArray, work: FloatArray
) -> None:
    """`find_wrench` of a unit force on the tip along an ``axis`` of base_frame alone.

    ``work`` is room for (13, points), of which there are at least three.
    """
    force, moment, none = work[6:9], work[9:12], work[12]
    force[:] = 0.0
    moment[:] = 0.0
    none[:] = 0.0
    force[axis] = 1.0
    find_wrench(tables, state, force, moment, none, wrench, work)


@borrows
def into_axes(
    rotation: FloatArray, force: FloatArray, moment: FloatArray, wrench: FloatArray
) -> None:
    """Fill in the ``wrench`` (4, n) in the axes of cross sections from vectors in base_frame.

    Rows 0 to 2 are the components of ``moment`` (3, n), row 3 is that of ``force`` (3, n) along
    the tangent; ``rotation`` (3, 3, n) are the orientations.
    """
    for k in range(4):
        # The moment about each of the three axes, then the force along the tangent.
        axis, vector, row = k % 3, moment if k < 3 else force, wrench[k]
        a, b, c = rotation[0, axis], rotation[1, axis], rotation[2, axis]
        v_0, v_1, v_2 = vector[0], vector[1], vector[2]
        for i in range(row.size):
            row[i] = a[i] * v_0[i] + b[i] * v_1[i] + c[i] * v_2[i]


@borrows
def find_state(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, factor: float,
    state: RodState, work: RodWork,
) -> float:  # fmt: skip
    """Fill in all fields of ``state`` that follow from its twist and orientations.

    The compiled counterpart of `Equilibrium.state`: it evaluates the cross sections under
    ``tensions`` (tendons,), the wrench of the loads and the imbalance. ``tip_wrench`` (6,) is the
    force and the moment on the tip in base_frame; ``factor`` multiplies the dead loads.

    Returns:
        The residual: the largest imbalance relative to the sizes of its terms.
    """
    count, imbalance = state.twist.shape[1], state.imbalance
    find_rotation(state.turn, state.rotation)
    gradient, scale, rows = work.rows[:4], work.rows[4:8], work.rows[8:]
    evaluate_blocks(
        tables.sections, tensions, state.twist, gradient, state.hessian, scale, work.sections
    )
    for k in range(3):
        force, moment, on_tip = state.force[k], state.moment[k], tip_wrench[k]
        dead_force, dead_moment = tables.force[k], tables.moment[k]
        for i in range(count):
            force[i] = factor * dead_force[i] + on_tip
        for i in range(count):
            moment[i] = factor * dead_moment[i]
    find_wrench(tables.elements, state, state.force, state.moment, tip_wrench[3:], imbalance, rows)
    outside = largest_in_rows(imbalance)
    for k in range(4):
        left, inside, of, beyond = imbalance[k], gradient[k], scale[k], outside[k]
        for i in range(count):
            left[i] -= inside[i]
            of[i] = left[i] / (of[i] + beyond)
    residuals = largest_in_rows(scale)
    return max(max(residuals[0], residuals[1]), max(residuals[2], residuals[3]))


@borrows
def largest_in_rows(rows: FloatArray) -> tuple[float, float, float, float]:
    """The largest magnitude in each row of ``rows`` (4, n); NaN where one is NaN or infinite."""
    # All rows in one loop, since comparisons of one row wait for each other.
    a, b, c, d = rows[0], rows[1], rows[2], rows[3]
    e, f, g, h = 0.0, 0.0, 0.0, 0.0
    p, q, r, s = 0.0, 0.0, 0.0, 0.0
    for i in range(a.size):
        e, f, g, h = max(e, abs(a[i])), max(f, abs(b[i])), max(g, abs(c[i])), max(h, abs(d[i]))
        p, q, r, s = p + a[i], q + b[i], r + c[i], s + d[i]
    if np.isfinite((p + q) + (r + s)):
        return e, f, g, h
    return np.nan, np.nan, np.nan, np.nan
