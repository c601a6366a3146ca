"""How tendons with friction turn together: what `numba_build` compiles.

As `loaded.sliding_balance` has it, of the tendons under tension alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.dense_kernels import eliminate_definite, substitute_definite
from octo_arm_model.core.compiled.friction_kernels import find_strain, find_turning
from octo_arm_model.core.compiled.friction_tables import FrictionTables
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.elastic_laws import incompressible_widening


class TurningState(NamedTuple):
    """How tendons turn; all (tendons, points) but for the last two.

    Attributes:
        angle: by which each has turned since the base, nearly [rad].
        turned: by which it turns in the shape that follows from that angle [rad].
        rate: derivative of ``turned`` [rad/m], without kinks.
        slip: -1 where it is drawn in, 1 where it is let out and 0 where it sticks.
        path: its unit tangent and the derivative of this in the axes of the cross sections,
            (tendons, 6, points).
        coupling: see `couplings`, of the tendons under tension in their order, (points, tendons,
            tendons).
    """

    angle: FloatArray
    turned: FloatArray
    rate: FloatArray
    slip: FloatArray
    path: FloatArray
    coupling: FloatArray


def empty_turning(tendons: int, points: int) -> TurningState:
    """Room for ``tendons`` that are drawn in and do not turn."""
    return TurningState(
        np.zeros((tendons, points)), np.empty((tendons, points)), np.empty((tendons, points)),
        np.full((tendons, points), -1.0), np.empty((tendons, 6, points)),
        np.empty((points, tendons, tendons)),
    )  # fmt: skip


def find_couplings(
    tables: FrictionTables, twist: FloatArray, hessian: FloatArray, pulled: IntArray,
    turning: TurningState,
) -> None:  # fmt: skip
    """Fill in the ``coupling`` of ``turning``, of which all else is known.

    Under ``twist`` (4, points), with the ``hessian`` (4, 4, points) of the energy there.
    """
    sections, count = tables.sections, twist.shape[1]
    bends, width, slope = np.empty((4, count)), 1.0, 0.0
    factors = hessian.copy()
    eliminate_definite(factors)
    for place, k in enumerate(pulled):
        for i in range(count):
            if sections.widens:
                width, slope, _ = incompressible_widening(twist[3, i])
            e_t, e_n, e_b = turning.path[k, 0, i], turning.path[k, 1, i], turning.path[k, 2, i]
            t, n, b = twist[0, i], twist[1, i], twist[2, i]
            x, y = sections.x[k, i], sections.y[k, i]
            bends[0, i], bends[1, i] = width * (x * e_b - y * e_n), width * y * e_t
            bends[2, i] = -width * x * e_t
            bends[3, i] = e_t + slope * (
                (n * y - b * x) * e_t
                + (sections.dx[k, i] - t * y) * e_n
                + (sections.dy[k, i] + t * x) * e_b
            )
        substitute_definite(factors, bends)
        for row, j in enumerate(pulled):
            path = turning.path[j]
            for i in range(count):
                e_t, e_n, e_b = path[0, i], path[1, i], path[2, i]
                c_t, c_n, c_b = path[3, i], path[4, i], path[5, i]
                rate = turning.rate[j, i]
                over = 1.0 / rate if rate > 0.0 else 0.0
                turning.coupling[i, row, place] = -over * (
                    (e_n * c_b - e_b * c_n) * bends[0, i]
                    + (e_b * c_t - e_t * c_b) * bends[1, i]
                    + (e_t * c_n - e_n * c_t) * bends[2, i]
                )


def find_turnings(
    tables: FrictionTables, twist: FloatArray, pulled: IntArray, turning: TurningState
) -> None:
    """Fill in how all tendons that are ``pulled`` turn under ``twist`` (4, points)."""
    strain = np.empty((5, twist.shape[1]))
    find_strain(tables.sections, twist, strain)
    for tendon in pulled:
        find_turning(
            tables, twist, strain, tendon, turning.path[tendon], turning.rate[tendon],
            turning.turned[tendon],
        )  # fmt: skip


def improve(tables: FrictionTables, pulled: IntArray, turning: TurningState) -> float:
    """Bring the angles nearer, as `next_angle` does, but in one sweep from point to point.

    With half of what a point adds to the integrals counted there, which is exact enough.

    Returns:
        The largest change; NaN where it is none.
    """
    s, n, largest = tables.weights.size, pulled.size, 0.0
    along, total, by_angle, moved = (
        tables.sections.transmission,
        np.zeros(n),
        np.empty(n),
        np.empty(n),
    )
    for i in range(turning.angle.shape[1]):
        part = tables.step[i // s] * tables.weights[i % s]
        for k in range(n):
            tendon = pulled[k]
            by_angle[k] = turning.slip[tendon, i] * tables.coefficient[tendon] * along[tendon, i]
            moved[k] = turning.turned[tendon, i] - turning.angle[tendon, i] + total[k]
            by_angle[k] *= moved[k]
        for j in range(n):
            tendon, rate = pulled[j], 0.0
            for k in range(n):
                rate += turning.coupling[i, j, k] * by_angle[k]
            total[j] += part * rate
            old = turning.angle[tendon, i]
            new = max(old + moved[j] + 0.5 * part * rate, 0.0)
            if np.isnan(new):
                return np.nan
            largest = max(largest, abs(new - old))
            turning.angle[tendon, i] = new
    return largest
