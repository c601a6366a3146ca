"""The finite-element model against results known by other means."""

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
    """A computed number and its known value.

    Attributes:
        what: what it is.
        found: by the elements.
        expected: by other means.
        tolerance: relative difference that is no fault of the elements.
    """

    what: str
    found: float
    expected: float
    tolerance: float

    @property
    def error(self) -> float:
        """Relative difference."""
        return abs(self.found / self.expected - 1.0)

    @property
    def passed(self) -> bool:
        """Whether the difference is small enough."""
        return bool(self.error <= self.tolerance)


def cylinder(offset: float, length: float, poisson_ratio: float = 0.5) -> Arm:
    """Cylinder of radius 10 mm with four straight tendons at ``offset`` [m]."""
    return Arm(
        Material(_E, poisson_ratio), Body(length, _R, _R), (Section(length, offset, offset),)
    )


def checks(across: int = 1) -> list[Check]:
    """All of them, on elements ``across`` fine."""
    return [
        *derivatives(Mesh(across, 0.75)),
        *compression(Mesh(across, 0.5)),
        *cantilever(Mesh(across, 0.5)),
        *bending(Mesh(across, 1.0)),
        *energy(Mesh(across, 0.75)),
    ]


def derivatives(mesh: Mesh) -> list[Check]:
    """Forces and stiffness against differences of energy and of forces."""
    arm = ElasticArm(cylinder(0.004, 0.05, 0.45), mesh, [0, 1], Contact(0.001, 0.001))
    solid, tendon = arm.solid, arm.tendons[1]
    random = np.random.default_rng(51)
    size = np.where(np.arange(solid.size) < solid.displacements, 1e-5, 0.05 * _E)
    state, way = size * random.normal(size=(2, solid.size))
    places, along = (x[: solid.displacements].reshape(-1, 3) for x in (state, way))
    h = 1e-3

    def slope(of: Callable[[float], float]) -> float:
        return (of(h) - of(-h)) / (2.0 * h)

    return [
        Check(
            'forces of the solid',
            float(solid.gradient(state) @ way),
            slope(lambda t: solid.energy(state + t * way)),
            1e-6,
        ),
        Check(
            'stiffness of the solid',
            float(way @ (solid.hessian(state) @ way)),
            slope(lambda t: solid.gradient(state + t * way) @ way),
            1e-6,
        ),
        Check(
            'forces of a tendon',
            float(np.sum(tendon.gradient(places) * along)),
            slope(lambda t: tendon.length(places + t * along)),
            1e-6,
        ),
        Check(
            'stiffness of a tendon',
            float(along.ravel() @ (tendon.hessian(places) @ along.ravel())),
            slope(lambda t: float(np.sum(tendon.gradient(places + t * along) * along))),
            1e-6,
        ),
    ]


def compression(mesh: Mesh) -> list[Check]:
    """A tendon on the axis: P = mu (l - J / (l^2)) with free sides, to rounding; and `exact`."""
    found = []
    for ratio in (0.5, 0.4):
        arm = cylinder(0.0, 0.05, ratio)
        solid = ElasticArm(arm, mesh, [0], Contact(clamped=False))
        (shape,) = solid.follow([[10.0]])
        stretch = shape.tip[0] / arm.length
        area = solid.area
        expected = brentq(lambda x: _pressed(x, ratio) + 10.0 / area, 0.3, 1.0, xtol=1e-14)
        found.append(Check(f'stretch under axial tension, nu = {ratio}', stretch, expected, 1e-8))
        if ratio == 0.5:
            q = Solver(arm, 'exact').solve([[10.0, 0, 0, 0]]).q[0]
            found.append(Check('the same, by exact', stretch - 1.0, float(q), 2e-3))
    return found


