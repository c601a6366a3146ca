"""Kernels for the first derivatives of a loaded rod: the compiled counterpart of `sensitivity`.

They compute the changes of an equilibrium with the loads, tensions and parameters of the arm, by
solving the linearised system for the wrenches that these leave unbalanced.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.loaded.orientation_kernels import find_rotation
from octo_arm_model.core.compiled.loaded.readout_kernels import read_changes
from octo_arm_model.core.compiled.loaded.response_kernels import respond, tip_wrenches
from octo_arm_model.core.compiled.loaded.rod_state import RodState, rod_work
from octo_arm_model.core.compiled.loaded.rod_tables import ParameterTables, RodTables
from octo_arm_model.core.compiled.loaded.state_kernels import find_state, find_wrench
from octo_arm_model.core.compiled.loaded.system_kernels import System, find_system
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.elastic_laws import (
    incompressible_widening,
    linear_density,
    neo_hookean_density,
)
from octo_arm_model.core.section.formulas import (
    bending_terms,
    offset_direction,
    offset_gradient,
    tendon_direction,
    tendon_gradient,
    unit_change,
    unscaled_gradient,
)


@borrows
def widening(widens: bool, stretch: float) -> tuple[float, float, float]:
    """Widening of a section at ``stretch`` and its first two derivatives by the stretch.

    Sections that do not widen have 1, 0 and 0.
    """
    return incompressible_widening(stretch) if widens else (1.0, 0.0, 0.0)


@borrows
def find_imbalance(
    tables: RodTables, parameters: ParameterTables, tensions: FloatArray, twist: FloatArray,
    stretch: FloatArray, left: FloatArray, first: int, own: FloatArray,
) -> None:  # fmt: skip
    """Fill in ``left`` (4, points, columns), the imbalance per unit of each parameter.

    It is the negative derivative of the section wrench by the parameter at the given ``twist`` (4,
    points). From column ``first`` on the parameters are the tensions, Young's modulus E
    (relative), Poisson's ratio nu and the offsets of the tendons. Also fills in ``own``
    (tendons,), the derivative of each tendon's length by its own offset at constant twist, and
    ``stretch`` (tendons, 4, points), the gradient by the twist of each tendon's stretch.
    """
    sections, tendons = tables.sections, tensions.size
    own[:] = 0.0
    for i in range(twist.shape[1]):
        weight = tables.elements.quadrature[i]
        kappa_t, kappa_n, kappa_b, stretched = twist[0, i], twist[1, i], twist[2, i], twist[3, i]
        width, slope, _ = widening(sections.widens, stretched)
        t, n, b = width * kappa_t, width * kappa_n, width * kappa_b
        squared = sections.squared[i]
        bend = (n * n + b * b) * squared
        if sections.widens:
            f_s, f_z, f_ss, f_sz, f_zz = neo_hookean_density(stretched, bend)
        else:
            f_s, f_z, f_ss, f_sz, f_zz = linear_density(stretched, bend)
        terms = bending_terms(n, b, f_s, f_z, f_ss, f_sz, f_zz, sections.axial[i], squared)
        young = unscaled_gradient(
            kappa_t, kappa_n, kappa_b, width, slope,
            sections.torsion[i] * t, terms[0], terms[1], terms[2],
        )  # fmt: skip
        poisson = unscaled_gradient(
            kappa_t, kappa_n, kappa_b, width, slope, parameters.torsion_by_poisson[i] * t,
            0.0, 0.0, 0.0,
        )  # fmt: skip
        for k in range(4):
            left[k, i, first + tendons] = -young[k]
            left[k, i, first + tendons + 1] = -poisson[k]
        for tendon in range(tendons):
            part, column = sections.transmission[tendon, i], first + tendons + 2 + tendon
            # A tendon that ends before this point has no tension and no length here.
            if part == 0.0:
                for k in range(4):
                    stretch[tendon, k, i] = 0.0
                    left[k, i, first + tendon] = left[k, i, column] = 0.0
                continue
            x, y = sections.x[tendon, i], sections.y[tendon, i]
            dx, dy = sections.dx[tendon, i], sections.dy[tendon, i]
            out_x, out_y = parameters.x[tendon, i], parameters.y[tendon, i]
            out_dx, out_dy = parameters.dx[tendon, i], parameters.dy[tendon, i]
            u_t, u_n, u_b, length = tendon_direction(t, n, b, stretched, width, x, y, dx, dy)
            over = 1.0 / length
            u_t, u_n, u_b = u_t * over, u_n * over, u_b * over
            g_t, g_n, g_b, g_s = tendon_gradient(u_t, u_n, u_b, slope, x, y, dx, dy)
            by_twist = unscaled_gradient(
                kappa_t, kappa_n, kappa_b, width, slope, g_t, g_n, g_b, g_s
            )
            for k in range(4):
                stretch[tendon, k, i] = by_twist[k]
                left[k, i, first + tendon] = -part * by_twist[k]
            c_t, c_n, c_b = offset_direction(t, n, b, width, out_x, out_y, out_dx, out_dy)
            along, c_t, c_n, c_b = unit_change(u_t, u_n, u_b, over, c_t, c_n, c_b)
            g_t, g_n, g_b, g_s = offset_gradient(
                u_t, u_n, u_b, c_t, c_n, c_b, slope, x, y, dx, dy, out_x, out_y, out_dx, out_dy
            )
            own[tendon] += weight * along
            pull = -part * tensions[tendon]
            by_twist = unscaled_gradient(
                kappa_t, kappa_n, kappa_b, width, slope, pull * g_t, pull * g_n, pull * g_b,
                pull * g_s,
            )  # fmt: skip
            for k in range(4):
                left[k, i, column] = by_twist[k]


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
    is_known: bool, system: System,
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
    count, elements = state.twist.shape[1], tables.elements.step.size
    find_state(tables, tensions, tip_wrench, 1.0, state, rod_work(tensions, count, elements, 0))
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
    and the others to the parameters of `find_imbalance`. The ``system`` is given or filled in as
    in `linearise`.

    Returns:
        The sign of the determinant of the system; 0 where it is singular.
    """
    count, columns, tendons = state.twist.shape[1], pose.shape[2], tensions.size
    sign = linearise(tables, tensions, tip_wrench, state, is_known, system)
    if sign == 0:
        return 0
    imbalance, stretch = np.empty((4, count, columns)), np.empty((tendons, 4, count))
    others, first, own = imbalance, 6, np.empty(tendons)
    if len(force):
        dead_wrenches(tables, state, force, moment, imbalance)
        others, first = np.empty((4, count, 2 * tendons + 2)), 0
    else:
        wrench = tip_wrenches(tables.elements, state)
        wrench[:, :, 3:] /= tables.elements.length
        imbalance[:, :, :6] = wrench
    find_imbalance(tables, parameters, tensions, state.twist, stretch, others, first, own)
    change, turn = np.empty((4, count, columns)), np.empty((3, count, columns))
    respond(tables.elements, system, imbalance, change, turn)
    read_changes(tables, state, change, turn, pose, strain)
    weigh(tables, stretch)
    np.dot(stretch.reshape(tendons, 4 * count), change.reshape(4 * count, columns), length)
    if not len(force):
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


