"""The loaded arm: textbook solutions, balance, and a boundary value solver."""

import dataclasses
import math

import numpy as np
import pytest
import reference_exact as reference
import rods
from differences import jacobian
from numpy.testing import assert_allclose
from rods import CONE, HELICAL, HELICES, METAL, RUBBER, mapped, scaled
from scipy.integrate import quad, trapezoid
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Backbone,
    Body,
    ConfigError,
    Discs,
    DistributedLoad,
    LoadError,
    Loads,
    Material,
    Plane,
    PointLoad,
    Pose,
    Section,
    Solver,
)

LAWS = ('linear', 'neo_hookean')
GRAVITY = (0.0, 0.0, -9.81)
HELICAL_TENSIONS = np.array([[0.5, 1.0, 0.0], [2.0, 0.5, 3.0]])
ROD_TENSIONS = np.array([[3.0, 0.0, 1.0], [0.0, 4.0, 0.0]])
EVERYTHING = dataclasses.replace(
    rods.EVERYTHING, tip_force=(0.01, 0.02, -0.01), tip_moment=(1e-4, -2e-4, 1e-4)
)
POINTS = dataclasses.replace(EVERYTHING, gravity=(0.0, 0.0, 0.0), distributed=())


def rod_of(length: float, radius: float, tip: float | None = None, young: float = 1e9) -> Arm:
    """Return an arm with a tendon on its midline."""
    section = Section(length, 0.0, 0.0, angles=(0.0,))
    return Arm(Material(young, 0.3, 1200.0), Body(length, radius, tip or radius), (section,))


def assert_same(shape: Backbone, expected: Backbone, atol: float) -> None:
    assert_allclose(shape.position, expected.position, atol=atol)
    overlap = np.abs((shape.quaternion * expected.quaternion).sum(axis=-1))
    assert_allclose(overlap, 1.0, atol=atol)
    for name in ('tau', 'xi', 'k', 'q'):
        a, b = getattr(shape, name), getattr(expected, name)
        assert_allclose(a, b, atol=100 * atol * (np.abs(b).max() + 1.0))


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize(
    'loads',
    [
        Loads(tip_force=(0.0, 0.0, 0.0)),
        Loads(gravity=GRAVITY, fluid_density=1080.0),
        Loads(distributed=(DistributedLoad((0.0, 0.4), ((0, 0, 0), (0, 0, 0))),)),
    ],
    ids=['nothing', 'floating', 'no force'],
)
def test_zero_loads_give_the_unloaded_shape(law, loads):
    expected = Solver(HELICAL, 'exact', material=law).solve(HELICAL_TENSIONS)
    solver = Solver(HELICAL, 'exact', material=law, loads=loads)
    for shape in (
        solver.solve(HELICAL_TENSIONS),
        solver.solve(HELICAL_TENSIONS, np.zeros(6)),
        solver.solve(HELICAL_TENSIONS, start=expected),
    ):
        for name in ('position', 'quaternion', 'tau', 'xi', 'k', 'q'):
            assert_allclose(getattr(shape, name), getattr(expected, name), atol=1e-12)


# Textbooks -------------------------------------------------------------------------------------


def test_shear_adds_the_timoshenko_deflection():
    arm, force = rod_of(0.1, 0.01, young=1e6), 1e-5
    shape = Solver(arm, 'exact', material='linear', shear=True).solve(
        [[0.0]], (0.0, force, 0.0, 0.0, 0.0, 0.0)
    )
    area = math.pi * 1e-4
    expected = force * (0.1**3 / (3 * 1e6 * area * 1e-4 / 4) + 0.1 / (1e6 / 2.6 * area))
    assert shape.tip[1] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize('end_angle', [0.1, 0.6, 1.0, 1.3, 1.5])
def test_large_tip_force_gives_the_elastica(end_angle):
    # Bisshopp and Drucker 1945; the thin rod hardly stretches.
    arm = rod_of(1.0, 1e-4)
    bending = 1e9 * math.pi * 1e-16 / 4.0
    m = (1.0 + math.sin(end_angle)) / 2.0
    start = math.asin(math.sqrt(0.5 / m))
    alpha = ellipk(m) - ellipkinc(start, m)
    force = alpha**2 * bending
    shape = Solver(arm, 'exact', material='linear').solve(
        [[0.0]], (0.0, 0.0, force, 0.0, 0.0, 0.0)
    )
    across = 1.0 - 2.0 / alpha * (ellipe(m) - ellipeinc(start, m))
    along = math.sqrt(2.0 * math.sin(end_angle)) / alpha
    assert_allclose(shape.tip, [along, 0.0, across], atol=1e-6)
    tangent = Rotation.from_quat(shape.quaternion[-1]).apply([1.0, 0.0, 0.0])
    assert math.atan2(tangent[2], tangent[0]) == pytest.approx(end_angle, abs=1e-6)


