"""Kernels for the angles by which tendons with friction turn, and for their tensions.

The functions consider the tendons under tension, with the numbers ``pulled`` (pulled,), each at
the points up to its anchorage, of which there are ``reach`` (pulled,).
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.sliding.friction import SAME
from octo_arm_model.core.section.elastic_laws import incompressible_widening
from octo_arm_model.core.section.formulas import tendon_direction
from octo_arm_model.core.section.tendons.tendon_tangents import curvature, kink_angle

# Rows of the arrays ``strain`` (`STRAIN`, points): the four scaled strains, the widening and its
# derivative by the stretch.
STRAIN = 6
# Change of mu theta up to which four terms of a series are exp(-mu theta) but for rounding.
SMALL = 1e-3


@borrows
def set_kept(
    coefficient: FloatArray, pulled: IntArray, reach: IntArray, angle: FloatArray,
    moved: FloatArray, largest: float, kept: FloatArray,
) -> None:  # fmt: skip
    """Fill in ``kept`` (pulled, points), the part of its tension that friction leaves a tendon.

    It is exp(-mu theta) after turning by the ``angle`` theta (pulled, points) [rad]. Where
    ``largest``, the largest of mu times the last change ``moved`` of theta, is small, ``kept``
    before that change is updated: exponentials take much longer.
    """
    for number in range(pulled.size):
        rate = coefficient[pulled[number]]
        if largest <= SMALL:
            for i in range(reach[number]):
                less = rate * moved[number, i]
                kept[number, i] *= 1.0 - less * (1.0 - less * (0.5 - less * (1.0 / 6.0)))
        else:
            for i in range(reach[number]):
                kept[number, i] = np.exp(-rate * angle[number, i])


@borrows
def set_tensions(
    tensions: FloatArray, before: FloatArray, pulled: IntArray, reach: IntArray, part: FloatArray,
    kept: FloatArray, along: FloatArray, slip: FloatArray, change: FloatArray,
) -> bool:  # fmt: skip
    """Fill in tensions ``along`` tendons, their ``change`` and ``slip``.

    The compiled counterpart of `Friction.tensions`. ``tensions`` (tendons,) are those at the base
    [N], ``part`` (tendons, points) is the part of them that reaches a point without friction and
    ``kept`` (pulled, points) the part of that which friction leaves. ``before`` (tendons, points)
    are the tensions along the tendons before [N], (0, 0) for slack tendons. ``along`` is (tendons,
    points), ``change`` and ``slip`` are (pulled, points) as in `TurningState`.

    Returns:
        Whether any tendon sticks.
    """
    stuck, has_history = 0, before.size > 0
    for number in range(pulled.size):
        tendon = pulled[number]
        pull = tensions[tendon]
        for i in range(reach[number]):
            given = part[tendon, i] * pull
            tension, way = given * kept[number, i], -1.0
            if has_history:
                held = before[tendon, i]
                if held > tension * (1.0 + SAME):
                    high = given / kept[number, i]
                    way = 1.0 if held >= high * (1.0 - SAME) else 0.0
                    stuck += way == 0.0
                    tension = min(held, high)
            slip[number, i], change[number, i] = way, tension - along[tendon, i]
            along[tendon, i] = tension
    return stuck > 0


@borrows
def set_strain(widens: bool, twist: FloatArray, strain: FloatArray) -> None:
    """Fill in the ``strain`` (`STRAIN`, points) of cross sections under ``twist`` (4, points)."""
    if widens:
        for i in range(twist.shape[1]):
            strain[4, i], strain[5, i], _ = incompressible_widening(twist[3, i])
    else:
        for i in range(twist.shape[1]):
            strain[4, i], strain[5, i] = 1.0, 0.0
    for i in range(twist.shape[1]):
        width = strain[4, i]
        strain[0, i], strain[1, i] = width * twist[0, i], width * twist[1, i]
        strain[2, i], strain[3, i] = width * twist[2, i], twist[3, i]


@borrows
def set_units(
    pulled: IntArray, reach: IntArray, place: FloatArray, dx: FloatArray, dy: FloatArray,
    strain: FloatArray, unit: FloatArray,
) -> None:  # fmt: skip
    """Fill in ``unit`` (3, pulled, points), the unit tangents of tendons in the section axes.

    The tendons are at ``place`` (2, pulled, points) with slopes ``dx`` and ``dy`` (tendons,
    points), under ``strain`` (`STRAIN`, points).
    """
    for number in range(pulled.size):
        tendon = pulled[number]
        for i in range(reach[number]):
            u_t, u_n, u_b, length = tendon_direction(
                strain[0, i], strain[1, i], strain[2, i], strain[3, i], strain[4, i],
                place[0, number, i], place[1, number, i], dx[tendon, i], dy[tendon, i],
            )  # fmt: skip
            over = 1.0 / length
            unit[0, number, i] = over * u_t
            unit[1, number, i] = over * u_n
            unit[2, number, i] = over * u_b


@borrows
def set_rates(
    reach: IntArray, twist: FloatArray, lengths: FloatArray, unit: FloatArray, slope: FloatArray,
    rate: FloatArray, across: FloatArray,
) -> None:  # fmt: skip
    """Fill in the rates at which tendons turn and their derivatives by the curvatures.

    ``rate`` (pulled, points) is |e' + kappa x e| [rad/m] with the unit tangent e, ``unit``. The
    derivative of e within an element of length one is ``slope`` (3, pulled, points). ``across``
    (3, pulled, points) is the derivative of the rate by the angular twist kappa.
    """
    for number in range(rate.shape[0]):
        for i in range(reach[number]):
            over = 1.0 / lengths[i]
            e_t, e_n, e_b = unit[0, number, i], unit[1, number, i], unit[2, number, i]
            c_t, c_n, c_b = curvature(
                twist[0, i], twist[1, i], twist[2, i], e_t, e_n, e_b,
                over * slope[0, number, i], over * slope[1, number, i], over * slope[2, number, i],
            )  # fmt: skip
            turns = np.sqrt(c_t * c_t + c_n * c_n + c_b * c_b)
            rate[number, i] = turns
            # The derivative of |e' + kappa x e| by kappa.
            over = 1.0 / turns if turns > 0.0 else 0.0
            across[0, number, i] = over * (e_n * c_b - e_b * c_n)
            across[1, number, i] = over * (e_b * c_t - e_t * c_b)
            across[2, number, i] = over * (e_t * c_n - e_n * c_t)


@borrows
def change_rates(reach: IntArray, across: FloatArray, moved: FloatArray, rate: FloatArray) -> None:
    """Fill in ``rate`` (pulled, points), the linear change of rates with the twist [rad/m].

    ``moved`` (4, points) is the change of the twist and ``across`` (3, pulled, points) the
    derivative of the rates by its angular part.
    """
    for number in range(rate.shape[0]):
        for i in range(reach[number]):
            rate[number, i] = (
                across[0, number, i] * moved[0, i] + across[1, number, i] * moved[1, i]
                + across[2, number, i] * moved[2, i]
            )  # fmt: skip


@borrows
def add_up(
    reach: IntArray, step: FloatArray, quadrature: FloatArray, rate: FloatArray,
    total: FloatArray,
) -> None:  # fmt: skip
    """Convert ``total`` (pulled, points), in place, to integrals of ``rate`` from the base.

    On entry they are the integrals within elements of length one, from the start of the element.
    """
    s = rate.shape[1] // step.size
    for number in range(rate.shape[0]):
        start = 0.0
        for element in range(reach[number] // s):
            first, length, whole = element * s, step[element], 0.0
            for i in range(first, first + s):
                total[number, i] = start + length * total[number, i]
                whole += quadrature[i] * rate[number, i]
            start += whole


@borrows
def add_kinks(reach: IntArray, ends: FloatArray, unit: FloatArray, turned: FloatArray) -> None:
    """Add to the angles ``turned`` (pulled, points) the kinks of tendons between elements [rad].

    A kink is the angle between the unit tangents ``unit`` extrapolated to the border of two
    elements from both sides; ``ends`` (each, 2) is the matrix to both ends of an element.
    """
    s = ends.shape[0]
    for number in range(turned.shape[0]):
        jumps = 0.0
        for first in range(s, reach[number], s):
            t, n, b = 0.0, 0.0, 0.0
            for i in range(s):
                start, stop, after, before = ends[i, 0], ends[i, 1], first + i, first + i - s
                t += start * unit[0, number, after] - stop * unit[0, number, before]
                n += start * unit[1, number, after] - stop * unit[1, number, before]
                b += start * unit[2, number, after] - stop * unit[2, number, before]
            jumps += kink_angle(t, n, b)
            for i in range(first, first + s):
                turned[number, i] += jumps
