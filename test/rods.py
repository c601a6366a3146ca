"""Arms, loads and node values for the tests of the rod."""

import dataclasses
import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model import (
    Arm,
    Backbone,
    Body,
    DistributedLoad,
    Dynamics,
    GivenStiffness,
    Linear,
    Loads,
    Material,
    MotionState,
    PointLoad,
    ProfiledBody,
    RectangularBody,
    RestShape,
    Section,
    Table,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.material import LINEAR
from octo_arm_model.rod import arrays
from octo_arm_model.rod.rod import Rod, Setting

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
# A rubber cylinder with a tendon on either side.
UNIFORM = Arm(
    Material(1e5, 0.5, 1000.0),
    Body(0.45, 0.01, 0.01),
    (Section(0.45, 0.006, 0.006, angles=(0.0, math.pi)),),
)
WRENCH = np.array([0.01, 0.02, -0.01, 1e-4, -2e-4, 1e-4])
TENSIONS = PULL.ravel()
SHEATHED = dataclasses.replace(HELICAL, sheath_stiffness=(3e5, 0.0, 1e6, 4e5, 5e5, 6e5))
# A tapered strip, bent and twisted at rest, with tendons outside it.
STRIP = RectangularBody(HELICAL.length, Linear(0.02, 0.01, HELICAL.length), 0.006, 0.02)
BENT = RestShape(
    Table((0.0, 0.2, HELICAL.length), (4.0, -6.0, 2.0)), 5.0, Linear(-3.0, 2.0, HELICAL.length)
)
CURVED = dataclasses.replace(SHEATHED, body=STRIP, rest=BENT)
GIVEN = GivenStiffness(bending_b=Linear(4e-3, 1e-3, HELICAL.length), torsion=5e-4)
TUBE = ProfiledBody(HELICAL.length, Linear(0.02, 0.01, HELICAL.length), 0.02, 0.006)
CASES: dict[str, tuple[Arm, Setting]] = {
    'linear': (HELICAL, Setting(law=LINEAR)),
    'neo_hookean': (HELICAL, Setting()),
    'shear': (HELICAL, Setting(law=LINEAR, shear=True)),
    'linear in sheaths': (SHEATHED, Setting(law=LINEAR)),
    'neo_hookean in sheaths': (SHEATHED, Setting()),
    'shear in sheaths': (SHEATHED, Setting(law=LINEAR, shear=True)),
    'linear bent strip': (dataclasses.replace(CURVED, stiffness=GIVEN), Setting(law=LINEAR)),
    'neo_hookean bent strip': (CURVED, Setting()),
    'shear bent strip': (CURVED, Setting(law=LINEAR, shear=True)),
    'neo_hookean tube': (dataclasses.replace(HELICAL, body=TUBE, stiffness=GIVEN), Setting()),
}


def rod_of(name: str, loads: Loads = EVERYTHING, compiled: bool = False) -> Rod:
    """Return the rod of a case of `CASES`."""
    arm, setting = CASES[name]
    return Rod(arm, loads, setting=setting._replace(compiled=compiled))


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


def twists_at(s: FloatArray, strains: int) -> FloatArray:
    """Return smooth twists (n, strains) that are not in equilibrium."""
    z = np.zeros((s.size, strains))
    z[:, 0] = 2.0 * np.sin(6.0 * s)
    z[:, 1] = 3.0 - 8.0 * s
    z[:, 2] = -4.0 + np.cos(9.0 * s)
    z[:, 3] = 0.9 + 0.1 * np.sin(4.0 * s)
    if strains == 6:
        z[:, 4], z[:, 5] = 0.03 * np.cos(5.0 * s), -0.02 + 0.1 * s
    return z


def tendon_points(arm: Arm, shape: Backbone) -> FloatArray:
    """Return the positions of the tendons at every station, (tendons, stations, 3) [m]."""
    axes = Rotation.from_quat(shape.quaternion).as_matrix()
    offsets = np.einsum('sxa,ajs->jsx', axes[..., 1:], arm.tendon_offsets(shape.s))
    return np.asarray(shape.position + offsets)


def forms() -> list[ModuleType]:
    """Return the modules of node functions that can be imported."""
    modules: list[ModuleType] = [arrays]
    try:
        from octo_arm_model.rod import loops
    except ModuleNotFoundError:
        return modules
    return [*modules, loops]


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
