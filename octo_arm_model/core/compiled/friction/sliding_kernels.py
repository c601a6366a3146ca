"""Kernels for the equilibrium of arms without loads whose tendons have friction.

They are the compiled counterpart of `sliding.sliding_balance` and `models.sliding`. Only the
tendons under tension, ``pulled``, are considered.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.friction.coupling_kernels import (
    HESSIAN,
    follow_tensions,
    improve,
)
from octo_arm_model.core.compiled.friction.friction_kernels import (
    find_responses,
    find_turnings,
    multiply_rows,
    remembered,
    resolves_tensions,
    state_in,
)
from octo_arm_model.core.compiled.friction.friction_tables import FrictionTables
from octo_arm_model.core.compiled.friction.placing_kernels import place_tendons
from octo_arm_model.core.compiled.friction.turning_kernels import (
    add_up,
    change_rates,
    set_kept,
    set_tensions,
)
from octo_arm_model.core.compiled.loaded.resolution_kernels import resolves_twist
from octo_arm_model.core.compiled.models.arm_tables import GridTables
from octo_arm_model.core.compiled.models.frame_kernels import read_out
from octo_arm_model.core.compiled.numerics.products import add_runs
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.compiled.section.minimum_kernels import (
    LEFT,
    NEXT_T,
    ROWS,
    find_next,
    is_least,
    set_twist,
)
from octo_arm_model.core.compiled.section.section_kernels import set_scales, unscale
from octo_arm_model.core.compiled.section.section_rows import OFFSET_LEFT, TT, T, set_strain
from octo_arm_model.core.compiled.section.section_tables import LANES, SectionTables
from octo_arm_model.core.compiled.section.sheath_kernels import OFFSET_TOLERANCE, are_inside
from octo_arm_model.core.compiled.section.start_kernels import set_start
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.sliding.friction import NO_FRICTION
from octo_arm_model.core.loaded.sliding.sliding_balance import CHANGED, MOST, has_converged
from octo_arm_model.core.section.newton import TOLERANCE
from octo_arm_model.core.section.paper_balance import mixed_curvatures, routed_torsion, stretch

# Most Newton steps for cross sections before the angles of the tendons are computed anew.
SECTION_STEPS = 2
# Relative residual before a step at which that step is the last of these, unless tensions have
# converged.
ROUGH = 1e-4
# Relative residual of cross sections before a Newton step, whose square is rounding: tensions that
# have converged need no more.
SQUARED = 1e-9
NEAR = 1e-6  # relative residual up to which converged tensions are not computed anew
SLOW = 2  # number of the sweep from a known balance in which its derivatives are computed anew
UNRESOLVED = -2  # value of ``iterations`` where the elements are too coarse


@borrows
def find_closed_form(
    along: FloatArray, path_x: FloatArray, path_y: FloatArray, slope_x: FloatArray,
    slope_y: FloatArray, axial: FloatArray, squared: FloatArray, torsion: FloatArray,
    pulled: IntArray, twist: FloatArray,
) -> None:  # fmt: skip
    """Fill in the ``twist`` (4, sections) of the closed form under tensions ``along``.

    The compiled counterpart of `ClosedForm`. ``along`` (tendons, sections) are the tensions at the
    sections [N]; paths, slopes and stiffnesses are those of `SectionTables`.
    """
    for i in range(twist.shape[1]):
        pull, n, b, nn, bb, mixed, routing = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for tendon in pulled:
            tension, x, y = along[tendon, i], path_x[tendon, i], path_y[tendon, i]
            pull, n, b = pull + tension, n + tension * x, b + tension * y
            nn, bb, mixed = nn + tension * x * x, bb + tension * y * y, mixed + tension * x * y
            routing += tension * (x * slope_y[tendon, i] - y * slope_x[tendon, i])
        xi, k = mixed_curvatures(n, b, nn, bb, mixed, 0.25 * axial[i] * squared[i])
        tau = routed_torsion(routing, nn, bb, torsion[i])
        stretched = stretch(xi, k, pull, n, b, axial[i])
        twist[0, i], twist[1, i], twist[2, i] = stretched * tau, stretched * xi, stretched * k
        twist[3, i] = stretched


@borrows
def find_sections(
    sections: SectionTables, is_exact: bool, ones: FloatArray, pulled: IntArray, is_guess: bool,
    is_kept: bool, twist: FloatArray, offsets: FloatArray, hessian: FloatArray, rows: FloatArray,
) -> tuple[float, bool]:  # fmt: skip
    """Update the ``twist`` (4, points) of cross sections under the tensions at the points.

    The tensions are the ``transmission`` of the ``sections``, for tensions ``ones`` at the base.
    For exact sections the twist is updated by one Newton step or, if ``is_guess``, replaced by the
    initial estimate of `set_start`. For others it is evaluated in closed form. The ``offsets`` of
    the tendons in their sheaths are updated as well. If ``is_kept`` the ``hessian`` (`HESSIAN`,
    points) at the twist before the step is filled in; ``rows`` is scratch space.

    Returns:
        Relative residual before the step, NaN where a state is impossible; and whether no fibre is
        compressed to nothing, no tendon pressed out of the body and the energy at a minimum.
    """
    residual, is_possible = 0.0, True
    if not is_exact:
        find_closed_form(
            sections.transmission, sections.x, sections.y, sections.dx, sections.dy,
            sections.axial, sections.squared, sections.torsion, pulled, twist,
        )  # fmt: skip
    for block in range(len(sections.blocks)):
        first, count = sections.blocks[block]
        own = twist[:, first : first + count]
        if is_guess and is_exact:
            set_start(sections, block, ones, pulled, rows)
            is_possible = set_twist(sections, block, rows, own) and is_possible
            continue
        if not (is_exact or is_kept):
            continue
        set_strain(sections.widens, own[0], own[1], own[2], own[3], rows)
        set_scales(sections, block, ones, pulled, rows)
        find_next(sections, block, ones, pulled, rows, offsets[block])
        if is_exact:
            for i in range(count):
                left = rows[LEFT + i]
                residual = max(residual, left) if np.isfinite(left) else np.nan
            if offsets.size:
                for i in range(count):
                    left = rows[OFFSET_LEFT + i] * (TOLERANCE / OFFSET_TOLERANCE)
                    residual = max(residual, left)
                is_possible = (
                    is_least(count, rows)
                    and are_inside(sections, block, pulled, offsets[block])
                    and is_possible
                )
        if is_kept:
            unscale(count, own[0], own[1], own[2], rows)
            for k in range(HESSIAN):
                for i in range(count):
                    hessian[k, first + i] = rows[TT + k * LANES + i]
        if is_exact:
            for i in range(4 * LANES):
                rows[T + i] += rows[NEXT_T + i]
            is_possible = set_twist(sections, block, rows, own) and is_possible
    return residual, is_possible


def slide(
    tables: FrictionTables, tensions: FloatArray, before: FloatArray, known: FloatArray,
    memory: FloatArray,
) -> tuple[float, int, bool]:  # fmt: skip
    """Find the tensions along tendons with friction and the twist of an arm without loads.

    The compiled counterpart of `sliding_balance.balance`. ``tensions`` (tendons,) are those at the
    base and ``before`` (tendons, points) those along the tendons before [N]. Fills in the tensions
    at the points as the ``transmission`` of the sections, and the twist as ``memory[:4]``. Each
    sweep computes the tensions from the angles by which tendons have turned, takes Newton steps
    for the cross sections and improves the angles.

    On return ``memory`` (`remembered`, points) has the twist, the angles and their derivatives,
    which predict the equilibrium under similar tensions. ``known`` is the memory of such an
    equilibrium, with the tensions ``before``; size 0 for none.

    Returns:
        The relative residual of the cross sections before their last step; the number of sweeps,
        -1 where no equilibrium was found; and whether any tendon sticks.
    """
    pulled, ones = np.flatnonzero(tensions), np.ones(tensions.size)
    sections, twist, is_known = tables.sections, memory[:4], known.size > 0
    turning, rows = state_in(tables, pulled, memory), np.zeros(ROWS)
    part, along, coefficient = tables.transmission, turning.along, turning.coefficient
    angle, kept, slip, change = turning.angle, turning.kept, turning.slip, turning.change
    reach, across, by_pull, turned = turning.reach, turning.across, turning.by_pull, turning.turned
    few, quadrature = turning.few, turning.quadrature
    last, left, is_found = 0.0, 0.0, False
    if is_known:
        memory[:], along[:] = known, before
        set_tensions(tensions, before, pulled, reach, part, kept, along, slip, change)
        moved = np.zeros((4, twist.shape[1]))
        follow_tensions(reach, by_pull, change, moved)
        twist += moved
        change_rates(reach, across, moved, turning.rate)
        multiply_rows(turning.rate, tables.from_start_columns, turned)
        add_up(reach, tables.step, quadrature, turning.rate, turned)
        turned += angle
        left = improve(
            coefficient, pulled, reach, along, quadrature, slip, across, by_pull, turned, few,
            angle,
        )  # fmt: skip
        set_kept(coefficient, pulled, reach, angle, turned, np.inf, kept)
    else:
        along[:], angle[:], kept[:] = 0.0, 0.0, 1.0
    for number in range(MOST):
        sticks = set_tensions(tensions, before, pulled, reach, part, kept, along, slip, change)
        if is_known or number:
            follow_tensions(reach, by_pull, change, twist)
        else:
            find_sections(
                sections, tables.is_exact, ones, pulled, True, False, twist, turning.offset,
                turning.hessian, rows,
            )  # fmt: skip
        # The derivatives by the tensions hardly change, so that few sweeps compute them anew.
        responds = number == SLOW and not is_found if is_known else number <= 1
        residual, is_possible = 0.0, True
        for _ in range(SECTION_STEPS):
            residual, is_possible = find_sections(
                sections, tables.is_exact, ones, pulled, False, responds, twist, turning.offset,
                turning.hessian, rows,
            )  # fmt: skip
            if residual <= (SQUARED if is_found else ROUGH):
                break
        if is_found and residual <= SQUARED:
            return residual, number if is_possible else -1, sticks
        if is_found and residual <= NEAR:
            continue
        if turning.offset.size:
            place_tendons(sections, twist, pulled, turning.offset, turning.place)
        find_turnings(turning, twist)
        if responds:
            find_responses(turning, twist)
        if number == 0 and not is_known:
            for k in range(pulled.size):
                mu = max(coefficient[pulled[k]], NO_FRICTION)
                for i in range(reach[k]):
                    angle[k, i] = np.log1p(mu * turned[k, i]) / mu
            set_kept(coefficient, pulled, reach, angle, turned, np.inf, kept)
            continue
        last = left
        left = improve(
            coefficient, pulled, reach, along, quadrature, slip, across, by_pull, turned, few,
            angle,
        )  # fmt: skip
        if np.isnan(left):
            break
        set_kept(coefficient, pulled, reach, angle, turned, left, kept)
        is_found = has_converged(left, last)
    return np.inf, -1, False


@borrows
def is_near(known: FloatArray, before: FloatArray, tensions: FloatArray, pulled: IntArray) -> bool:
    """Whether the ``known`` memory of `slide` predicts an equilibrium under ``tensions``.

    The compiled counterpart of `Slid.is_near`: the tensions (tendons,) of the tendons ``pulled``
    must be within `CHANGED` of those at the base before, and ``known`` must be of as many tendons.
    ``before`` (tendons, points) are the tensions of the known equilibrium.
    """
    if len(known) != remembered(pulled.size):
        return False
    for tendon in pulled:
        at_base = before[tendon, 0]
        if not abs(tensions[tendon] - at_base) <= CHANGED * at_base:
            return False
    return True


@borrows
def resolves(tables: FrictionTables, pulled: IntArray, twist: FloatArray) -> bool:
    """Whether the elements resolve the ``twist`` (4, points) and the tensions along tendons."""
    return resolves_tensions(tables, pulled) and resolves_twist(tables.tail, tables.step, twist)


def find_sliding_shapes(
    tables: FrictionTables, grid: GridTables, tensions: FloatArray, before: FloatArray,
    twist: FloatArray, strains: FloatArray, position: FloatArray, quaternion: FloatArray,
    residual: FloatArray, iterations: IntArray, points: FloatArray, stations: FloatArray,
    known: FloatArray, memory: FloatArray,
) -> int:  # fmt: skip
    """Fill in the shapes of arms without loads whose tendons have friction.

    ``tensions`` (batch, tendons) are those at the base. The results of `paper_kernels.find_shapes`
    are filled in, and the tensions at the ``points`` (tendons, points) of the last arm and at the
    ``stations`` (batch, stations, tendons) [N]; the latter must be zero on entry. ``before``,
    ``known`` and ``memory`` are those of `slide`. Where the elements do not resolve twist or
    tensions and there are finer ones, ``iterations`` are `UNRESOLVED`.

    Returns:
        Number of arms without solution: their ``iterations`` are negative.
    """
    without, count = 0, tables.transmission.shape[1]
    s, nothing = len(tables.end_columns), np.zeros((0, 0))
    for arm in range(len(tensions)):
        own, sweeps, sticks = tensions[arm], -1, False
        pulled = np.flatnonzero(own)
        found = memory if memory.size else np.empty((remembered(pulled.size), count))
        at_points = found[:4]
        if is_near(known, before, own, pulled):
            residual[arm], sweeps, sticks = slide(tables, own, before, known, found)
        if sweeps < 0:
            residual[arm], sweeps, sticks = slide(tables, own, before, nothing, found)
        iterations[arm] = sweeps
        if iterations[arm] < 0:
            without += 1
            continue
        if not (tables.is_finest or sticks or resolves(tables, pulled, at_points)):
            iterations[arm] = UNRESOLVED
            without += 1
            continue
        points[:] = tables.sections.transmission
        along, at_stations = points[pulled], np.zeros((pulled.size, stations.shape[1]))
        add_runs(tables.station_runs, tables.to_stations, s, along, at_stations)
        for number in range(pulled.size):
            for station in range(stations.shape[1]):
                stations[arm, station, pulled[number]] = at_stations[number, station]
        if tables.is_exact:
            twist[:] = 0.0
            add_runs(tables.runs, tables.to_nodes, s, at_points, twist)
        else:
            paths, stiffness = tables.node_paths, tables.node_stiffness
            at_nodes = np.zeros(paths[0].shape)
            add_runs(tables.runs, tables.to_nodes, s, points, at_nodes)
            find_closed_form(
                at_nodes, paths[0], paths[1], paths[2], paths[3], stiffness[0], stiffness[1],
                stiffness[2], pulled, twist,
            )  # fmt: skip
        if not read_out(grid, twist, strains[:, arm], position[arm], quaternion[arm]):
            iterations[arm] = -1
            without += 1
    return without
