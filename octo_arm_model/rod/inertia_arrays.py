"""The node functions of a rod that moves over whole arrays; `inertia_loops` has them for numba."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.rotations import dot
from octo_arm_model.rod.section_arrays import LAST, NEXT, cross

# Columns of `MotionTables.section`.
MASS, ROTARY_N, ROTARY_B, DISPLACED, ADDED, ACROSS, ALONG = range(7)
# Columns of the place of a node: its position and the axes t, n and b of its section.
POSITION, TANGENT, COLUMNS = slice(0, 3), slice(3, 6), 12


class MotionTables(NamedTuple):
    """What does not change while an arm moves.

    Attributes:
        from_base: matrix of integrals from the base to each node, (N, N) in columns [m].
        to_tip: the same from each node to the tip.
        section: per reference length, rho A [kg/m], rho times the second moments of area across
            which n and b point [kg m], the mass of the displaced water and the added one [kg/m],
            and factors of the drag, see `inertia` (1): rho_w R C_n and rho_w R (pi C_t / 2 - C_n)
            [kg/m^2], (N, 7).
        in_water: whether any of the last four is not zero.
        viscous: D of the sections, (N, m).
    """

    from_base: FloatArray
    to_tip: FloatArray
    section: FloatArray
    in_water: bool
    viscous: FloatArray


class TimeRule(NamedTuple):
    """Velocities and accelerations as linear functions of what the rod is, x.

    Those of places are by_velocity x - velocity and by_acceleration x - acceleration.

    Attributes:
        by_velocity: [1/s].
        by_acceleration: [1/s^2].
        velocity: (N, 12).
        acceleration: (N, 12).
        twist_rate: as `velocity`, of twists, (N, m).
        water: velocity of the water [m/s] and its acceleration [m/s^2], (2, 3).
    """

    by_velocity: float
    by_acceleration: float
    velocity: FloatArray
    acceleration: FloatArray
    twist_rate: FloatArray
    water: FloatArray


class Motion(NamedTuple):
    """How the nodes move, (N, 12) each, and what that exerts.

    Attributes:
        place: positions in base_frame [m] and axes of the sections [-].
        velocity: of these.
        acceleration: of these.
        load: force and moment of inertia and water beyond each node, (2, N, 3) [N, N m].
    """

    place: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    load: FloatArray


def moving_loads(
    tables: MotionTables, rule: TimeRule, base: FloatArray, slope: FloatArray,
    rotation: FloatArray, motion: Motion,
) -> None:  # fmt: skip
    """Fill in the ``motion`` of a rod of derivatives r', ``slope``, and ``rotation`` of sections.

    ``base`` (3,) is the position of its base [m].
    """
    place, velocity, acceleration, load = motion
    place[:, POSITION] = tables.from_base @ slope + base
    place[:, 3:].reshape(-1, 3, 3)[...] = rotation.swapaxes(1, 2)
    np.subtract(rule.by_velocity * place, rule.velocity, out=velocity)
    np.subtract(rule.by_acceleration * place, rule.acceleration, out=acceleration)
    mass, _, _, displaced, added, across, along = tables.section.T[..., np.newaxis]
    # The cross products n x n'' + b x b'' are the antisymmetric part of n n''^T + b b''^T.
    axes, turned = (one[:, 6:].reshape(-1, 2, 3) for one in (place, acceleration))
    axes = axes * tables.section[:, ROTARY_N : ROTARY_B + 1, np.newaxis]
    turn = axes.swapaxes(1, 2) @ turned
    moment = turn[:, LAST, NEXT] - turn[:, NEXT, LAST]
    force = -mass * acceleration[:, POSITION]
    if tables.in_water:
        (u, rate), t, dt = rule.water, place[:, TANGENT], velocity[:, TANGENT]
        w, a = velocity[:, POSITION] - u, acceleration[:, POSITION] - rate
        tw, pull = dot(t, w), dot(t, a) + dot(dt, w)
        force -= added * (a - tw * dt - pull * t)
        force -= np.sqrt(dot(w, w)) * (across * w + along * tw * t)
        force += displaced * rate
        moment -= added * tw * cross(t, w)
    load[0], load[1] = tables.to_tip @ force, tables.to_tip @ moment


def imbalance(
    viscous: FloatArray, rate: FloatArray, reference: FloatArray, residual: FloatArray,
    scale: FloatArray,
) -> float:  # fmt: skip
    """Add viscosity to the ``residual`` and return the largest, NaN if one is none.

    Of the ``viscous`` coefficients and the ``rate`` of twists, (N, m); over `Work.scale` and a
    ``reference`` moment and force, (m,).
    """
    residual[:] += viscous * rate
    scale = scale[:, np.arange(rate.shape[1]) // 3] + reference
    return float((np.abs(residual) / scale).max())
