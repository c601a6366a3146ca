"""Arms and loads for the tests of the rod."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model import (
    Arm,
    Backbone,
    Body,
    DistributedLoad,
    Dynamics,
    Loads,
    Material,
    MotionState,
    PointLoad,
    Section,
)
from octo_arm_model.arm.hints import FloatArray

# A cone with two sections of helical tendons that converge towards the tip.
RUBBER = Material(1.1e5, 0.45, 1080.0)
CONE = Body(0.4, 0.015, 0.006)
HELICES = (
    Section(0.4, 0.008, 0.004, angles=(0.3, 2.0, 4.0), twist=(3.0, -5.0, 1.0)),
    Section(0.25, 0.01, 0.007, angles=(0.0, 1.5, 3.0), twist=(0.0, 4.0, 4.0)),
)


def helical_arm(material: Material = RUBBER, **fields: Any) -> Arm:
    """Return an arm with six tendons in two sections, and other ``fields`` of `Arm`."""
    return Arm(material, CONE, HELICES, **fields)


HELICAL = helical_arm()
# Tensions with large bending [N].
PULL = np.array([[0.3, 0.6, 0.1], [1.0, 0.4, 1.5]])
EVERYTHING = Loads(
    gravity=(0.0, 3.0, -5.0),
    fluid_density=400.0,
    points=(PointLoad(0.15, (0.0, 0.05, 0.02), (1e-4, 0.0, 2e-4)), PointLoad(0.25, (0.02, 0, 0))),
    distributed=(DistributedLoad((0.1, 0.2, 0.3), ((0, 0, 0), (0, 0.3, 0.2), (0, 0, 0.1))),),
)
THIRDS = (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)
# The metal rod of Rao et al. 2021: nickel-titanium, tendons in spacer discs.
METAL = Arm(
    Material.from_moduli(54e9, 54e9 / 2.6, 6450.0),
    Body(0.4, 0.0007, 0.0007, disc_radius=0.011),
    tuple(Section(anchorage, 0.01, 0.01, angles=THIRDS) for anchorage in (0.4, 0.2)),
)


def cylinder(
    length: float = 0.45,
    radius: float = 0.01,
    young: float = 1e5,
    angles: tuple[float, ...] = (0.0, math.pi),
    **fields: Any,
) -> Arm:
    """Return a rubber cylinder with tendons at 0.6 of its radius."""
    section = Section(length, 0.6 * radius, 0.6 * radius, angles=angles)
    return Arm(Material(young, 0.5, 1000.0), Body(length, radius, radius), (section,), **fields)


UNIFORM = cylinder()
WRENCH = np.array([0.01, 0.02, -0.01, 1e-4, -2e-4, 1e-4])
SHEATHED = dataclasses.replace(HELICAL, sheath_stiffness=(3e5, 0.0, 1e6, 4e5, 5e5, 6e5))


def mapped(loads: Loads, change: Callable[[FloatArray], FloatArray]) -> Loads:
    """Return ``loads`` with ``change`` applied to each vector."""

    def map_(vector: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(change(np.array(vector)).tolist())

    return Loads(
        map_(loads.gravity),
        loads.fluid_density,
        map_(loads.tip_force),
        map_(loads.tip_moment),
        tuple(PointLoad(load.s, map_(load.force), map_(load.moment)) for load in loads.points),
        tuple(DistributedLoad(load.s, tuple(map(map_, load.force))) for load in loads.distributed),
    )


def scaled(loads: Loads, factor: float) -> Loads:
    """Return ``loads`` times a ``factor``."""
    return mapped(loads, lambda vector: factor * vector)


def tendon_points(arm: Arm, shape: Backbone) -> FloatArray:
    """Return the positions of the tendons at every station, (tendons, stations, 3) [m]."""
    axes = Rotation.from_quat(shape.quaternion).as_matrix()
    offsets = np.einsum('sxa,ajs->jsx', axes[..., 1:], arm.tendon_offsets(shape.s))
    return np.asarray(shape.position + offsets)


def energy(dynamics: Dynamics, state: MotionState) -> float:
    """Return the energy of an arm of the linear law with slack tendons, and of its water [J]."""
    solver, s, weights = dynamics.solver, dynamics.nodes.s, dynamics.nodes.weights
    area = np.pi * solver.arm.body.radius(s) ** 2
    second_moment = area**2 / (4.0 * np.pi)
    mass = solver.arm.material.density * area
    displaced = solver.loads.fluid_density * area
    material = solver.arm.material
    young, shear = material.youngs_modulus_at(s), material.shear_modulus_at(s)
    t, n, b, stretch = state.twist[0].T
    density = young * area * (stretch - 1.0) ** 2 + young * second_moment * (n * n + b * b)
    density += 2.0 * shear * second_moment * t * t
    frames, velocity = state.place[:2].reshape(2, -1, 4, 3)
    v, axial = velocity[:, 0], (velocity[:, 0] * frames[:, 1]).sum(axis=1)
    density += mass * (v * v).sum(axis=1)
    density += mass * area / (4.0 * np.pi) * (velocity[:, 2:] ** 2).sum(axis=(1, 2))
    density += dynamics.properties.added_mass * displaced * ((v * v).sum(axis=1) - axial**2)
    density -= 2.0 * (mass - displaced) * (frames[:, 0] @ np.array(solver.loads.gravity))
    return float(0.5 * weights @ density)