def _pressed(stretch: float, ratio: float) -> float:
    """Nominal stress of a bar of the solid's material, its sides free [Pa]."""
    mu = _E / (2.0 * (1.0 + ratio))
    if ratio == 0.5:
        return mu * (stretch - stretch**-2)
    bulk = 2.0 * ratio * mu / (1.0 - 2.0 * ratio)

    def sideways(width: float) -> float:
        j = stretch * width**2
        return mu * (width - 1.0 / width) + bulk * (j - 1.0) * j / width

    width = brentq(sideways, 0.8, 1.5, xtol=1e-14)
    j = stretch * width**2
    return float(mu * (stretch - 1.0 / stretch) + bulk * (j - 1.0) * j / stretch)


def cantilever(mesh: Mesh) -> list[Check]:
    """A small moment at the tip of a base that may widen, and a small force with a glued base.

    The first is exact in quadratic elements but for their section; a glued base of incompressible
    rubber is stiffer than beam theory (Timoshenko's, with Cowper's coefficient of shear) knows.
    """
    length, found = 20.0 * _R, []
    inertia = np.pi * _R**4 / 4.0
    shear = (7.0 + 6.0 * 0.5) / (6.0 * 1.5) / (_E / 3.0 * np.pi * _R**2)
    for clamped in (False, True):
        solid = ElasticArm(cylinder(0.0, length), mesh, [0], Contact(clamped=clamped))
        nodes, values, area = solid.mesh.face(length)
        y = np.einsum('fa,afq->fq', solid.mesh.nodes[1, nodes], values)
        load = np.zeros((solid.mesh.nodes.shape[1], 3))
        way = np.einsum('fq,afq->fa', area if clamped else -area * y, values)
        load[:, int(clamped)] = np.bincount(nodes.ravel(), way.ravel(), len(load))
        moved = solid.midline(solid.small_response(load))[-1, 1]
        if clamped:
            force = 2.0 * float(load[:, 1].sum())  # two halves
            beam = force * (length**3 / (3.0 * _E * inertia) + length * shear)
            found.append(Check('deflection under a force', float(moved), beam, 3e-2))
        else:
            moment = 2.0 * float(np.sum(area * y * y))
            beam = moment * length**2 / (2.0 * _E * inertia)
            found.append(Check('deflection under a moment', float(moved), beam, 3e-3))
    return found


def bending(mesh: Mesh) -> list[Check]:
    """A tendon beside the axis, far from the ends: `exact` with the tendon kept in its section."""
    arm, tension = cylinder(0.004, 0.12), 3.0
    solid = ElasticArm(arm, mesh, [0], Contact(clamped=False))
    (shape,) = solid.follow([[tension]])
    middle = (shape.s > 0.04) & (shape.s < 0.08)
    path = shape.midline[middle, 0] + 1j * shape.midline[middle, 1]
    chord = np.diff(path)
    # Of a circle: the turn between chords, and an arc for a chord.
    turn = float(np.mean(np.angle(chord[1:] / chord[:-1])))
    arc = float(np.mean(np.abs(chord))) * (0.5 * turn) / np.sin(0.5 * turn)
    step = float(np.mean(np.diff(shape.s[middle])))
    model = Solver(arm, 'exact').solve([[tension, 0, 0, 0]])
    return [
        Check('curvature of a cylinder, by exact', turn / arc, float(model.k[50]), 2e-2),
        Check('stretch of its midline, by exact', arc / step, float(1.0 + model.q[50]), 5e-3),
    ]


def energy(mesh: Mesh) -> list[Check]:
    """The potential falls from the unloaded shape on, and its slope with T is the length."""
    arm, h = cylinder(0.004, 0.05), 1e-3
    solid = ElasticArm(arm, mesh, [0], Contact(0.001, 0.001))
    below, at, above = solid.follow([[2.0 - h], [2.0], [2.0 + h]])
    slope = (above.potential - below.potential) / (2.0 * h)
    return [
        Check('slope of the potential with tension', slope, at.lengths[0], 1e-6),
        Check('whether the potential fell', float(at.potential < 2.0 * arm.length), 1.0, 0.0),
    ]
