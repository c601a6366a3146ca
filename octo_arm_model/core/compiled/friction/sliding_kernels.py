"""Arms without loads whose tendons have friction: what `numba_build` compiles.

As `sliding.sliding_balance` and `models.sliding` have it, of the tendons under tension alone.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.friction.coupling_kernels import (
    find_couplings,
    follow_tensions,
    improve,
)
from octo_arm_model.core.compiled.friction.friction_kernels import (
    TurningState,
    empty_turning,
    find_tensions,
    find_turnings,
    resolves_tensions,
)
from octo_arm_model.core.compiled.friction.friction_tables import FrictionTables
from octo_arm_model.core.compiled.loaded.resolution_kernels import resolves_twist
from octo_arm_model.core.compiled.models.arm_tables import GridTables
from octo_arm_model.core.compiled.models.frame_kernels import read_out
from octo_arm_model.core.compiled.numerics.products import add_runs
from octo_arm_model.core.compiled.section.minimum_kernels import (
    LEFT,
    NEXT_T,
    ROWS,
    find_next,
    is_least,
    set_twist,
)
from octo_arm_model.core.compiled.section.section_kernels import evaluate_sections, set_scales
from octo_arm_model.core.compiled.section.section_rows import OFFSET_LEFT, WIDTH, T, set_strain
from octo_arm_model.core.compiled.section.section_tables import LANES, SectionTables
from octo_arm_model.core.compiled.section.sheath_kernels import OFFSET_TOLERANCE, are_inside
from octo_arm_model.core.compiled.section.start_kernels import set_start
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.loaded.sliding.friction import NO_FRICTION
from octo_arm_model.core.loaded.sliding.sliding_balance import CHANGED, MOST, has_converged
from octo_arm_model.core.section.newton import TOLERANCE
from octo_arm_model.core.section.paper_balance import mixed_curvatures, routed_torsion, stretch

SECTION_STEPS = 2  # of Newton's method for cross sections, before tendons are turned anew
# What is left of the balance, relative, before the last of these.
ROUGH = 1e-4
NEAR = 1e-6  # what is left of the balance, relative, for tensions not to change any more
UNRESOLVED = -2  # instead of a number of iterations


def closed_form(sections: SectionTables, i: int, pulled: IntArray, twist: FloatArray) -> None:
    """Fill in the ``twist`` (4, sections) of section ``i``, as `ClosedForm` has it."""
    pull, n, b, nn, bb, mixed, routing = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for tendon in pulled:
        tension = sections.transmission[tendon, i]
        x, y = sections.x[tendon, i], sections.y[tendon, i]
        pull, n, b = pull + tension, n + tension * x, b + tension * y
        nn, bb, mixed = nn + tension * x * x, bb + tension * y * y, mixed + tension * x * y
        routing += tension * (x * sections.dy[tendon, i] - y * sections.dx[tendon, i])
    bending = 0.25 * sections.axial[i] * sections.squared[i]
    xi, k = mixed_curvatures(n, b, nn, bb, mixed, bending)
    tau = routed_torsion(routing, nn, bb, sections.torsion[i])
    stretched = stretch(xi, k, pull, n, b, sections.axial[i])
    twist[0, i], twist[1, i], twist[2, i] = stretched * tau, stretched * xi, stretched * k
    twist[3, i] = stretched


def find_sections(
    tables: FrictionTables, ones: FloatArray, pulled: IntArray, is_guess: bool,
    twist: FloatArray, offsets: FloatArray, rows: FloatArray,
) -> tuple[float, bool]:  # fmt: skip
    """Bring the ``twist`` (4, points) nearer to balance with the tensions that are at the points.

    By a step of Newton's method, or as `set_start` has it; with the ``offsets`` of tendons in
    their sheaths, see `placing_kernels`. ``rows`` are to work in.

    Returns:
        What was left of the balance before, relative, NaN where there is none, and whether no
        fibre is compressed to nothing, no tendon pressed out of the body and the energy least.
    """
    sections, residual, is_possible = tables.sections, 0.0, True
    if not tables.is_exact:
        for i in range(twist.shape[1]):
            closed_form(sections, i, pulled, twist)
        return residual, True
    for block in range(len(sections.blocks)):
        first, count = sections.blocks[block]
        own = twist[:, first : first + count]
        if is_guess:
            set_start(sections, block, ones, pulled, rows)
        else:
            set_strain(sections.widens, own[0], own[1], own[2], own[3], rows)
            set_scales(sections, block, ones, pulled, rows)
            find_next(sections, block, ones, pulled, rows, offsets[block])
            for i in range(4 * LANES):
                rows[T + i] += rows[NEXT_T + i]
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
        is_possible = set_twist(sections, block, rows, own) and is_possible
    return residual, is_possible


def slide(
    tables: FrictionTables, tensions: FloatArray, before: FloatArray, twist: FloatArray,
    known: FloatArray, memory: FloatArray,
) -> tuple[float, int, bool]:  # fmt: skip
    """Fill in the ``twist`` (4, points) and the tensions at the points, as `balance` does.

    ``memory`` is filled in by `remember` if it has any size, ``known`` that of the balance with
    the tensions ``before`` if it has; then it is near.

    Returns:
        What is left of the balance, relative, number of sweeps, -1 where there is no balance,
        and whether any tendon sticks.
    """
    pulled, ones = np.flatnonzero(tensions), np.ones(tensions.size)
    along, is_known = tables.sections.transmission, known.size > 0
    turning = empty_turning(tables.sections, pulled.size)
    rows = np.zeros(ROWS)
    rows[WIDTH : WIDTH + LANES] = 1.0
    last, left, is_found = 0.0, 0.0, False
    if is_known:
        recall(known, twist, turning)
        along[:] = before
        find_tensions(tables, tensions, before, pulled, turning)
        follow_tensions(tables, turning, twist, True)
        left = improve(tables, pulled, turning)
    else:
        along[:] = 0.0
    for sweep in range(MOST):
        sticks = find_tensions(tables, tensions, before, pulled, turning)
        if is_known or sweep > 1:
            follow_tensions(tables, turning, twist, False)
        elif sweep == 0:
            find_sections(tables, ones, pulled, True, twist, turning.offset, rows)
        residual, is_possible = 0.0, True
        for _ in range(SECTION_STEPS):
            residual, is_possible = find_sections(
                tables, ones, pulled, False, twist, turning.offset, rows
            )
            if residual <= (TOLERANCE if is_found else ROUGH):
                break
        if is_found and residual <= TOLERANCE:
            if memory.size:
                remember(turning, twist, memory)
            return residual, sweep if is_possible else -1, sticks
        if is_found and residual <= NEAR:
            continue
        find_turnings(tables, twist, pulled, turning)
        if sweep == 0 and not is_known:
            for number in range(pulled.size):
                mu = max(tables.coefficient[pulled[number]], NO_FRICTION)
                turning.angle[number] = np.log1p(mu * turning.turned[number]) / mu
            continue
        if sweep == (2 if is_known else 1):
            hessian = np.empty((4, *twist.shape))
            evaluate_sections(
                tables.sections, ones, twist, np.empty(twist.shape), hessian, np.empty(twist.shape)
            )
            find_couplings(tables, twist, hessian, pulled, turning)
        last, left = left, improve(tables, pulled, turning)
        if np.isnan(left):
            break
        is_found = has_converged(left, last)
    return np.inf, -1, False


def is_near(known: FloatArray, before: FloatArray, tensions: FloatArray, pulled: IntArray) -> bool:
    """As `Slid.is_near`, of what is ``known`` of the balance with tensions ``before``."""
    if len(known) != remembered(pulled.size):
        return False
    for tendon in pulled:
        at_base = before[tendon, 0]
        if not abs(tensions[tendon] - at_base) <= CHANGED * at_base:
            return False
    return True


def remembered(pulled: int) -> int:
    """How many numbers at every point `remember` keeps."""
    return 4 + pulled * (5 + pulled)


def parts_of(
    memory: FloatArray, pulled: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Twist, ``angle``, ``by_pull`` and ``coupling`` in ``memory`` (`remembered`, points)."""
    rest = memory[4:].reshape(pulled, 5 + pulled, memory.shape[1])
    return memory[:4], rest[:, 0], rest[:, 1:5], rest[:, 5:]


