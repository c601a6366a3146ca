"""Contact of the arm with planes, spheres and cylinders, static and dynamic."""

import dataclasses
import math

import numpy as np
import pytest
from differences import jacobian
from rods import UNIFORM as ROD
from rods import cylinder, energy

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    ConfigError,
    ConvergenceError,
    Cylinder,
    Dynamics,
    Inputs,
    Loads,
    MotionProperties,
    Plane,
    Pose,
    RectangularBody,
    SolveError,
    Solver,
    Sphere,
    solve_displacements,
)
from octo_arm_model.arm.limits import Budget
from octo_arm_model.arm.obstacles import Obstacle
from octo_arm_model.rod.contact import Contact, NodeMotion
from octo_arm_model.rod.elements import build_elements
from octo_arm_model.rod.rotations import rotation_matrices

RADIUS, LENGTH = 0.01, 0.45
SLACK = np.zeros(ROD.tension_shape)
BENDING = 1e5 * 0.25 * math.pi * RADIUS**4
WEIGHT = 1000.0 * 9.81 * math.pi * RADIUS**2  # per length
GRAVITY = (0.0, 0.0, -9.81)


def solver_of(
    *obstacles: Obstacle, loads: Loads = Loads(), stations: int = 901, accuracy: float = 1e-5
) -> Solver:
    loads = dataclasses.replace(loads, obstacles=obstacles)
    return Solver(ROD, 'exact', stations, material='linear', loads=loads, accuracy=accuracy)


def floor(gap: float, stiffness: float) -> Plane:
    """Return a floor at a ``gap`` below a horizontal arm."""
    return Plane((0.0, 0.0, -RADIUS - gap), (0.0, 0.0, 2.0), stiffness=stiffness)


@pytest.mark.parametrize(('gap', 'stiffness'), [(2e-3, 2e7), (5e-4, 5e7)])
def test_rod_above_a_floor_touches_it_beyond_its_free_span(gap, stiffness):
    # Free up to a = (72 E J d / w)^(1/4) with a force w a / 3 there; the floor carries w beyond.
    solver = solver_of(floor(gap, stiffness), loads=Loads(gravity=GRAVITY), accuracy=1e-6)
    shape = solver.solve(SLACK)
    span = (72.0 * BENDING * gap / WEIGHT) ** 0.25
    contacts = solver.contacts(shape)
    total_force = WEIGHT * (span / 3.0 + LENGTH - span)
    assert contacts.force[0] == pytest.approx([0.0, 0.0, total_force], rel=2e-3, abs=1e-9)
    touched = contacts.s[contacts.penetration[0] > 0.0]
    # The penalty spreads the force over the characteristic length of a beam on springs.
    spread = (4.0 * BENDING / (2.0 * RADIUS * stiffness)) ** 0.25
    assert span - 1.5 * spread < touched.min() < span
    free = shape.s <= 0.9 * span
    x = shape.s[free]
    sag = WEIGHT * x**2 / (72.0 * BENDING) * (3.0 * x**2 - 8.0 * span * x + 6.0 * span**2)
    assert -shape.position[free, 2] == pytest.approx(sag, abs=0.015 * gap)
    # The penetration is inversely proportional to the stiffness.
    depth = np.interp(0.3, contacts.s, contacts.penetration[0])
    assert depth == pytest.approx(WEIGHT / (2.0 * RADIUS * stiffness), rel=1e-3)


def arm_around_a_post(young: float) -> tuple[Arm, Cylinder, float]:
    """Return an arm of 2 mm, a post above it, and a force 30 E J / r^2 that wraps the arm."""
    radius, post = 2e-3, 0.04
    force = 30.0 * young * 0.25 * math.pi * radius**4 / (post + radius) ** 2
    round_post = Cylinder((0.2, post + radius, 0.0), (0.0, 0.0, 1.0), post, stiffness=1e7)
    return cylinder(LENGTH, radius, young), round_post, force


