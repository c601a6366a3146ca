"""Kernels for the wrenches that parameters leave unbalanced, at fixed twist: see `Imbalance`.

Sections are evaluated in blocks of up to `LANES`, see `section_rows`.
"""

from __future__ import annotations

from octo_arm_model.core.compiled.loaded.rod_tables import ParameterTables
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.compiled.section.section_kernels import set_material
from octo_arm_model.core.compiled.section.section_rows import (
    FREE,
    G_B,
    G_N,
    G_S,
    G_T,
    SLOPE,
    WIDTH,
    B,
    N,
    S,
    T,
    set_strain,
)
from octo_arm_model.core.compiled.section.section_tables import LANES, SectionTables
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.formulas import (
    offset_direction,
    offset_gradient,
    tendon_direction,
    tendon_gradient,
    unit_change,
    unscaled_gradient,
)

# Rows of the angular twist, of a gradient by the twist, and of one more value.
_TWIST, _GRADIENT, _ALONG = FREE, FREE + 3 * LANES, FREE + 7 * LANES
IMBALANCE_ROWS = FREE + 8 * LANES


@borrows
def find_imbalance(
    sections: SectionTables, parameters: ParameterTables, weights: FloatArray,
    tensions: FloatArray, twist: FloatArray, rows: FloatArray, stretch: FloatArray,
    left: FloatArray, own: FloatArray,
) -> None:  # fmt: skip
    """Fill in ``left`` (columns, 4, points), the imbalance per unit of each parameter.

    It is the negative derivative of the section wrench by the parameter at the given ``twist`` (4,
    points). The parameters are the tensions, Young's modulus E (relative), Poisson's ratio nu and,
    if ``left`` has so many columns, the offsets of the tendons. Also fills in ``stretch``
    (tendons, 4, points), the gradient by the twist of each tendon's stretch, and, with offsets,
    ``own`` (tendons,), the derivative of each tendon's length by its own offset at constant twist.
    ``weights`` (points,) are those of the integral along the arm and ``rows`` is room for
    `IMBALANCE_ROWS`.
    """
    tendons = tensions.size
    has_offsets = len(left) > tendons + 2
    own[:] = 0.0
    for block in range(len(sections.blocks)):
        first, count = sections.blocks[block]
        last = first + count
        t, n, b = twist[0, first:last], twist[1, first:last], twist[2, first:last]
        set_strain(sections.widens, t, n, b, twist[3, first:last], rows)
        for i in range(count):
            rows[_TWIST + i] = t[i]
            rows[_TWIST + LANES + i], rows[_TWIST + 2 * LANES + i] = n[i], b[i]
        set_material(sections, block, rows)
        unscale(count, rows)
        take(first, count, rows, left[tendons])
        by_poisson = parameters.torsion_by_poisson[first:last]
        for i in range(count):
            rows[G_T + i] = by_poisson[i] * rows[T + i]
            rows[G_N + i], rows[G_B + i], rows[G_S + i] = 0.0, 0.0, 0.0
        unscale(count, rows)
        take(first, count, rows, left[tendons + 1])
        for tendon in range(tendons):
            acting = sections.acting[tendon, block]
            part = sections.transmission[tendon, first:last]
            x, y = sections.x[tendon, first:last], sections.y[tendon, first:last]
            dx, dy = sections.dx[tendon, first:last], sections.dy[tendon, first:last]
            set_stretch(acting, x, y, dx, dy, rows)
            unscale(acting, rows)
            for k in range(4):
                given, out = _GRADIENT + k * LANES, stretch[tendon, k, first:last]
                # A tendon that ends before a point has no length there.
                for i in range(acting):
                    out[i] = rows[given + i] if part[i] != 0.0 else 0.0
                out[acting:] = 0.0
            take_part(first, acting, 1.0, part, rows, left[tendon])
            if has_offsets:
                set_offset(
                    acting, x, y, dx, dy, parameters.x[tendon, first:last],
                    parameters.y[tendon, first:last], parameters.dx[tendon, first:last],
                    parameters.dy[tendon, first:last], rows,
                )  # fmt: skip
                weight, total = weights[first:last], 0.0
                for i in range(acting):
                    total += weight[i] * rows[_ALONG + i] if part[i] != 0.0 else 0.0
                own[tendon] += total
                unscale(acting, rows)
                column = left[tendons + 2 + tendon]
                take_part(first, acting, tensions[tendon], part, rows, column)