def remember(turning: TurningState, twist: FloatArray, memory: FloatArray) -> None:
    """Keep the ``twist`` and what is known of ``turning`` in ``memory``, see `parts_of`."""
    kept, angle, by_pull, coupling = parts_of(memory, len(turning.angle))
    kept[:], angle[:], by_pull[:], coupling[:] = (
        twist, turning.angle, turning.by_pull, turning.coupling
    )  # fmt: skip


def recall(memory: FloatArray, twist: FloatArray, turning: TurningState) -> None:
    """Take them from it."""
    kept, angle, by_pull, coupling = parts_of(memory, len(turning.angle))
    twist[:], turning.angle[:] = kept, angle
    turning.by_pull[:], turning.coupling[:] = by_pull, coupling


def resolves(tables: FrictionTables, pulled: IntArray, twist: FloatArray) -> bool:
    """Whether points resolve ``twist`` and `resolves_tensions`, as `LoadedRod.resolves_twist`."""
    return resolves_tensions(tables, pulled) and resolves_twist(tables.tail, tables.step, twist)


def find_sliding_shapes(
    tables: FrictionTables, grid: GridTables, tensions: FloatArray, before: FloatArray,
    may_refine: bool, twist: FloatArray, strains: FloatArray, position: FloatArray,
    quaternion: FloatArray, residual: FloatArray, iterations: IntArray, points: FloatArray,
    stations: FloatArray, known: FloatArray, memory: FloatArray,
) -> int:  # fmt: skip
    """As `paper_kernels.find_shapes`, of tendons with friction.

    Fills in their tensions besides, at the ``points`` (tendons, points) of the last arm and at
    the ``stations`` (batch, stations, tendons), zero at first; ``known`` and ``memory`` are those
    of `slide`. Where finer elements ``may_refine`` what these do not resolve ``iterations`` are
    `UNRESOLVED`.
    """
    without = 0
    at_points = np.empty((4, tables.transmission.shape[1]))
    s, nothing = len(tables.end_columns), np.zeros((0, 0))
    for arm in range(len(tensions)):
        own, sweeps, sticks = tensions[arm], -1, False
        pulled = np.flatnonzero(own)
        if is_near(known, before, own, pulled):
            residual[arm], sweeps, sticks = slide(tables, own, before, at_points, known, memory)
        if sweeps < 0:
            residual[arm], sweeps, sticks = slide(tables, own, before, at_points, nothing, memory)
        iterations[arm] = sweeps
        if iterations[arm] < 0:
            without += 1
            continue
        if may_refine and not sticks and not resolves(tables, pulled, at_points):
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
            tables.at_nodes.transmission[:] = 0.0
            add_runs(tables.runs, tables.to_nodes, s, points, tables.at_nodes.transmission)
            for i in range(twist.shape[1]):
                closed_form(tables.at_nodes, i, pulled, twist)
        if not read_out(grid, twist, strains[:, arm], position[arm], quaternion[arm]):
            iterations[arm] = -1
            without += 1
    return without