def test_arm_around_a_post_has_the_curvature_of_the_post():
    arm, post, force = arm_around_a_post(1e5)
    loads = Loads(tip_force=(0.0, force, 0.0), obstacles=(post,))
    solver = Solver(arm, 'exact', 451, material='linear', loads=loads, accuracy=1e-5)
    shape = solver.solve(SLACK)
    contacts = solver.contacts(shape)
    touched = contacts.s[contacts.penetration[0] > 0.0]
    middle = (shape.s > touched.min() + 0.015) & (shape.s < touched.max() - 0.015)
    assert middle.sum() > 20
    assert shape.k[middle] == pytest.approx(1.0 / (post.radius + 2e-3), rel=0.01)
    # The post turns the direction of the force by a right angle.
    assert contacts.force[0] == pytest.approx([force, -force, 0.0], rel=0.01)


PULL = np.array([[0.05, 0.02]])


@pytest.mark.parametrize(
    ('obstacle', 'law', 'shear'),
    [
        (Sphere((0.3, 0.13, -0.015), 0.04, stiffness=2e6), 'linear', False),
        (Cylinder((0.3, 0.13, 0.0), (0.3, 0.1, 1.0), 0.04, stiffness=2e6), 'linear', True),
        (Cylinder((0.3, 0.13, 0.0), (0.3, 0.1, 1.0), 0.04, stiffness=2e6), 'neo_hookean', False),
    ],
    ids=['sphere', 'shear', 'rubber'],
)
def test_sensitivities_with_contact_equal_finite_differences(obstacle, law, shear):
    loads = Loads(gravity=(0.0, 0.1, -0.6), obstacles=(floor(0.02, 2e6), obstacle))
    options = {'material': law, 'shear': shear, 'loads': loads, 'accuracy': 1e-5}
    leaning = Solver(ROD, 'exact', 5, **options)

    def position(change: np.ndarray) -> np.ndarray:
        wrench = [*change[2:], 0.0, 0.0, 0.0]
        return leaning.solve(PULL + change[:2], tip_wrench=wrench, start=shape).position

    shape = leaning.solve(PULL)
    assert np.abs(leaning.contacts(shape).force).max(axis=1).min() > 1e-3
    by = leaning.sensitivity(shape)
    expected = jacobian(position, np.zeros(5), np.array([1e-4, 1e-4, 1e-5, 1e-5, 1e-5]))
    analytic = np.concatenate([by.by_tension.pose, by.by_tip_wrench.pose[..., :3]], axis=-1)[:, :3]
    assert analytic == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.abs(expected).max())


def test_walls_hold_a_buckled_column():
    # Twice Euler's load, pi^2 E J / (2 L)^2, with walls on all sides.
    gap = 0.02
    load = 2.0 * math.pi**2 * BENDING / (2.0 * LENGTH) ** 2
    walls = [Plane((0.0, y, 0.0), (0.0, -y, 0.0), stiffness=1e6) for y in (-gap, gap)]
    sides = [Plane((0.0, 0.0, z), (0.0, 0.0, -z), stiffness=1e6) for z in (-gap, gap)]
    push = Loads(tip_force=(-load, 0.0, 0.0))
    shape = solver_of(*walls, *sides, loads=push).solve(SLACK)
    deflection = np.abs(shape.position[:, 1:]).max()
    assert gap - RADIUS < deflection < 1.02 * (gap - RADIUS)
    assert np.abs(solver_of(loads=push).solve(SLACK).position[:, 1:]).max() > 10.0 * gap


def test_obstacle_that_is_not_touched_costs_no_accuracy():
    loads = Loads(gravity=GRAVITY, obstacles=(floor(10.0, 1e6),))
    beside, alone = (Solver(ROD, 'exact', loads=each) for each in (loads, Loads(gravity=GRAVITY)))
    assert beside.solve([[1.0, 0.2]]).tip == pytest.approx(
        alone.solve([[1.0, 0.2]]).tip, abs=2e-8 * LENGTH
    )


