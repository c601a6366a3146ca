"""Contact of the arm with planes, spheres and cylinders, at rest and in motion."""

import dataclasses
import math

import numpy as np
import pytest
from differences import jacobian
from rods import CASES, EVERYTHING, TENSIONS, WRENCH, energy, twists_at
from rods import UNIFORM as ROD

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Body,
    ConfigError,
    ConvergenceError,
    Cylinder,
    Dynamics,
    Inputs,
    Loads,
    Material,
    MotionProperties,
    Plane,
    Pose,
    RectangularBody,
    Section,
    SolveError,
    Solver,
    Sphere,
)
from octo_arm_model.arm.obstacles import Obstacle
from octo_arm_model.rod.contact import Contact, NodeMotion
from octo_arm_model.rod.elements import build_elements
from octo_arm_model.rod.equilibrium import Condition
from octo_arm_model.rod.rod import Rod
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
    """So far below the surface of a level arm."""
    return Plane((0.0, 0.0, -RADIUS - gap), (0.0, 0.0, 2.0), stiffness=stiffness)


@pytest.mark.parametrize(('gap', 'stiffness'), [(2e-3, 2e7), (5e-4, 5e7)])
def test_a_rod_clamped_over_a_floor_lies_on_it_from_its_free_span_on(gap, stiffness):
    # Free up to a = (72 E J d / w)^(1/4), where the floor pushes with w a / 3; beyond, with w.
    solver = solver_of(floor(gap, stiffness), loads=Loads(gravity=GRAVITY), accuracy=1e-6)
    found = solver.solve(SLACK)
    span = (72.0 * BENDING * gap / WEIGHT) ** 0.25
    contacts = solver.contacts(found)
    push = WEIGHT * (span / 3.0 + LENGTH - span)
    assert contacts.force[0] == pytest.approx([0.0, 0.0, push], rel=2e-3, abs=1e-9)
    touched = contacts.s[contacts.penetration[0] > 0.0]
    # The penalty spreads the force at the end over the length of a beam on springs.
    spread = (4.0 * BENDING / (2.0 * RADIUS * stiffness)) ** 0.25
    assert span - 1.5 * spread < touched.min() < span
    free = found.s <= 0.9 * span
    x = found.s[free]
    sag = WEIGHT * x**2 / (72.0 * BENDING) * (3.0 * x**2 - 8.0 * span * x + 6.0 * span**2)
    assert -found.position[free, 2] == pytest.approx(sag, abs=0.01 * gap)
    # Half the stiffness is twice the penetration.
    depth = np.interp(0.3, contacts.s, contacts.penetration[0])
    assert depth == pytest.approx(WEIGHT / (2.0 * RADIUS * stiffness), rel=1e-3)


def slender(radius: float, length: float = 1.0, young: float = 1e7) -> Arm:
    sections = (Section(length, 0.5 * radius, 0.5 * radius, angles=(0.0, math.pi)),)
    return Arm(Material(young, 0.5, 1000.0), Body(length, radius, radius), sections)


def thin_round_a_post(young: float) -> tuple[Arm, Cylinder, float]:
    """An arm of 2 mm below a post, which a force on its tip pulls up round it: 30 E J / r^2."""
    radius, post = 2e-3, 0.04
    force = 30.0 * young * 0.25 * math.pi * radius**4 / (post + radius) ** 2
    round_it = Cylinder((0.2, post + radius, 0.0), (0.0, 0.0, 1.0), post, stiffness=1e7)
    return slender(radius, LENGTH, young), round_it, force


def test_an_arm_pulled_round_a_post_has_its_curvature():
    arm, post, force = thin_round_a_post(1e5)
    loads = Loads(tip_force=(0.0, force, 0.0), obstacles=(post,))
    solver = Solver(arm, 'exact', 451, material='linear', loads=loads, accuracy=1e-5)
    found = solver.solve(SLACK)
    contacts = solver.contacts(found)
    touched = contacts.s[contacts.penetration[0] > 0.0]
    middle = (found.s > touched.min() + 0.015) & (found.s < touched.max() - 0.015)
    assert middle.sum() > 20
    assert found.k[middle] == pytest.approx(1.0 / (post.radius + 2e-3), rel=0.01)
    # In all the post turns the pull by a right angle.
    assert contacts.force[0] == pytest.approx([force, -force, 0.0], rel=0.01)


