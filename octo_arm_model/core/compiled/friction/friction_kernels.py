"""Friction along tendons: what `numba_build` compiles, as `sliding.friction` has it.

And how tendons turn together, as `sliding.sliding_balance`; of those under tension alone,
``pulled``.
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
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.rod import RESOLVED_TENSIONS


class TurningState(NamedTuple):
    """How the tendons that are pulled turn; all (pulled, points) but for those of other axes.

    One tuple of all there is, as the compiler counts references of every array that is passed.

    Attributes:
        angle: by which each has turned since the base, nearly [rad].
        kept: what friction leaves of its tension after that angle.
        by_pull: change of the twist with each tension at the same place, (pulled, 4, points).
        across: change of ``rate`` with the angular twist, (3, pulled, points).
        turned: by which it turns in the shape that follows from that angle [rad].
        rate: derivative of ``turned`` [rad/m], without kinks.
        slip: -1 where it is drawn in, 1 where it is let out and 0 where it sticks.
        change: of its tension, when that was found last [N].
        unit: its unit tangent in the axes of the cross sections, (3, pulled, points).
        slope: derivative of this along an element over its length, likewise.
        place: where it stands in the section along n and b [m], (2, pulled, points).
        strain: of the sections, see `STRAIN`.
        hessian: of their energy, see `HESSIAN`.
        few: to work in, (2, pulled).
        offset: of the tendons in their sheaths [m], see `placing_kernels`.
        pulled: their numbers.
        reach: how many points each acts at, (pulled,).
        dx: as of `SectionTables`, of all tendons.
        dy: likewise.
        compliance: likewise, of their sheaths.
        along: their tensions at the points [N].
        coefficient: as of `FrictionTables`, and so are the others.
        widens: as of `SectionTables`.
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
    """How many numbers at every point foretell another balance, see `state_in`."""
    return 4 + 9 * pulled


def state_in(tables: FrictionTables, pulled: IntArray, memory: FloatArray) -> TurningState:
    """How ``pulled`` tendons turn, of which their paths alone are known.

    What foretells another balance lies in ``memory`` (`remembered`, points) after the twist.
    """
    sections, points, p = tables.sections, memory.shape[1], pulled.size
    room, along = np.empty((4, p, points)), np.empty((2, 3, p, points))
    place, offset = np.empty((2, p, points)), no_offsets(sections, p)
    set_places(sections.blocks, sections.x, sections.y, pulled, offset, place)
    return TurningState(
        memory[4 : 4 + p], memory[4 + p : 4 + 2 * p],
        memory[4 + 2 * p : 4 + 6 * p].reshape(p, 4, points),
        memory[4 + 6 * p :].reshape(3, p, points), room[0], room[1], room[2], room[3], along[0],
        along[1], place, np.empty((STRAIN, points)), np.empty((HESSIAN, points)),
        np.empty((2, p)), offset, pulled, tables.reach[pulled], sections.dx, sections.dy,
        sections.sheath_compliance, sections.transmission, tables.coefficient, tables.step,
        tables.lengths, tables.quadrature, tables.from_start_columns,
        tables.differentiate_columns, tables.end_columns, sections.widens,
    )  # fmt: skip


def find_turnings(turning: TurningState, twist: FloatArray) -> None:
    """Fill in how the tendons turn in their places under ``twist`` (4, points): see `Turning`."""
    unit, slope, reach, rate = turning.unit, turning.slope, turning.reach, turning.rate
    ends, turned = turning.end_columns, turning.turned
    set_strain(turning.widens, twist, turning.strain)
    set_units(turning.pulled, reach, turning.place, turning.dx, turning.dy, turning.strain, unit)
    multiply_rows(unit, turning.differentiate_columns, slope)
    set_rates(reach, twist, turning.lengths, unit, slope, rate, turning.across)
    multiply_rows(rate, turning.from_start_columns, turned)
    add_up(reach, turning.step, turning.quadrature, rate, turned)
    add_kinks(reach, ends, unit, turned)


def multiply_rows(rows: FloatArray, columns: FloatArray, out: FloatArray) -> None:
    """Fill in the products of all elements of ``rows`` (..., points) with ``columns``."""
    s = len(columns)
    each = rows.size // s, s
    np.dot(rows.reshape(each), columns, out.reshape(each))


def find_responses(turning: TurningState, twist: FloatArray) -> None:
    """Fill in ``by_pull`` under ``twist`` (4, points), of which `find_turnings` has been found.

    With the ``hessian``, which is lost.
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
    """Whether points resolve the tensions at them, of tendons that do not stick.

    As `LoadedRod.resolves_twist`.
    """
    along = tables.sections.transmission
    most = RESOLVED_TENSIONS * along.max() if along.size else 0.0
    for tendon in pulled:
        if largest_tail(tables.tail, along[tendon]) > most:
            return False
    return True
