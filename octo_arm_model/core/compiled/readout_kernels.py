"""From the points of a loaded rod to nodes and stations: what `numba_build` compiles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.compiled.dense_kernels import solve_definite
from octo_arm_model.core.compiled.orientation_kernels import find_rotation
from octo_arm_model.core.compiled.products import add_products, add_runs
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.section_kernels import evaluate_sections
from octo_arm_model.core.compiled.state_kernels import RodState
from octo_arm_model.core.hints import FloatArray


class Readings(NamedTuple):
    """What is read out of a loaded rod.

    Attributes:
        twist: at the nodes, (4, nodes).
        strains: at the stations, (4, stations), as `Results` has them.
        position: of the stations [m], (stations, 3).
        quaternion: their orientation x, y, z, w, (stations, 4).
    """

    twist: FloatArray
    strains: FloatArray
    position: FloatArray
    quaternion: FloatArray


def empty_readings(nodes: int, stations: int) -> Readings:
    """Room for readings."""
    return Readings(
        np.empty((4, nodes)), np.empty((4, stations)), np.empty((stations, 3)),
        np.empty((stations, 4)),
    )  # fmt: skip


def read_rod(
    tables: RodTables, tensions: FloatArray, tip_wrench: FloatArray, state: RodState,
    readings: Readings,
) -> None:  # fmt: skip
    """Fill in ``readings`` of a balanced ``state`` under all loads, as `LoadedRod`."""
    s = tables.weights.size
    at_nodes, position, quaternion = readings.twist, readings.position, readings.quaternion
    at_nodes[:] = 0.0
    add_runs(tables.node_runs, tables.to_nodes, s, state.twist, at_nodes)
    # Position, orientation and the moment of the forces.
    rate, total = np.empty((10, s)), np.zeros(10)
    total[:3] = tables.position
    total[3], total[4], total[5], total[6] = (
        tables.base[1], tables.base[2], tables.base[3], tables.base[0],
    )  # fmt: skip
    found, wrench = np.empty((10, len(position))), np.zeros((6, len(position)))
    others = np.empty((6, s))
    done, run = 0, 0
    for element in range(tables.step.size):
        first = element * s
        set_rates(state, first, tables.step[element], rate)
        for k in range(3):
            for i in range(s):
                # What of the moment is no integral of the force, such as moments of point loads.
                others[k, i] = tip_wrench[3 + k] + tables.moment[k, first + i]
                others[3 + k, i] = state.force[k, first + i]
        while run < len(tables.station_runs) and tables.station_runs[run, 0] == element:
            start, count = tables.station_runs[run, 1], tables.station_runs[run, 2]
            within = tables.to_stations[done : done + s * count].reshape(s, count)
            values = tables.at_stations[done : done + s * count].reshape(s, count)
            for k in range(10):
                out = found[k, start : start + count]
                out[:] = total[k]
                add_products(rate[k], within, out)
            for k in range(6):
                add_products(others[k], values, wrench[k, start : start + count])
            run, done = run + 1, done + s * count
        for k in range(10):
            for i in range(s):
                total[k] += tables.weights[i] * rate[k, i]
    for i in range(len(position)):
        square = found[3, i] ** 2 + found[4, i] ** 2 + found[5, i] ** 2 + found[6, i] ** 2
        over = 1.0 / np.sqrt(square)
        for k in range(3):
            position[i, k] = found[k, i]
            wrench[k, i] += total[7 + k] - found[7 + k, i]
        for k in range(4):
            quaternion[i, k] = over * found[3 + k, i]
    balance_stations(tables, tensions, wrench, readings)


def set_rates(state: RodState, first: int, h: float, rate: FloatArray) -> None:
    """Fill in what position, orientation x, y, z, w and moment change by along an element.

    (10, s), over its length ``h``, at the points from ``first`` on.
    """
    twist, rotation, force, half = state.twist, state.rotation, state.force, 0.5 * h
    for i in range(rate.shape[1]):
        at = first + i
        for k in range(3):
            rate[k, i] = h * rotation[k, 0, at] * twist[3, at]
        t, n, m = half * twist[0, at], half * twist[1, at], half * twist[2, at]
        w, x, y, z = state.turn[0, at], state.turn[1, at], state.turn[2, at], state.turn[3, at]
        rate[3, i] = w * t + y * m - z * n
        rate[4, i] = w * n + z * t - x * m
        rate[5, i] = w * m + x * n - y * t
        rate[6, i] = -x * t - y * n - z * m
        rate[7, i] = rate[1, i] * force[2, at] - rate[2, i] * force[1, at]
        rate[8, i] = rate[2, i] * force[0, at] - rate[0, i] * force[2, at]
        rate[9, i] = rate[0, i] * force[1, at] - rate[1, i] * force[0, at]


def balance_stations(
    tables: RodTables, tensions: FloatArray, wrench: FloatArray, readings: Readings
) -> None:
    """Balance the twist at the stations with a ``wrench`` (6, stations) in base_frame.

    As `LoadedRod` does, by one step of Newton's method from what is interpolated.
    """
    count = tables.station_node.size
    twist, left = np.empty((4, count)), np.empty((4, count))
    scale, hessian = np.empty((4, count)), np.empty((4, 4, count))
    turn, rotation = np.empty((4, count)), np.empty((3, 3, count))
    for i in range(count):
        for k in range(4):
            twist[k, i] = readings.twist[k, tables.station_node[i]]
            turn[k, i] = readings.quaternion[i, (k + 3) % 4]
    find_rotation(turn, rotation)
    evaluate_sections(tables.station_sections, tensions, twist, left, hessian, scale)
    for i in range(count):
        left[3, i] = -left[3, i]
        for k in range(3):
            left[k, i] = -left[k, i]
            left[3, i] += rotation[k, 0, i] * wrench[3 + k, i]
            for m in range(3):
                left[k, i] += rotation[m, k, i] * wrench[m, i]
    solve_definite(hessian, left)
    for i in range(count):
        node, stretch = tables.station_node[i], twist[3, i] + left[3, i]
        for k in range(3):
            found = twist[k, i] + left[k, i]
            readings.twist[k, node], readings.strains[k, i] = found, found / stretch
        readings.twist[3, node], readings.strains[3, i] = stretch, stretch - 1.0


def read_changes(
    tables: RodTables, state: RodState, change: FloatArray, turn: FloatArray, pose: FloatArray,
    strain: FloatArray,
) -> None:  # fmt: skip
    """Fill in changes of ``pose`` (stations, 6, columns) and of ``strain`` (stations, 4, columns).

    From a ``change`` of twist (4, points, columns) and the rotation ``turn`` of the cross sections
    (3, points, columns) near a ``state``.
    """
    s, columns, rotation = tables.weights.size, change.shape[2], state.rotation
    rate, total = np.empty((s, 6, columns)), np.zeros(6 * columns)
    flat = rate.reshape(s, 6 * columns)
    found, at_station = np.empty((4, tables.most, columns)), np.empty((4, tables.most))
    done, run = 0, 0
    for element in range(tables.step.size):
        first, h = element * s, tables.step[element]
        for i in range(s):
            at = first + i
            k_0, k_1, k_2, v = change[0, at], change[1, at], change[2, at], change[3, at]
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
            np.dot(within.T, flat, poses)
            for i in range(count):
                out = poses[i]
                for j in range(out.size):
                    out[j] += total[j]
            for k in range(4):
                np.dot(values.T, change[k, first : first + s], found[k, :count])
                row = at_station[k, :count]
                row[:] = 0.0
                add_products(state.twist[k, first : first + s], values, row)
            for i in range(count):
                over, more = 1.0 / at_station[3, i], found[3, i]
                strain[start + i, 3] = more
                for k in range(3):
                    omega = over * at_station[k, i]
                    out, here = strain[start + i, k], found[k, i]
                    for j in range(columns):
                        out[j] = over * (here[j] - omega * more[j])
            run, done = run + 1, done + s * count
        for i in range(s):
            weight, rates = tables.weights[i], flat[i]
            for j in range(total.size):
                total[j] += weight * rates[j]
