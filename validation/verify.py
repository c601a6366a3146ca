"""Check the finite-element model against analytic and independent results."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from arm_mesh import Mesh
from elasticity import Contact, ElasticArm
from scipy.optimize import brentq

from octo_arm_model import Arm, Body, Material, Section, Solver

_E, _R = 1.1e5, 0.01


class Check(NamedTuple):
    """A computed number and its expected value.

    Attributes:
        what: name of the quantity.
        found: result of the elements.
        expected: result of another method.
        tolerance: largest relative difference.
    """

    what: str
    found: float
    expected: float
    tolerance: float

    @property
    def error(self) -> float:
        """Relative difference between both results."""
        return abs(self.found / self.expected - 1.0)

    @property
    def passed(self) -> bool:
        """Whether the difference is within the tolerance."""
        return bool(self.error <= self.tolerance)


def cylinder(offset: float, length: float, poisson_ratio: float = 0.5) -> Arm:
    """Return a cylinder of radius 10 mm with four straight tendons at ``offset`` [m]."""
    return Arm(
        Material(_E, poisson_ratio), Body(length, _R, _R), (Section(length, offset, offset),)
    )


def checks(across: int = 1) -> list[Check]:
    """Run all checks on meshes with ``across`` elements, see `Mesh`."""
    return [
        *derivatives(Mesh(across, 0.75)),
        *compression(Mesh(across, 0.5)),
        *cantilever(Mesh(across, 0.5)),
        *bending(Mesh(across, 1.0)),
        *energy(Mesh(across, 0.75)),
    ]


def derivatives(mesh: Mesh) -> list[Check]:
    """Compare forces with differences of energy, and stiffness with differences of forces."""
    arm = ElasticArm(cylinder(0.004, 0.05, 0.45), mesh, [0, 1], Contact(0.001, 0.001))
    solid, tendon = arm.solid, arm.tendons[1]
    random = np.random.default_rng(51)
    magnitudes = np.where(np.arange(solid.size) < solid.displacements, 1e-5, 0.05 * _E)
    state, direction = magnitudes * random.normal(size=(2, solid.size))
    u, v = (x[: solid.displacements].reshape(-1, 3) for x in (state, direction))
    h = 1e-3

    def difference(function: Callable[[float], float]) -> float:
        return (function(h) - function(-h)) / (2.0 * h)

    def energy(t: float) -> float:
        return solid.energy(state + t * direction)

    def work(t: float) -> float:
        return float(solid.gradient(state + t * direction) @ direction)

    def length(t: float) -> float:
        return tendon.length(u + t * v)

    def pull(t: float) -> float:
        return float(np.sum(tendon.gradient(u + t * v) * v))

    stiffness = direction @ (solid.hessian(state) @ direction)
    tendon_stiffness = v.ravel() @ (tendon.hessian(u) @ v.ravel())
    return [
        Check('forces of the solid', work(0.0), difference(energy), 1e-6),
        Check('stiffness of the solid', float(stiffness), difference(work), 1e-6),
        Check('forces of a tendon', pull(0.0), difference(length), 1e-6),
        Check('stiffness of a tendon', float(tendon_stiffness), difference(pull), 1e-6),
    ]


def compression(mesh: Mesh) -> list[Check]:
    """Compare a tendon on the axis with the stress of a bar with free sides, and with `exact`."""
    results = []
    for ratio in (0.5, 0.4):
        arm = cylinder(0.0, 0.05, ratio)
        solid = ElasticArm(arm, mesh, [0], Contact(clamped=False))
        (shape,) = solid.follow([[10.0]])
        stretch = shape.tip[0] / arm.length
        area = solid.area
        expected = brentq(lambda x: _uniaxial_stress(x, ratio) + 10.0 / area, 0.3, 1.0, xtol=1e-14)
        name = f'stretch under axial tension, nu = {ratio}'
        results.append(Check(name, stretch, expected, 1e-8))
        if ratio == 0.5:
            q = Solver(arm, 'exact').solve([[10.0, 0, 0, 0]]).q[0]
            results.append(Check('axial strain by exact, nu = 0.5', stretch - 1.0, float(q), 2e-3))
    return results


def _uniaxial_stress(stretch: float, ratio: float) -> float:
    """Return the nominal stress of a bar with free sides [Pa]."""
    mu = _E / (2.0 * (1.0 + ratio))
    if ratio == 0.5:
        return mu * (stretch - stretch**-2)
    bulk = 2.0 * ratio * mu / (1.0 - 2.0 * ratio)

    def lateral_stress(width: float) -> float:
        j = stretch * width**2
        return mu * (width - 1.0 / width) + bulk * (j - 1.0) * j / width

    width = brentq(lateral_stress, 0.8, 1.5, xtol=1e-14)
    j = stretch * width**2
    return float(mu * (stretch - 1.0 / stretch) + bulk * (j - 1.0) * j / stretch)


def cantilever(mesh: Mesh) -> list[Check]:
    """Compare deflections under a small tip moment and a small tip force with beam theory.

    The moment acts on an arm whose base can widen; only the shape of the section has an error. The
    force acts on an arm with a clamped base. With incompressible rubber this is stiffer than a
    Timoshenko beam with Cowper's shear coefficient.
    """
    length, results = 20.0 * _R, []
    inertia = np.pi * _R**4 / 4.0
    shear = (7.0 + 6.0 * 0.5) / (6.0 * 1.5) / (_E / 3.0 * np.pi * _R**2)
    for clamped in (False, True):
        solid = ElasticArm(cylinder(0.0, length), mesh, [0], Contact(clamped=clamped))
        nodes, values, area = solid.mesh.face(length)
        y = np.einsum('fa,afq->fq', solid.mesh.nodes[1, nodes], values)
        load = np.zeros((solid.mesh.nodes.shape[1], 3))
        nodal_load = np.einsum('fq,afq->fa', area if clamped else -area * y, values)
        load[:, int(clamped)] = np.bincount(nodes.ravel(), nodal_load.ravel(), len(load))
        deflection = solid.midline(solid.small_response(load))[-1, 1]
        if clamped:
            force = 2.0 * float(load[:, 1].sum())  # two halves
            beam = force * (length**3 / (3.0 * _E * inertia) + length * shear)
            results.append(Check('deflection under a force', float(deflection), beam, 3e-2))
        else:
            moment = 2.0 * float(np.sum(area * y * y))
            beam = moment * length**2 / (2.0 * _E * inertia)
            results.append(Check('deflection under a moment', float(deflection), beam, 3e-3))
    return results


def bending(mesh: Mesh) -> list[Check]:
    """Compare bending far from the ends, with tendons kept in their sections, with `exact`."""
    arm, tension = cylinder(0.004, 0.12), 3.0
    solid = ElasticArm(arm, mesh, [0], Contact(clamped=False))
    (shape,) = solid.follow([[tension]])
    middle = (shape.s > 0.04) & (shape.s < 0.08)
    path = shape.midline[middle, 0] + 1j * shape.midline[middle, 1]
    chords = np.diff(path)
    # On a circle: the angle between chords, and the arc of a chord.
    angle = float(np.mean(np.angle(chords[1:] / chords[:-1])))
    arc = float(np.mean(np.abs(chords))) * (0.5 * angle) / np.sin(0.5 * angle)
    step = float(np.mean(np.diff(shape.s[middle])))
    model = Solver(arm, 'exact').solve([[tension, 0, 0, 0]])
    return [
        Check('curvature of a cylinder, by exact', angle / arc, float(model.k[50]), 2e-2),
        Check('stretch of its midline, by exact', arc / step, float(1.0 + model.q[50]), 5e-3),
    ]


def energy(mesh: Mesh) -> list[Check]:
    """Check that the potential falls, and that its derivative by the tension is the length."""
    arm, h = cylinder(0.004, 0.05), 1e-3
    solid = ElasticArm(arm, mesh, [0], Contact(0.001, 0.001))
    below, middle, above = solid.follow([[2.0 - h], [2.0], [2.0 + h]])
    slope = (above.potential - below.potential) / (2.0 * h)
    is_below = middle.potential < 2.0 * arm.length
    return [
        Check('slope of the potential with tension', slope, middle.lengths[0], 1e-6),
        Check('potential below that without load', float(is_below), 1.0, 0.0),
    ]