def test_arm_that_a_tendon_pulls_away_is_found_though_a_ball_is_where_it_is_unloaded():
    ball = Sphere((0.3, 0.0, 0.003), 0.02, stiffness=2e6)
    solver, alone = (solver_of(*each, accuracy=1e-8) for each in ((ball,), ()))
    free = alone.solve([[1.0, 0.0]])
    assert ball.nearest(free.position)[0].min() > RADIUS
    assert solver.solve([[1.0, 0.0]]).tip == pytest.approx(free.tip, abs=2e-8 * LENGTH)
    with pytest.raises(ConvergenceError, match=r'0.017 m inside loads.obstacles\[0\]'):
        solver.solve(SLACK)
    reeled_in = {'tendon_1_1': float(alone.displacements(free)[0, 0])}
    wound = solve_displacements(solver, reeled_in)
    assert wound.backbone.tip == pytest.approx(free.tip, abs=1e-7 * LENGTH)


@pytest.mark.parametrize('at', [0.4, 0.4004, 0.4008])
def test_slender_arm_does_not_pass_through_an_equally_thin_post(at):
    arm, radius = cylinder(1.0, 1e-3, 1e7), 1e-3
    force = 1e7 * 0.25 * math.pi * radius**4
    post = Cylinder((at, 3.0 * radius, 0.0), (0.0, 0.0, 1.0), radius, stiffness=1e7)
    loads = Loads(tip_force=(0.0, force, 0.0), obstacles=(post,))
    solver = Solver(arm, 'exact', 501, material='linear', loads=loads, accuracy=1e-5)
    shape = solver.solve(SLACK)
    assert solver.contacts(shape).force[0, 1] < -force
    height = np.interp(at, shape.position[:, 0], shape.position[:, 1])
    assert 0.5 * radius < height < 1.5 * radius


def test_invalid_obstacles_are_refused():
    with pytest.raises(ArmDefinitionError, match=r'radius of the arm .* is 5e-05, expected at l'):
        Solver(cylinder(1.0, 5e-5), 'exact', loads=Loads(obstacles=(floor(0.1, 1e6),)))
    ball = Sphere((0.2, 0.0, 0.1), 0.05, stiffness=1e6)
    with pytest.raises(SolveError, match=r'inside loads.obstacles\[0\] at s = 0\.2'):
        solver_of(Sphere((0.2, 0.0, 0.03), 0.05, stiffness=1e-3)).solve(SLACK)
    with pytest.raises(ArmDefinitionError, match=r'outside of loads.obstacles\[1\], not 0.01'):
        solver_of(ball, floor(-2.0 * RADIUS, 1e6))
    way = r'under its tensions alone is 0.0\d* m inside loads.obstacles\[1\] at s = 0.2'
    with pytest.raises(ConvergenceError, match=way):
        solver_of(ball, Sphere((0.2, 0.0, 0.0), 0.03, stiffness=1e6), stations=11).solve(SLACK)
    strip = dataclasses.replace(ROD, body=RectangularBody(LENGTH, 0.02, 0.02))
    with pytest.raises(ArmDefinitionError, match='a rectangular body has no contact'):
        Solver(strip, 'exact', loads=Loads(obstacles=(ball,)))

    rough = dataclasses.replace(ball, friction=0.3)
    with pytest.raises(ConfigError, match=r'loads\.obstacles have friction'):
        solver_of(rough).solve(SLACK)
    for wrong, match in (
        ({'radius': 0.0}, r'Sphere.radius is 0.0, expected a finite number > 0'),
        ({'stiffness': -1.0}, r'Sphere.stiffness is -1.0, expected a finite number > 0'),
        ({'friction': math.nan}, r'Sphere.friction is nan, expected a finite coefficient >= 0'),
        ({'creep_speed': 0.0}, r'Sphere.creep_speed is 0.0, expected a finite number > 0'),
        ({'centre': (0.0, 1.0)}, r'Sphere.centre is \(0.0, 1.0\), expected three finite numbers'),
    ):
        with pytest.raises(ArmDefinitionError, match=match):
            dataclasses.replace(ball, **wrong)  # type: ignore[arg-type]
    with pytest.raises(ArmDefinitionError, match=r'Plane\.normal is .*, expected a direction'):
        Plane((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), stiffness=1.0)
    with pytest.raises(ArmDefinitionError, match=r'number of loads\.obstacles is 33, expected at'):
        Loads(obstacles=33 * (ball,))


