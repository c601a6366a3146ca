"""Tendons that are straight between discs: balance, convergence, friction and dynamics."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rods import METAL, THIRDS, tendon_points
from scipy.spatial.transform import Rotation

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Backbone,
    Body,
    Config,
    ConfigError,
    Discs,
    Dynamics,
    Inputs,
    Loads,
    Material,
    MotionProperties,
    Section,
    SolveError,
    Solver,
    displacements_of,
    load_config,
    modes,
    solve_displacements,
    wound_sensitivity,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.config.parameter_files import load_parameters

LENGTH = 0.25
STEEL = Material(40e9, 1.0 / 3.0, 7800.0)

# A nitinol rod as in built robots, with one helical tendon of one turn.
SECTIONS = (
    Section(LENGTH, 0.01, 0.01, THIRDS, (2.0 * math.pi, 0.0, 0.5)),
    Section(0.15, 0.012, 0.008, THIRDS),
)
PULL = np.array([[3.0, 0.5, 1.0], [0.2, 4.0, 0.3]])
WRENCH = np.array([0.05, 0.1, -0.1, 0.002, 0.0, 0.003])


def robot(discs: Discs | None = Discs.evenly(5, LENGTH), **fields: Any) -> Arm:
    """Return a robot of two sections."""
    body = Body(LENGTH, 0.0006, 0.0006, disc_radius=0.015)
    fields = {'material': STEEL, 'sections': SECTIONS, **fields}
    return Arm(body=body, discs=discs or Discs(), **fields)


def solver(arm: Arm, **options: Any) -> Solver:
    return Solver(arm, 'exact', **{'stations': 51, 'material': 'linear', **options})


def chords_of(solver_: Solver, shape: Backbone) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the faces of the discs, and each tendon's holes and directions there.

    Returns:
        (faces,) [m], (tendons, faces, 3) [m] and (tendons, faces - 1, 3).
    """
    faces = np.array([0.0, *solver_.arm.discs.faces])
    indices = [int(np.argmin(np.abs(shape.s - s))) for s in faces]
    assert np.abs(shape.s[indices] - faces).max() < 1e-12
    holes = tendon_points(solver_.arm, shape)[:, indices]
    chords = np.diff(holes, axis=1)
    return faces, holes, chords / np.linalg.norm(chords, axis=2, keepdims=True)


@pytest.mark.parametrize('mu', [0.0, 0.2])
@pytest.mark.parametrize(
    'discs', [Discs.evenly(5, LENGTH), Discs((0.05, 0.1, 0.2), 0.01)], ids=['thin', 'thick']
)
def test_rod_and_chords_between_discs_are_in_balance(discs, mu):
    arm = robot(discs, friction=(mu,))
    solver_ = solver(arm)
    shape = solver_.solve(0.5 * PULL, WRENCH)
    faces, holes, directions = chords_of(solver_, shape)
    is_between = np.abs(shape.s[:, np.newaxis] - faces).min(axis=1) > 1e-9
    (indices,) = np.nonzero(is_between & ~arm.discs.cover(shape.s))
    assert indices.size > 20
    bending, axial = STEEL.youngs_modulus * np.pi * 0.0006 ** np.array([4, 2]) / [4.0, 1.0]
    axes = Rotation.from_quat(shape.quaternion).as_matrix()
    for i in indices:
        interval = int(np.searchsorted(faces, shape.s[i])) - 1
        pull = shape.tendon_tensions[i][:, np.newaxis] * directions[:, interval]
        force = WRENCH[:3] - pull.sum(axis=0)
        moment = WRENCH[3:] + np.cross(shape.tip - shape.position[i], WRENCH[:3])
        moment -= np.cross(holes[:, interval] - shape.position[i], pull).sum(axis=0)
        omega = np.array([0.75 * shape.tau[i], shape.xi[i], shape.k[i]])
        expected = bending * (1.0 + shape.q[i]) * omega
        assert_allclose(axes[i].T @ moment, expected, rtol=0.0, atol=1e-6 * bending / LENGTH)
        assert force @ axes[i][:, 0] == pytest.approx(axial * shape.q[i], rel=1e-6)


def test_distances_of_the_tip_in_the_manual_are_reproduced():
    # Two tendons bend the rod of Rao et al. by 68 degrees.
    arm, tips = load_config('rao2021').arm, []
    for count in (0, 4, 10, 20):
        bent = dataclasses.replace(arm, discs=Discs.evenly(count, arm.length))
        tips.append(Solver(bent, 'exact', material='linear').solve([[2, 0, 0], [2, 0, 0]]).tip)
    distances = 100.0 * np.linalg.norm(np.array(tips[1:]) - tips[0], axis=1) / arm.length
    assert_allclose(distances, [28.0, 3.2, 0.8], rtol=0.04)


