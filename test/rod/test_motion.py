"""Dynamics: textbook frequencies, conservation laws, static limits and states."""

import contextlib
import copy
import dataclasses
import math
import pickle
from functools import partial

import numpy as np
import pytest
from rods import HELICAL, METAL, cylinder, energy, helical_arm
from rods import PULL as REACH
from rods import UNIFORM as ROD
from scipy.integrate import trapezoid
from scipy.linalg import expm

from octo_arm_model import (
    Arm,
    ArmDefinitionError,
    Body,
    ConfigError,
    Discs,
    Dynamics,
    Inputs,
    LoadError,
    Loads,
    Material,
    MotionProperties,
    MotionState,
    OctoArmError,
    Plane,
    Pose,
    Section,
    SolveError,
    Solver,
    TensionError,
    linearise,
    load_config,
    modes,
)
from octo_arm_model.arm.hints import FloatArray

TABLE4 = load_config('renda2012_table4').arm.with_density(1080.0)
SLACK = np.zeros((3, 4))
WATER = MotionProperties(300.0, 0.0, 2.5, 0.01, 1.5)
GRAVITY = (0.0, 0.0, -9.81)
WATERED = Loads(gravity=GRAVITY, fluid_density=1022.0)
PULL = np.array([[0.05, 0.0, 0.0, 0.0], [0.1, 0.3, 0.0, 0.0], [0.2, 0.0, 0.1, 0.0]])


def swing(
    dynamics: Dynamics, state: MotionState, inputs: Inputs, seconds: float, dt: float = 2e-3
) -> MotionState:
    for _ in range(round(seconds / dt)):
        state = dynamics.step(state, inputs, dt)
    return state


# Frequencies -------------------------------------------------------------------------------------


def test_rotary_inertia_lowers_frequencies_as_in_rayleighs_formula():
    # To first order by half of the ratio of rotary to translational kinetic energy.
    dynamics = Dynamics(Solver(ROD, 'exact', material='linear', stations=401))
    state = dynamics.at_rest(Inputs([[0.0, 0.0]]))
    result = modes(dynamics, state, 1)
    s, shape = dynamics.solver.grid.s, np.linalg.norm(result.shapes[0], axis=1)
    slope = np.gradient(shape, s)
    ratio = 0.01**2 / 4.0 * trapezoid(slope**2, s) / trapezoid(shape**2, s)
    bernoulli = 1.8751040687**2 / (2.0 * np.pi * 0.45**2) * np.sqrt(1e5 * 0.01**2 / 4.0 / 1000.0)
    np.testing.assert_allclose(result.frequencies[0], bernoulli * (1.0 - 0.5 * ratio), rtol=1e-6)


@pytest.mark.parametrize(
    ('water', 'added', 'expected'),
    [
        (0.0, 0.0, [0.4056, 1.0975, 2.2519, 3.9170]),
        (1000.0, 1.0, [0.2923, 0.7912, 1.6244]),
        (1000.0, 1.5, [0.2625, 0.7105, 1.4588]),
    ],
)
def test_frequencies_of_table_4_in_air_and_water_are_reproduced(water, added, expected):
    solver = Solver(TABLE4, 'exact', loads=Loads(fluid_density=water))
    dynamics = Dynamics(solver, MotionProperties(viscosity=300.0, added_mass=added))
    result = modes(dynamics, dynamics.at_rest(Inputs(SLACK)), 8)
    np.testing.assert_allclose(result.frequencies[: 2 * len(expected) : 2], expected, atol=6e-5)
    damping = np.pi * result.frequencies * 3.0 * 300.0 / 110e3
    np.testing.assert_allclose(result.damping, damping, rtol=1e-6)


