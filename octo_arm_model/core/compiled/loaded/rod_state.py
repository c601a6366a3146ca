"""The state of a loaded rod, and the room in which kernels compute."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.loaded.orientation_kernels import TURN_ROWS
from octo_arm_model.core.compiled.numerics.references import borrows, inlined
from octo_arm_model.core.compiled.section.section_kernels import SectionWork, section_work
from octo_arm_model.core.hints import FloatArray

_STATE_ROWS, _RATE_ROWS, _STATION_ROWS = 43, 11, 57


class RodState(NamedTuple):
    """State of a loaded rod at its collocation points, in equilibrium or not.

    Attributes:
        twist: angular rates by arc length [1/m] and stretch, (4, points).
        turn: orientation of the cross sections as quaternions w, x, y, z, (4, points).
        rotation: orientation of the cross sections as matrices, (3, 3, points).
        force: resultant of the loads beyond each point, in base_frame [N], (3, points).
        moment: moment of the loads beyond each point, in base_frame [N m], (3, points).
        imbalance: wrench of the loads less that of the cross section, in its axes, (4, points).
        hessian: second derivatives of the energy by the twist, (4, 4, points).
    """

    twist: FloatArray
    turn: FloatArray
    rotation: FloatArray
    force: FloatArray
    moment: FloatArray
    imbalance: FloatArray
    hessian: FloatArray


def empty_state(count: int) -> RodState:
    """Allocate an uninitialised `RodState` of ``count`` points."""
    return state_in(np.empty((_STATE_ROWS, count)))


def state_in(rows: FloatArray) -> RodState:
    """`RodState` in the arrays of ``rows`` (43, points)."""
    count = rows.shape[1]
    return RodState(
        rows[:4], rows[4:8], rows[8:17].reshape(3, 3, count), rows[17:20], rows[20:23],
        rows[23:27], rows[27:].reshape(4, 4, count),
    )  # fmt: skip


class RodWork(NamedTuple):
    """Room in which the kernels of a loaded rod compute; nothing in it outlives a call.

    It is allocated once for all of them, so that they may be marked by `borrows`: to allocate in
    each, and to count the references of its arrays, took a fifth of the time of a followed arm.

    Attributes:
        sections: room for the evaluation of cross sections.
        there: a state besides the one that is given.
        step: change of the twist, (4, points).
        turn: change of the orientations, (3, points).
        rows: for one kernel at a time, (`TURN_ROWS`, points).
        ends: the same by element, (elements, 6).
        rate: for the integrals along the arm, (11, points).
        total: their values at the start of an element, (10,).
        stations: for what is evaluated at the stations, (57, stations).
    """

    sections: SectionWork
    there: RodState
    step: FloatArray
    turn: FloatArray
    rows: FloatArray
    ends: FloatArray
    rate: FloatArray
    total: FloatArray
    stations: FloatArray


@inlined
def rod_work(tensions: FloatArray, count: int, elements: int, stations: int) -> RodWork:
    """Allocate `RodWork` for ``tensions`` (tendons,) and numbers of points and of others."""
    # Parts of one array, since allocating takes as long as a loop.
    rows = np.empty((_STATE_ROWS + 7 + TURN_ROWS + _RATE_ROWS, count))
    own, ends = rows[_STATE_ROWS:], np.empty((elements, 6))
    at_points, rate = own[7 : 7 + TURN_ROWS], own[7 + TURN_ROWS :]
    return RodWork(
        section_work(tensions), state_in(rows[:_STATE_ROWS]), own[:4], own[4:7], at_points, ends,
        rate, np.empty(10), np.empty((_STATION_ROWS, stations)),
    )  # fmt: skip


@borrows
@inlined
def copy_state(state: RodState, out: RodState) -> None:
    """Copy all arrays of ``state`` into those of ``out``."""
    copy_rows(state.twist, out.twist)
    copy_rows(state.turn, out.turn)
    copy_rows(state.force, out.force)
    copy_rows(state.moment, out.moment)
    copy_rows(state.imbalance, out.imbalance)
    for k in range(3):
        copy_rows(state.rotation[k], out.rotation[k])
    for k in range(4):
        copy_rows(state.hessian[k], out.hessian[k])


@borrows
def copy_rows(rows: FloatArray, out: FloatArray) -> None:
    """Copy ``rows`` (k, n) into ``out``, which do not overlap.

    An assignment would allocate an array in case they did.
    """
    for k in range(rows.shape[0]):
        row, to = rows[k], out[k]
        for i in range(row.size):
            to[i] = row[i]