def differentiate_tip(
    tables: RodTables, parameters: ParameterTables, tensions: FloatArray, tip_wrench: FloatArray,
    state: RodState, is_known: bool, system: System, tip: FloatArray,
) -> int:  # fmt: skip
    """Fill in the derivatives of the pose of the ``tip`` (6, columns).

    The compiled counterpart of `tip_derivatives`. By reciprocity they are the work of the
    imbalance of each parameter on the changes that unit wrenches on the tip make, so that the
    system is solved for six columns only. Columns of ``tip`` are those of `find_imbalance`;
    ``state`` is an equilibrium, given by twist and orientations.

    Returns:
        The sign of the determinant of the system; 0 where it is singular.
    """
    count, tendons = state.twist.shape[1], tensions.size
    sign = linearise(tables, tensions, tip_wrench, state, is_known, system)
    if sign == 0:
        return 0
    wrench = tip_wrenches(tables.elements, state)
    change = np.empty_like(wrench)
    respond(tables.elements, system, wrench, change, np.empty((3, count, 6)))
    for i in range(count):
        weight = tables.elements.quadrature[i]
        for k in range(4):
            for column in range(6):
                unit = tables.elements.length if column >= 3 else 1.0
                change[k, i, column] *= weight / unit
    stretch, left = np.empty((tendons, 4, count)), np.empty((4, count, tip.shape[1]))
    own = np.empty(tendons)
    find_imbalance(tables, parameters, tensions, state.twist, stretch, left, 0, own)
    np.dot(change.reshape(4 * count, 6).T, left.reshape(4 * count, tip.shape[1]), tip)
    return sign
