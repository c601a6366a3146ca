"""Analytic first derivatives of the shape against finite differences, and what they must obey."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import pytest
from differences import along
from numpy.testing import assert_allclose
from numpy.typing import ArrayLike
from rods import CONE, METAL, helical_arm
from scipy.spatial.transform import Rotation

from octo_arm_model import (
    Arm,
    Backbone,
    Body,
    Discs,
    DistributedLoad,
    GivenStiffness,
    Linear,
    Loads,
    Material,
    PointLoad,
    RectangularBody,
    RestShape,
    RoutedSection,
    Section,
    Solver,
    Tendon,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty

# Away from nu = 0.5, beyond which there is no material.
RUBBER = Material(1.1e5, 0.4, 1080.0)
STRAIGHT = (Section(0.4, 0.008, 0.004), Section(0.25, 0.01, 0.007))
HELICAL_TENSIONS = ((0.3, 0.6, 0.1), (1.0, 0.4, 1.5))
STRAIGHT_TENSIONS = ((0.4, 0.6, 0.1, 0.2), (1.0, 0.4, 1.5, 0.3))
EVERYTHING = Loads(
    gravity=(0.0, 2.0, -3.0),
    fluid_density=400.0,
    tip_force=(0.005, 0.01, -0.005),
    tip_moment=(1e-4, -2e-4, 1e-4),
    points=(PointLoad(0.15, (0.0, 0.02, 0.01), (1e-4, 0.0, 2e-4)),),
    distributed=(DistributedLoad((0.1, 0.2, 0.3), ((0, 0, 0), (0, 0.1, 0.2), (0, 0, 0.1))),),
)


class Case(NamedTuple):
    """An arm under tensions and loads."""

    arm: Arm
    tensions: tuple[tuple[float, ...], ...]
    law: str
    shear: bool = False
    loads: Loads = Loads()

    def solver(
        self,
        young: ArrayLike = 0.0,
        poisson: ArrayLike = 0.0,
        farther: ArrayLike = (0.0,) * 8,
        rougher: ArrayLike = 0.0,
        stiffer: ArrayLike = 0.0,
    ) -> Solver:
        """The arm with E and nu changed, and each tendon's offset, friction and sheath."""
        arm, more, moves = self.arm, 1.0 + np.ravel(young).item(), iter(np.ravel(farther))
        sections = tuple(
            RoutedSection(
                one.anchorage,
                tuple(
                    Tendon(
                        Linear(one.offset_base + move, one.offset_anchorage + move, one.anchorage),
                        tendon.angle,
                    )
                    for tendon, move in zip(one.tendons, moves)
                ),
            )
            for one in arm.sections
        )
        changed = dataclasses.replace(
            arm,
            material=dataclasses.replace(
                arm.material,
                youngs_modulus=arm.material.youngs_modulus * more,
                poisson_ratio=arm.material.poisson_ratio + np.ravel(poisson).item(),
            ),
            sections=sections,
            stiffness=GivenStiffness(
                **{name: one.level * more for name, one in arm.stiffness.profiles.items()}
            ),
            friction=tuple(arm.friction + np.asarray(rougher)) if arm.friction else (),
            sheath_stiffness=tuple(np.add(arm.sheath_stiffness, stiffer))
            if arm.sheath_stiffness
            else (),
        )
        return Solver(changed, 'exact', 41, material=self.law, shear=self.shear, loads=self.loads)


