"""How tendons with friction turn together: what `numba_build` compiles.

As `sliding.sliding_balance` has it, of the tendons under tension alone, ``pulled``.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.friction.friction_kernels import TurningState, integrate
from octo_arm_model.core.compiled.friction.friction_tables import FrictionTables
from octo_arm_model.core.compiled.friction.placing_kernels import add_yielding, place_of
from octo_arm_model.core.compiled.numerics.dense_kernels import (
    eliminate_definite,
    substitute_definite,
)
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.elastic_laws import incompressible_widening


def find_couplings(
    tables: FrictionTables, twist: FloatArray, hessian: FloatArray, pulled: IntArray,
    turning: TurningState,
) -> None:  # fmt: skip
    """Fill in ``by_pull`` and ``coupling`` of ``turning``, of which all else is known.

    Under ``twist`` (4, points), with the ``hessian`` (4, 4, points) of the energy there.
    """
    sections, count, unit = tables.sections, twist.shape[1], turning.unit
    width, slope = np.ones(count), np.zeros(count)
    if sections.widens:
        for i in range(count):
            width[i], slope[i], _ = incompressible_widening(twist[3, i])
    factors = hessian.copy()
    eliminate_definite(factors)
    t, n, b = twist[0], twist[1], twist[2]
    for k in range(pulled.size):
        e_t, e_n, e_b = unit[0, k], unit[1, k], unit[2, k]
        x, y = place_of(sections, pulled[k], k, turning.offset)
        dx, dy = sections.dx[pulled[k]], sections.dy[pulled[k]]
        bends = turning.by_pull[k]
        for i in range(count):
            bends[0, i] = -width[i] * (x[i] * e_b[i] - y[i] * e_n[i])
            bends[1, i] = -width[i] * y[i] * e_t[i]
            bends[2, i] = width[i] * x[i] * e_t[i]
            bends[3, i] = -e_t[i] - slope[i] * (
                (n[i] * y[i] - b[i] * x[i]) * e_t[i]
                + (dx[i] - t[i] * y[i]) * e_n[i]
                + (dy[i] + t[i] * x[i]) * e_b[i]
            )
        if turning.offset.size:
            add_yielding(sections, pulled[k], x, y, twist, width, slope, bends)
        substitute_definite(factors, bends)
    across = np.empty((3, count))
    for j in range(pulled.size):
        e_t, e_n, e_b = unit[0, j], unit[1, j], unit[2, j]
        c_t, c_n, c_b = turning.curvature[0, j], turning.curvature[1, j], turning.curvature[2, j]
        for i in range(count):
            rate = turning.rate[j, i]
            over = 1.0 / rate if rate > 0.0 else 0.0
            across[0, i] = over * (e_n[i] * c_b[i] - e_b[i] * c_n[i])
            across[1, i] = over * (e_b[i] * c_t[i] - e_t[i] * c_b[i])
            across[2, i] = over * (e_t[i] * c_n[i] - e_n[i] * c_t[i])
        for k in range(pulled.size):
            bends, out = turning.by_pull[k], turning.coupling[j, k]
            for i in range(count):
                out[i] = (
                    across[0, i] * bends[0, i] + across[1, i] * bends[1, i]
                    + across[2, i] * bends[2, i]
                )  # fmt: skip


def follow_tensions(
    tables: FrictionTables, turning: TurningState, twist: FloatArray, turns: bool
) -> None:
    """Move the ``twist`` (4, points) of sections in balance by the ``change`` of tensions.

    And if ``turns``, how far tendons have turned.
    """
    several, count = turning.angle.shape
    for k in range(several):
        change = turning.change[k]
        for m in range(4):
            by_pull, out = turning.by_pull[k, m], twist[m]
            for i in range(count):
                out[i] += by_pull[i] * change[i]
    if turns:
        rate, turned = np.zeros((several, count)), turning.turned
        for j in range(several):
            for k in range(several):
                coupled, change = turning.coupling[j, k], turning.change[k]
                for i in range(count):
                    rate[j, i] += coupled[i] * change[i]
        integrate(tables, rate, turned)
        turned += turning.angle


def improve(tables: FrictionTables, pulled: IntArray, turning: TurningState) -> float:
    """Bring the angles nearer, as `next_angle` does, but in one sweep from point to point.

    With half of what a point adds to the integrals counted there, which is exact enough.

    Returns:
        The largest part by which tensions change; NaN where it is none.
    """
    several, count = turning.angle.shape
    by_angle, moved = np.empty((several, count)), np.empty((several, count))
    for k in range(several):
        mu, along = tables.coefficient[pulled[k]], tables.sections.transmission[pulled[k]]
        for i in range(count):
            by_angle[k, i] = turning.slip[k, i] * mu * along[i]
            moved[k, i] = turning.turned[k, i] - turning.angle[k, i]
    total, pull = np.zeros(several), np.empty(several)
    for i in range(count):
        half = 0.5 * tables.quadrature[i]
        for k in range(several):
            moved[k, i] += total[k]
            pull[k] = by_angle[k, i] * moved[k, i]
        for j in range(several):
            rate = 0.0
            for k in range(several):
                rate += turning.coupling[j, k, i] * pull[k]
            moved[j, i] += half * rate
            total[j] += 2.0 * half * rate
    largest, sum_of_all = 0.0, 0.0
    for k in range(several):
        mu = tables.coefficient[pulled[k]]
        for i in range(count):
            old = turning.angle[k, i]
            new = turning.angle[k, i] = max(old + moved[k, i], 0.0)
            largest = max(largest, mu * abs(new - old))
            sum_of_all += moved[k, i]
    return largest if np.isfinite(sum_of_all) else np.nan
