"""The balance of the cross sections of the model exact: what `numba_build` compiles.

As in `kernels`, formulas are those that NumPy evaluates, imported from their modules. Sections are
evaluated in blocks of up to `LANES`. All quantities of a block are rows of one flat array,
``rows``, `LANES` apart: the compiler then knows that they do not overlap, and evaluates several
sections with every instruction.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.section_tables import LANES, SectionTables
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.elastic_laws import (
    incompressible_widening,
    linear_density,
    neo_hookean_density,
)
from octo_arm_model.core.section.formulas import (
    bending_terms,
    condensed_terms,
    sheath_inverse,
    sheath_mixed,
    sheath_pull,
    tendon_direction,
    tendon_gradient,
    tendon_hessian,
    unscaled_gradient,
    unscaled_hessian,
)

# First elements of the rows of a block: scaled strain, gradient and Hessian (lower half, row by
# row), widening and its derivatives, scales of moments and forces, imbalance of tendons in their
# sheaths.
T, N, B, S = (k * LANES for k in range(4))
G_T, G_N, G_B, G_S = 4 * LANES, 5 * LANES, 6 * LANES, 7 * LANES
TT, NT, NN, BT, BN = 8 * LANES, 9 * LANES, 10 * LANES, 11 * LANES, 12 * LANES
BB, ST, SN, SB, SS = 13 * LANES, 14 * LANES, 15 * LANES, 16 * LANES, 17 * LANES
WIDTH, SLOPE, BEND = 18 * LANES, 19 * LANES, 20 * LANES
OF_MOMENT, OF_FORCE, ADRIFT = 21 * LANES, 22 * LANES, 23 * LANES
FREE = 24 * LANES  # rows from here on are those of the caller
OFFSETS_PLACED = 1e-9  # imbalance of a tendon in its sheath, relative: its square is rounding
MOST_PLACINGS = 30


def set_scales(
    tables: SectionTables, block: int, tensions: FloatArray, pulled: IntArray, rows: FloatArray
) -> None:
    """Fill in what imbalances of moments and forces are measured by, see `force_scale`."""
    first, count = tables.blocks[block]
    axial, lever = tables.axial[first : first + count], tables.lever_max[first : first + count]
    for i in range(count):
        rows[OF_FORCE + i] = 1e-4 * axial[i]
    for tendon in pulled:
        part, tension = tables.transmission[tendon, first:], tensions[tendon]
        for i in range(tables.acting[tendon, block]):
            rows[OF_FORCE + i] += part[i] * tension
    for i in range(count):
        rows[OF_MOMENT + i] = rows[OF_FORCE + i] * lever[i]


def set_material(tables: SectionTables, block: int, rows: FloatArray) -> None:
    """Fill in the widening, and gradient and Hessian of the elastic energy."""
    first, count = tables.blocks[block]
    axial, torsion = tables.axial[first : first + count], tables.torsion[first : first + count]
    squared = tables.squared[first : first + count]
    if tables.widens:
        for i in range(count):
            n, b, stretch = rows[N + i], rows[B + i], rows[S + i]
            f_s, f_z, f_ss, f_sz, f_zz = neo_hookean_density(stretch, (n * n + b * b) * squared[i])
            (
                rows[G_N + i], rows[G_B + i], rows[G_S + i],
                rows[NN + i], rows[BN + i], rows[BB + i],
                rows[SN + i], rows[SB + i], rows[SS + i],
            ) = bending_terms(n, b, f_s, f_z, f_ss, f_sz, f_zz, axial[i], squared[i])  # fmt: skip
            rows[WIDTH + i], rows[SLOPE + i], rows[BEND + i] = incompressible_widening(stretch)
    else:
        for i in range(count):
            n, b, stretch = rows[N + i], rows[B + i], rows[S + i]
            f_s, f_z, f_ss, f_sz, f_zz = linear_density(stretch, (n * n + b * b) * squared[i])
            (
                rows[G_N + i], rows[G_B + i], rows[G_S + i],
                rows[NN + i], rows[BN + i], rows[BB + i],
                rows[SN + i], rows[SB + i], rows[SS + i],
            ) = bending_terms(n, b, f_s, f_z, f_ss, f_sz, f_zz, axial[i], squared[i])  # fmt: skip
            rows[WIDTH + i], rows[SLOPE + i], rows[BEND + i] = 1.0, 0.0, 0.0
    for i in range(count):
        rows[G_T + i], rows[TT + i] = torsion[i] * rows[T + i], torsion[i]
        rows[NT + i], rows[BT + i], rows[ST + i], rows[ADRIFT + i] = 0.0, 0.0, 0.0, 0.0


def add_tendon(
    count: int, tension: float, part: FloatArray, path_x: FloatArray, path_y: FloatArray,
    slope_x: FloatArray, slope_y: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """Add gradient and Hessian of T |u| of a tendon in its place in ``count`` sections."""
    for i in range(count):
        t, n, b, slope = rows[T + i], rows[N + i], rows[B + i], rows[SLOPE + i]
        x, y, dx, dy = path_x[i], path_y[i], slope_x[i], slope_y[i]
        u_t, u_n, u_b, length = tendon_direction(
            t, n, b, rows[S + i], rows[WIDTH + i], x, y, dx, dy
        )
        over, local = 1.0 / length, tension * part[i]
        l_t, l_n, l_b, l_s = tendon_gradient(
            u_t * over, u_n * over, u_b * over, slope, x, y, dx, dy
        )
        h = tendon_hessian(l_t, l_n, l_b, l_s, u_n, u_b, slope, rows[BEND + i], x, y, dx, dy)
        add_terms(i, local, l_t, l_n, l_b, l_s, local * over, h, rows)


def add_terms(
    i: int, tension: float, l_t: float, l_n: float, l_b: float, l_s: float, weight: float,
    h: tuple[float, ...], rows: FloatArray,
) -> None:  # fmt: skip
    """Add gradient and Hessian of T |u| in section ``i``.

    From the ``tension``, the gradient of |u|, T / |u| and the Hessian of |u| times |u|.
    """
    rows[G_T + i] += tension * l_t
    rows[G_N + i] += tension * l_n
    rows[G_B + i] += tension * l_b
    rows[G_S + i] += tension * l_s
    rows[TT + i] += weight * h[0]
    rows[NT + i] += weight * h[1]
    rows[NN + i] += weight * h[2]
    rows[BT + i] += weight * h[3]
    rows[BN + i] += weight * h[4]
    rows[BB + i] += weight * h[5]
    rows[ST + i] += weight * h[6]
    rows[SN + i] += weight * h[7]
    rows[SB + i] += weight * h[8]
    rows[SS + i] += weight * h[9]


def place_tendon(
    count: int, tension: float, part: FloatArray, path_x: FloatArray, path_y: FloatArray,
    slope_x: FloatArray, slope_y: FloatArray, compliance: FloatArray, lever: FloatArray,
    rows: FloatArray, offset: FloatArray,
) -> float:  # fmt: skip
    """Newton's step for the ``offset`` (2 `LANES`,) of a tendon in its sheath, [m].

    Returns:
        How far the largest step is over the lever; NaN counts for nothing.
    """
    for i in range(count):
        t, n, b = rows[T + i], rows[N + i], rows[B + i]
        off_n, off_b, local = offset[i], offset[LANES + i], compliance[i] * tension * part[i]
        u_t, u_n, u_b, length = tendon_direction(
            t, n, b, rows[S + i], rows[WIDTH + i], path_x[i] + off_n, path_y[i] + off_b,
            slope_x[i], slope_y[i],
        )  # fmt: skip
        over = 1.0 / length
        p_n, p_b = sheath_pull(t, n, b, u_t * over, u_n * over, u_b * over)
        nn, nb, bb = sheath_inverse(t, n, b, p_n, p_b, local * over)
        left_n, left_b = off_n + local * p_n, off_b + local * p_b
        offset[i] = off_n - (nn * left_n + nb * left_b)
        offset[LANES + i] = off_b - (nb * left_n + bb * left_b)
        rows[FREE + i] = (abs(left_n) + abs(left_b)) / lever[i]
    worst = 0.0
    for i in range(count):
        worst = max(worst, rows[FREE + i])
    return worst


def add_sheathed_tendon(
    count: int, tension: float, part: FloatArray, path_x: FloatArray, path_y: FloatArray,
    slope_x: FloatArray, slope_y: FloatArray, compliance: FloatArray, lever: FloatArray,
    rows: FloatArray, offset: FloatArray,
) -> None:  # fmt: skip
    """As `add_tendon`, of a tendon that stands off its path by ``offset`` (2 `LANES`,) [m].

    What it follows the strain by is condensed as in `SheathedSections`, and so is what is left of
    its balance in the sheath, of which the square is then left in the gradient.
    """
    for i in range(count):
        t, n, b, slope = rows[T + i], rows[N + i], rows[B + i], rows[SLOPE + i]
        x, y = path_x[i] + offset[i], path_y[i] + offset[LANES + i]
        dx, dy, soft = slope_x[i], slope_y[i], compliance[i]
        u_t, u_n, u_b, length = tendon_direction(
            t, n, b, rows[S + i], rows[WIDTH + i], x, y, dx, dy
        )
        over, local = 1.0 / length, tension * part[i]
        e_t, e_n, e_b, weight = u_t * over, u_n * over, u_b * over, local * over
        l_t, l_n, l_b, l_s = tendon_gradient(e_t, e_n, e_b, slope, x, y, dx, dy)
        h = tendon_hessian(l_t, l_n, l_b, l_s, u_n, u_b, slope, rows[BEND + i], x, y, dx, dy)
        p_n, p_b = sheath_pull(t, n, b, e_t, e_n, e_b)
        nn, nb, bb = sheath_inverse(t, n, b, p_n, p_b, soft * weight)
        m_t, m_n, m_b, m_s, c_t, c_n, c_b, c_s = sheath_mixed(
            t, n, b, slope, x, y, dx, dy, e_t, e_n, e_b, p_n, p_b, l_t, l_n, l_b, l_s,
            local, weight,
        )  # fmt: skip
        left_n, left_b = offset[i] + soft * local * p_n, offset[LANES + i] + soft * local * p_b
        step_n, step_b = nn * left_n + nb * left_b, nb * left_n + bb * left_b
        lost = condensed_terms(
            soft * nn, soft * nb, soft * bb, m_t, m_n, m_b, m_s, c_t, c_n, c_b, c_s
        )
        add_terms(i, local, l_t, l_n, l_b, l_s, weight, h, rows)
        add_terms(
            i, -1.0, m_t * step_n + c_t * step_b, m_n * step_n + c_n * step_b,
            m_b * step_n + c_b * step_b, m_s * step_n + c_s * step_b, -1.0, lost, rows,
        )  # fmt: skip
        adrift = (abs(left_n) + abs(left_b)) / lever[i]
        rows[ADRIFT + i] = max(rows[ADRIFT + i], adrift)


def set_balance(
    tables: SectionTables, block: int, tensions: FloatArray, pulled: IntArray, rows: FloatArray,
    offsets: FloatArray, placings: int,
) -> None:  # fmt: skip
    """Fill in gradient and Hessian of the energy of the sections of a ``block``.

    ``pulled`` are the numbers of tendons under tension, ``offsets`` (pulled, 2 `LANES`) those of
    their places in sheaths, which take up to ``placings`` steps of Newton's method.
    """
    set_material(tables, block, rows)
    first, count = tables.blocks[block]
    last = first + count
    for number in range(pulled.size):
        tendon = pulled[number]
        acting, tension = tables.acting[tendon, block], tensions[tendon]
        part = tables.transmission[tendon, first:last]
        x, y = tables.x[tendon, first:last], tables.y[tendon, first:last]
        dx, dy = tables.dx[tendon, first:last], tables.dy[tendon, first:last]
        if not tables.sheath_compliance.size:
            add_tendon(acting, tension, part, x, y, dx, dy, rows)
            continue
        compliance = tables.sheath_compliance[tendon, first:last]
        lever, offset = tables.lever_max[first:last], offsets[number]
        for _ in range(placings):
            if not place_tendon(
                acting, tension, part, x, y, dx, dy, compliance, lever, rows, offset
            ) > OFFSETS_PLACED:  # fmt: skip
                break
        add_sheathed_tendon(acting, tension, part, x, y, dx, dy, compliance, lever, rows, offset)


def set_strain(
    widens: bool, t: FloatArray, n: FloatArray, b: FloatArray, s: FloatArray, rows: FloatArray
) -> None:
    """Fill in the scaled strain from the twist of the sections of a block."""
    for i in range(s.size):
        width = incompressible_widening(s[i])[0] if widens else 1.0
        rows[T + i], rows[N + i], rows[B + i] = width * t[i], width * n[i], width * b[i]
        rows[S + i] = s[i]


def evaluate_sections(
    tables: SectionTables, tensions: FloatArray, twist: FloatArray, gradient: FloatArray,
    hessian: FloatArray, scale: FloatArray,
) -> None:  # fmt: skip
    """Fill in how all sections answer a ``twist`` (4, sections), as `evaluate` does."""
    pulled = np.flatnonzero(tensions)
    rows, offsets = np.zeros(FREE + LANES), np.empty((pulled.size, 2 * LANES))
    for block in range(len(tables.blocks)):
        first, count = tables.blocks[block]
        last = first + count
        t, n, b = twist[0, first:last], twist[1, first:last], twist[2, first:last]
        set_strain(tables.widens, t, n, b, twist[3, first:last], rows)
        offsets[:] = 0.0
        set_scales(tables, block, tensions, pulled, rows)
        set_balance(tables, block, tensions, pulled, rows, offsets, MOST_PLACINGS)
        for i in range(count):
            if tables.planar and t[i] == 0.0:
                # Tendons cannot twist the arm, but for rounding.
                rows[G_T + i] = 0.0
        unscale(count, t, n, b, rows)
        for k in range(4):
            gradient[k, first:last] = rows[G_T + k * LANES : G_T + k * LANES + count]
            scale[k, first:last] = rows[OF_MOMENT : OF_MOMENT + count]
        scale[3, first:last] = rows[OF_FORCE : OF_FORCE + count]
        place = TT
        for k in range(4):
            for m in range(k + 1):
                hessian[k, m, first:last] = rows[place : place + count]
                hessian[m, k, first:last] = rows[place : place + count]
                place += LANES


def unscale(count: int, t: FloatArray, n: FloatArray, b: FloatArray, rows: FloatArray) -> None:
    """Turn gradient and Hessian by the scaled strain into those by the twist."""
    for i in range(count):
        width, slope, bend = rows[WIDTH + i], rows[SLOPE + i], rows[BEND + i]
        g_t, g_n, g_b = rows[G_T + i], rows[G_N + i], rows[G_B + i]
        rows[G_T + i], rows[G_N + i], rows[G_B + i], rows[G_S + i] = unscaled_gradient(
            t[i], n[i], b[i], width, slope, g_t, g_n, g_b, rows[G_S + i]
        )
        (
            rows[TT + i], rows[NT + i], rows[NN + i], rows[BT + i], rows[BN + i],
            rows[BB + i], rows[ST + i], rows[SN + i], rows[SB + i], rows[SS + i],
        ) = unscaled_hessian(
            t[i], n[i], b[i], width, slope, bend, g_t, g_n, g_b, rows[TT + i], rows[NT + i],
            rows[NN + i], rows[BT + i], rows[BN + i], rows[BB + i], rows[ST + i], rows[SN + i],
            rows[SB + i], rows[SS + i],
        )  # fmt: skip