def test_small_motions_equal_those_of_the_linear_model():
    # The arm is bent in a current, with drag.
    properties = dataclasses.replace(WATER, current=(0.05, 0.1, 0.0))
    dynamics = Dynamics(Solver(TABLE4, 'exact', loads=WATERED), properties)
    first, dt = dynamics.at_rest(Inputs(PULL)), 2e-3
    model = linearise(dynamics, first, 60)
    change = 1e-4 * np.arange(12.0)
    x, tip, state = np.zeros(120), dynamics.backbone(first).tip, first
    # The input is a ramp of 50 ms, linear over each step.
    augmented = np.zeros((122, 122))
    augmented[:120, :121] = dt * np.column_stack([model.A, model.B @ change])
    augmented[120, 121] = 1.0
    step = expm(augmented)
    ramp_before, largest, largest_error = 0.0, 0.0, 0.0
    for number in range(1, 401):
        ramp = min(number * dt / 0.05, 1.0)
        x = step[:120] @ np.concatenate([x, [ramp_before, ramp - ramp_before]])
        ramp_before = ramp
        tensions = PULL + ramp * change.reshape(3, 4)
        state = dynamics.step(state, Inputs(tensions), dt)
        expected = model.C @ x + model.D @ change * ramp
        largest = max(largest, float(np.linalg.norm(expected)))
        error = dynamics.backbone(state).tip - tip - expected
        largest_error = max(largest_error, float(np.linalg.norm(error)))
    assert largest_error < 1e-2 * largest
    assert largest > 1e-5


# Conservation and convergence --------------------------------------------------------------------


@pytest.mark.parametrize('seconds', [1.0, pytest.param(10.0, marks=pytest.mark.endurance)])
@pytest.mark.parametrize(('water', 'added'), [(0.0, 0.0), (1000.0, 1.5)], ids=['air', 'water'])
def test_undamped_swing_conserves_energy(water, added, seconds):
    loads = Loads(gravity=(0.0, -1.0, 0.0), fluid_density=water)
    solver = Solver(TABLE4, 'exact', stations=5, material='linear', loads=loads)
    dynamics = Dynamics(solver, MotionProperties(added_mass=added))
    first = dynamics.at_rest(Inputs(SLACK, tip_wrench=(0.0, 0.002, 0.001, 0.0, 0.0, 0.0)))
    state, rest = first, energy(dynamics, dynamics.at_rest(Inputs(SLACK)))
    for factor in np.linspace(1.0, 0.0, 151)[1:]:
        wrench = (0.0, 0.002 * factor, 0.001 * factor, 0.0, 0.0, 0.0)
        state = dynamics.step(state, Inputs(SLACK, tip_wrench=wrench), 2e-3)
    energies = []
    for _ in range(round(seconds / 2e-3)):
        state = dynamics.step(state, Inputs(SLACK), 2e-3)
        energies.append(energy(dynamics, state))
    assert energy(dynamics, first) > rest
    assert np.ptp(energies) < 1e-3 * (energies[0] - rest)


def test_error_is_of_second_order_in_the_time_step():
    solver = Solver(TABLE4, 'exact', stations=5, loads=WATERED)
    dynamics = Dynamics(solver, WATER)
    first, tips = dynamics.at_rest(Inputs(SLACK)), []
    for steps in (50, 100, 200, 400):
        state, dt = first, 0.4 / steps
        for number in range(1, steps + 1):
            part = math.sin(0.5 * math.pi * number / steps) ** 2
            wrench, current = (0.0, 1e-3 * part, 0, 0, 0, 0), (0.0, 0.1 * part, 0.0)
            inputs = Inputs(part * PULL, tip_wrench=wrench, current=current)
            state = dynamics.step(state, inputs, dt)
        tips.append(dynamics.backbone(state).tip)
    limit = tips[3] + (tips[3] - tips[2]) / 3.0
    errors = np.linalg.norm(np.array(tips) - limit, axis=1)
    np.testing.assert_allclose(errors, [6.2e-6, 1.5e-6, 3.8e-7, 9.5e-8], rtol=0.05)
    np.testing.assert_allclose(errors[:-1] / errors[1:], 4.0, atol=0.2)


SETTLING = MotionProperties(damping_time=0.3)


HELD = Discs.evenly(4, METAL.length, 0.003, 0.002)
# A robot with discs and elastic tendons, and its tensions.
ROBOT = dataclasses.replace(METAL, discs=HELD, axial_stiffness=(2e4,)), REACH[:, [1, 0, 2]]


