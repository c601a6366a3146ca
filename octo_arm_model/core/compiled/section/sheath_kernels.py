"""Kernels for tendons in compliant sheaths, as in `sheaths.sheath`."""

from __future__ import annotations

from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.compiled.section.section_rows import (
    BEND,
    ITS_LEFT,
    OFFSET_LEFT,
    SLOPE,
    WIDTH,
    B,
    N,
    S,
    T,
    add_terms,
)
from octo_arm_model.core.compiled.section.section_tables import LANES, SectionTables
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.formulas import (
    condensed_terms,
    sheath_inverse,
    sheath_mixed,
    sheath_pull,
    tendon_direction,
    tendon_gradient,
    tendon_hessian,
)

OFFSET_TOLERANCE = 1e-9  # residual of an offset over the lever arm: its square is rounding
MOST_OFFSET_STEPS = 30  # of Newton's method for offsets at a given strain


@borrows
def step_offset(
    count: int, tension: float, part: FloatArray, path_x: FloatArray, path_y: FloatArray,
    slope_x: FloatArray, slope_y: FloatArray, compliance: FloatArray, lever: FloatArray,
    rows: FloatArray, offset: FloatArray,
) -> float:  # fmt: skip
    """Newton step of the ``offset`` (2 `LANES`,) [m] of a tendon in its sheath.

    Returns:
        The largest residual before it over the lever arm, but for NaN.
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
        rows[ITS_LEFT + i] = (abs(left_n) + abs(left_b)) / lever[i]
    worst = 0.0
    for i in range(count):
        worst = max(worst, rows[ITS_LEFT + i])
    return worst


@borrows
def add_sheathed_tendon(
    count: int, tension: float, part: FloatArray, path_x: FloatArray, path_y: FloatArray,
    slope_x: FloatArray, slope_y: FloatArray, compliance: FloatArray, lever: FloatArray,
    rows: FloatArray, offset: FloatArray,
) -> None:  # fmt: skip
    """As `add_tendon`, for a tendon displaced from its path by ``offset`` (2 `LANES`,) [m].

    The offset is condensed out as in `SheathedSections`, together with its residual: the error of
    the gradient is then of second order in the residual.
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
        rows[OFFSET_LEFT + i] = max(rows[OFFSET_LEFT + i], (abs(left_n) + abs(left_b)) / lever[i])


@borrows
def are_inside(tables: SectionTables, block: int, pulled: IntArray, offsets: FloatArray) -> bool:
    """Whether tendons in sheaths stay in the body, as `check_tendons` requires."""
    first = tables.blocks[block, 0]
    for number in range(pulled.size):
        tendon = pulled[number]
        for i in range(tables.acting[tendon, block]):
            x = tables.x[tendon, first + i] + offsets[number, i]
            y = tables.y[tendon, first + i] + offsets[number, LANES + i]
            if not x * x + y * y <= tables.farthest[tendon, first + i] ** 2:
                return False
    return True