@pytest.mark.parametrize('law', LAWS)
# The upward case is below the buckling load.
@pytest.mark.parametrize('gravity', [9.81, -0.5])
def test_stretch_of_hanging_and_standing_arms_equals_that_of_their_weight(law, gravity):
    # The arm would buckle under its weight at about twice this length.
    length = 0.15
    arm = rod_of(length, 0.02, 0.012, 1e5)
    loads = Loads(gravity=(gravity, 0.0, 0.0), fluid_density=200.0)
    shape = Solver(arm, 'exact', 11, material=law, loads=loads).solve([[0.0]])

    def stretch(s):
        radius, tip = float(arm.body.radius(s)), 0.012
        # The weight of the frustum beyond the cross section.
        weight = 1000 * gravity * math.pi * (length - s) / 3 * (radius**2 + radius * tip + tip**2)
        stress = weight / (1e5 * math.pi * radius**2)
        if law == 'linear':
            return 1.0 + stress
        return brentq(lambda x: (x - x**-2) / 3.0 - stress, 0.5, 2.0, xtol=1e-14)

    for s, position, q in zip(shape.s, shape.position, shape.q):
        assert q == pytest.approx(stretch(s) - 1.0, abs=1e-9)
        assert position[0] == pytest.approx(quad(stretch, 0.0, s, epsabs=1e-12)[0], abs=1e-9)
    if law == 'linear':
        uniform = Solver(rod_of(length, 0.02, young=1e5), 'exact', material='linear', loads=loads)
        elongation = 1000 * gravity * length**2 / (2 * 1e5)
        assert uniform.solve([[0.0]]).tip[0] == pytest.approx(length + elongation, abs=1e-10)


# Equivalent loads ------------------------------------------------------------------------------


def test_tip_load_point_load_and_tip_wrench_are_equivalent():
    force, moment = (0.01, 0.03, -0.02), (1e-4, -2e-4, 3e-4)
    tip_load = Loads(tip_force=force, tip_moment=moment)
    expected = Solver(HELICAL, 'exact', loads=tip_load).solve(HELICAL_TENSIONS)
    point = Loads(points=(PointLoad(0.4, force, moment),))
    assert_same(Solver(HELICAL, 'exact', loads=point).solve(HELICAL_TENSIONS), expected, 1e-9)
    by_wrench = Solver(HELICAL, 'exact').solve(HELICAL_TENSIONS, (*force, *moment))
    assert_same(by_wrench, expected, 1e-10)
    half = Loads(tip_force=tuple(0.5 * f for f in force))
    rest = (*(0.5 * f for f in force), *moment)
    both = Solver(HELICAL, 'exact', loads=half).solve(HELICAL_TENSIONS, rest)
    assert_same(both, expected, 1e-10)
    assert_allclose(both.tip_wrench, (*force, *moment), rtol=1e-12)


def test_distributed_load_of_the_weight_equals_gravity():
    body = Body(0.4, 0.012, 0.012)
    arm = Arm(RUBBER, body, (Section(0.3, 0.01, 0.005),))
    tensions = [[0.5, 2.0, 0.0, 0.3]]
    weight = 1080.0 * math.pi * 0.012**2 * np.array(GRAVITY)
    expected = Solver(arm, 'exact', 81, loads=Loads(gravity=GRAVITY)).solve(tensions)
    uniform = DistributedLoad((0.0, 0.4), (tuple(weight), tuple(weight)))
    shape = Solver(arm, 'exact', 81, loads=Loads(distributed=(uniform,))).solve(tensions)
    assert_same(shape, expected, 1e-9)
    # Two overlapping ramps, with a corner between stations, have the same sum.
    ramps = (
        DistributedLoad((0.0, 0.17, 0.4), ((0, 0, 0), tuple(weight), tuple(weight))),
        DistributedLoad((0.0, 0.17), (tuple(weight), (0, 0, 0))),
    )
    shape = Solver(arm, 'exact', 81, loads=Loads(distributed=ramps)).solve(tensions)
    assert_allclose(shape.tip, expected.tip, atol=1e-8)


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('has_floor', [False, True], ids=['free', 'on a floor'])
def test_rotated_base_and_loads_rotate_the_shape(law, has_floor):
    turn, base = Rotation.from_euler('xyz', [0.3, -1.1, 2.0]), np.array([1e3, -0.2, 0.3])
    floor, up = np.array([0.0, 0.0, -0.06]), np.array([0.0, 0.0, 1.0])
    shapes, forces = [], []
    for turned, at in ((Rotation.identity(), np.zeros(3)), (turn, base)):
        plane = Plane(tuple(turned.apply(floor) + at), tuple(turned.apply(up)), stiffness=1e6)
        loads = mapped(EVERYTHING, turned.apply)
        loads = dataclasses.replace(loads, obstacles=(plane,) if has_floor else ())
        pose = Pose(tuple(at), tuple(turned.as_quat()))
        solver = Solver(HELICAL, 'exact', base=pose, material=law, loads=loads)
        shapes.append(solver.solve(HELICAL_TENSIONS))
        forces.append(turned.inv().apply(solver.contacts(shapes[-1]).force))
    before, after = shapes
    assert_allclose(after.position, turn.apply(before.position.copy()) + base, atol=1e-9)
    assert_allclose(after.k, before.k, atol=1e-7)
    assert_allclose(forces[1], forces[0], atol=1e-6)
    assert not has_floor or forces[0][0, 2] > 0.01