@pytest.mark.parametrize(
    ('arm', 'tensions', 'allowed'),
    [
        (TABLE4, PULL, 1e-6),
        (dataclasses.replace(TABLE4, sheath_stiffness=(3e5,)), PULL, 1e-6),
        (dataclasses.replace(TABLE4, axial_stiffness=(500.0,)), PULL, 1e-6),
        (*ROBOT, 2e-6),
    ],
    ids=['plain', 'sheaths', 'elastic', 'discs'],
)
def test_damped_arm_ends_at_the_static_equilibrium(arm, tensions, allowed):
    solver = Solver(arm, 'exact', 41, loads=WATERED)
    dynamics = Dynamics(solver, SETTLING)
    state = dynamics.at_rest(Inputs(0.0 * tensions))
    wrench = (0.0, 0.002, 0.001, 0.0, 1e-5, 0.0)
    state = swing(dynamics, state, Inputs(tensions, tip_wrench=wrench), 20.0, 0.04)
    expected = solver.solve(tensions, wrench)
    shape = dynamics.backbone(state)
    np.testing.assert_allclose(shape.position, expected.position, atol=allowed * arm.length)
    np.testing.assert_allclose(shape.k, expected.k, rtol=1e-3, atol=1e-3)
    assert np.abs(dynamics.velocities(state)).max() < 1e-7


# Water, a base that moves, friction --------------------------------------------------------------


def test_drag_equals_the_weight_at_the_terminal_speed():
    # The terminal speed of a rod that sinks sideways; here the water rises.
    arm, water, normal_drag = ROD.with_density(1080.0), 1022.0, 2.5
    solver = Solver(arm, 'exact', loads=Loads(gravity=GRAVITY, fluid_density=water))
    speed = math.sqrt((1080.0 - water) * 9.81 * math.pi * 0.01 / (water * normal_drag))
    dynamics = Dynamics(solver, MotionProperties(300.0, 0.0, normal_drag, 0.01, 1.5))
    still = dynamics.at_rest(Inputs([[0.0, 0.0]]))
    assert dynamics.backbone(still).tip[2] < -0.05
    rising = dynamics.at_rest(Inputs([[0.0, 0.0]], current=(0.0, 0.0, speed)))
    np.testing.assert_allclose(dynamics.backbone(rising).position[:, 2], 0.0, atol=1e-9)
    # The same for a sinking base in still water.
    state, dt, time = rising, 0.01, 0.0
    for _ in range(50):
        time += dt
        base = Pose((0.0, 0.0, -speed * max(time - 0.25, 0.0)))
        current = (0.0, 0.0, speed if time <= 0.25 else 0.0)
        state = dynamics.step(state, Inputs([[0.0, 0.0]], current=current, base=base), dt)
    level = dynamics.backbone(state).position[:, 2] - state.base[2]
    np.testing.assert_allclose(level, 0.0, atol=5e-3)


def test_rotating_rod_has_the_stretch_of_its_centrifugal_force():
    # E A r'' = -rho A omega^2 r with r(0) = 0 and r'(L) = 1.
    omega, dt, angle = 12.0, 4e-3, 0.0
    dynamics = Dynamics(Solver(cylinder(young=1e6), 'exact', material='linear'), SETTLING)
    state = dynamics.at_rest(Inputs([[0.0, 0.0]]))
    for number in range(1, 1751):
        angle += omega * dt * min(number * dt / 4.0, 1.0)
        base = Pose(quaternion=(0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle)))
        state = dynamics.step(state, Inputs([[0.0, 0.0]], base=base), dt)
    k = omega * math.sqrt(1000.0 / 1e6)
    shape = dynamics.backbone(state)
    np.testing.assert_allclose(np.linalg.norm(shape.tip), math.tan(k * 0.45) / k, rtol=1e-5)
    np.testing.assert_allclose(
        shape.tip,
        np.linalg.norm(shape.tip) * np.array([math.cos(angle), math.sin(angle), 0.0]),
        atol=2e-4,
    )
    speed = np.linalg.norm(dynamics.velocities(state), axis=1)
    expected = omega * np.linalg.norm(shape.position, axis=1)
    np.testing.assert_allclose(speed, expected, rtol=1e-3, atol=1e-6)


