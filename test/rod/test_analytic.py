"""Analytic first derivatives of the shape against finite differences, and what they must obey."""

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
from octo_arm_model.arm.material import LINEAR
from octo_arm_model.rod.rod import Setting
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
    """An arm under tensions and loads."""

    arm: Arm
    setting: Setting
    tensions: FloatArray = PULL
    loads: Loads = LOADS

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
        law = 'linear' if self.setting.law == LINEAR else 'neo_hookean'
        given = {'material': law, 'shear': self.setting.shear, 'loads': self.loads}
        return Solver(changed, 'exact', 41, **given)


RUBBER, SHEAR = Setting(), Setting(law=LINEAR, shear=True)
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
    Setting(law=LINEAR),
    np.array([[3.0, 0.0, 1.0], [0.0, 4.0, 0.5]]),
    Loads(tip_force=(0.0, 0.05, 0.1)),
)
THICK = dataclasses.replace(
    METAL, discs=Discs.evenly(5, 0.4, 0.005), rest=RestShape(2.0, -1.0, 1.0)
)
CASES = {
    'unloaded': Case(HELICAL, RUBBER, loads=Loads()),
    'unloaded with shear': Case(HELICAL, SHEAR, loads=Loads()),
    'loaded': Case(HELICAL, RUBBER),
    'loaded with shear': Case(HELICAL, SHEAR),
    'metal': ROD,
    'in sheaths': Case(SHEATHED, RUBBER),
    'bent strip': Case(BENT_STRIP, RUBBER),
    'bent tube with shear': Case(BENT_TUBE, SHEAR),
    'between discs': Case(dataclasses.replace(HELICAL, discs=Discs.evenly(16, 0.4)), RUBBER),
    'between thick discs': ROD._replace(arm=THICK, setting=SHEAR),
}
# With friction, whose equations derive from no energy.
SMOOTH = tuple(np.random.default_rng(3).uniform(0.05, 0.4, 6).tolist())
SLIDING = {
    f'sliding {name}': case._replace(arm=dataclasses.replace(case.arm, friction=SMOOTH))
    for name, case in CASES.items()
    if name != 'bent tube with shear'
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


# Reciprocity (Maxwell): without friction and dead moments all of it derives from one energy ------


@pytest.mark.parametrize('name', CASES)
def test_tendons_and_tip_answer_each_other_alike(name):
    case = CASES[name]
    points = tuple(PointLoad(load.s, load.force) for load in case.loads.points)
    loads = dataclasses.replace(case.loads, tip_moment=(0.0, 0.0, 0.0), points=points)
    solver = case._replace(loads=loads).solver()
    by = solver.sensitivity(solver.solve(case.tensions))
    # In units in which all are of one size.
    unit = np.array(3 * [1.0] + 3 * [case.arm.body.length])[:, np.newaxis]
    compliance = by.compliance * unit * unit.T
    lengths = by.by_tension.tendon_length
    for symmetric, sign in ((compliance, 1.0), (lengths, -1.0)):
        assert_allclose(symmetric, symmetric.T, atol=1e-7 * np.abs(symmetric).max())
        # The tip yields to a force, and a tendon that pulls gets shorter.
        eigenvalues = sign * np.linalg.eigvalsh(symmetric)
        assert eigenvalues.min() > -1e-9 * eigenvalues.max()
    assert np.linalg.eigvalsh(compliance).min() > 0.0
    expected = -by.by_tension.tip * unit
    found = by.by_tip_wrench.tendon_length.T * unit
    assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


# Uncertainty -----------------------------------------------------------------------------------


def test_the_tips_covariance_adds_up_what_each_input_moves_it_by(solved):
    # In the units of a pose and of one in which all are of one size; E and nu are relative ones.
    deviation, by = Uncertainty(0.01, 0.02, 0.03, 1e-4), solved.sensitivity
    parts = (by.by_tension, by.by_youngs_modulus, by.by_poisson_ratio, by.by_offset)
    sizes = (
        deviation.tension,
        deviation.youngs_modulus,
        deviation.poisson_ratio,
        deviation.offset,
    )
    moved = np.concatenate([size * part.tip for size, part in zip(sizes, parts)], axis=1)
    unit = np.array(3 * [1.0] + 3 * [solved.case.arm.length])[:, np.newaxis]
    expected = moved @ moved.T * unit * unit.T
    for found in (
        by.tip_covariance(deviation),
        solved.solver.tip_covariance(solved.backbone, deviation),
    ):
        assert_allclose(
            found * unit * unit.T, expected, rtol=0, atol=1e-7 * np.abs(expected).max()
        )