# Such that all of an arm of 0.3 m is inside each, where nothing begins or ends.
AROUND = (
    Plane((0.1, 0.0, 0.4), (0.2, -0.1, 1.0), stiffness=4e3),
    Sphere((0.2, 0.3, -0.1), 0.9, stiffness=2e3),
    Cylinder((0.1, -0.2, 0.3), (0.5, 1.0, -0.3), 0.8, stiffness=3e3),
)


@pytest.mark.parametrize('name', CASES)
def test_the_jacobian_is_the_derivative_of_the_imbalance(name):
    arm, setting = CASES[name]
    around = () if 'strip' in name else AROUND  # of a rectangle there is no contact
    rod = Rod(arm, dataclasses.replace(EVERYTHING, obstacles=around), setting=setting)
    problem = rod.problem(0)
    at_nodes, s = problem.at_nodes(Condition(TENSIONS, WRENCH, 0.7)), problem.elements.s
    z = twists_at(s, problem.strains)
    change = np.cos(7.0 * s)[:, np.newaxis] * np.ones_like(z)
    change[:, 3:] *= 0.1
    problem.fill_jacobian(problem.evaluate(at_nodes, z))
    assert not around or problem.contact.report(problem.places()).penetration.min() > 0.1
    found = (problem.work.jacobian @ change.ravel()).reshape(z.shape)
    expected = jacobian(
        lambda part: problem.evaluate(at_nodes, z + part[0] * change).imbalance, np.zeros(1), 1e-4
    )[..., 0]
    assert np.abs(found - expected).max(axis=0) == pytest.approx(
        0.0, abs=3e-6 * np.abs(expected).max()
    )


LEANING = solver_of(
    floor(0.02, 2e6),
    Sphere((0.3, 0.13, -0.015), 0.04, stiffness=2e6),
    loads=Loads(gravity=(0.0, 0.1, -0.6)),
    stations=5,
)
PULL = np.array([[0.05, 0.02]])


def test_sensitivities_are_those_of_an_arm_that_leans_on_something():
    def position(change: np.ndarray) -> np.ndarray:
        pushed = [*change[2:], 0.0, 0.0, 0.0]
        return LEANING.solve(PULL + change[:2], tip_wrench=pushed, start=found).position

    found = LEANING.solve(PULL)
    own = LEANING.sensitivity(found)
    expected = jacobian(position, np.zeros(5), np.array([1e-4, 1e-4, 1e-5, 1e-5, 1e-5]))
    mine = np.concatenate([own.by_tension.pose, own.by_tip_wrench.pose[..., :3]], axis=-1)[:, :3]
    assert mine == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.abs(expected).max())


def test_an_arm_stays_on_the_side_of_a_post_from_which_it_came():
    # Bent freely its tip would be beyond the post; from there it is on the other side.
    post = Cylinder((0.2, 0.05, 0.0), (0.0, 0.0, 1.0), 0.01, stiffness=1e6)
    solver, free = solver_of(post), solver_of()
    pull = np.array([[0.4, 0.0]])
    beyond = free.solve(pull)
    found = solver.solve(pull)
    heights = [
        one.position[np.argmin(np.abs(one.position[:, 0] - 0.2)), 1] for one in (beyond, found)
    ]
    assert heights[0] > 0.05 + 0.015 > 0.05 - 0.019 > heights[1]
    force = solver.contacts(found).force[0]
    assert force[1] < 0.0
    again = solver.follow(pull, solver.solve(0.5 * pull))
    assert again.tip == pytest.approx(found.tip, abs=1e-6 * LENGTH)