THREADS = Arm(RUBBER, CONE, STRAIGHT)
WOUND = helical_arm(RUBBER)
ROD = Case(
    METAL, ((3.0, 0.0, 1.0), (0.0, 4.0, 0.5)), 'linear', loads=Loads(tip_force=(0.0, 0.05, 0.1))
)
# One is rigid.
IN_SHEATHS = dataclasses.replace(WOUND, sheath_stiffness=(3e5, 0.0, 1e6, 4e5, 5e5, 6e5))
BENT_STRIP = dataclasses.replace(
    IN_SHEATHS,
    body=RectangularBody(0.4, 0.024, Linear(0.022, 0.016, 0.4)),
    rest=RestShape(5.0, -3.0, 4.0),
)
BENT_TUBE = dataclasses.replace(
    WOUND,
    body=Body(0.4, 0.015, 0.01, 0.0, 0.005),
    rest=RestShape(-4.0, 6.0, 3.0),
    stiffness=GivenStiffness(bending_n=2e-3, torsion=3e-3),
)
THICK = dataclasses.replace(
    METAL, discs=Discs.evenly(5, 0.4, 0.005), rest=RestShape(2.0, -1.0, 1.0)
)
CASES = {
    'rubber': Case(THREADS, STRAIGHT_TENSIONS, 'neo_hookean'),
    'helical rubber': Case(WOUND, HELICAL_TENSIONS, 'neo_hookean'),
    'helical': Case(WOUND, HELICAL_TENSIONS, 'linear'),
    'helical with shear': Case(WOUND, HELICAL_TENSIONS, 'linear', True),
    'loaded rubber': Case(THREADS, STRAIGHT_TENSIONS, 'neo_hookean', loads=EVERYTHING),
    'loaded helical rubber': Case(WOUND, HELICAL_TENSIONS, 'neo_hookean', loads=EVERYTHING),
    'loaded with shear': Case(WOUND, HELICAL_TENSIONS, 'linear', True, EVERYTHING),
    'loaded rod': ROD,
    'in sheaths': Case(IN_SHEATHS, HELICAL_TENSIONS, 'neo_hookean', loads=EVERYTHING),
    'bent strip': Case(BENT_STRIP, HELICAL_TENSIONS, 'neo_hookean', loads=EVERYTHING),
    'bent tube with shear': Case(BENT_TUBE, HELICAL_TENSIONS, 'linear', True, EVERYTHING),
    'between discs': Case(
        dataclasses.replace(WOUND, discs=Discs.evenly(16, 0.4)),
        HELICAL_TENSIONS,
        'neo_hookean',
        loads=EVERYTHING,
    ),
    'between thick discs': ROD._replace(arm=THICK, shear=True),
}


# With friction, whose equations derive from no energy.
SMOOTH = np.random.default_rng(3).uniform(0.05, 0.4, 8)
SLIDING = {
    f'sliding {name}': CASES[name]._replace(
        arm=dataclasses.replace(
            CASES[name].arm, friction=tuple(SMOOTH[: np.size(CASES[name].tensions)].tolist())
        )
    )
    for name in (
        'rubber',
        'helical rubber',
        'helical with shear',
        'loaded helical rubber',
        'loaded with shear',
        'loaded rod',
        'in sheaths',
        'bent strip',
        'between discs',
        'between thick discs',
    )
}


class Solved(NamedTuple):
    """A case, solved and differentiated once for all tests."""

    case: Case
    solver: Solver
    backbone: Backbone
    sensitivity: Sensitivity


@pytest.fixture(scope='module', params=(CASES | SLIDING).values(), ids=CASES | SLIDING)
def solved(request):
    case = request.param
    solver = case.solver()
    backbone = solver.solve(case.tensions)
    return Solved(case, solver, backbone, solver.sensitivity(backbone))


