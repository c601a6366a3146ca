"""Kernels for the initial strain of the minimisation, as in `section.newton`."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.compiled.section.section_rows import (
    G_B,
    G_N,
    G_S,
    OFFSET_LEFT,
    B,
    N,
    S,
    T,
)
from octo_arm_model.core.compiled.section.section_tables import SectionTables
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.elastic_laws import linear_density, neo_hookean_density
from octo_arm_model.core.section.formulas import planar_start, planar_step
from octo_arm_model.core.section.sheaths.sheath import MOST_SOFTENED


@borrows
def set_start(
    tables: SectionTables, block: int, tensions: FloatArray, pulled: IntArray, rows: FloatArray
) -> None:
    """Fill in the scaled strain of `initial_strain`."""
    first, count = tables.blocks[block]
    last = first + count
    axial, squared = tables.axial[first:last], tables.squared[first:last]
    lever = tables.lever_max[first:last]
    for i in range(count):
        rows[G_N + i], rows[G_B + i], rows[G_S + i], rows[OFFSET_LEFT + i] = 0.0, 0.0, 0.0, 0.0
    for tendon in pulled:
        part, tension = tables.transmission[tendon, first:last], tensions[tendon]
        x, y = tables.x[tendon, first:last], tables.y[tendon, first:last]
        for i in range(tables.acting[tendon, block]):
            local = part[i] * tension
            rows[G_N + i] += y[i] * local
            rows[G_B + i] -= x[i] * local
            rows[G_S + i] += local
        if tables.sheath_compliance.size:
            compliance = tables.sheath_compliance[tendon, first:last]
            for i in range(tables.acting[tendon, block]):
                local = part[i] * tension
                rows[OFFSET_LEFT + i] += compliance[i] * local * local
    for i in range(count):
        over = 1.0 / axial[i]
        softening = min(0.5 * rows[OFFSET_LEFT + i] * over / squared[i], MOST_SOFTENED)
        n, b, force = rows[G_N + i], rows[G_B + i], rows[G_S + i] * over
        moment, radius = np.sqrt(n * n + b * b), np.sqrt(squared[i])
        load = moment * over / radius
        straight, stretch, bend = planar_start(load, force, softening)
        if tables.widens:
            f = neo_hookean_density(stretch, bend * bend)
        else:
            f = linear_density(stretch, bend * bend)
        stretch, bend = planar_step(
            stretch, bend, load, force, softening, f[0], f[1], f[2], f[3], f[4]
        )
        curvature = bend / radius
        # The straight state where the bent one is impossible or NaN.
        can_be = stretch > abs(curvature) * lever[i]
        towards = -curvature / max(moment, 1e-300) if can_be else 0.0
        rows[T + i], rows[N + i], rows[B + i] = 0.0, towards * n, towards * b
        rows[S + i] = stretch if can_be else straight


@borrows
def can_be(tables: SectionTables, block: int, rows: FloatArray) -> bool:
    """Whether all fibres and tendons of the sections of a ``block`` have positive length."""
    first, count = tables.blocks[block]
    lever, inside_out = tables.lever_max[first : first + count], 0
    for i in range(count):
        n, b = rows[N + i], rows[B + i]
        inside_out += not rows[S + i] > np.sqrt(n * n + b * b) * lever[i]
    return inside_out == 0
