"""Kernels for the first derivatives of a loaded rod: the compiled counterpart of `sensitivity`.

They compute the changes of an equilibrium with the loads, tensions and parameters of the arm, by
solving the linearised system for the wrenches that these leave unbalanced.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.loaded.imbalance_kernels import IMBALANCE_ROWS, find_imbalance
from octo_arm_model.core.compiled.loaded.orientation_kernels import find_rotation
from octo_arm_model.core.compiled.loaded.readout_kernels import read_changes
from octo_arm_model.core.compiled.loaded.response_kernels import respond, tip_wrenches
from octo_arm_model.core.compiled.loaded.rod_state import RodState, RodWork, rod_work
from octo_arm_model.core.compiled.loaded.rod_tables import (
    ElementTables,
    ParameterTables,
    RodTables,
)
from octo_arm_model.core.compiled.loaded.state_kernels import (
    find_state,
    find_wrench,
    find_wrench_of_tip_force,
)
from octo_arm_model.core.compiled.loaded.step_kernels import find_response_to_moment, find_step
from octo_arm_model.core.compiled.loaded.system_kernels import System, find_system
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray


def dead_wrenches(
    tables: RodTables, state: RodState, force: FloatArray, moment: FloatArray, wrench: FloatArray
) -> None:
    """Fill in the ``wrench`` (4, points, loads) of dead loads in the axes of the cross sections.

    ``force`` and ``moment`` (loads, 3, points) are the resultants, in base_frame, of the forces
    and of the free moments beyond each point. The moments of the forces are added here.
    """
    found, tip, work = np.empty_like(state.twist), np.zeros(3), np.empty((6, state.twist.shape[1]))
    for load in range(len(force)):
        find_wrench(tables.elements, state, force[load], moment[load].copy(), tip, found, work)
        wrench[:, :, load] = found


def linearise(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, state: RodState,
    is_known: bool, system: System, work: RodWork,
) -> int:  # fmt: skip
    """Linearise about an equilibrium ``state``, of which twist and orientations are given.

    Fills in the rotation matrices of the state and, unless ``is_known`` says that it is given, the
    ``system``, together with the other fields of the state.

    Returns:
        The sign of the determinant of the system; 1 for a given one, 0 where it is singular.
    """
    if is_known:
        find_rotation(state.turn, state.rotation)
        return 1
    find_state(tables, tensions, tip_wrench, 1.0, state, work)
    return find_system(tables.elements, state, system)


def differentiate(
    tables: RodTables, parameters: ParameterTables, tensions: FloatArray, tip_wrench: FloatArray,
    state: RodState, is_known: bool, system: System, force: FloatArray, moment: FloatArray,
    pose: FloatArray, strain: FloatArray, length: FloatArray,
) -> int:  # fmt: skip
    """Fill in the derivatives of an equilibrium ``state``, given by twist and orientations.

    The compiled counterpart of `derivatives`. Fills in the changes of ``pose`` (stations, 6,
    columns) and ``strain`` (stations, 4, columns) at the stations and of the tendons' ``length``
    (tendons, columns). If dead loads are given by ``force`` and ``moment``, as in `dead_wrenches`,
    there is one column for each. Otherwise the first six columns belong to the wrench on the tip
    and the others to the parameters of `find_imbalance`, with offsets or without. The ``system``
    is given or filled in as in `linearise`.

    Returns:
        The sign of the determinant of the system; 0 where it is singular.
    """
    count, columns, tendons = state.twist.shape[1], pose.shape[2], tensions.size
    work = rod_work(tensions, count, tables.elements.step.size, 0)
    sign = linearise(tables, tensions, tip_wrench, state, is_known, system, work)
    if sign == 0:
        return 0
    others = tendons + 2 if len(force) else columns - 6
    imbalance, stretch = np.empty((4, count, columns)), np.empty((tendons, 4, count))
    left, own = np.empty((others, 4, count)), np.empty(tendons)
    find_imbalance(
        tables.sections, parameters, tables.elements.quadrature, tensions, state.twist,
        np.empty(IMBALANCE_ROWS), stretch, left, own,
    )  # fmt: skip
    if len(force):
        dead_wrenches(tables, state, force, moment, imbalance)
    else:
        wrench = tip_wrenches(tables.elements, state)
        wrench[:, :, 3:] /= tables.elements.length
        imbalance[:, :, :6] = wrench
        for column in range(others):
            for k in range(4):
                for i in range(count):
                    imbalance[k, i, 6 + column] = left[column, k, i]
    change, turn = np.empty((4, count, columns)), np.empty((3, count, columns))
    respond(tables.elements, system, imbalance, change, turn)
    read_changes(tables, state, change, turn, pose, strain)
    weigh(tables, stretch)
    np.dot(stretch.reshape(tendons, 4 * count), change.reshape(4 * count, columns), length)
    if columns > tendons + 8 and not len(force):
        for tendon in range(tendons):
            length[tendon, tendons + 8 + tendon] += own[tendon]
    return sign


@borrows
def weigh(tables: RodTables, values: FloatArray) -> None:
    """Multiply ``values`` (rows, 4, points) by the weights of the integral along the arm."""
    weights = tables.elements.quadrature
    for row in range(len(values)):
        for k in range(4):
            out = values[row, k]
            for i in range(out.size):
                out[i] *= weights[i]


def add_tip_covariance(
    tables: RodTables, parameters: ParameterTables, tensions: FloatArray, tip_wrench: FloatArray,
    state: RodState, is_known: bool, system: System, deviations: FloatArray,
    covariance: FloatArray,
) -> int:  # fmt: skip
    """Add to ``covariance`` (6, 6) that of the pose of the tip by uncertain parameters.

    The compiled counterpart of `tip_covariance`. By reciprocity, derivatives of the pose are the
    work of the imbalance of each parameter on the changes that unit wrenches on the tip make, so
    that the system is solved for few columns. The standard ``deviations`` (columns,) are those of
    the parameters of `find_imbalance`, with offsets or without; ``state`` is an equilibrium, given
    by twist and orientations.

    Returns:
        The sign of the determinant of the system; 0 where it is singular.
    """
    count, tendons, columns = state.twist.shape[1], tensions.size, deviations.size
    work = rod_work(tensions, count, tables.elements.step.size, 0)
    sign = linearise(tables, tensions, tip_wrench, state, is_known, system, work)
    if sign == 0:
        return 0
    change, left = np.empty((6, 4, count)), np.empty((columns, 4, count))
    respond_at_tip(tables.elements, state, system, change, work)
    weigh(tables, change)
    find_imbalance(
        tables.sections, parameters, tables.elements.quadrature, tensions, state.twist,
        np.empty(IMBALANCE_ROWS), np.empty((tendons, 4, count)), left, np.empty(tendons),
    )  # fmt: skip
    tip = np.dot(change.reshape(6, 4 * count), left.reshape(columns, 4 * count).T)
    for column in range(columns):
        variance = deviations[column] ** 2
        for i in range(6):
            for k in range(6):
                covariance[i, k] += variance * (tip[i, column] * tip[k, column])
    return sign


@borrows
def respond_at_tip(
    tables: ElementTables, state: RodState, system: System, change: FloatArray, work: RodWork
) -> None:
    """Fill in the ``change`` of the twist (6, 4, points) under unit wrenches on the tip.

    Rows 0 to 2 belong to forces along the axes of base_frame, 3 to 5 to moments about them. The
    ``state`` is the equilibrium that the ``system`` is linearised about.
    """
    imbalance = work.there.imbalance
    for axis in range(3):
        find_wrench_of_tip_force(tables, state, axis, imbalance, work.rows)
        find_step(tables, system, imbalance, change[axis], work.turn, work)
    imbalance[:] = 0.0
    for axis in range(3):
        find_response_to_moment(tables, system, axis, imbalance, change[3 + axis], work.turn, work)
