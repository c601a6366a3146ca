"""Kernels for tendons with friction along an arm: the compiled counterpart of `sliding.friction`.

They compute by which angles tendons turn under a twist of the cross sections and how the twist
answers their tensions, as `sliding.sliding_balance` does. Only the tendons under tension, with the
numbers ``pulled``, are considered.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.friction.coupling_kernels import (
    HESSIAN,
    add_yielding,
    eliminate,
    set_forces,
    substitute,
    unscale,
)
from octo_arm_model.core.compiled.friction.friction_tables import FrictionTables
from octo_arm_model.core.compiled.friction.placing_kernels import (
    no_offsets,
    set_places,
)
from octo_arm_model.core.compiled.friction.turning_kernels import (
    STRAIN,
    add_kinks,
    add_up,
    set_rates,
    set_strain,
    set_units,
)
from octo_arm_model.core.compiled.loaded.resolution_kernels import largest_tail
from octo_arm_model.core.compiled.numerics.products import multiply_rows
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.rod import RESOLVED_TENSIONS


class TurningState(NamedTuple):
    """How the tendons under tension turn; arrays are (pulled, points) unless stated otherwise.

    It has all arrays of the iteration. The attributes from ``step`` to ``end_columns`` are those
    of `FrictionTables`.

    Attributes:
        angle: current iterate of the angle by which each tendon has turned since the base [rad].
        kept: part of its tension that friction leaves after that angle.
        by_pull: derivative of the twist by the tension at the same point, (pulled, 4, points).
        across: derivative of ``rate`` by the angular twist, (3, pulled, points).
        turned: angle by which the tendon turns in the shape that follows from ``angle`` [rad].
        rate: derivative of ``turned`` by arc length, without kinks [rad/m].
        slip: -1 where the tendon is drawn in, 1 where it is let out and 0 where it sticks.
        change: change of its tension when tensions were last computed [N].
        unit: its unit tangent in the axes of the cross sections, (3, pulled, points).
        slope: derivative of ``unit`` by the coordinate within an element of length one, (3,
            pulled, points).
        place: position of the tendon in the cross section along n and b [m], (2, pulled, points).
        strain: strains of the cross sections, see `STRAIN`, (`STRAIN`, points).
        hessian: Hessian of their energy, see `HESSIAN`, (`HESSIAN`, points).
        few: scratch space, (2, pulled).
        offset: offsets of the tendons in their sheaths [m], see `placing_kernels`.
        pulled: numbers of the tendons under tension, (pulled,).
        reach: number of points up to the anchorage of each, (pulled,).
        dx: slopes along n of all tendons as in `SectionTables`, (tendons, points).
        dy: slopes along b, (tendons, points).
        compliance: compliance of all sheaths as in `SectionTables`; empty if all are rigid.
        along: tensions of all tendons at the points [N], (tendons, points).
        coefficient: coefficients of friction of all tendons, (tendons,).
        widens: whether cross sections widen, as in `SectionTables`.
    """

    angle: FloatArray
    kept: FloatArray
    by_pull: FloatArray
    across: FloatArray
    turned: FloatArray
    rate: FloatArray
    slip: FloatArray
    change: FloatArray
    unit: FloatArray
    slope: FloatArray
    place: FloatArray
    strain: FloatArray
    hessian: FloatArray
    few: FloatArray
    offset: FloatArray
    pulled: IntArray
    reach: IntArray
    dx: FloatArray
    dy: FloatArray
    compliance: FloatArray
    along: FloatArray
    coefficient: FloatArray
    step: FloatArray
    lengths: FloatArray
    quadrature: FloatArray
    from_start_columns: FloatArray
    differentiate_columns: FloatArray
    end_columns: FloatArray
    widens: bool


def remembered(pulled: int) -> int:
    """Number of values at each point that are kept to predict another equilibrium.

    They are the four rows of the twist and the arrays that `state_in` places after them.
    """
    return 4 + 9 * pulled


def state_in(tables: FrictionTables, pulled: IntArray, memory: FloatArray) -> TurningState:
    """Make a `TurningState` of the tendons ``pulled``, with their places on their paths.

    The other arrays are not filled in. ``angle``, ``kept``, ``by_pull`` and ``across`` are views
    of ``memory`` (`remembered`, points) after the four rows of the twist; they serve to predict
    another equilibrium.
    """
    sections, points, p = tables.sections, memory.shape[1], pulled.size
    # Parts of one array, since allocating takes as long as a loop.
    work, offset = np.empty((12 * p + STRAIN + HESSIAN, points)), no_offsets(sections, p)
    room, along = (
        work[: 4 * p].reshape(4, p, points),
        work[4 * p : 10 * p].reshape(2, 3, p, points),
    )
    place = work[10 * p : 12 * p].reshape(2, p, points)
    strain, hessian = work[12 * p : 12 * p + STRAIN], work[12 * p + STRAIN :]
    set_places(sections.blocks, sections.x, sections.y, pulled, offset, place)
    return TurningState(
        memory[4 : 4 + p], memory[4 + p : 4 + 2 * p],
        memory[4 + 2 * p : 4 + 6 * p].reshape(p, 4, points),
        memory[4 + 6 * p :].reshape(3, p, points), room[0], room[1], room[2], room[3], along[0],
        along[1], place, strain, hessian, np.empty((2, p)), offset, pulled, tables.reach[pulled],
        sections.dx, sections.dy, sections.sheath_compliance, sections.transmission,
        tables.coefficient, tables.step, tables.lengths, tables.quadrature,
        tables.from_start_columns, tables.differentiate_columns, tables.end_columns,
        sections.widens,
    )  # fmt: skip


@borrows
def find_turnings(turning: TurningState, twist: FloatArray) -> None:
    """Fill in the angles ``turned`` by which the tendons turn under ``twist`` (4, points).

    The compiled counterpart of `Friction.turning`, with the tendons at the given ``place``. Also
    fills in ``strain``, ``unit``, ``slope``, ``rate`` and ``across`` of `TurningState`.
    """
    unit, slope, reach, rate = turning.unit, turning.slope, turning.reach, turning.rate
    ends, turned = turning.end_columns, turning.turned
    set_strain(turning.widens, twist, turning.strain)
    set_units(turning.pulled, reach, turning.place, turning.dx, turning.dy, turning.strain, unit)
    multiply_rows(unit, turning.differentiate_columns, slope)
    set_rates(reach, twist, turning.lengths, unit, slope, rate, turning.across)
    multiply_rows(rate, turning.from_start_columns, turned)
    add_up(reach, turning.step, turning.quadrature, rate, turned)
    add_kinks(reach, ends, unit, turned)


@borrows
def find_responses(turning: TurningState, twist: FloatArray) -> None:
    """Fill in ``by_pull``, the derivatives of the twist of cross sections by the tensions.

    `find_turnings` must have been called for the same ``twist`` (4, points), and ``hessian`` must
    be that at this twist; it is overwritten by its factors.
    """
    pulled, reach, place, strain, by_pull = (
        turning.pulled, turning.reach, turning.place, turning.strain, turning.by_pull
    )  # fmt: skip
    dx, dy, compliance = turning.dx, turning.dy, turning.compliance
    set_forces(pulled, reach, place, dx, dy, strain, turning.unit, by_pull)
    if compliance.size:
        add_yielding(pulled, reach, place, dx, dy, turning.along, compliance, strain, by_pull)
    unscale(reach, twist, strain, by_pull)
    eliminate(turning.hessian)
    substitute(reach, turning.hessian, by_pull)


def resolves_tensions(tables: FrictionTables, pulled: IntArray) -> bool:
    """Whether the elements resolve the tensions of the tendons ``pulled``, if none sticks.

    The last two Legendre coefficients of each tension in every element must be within
    `RESOLVED_TENSIONS` of the largest tension.
    """
    along = tables.sections.transmission
    most = RESOLVED_TENSIONS * along.max() if along.size else 0.0
    for tendon in pulled:
        if largest_tail(tables.tail, along[tendon]) > most:
            return False
    return True
