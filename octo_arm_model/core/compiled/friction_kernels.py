"""Friction along tendons: what `numba_build` compiles, as `loaded.friction` has it.

Of the tendons under tension alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.core.compiled.friction_tables import FrictionTables
from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.friction import SAME
from octo_arm_model.core.section.elastic_laws import incompressible_widening
from octo_arm_model.core.section.formulas import tendon_direction
from octo_arm_model.core.section.tendon_tangents import curvature, kink_angle


def find_tensions(
    tables: FrictionTables, tensions: FloatArray, before: FloatArray, pulled: IntArray,
    angle: FloatArray, kept: FloatArray, slip: FloatArray,
) -> bool:  # fmt: skip
    """Fill in tensions at the points and which way tendons ``slip`` there, for an ``angle``.

    And what is ``kept`` of a tension over that angle, all (tendons, points); ``before`` likewise,
    or (0, 0) for slack ones.

    Returns:
        Whether any tendon sticks.
    """
    along, sticks = tables.sections.transmission, False
    for tendon in pulled:
        rate = tables.coefficient[tendon]
        for i in range(angle.shape[1]):
            given = tables.transmission[tendon, i] * tensions[tendon]
            part = kept[tendon, i] = np.exp(-rate * angle[tendon, i])
            low = given * part
            slip[tendon, i] = -1.0
            if before.size:
                held, high = before[tendon, i], given / part
                if held > low * (1.0 + SAME):
                    slip[tendon, i] = 1.0 if held >= high * (1.0 - SAME) else 0.0
                    sticks = sticks or slip[tendon, i] == 0.0
                    low = min(held, high)
            along[tendon, i] = low
    return sticks


def find_turning(
    tables: FrictionTables,
    twist: FloatArray,
    tendon: np.integer[Any],
    rate: FloatArray,
    angle: FloatArray,
) -> None:
    """Fill in how a ``tendon`` turns under ``twist`` (4, points): see `Turning`, (points,)."""
    sections, s = tables.sections, tables.weights.size
    unit, slope = np.empty((3, s)), np.zeros((3, s))
    total, end = 0.0, np.empty(3)
    for element in range(tables.step.size):
        first, step = element * s, tables.step[element]
        across = 0.0
        for j in range(s):
            i = first + j
            width = incompressible_widening(twist[3, i])[0] if sections.widens else 1.0
            u_t, u_n, u_b, length = tendon_direction(
                width * twist[0, i], width * twist[1, i], width * twist[2, i], twist[3, i], width,
                sections.x[tendon, i], sections.y[tendon, i],
                sections.dx[tendon, i], sections.dy[tendon, i],
            )  # fmt: skip
            over = 1.0 / length
            unit[0, j], unit[1, j], unit[2, j] = u_t * over, u_n * over, u_b * over
            across += abs(u_n) + abs(u_b)
        if across > 0.0:
            for k in range(3):
                add_products(unit[k], tables.differentiate_columns, slope[k])
        jump = np.zeros(3)
        for k in range(3):
            start, stop = 0.0, 0.0
            for j in range(s):
                start += tables.ends[0, j] * unit[k, j]
                stop += tables.ends[1, j] * unit[k, j]
            jump[k], end[k] = start - end[k], stop
        if element:
            total += kink_angle(jump[0], jump[1], jump[2])
        own, over = rate[first : first + s], 1.0 / step
        for j in range(s):
            i = first + j
            c_t, c_n, c_b = curvature(
                twist[0, i], twist[1, i], twist[2, i], unit[0, j], unit[1, j], unit[2, j],
                over * slope[0, j], over * slope[1, j], over * slope[2, j],
            )  # fmt: skip
            own[j] = np.sqrt(c_t * c_t + c_n * c_n + c_b * c_b)
        total = integrate(tables, element, own, total, angle)
        if across > 0.0:
            slope[:] = 0.0


def integrate(
    tables: FrictionTables, element: int, rate: FloatArray, start: float, total: FloatArray
) -> float:
    """Fill in the integral (points,) of ``rate`` (each,) over an ``element``; return its end."""
    s, step = tables.weights.size, tables.step[element]
    out = total[element * s : element * s + s]
    out[:] = 0.0
    add_products(rate, tables.from_start_columns, out)
    whole = 0.0
    for j in range(s):
        out[j] = start + step * out[j]
        whole += tables.weights[j] * rate[j]
    return start + step * whole


def growth(kept: float, slip: float) -> float:
    """What a tension changes to over an angle over which ``kept`` is left of one that falls."""
    if slip < 0.0:
        return kept
    return 1.0 / kept if slip > 0.0 else 1.0


def improve(
    tables: FrictionTables, tendon: np.integer[Any], is_first: bool, kept: FloatArray,
    slip: FloatArray, rate: FloatArray, turned: FloatArray, angle: FloatArray,
) -> float:  # fmt: skip
    """Bring the ``angle`` (points,) of a ``tendon`` nearer, as `Friction.next_angle` does.

    Returns:
        The largest change, but of the first time.
    """
    s, mu = tables.weights.size, tables.coefficient[tendon]
    largest = 0.0
    if is_first:
        for i in range(angle.size):
            angle[i] = np.log1p(mu * turned[i]) / mu if mu > 0.0 else turned[i]
        return 0.0
    left, moved, total = np.empty(s), np.empty(angle.size), 0.0
    for element in range(tables.step.size):
        for j in range(s):
            i = element * s + j
            grows = growth(kept[i], slip[0])
            left[j] = slip[i] * rate[i] * (turned[i] - angle[i]) / grows
        total = integrate(tables, element, left, total, moved)
    for i in range(angle.size):
        new = max(turned[i] + mu * growth(kept[i], slip[0]) * moved[i], 0.0)
        largest = max(largest, abs(new - angle[i]))
        if np.isnan(new):
            return np.nan
        angle[i] = new
    return largest


def largest_tail(tables: FrictionTables, values: FloatArray) -> float:
    """Largest of the last Legendre coefficients of ``values`` (points,)."""
    s, largest = tables.weights.size, 0.0
    for first in range(0, values.size, s):
        one, other = 0.0, 0.0
        for j in range(s):
            one += tables.tail[0, j] * values[first + j]
            other += tables.tail[1, j] * values[first + j]
        largest = max(largest, abs(one), abs(other))
    return largest
