"""Kernels that evaluate a loaded rod at nodes and stations from its collocation points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.loaded.orientation_kernels import (
    find_rate,
    find_rotation,
    normalise,
)
from octo_arm_model.core.compiled.loaded.rod_state import RodState, RodWork
from octo_arm_model.core.compiled.loaded.rod_tables import RodTables
from octo_arm_model.core.compiled.loaded.state_kernels import into_axes
from octo_arm_model.core.compiled.numerics.dense_kernels import solve_definite
from octo_arm_model.core.compiled.numerics.products import (
    add_products,
    add_run,
    add_runs,
    multiply,
)
from octo_arm_model.core.compiled.numerics.references import borrows, inlined
from octo_arm_model.core.compiled.section.section_kernels import evaluate_blocks
from octo_arm_model.core.hints import FloatArray


class Readings(NamedTuple):
    """Shape of a loaded rod at nodes and stations.

    Attributes:
        twist: twist at the nodes, (4, nodes).
        strains: strains at the stations as in `Results`: the curvatures over the stretch and the
            stretch less 1, (4, stations).
        position: position of the stations [m], (stations, 3).
        quaternion: orientation x, y, z, w of the stations, (stations, 4).
    """

    twist: FloatArray
    strains: FloatArray
    position: FloatArray
    quaternion: FloatArray


def empty_readings(nodes: int, stations: int) -> Readings:
    """Uninitialised `Readings`."""
    return Readings(
        np.empty((4, nodes)), np.empty((4, stations)), np.empty((stations, 3)),
        np.empty((stations, 4)),
    )  # fmt: skip


@borrows
def read_rod(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, state: RodState,
    readings: Readings, work: RodWork,
) -> None:  # fmt: skip
    """Fill in the ``readings`` of an equilibrium ``state`` under all loads.

    The compiled counterpart of `loaded.read_out`. Twist, forces and moments are interpolated from
    the collocation points, positions and orientations integrated from the base. At the stations
    the twist is then corrected by one Newton step, see `balance_stations`.
    """
    s, count = tables.elements.weights.size, tables.station_node.size
    readings.twist[:] = 0.0
    add_runs(tables.node_runs, tables.to_nodes, s, state.twist, readings.twist)
    # Position, orientation and the moment of the forces, integrated from the base.
    rate, total, room = work.rate[:10], work.total, work.stations
    set_rates(tables.elements.lengths, state, work.rate)
    for k in range(3):
        total[k], total[7 + k] = tables.position[k], 0.0
    for k in range(4):
        total[3 + k] = tables.elements.base[k]
    found, force, moment = room[:10], room[10:13], room[13:16]
    room[10:16] = 0.0
    done, run = 0, 0
    for element in range(tables.elements.step.size):
        first = element * s
        while run < len(tables.station_runs) and tables.station_runs[run, 0] == element:
            start, size = tables.station_runs[run, 1], tables.station_runs[run, 2]
            for k in range(10):
                for i in range(start, start + size):
                    found[k, i] = total[k]
            add_run(tables.to_stations, done, s, size, rate, first, found, start)
            # The free moments, such as those of point loads, have no levers to integrate.
            add_run(tables.at_stations, done, s, size, tables.moment, first, moment, start)
            add_run(tables.at_stations, done, s, size, state.force, first, force, start)
            run, done = run + 1, done + s * size
        for k in range(10):
            for i in range(s):
                total[k] += tables.elements.weights[i] * rate[k, first + i]
    normalise(found[3:7])
    for k in range(3):
        beyond, out, lever = tip_wrench[3 + k] + total[7 + k], moment[k], found[7 + k]
        for i in range(count):
            out[i] += beyond - lever[i]
    for i in range(count):
        for k in range(3):
            readings.position[i, k] = found[k, i]
            readings.quaternion[i, k] = found[4 + k, i]
        readings.quaternion[i, 3] = found[3, i]
    balance_stations(tables, tensions, force, moment, found[3:7], readings, work)


@borrows
def set_rates(lengths: FloatArray, state: RodState, rate: FloatArray) -> None:
    """Fill in ``rate`` (11, points), the derivatives of position, orientation and moment.

    Rows 0 to 2 belong to the position, 3 to 6 to the quaternion w, x, y, z and 7 to 9 to the
    moment of the forces. Derivatives are by arc length, times ``lengths`` (points,), the length of
    the element of each point; row 10 is half of that.
    """
    twist, force, stretch = state.twist, state.force, state.twist[3]
    for k in range(3):
        tangent, moved = state.rotation[k, 0], rate[k]
        for i in range(moved.size):
            moved[i] = lengths[i] * tangent[i] * stretch[i]
    half = rate[10]
    for i in range(half.size):
        half[i] = 0.5 * lengths[i]
    find_rate(twist, half, state.turn, rate[3:7])
    for k in range(3):
        n, m = (k + 1) % 3, (k + 2) % 3
        x_n, x_m, f_n, f_m, out = rate[n], rate[m], force[n], force[m], rate[7 + k]
        for i in range(out.size):
            out[i] = x_n[i] * f_m[i] - x_m[i] * f_n[i]


@borrows
@inlined
def balance_stations(
    tables: RodTables, tensions: FloatArray, force: FloatArray, moment: FloatArray,
    turn: FloatArray, readings: Readings, work: RodWork,
) -> None:  # fmt: skip
    """Fill in twist and strains at the stations by one Newton step from the interpolated twist.

    The step solves the equilibrium of each cross section under the ``force`` and ``moment`` (3,
    stations) of the loads beyond it, in base_frame. ``turn`` (4, stations) are the quaternions of
    the cross sections. The corrected twist overwrites that of the stations' nodes in ``readings``.
    """
    count, nodes, room = tables.station_node.size, tables.station_node, work.stations[16:]
    twist, left, gradient, scale = room[:4], room[4:8], room[8:12], room[12:16]
    hessian, rotation = room[16:32].reshape(4, 4, count), room[32:].reshape(3, 3, count)
    for k in range(4):
        out, at_nodes = twist[k], readings.twist[k]
        for i in range(count):
            out[i] = at_nodes[nodes[i]]
    find_rotation(turn, rotation)
    evaluate_blocks(
        tables.station_sections, tensions, twist, gradient, hessian, scale, work.sections
    )
    into_axes(rotation, force, moment, left)
    left -= gradient
    solve_definite(hessian, left)
    twist += left
    for k in range(4):
        found, at_nodes, strain, stretch = (
            twist[k],
            readings.twist[k],
            readings.strains[k],
            twist[3],
        )
        for i in range(count):
            at_nodes[nodes[i]] = found[i]
        for i in range(count):
            strain[i] = found[i] / stretch[i] if k < 3 else found[i] - 1.0


def read_changes(
    tables: RodTables, state: RodState, change: FloatArray, turn: FloatArray, pose: FloatArray,
    strain: FloatArray,
) -> None:  # fmt: skip
    """Fill in changes of ``pose`` (stations, 6, columns) and of ``strain`` (stations, 4, columns).

    They follow, linearised about a ``state``, from the ``change`` of the twist (4, points,
    columns) and the small rotations ``turn`` of the cross sections (3, points, columns) [rad]. The
    first three rows of a pose are the displacement [m], the others the rotation [rad], both in
    base_frame.
    """
    s, columns, rotation = tables.elements.weights.size, change.shape[2], state.rotation
    rate, total = np.empty((s, 6, columns)), np.zeros(6 * columns)
    local, found = np.empty((s, 4, columns)), np.empty((tables.most, 4, columns))
    flat, flat_local = rate.reshape(s, 6 * columns), local.reshape(s, 4 * columns)
    flat_found, at_station = found.reshape(tables.most, 4 * columns), np.empty((4, tables.most))
    done, run = 0, 0
    for element in range(tables.elements.step.size):
        first, h = element * s, tables.elements.step[element]
        for i in range(s):
            at = first + i
            local[i] = change[:, at]
            k_0, k_1, k_2, v = local[i, 0], local[i, 1], local[i, 2], local[i, 3]
            for p in range(3):
                n, m = (p + 1) % 3, (p + 2) % 3
                a, b, c = h * rotation[p, 0, at], h * rotation[p, 1, at], h * rotation[p, 2, at]
                d = h * state.twist[3, at] * rotation[m, 0, at]
                e = h * state.twist[3, at] * rotation[n, 0, at]
                t_n, t_m = turn[n, at], turn[m, at]
                moved, angular = rate[i, p], rate[i, 3 + p]
                for j in range(columns):
                    angular[j] = a * k_0[j] + b * k_1[j] + c * k_2[j]
                for j in range(columns):
                    moved[j] = a * v[j] + d * t_n[j] - e * t_m[j]
        while run < len(tables.station_runs) and tables.station_runs[run, 0] == element:
            start, count = tables.station_runs[run, 1], tables.station_runs[run, 2]
            within = tables.to_stations[done : done + s * count].reshape(s, count)
            values = tables.at_stations[done : done + s * count].reshape(s, count)
            poses = pose[start : start + count].reshape(count, 6 * columns)
            multiply(within, flat, poses)
            for i in range(count):
                out = poses[i]
                for j in range(out.size):
                    out[j] += total[j]
            multiply(values, flat_local, flat_found[:count])
            for k in range(4):
                row = at_station[k, :count]
                row[:] = 0.0
                add_products(state.twist[k, first : first + s], values, row)
            for i in range(count):
                over, more = 1.0 / at_station[3, i], found[i, 3]
                strain[start + i, 3] = more
                for k in range(3):
                    omega = over * at_station[k, i]
                    out, here = strain[start + i, k], found[i, k]
                    for j in range(columns):
                        out[j] = over * (here[j] - omega * more[j])
            run, done = run + 1, done + s * count
        for i in range(s):
            weight, rates = tables.elements.weights[i], flat[i]
            for j in range(total.size):
                total[j] += weight * rates[j]