@pytest.mark.parametrize(
    'discs, tip',
    [
        (0, [[0.301831168, -0.109975349, 0.206738668], [0.396384404, -0.018834402, 0.035628664]]),
        (10, [[0.292288507, -0.114076779, 0.214988626], [0.396048700, -0.019749030, 0.037515347]]),
    ],
)
def test_tips_are_those_of_shooting_codes(discs, tip):
    # Rucker and Webster's equations with shear, and rods between discs, by other people's codes of
    # Runge and Kutta, in which a tendon that goes on past an anchorage pulls at its kink there.
    angles = (0.5 * math.pi, -math.pi / 6.0, 7.0 * math.pi / 6.0)
    arm = dataclasses.replace(
        METAL,
        sections=tuple(Section(end, 0.01, 0.01, angles) for end in (0.4, 0.2)),
        discs=Discs.evenly(discs, 0.4),
    )
    tensions = [[[1.5, 0.5, 0.0], [2.5, 0.0, 1.0]], [[0.0, 0.0, 2.0], [0.0, 1.0, 0.0]]]
    wrenches = [
        [0.02, -0.05, 0.04, 0.002, 0.001, -0.003],
        [-0.04, 0.03, 0.06, 0.004, -0.002, 1e-3],
    ]
    shapes = solver(arm, shear=True).solve(tensions, wrenches)
    assert_allclose(shapes.tip, tip, rtol=0.0, atol=2e-9)


def test_friction_acts_at_every_hole_and_has_hysteresis():
    mu, solver_ = 0.25, solver(robot(friction=(0.25,)))
    loaded = solver_.solve(0.5 * PULL, WRENCH)
    directions = chords_of(solver_, loaded)[2][0]
    angle = np.arccos((directions[1:] * directions[:-1]).sum(axis=1)).cumsum()
    local = solver_.local_tensions(loaded)[0]
    levels = np.unique(np.round(local, 9))[::-1]
    expected = 0.5 * PULL[0, 0] * np.exp(-mu * np.append(0.0, angle))
    assert_allclose(levels, expected, rtol=1e-7)
    unloaded = solver_.follow(0.45 * PULL, loaded, WRENCH)
    fresh = solver_.solve(0.45 * PULL, WRENCH)
    local = solver_.local_tensions(unloaded)
    assert (local[0] <= 0.5 * PULL[0, 0]).all() and local[0, -1] > 0.98 * levels[-1]
    assert np.linalg.norm(unloaded.tip - fresh.tip) > 1e-3 * LENGTH
    reloaded = solver_.follow(0.5 * PULL, unloaded, WRENCH)
    assert_allclose(reloaded.tip, loaded.tip, atol=2e-4 * LENGTH)


@pytest.mark.parametrize('friction', [(), (0.2,)])
def test_displacements_determine_the_tensions(friction):
    discs = Discs.evenly(5, LENGTH, 0.002)
    arm = robot(discs, friction=friction, axial_stiffness=(2e4,), free_length=(0.1,))
    robot_ = solver(arm)
    shape = robot_.solve(0.5 * PULL, WRENCH)
    lengths = displacements_of(robot_, shape).ravel()

    def solve(change=0.0, start=None):
        named = dict(zip(arm.tendon_names, [lengths[0], lengths[1] + change, *lengths[2:]]))
        return solve_displacements(robot_, named, start=start, tip_wrench=WRENCH)

    result = solve()
    assert_allclose(result.backbone.tensions, 0.5 * PULL, rtol=1e-5)
    assert_allclose(result.backbone.tip, shape.tip, atol=1e-7 * LENGTH)
    if not friction:  # with it, one of both steps would unload
        analytic = wound_sensitivity(robot_, result).by_displacement.pose[-1, :3, 1]
        ends = [solve(change, result).backbone.tip for change in (1e-6, -1e-6)]
        assert_allclose(analytic, (ends[0] - ends[1]) / 2e-6, rtol=1e-4, atol=1e-5)


