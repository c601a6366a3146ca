"""Kernels that integrate the twist at nodes to the poses of stations, as `rod.kinematics`."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.models.arm_tables import GridTables
from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.quaternion import displacement, product
from octo_arm_model.core.rod.kinematics import (
    commutator,
    commutator_weight,
    exponential,
    mean_twist,
)


def integrate_twist(
    grid: GridTables, twist: FloatArray, position: FloatArray, quaternion: FloatArray
) -> None:
    """Fill in ``position`` (stations, 3) and ``quaternion`` (stations, 4) from the ``twist``."""
    base, intervals = grid.base, grid.step.size
    mean, motion = np.empty(4), np.empty((intervals, 8))
    for first in range(intervals):
        last, middle, step = first + 1, intervals + 1 + first, grid.step[first]
        for k in range(4):
            mean[k] = mean_twist(twist[k, first], twist[k, middle], twist[k, last], step)
        x, y, z, q, r = commutator(
            twist[0, first], twist[1, first], twist[2, first], twist[3, first],
            twist[0, last], twist[1, last], twist[2, last], twist[3, last],
        )  # fmt: skip
        factor = commutator_weight(step)
        motion[first] = exponential(
            mean[0] + factor * x, mean[1] + factor * y, mean[2] + factor * z,
            mean[3], factor * q, factor * r,
        )  # fmt: skip
    a, b = complex(base[3], base[4]), complex(base[5], base[6])
    along, aside = 0.0, complex(0.0, 0.0)
    station = 0
    for end in range(intervals + 1):
        if end:
            w, x, y, z, p, q, r, s = motion[end - 1]
            moved = product(a, b, complex(p, q), complex(r, s))
            a, b = product(a, b, complex(w, x), complex(y, z))
            further = displacement(moved[0], moved[1], a, b)
            along, aside = along + further[0], aside + further[1]
        while station < len(position) and grid.station_node[station] == end:
            position[station, 0] = along + base[0]
            position[station, 1] = aside.real + base[1]
            position[station, 2] = aside.imag + base[2]
            quaternion[station, 0], quaternion[station, 3] = a.imag, a.real
            quaternion[station, 1], quaternion[station, 2] = b.real, b.imag
            station += 1


@borrows
def read_out(
    grid: GridTables, twist: FloatArray, strains: FloatArray, position: FloatArray,
    quaternion: FloatArray,
) -> bool:  # fmt: skip
    """Fill in the shape of one arm under a ``twist`` (4, nodes), as `Results` has it.

    Returns:
        Whether the stretch is positive at all nodes.
    """
    integrate_twist(grid, twist, position, quaternion)
    is_fine = True
    for station in range(grid.station_node.size):
        node = grid.station_node[station]
        stretched = twist[3, node]
        for k in range(3):
            strains[k, station] = twist[k, node] / stretched
        strains[3, station] = stretched - 1.0
    for node in range(twist.shape[1]):
        if not twist[3, node] > 0.0:  # also for NaN
            is_fine = False
    return is_fine