def test_soft_arm_that_tensions_press_against_a_wall_is_found(table4):
    # Hundreds of contacts begin and end one by one, if the wall is stiff while loads grow.
    wall = Plane((0.3, 0.0, 0.0), (-1.0, 0.0, 0.3), stiffness=1e6)
    loads = Loads(gravity=GRAVITY, fluid_density=1000.0, obstacles=(wall,))
    arm, random = table4.arm.with_density(1080.0), np.random.default_rng(11)
    solver = Solver(arm, 'exact', 51, loads=loads, budget=Budget(iterations=500))
    for _ in range(2):
        pulls = random.random((3, 4)) * [[0.15], [0.8], [2.0]] * random.integers(0, 2, (3, 4))
        shape = solver.solve(pulls)
        assert solver.contacts(shape).force[0, 0] < -0.002
        assert solver.solve(pulls, start=shape).iterations <= 1


# Motion ------------------------------------------------------------------------------------------


# All of an arm of 0.3 m is inside each obstacle, so that no contact begins or ends.
AROUND = (
    Plane((0.1, 0.0, 0.4), (0.2, -0.1, 1.0), stiffness=4e3),
    Sphere((0.2, 0.3, -0.1), 0.9, stiffness=2e3),
    Cylinder((0.1, -0.2, 0.3), (0.5, 1.0, -0.3), 0.8, stiffness=3e3),
)


def test_derivatives_of_contact_friction_equal_finite_differences():
    rough = tuple(dataclasses.replace(one, friction=0.4, creep_speed=0.1) for one in AROUND)
    elements = build_elements(ROD)
    contact, s = Contact(ROD, elements, rough), elements.s
    straight = np.stack([s, 0.1 * s, 0.2 * s * s], axis=1)
    velocity = np.stack([0.2 + s, np.cos(9.0 * s), -0.3 * s], axis=1)
    axes = rotation_matrices(np.array([[0.8], [0.2], [-0.4], [0.4]]))[..., 0].T
    rates = np.cross([0.5, -2.0, 3.0], axes)
    displacement = np.stack([np.sin(5.0 * s), 0.3 - s, s * s], axis=1)
    rotation, by_velocity = np.array([0.6, -0.3, 0.5]), 30.0

    def at(factor: np.ndarray) -> tuple[np.ndarray, NodeMotion]:
        change = factor[0] * np.cross(rotation, axes)
        spin = (rates + by_velocity * change).T @ (axes + change)
        move = factor[0] * displacement
        motion = NodeMotion(velocity + by_velocity * move, np.tile(spin, (s.size, 1, 1)))
        return straight + move, motion

    expected = jacobian(lambda factor: contact.densities(*at(factor)), np.zeros(1), 1e-5)[..., 0]
    tangents = contact.tangents(*at(np.zeros(1)), by_velocity)
    assert tangents is not None
    # Densities by poses (2, E, 3 p) of the nodes of each element.
    pose = np.stack([displacement, np.tile(rotation, (s.size, 1))])
    pose = pose.reshape(2, elements.lengths.size, -1, 1)
    analytic = (tangents @ pose).sum(axis=1).reshape(2, s.size, 3)
    for actual, other in zip(analytic, expected):
        assert actual == pytest.approx(other, rel=1e-6, abs=1e-7 * np.abs(other).max())