# Balance ---------------------------------------------------------------------------------------


def largest_imbalance(arm: Arm, law: str, loads: Loads, backbone: Backbone) -> float:
    """Return the largest relative imbalance of all stations of a shape."""
    # Distributed loads act on the interpolated shape between stations.
    curve, largest = CubicSpline(backbone.s, backbone.position), 0.0
    is_distributed = any(loads.gravity) or loads.distributed
    points = [*loads.points, PointLoad(arm.length, loads.tip_force, loads.tip_moment)]
    for i, s in enumerate(backbone.s):
        force, moment = np.zeros(3), np.zeros(3)
        for load in points:
            if load.s >= s:
                node = int(np.abs(backbone.s - load.s).argmin())
                lever = backbone.position[node] - backbone.position[i]
                force += load.force
                moment += np.cross(lever, load.force) + load.moment
        if is_distributed:
            edges = [at + e for load in loads.distributed for at in load.s for e in (0.0, 1e-9)]
            nodes = np.linspace(s, arm.length, 2001)
            nodes = np.union1d(nodes, [at for at in edges if at > s])
            area = np.pi * arm.body.radius(nodes) ** 2
            density = np.outer((arm.material.density - loads.fluid_density) * area, loads.gravity)
            for load in loads.distributed:
                forces = [np.interp(nodes, load.s, f, 0.0, 0.0) for f in zip(*load.force)]
                density += np.transpose(forces)
            force += trapezoid(density, nodes, axis=0)
            moment += trapezoid(
                np.cross(curve(nodes) - backbone.position[i], density), nodes, axis=0
            )
        largest = max(largest, reference.imbalance(arm, law, backbone, i, force, moment))
    return largest


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize(
    ('sections', 'loads', 'stations'),
    [
        (HELICES, Loads(), 31),
        (HELICES, POINTS, 31),
        # One section, so that the shape is smooth between stations.
        (HELICES[:1], dataclasses.replace(EVERYTHING, points=()), 201),
    ],
    ids=['free', 'pushed', 'spread'],
)
@pytest.mark.parametrize(('friction', 'left'), [((), 2e-7), ((0.3,), 1e-5)])
def test_forces_and_moments_balance_at_every_station(
    law, sections, loads, stations, friction, left
):
    arm = Arm(RUBBER, CONE, sections, friction=friction)
    tensions = HELICAL_TENSIONS[: len(sections)]
    backbone = Solver(arm, 'exact', stations, material=law, loads=loads).solve(tensions)
    assert largest_imbalance(arm, law, loads, backbone) < left


@pytest.mark.parametrize(('law', 'modulus'), [('linear', 3e4), ('neo_hookean', 2e4)])
def test_positions_have_the_accuracy_of_the_solver(table4, law, modulus):
    # The weight of an upright arm bends it to the side, where small imbalances move it far.
    section = Section(0.4, 0.01, 0.005, angles=(0.0, 2.1, 4.2))
    upright = Arm(Material(modulus, 0.45, 1080.0), Body(0.4, 0.015, 0.0075), (section,))
    level = table4.arm.with_density(1080.0)
    several = np.random.default_rng(5).uniform(size=(4, 3, 4)) * [[0.3], [2.0], [6.0]]
    for arm, gravity, tensions in (
        (upright, (-9.81, 0.0, 0.0), [[5e-8 * modulus, 0.0, 0.0]]),
        (level, GRAVITY, several),
    ):
        positions = [
            Solver(arm, 'exact', 31, material=law, loads=Loads(gravity), accuracy=accuracy)
            .solve(tensions)
            .position
            for accuracy in (1e-8, 1e-11)
        ]
        assert_allclose(*positions, rtol=0.0, atol=1e-8 * arm.length)