def test_a_column_that_buckles_is_held_between_walls():
    # At twice Euler's load, pi^2 E J / (2 L)^2, with a wall at either side.
    gap = 0.02
    load = 2.0 * math.pi**2 * BENDING / (2.0 * LENGTH) ** 2
    walls = [Plane((0.0, y, 0.0), (0.0, -y, 0.0), stiffness=1e6) for y in (-gap, gap)]
    sides = [Plane((0.0, 0.0, z), (0.0, 0.0, -z), stiffness=1e6) for z in (-gap, gap)]
    push = Loads(tip_force=(-load, 0.0, 0.0))
    found = solver_of(*walls, *sides, loads=push).solve(SLACK)
    out = np.abs(found.position[:, 1:]).max()
    assert gap - RADIUS < out < 1.02 * (gap - RADIUS)
    assert np.abs(solver_of(loads=push).solve(SLACK).position[:, 1:]).max() > 10.0 * gap


def test_the_base_may_be_anywhere():
    moved = Pose((0.3, -0.2, 0.5), (0.5, 0.5, 0.5, 0.5))
    solver = solver_of(floor(1e-3, 1e6), loads=Loads(gravity=GRAVITY), accuracy=1e-6)
    found = solver.solve(SLACK)
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    gravity, normal = turn @ GRAVITY, turn @ [0.0, 0.0, 1.0]
    point = turn @ [0.0, 0.0, -RADIUS - 1e-3] + moved.position
    loads = Loads(tuple(gravity), obstacles=(Plane(tuple(point), tuple(normal), stiffness=1e6),))
    other = Solver(ROD, 'exact', 901, moved, material='linear', loads=loads, accuracy=1e-6)
    again = other.solve(SLACK)
    assert again.position == pytest.approx(found.position @ turn.T + moved.position, abs=1e-9)
    force = other.contacts(again).force[0]
    assert force == pytest.approx(turn @ solver.contacts(found).force[0], abs=1e-6)


@pytest.mark.parametrize('at', [0.4, 0.4004, 0.4008])
def test_a_slender_arm_does_not_pass_through_a_post_as_thin_as_itself(at):
    arm, radius = slender(1e-3), 1e-3
    force = 1e7 * 0.25 * math.pi * radius**4
    post = Cylinder((at, 3.0 * radius, 0.0), (0.0, 0.0, 1.0), radius, stiffness=1e7)
    loads = Loads(tip_force=(0.0, force, 0.0), obstacles=(post,))
    solver = Solver(arm, 'exact', 501, material='linear', loads=loads, accuracy=1e-5)
    found = solver.solve(SLACK)
    assert solver.contacts(found).force[0, 1] < -force
    height = np.interp(at, found.position[:, 0], found.position[:, 1])
    assert 0.5 * radius < height < 1.5 * radius


def test_what_has_no_contact_is_refused():
    with pytest.raises(ArmDefinitionError, match=r'radius of the arm .* is 5e-05, expected at l'):
        Solver(slender(5e-5), 'exact', loads=Loads(obstacles=(floor(0.1, 1e6),)))
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
    with pytest.raises(ConfigError, match='no loads but the tendons: choose exact'):
        Solver(ROD, 'closed_form', loads=Loads(obstacles=(ball,)))
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


# Motion ------------------------------------------------------------------------------------------


def test_friction_has_the_derivatives_that_it_is_given():
    rough = tuple(dataclasses.replace(one, friction=0.4, creep_speed=0.1) for one in AROUND)
    elements = build_elements(ROD)
    contact, s = Contact(ROD, elements, rough), elements.s
    straight = np.stack([s, 0.1 * s, 0.2 * s * s], axis=1)
    velocity = np.stack([0.2 + s, np.cos(9.0 * s), -0.3 * s], axis=1)
    axes = rotation_matrices(np.array([[0.8], [0.2], [-0.4], [0.4]]))[..., 0].T
    rates = np.cross([0.5, -2.0, 3.0], axes)
    moved = np.stack([np.sin(5.0 * s), 0.3 - s, s * s], axis=1)
    turned, by_velocity = np.array([0.6, -0.3, 0.5]), 30.0

    def at(part: np.ndarray) -> tuple[np.ndarray, NodeMotion]:
        change = part[0] * np.cross(turned, axes)
        spin = (rates + by_velocity * change).T @ (axes + change)
        move = part[0] * moved
        motion = NodeMotion(velocity + by_velocity * move, np.tile(spin, (s.size, 1, 1)))
        return straight + move, motion

    expected = jacobian(lambda part: contact.densities(*at(part)), np.zeros(1), 1e-5)[..., 0]
    found = np.zeros((2, s.size, 3))
    for one in contact.tangents(*at(np.zeros(1)), by_velocity):
        places = (one.between @ moved)[..., np.newaxis]
        parts = one.force_by_place, one.force_by_turn, one.moment_by_place, one.moment_by_turn
        by_place, by_turn, moment_by_place, moment_by_turn = (np.asarray(part) for part in parts)
        found[0] += one.back @ (by_place @ places)[..., 0] + one.back @ (by_turn @ turned)
        found[1] += one.back @ (moment_by_place @ places)[..., 0]
        found[1] += one.back @ (moment_by_turn @ turned)
    for mine, other in zip(found, expected):
        assert mine == pytest.approx(other, rel=1e-6, abs=1e-7 * np.abs(other).max())