def test_slow_loading_with_friction_equals_the_statics():
    arm = dataclasses.replace(TABLE4, friction=(0.3,))
    solver = Solver(arm, 'exact')
    dynamics = Dynamics(solver, SETTLING)
    state, last = dynamics.at_rest(Inputs(SLACK)), None
    for level in (1.0, 0.6):
        begin = state.tensions.reshape(3, 4)
        for number in range(1, 61):
            factor = min(number / 40.0, 1.0)
            state = dynamics.step(state, Inputs(begin + factor * (level * PULL - begin)), 0.15)
        last = solver.follow(level * PULL, last)
        tip = dynamics.backbone(state).tip
        np.testing.assert_allclose(tip, last.tip, atol=5e-3 * arm.length)
    # Unloading follows another path than loading.
    assert np.linalg.norm(tip - solver.solve(0.6 * PULL).tip) > 0.01 * arm.length


# States ------------------------------------------------------------------------------------------


def _moving(friction: float = 0.0, **options: bool) -> tuple[Dynamics, MotionState]:
    arm = dataclasses.replace(TABLE4, friction=(friction,))
    dynamics = Dynamics(Solver(arm, 'exact', stations=11, loads=WATERED, **options), WATER)
    return dynamics, swing(dynamics, dynamics.at_rest(Inputs(SLACK)), Inputs(0.1 * PULL), 0.02)


def _bytes(state: MotionState) -> bytes:
    history = b'' if state.history is None else state.history.tobytes()
    return b''.join(part.tobytes() for part in (state.twist, state.place, state.water)) + history


@pytest.mark.parametrize('friction', [0.0, 0.2])
def test_copies_and_saved_states_continue_bit_by_bit(friction, tmp_path):
    dynamics, state = _moving(friction)
    dynamics.save(state, tmp_path / 'state.npz')
    other, same = _moving(friction)
    assert _bytes(same) == _bytes(state)
    dynamics.step(state, Inputs(PULL), 5e-3)  # must not change anything in dynamics
    copies = copy.copy(dynamics), pickle.loads(pickle.dumps(dynamics))
    for each in copies:
        assert each.problem is not dynamics.problem and each.solver is not dynamics.solver
    starts = [(each, state) for each in (dynamics, other, *copies)]
    starts.append((dynamics, dynamics.load(tmp_path / 'state.npz')))
    ends = {_bytes(swing(each, first, Inputs(0.2 * PULL), 0.02)) for each, first in starts}
    assert len(ends) == 1
    assert not state.place.flags.writeable


def test_state_of_another_arm_is_refused():
    _, state = _moving()
    other = Dynamics(Solver(ROD, 'exact', stations=11))
    for use in (
        lambda: other.step(state, Inputs([[0.0, 0.0]]), 1e-3),
        lambda: other.go_on(state, Inputs([[0.0, 0.0]]), 1e-2, 1e-3),
        lambda: other.backbone(state),
        lambda: other.velocities(state),
        lambda: other.contacts(state),
        lambda: other.tendon_lengths(state),
        lambda: modes(other, state),
    ):
        with pytest.raises(ConfigError, match='of another arm'):
            use()


@pytest.mark.parametrize('friction', [0.0, 0.3])
def test_motion_is_independent_of_the_position_of_the_base(friction):
    # At 2 km, rounding of positions must not act as acceleration.
    ends = []
    for at in (np.zeros(3), np.array([1e3, -2e3, 500.0])):
        floor = Plane(
            point=tuple(at - [0.0, 0.0, 0.02]),
            normal=(0.0, 0.0, 1.0),
            stiffness=1e7,
            friction=friction,
        )
        loads = Loads(gravity=GRAVITY, fluid_density=500.0, obstacles=(floor,))
        dynamics = Dynamics(Solver(TABLE4, 'exact', stations=5, base=Pose(tuple(at)), loads=loads))
        state = swing(dynamics, dynamics.at_rest(Inputs(SLACK)), Inputs(0.2 * PULL), 0.02)
        base = Pose(tuple(at + [0.0, 0.0, 1e-4]))
        state = dynamics.step(state, Inputs(0.2 * PULL, base=base), 2e-3)
        ends.append((dynamics.backbone(state).position - at, dynamics.contacts(state).force))
    assert ends[0][1][0, 2] > 0.01
    for actual, expected in zip(*ends[::-1], strict=True):
        np.testing.assert_allclose(actual, expected, atol=1e-8)


def test_loops_and_arrays_give_the_same_motion():
    pytest.importorskip('numba')
    ends = [_moving(compiled=compiled)[1] for compiled in (True, False)]
    np.testing.assert_allclose(ends[0].place[0], ends[1].place[0], atol=1e-10)
    np.testing.assert_allclose(ends[0].place[1], ends[1].place[1], atol=1e-7)


