"""From the points of a loaded rod to nodes and stations: what `numba_build` compiles."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.products import add_products, add_runs
from octo_arm_model.core.compiled.rod_tables import RodTables
from octo_arm_model.core.compiled.state_kernels import RodState
from octo_arm_model.core.hints import ComplexArray, FloatArray


def read_rod(
    tables: RodTables, twist: FloatArray, a: ComplexArray, b: ComplexArray, rotation: FloatArray,
    at_nodes: FloatArray, position: FloatArray, quaternion: FloatArray,
) -> None:  # fmt: skip
    """Fill in twist (4, nodes), position (stations, 3) and orientation, as `LoadedRod`."""
    s = tables.weights.size
    at_nodes[:] = 0.0
    add_runs(tables.node_runs, tables.to_nodes, s, twist, at_nodes)
    rate, total = np.empty((7, s)), np.zeros(7)
    total[:3] = tables.position
    total[3], total[4], total[5], total[6] = (
        tables.base[1], tables.base[2], tables.base[3], tables.base[0],
    )  # fmt: skip
    found = np.empty((7, len(position)))
    done, run = 0, 0
    for element in range(tables.step.size):
        first, half = element * s, 0.5 * tables.step[element]
        for i in range(s):
            at = first + i
            for k in range(3):
                rate[k, i] = 2.0 * half * rotation[k, 0, at] * twist[3, at]
            t, n, m = half * twist[0, at], half * twist[1, at], half * twist[2, at]
            w, x, y, z = a[at].real, a[at].imag, b[at].real, b[at].imag
            rate[3, i] = w * t + y * m - z * n
            rate[4, i] = w * n + z * t - x * m
            rate[5, i] = w * m + x * n - y * t
            rate[6, i] = -x * t - y * n - z * m
        while run < len(tables.station_runs) and tables.station_runs[run, 0] == element:
            start, count = tables.station_runs[run, 1], tables.station_runs[run, 2]
            matrix = tables.to_stations[done : done + s * count].reshape(s, count)
            for k in range(7):
                out = found[k, start : start + count]
                out[:] = total[k]
                add_products(rate[k], matrix, out)
            run, done = run + 1, done + s * count
        for k in range(7):
            for i in range(s):
                total[k] += tables.weights[i] * rate[k, i]
    for i in range(len(position)):
        square = found[3, i] ** 2 + found[4, i] ** 2 + found[5, i] ** 2 + found[6, i] ** 2
        over = 1.0 / np.sqrt(square)
        for k in range(3):
            position[i, k] = found[k, i]
        for k in range(4):
            quaternion[i, k] = over * found[3 + k, i]


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
