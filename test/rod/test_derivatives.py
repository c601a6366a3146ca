"""First derivatives of equilibria against differences of solves, and the covariance of the tip."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from differences import along
from helical_arm import CONE, HELICES
from rods import EVERYTHING, WRENCH
from scipy.spatial.transform import Rotation

from octo_arm_model import (
    Arm,
    Constant,
    Linear,
    Loads,
    Material,
    PointLoad,
    RoutedSection,
    Tendon,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.derivatives import Derivatives
from octo_arm_model.rod.lengths import tendon_lengths
from octo_arm_model.rod.rod import Equilibrium, Rod, Setting
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty

STATIONS = np.array([0.0, 0.07, 0.15, 0.19, 0.25, 0.33, 0.4])
TENSIONS = 0.6 * np.array([0.3, 0.6, 0.1, 1.0, 0.4, 1.5])
SHEATHS = (3e5, 0.0, 1e6, 4e5, 5e5, 6e5)
# Loads of magnitudes that are unknown: at an edge between elements, and everywhere.
UNITS = (
    Loads(points=(PointLoad(0.15, (0.01, 0.02, 0.0), (0.0, 1e-3, 0.0)),)),
    Loads(gravity=(0.0, 1.0, 1.0), fluid_density=400.0),
)
LAWS = {
    'linear': Setting(widens=False),
    'neo_hookean': Setting(),
    'shear': Setting(widens=False, shear=True),
}


class Case(NamedTuple):
    """A rod of a law, in sheaths or not, loaded or not, in one of the forms, with friction."""

    law: str
    is_sheathed: bool
    is_loaded: bool
    friction: tuple[float, ...] = ()

    def rod(
        self, young: float = 0.0, poisson: float = 0.0, farther: FloatArray = np.zeros(6),
        stiffer: FloatArray = np.zeros(6), units: FloatArray = np.zeros(2),
        rougher: FloatArray = np.zeros(6),
    ) -> Rod:  # fmt: skip
        """Of other E, nu, distances of tendons, sheaths, unit loads and friction."""
        material = Material(1.1e5 * (1.0 + young), 0.4 + poisson, 1080.0)
        moves, sections = iter(farther), []
        for section in HELICES:
            tendons = []
            for angle, twist in zip(section.angles, section.twist, strict=True):
                move, end = next(moves), section.anchorage
                place = section.offset_base + move, section.offset_anchorage + move
                turn = Linear(angle, angle + twist, end) if twist else Constant(angle)
                tendons.append(Tendon(Linear(*place, end), turn))
            sections.append(RoutedSection(section.anchorage, tuple(tendons)))
        sheaths = tuple(np.where(np.array(SHEATHS) > 0.0, SHEATHS + stiffer, 0.0))
        own = {'sheath_stiffness': sheaths} if self.is_sheathed else {}
        if self.friction:
            own['friction'] = tuple(self.friction + rougher)
        loads = _with(units) if self.is_loaded else Loads()
        setting = LAWS[self.law]
        return Rod(Arm(material, CONE, tuple(sections), **own), loads, setting=setting)


def _with(units: FloatArray) -> Loads:
    """`EVERYTHING` in water and so much of the `UNITS`."""
    point, weight = units
    more = UNITS[0].points[0]
    force, moment = (tuple(point * np.array(one)) for one in (more.force, more.moment))
    # Weight in a fluid of 400 kg/m^3, as a part of that in water.
    part = weight * (1080.0 - 400.0) / (1080.0 - 1000.0)
    gravity = np.array(EVERYTHING.gravity) + part * np.array(UNITS[1].gravity)
    return dataclasses.replace(
        EVERYTHING, fluid_density=1000.0, gravity=tuple(gravity),
        points=(*EVERYTHING.points, PointLoad(more.s, force, moment)),
    )  # fmt: skip


CASES = [
    Case(law, sheathed, loaded)
    for law in LAWS for sheathed in (False, True) for loaded in (True, False)
]  # fmt: skip
MU = (0.1, 0.3, 0.05, 0.2, 0.4, 0.15)
CASES += [
    Case('neo_hookean', sheathed, loaded, MU)
    for sheathed, loaded in ((True, True), (False, True), (False, False))
]
CASES.append(Case('shear', True, True, MU))


class Solved(NamedTuple):
    """A case in equilibrium."""

    case: Case
    rod: Rod
    wrench: FloatArray
    found: Equilibrium
    derivatives: Derivatives
    sensitivity: Sensitivity

    def outcome(self, rod: Rod, tensions: FloatArray, wrench: FloatArray) -> FloatArray:
        """Poses and strains at the stations, and lengths, of another rod or condition."""
        found = rod.solve(tensions, wrench, self.found)
        readout = rod.readout(found.level, STATIONS)
        reading = readout.read(found.state)
        z = reading.twist
        turn = Rotation.from_quat(np.roll(reading.quaternion, -1, axis=1)) * self.turned.inv()
        strain = z[:, :4].copy()
        strain[:, :3] /= z[:, 3:4]
        lengths = tendon_lengths(rod.problem(found.level), found.state).length
        parts = reading.position, turn.as_rotvec(), strain[:, :3], strain[:, 3], lengths
        return np.concatenate([part.ravel() for part in parts])

    @property
    def turned(self) -> Rotation:
        reading = self.rod.readout(self.found.level, STATIONS).read(self.found.state)
        return Rotation.from_quat(np.roll(reading.quaternion, -1, axis=1))


@functools.cache
def solve(case: Case) -> Solved:
    rod, wrench = case.rod(), WRENCH * case.is_loaded
    found = rod.solve(TENSIONS, wrench)
    derivatives = Derivatives(rod, found.level, STATIONS)
    return Solved(case, rod, wrench, found, derivatives, derivatives.sensitivity(found.state))


@pytest.fixture(params=CASES, ids=lambda case: '-'.join(map(str, case)))
def solved(request: pytest.FixtureRequest) -> Solved:
    return solve(request.param)


def assert_derivative(
    change: Change, outcome: Callable[[FloatArray], FloatArray], steps: FloatArray
) -> None:
    """That ``outcome``, `Solved.outcome` of steps, changes by the ``change``."""
    # All columns at once, each by another part of its step.
    random = np.random.default_rng(4)
    direction = steps * random.uniform(0.4, 1.0, steps.size) * random.choice([-1, 1], steps.size)
    expected = along(outcome, np.zeros(steps.size), direction)
    pose, strain = change.pose, change.strain
    parts = pose[:, :3], pose[:, 3:], strain[:, :3], strain[:, 3], change.tendon_length
    first = 0
    for number, part in enumerate(parts):
        columns = part.reshape(-1, steps.size)
        own = expected[first : first + len(columns)]
        first += len(columns)
        # Not of what is left where columns cancel each other.
        scale = (np.abs(columns) @ np.abs(direction)).max()
        atol = 1e-5 * scale
        if number in (2, 3):
            atol *= 100.0  # Between nodes changes of strains are interpolated.
        np.testing.assert_allclose(columns @ direction, own, rtol=0.0, atol=atol)
    assert first == expected.size


def test_by_tension(solved: Solved) -> None:
    assert_derivative(
        solved.sensitivity.by_tension,
        lambda x: solved.outcome(solved.rod, TENSIONS + x, solved.wrench), 0.005 * TENSIONS,
    )  # fmt: skip


def test_by_the_wrench_on_the_tip(solved: Solved) -> None:
    change = solved.sensitivity.by_tip_wrench
    assert change is not None
    assert_derivative(
        change, lambda x: solved.outcome(solved.rod, TENSIONS, solved.wrench + x),
        np.repeat([2e-4, 2e-5], 3),
    )  # fmt: skip


def test_by_stiffness_and_poissons_ratio(solved: Solved) -> None:
    for change, name in (
        (solved.sensitivity.by_youngs_modulus, 'young'),
        (solved.sensitivity.by_poisson_ratio, 'poisson'),
    ):
        assert change is not None

        def outcome(x: FloatArray, name: str = name) -> FloatArray:
            rod = solved.case.rod(**{name: x[0]})
            return solved.outcome(rod, TENSIONS, solved.wrench)

        assert_derivative(change, outcome, np.array([3e-3]))


def test_by_the_distance_of_each_tendon(solved: Solved) -> None:
    change = solved.sensitivity.by_offset
    assert change is not None
    assert_derivative(
        change,
        lambda x: solved.outcome(solved.case.rod(farther=x), TENSIONS, solved.wrench),
        np.full(6, 3e-5),
    )  # fmt: skip


def test_by_the_stiffness_of_each_sheath(solved: Solved) -> None:
    change = solved.sensitivity.by_sheath_stiffness
    if not solved.case.is_sheathed:
        assert change is None
        return
    assert change is not None
    assert not change.pose[..., 1].any()  # a rigid one
    assert_derivative(
        change,
        lambda x: solved.outcome(solved.case.rod(stiffer=x), TENSIONS, solved.wrench),
        0.02 * np.array(SHEATHS),
    )  # fmt: skip


def test_by_the_friction_of_each_tendon(solved: Solved) -> None:
    change = solved.sensitivity.by_friction
    if not solved.case.friction:
        assert change is None
        return
    assert change is not None
    assert_derivative(
        change,
        lambda x: solved.outcome(solved.case.rod(rougher=x), TENSIONS, solved.wrench),
        np.full(6, 0.01),
    )  # fmt: skip


def test_by_loads_of_any_magnitude(solved: Solved) -> None:
    if not solved.case.is_loaded:
        return
    assert_derivative(
        solved.derivatives.by_loads(solved.found.state, UNITS),
        lambda x: solved.outcome(solved.case.rod(units=x), TENSIONS, solved.wrench),
        np.array([0.01, 0.01]),
    )  # fmt: skip


def test_without_offsets_all_else_is_the_same(solved: Solved) -> None:
    some = solved.derivatives.sensitivity(solved.found.state, by_offsets=False)
    if not solved.case.friction:
        assert some.by_offset is some.by_sheath_stiffness is None
    for name in ('by_tension', 'by_tip_wrench', 'by_youngs_modulus', 'by_poisson_ratio'):
        one, other = getattr(some, name), getattr(solved.sensitivity, name)
        for field in ('pose', 'strain', 'tendon_length'):
            expected = getattr(other, field)
            atol = 1e-9 * np.abs(expected).max()
            np.testing.assert_allclose(getattr(one, field), expected, rtol=0.0, atol=atol)
        np.testing.assert_array_equal(one.pose[0], 0.0)


def test_the_covariance_of_the_tip_is_that_of_all_columns(solved: Solved) -> None:
    wished = Uncertainty(0.05, 0.1, 0.02, 1e-3, model_position=1e-3)
    found = solved.derivatives.tip_covariance(solved.found.state, wished)
    expected = solved.sensitivity.tip_covariance(wished)
    # The pose of the tip is read at more points by one than by the other.
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0.0, atol=1e-5)


@pytest.mark.parametrize('moment', [0.0, 1e-3])
def test_without_moments_fixed_in_space_the_compliance_is_symmetric(moment: float) -> None:
    rod = Case('neo_hookean', True, False, False).rod()
    found = rod.solve(TENSIONS, np.array([0.01, -0.02, 0.01, moment, 0.0, 0.0]))
    of = Derivatives(rod, found.level, STATIONS).sensitivity(found.state).compliance
    is_symmetric = np.abs(of - of.T).max() <= 1e-6 * np.abs(of).max()
    assert is_symmetric == (moment == 0.0)


def test_loads_on_the_tip_are_the_wrench_on_it() -> None:
    solved = solve(Case('shear', True, True, False))
    loads = [
        Loads(points=(PointLoad(0.4, tuple(axis[:3]), tuple(axis[3:])),))
        for axis in np.eye(6).tolist()
    ]
    by_loads = solved.derivatives.by_loads(solved.found.state, loads)
    expected = solved.sensitivity.by_tip_wrench
    assert expected is not None
    for name in ('pose', 'strain', 'tendon_length'):
        other = getattr(expected, name)
        atol = 1e-11 * np.abs(other).max()
        np.testing.assert_allclose(getattr(by_loads, name), other, rtol=1e-9, atol=atol)