def outcome(solver: Solver, backbone: Backbone, at: Backbone) -> FloatArray:
    """Poses and strains at a station in the middle and at the tip, and tendons' lengths."""
    parts = []
    for i in (backbone.s.size // 2, -1):
        turn = (
            Rotation.from_quat(backbone.quaternion[i]) * Rotation.from_quat(at.quaternion[i]).inv()
        )
        strains = backbone.tau[i], backbone.xi[i], backbone.k[i], backbone.q[i]
        parts += [*backbone.position[i], *turn.as_rotvec(), *strains]
    return np.array([*parts, *np.ravel(solver.tendon_lengths(backbone))])


def given(change: Change) -> FloatArray:
    """The same derivatives from `Change`."""
    parts = []
    for i in (change.pose.shape[0] // 2, -1):
        parts += [change.pose[i], change.strain[i]]
    return np.concatenate([*parts, change.tendon_length])


def moves_of(case: Case, found: Sensitivity) -> dict[str, tuple[Change, FloatArray]]:
    """Derivatives by every input, and how far each is moved."""
    tensions, radius = np.ravel(case.tensions), float(case.arm.body.half_sizes(0.2).min())
    bending = float(case.arm.material.youngs_modulus) * math.pi * radius**4 / 4
    moment = 0.01 * bending / case.arm.body.length
    moves = {
        # A slack one has its derivative from above alone, and is not moved.
        'tensions': (found.by_tension, 0.02 * tensions),
        'wrench': (found.by_tip_wrench, np.repeat([moment / case.arm.body.length, moment], 3)),
        'young': (found.by_youngs_modulus, np.array([1e-2])),
        'poisson': (found.by_poisson_ratio, np.array([1e-2])),
        'farther': (found.by_offset, np.full(tensions.size, 1e-4)),
        'rougher': (found.by_friction, np.full(tensions.size, 0.01)),
        'stiffer': (found.by_sheath_stiffness, 0.01 * np.array(case.arm.sheath_stiffness)),
    }
    assert (found.by_friction is None) == (not case.arm.friction)
    assert (found.by_sheath_stiffness is None) == (not case.arm.sheath_stiffness)
    return {name: (change, step) for name, (change, step) in moves.items() if change is not None}


# Inputs that are moved at once change the shape by about as much.
TOGETHER = (('tensions', 'wrench', 'young'), ('farther', 'rougher', 'poisson'), ('stiffer',))


@pytest.mark.parametrize('names', TOGETHER, ids=' '.join)
def test_derivatives_are_those_of_differences(solved, names):
    case, random = solved.case, np.random.default_rng(4)
    moves, ways = moves_of(case, solved.sensitivity), {}
    moves = {name: move for name, move in moves.items() if name in names}
    if not moves:
        return  # without sheaths
    for name, (_, step) in moves.items():
        # Each by another part of its step.
        ways[name] = step * random.uniform(0.4, 1.0, step.size) * random.choice([-1, 1], step.size)

    def moved(part):
        own = {name: part * way for name, way in ways.items()}
        tensions = np.ravel(case.tensions) + own.pop('tensions', 0.0)
        wrench, solver = own.pop('wrench', None), case.solver(**own)
        shape = solver.solve(
            tensions.reshape(np.shape(case.tensions)), wrench, start=solved.backbone
        )
        return outcome(solver, shape, solved.backbone)

    expected = along(moved, np.zeros(1), np.ones(1))
    columns = np.concatenate([given(change) for change, _ in moves.values()], axis=1)
    direction = np.concatenate(list(ways.values()))
    found, sizes = columns @ direction, np.abs(columns) @ np.abs(direction)
    # Positions, angles, curvatures, strains and lengths, each by its largest.
    kinds = np.array([*2 * (*3 * (0,), *3 * (1,), *3 * (2,), 3), *(len(found) - 20) * (4,)])
    for kind in range(5):
        rows = kinds == kind
        # Not of what is left where components cancel each other.
        scale = max(sizes[rows].max(), 1e-9)  # strains are zero in rigid discs
        # Between nodes changes of strains are interpolated.
        atol = (1e-3 if kind in (2, 3) else 2e-5) * scale
        assert_allclose(found[rows], expected[rows], atol=atol, rtol=0)


def test_by_tension_from_slack():
    solver = ROD.solver()
    backbone = solver.solve(ROD.tensions)
    change = solver.sensitivity(backbone).by_tension.tip
    step = 1e-4
    for index in ((0, 1), (1, 0)):
        pulls = []
        for count in (1, 2):
            tensions = np.array(ROD.tensions)
            tensions[index] += count * step
            pulls.append(solver.solve(tensions, start=backbone).tip)
        expected = (4 * pulls[0] - pulls[1] - 3 * backbone.tip) / (2 * step)
        column = np.ravel_multi_index(index, (2, 3))
        assert_allclose(change[:3, column], expected, atol=1e-5 * np.abs(expected).max())


# Reciprocity (Maxwell): all of it derives from one energy ---------------------------------------


def conservative(case: Case) -> Case:
    loads = case.loads
    points = tuple(PointLoad(load.s, load.force) for load in loads.points)
    return case._replace(
        loads=dataclasses.replace(loads, tip_moment=(0.0, 0.0, 0.0), points=points)
    )


@pytest.mark.parametrize('name', CASES)
def test_without_dead_moments_the_compliance_is_symmetric(name):
    case = conservative(CASES[name])
    solver = case.solver()
    compliance = solver.sensitivity(solver.solve(case.tensions)).compliance
    # In units in which all are of one size.
    unit = np.array(3 * [1.0] + 3 * [case.arm.body.length])
    compliance = compliance * unit[:, np.newaxis] * unit
    assert_allclose(compliance, compliance.T, atol=1e-7 * np.abs(compliance).max())
    assert np.linalg.eigvalsh((compliance + compliance.T) / 2).min() > 0.0


@pytest.mark.parametrize('name', CASES)
def test_tendons_and_tip_answer_each_other_alike(name):
    case = conservative(CASES[name])
    solver = case.solver()
    by = solver.sensitivity(solver.solve(case.tensions))
    lengths = by.by_tension.tendon_length
    assert_allclose(lengths, lengths.T, atol=1e-7 * np.abs(lengths).max())
    # A tendon that pulls gets shorter.
    assert np.linalg.eigvalsh((lengths + lengths.T) / 2).max() < 1e-9 * np.abs(lengths).max()
    unit = np.array(3 * [1.0] + 3 * [case.arm.body.length])
    expected = -by.by_tension.tip * unit[:, np.newaxis]
    found = (by.by_tip_wrench.tendon_length * unit).T
    assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


# Uncertainty -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('count', 'near'), [(60, 0.4), pytest.param(400, 0.2, marks=pytest.mark.endurance)]
)
def test_the_tips_covariance_is_that_of_many_samples_to_first_order(count, near):
    case = CASES['loaded rubber']
    solver = case.solver()
    backbone = solver.solve(case.tensions)
    deviation = Uncertainty(0.002, 0.005, 0.01, 2e-5)
    covariance = solver.sensitivity(backbone).tip_covariance(deviation)
    assert_allclose(covariance, covariance.T, rtol=0.0, atol=1e-10 * np.abs(covariance).max())
    assert np.linalg.eigvalsh(covariance).min() > -1e-12 * np.trace(covariance)
    random = np.random.default_rng(0)
    samples = []
    for _ in range(count):
        moved = case.solver(
            deviation.youngs_modulus * random.normal(),
            deviation.poisson_ratio * random.normal(),
            deviation.offset * random.normal(size=8),
        )
        tensions = case.tensions + deviation.tension * random.normal(size=(2, 4))
        samples.append(moved.solve(tensions, start=backbone).tip)
    spread = np.cov(np.array(samples).T)
    # Of 60 samples a variance is known to 18 %, of 400 to 7 %.
    assert_allclose(spread, covariance[:3, :3], atol=near * np.abs(spread).max())


def test_the_tip_alone_where_nothing_is_reciprocal(solved):
    # Dead moments and friction have no energy.
    solver, backbone, deviation = (
        solved.solver,
        solved.backbone,
        Uncertainty(0.01, 0.02, 0.03, 1e-4),
    )
    expected = solver.sensitivity(backbone).tip_covariance(deviation)
    found = solver.tip_covariance(backbone, deviation)
    # In units in which all are of one size.
    unit = np.array(3 * [1.0] + 3 * [solver.arm.length])
    expected, found = (part * unit[:, np.newaxis] * unit for part in (expected, found))
    assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


# What is refused -------------------------------------------------------------------------------