def marked(data: bytes, place: int, value: int) -> bytes:
    """Return the zip file ``data`` with another byte in the headers of all its parts."""
    for header, at in ((b'PK\x01\x02', place), (b'PK\x03\x04', place - 2)):
        begin, *parts = data.split(header)
        data = header.join([begin, *(p[: at - 4] + bytes([value]) + p[at - 3 :] for p in parts)])
    return data


# A damaged file must be closed too.
@pytest.mark.filterwarnings(
    'error::ResourceWarning', 'error::pytest.PytestUnraisableExceptionWarning'
)
def test_invalid_files_of_states_are_refused(tmp_path):
    dynamics, state = _moving()
    path = tmp_path / 'state.npz'
    dynamics.save(state, path)
    whole, shape = path.read_bytes(), (b'(6,), }' + 12 * b' ', b'(6' + 12 * b'0' + b',), }')
    damages = [b'none', b'PK\3\4 and no archive', whole[: len(whole) // 2], whole.replace(*shape)]
    # Encrypted, and packed by no known method.
    for damaged in (*damages, marked(whole, 8, 1), marked(whole, 10, 99)):
        path.write_bytes(damaged)
        with pytest.raises(ConfigError, match='cannot be read as a state'):
            dynamics.load(path)
    dynamics.save(dataclasses.replace(state, base=np.full(7, np.nan)), path)
    with pytest.raises(ConfigError, match='base is not finite'):
        dynamics.load(path)
    dynamics.save(state, path)
    with pytest.raises(ConfigError, match='twist is float64'):
        Dynamics(Solver(ROD, 'exact')).load(path)


# Steps -------------------------------------------------------------------------------------------


def test_long_step_is_divided():
    dynamics = Dynamics(Solver(TABLE4, 'exact', stations=5), MotionProperties(300.0))
    first = dynamics.at_rest(Inputs(SLACK))
    in_one_step = dynamics.step(first, Inputs(5.0 * PULL), 0.2)
    assert in_one_step.time == pytest.approx(0.2, abs=1e-12)
    in_short_steps = first
    for k in range(1, 101):
        in_short_steps = dynamics.step(in_short_steps, Inputs(0.05 * k * PULL), 2e-3)
    tips = [dynamics.backbone(state).tip for state in (first, in_one_step, in_short_steps)]
    assert np.linalg.norm(tips[1] - tips[0]) > 0.2 * TABLE4.length
    assert np.linalg.norm(tips[1] - tips[2]) < 0.04 * TABLE4.length


def test_large_soft_arm_moves_as_a_small_stiff_one_in_short_steps():
    tips = []
    for size, stress in ((1.0, 1.0), (8.0, 2.0**-6)):
        arm = cylinder(0.45 * size, 0.01 * size, 1e5 * stress)
        dynamics = Dynamics(Solver(arm, 'exact', stations=5))
        inputs = Inputs([[0.1 * size**2 * stress, 0.0]])
        dt = 1e-5 * size / math.sqrt(stress)
        state = swing(dynamics, dynamics.at_rest(Inputs([[0.0, 0.0]])), inputs, 20 * dt, dt)
        tips.append(dynamics.backbone(state).tip / size)
    assert np.linalg.norm(tips[0] - [0.45, 0.0, 0.0]) > 1e-6
    np.testing.assert_allclose(tips[1], tips[0], rtol=0.0, atol=1e-12)


def test_inputs_change_linearly_and_steps_adapt_to_fast_motion():
    solver = Solver(TABLE4, 'exact', stations=5, loads=Loads(fluid_density=1022.0))
    dynamics = Dynamics(solver, WATER)
    first = dynamics.at_rest(Inputs(SLACK))
    base = Pose((2e-4, 0.0, 1e-4), (0.0, 0.0, math.sin(1e-3), math.cos(1e-3)))
    half = Pose((1e-4, 0.0, 5e-5), (0.0, 0.0, math.sin(5e-4), math.cos(5e-4)))
    wrench, current = np.array([0.0, 1e-4, 0.0, 0.0, 0.0, 1e-6]), (0.0, 0.02, 0.0)
    calm = dynamics.step(
        first, Inputs(0.01 * PULL, {}, 0.5 * wrench, (0.0, 0.01, 0.0), half), 1e-3
    )
    calm = dynamics.step(calm, Inputs(0.02 * PULL, {}, wrench, current, base), 1e-3)
    inputs = Inputs(0.02 * PULL, {}, wrench, current, base)
    by_parts = dynamics.go_on(first, inputs, 2e-3, 1e-3)
    np.testing.assert_allclose(by_parts.place[0], calm.place[0], atol=1e-8)
    np.testing.assert_allclose(by_parts.water[0], current)

    def tip(state: MotionState) -> FloatArray:
        return dynamics.backbone(state).tip

    hard, fine = Inputs(np.diag([0.42, 1.4, 1.4]) @ np.eye(3, 4)), first
    for number in range(1, 81):
        pull = min(number / 20, 1.0) * np.array(hard.tensions)
        fine = dynamics.step(fine, Inputs(pull), 2.5e-4)
    coarse = dynamics.step(first, hard, 5e-3)
    coarse = swing(dynamics, coarse, hard, 15e-3, 5e-3)
    adapted = dynamics.go_on(dynamics.go_on(first, hard, 5e-3, 5e-3), hard, 15e-3, 5e-3)
    assert adapted.time == pytest.approx(coarse.time)
    errors = [np.linalg.norm(tip(one) - tip(fine)) for one in (adapted, coarse)]
    assert errors[0] < 0.6 * errors[1] < 1e-3


def test_crushed_arm_raises_an_error():
    dynamics = Dynamics(Solver(TABLE4, 'exact', stations=5), MotionProperties(300.0))
    first = dynamics.at_rest(Inputs(SLACK))
    message = r'the motion ends at .* s, no step of .* s succeeds: [^;]*$'
    with pytest.raises(SolveError, match=message):
        swing(dynamics, first, Inputs(np.full((3, 4), 1e4)), 0.01, 2e-3)
    assert dynamics.step(first, Inputs(PULL), 2e-3).time == pytest.approx(2e-3)
    undamped = Dynamics(dynamics.solver)
    with pytest.raises(SolveError, match='state a viscosity'):
        swing(undamped, undamped.at_rest(Inputs(SLACK)), Inputs(np.full((3, 4), 1e4)), 0.01, 2e-3)


def test_winches_that_crush_an_arm_with_friction_end_or_are_refused():
    arm = Arm(
        Material(1e4, 0.4, density=1080.0),
        Body(0.79, 0.027, 0.022),
        (Section(0.79, 0.02, 0.007, (0.0, math.pi), (1.0, -3.7)),),
        friction=(0.3,),
    )
    loads = Loads(tip_force=(-3e-4, -1.9e-3, 1.6e-3))
    solver = Solver(arm, 'exact', stations=5, material='linear', shear=True, loads=loads)
    dynamics, tensions = Dynamics(solver, MotionProperties(20.0)), np.array([[0.16, 0.0]])
    state = dynamics.at_rest(Inputs(tensions))
    with contextlib.suppress(SolveError):
        for step, length in enumerate((0.014385, 0.016065, 0.017745)):
            base = Pose((0.0, 0.016 * math.sin(0.3 * step), 0.0))
            inputs = Inputs((1.0 - 0.05 * step) * tensions, {'tendon_1_1': length}, base=base)
            state = dynamics.step(state, inputs, 0.0145)
            assert dynamics.displacements(state)[0] >= length - 1e-6


# What a dynamics has done before -----------------------------------------------------------------


HELD = Plane(stiffness=1e4, point=(0.0, 0.0, -0.06), normal=(0.0, 0.0, 1.0), friction=0.3)


@pytest.mark.parametrize(
    ('arm', 'obstacles'),
    [
        (HELICAL, ()),
        (helical_arm(friction=(0.2,), axial_stiffness=(500.0,), free_length=(0.1,)), ()),
        (helical_arm(sheath_stiffness=(2e4,)), ()),
        (HELICAL, (HELD,)),
    ],
    ids=['frictionless', 'friction', 'sheaths', 'obstacle'],
)
def test_used_dynamics_equal_new_ones(arm, obstacles):
    """Random steps, rests, held tendons and refused pulls do not change what comes after."""
    loads = Loads(gravity=(0.0, 0.0, -3.0), obstacles=obstacles)

    def new() -> Dynamics:
        return Dynamics(Solver(arm, 'exact', 11, loads=loads), MotionProperties(viscosity=50.0))

    def result(dynamics: Dynamics) -> list[FloatArray]:
        """Return the next state and the lengths of tendons; zeros if the inputs are refused."""
        try:
            if number % 3 == 2:
                state = dynamics.at_rest(inputs)
            else:
                state = dynamics.step(before, inputs, dt)
        except SolveError:
            return [np.zeros(1)] * 4
        if dynamics is used:
            states.append(state)
        lengths = dynamics.tendon_lengths(before)
        return [state.twist[0], state.place, np.asarray(state.tensions), lengths]

    used, rng = new(), np.random.default_rng(5)
    states = [used.at_rest(Inputs(np.zeros((2, 3))))]
    for number in range(9):
        before, dt = states[rng.integers(len(states))], rng.uniform(1e-3, 0.03)
        tensions = REACH * rng.uniform(0.0, 1.0, (2, 3)) * (rng.random((2, 3)) < 0.7)
        inputs = Inputs(tensions, tip_wrench=np.append(0.01 * rng.normal(size=3), np.zeros(3)))
        with pytest.raises(SolveError):
            used.step(before, Inputs(1e4 * REACH), 1e-3)
        if number % 3 == 1:
            held = used.displacements(before).ravel() + 2e-4
            names = dict(zip(arm.tendon_names, held.tolist(), strict=True))
            inputs = Inputs(np.zeros((2, 3)), displacements=names)
        for found, expected in zip(result(used), result(new()), strict=True):
            scale = np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * scale)
    assert len(states) > 5


@pytest.mark.parametrize(
    ('inputs', 'dt', 'error', 'message'),
    [
        (Inputs(SLACK), 0.0, ArmDefinitionError, 'dt is 0'),
        (Inputs(SLACK), math.nan, ArmDefinitionError, 'dt is nan'),
        (Inputs(-PULL), 1e-3, TensionError, 'tension of'),
        (Inputs(np.stack([PULL, PULL])), 1e-3, TensionError, 'one set'),
        (Inputs(PULL, {'none': 0.0}), 1e-3, TensionError, 'unknown tendon'),
        (Inputs(PULL, {'tendon_1_1': math.inf}), 1e-3, TensionError, 'displacement of'),
        (Inputs(PULL, {'tendon_1_1': 2.0}), 1e-3, TensionError, 'reel in'),
        (Inputs(PULL, [0.1]), 1e-3, TensionError, 'displacements are'),
        (Inputs(PULL, base=(0.0, 0.0, 0.0)), 1e-3, ArmDefinitionError, r'inputs\.base'),
        (Inputs(PULL, tip_wrench=(math.nan,) * 6), 1e-3, LoadError, 'tip_wrench'),
        (Inputs(PULL, current=(math.inf, 0.0, 0.0)), 1e-3, ArmDefinitionError, 'current'),
    ],
)
def test_invalid_inputs_are_refused(inputs, dt, error, message):
    dynamics, state = _moving()
    with pytest.raises(error, match=message):
        dynamics.step(state, inputs, dt)


def _modes_of_a_moving_arm() -> None:
    dynamics, state = _moving()
    modes(dynamics, dynamics.step(state, Inputs(2.0 * PULL), 5e-3))


@pytest.mark.parametrize(
    ('build', 'message'),
    [
        (lambda: Dynamics(Solver(TABLE4, 'closed_form')), 'choose exact'),
        (lambda: Dynamics(load_config('renda2012_table4').solver('exact')), 'material.density'),
        (lambda: Dynamics(Solver(TABLE4, 'exact'), rho_inf=1.1), 'rho_inf'),
        (lambda: MotionProperties(added_mass=-1.0), 'motion.added_mass'),
        (lambda: MotionProperties(viscosity=1.0, damping_time=1.0), 'motion.damping_time'),
        (lambda: linearise(*_moving(0.2)), 'linear model'),
        (_modes_of_a_moving_arm, 'not at rest'),
        *((partial(modes, *_moving(), count), 'number of modes') for count in (0, 2.5, 'six')),
    ],
)
def test_invalid_dynamics_are_refused(build, message):
    with pytest.raises(OctoArmError, match=message):
        build()
