"""Friction along tendons: what `numba_build` compiles, as `loaded.friction` has it.

Of the tendons under tension alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.core.compiled.friction_tables import FrictionTables
from octo_arm_model.core.compiled.products import add_products
from octo_arm_model.core.compiled.resolution_kernels import largest_tail
from octo_arm_model.core.compiled.section_tables import SectionTables
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.friction import SAME
from octo_arm_model.core.loaded.rod import RESOLVED_TENSIONS
from octo_arm_model.core.section.elastic_laws import incompressible_widening
from octo_arm_model.core.section.formulas import tendon_direction
from octo_arm_model.core.section.tendon_tangents import curvature, kink_angle


def find_tensions(
    tables: FrictionTables, tensions: FloatArray, before: FloatArray, pulled: IntArray,
    angle: FloatArray, slip: FloatArray,
) -> bool:  # fmt: skip
    """Fill in tensions at the points and which way tendons ``slip`` there, for an ``angle``.

    Both (tendons, points); ``before`` likewise, or (0, 0) for slack ones.

    Returns:
        Whether any tendon sticks.
    """
    along, sticks = tables.sections.transmission, False
    for tendon in pulled:
        rate = tables.coefficient[tendon]
        for i in range(angle.shape[1]):
            given = tables.transmission[tendon, i] * tensions[tendon]
            part = np.exp(-rate * angle[tendon, i])
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
    tables: FrictionTables, twist: FloatArray, strain: FloatArray, tendon: np.integer[Any],
    path: FloatArray, rate: FloatArray, angle: FloatArray,
) -> None:  # fmt: skip
    """Fill in how a ``tendon`` turns under ``twist`` (4, points): see `Turning`, (points,).

    And its ``path`` (6, points), the unit tangent and the derivative of this; ``strain`` is that
    of `find_strain`. In loops along all points, which are vectorised.
    """
    sections, s, count = tables.sections, tables.weights.size, rate.size
    x, y, dx, dy = sections.x[tendon], sections.y[tendon], sections.dx[tendon], sections.dy[tendon]
    e_t, e_n, e_b, c_t, c_n, c_b = path[0], path[1], path[2], path[3], path[4], path[5]
    t, n, b = strain[0], strain[1], strain[2]
    for i in range(count):
        u_t, u_n, u_b, length = tendon_direction(
            t[i], n[i], b[i], strain[3, i], strain[4, i], x[i], y[i], dx[i], dy[i]
        )
        over = 1.0 / length
        e_t[i], e_n[i], e_b[i] = over * u_t, over * u_n, over * u_b
    path[3:] = 0.0
    total, jump, end = 0.0, np.empty(3), np.zeros(3)
    for element in range(tables.step.size):
        first, over = element * s, 1.0 / tables.step[element]
        for k in range(3):
            unit, slope = path[k, first : first + s], path[3 + k, first : first + s]
            add_products(unit, tables.differentiate_columns, slope)
            start, stop = 0.0, 0.0
            for j in range(s):
                slope[j] *= over
                start += tables.ends[0, j] * unit[j]
                stop += tables.ends[1, j] * unit[j]
            jump[k], end[k] = start - end[k], stop
        # Until it is integrated, what is added at the start of the element.
        angle[first] = kink_angle(jump[0], jump[1], jump[2]) if element else 0.0
    t, n, b = twist[0], twist[1], twist[2]
    for i in range(count):
        c_t[i], c_n[i], c_b[i] = curvature(
            t[i], n[i], b[i], e_t[i], e_n[i], e_b[i], c_t[i], c_n[i], c_b[i]
        )
        rate[i] = np.sqrt(c_t[i] * c_t[i] + c_n[i] * c_n[i] + c_b[i] * c_b[i])
    for element in range(tables.step.size):
        first = element * s
        total += angle[first]
        total = integrate(tables, element, rate[first : first + s], total, angle)


def find_strain(sections: SectionTables, twist: FloatArray, strain: FloatArray) -> None:
    """Fill in the scaled ``strain`` (5, points) under ``twist`` (4, points), and the widening."""
    strain[:4], strain[4] = twist, 1.0
    if sections.widens:
        for i in range(twist.shape[1]):
            width = strain[4, i] = incompressible_widening(twist[3, i])[0]
            for k in range(3):
                strain[k, i] *= width


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


def resolves_tensions(tables: FrictionTables, tensions: FloatArray) -> bool:
    """Whether points resolve those along tendons of ``tensions`` at the base, which do not stick.

    As `LoadedRod.resolves_twist`.
    """
    for tendon in np.flatnonzero(tensions):
        along = tables.sections.transmission[tendon]
        if largest_tail(tables.tail, along) > RESOLVED_TENSIONS * tensions.max():
            return False
    return True