def test_an_arm_that_is_dragged_over_a_floor_resists_with_mu_times_its_weight():
    mu, speed, creep, dt = 0.3, 0.02, 1e-3, 5e-3
    rough = dataclasses.replace(floor(0.0, 1e5), friction=mu, creep_speed=creep)
    loads = Loads(gravity=GRAVITY, obstacles=(rough,))
    solver = Solver(ROD, 'exact', material='linear', loads=loads)
    dynamics = Dynamics(solver, MotionProperties(damping_time=0.02))
    state, forces = dynamics.at_rest(Inputs(SLACK)), []
    assert dynamics.contacts(state).force[0, :2] == pytest.approx([0.0, 0.0], abs=1e-9)
    for number in range(1, 71):
        inputs = Inputs(SLACK, base=Pose((-number * speed * dt, 0.0, 0.0)))
        state = dynamics.step(state, inputs, dt)
        forces.append([*dynamics.contacts(state).force[0], state.base_wrench[0]])
    along, across, normal, base = np.mean(forces[45:], axis=0)
    share = speed / math.hypot(speed, creep)
    assert along == pytest.approx(mu * share * normal, rel=1e-3)
    assert base == pytest.approx(along, rel=0.02)
    assert normal == pytest.approx(WEIGHT * LENGTH, rel=0.1)  # the base bears the rest
    assert across == pytest.approx(0.0, abs=1e-9)


def test_a_tendon_of_rubber_round_a_post_holds_as_a_capstan_does():
    # T2 = T1 e^(mu theta) over a right angle. Friction acts on the surface, at r from the axis,
    # the pull at r + R, so that mu counts r / (r + R) of itself.
    arm, post, force = thin_round_a_post(1e6)
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


def test_an_undamped_arm_bounces_from_a_floor_with_the_energy_that_it_had():
    # On nodes that resolve its waves: on those of level 0 short ones grow in the air already.
    loads, still = Loads(gravity=GRAVITY), MotionProperties()
    dynamics = Dynamics(solver_of(floor(0.03, 1e6), loads=loads), still, level=2)
    state = Dynamics(solver_of(), still, level=2).at_rest(Inputs(SLACK))
    first, fallen, pushed, off = energy(dynamics, state), WEIGHT * LENGTH * 0.03, 0.0, []
    for number in range(110):
        state = dynamics.step(state, Inputs(SLACK), 1e-3)
        force = float(dynamics.contacts(state).force[0, 2])
        pushed = max(pushed, force)
        if number > 80 and not force:
            off.append(energy(dynamics, state) - first)
    assert pushed > 2.0 * WEIGHT * LENGTH and len(off) > 10
    np.testing.assert_allclose(off, 0.0, atol=1e-3 * fallen)


def test_an_arm_that_has_fallen_on_something_comes_to_rest_where_the_statics_are():
    ball = Sphere((0.3, 0.02, 0.0), 0.02, stiffness=1e6)
    loads = Loads(gravity=(0.0, 0.5, -3.0), obstacles=(floor(0.02, 1e6), ball))
    firm = dataclasses.replace(ROD, material=Material(1e6, 0.5, 1000.0))
    solver = Solver(firm, 'exact', 21, material='linear', loads=loads, accuracy=1e-5)
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