@pytest.mark.parametrize(
    ('arm', 'tensions', 'shear', 'loads'),
    [
        (METAL, ROD_TENSIONS, False, Loads(tip_force=(0.0, 0.0, 0.1))),
        (
            HELICAL,
            HELICAL_TENSIONS,
            True,
            dataclasses.replace(EVERYTHING, points=(), distributed=()),
        ),
    ],
    ids=['metal', 'rubber with shear'],
)
def test_shape_equals_that_of_a_boundary_value_solver(arm, tensions, shear, loads):
    arm, tensions = Arm(arm.material, arm.body, arm.sections[:1]), tensions[:1]
    solver = Solver(arm, 'exact', 21, material='linear', shear=shear, loads=loads)
    shape = solver.solve(tensions)
    expected = reference.loaded_bvp(arm, tensions, shape, loads, shear=shear, tol=1e-6)
    assert_allclose(shape.position, expected.position, atol=2e-8 * arm.length)
    rotation = Rotation.from_quat(shape.quaternion).as_matrix()
    assert_allclose(rotation, expected.rotation, atol=1e-5)
    unloaded = Solver(arm, 'exact', material='linear', shear=shear).solve(tensions)
    assert np.linalg.norm(shape.tip - unloaded.tip) > 0.1 * arm.length


# Solving ---------------------------------------------------------------------------------------


@pytest.mark.parametrize('law', LAWS)
def test_start_does_not_change_the_solution(law):
    solver = Solver(HELICAL, 'exact', material=law, loads=EVERYTHING)
    cold = solver.solve(HELICAL_TENSIONS)
    for factor, wrench in ((0.9, None), (1.2, (0.01, 0.0, 0.0, 0.0, 0.0, 0.0)), (0.0, None)):
        start = solver.solve(factor * HELICAL_TENSIONS, wrench)
        warm = solver.solve(HELICAL_TENSIONS, start=start)
        assert_same(warm, cold, 2e-8)  # a start may use finer elements
        solver.sensitivity(start)  # stores a linearisation, which must not cost iterations
        assert solver.solve(HELICAL_TENSIONS, start=start).iterations <= warm.iterations


def test_start_of_another_solver_is_refused():
    solver = Solver(HELICAL, 'exact', material='linear', loads=EVERYTHING)
    for more in ({'stations': 51}, {'shear': True}):
        other = Solver(HELICAL, 'exact', material='linear', loads=EVERYTHING, **more)
        with pytest.raises(ConfigError, match='another solver'):
            solver.solve(HELICAL_TENSIONS, start=other.solve(HELICAL_TENSIONS))


@pytest.mark.parametrize('law', LAWS)
def test_solution_equals_that_of_slowly_increasing_loads(law):
    # Other equilibria exist, which are unstable.
    followed = None
    for factor in np.linspace(0.0, 1.0, 26)[1:]:
        solver = Solver(HELICAL, 'exact', material=law, loads=scaled(EVERYTHING, factor))
        followed = solver.solve(HELICAL_TENSIONS, start=followed)
    assert_same(solver.solve(HELICAL_TENSIONS), followed, 1e-9)


def test_batch_with_loads_equals_single_solves():
    solver = Solver(HELICAL, 'exact', 31, loads=EVERYTHING)
    tensions = HELICAL_TENSIONS * np.linspace(0.0, 1.0, 3).reshape(3, 1, 1)
    wrenches = 0.01 * np.random.default_rng(0).normal(size=(2, 1, 6)) * ([1.0] * 3 + [0.01] * 3)
    together = solver.solve(tensions, wrenches)
    assert together.position.shape == (2, 3, 31, 3)
    assert together.tip_wrench.shape == (2, 3, 6)
    assert (together.residual < 1e-10).all()
    for i in range(2):
        for j in range(3):
            alone = solver.solve(tensions[j], wrenches[i, 0])
            assert_allclose(together.position[i, j], alone.position, atol=1e-9)


