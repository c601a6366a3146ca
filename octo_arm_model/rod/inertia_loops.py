"""The node functions of a rod that moves as loops for numba; `arrays` has them for NumPy."""

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.compiled import compiled, helper
from octo_arm_model.rod.tables import (
    ACROSS,
    ADDED,
    ALONG,
    DISPLACED,
    MASS,
    ROTARY_B,
    ROTARY_N,
    Motion,
    MotionTables,
    TimeRule,
)


def moving_loads(
    tables: MotionTables,
    rule: TimeRule,
    base: FloatArray,
    slope: FloatArray,
    rotation: FloatArray,
    motion: Motion,
) -> None:
    """Compute the ``motion`` of the nodes of a rod, and its loads."""
    along = tables.from_base, tables.to_tip
    before = rule.velocity, rule.acceleration
    factors = rule.by_velocity, rule.by_acceleration, tables.in_water
    _fill_motion(
        along, tables.section, factors, before, rule.water, (base, slope, rotation), tuple(motion)
    )


@compiled
def _fill_motion(
    along: tuple[FloatArray, FloatArray],
    sections: FloatArray,
    factors: tuple[float, float, bool],
    before: tuple[FloatArray, FloatArray],
    water: FloatArray,
    rod: tuple[FloatArray, FloatArray, FloatArray],
    motion: tuple[FloatArray, ...],
) -> None:
    (from_base, to_tip), (by_velocity, by_acceleration, in_water) = along, factors
    (velocities, accelerations), (base, slope, rotation) = before, rod
    place, velocity, acceleration, load = motion
    nodes = place.shape[0]
    position, density, total = np.empty((3, nodes)), np.zeros((nodes, 6)), np.empty((6, nodes))
    relative = np.empty(3)
    _integrate(from_base, slope, position)
    for i in range(nodes):
        for c in range(3):
            place[i, c] = position[c, i] + base[c]
        for a in range(3):
            for c in range(3):
                place[i, 3 + 3 * a + c] = rotation[i, c, a]
        for c in range(12):
            velocity[i, c] = by_velocity * place[i, c] - velocities[i, c]
            acceleration[i, c] = by_acceleration * place[i, c] - accelerations[i, c]
        section, node_place, rates = sections[i], place[i], acceleration[i]
        t = node_place[3:6]
        force, moment = density[i, :3], density[i, 3:]
        for c in range(3):
            force[c] = -section[MASS] * rates[c]
        _add_cross(-section[ROTARY_N], node_place[6:9], rates[6:9], moment)
        _add_cross(-section[ROTARY_B], node_place[9:12], rates[9:12], moment)
        if in_water:
            _add_water(section, water, t, velocity[i], rates, relative, force, moment)
    _integrate(to_tip, density, total)
    for i in range(nodes):
        for c in range(3):
            load[0, i, c], load[1, i, c] = total[c, i], total[3 + c, i]


@helper
def _integrate(matrix: FloatArray, values: FloatArray, out: FloatArray) -> None:
    """Write a ``matrix`` (N, N) in columns times ``values`` (N, k) into ``out`` (k, N)."""
    for c in range(out.shape[0]):
        for i in range(out.shape[1]):
            out[c, i] = 0.0
        for k in range(values.shape[0]):
            value = values[k, c]
            for i in range(out.shape[1]):
                out[c, i] += matrix[i, k] * value


@helper
def _add_cross(part: float, a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    out[0] += part * (a[1] * b[2] - a[2] * b[1])
    out[1] += part * (a[2] * b[0] - a[0] * b[2])
    out[2] += part * (a[0] * b[1] - a[1] * b[0])


@helper
def _add_water(
    section: FloatArray,
    water: FloatArray,
    t: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    w: FloatArray,
    force: FloatArray,
    moment: FloatArray,
) -> None:
    """Add force and moment of the water on one node per reference length, see `inertia`.

    ``w`` (3,) becomes the velocity relative to the water.
    """
    tw, pull, square = 0.0, 0.0, 0.0
    for c in range(3):
        w[c] = velocity[c] - water[0, c]
        tw += t[c] * w[c]
        pull += t[c] * (acceleration[c] - water[1, c]) + velocity[3 + c] * w[c]
        square += w[c] * w[c]
    speed, added = np.sqrt(square), section[ADDED]
    for c in range(3):
        a = acceleration[c] - water[1, c]
        force[c] -= added * (a - tw * velocity[3 + c] - pull * t[c])
        force[c] -= speed * (section[ACROSS] * w[c] + section[ALONG] * tw * t[c])
        force[c] += section[DISPLACED] * water[1, c]
    _add_cross(-added * tw, t, w, moment)
