"""First derivatives of the shape: finite differences, reciprocity and covariance."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import pytest
from differences import along
from numpy.testing import assert_allclose
from numpy.typing import ArrayLike
from rods import HELICAL, METAL, PULL, SHEATHED
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
    PointLoad,
    RectangularBody,
    RestShape,
    RoutedSection,
    Solver,
    Tendon,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty

LOADS = Loads(
    gravity=(0.0, 2.0, -3.0),
    fluid_density=400.0,
    tip_force=(0.005, 0.01, -0.005),
    tip_moment=(1e-4, -2e-4, 1e-4),
    points=(PointLoad(0.15, (0.0, 0.02, 0.01), (1e-4, 0.0, 2e-4)),),
    distributed=(DistributedLoad((0.1, 0.2, 0.3), ((0, 0, 0), (0, 0.1, 0.2), (0, 0, 0.1))),),
)


class Case(NamedTuple):
    """An arm with tensions and loads."""

    arm: Arm
    law: str = 'neo_hookean'
    shear: bool = False
    tensions: FloatArray = PULL
    loads: Loads = LOADS

    def solver(
        self,
        young: ArrayLike = 0.0,
        poisson: ArrayLike = 0.0,
        offset: ArrayLike = (0.0,) * 8,
        friction: ArrayLike = 0.0,
        sheath: ArrayLike = 0.0,
        compiled: bool | None = None,
    ) -> Solver:
        """Return a solver after changes of E, nu, and the tendons' offsets, friction, sheaths."""
        arm, scale, shifts = self.arm, 1.0 + np.ravel(young).item(), iter(np.ravel(offset))
        sections = tuple(
            RoutedSection(
                one.anchorage,
                tuple(
                    Tendon(
                        Linear(one.offset_base + up, one.offset_anchorage + up, one.anchorage),
                        tendon.angle,
                    )
                    for tendon, up in zip(one.tendons, shifts)
                ),
            )
            for one in arm.sections
        )
        changed = dataclasses.replace(
            arm,
            material=dataclasses.replace(
                arm.material,
                youngs_modulus=arm.material.youngs_modulus * scale,
                poisson_ratio=arm.material.poisson_ratio + np.ravel(poisson).item(),
            ),
            sections=sections,
            stiffness=GivenStiffness(
                **{name: one.level * scale for name, one in arm.stiffness.profiles.items()}
            ),
            friction=tuple(arm.friction + np.asarray(friction)) if arm.friction else (),
            sheath_stiffness=tuple(np.add(arm.sheath_stiffness, sheath))
            if arm.sheath_stiffness
            else (),
        )
        options = {'material': self.law, 'shear': self.shear, 'loads': self.loads}
        return Solver(changed, 'exact', 41, **options, compiled=compiled)


SHEAR = {'law': 'linear', 'shear': True}
BENT_STRIP = dataclasses.replace(
    SHEATHED,
    body=RectangularBody(0.4, 0.024, Linear(0.022, 0.016, 0.4)),
    rest=RestShape(5.0, -3.0, 4.0),
)
BENT_TUBE = dataclasses.replace(
    HELICAL,
    body=Body(0.4, 0.015, 0.01, 0.0, 0.005),
    rest=RestShape(-4.0, 6.0, 3.0),
    stiffness=GivenStiffness(bending_n=2e-3, torsion=3e-3),
)
ROD = Case(
    METAL,
    'linear',
    tensions=np.array([[3.0, 0.0, 1.0], [0.0, 4.0, 0.5]]),
    loads=Loads(tip_force=(0.0, 0.05, 0.1)),
)
THICK = dataclasses.replace(
    METAL, discs=Discs.evenly(5, 0.4, 0.005), rest=RestShape(2.0, -1.0, 1.0)
)
CASES = {
    'unloaded': Case(HELICAL, loads=Loads()),
    'unloaded with shear': Case(HELICAL, **SHEAR, loads=Loads()),
    'loaded': Case(HELICAL),
    'loaded with shear': Case(HELICAL, **SHEAR),
    'metal': ROD,
    'in sheaths': Case(SHEATHED),
    'bent strip': Case(BENT_STRIP),
    'bent tube with shear': Case(BENT_TUBE, **SHEAR),
    'between discs': Case(dataclasses.replace(HELICAL, discs=Discs.evenly(16, 0.4))),
    'between thick discs': ROD._replace(arm=THICK, shear=True),
}
# With friction the equations do not derive from an energy.
SMOOTH = tuple(np.random.default_rng(3).uniform(0.05, 0.4, 6).tolist())
SLIDING = {
    f'sliding {name}': case._replace(arm=dataclasses.replace(case.arm, friction=SMOOTH))
    for name, case in CASES.items()
    if name != 'bent tube with shear'
}