@pytest.mark.parametrize(
    ('make', 'error', 'message'),
    [
        (lambda: PointLoad(-0.1, (0, 0, 1)), ArmDefinitionError, 'loads.point.s is -0.1'),
        (lambda: PointLoad(0.1, (0, math.nan, 1)), ArmDefinitionError, 'three finite numbers'),
        (
            lambda: DistributedLoad((0.1, 0.2), ((0, 0, 0),)),
            ArmDefinitionError,
            'expected 2 forces, one for each s',
        ),
        (
            lambda: Solver(HELICAL, 'exact').solve([HELICAL_TENSIONS] * 2, np.zeros((3, 6))),
            LoadError,
            r'tip_wrench has leading axes \(3,\), expected those of the tensions, \(2,\), or none',
        ),
    ],
)
def test_invalid_loads_are_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()


# The bound is that of the node nearest to the tip, which is not exactly at the tip.
@pytest.mark.parametrize('factor', [0.98, 1.02])
@pytest.mark.parametrize('way', [(1.0, 0.0, 0.0), (0.6, 0.0, -0.8)])
@pytest.mark.parametrize('discs', [Discs(), Discs.evenly(9, 0.45)], ids=['path', 'discs'])
def test_all_loads_are_bounded(table4, discs, factor, way):
    # A hundred times E A of the thinnest cross section, and sqrt(E A E I).
    arm = dataclasses.replace(table4.arm.with_density(1000.0), discs=discs)
    tip = table4.arm.body.radius_tip
    largest_force = 100.0 * 1.1e5 * math.pi * tip**2
    largest_moment = 0.5 * tip * largest_force
    force = tuple(factor * largest_force * x for x in way)
    moment = tuple(factor * largest_moment * x for x in way)
    zero = (0.0, 0.0, 0.0)
    solver = Solver(arm, 'exact')
    inputs = [
        lambda: solver.check_tip_wrench((*force, *zero)),
        lambda: solver.check_tip_wrench((*zero, *moment)),
        lambda: solver.check_tip_wrench([(0.0,) * 6, (*force, *moment)]),
        lambda: Solver(arm, 'exact', loads=Loads(tip_force=force)),
        lambda: Solver(arm, 'exact', loads=Loads(tip_moment=moment)),
        lambda: Solver(arm, 'exact', loads=Loads(points=(PointLoad(0.2, force),))),
        lambda: Solver(arm, 'exact', loads=Loads(points=(PointLoad(0.2, zero, moment),))),
    ]
    for make in inputs:
        if factor < 1.0:
            make()
        else:
            with pytest.raises((LoadError, ArmDefinitionError), match='expected at most'):
                make()
    # Huge loads are refused before a solve.
    for size in (1e9, 1e300, 1.7e308) if factor > 1.0 else ():
        vector = (0.0, size, -size)
        for loads in (
            lambda: Loads(gravity=vector),
            lambda: Loads(tip_force=vector),
            lambda: Loads(distributed=(DistributedLoad((0.1, 0.2), (vector, vector)),)),
            lambda: Loads(fluid_density=size, gravity=(0.0, 0.0, -9.81)),
        ):
            with pytest.raises(ArmDefinitionError, match=r'expected .*at most'):
                Solver(arm, 'exact', loads=loads())
        for wrench in ((*vector, *zero), (*zero, *vector)):
            with pytest.raises(LoadError, match=r'on the tip is .*, expected at most'):
                solver.solve(np.zeros((3, 4)), wrench)


@pytest.mark.parametrize('turns', [1, 2, 5])
def test_coiled_slender_arm_is_resolved(turns):
    # The twist is constant, which a single point would resolve, but the midline is a circle.
    tensions = np.array([[16.0 * turns, 0.0, 0.0], [0.0, 0.0, 0.0]])
    solver, step = Solver(METAL, 'exact', 41), 1e-4 * tensions[0, 0]
    unloaded = Solver(METAL, 'exact', 1601)
    coiled = unloaded.solve(tensions)
    shape = solver.solve(tensions, tip_wrench=[0.0, 0.0, 1e-12, 0.0, 0.0, 0.0])
    angle = np.sum(np.diff(coiled.s) * np.hypot(coiled.xi, coiled.k)[1:])
    assert angle > 0.9 * math.tau * turns
    error = np.abs(shape.position - coiled.position[::40]).max()
    assert error < 2e-7 * METAL.length
    expected = jacobian(
        lambda first: unloaded.solve([[first[0], 0.0, 0.0], [0.0, 0.0, 0.0]]).tip,
        [tensions[0, 0]],
        step,
    )
    by_tension = solver.sensitivity(solver.solve(tensions)).by_tension.pose[-1, :3, :1]
    assert_allclose(by_tension, expected, rtol=0.0, atol=2e-5 * abs(expected).max())
