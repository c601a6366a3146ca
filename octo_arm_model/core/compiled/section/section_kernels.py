"""Kernels for gradient and Hessian of the energy of cross sections of the model exact.

As in `paper_kernels`, the formulas are imported from the modules in which NumPy evaluates them.
Sections are evaluated in blocks of up to `LANES`, see `section_rows`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.numerics.references import borrows, inlined
from octo_arm_model.core.compiled.section.section_rows import (
    BB,
    BEND,
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
    SLOPE,
    SN,
    SS,
    ST,
    TT,
    WIDTH,
    B,
    N,
    S,
    T,
    add_terms,
    set_strain,
)
from octo_arm_model.core.compiled.section.section_tables import LANES, SectionTables
from octo_arm_model.core.compiled.section.sheath_kernels import (
    MOST_OFFSET_STEPS,
    OFFSET_TOLERANCE,
    add_sheathed_tendon,
    step_offset,
)
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.elastic_laws import (
    incompressible_widening,
    linear_density,
    neo_hookean_density,
)
from octo_arm_model.core.section.formulas import (
    bending_terms,
    tendon_direction,
    tendon_gradient,
    tendon_hessian,
    unscaled_gradient,
    unscaled_hessian,
)


class SectionWork(NamedTuple):
    """Room for the evaluation of cross sections.

    Attributes:
        pulled: indices of the tendons under tension.
        rows: of a block of sections, see `section_rows`.
        offsets: of the tendons under tension in their sheaths [m], (pulled, 2 `LANES`).
    """

    pulled: IntArray
    rows: FloatArray
    offsets: FloatArray


def section_work(tensions: FloatArray) -> SectionWork:
    """Allocate `SectionWork` for ``tensions`` (tendons,)."""
    pulled = np.flatnonzero(tensions)
    return SectionWork(pulled, np.zeros(FREE + LANES), np.empty((pulled.size, 2 * LANES)))


@borrows
def set_scales(
    tables: SectionTables, block: int, tensions: FloatArray, pulled: IntArray, rows: FloatArray
) -> None:
    """Fill in the scales of residual moments and forces, see `force_scale`."""
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


@borrows
def set_material(tables: SectionTables, block: int, rows: FloatArray) -> None:
    """Fill in the widening, and gradient and Hessian of the elastic energy."""
    first, count = tables.blocks[block]
    axial, torsion = tables.axial[first : first + count], tables.torsion[first : first + count]
    squared = tables.squared[first : first + count]
    for i in range(count):
        n, b, stretch = rows[N + i], rows[B + i], rows[S + i]
        bend = (n * n + b * b) * squared[i]
        if tables.widens:
            density = neo_hookean_density(stretch, bend)
            rows[WIDTH + i], rows[SLOPE + i], rows[BEND + i] = incompressible_widening(stretch)
        else:
            density = linear_density(stretch, bend)
            rows[WIDTH + i], rows[SLOPE + i], rows[BEND + i] = 1.0, 0.0, 0.0
        (
            rows[G_N + i], rows[G_B + i], rows[G_S + i],
            rows[NN + i], rows[BN + i], rows[BB + i],
            rows[SN + i], rows[SB + i], rows[SS + i],
        ) = bending_terms(n, b, *density, axial[i], squared[i])  # fmt: skip
    for i in range(count):
        rows[G_T + i], rows[TT + i] = torsion[i] * rows[T + i], torsion[i]
        rows[NT + i], rows[BT + i], rows[ST + i], rows[OFFSET_LEFT + i] = 0.0, 0.0, 0.0, 0.0


@borrows
def add_tendon(
    count: int, tension: float, part: FloatArray, path_x: FloatArray, path_y: FloatArray,
    slope_x: FloatArray, slope_y: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """Add gradient and Hessian of T |u| of a tendon on its path, in ``count`` sections."""
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


@borrows
def set_balance(
    tables: SectionTables, block: int, tensions: FloatArray, pulled: IntArray, rows: FloatArray,
    offsets: FloatArray, offset_steps: int,
) -> None:  # fmt: skip
    """Fill in gradient and Hessian of the energy of the sections of a ``block``.

    ``pulled`` are the indices of the tendons under tension. Their ``offsets`` (pulled, 2 `LANES`)
    [m] in sheaths are updated by up to ``offset_steps`` Newton steps.
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
        for _ in range(offset_steps):
            if not step_offset(
                acting, tension, part, x, y, dx, dy, compliance, lever, rows, offset
            ) > OFFSET_TOLERANCE:  # fmt: skip
                break
        add_sheathed_tendon(acting, tension, part, x, y, dx, dy, compliance, lever, rows, offset)


def evaluate_sections(
    tables: SectionTables, tensions: FloatArray, twist: FloatArray, gradient: FloatArray,
    hessian: FloatArray, scale: FloatArray,
) -> None:  # fmt: skip
    """`Evaluate`: gradient, Hessian and scale of all sections at ``twist`` (4, sections)."""
    evaluate_blocks(tables, tensions, twist, gradient, hessian, scale, section_work(tensions))


@borrows
@inlined
def evaluate_blocks(
    tables: SectionTables, tensions: FloatArray, twist: FloatArray, gradient: FloatArray,
    hessian: FloatArray, scale: FloatArray, work: SectionWork,
) -> None:  # fmt: skip
    """`evaluate_sections`, one block after another, in the room of ``work``."""
    pulled, rows, offsets = work.pulled, work.rows, work.offsets
    for block in range(len(tables.blocks)):
        first, count = tables.blocks[block]
        last = first + count
        t, n, b = twist[0, first:last], twist[1, first:last], twist[2, first:last]
        set_strain(tables.widens, t, n, b, twist[3, first:last], rows)
        offsets[:] = 0.0
        set_scales(tables, block, tensions, pulled, rows)
        set_balance(tables, block, tensions, pulled, rows, offsets, MOST_OFFSET_STEPS)
        for i in range(count):
            if tables.planar and t[i] == 0.0:
                # Exactly zero: tendons have no moment about t but rounding.
                rows[G_T + i] = 0.0
        unscale(count, t, n, b, rows)
        place = TT
        for k in range(4):
            out, of = gradient[k, first:last], scale[k, first:last]
            its, size = G_T + k * LANES, OF_FORCE if k == 3 else OF_MOMENT
            for i in range(count):
                out[i], of[i] = rows[its + i], rows[size + i]
            for m in range(k + 1):
                lower, upper = hessian[k, m, first:last], hessian[m, k, first:last]
                for i in range(count):
                    lower[i] = upper[i] = rows[place + i]
                place += LANES


@borrows
def unscale(count: int, t: FloatArray, n: FloatArray, b: FloatArray, rows: FloatArray) -> None:
    """Convert gradient and Hessian by the scaled strain to those by the twist."""
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
