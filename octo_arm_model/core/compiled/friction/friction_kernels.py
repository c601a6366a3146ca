"""Friction along tendons: what `numba_build` compiles, as `sliding.friction` has it.

Of the tendons under tension alone, ``pulled``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.friction.friction_tables import FrictionTables
from octo_arm_model.core.compiled.friction.placing_kernels import (
    no_offsets,
    place_of,
    place_tendons,
)
from octo_arm_model.core.compiled.loaded.resolution_kernels import largest_tail
from octo_arm_model.core.compiled.section.section_tables import SectionTables
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.rod import RESOLVED_TENSIONS
from octo_arm_model.core.loaded.sliding.friction import SAME
from octo_arm_model.core.section.elastic_laws import incompressible_widening
from octo_arm_model.core.section.formulas import tendon_direction
from octo_arm_model.core.section.tendons.tendon_tangents import curvature, kink_angle


class TurningState(NamedTuple):
    """How the tendons that are pulled turn; all (pulled, points) but for the last five.

    Attributes:
        angle: by which each has turned since the base, nearly [rad].
        turned: by which it turns in the shape that follows from that angle [rad].
        rate: derivative of ``turned`` [rad/m], without kinks.
        slip: -1 where it is drawn in, 1 where it is let out and 0 where it sticks.
        change: of its tension, when that was found last [N].
        unit: its unit tangent in the axes of the cross sections, (3, pulled, points).
        curvature: derivative of this, likewise [1/m].
        by_pull: change of the twist with each tension at the same place, (pulled, 4, points).
        coupling: likewise of each ``rate``, see `couplings`, (pulled, pulled, points).
        offset: of the tendons in their sheaths [m], see `placing_kernels`.
    """

    angle: FloatArray
    turned: FloatArray
    rate: FloatArray
    slip: FloatArray
    change: FloatArray
    unit: FloatArray
    curvature: FloatArray
    by_pull: FloatArray
    coupling: FloatArray
    offset: FloatArray


def empty_turning(sections: SectionTables, pulled: int) -> TurningState:
    """Room for ``pulled`` tendons that are drawn in and do not turn."""
    points = sections.axial.size
    return TurningState(
        np.zeros((pulled, points)), np.empty((pulled, points)), np.empty((pulled, points)),
        np.full((pulled, points), -1.0), np.zeros((pulled, points)),
        np.empty((3, pulled, points)), np.empty((3, pulled, points)),
        np.empty((pulled, 4, points)), np.empty((pulled, pulled, points)),
        no_offsets(sections, pulled),
    )  # fmt: skip


def find_tensions(
    tables: FrictionTables, tensions: FloatArray, before: FloatArray, pulled: IntArray,
    turning: TurningState,
) -> bool:  # fmt: skip
    """Fill in tensions at the points, their ``change`` and ``slip``, for the ``angle``.

    ``before`` (tendons, points) are those before, or (0, 0) for slack ones.

    Returns:
        Whether any tendon sticks.
    """
    sticks, has_history = False, before.size > 0
    for number in range(pulled.size):
        tendon = pulled[number]
        rate, pull, part = (
            tables.coefficient[tendon],
            tensions[tendon],
            tables.transmission[tendon],
        )
        angle, slip, change = turning.angle[number], turning.slip[number], turning.change[number]
        along = tables.sections.transmission[tendon]
        for i in range(angle.size):
            given, kept = part[i] * pull, np.exp(-rate * angle[i])
            tension, slip[i] = given * kept, -1.0
            if has_history:
                held = before[tendon, i]
                if held > tension * (1.0 + SAME):
                    high = given / kept
                    slip[i] = 1.0 if held >= high * (1.0 - SAME) else 0.0
                    sticks = sticks or slip[i] == 0.0
                    tension = min(held, high)
            change[i], along[i] = tension - along[i], tension
    return sticks


def find_turnings(
    tables: FrictionTables, twist: FloatArray, pulled: IntArray, turning: TurningState
) -> None:
    """Fill in how the tendons turn under ``twist`` (4, points): see `Turning`.

    Where sheaths give way tendons stand as the tensions at the points have it.
    """
    sections, several, count = tables.sections, pulled.size, twist.shape[1]
    elements, s = tables.step.size, len(tables.end_columns)
    unit, slope, rate, turned = turning.unit, turning.curvature, turning.rate, turning.turned
    strain = np.empty((5, count))
    find_strain(sections, twist, strain)
    t, n, b, stretch, width = strain[0], strain[1], strain[2], strain[3], strain[4]
    if turning.offset.size:
        place_tendons(sections, strain, pulled, turning.offset)
    for number in range(several):
        tendon = pulled[number]
        x, y = place_of(sections, tendon, number, turning.offset)
        dx, dy = sections.dx[tendon], sections.dy[tendon]
        e_t, e_n, e_b = unit[0, number], unit[1, number], unit[2, number]
        for i in range(count):
            u_t, u_n, u_b, length = tendon_direction(
                t[i], n[i], b[i], stretch[i], width[i], x[i], y[i], dx[i], dy[i]
            )
            over = 1.0 / length
            e_t[i], e_n[i], e_b[i] = over * u_t, over * u_n, over * u_b
    each = 3 * several * elements, s
    np.dot(unit.reshape(each), tables.differentiate_columns, slope.reshape(each))
    ends = np.dot(unit.reshape(each), tables.end_columns).reshape(3, several, elements, 2)
    t, n, b, over = twist[0], twist[1], twist[2], 1.0 / tables.lengths
    for number in range(several):
        e_t, e_n, e_b = unit[0, number], unit[1, number], unit[2, number]
        c_t, c_n, c_b = slope[0, number], slope[1, number], slope[2, number]
        turns = rate[number]
        for i in range(count):
            d_t, d_n, d_b = over[i] * c_t[i], over[i] * c_n[i], over[i] * c_b[i]
            d_t, d_n, d_b = curvature(t[i], n[i], b[i], e_t[i], e_n[i], e_b[i], d_t, d_n, d_b)
            c_t[i], c_n[i], c_b[i] = d_t, d_n, d_b
            turns[i] = np.sqrt(d_t * d_t + d_n * d_n + d_b * d_b)
    integrate(tables, rate, turned)
    for number in range(several):
        jumps, out = 0.0, turned[number].reshape(elements, s)
        for element in range(1, elements):
            before, after = ends[:, number, element - 1, 1], ends[:, number, element, 0]
            jumps += kink_angle(after[0] - before[0], after[1] - before[1], after[2] - before[2])
            out[element] += jumps


def find_strain(sections: SectionTables, twist: FloatArray, strain: FloatArray) -> None:
    """Fill in the scaled ``strain`` (5, points) under ``twist`` (4, points), and the widening."""
    strain[:4], strain[4] = twist, 1.0
    if sections.widens:
        for i in range(twist.shape[1]):
            width = strain[4, i] = incompressible_widening(twist[3, i])[0]
            for k in range(3):
                strain[k, i] *= width


def integrate(tables: FrictionTables, rate: FloatArray, total: FloatArray) -> None:
    """Fill in the integrals from the base (n, points) of each ``rate`` (n, points)."""
    s, several, elements = len(tables.end_columns), len(rate), tables.step.size
    carried = rate * tables.lengths
    each = several * elements, s
    np.dot(carried.reshape(each), tables.from_start_columns, total.reshape(each))
    for number in range(several):
        start = 0.0
        for element in range(elements):
            first, whole = element * s, 0.0
            for i in range(first, first + s):
                total[number, i] += start
                whole += tables.quadrature[i] * rate[number, i]
            start += whole


def resolves_tensions(tables: FrictionTables, pulled: IntArray) -> bool:
    """Whether points resolve the tensions at them, of tendons that do not stick.

    As `LoadedRod.resolves_twist`.
    """
    along = tables.sections.transmission
    most = RESOLVED_TENSIONS * along.max() if along.size else 0.0
    for tendon in pulled:
        if largest_tail(tables.tail, along[tendon]) > most:
            return False
    return True