@borrows
def set_stretch(
    count: int, x: FloatArray, y: FloatArray, dx: FloatArray, dy: FloatArray, rows: FloatArray
) -> None:
    """Fill in the gradient of a tendon's stretch by the scaled strain, at ``count`` sections."""
    for i in range(count):
        u_t, u_n, u_b, length = tendon_direction(
            rows[T + i], rows[N + i], rows[B + i], rows[S + i], rows[WIDTH + i],
            x[i], y[i], dx[i], dy[i],
        )  # fmt: skip
        over = 1.0 / length
        rows[G_T + i], rows[G_N + i], rows[G_B + i], rows[G_S + i] = tendon_gradient(
            u_t * over, u_n * over, u_b * over, rows[SLOPE + i], x[i], y[i], dx[i], dy[i]
        )


@borrows
def set_offset(
    count: int, path_x: FloatArray, path_y: FloatArray, slope_x: FloatArray, slope_y: FloatArray,
    out_x: FloatArray, out_y: FloatArray, out_dx: FloatArray, out_dy: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """Fill in the derivatives by a tendon's offset of its stretch and of the gradient of that.

    ``out_x``, ``out_y`` and their slopes are those of `ParameterTables`, at ``count`` sections.
    """
    for i in range(count):
        t, n, b, width, slope = (
            rows[T + i], rows[N + i], rows[B + i], rows[WIDTH + i], rows[SLOPE + i]
        )  # fmt: skip
        x, y, dx, dy = path_x[i], path_y[i], slope_x[i], slope_y[i]
        u_t, u_n, u_b, length = tendon_direction(t, n, b, rows[S + i], width, x, y, dx, dy)
        over = 1.0 / length
        u_t, u_n, u_b = u_t * over, u_n * over, u_b * over
        c_t, c_n, c_b = offset_direction(t, n, b, width, out_x[i], out_y[i], out_dx[i], out_dy[i])
        rows[_ALONG + i], c_t, c_n, c_b = unit_change(u_t, u_n, u_b, over, c_t, c_n, c_b)
        rows[G_T + i], rows[G_N + i], rows[G_B + i], rows[G_S + i] = offset_gradient(
            u_t, u_n, u_b, c_t, c_n, c_b, slope, x, y, dx, dy, out_x[i], out_y[i], out_dx[i],
            out_dy[i],
        )  # fmt: skip


@borrows
def unscale(count: int, rows: FloatArray) -> None:
    """Fill in the gradient by the twist from that by the scaled strain."""
    for i in range(count):
        (
            rows[_GRADIENT + i], rows[_GRADIENT + LANES + i], rows[_GRADIENT + 2 * LANES + i],
            rows[_GRADIENT + 3 * LANES + i],
        ) = unscaled_gradient(
            rows[_TWIST + i], rows[_TWIST + LANES + i], rows[_TWIST + 2 * LANES + i],
            rows[WIDTH + i], rows[SLOPE + i], rows[G_T + i], rows[G_N + i], rows[G_B + i],
            rows[G_S + i],
        )  # fmt: skip


@borrows
def take(first: int, count: int, rows: FloatArray, out: FloatArray) -> None:
    """Fill in ``count`` sections of ``out`` (4, points) with the negative of a gradient."""
    for k in range(4):
        given, row = _GRADIENT + k * LANES, out[k, first : first + count]
        for i in range(count):
            row[i] = -rows[given + i]


@borrows
def take_part(
    first: int, acting: int, tension: float, part: FloatArray, rows: FloatArray, out: FloatArray
) -> None:
    """`take` of the ``tension`` times its ``part`` (count,); zero where the tendon has ended."""
    for k in range(4):
        given, row = _GRADIENT + k * LANES, out[k, first : first + part.size]
        for i in range(acting):
            row[i] = -(tension * part[i]) * rows[given + i]
        row[acting:] = 0.0
