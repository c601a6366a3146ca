"""Layout of a block of cross sections of the model exact, and kernels that fill it in.

All quantities of up to `LANES` sections are rows of one flat array, ``rows``, `LANES` apart: the
compiler then knows that they do not overlap, and vectorises over the sections.
"""

from __future__ import annotations

from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.compiled.section.section_tables import LANES
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.elastic_laws import incompressible_widening

# First elements of the rows of a block: scaled strain, gradient and Hessian (lower half, row by
# row), widening and its derivatives, scales of moments and forces, residual of the offsets in
# sheaths over the lever arm: the largest of all tendons, and that of one.
T, N, B, S = (k * LANES for k in range(4))
G_T, G_N, G_B, G_S = 4 * LANES, 5 * LANES, 6 * LANES, 7 * LANES
TT, NT, NN, BT, BN = 8 * LANES, 9 * LANES, 10 * LANES, 11 * LANES, 12 * LANES
BB, ST, SN, SB, SS = 13 * LANES, 14 * LANES, 15 * LANES, 16 * LANES, 17 * LANES
WIDTH, SLOPE, BEND = 18 * LANES, 19 * LANES, 20 * LANES
OF_MOMENT, OF_FORCE, OFFSET_LEFT, ITS_LEFT = 21 * LANES, 22 * LANES, 23 * LANES, 24 * LANES
FREE = 25 * LANES  # rows from here on are those of the caller


@borrows
def set_strain(
    widens: bool, t: FloatArray, n: FloatArray, b: FloatArray, s: FloatArray, rows: FloatArray
) -> None:
    """Fill in the scaled strain from the twist (t, n, b, s) of the sections of a block."""
    for i in range(s.size):
        width = incompressible_widening(s[i])[0] if widens else 1.0
        rows[T + i], rows[N + i], rows[B + i] = width * t[i], width * n[i], width * b[i]
        rows[S + i] = s[i]


@borrows
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