def test_heavy_disc_at_the_tip_agrees_with_beam_theory():
    light = Material(40e9, 0.3, 1e-3)
    heavy = Discs((LENGTH,), 1e-3, 0.05)
    arm = robot(heavy, material=light, sections=(Section(LENGTH, 0.01, 0.01),))
    solver_ = solver(arm, loads=Loads(gravity=(0.0, 0.0, -9.81)), stations=101)
    free_length = LENGTH - heavy.thickness  # what bends
    stiffness = 40e9 * math.pi * 0.0006**4 / 4.0
    slack = np.zeros((1, 4))
    sag = -solver_.solve(slack).tip[2]
    lever = free_length + 0.5 * heavy.thickness
    weight = 0.05 * 9.81
    # Beam theory for small slopes: a thousandth of the mass.
    arm = dataclasses.replace(arm, discs=dataclasses.replace(heavy, mass=5e-5))
    small = solver(arm, loads=Loads(gravity=(0.0, 0.0, -9.81)))
    weight *= 1e-3
    slope = weight * (lever * free_length - 0.5 * free_length**2) / stiffness
    drop = weight * (lever * free_length**2 / 2.0 - free_length**3 / 6.0) / stiffness
    assert -small.solve(slack).tip[2] == pytest.approx(drop + slope * heavy.thickness, rel=1e-4)
    assert sag > 100.0 * drop
    swinging = Dynamics(solver(arm), MotionProperties())
    lowest = modes(swinging, swinging.at_rest(Inputs(slack)), 2).frequencies
    expected = math.sqrt(3.0 * stiffness / (5e-5 * lever**3)) / (2.0 * math.pi)
    assert_allclose(lowest, expected, rtol=0.02)  # beam theory neglects the disc's rotary inertia


def test_random_robots_converge_and_buckling_between_discs_is_an_error():
    rng, bending = np.random.default_rng(0), 40e9 * math.pi * 0.0006**4 / 4.0
    for _ in range(6):
        discs = Discs.evenly(int(rng.integers(2, 15)), LENGTH, float(rng.choice([0.0, 0.003])))
        arm = robot(discs, friction=(float(rng.choice([0.0, 0.2])),))
        longest = np.diff([0.0, *arm.discs.faces]).max()
        tensions = rng.uniform(0.0, 6.0, (2, 3)) * rng.integers(0, 2, (2, 3))
        tensions *= min(1.0, 12.0 * bending / longest**2 / max(tensions.sum(), 1e-9))
        wrench = WRENCH * rng.normal(size=6)
        assert solver(arm).solve(tensions, wrench).residual < 1e-8
    with pytest.raises(SolveError, match=r'tensions fold between discs that are 0\.1'):
        solver(robot(Discs.evenly(2, LENGTH))).solve(4.0 * PULL)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'tendons.discs': [0.1, 0.1]}, 'tendons.discs is [0.1, 0.1], expected increasing'),
        ({'tendons.discs': [0.5]}, 'tendons.discs is 0.5, expected at most the length'),
        ({'tendons.disc_count': 10**9}, 'tendons.disc_count is 1000000000, expected a fin'),
        ({'tendons.disc_count': -1}, 'tendons.disc_count is -1, expected a finite'),
        ({'tendons.disc_count': 10, 'tendons.disc_thickness': 0.05}, 'expected more than 0.05'),
        ({'tendons.disc_thickness': 0.01}, 'tendons.disc_thickness is 0.01, expected 0 without'),
        ({'tendons.disc_count': 9, 'tendons.disc_mass': 0.1}, 'expected 0 of discs without'),
        ({'tendons.disc_count': 9, 'tendons.sheath_stiffness': [1e5]}, 'expected none with discs'),
    ],
)
def test_invalid_discs_are_refused(values, message):
    parameters = load_parameters('rao2021')
    with pytest.raises((ArmDefinitionError, ConfigError)) as error:
        Config.from_parameters({**parameters, **values})
    assert message in str(error.value)


def test_parameters_describe_discs_and_anchorages_are_discs():
    rod = load_parameters('rao2021')
    count = Config.from_parameters({**rod, 'tendons.disc_count': 20, 'tendons.disc_mass': 0.0})
    assert count.arm.discs == Discs.evenly(20, 0.4)
    changes = {
        'tendons.discs': [0.1, 0.3],
        'tendons.disc_thickness': 0.002,
        'tendons.disc_mass': 0.01,
    }
    arm = Config.from_parameters({**rod, **changes}).arm
    assert arm.discs == Discs((0.1, 0.2, 0.3, 0.4), 0.002, 0.01)


def test_highest_default_tension_of_one_tendon_does_not_buckle_the_arm():
    arm = dataclasses.replace(load_config('rao2021').arm, discs=Discs.evenly(4, 0.4))
    solver, highest = Solver(arm, 'exact', stations=5, material='linear'), default_highest(arm)
    for tendon in np.eye(6).reshape(6, *arm.tension_shape):
        solver.solve(tendon * highest)
    assert highest.max() < 0.3 * 12.0 * 54e9 * 0.25 * np.pi * 0.7e-3**4 / 0.1**2 * 1.001
