"""Kernels that minimise the energy of cross sections, as in `section.newton`."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.compiled.section.section_kernels import set_balance, set_scales
from octo_arm_model.core.compiled.section.section_rows import (
    BB,
    BN,
    BT,
    FREE,
    G_B,
    G_N,
    G_S,
    G_T,
    NN,
    NT,
    OF_FORCE,
    OF_MOMENT,
    OFFSET_LEFT,
    SB,
    SN,
    SS,
    ST,
    TT,
    WIDTH,
    B,
    N,
    S,
    T,
    set_strain,
)
from octo_arm_model.core.compiled.section.section_tables import LANES, SectionTables
from octo_arm_model.core.compiled.section.sheath_kernels import OFFSET_TOLERANCE, are_inside
from octo_arm_model.core.compiled.section.start_kernels import can_be, set_start
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.elastic_laws import incompressible_widening
from octo_arm_model.core.section.newton import OVERSHOOT, ROUNDING, TOLERANCE
from octo_arm_model.core.section.strain_measures import SHORTEST_FIBRE

MOST_STEPS = 60  # of Newton's method; where these are not enough NumPy solves
# Rows: last step, next step, minus the derivative of the energy along the last step at its start,
# relative residual, and least pivot of the Hessian.
STEP_T, STEP_N, STEP_B, STEP_S = (FREE + k * LANES for k in range(4))
NEXT_T, NEXT_N, NEXT_B, NEXT_S = (FREE + (4 + k) * LANES for k in range(4))
DESCENT, LEFT, PIVOT = FREE + 8 * LANES, FREE + 9 * LANES, FREE + 10 * LANES
ROWS = FREE + 11 * LANES


@borrows
def set_next(count: int, rows: FloatArray) -> None:
    """Fill in the next Newton step by L D L^T, the least pivot and the relative residual."""
    for i in range(count):
        g_t, g_n, g_b, g_s = rows[G_T + i], rows[G_N + i], rows[G_B + i], rows[G_S + i]
        moment = max(abs(g_t), max(abs(g_n), abs(g_b))) / rows[OF_MOMENT + i]
        # NaN where any of them is.
        rows[LEFT + i] = (
            max(moment, abs(g_s) / rows[OF_FORCE + i]) + 0.0 * (g_t + g_n) + 0.0 * (g_b + g_s)
        )
        tt, nt, nn, bt, bn = rows[TT + i], rows[NT + i], rows[NN + i], rows[BT + i], rows[BN + i]
        bb, st, sn, sb, ss = rows[BB + i], rows[ST + i], rows[SN + i], rows[SB + i], rows[SS + i]
        over = 1.0 / tt
        f_n, f_b, f_s = nt * over, bt * over, st * over
        nn, bn, sn, g_n = nn - f_n * nt, bn - f_n * bt, sn - f_n * st, g_n - f_n * g_t
        bb, sb, g_b = bb - f_b * bt, sb - f_b * st, g_b - f_b * g_t
        ss, g_s = ss - f_s * st, g_s - f_s * g_t
        over = 1.0 / nn
        h_b, h_s = bn * over, sn * over
        bb, sb, g_b = bb - h_b * bn, sb - h_b * sn, g_b - h_b * g_n
        ss, g_s = ss - h_s * sn, g_s - h_s * g_n
        k_s = sb / bb
        ss, g_s = ss - k_s * sb, g_s - k_s * g_b
        s = -g_s / ss
        b = -g_b / bb - k_s * s
        n = -g_n / nn - h_b * b - h_s * s
        rows[NEXT_S + i], rows[NEXT_B + i], rows[NEXT_N + i] = s, b, n
        rows[NEXT_T + i] = -g_t / tt - f_n * n - f_b * b - f_s * s
        rows[PIVOT + i] = min(min(tt, nn), min(bb, ss))


@borrows
def find_next(
    tables: SectionTables, block: int, tensions: FloatArray, pulled: IntArray, rows: FloatArray,
    offsets: FloatArray,
) -> None:  # fmt: skip
    """Evaluate gradient and Hessian of a ``block``, then `set_next`."""
    set_balance(tables, block, tensions, pulled, rows, offsets, 1)
    count = tables.blocks[block, 1]
    if tables.planar:
        # Exactly zero: tendons have no moment about t but rounding.
        for i in range(count):
            rows[G_T + i], rows[NT + i], rows[BT + i], rows[ST + i] = 0.0, 0.0, 0.0, 0.0
    set_next(count, rows)


@borrows
def take_step(count: int, rows: FloatArray) -> None:
    """Take the next step, or take back half of the last one where that was too long."""
    for i in range(count):
        g_t, g_n, g_b, g_s = rows[G_T + i], rows[G_N + i], rows[G_B + i], rows[G_S + i]
        slope = rows[DESCENT + i]
        work = (
            g_t * rows[STEP_T + i] + g_n * rows[STEP_N + i]
            + g_b * rows[STEP_B + i] + g_s * rows[STEP_S + i]
        )  # fmt: skip
        is_accepted = work <= OVERSHOOT * slope or rows[LEFT + i] <= ROUNDING
        t = rows[NEXT_T + i] if is_accepted else -0.5 * rows[STEP_T + i]
        n = rows[NEXT_N + i] if is_accepted else -0.5 * rows[STEP_N + i]
        b = rows[NEXT_B + i] if is_accepted else -0.5 * rows[STEP_B + i]
        s = rows[NEXT_S + i] if is_accepted else -0.5 * rows[STEP_S + i]
        sign = 1.0 if is_accepted else -1.0
        newton = -(g_t * t + g_n * n + g_b * b + g_s * s)
        rows[DESCENT + i] = newton if is_accepted else 0.5 * slope
        rows[T + i], rows[N + i] = rows[T + i] + t, rows[N + i] + n
        rows[B + i], rows[S + i] = rows[B + i] + b, rows[S + i] + s
        rows[STEP_T + i], rows[STEP_N + i] = sign * t, sign * n
        rows[STEP_B + i], rows[STEP_S + i] = sign * b, sign * s


@borrows
def minimise_block(
    tables: SectionTables, block: int, tensions: FloatArray, pulled: IntArray, rows: FloatArray,
    offsets: FloatArray,
) -> tuple[float, int]:  # fmt: skip
    """Move the strain of the sections of a ``block`` to least energy.

    Returns:
        Relative residual and number of steps; -1 where it does not converge.
    """
    count = tables.blocks[block, 1]
    for i in range(count):
        rows[STEP_T + i], rows[STEP_N + i], rows[STEP_B + i], rows[STEP_S + i] = 0.0, 0.0, 0.0, 0.0
        rows[DESCENT + i] = 0.0
    for steps in range(MOST_STEPS):
        find_next(tables, block, tensions, pulled, rows, offsets)
        unconverged = 0
        for i in range(count):
            unconverged += not (
                rows[LEFT + i] <= TOLERANCE and rows[OFFSET_LEFT + i] <= OFFSET_TOLERANCE
            )
        if not unconverged:
            worst = 0.0
            for i in range(count):
                worst = max(worst, rows[LEFT + i])
            # One more step with this Hessian: the error is then of the order of rounding.
            for i in range(4 * LANES):
                rows[T + i] += rows[NEXT_T + i]
            return worst, steps
        take_step(count, rows)
    return np.inf, -1


@borrows
def is_least(count: int, rows: FloatArray) -> bool:
    """Whether the equilibria of a block are minima of the energy, as `check_stable` requires."""
    for i in range(count):
        if not rows[PIVOT + i] > 0.0:
            return False
    return True


def find_minima(
    tables: SectionTables, tensions: FloatArray, twist: FloatArray
) -> tuple[float, int]:
    """Fill in ``twist`` (4, sections) of least energy.

    Returns:
        Largest relative residual and number of steps of a block; -1 where one does not converge or
        a fibre is shorter than `SHORTEST_FIBRE`.
    """
    return find_some_minima(tables, 0, len(tables.blocks), tensions, twist, False)


def find_some_minima(
    tables: SectionTables, start: int, stop: int, tensions: FloatArray, twist: FloatArray,
    is_near: bool,
) -> tuple[float, int]:  # fmt: skip
    """`find_minima` in the blocks from ``start`` to before ``stop``.

    If ``is_near``, ``twist`` is given as the start.
    """
    pulled, has_sheaths = np.flatnonzero(tensions), tables.sheath_compliance.size > 0
    residual, steps = 0.0, 0
    rows, offsets = np.zeros(ROWS), np.empty((pulled.size, 2 * LANES))
    for block in range(start, stop):
        first, count = tables.blocks[block]
        last = first + count
        found = twist[:, first:last]
        offsets[:] = 0.0
        set_scales(tables, block, tensions, pulled, rows)
        if is_near:
            set_strain(tables.widens, found[0], found[1], found[2], found[3], rows)
        if not (is_near and can_be(tables, block, rows)):
            set_start(tables, block, tensions, pulled, rows)
        left, taken = minimise_block(tables, block, tensions, pulled, rows, offsets)
        if taken < 0:
            return left, -1
        if has_sheaths and not (
            is_least(count, rows) and are_inside(tables, block, pulled, offsets)
        ):
            return np.inf, -1
        residual, steps = max(residual, left), max(steps, taken)
        if not set_twist(tables, block, rows, found):
            return np.inf, -1
    return residual, steps


def set_twist(tables: SectionTables, block: int, rows: FloatArray, twist: FloatArray) -> bool:
    """Fill in the ``twist`` (4, sections) of a ``block``.

    Returns:
        Whether no fibre is shorter than `SHORTEST_FIBRE`.
    """
    first, count = tables.blocks[block]
    squared, crushed = tables.squared[first : first + count], 0
    if tables.widens:
        for i in range(count):
            n, b = rows[N + i], rows[B + i]
            crushed += not rows[S + i] - np.sqrt((n * n + b * b) * squared[i]) > SHORTEST_FIBRE
            rows[WIDTH + i] = incompressible_widening(rows[S + i])[0]
    for k in range(3):
        for i in range(count):
            twist[k, i] = rows[k * LANES + i] / rows[WIDTH + i]
    twist[3] = rows[S : S + count]
    return crushed == 0