def test_friction_of_a_dragged_arm_is_mu_times_the_normal_force():
    mu, speed, creep, dt = 0.3, 0.02, 1e-3, 5e-3
    rough_floor = dataclasses.replace(floor(0.0, 1e5), friction=mu, creep_speed=creep)
    loads = Loads(gravity=GRAVITY, obstacles=(rough_floor,))
    solver = Solver(ROD, 'exact', material='linear', loads=loads)
    dynamics = Dynamics(solver, MotionProperties(damping_time=0.02))
    state, forces = dynamics.at_rest(Inputs(SLACK)), []
    assert dynamics.contacts(state).force[0, :2] == pytest.approx([0.0, 0.0], abs=1e-9)
    for number in range(1, 71):
        inputs = Inputs(SLACK, base=Pose((-number * speed * dt, 0.0, 0.0)))
        state = dynamics.step(state, inputs, dt)
        forces.append([*dynamics.contacts(state).force[0], state.base_wrench[0]])
    along, across, normal, base = np.mean(forces[45:], axis=0)
    ratio = speed / math.hypot(speed, creep)
    assert along == pytest.approx(mu * ratio * normal, rel=1e-3)
    assert base == pytest.approx(along, rel=0.02)
    assert normal == pytest.approx(WEIGHT * LENGTH, rel=0.1)  # the base carries the rest
    assert across == pytest.approx(0.0, abs=1e-9)


def test_arm_around_a_post_obeys_the_capstan_equation():
    # T2 = T1 e^(mu theta) over a right angle. Friction acts on the surface at r, the tension at
    # r + R, so that the effective mu is mu r / (r + R).
    arm, post, force = arm_around_a_post(1e6)
    rough = dataclasses.replace(post, friction=0.3)
    loads = Loads(tip_force=(0.0, force, 0.0), obstacles=(rough,))
    solver = Solver(arm, 'exact', material='linear', loads=loads, accuracy=1e-5)
    dynamics = Dynamics(solver, MotionProperties(damping_time=0.02), level=1)
    state, dt, at = dynamics.at_rest(Inputs(SLACK)), 5e-3, 0.0
    for number in range(40):
        at -= 0.02 * min(1.0, (number + 1) / 20) * dt
        state = dynamics.step(state, Inputs(SLACK, base=Pose((at, 0.0, 0.0))), dt)
    mu = 0.3 * post.radius / (post.radius + 2e-3)
    pull = state.base_wrench[0]
    assert pull / force == pytest.approx(math.exp(0.5 * math.pi * mu), rel=0.01)


def test_bounce_of_an_undamped_arm_conserves_energy():
    # On nodes that resolve the waves: at level 0 short waves grow without contact too.
    loads, undamped = Loads(gravity=GRAVITY), MotionProperties()
    dynamics = Dynamics(solver_of(floor(0.03, 1e6), loads=loads), undamped, level=2)
    state = Dynamics(solver_of(), undamped, level=2).at_rest(Inputs(SLACK))
    initial, largest_force, errors = energy(dynamics, state), 0.0, []
    for number in range(110):
        state = dynamics.step(state, Inputs(SLACK), 1e-3)
        force = float(dynamics.contacts(state).force[0, 2])
        largest_force = max(largest_force, force)
        if number > 80 and not force:
            errors.append(energy(dynamics, state) - initial)
    assert largest_force > 2.0 * WEIGHT * LENGTH and len(errors) > 10
    np.testing.assert_allclose(errors, 0.0, atol=1e-3 * WEIGHT * LENGTH * 0.03)


def test_damped_arm_on_obstacles_comes_to_rest_in_the_static_equilibrium():
    ball = Sphere((0.3, 0.02, 0.0), 0.02, stiffness=1e6)
    loads = Loads(gravity=(0.0, 0.5, -3.0), obstacles=(floor(0.02, 1e6), ball))
    stiff_arm = cylinder(young=1e6)
    solver = Solver(stiff_arm, 'exact', 21, material='linear', loads=loads, accuracy=1e-5)
    dynamics = Dynamics(solver, MotionProperties(damping_time=0.2))
    state = dynamics.at_rest(Inputs([[1.0, 0.0]]))
    for _ in range(95):
        state = dynamics.step(state, Inputs(SLACK), 1e-2)
    expected = solver.solve(SLACK)
    assert dynamics.backbone(state).position == pytest.approx(expected.position, abs=5e-4 * LENGTH)
    forces = dynamics.contacts(state).force
    assert np.abs(forces).max(axis=1).min() > 0.05
    assert forces == pytest.approx(
        solver.contacts(expected).force, abs=3e-2 * np.abs(forces).max()
    )