class Solved(NamedTuple):
    """A case with its solution and derivatives, computed once for all tests."""

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
    """Return poses and strains at a station in the middle and at the tip, and tendon lengths."""
    parts = []
    for i in (backbone.s.size // 2, -1):
        turn = (
            Rotation.from_quat(backbone.quaternion[i]) * Rotation.from_quat(at.quaternion[i]).inv()
        )
        strains = backbone.tau[i], backbone.xi[i], backbone.k[i], backbone.q[i]
        parts += [*backbone.position[i], *turn.as_rotvec(), *strains]
    return np.array([*parts, *np.ravel(solver.tendon_lengths(backbone))])


def outcome_of(change: Change) -> FloatArray:
    """Return the derivatives of the values of `outcome` from a `Change`."""
    parts = []
    for i in (change.pose.shape[0] // 2, -1):
        parts += [change.pose[i], change.strain[i]]
    return np.concatenate([*parts, change.tendon_length])


def moves_of(case: Case, by: Sensitivity) -> dict[str, tuple[Change, FloatArray]]:
    """Return the derivatives by every input and the step of its difference."""
    tensions, radius = np.ravel(case.tensions), float(case.arm.body.half_sizes(0.2).min())
    bending = float(case.arm.material.youngs_modulus) * math.pi * radius**4 / 4
    moment = 0.01 * bending / case.arm.body.length
    steps = {
        # Slack tendons have one-sided derivatives and are not varied here.
        'tensions': (by.by_tension, 0.02 * tensions),
        'wrench': (by.by_tip_wrench, np.repeat([moment / case.arm.body.length, moment], 3)),
        'young': (by.by_youngs_modulus, np.array([1e-2])),
        'poisson': (by.by_poisson_ratio, np.array([1e-2])),
        'offset': (by.by_offset, np.full(tensions.size, 1e-4)),
        'friction': (by.by_friction, np.full(tensions.size, 0.01)),
        'sheath': (by.by_sheath_stiffness, 0.01 * np.array(case.arm.sheath_stiffness)),
    }
    assert (by.by_friction is None) == (not case.arm.friction)
    assert (by.by_sheath_stiffness is None) == (not case.arm.sheath_stiffness)
    return {name: (change, step) for name, (change, step) in steps.items() if change is not None}


# Inputs that are varied together have effects of similar size.
TOGETHER = (('tensions', 'wrench', 'young'), ('offset', 'friction', 'poisson'), ('sheath',))


@pytest.mark.parametrize('names', TOGETHER, ids=' '.join)
def test_derivatives_equal_finite_differences(solved, names):
    case, random = solved.case, np.random.default_rng(4)
    moves, ways = moves_of(case, solved.sensitivity), {}
    moves = {name: move for name, move in moves.items() if name in names}
    if not moves:
        return  # without sheaths
    for name, (_, step) in moves.items():
        # Components get different fractions of their steps.
        ways[name] = step * random.uniform(0.4, 1.0, step.size) * random.choice([-1, 1], step.size)

    def outcome_at(factor):
        changes = {name: factor * way for name, way in ways.items()}
        tensions = np.ravel(case.tensions) + changes.pop('tensions', 0.0)
        wrench, solver = changes.pop('wrench', None), case.solver(**changes)
        shape = solver.solve(
            tensions.reshape(np.shape(case.tensions)), wrench, start=solved.backbone
        )
        return outcome(solver, shape, solved.backbone)

    expected = along(outcome_at, np.zeros(1), np.ones(1))
    columns = np.concatenate([outcome_of(change) for change, _ in moves.values()], axis=1)
    way = np.concatenate(list(ways.values()))
    analytic, sizes = columns @ way, np.abs(columns) @ np.abs(way)
    # Compare positions, angles, curvatures, strains and lengths, each relative to its largest.
    kinds = np.array([*2 * (*3 * (0,), *3 * (1,), *3 * (2,), 3), *(len(analytic) - 20) * (4,)])
    for kind in range(5):
        rows = kinds == kind
        # Relative to the sum of absolute values, because components may cancel each other.
        scale = max(sizes[rows].max(), 1e-9)  # strains are zero in rigid discs
        # Changes of strains are interpolated between nodes.
        atol = (1e-3 if kind in (2, 3) else 2e-5) * scale
        assert_allclose(analytic[rows], expected[rows], atol=atol, rtol=0)


def test_derivative_by_a_slack_tension_is_one_sided():
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


# Reciprocity (Maxwell): without friction and dead moments there is an energy --------------------


@pytest.mark.parametrize('name', CASES)
def test_compliances_are_symmetric_and_reciprocal(name):
    case = CASES[name]
    points = tuple(PointLoad(load.s, load.force) for load in case.loads.points)
    loads = dataclasses.replace(case.loads, tip_moment=(0.0, 0.0, 0.0), points=points)
    solver = case._replace(loads=loads).solver()
    sensitivity = solver.sensitivity(solver.solve(case.tensions))
    # In units in which forces and moments have similar sizes.
    unit = np.array(3 * [1.0] + 3 * [case.arm.body.length])[:, np.newaxis]
    compliance = sensitivity.compliance * unit * unit.T
    lengths = sensitivity.by_tension.tendon_length
    for symmetric, sign in ((compliance, 1.0), (lengths, -1.0)):
        assert_allclose(symmetric, symmetric.T, atol=1e-8 * np.abs(symmetric).max())
        # The tip moves along a force, and a tendon under more tension gets shorter.
        eigenvalues = sign * np.linalg.eigvalsh(symmetric)
        assert eigenvalues.min() > -1e-9 * eigenvalues.max()
    assert np.linalg.eigvalsh(compliance).min() > 0.0
    expected = -sensitivity.by_tension.tip * unit
    actual = sensitivity.by_tip_wrench.tendon_length.T * unit
    assert_allclose(actual, expected, atol=1e-8 * np.abs(expected).max())


def test_tip_covariance_is_the_sum_over_all_inputs(solved):
    # Deviations of E and nu are relative.
    by, deviation = solved.sensitivity, Uncertainty(0.01, 0.02, 0.03, 1e-4)
    parts = by.by_tension, by.by_youngs_modulus, by.by_poisson_ratio, by.by_offset
    sizes = 0.01, 0.02, 0.03, 1e-4
    columns = np.concatenate([size * part.tip for size, part in zip(sizes, parts)], axis=1)
    unit = np.array(3 * [1.0] + 3 * [solved.case.arm.length])[:, np.newaxis]
    expected = columns @ columns.T * unit * unit.T
    for actual in (
        by.tip_covariance(deviation),
        solved.solver.tip_covariance(solved.backbone, deviation),
    ):
        assert_allclose(
            actual * unit * unit.T, expected, rtol=0, atol=1e-7 * np.abs(expected).max()
        )


def test_arrays_give_the_shape_and_derivatives_of_compiled_loops(solved):
    pytest.importorskip('numba')
    solver = solved.case.solver(compiled=False)
    shape = solver.solve(solved.case.tensions)
    for name in ('position', 'quaternion', 'tau', 'xi', 'k', 'q', 'tendon_tensions'):
        found, expected = getattr(shape, name), getattr(solved.backbone, name)
        scale = max(1.0, np.abs(expected).max())
        assert_allclose(found, expected, rtol=0.0, atol=1e-12 * scale, err_msg=name)
    expected = moves_of(solved.case, solved.sensitivity)
    for name, (change, _) in moves_of(solved.case, solver.sensitivity(shape)).items():
        other = outcome_of(expected[name][0])
        atol = 1e-9 * np.abs(other).max()
        assert_allclose(outcome_of(change), other, rtol=0.0, atol=atol, err_msg=name)
