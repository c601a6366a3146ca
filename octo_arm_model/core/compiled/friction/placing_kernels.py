"""Tendons with friction where they stand in their sheaths: what `numba_build` compiles.

As `sheaths.sheath` has it, at the tensions that the sections have for their ``transmission``.
Offsets are of blocks of sections, (blocks, pulled, 2 `LANES`) as in `sheath_kernels`, and of no
size where all sheaths are rigid.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.section.section_rows import FREE, WIDTH, T
from octo_arm_model.core.compiled.section.section_tables import LANES, SectionTables
from octo_arm_model.core.compiled.section.sheath_kernels import (
    MOST_OFFSET_STEPS,
    OFFSET_TOLERANCE,
    step_offset,
)
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.formulas import (
    sheath_inverse,
    sheath_mixed,
    sheath_pull,
    tendon_direction,
    tendon_gradient,
    unscaled_gradient,
)


def no_offsets(sections: SectionTables, pulled: int) -> FloatArray:
    """Those of ``pulled`` tendons on their paths."""
    each = 2 * LANES if sections.sheath_compliance.size else 0
    return np.zeros((len(sections.blocks), pulled, each))


def place_tendons(
    sections: SectionTables, strain: FloatArray, pulled: IntArray, offsets: FloatArray
) -> None:
    """Move tendons to balance in their sheaths under scaled ``strain`` (5, points)."""
    rows = np.zeros(FREE + LANES)
    for block in range(len(sections.blocks)):
        first, count = sections.blocks[block]
        last = first + count
        for k in range(4):
            rows[T + k * LANES : T + k * LANES + count] = strain[k, first:last]
        rows[WIDTH : WIDTH + count] = strain[4, first:last]
        for number in range(pulled.size):
            tendon = pulled[number]
            for _ in range(MOST_OFFSET_STEPS):
                if not step_offset(
                    sections.acting[tendon, block], 1.0,
                    sections.transmission[tendon, first:last],
                    sections.x[tendon, first:last], sections.y[tendon, first:last],
                    sections.dx[tendon, first:last], sections.dy[tendon, first:last],
                    sections.sheath_compliance[tendon, first:last],
                    sections.lever_max[first:last], rows, offsets[block, number],
                ) > OFFSET_TOLERANCE:  # fmt: skip
                    break


def place_of(
    sections: SectionTables, tendon: int, number: int, offsets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where a ``tendon`` stands, along n and b (points,) [m]; it is this ``number`` of offsets."""
    x, y = sections.x[tendon], sections.y[tendon]
    if offsets.size:
        x, y = x.copy(), y.copy()
        for block in range(len(sections.blocks)):
            first, count = sections.blocks[block]
            offset = offsets[block, number]
            for i in range(count):
                x[first + i] += offset[i]
                y[first + i] += offset[LANES + i]
    return x, y


def add_yielding(
    sections: SectionTables, tendon: int, x: FloatArray, y: FloatArray, twist: FloatArray,
    width: FloatArray, slope: FloatArray, force: FloatArray,
) -> None:  # fmt: skip
    """Add to the ``force`` (4, points) per tension of a ``tendon`` what its sheath takes from it.

    It stands at ``x`` and ``y``, in balance under the ``twist`` (4, points), by which sections
    widen by ``width`` with that ``slope`` (points,), and moves in its sheath with its tension.
    """
    dx, dy = sections.dx[tendon], sections.dy[tendon]
    compliance, along = sections.sheath_compliance[tendon], sections.transmission[tendon]
    t, n, b = width * twist[0], width * twist[1], width * twist[2]
    for i in range(x.size):
        u_t, u_n, u_b, length = tendon_direction(
            t[i], n[i], b[i], twist[3, i], width[i], x[i], y[i], dx[i], dy[i]
        )
        over, local, soft = 1.0 / length, along[i], compliance[i]
        e_t, e_n, e_b, weight = u_t * over, u_n * over, u_b * over, local * over
        p_n, p_b = sheath_pull(t[i], n[i], b[i], e_t, e_n, e_b)
        nn, nb, bb = sheath_inverse(t[i], n[i], b[i], p_n, p_b, soft * weight)
        g_t, g_n, g_b, g_s = tendon_gradient(e_t, e_n, e_b, slope[i], x[i], y[i], dx[i], dy[i])
        m_t, m_n, m_b, m_s, c_t, c_n, c_b, c_s = sheath_mixed(
            t[i], n[i], b[i], slope[i], x[i], y[i], dx[i], dy[i], e_t, e_n, e_b, p_n, p_b,
            g_t, g_n, g_b, g_s, local, weight,
        )  # fmt: skip
        off_n, off_b = soft * (nn * p_n + nb * p_b), soft * (nb * p_n + bb * p_b)
        taken = unscaled_gradient(
            twist[0, i], twist[1, i], twist[2, i], width[i], slope[i],
            m_t * off_n + c_t * off_b, m_n * off_n + c_n * off_b,
            m_b * off_n + c_b * off_b, m_s * off_n + c_s * off_b,
        )  # fmt: skip
        force[0, i] += taken[0]
        force[1, i] += taken[1]
        force[2, i] += taken[2]
        force[3, i] += taken[3]
