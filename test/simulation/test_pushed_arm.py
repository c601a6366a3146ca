"""A pushed arm: its shape and sensors; and the one of any preset, whose force is found."""

import dataclasses

import numpy as np
import pytest
from checkout import PRESETS
from scipy.spatial.transform import Rotation

from octo_arm_model import (
    Config,
    ConfigError,
    Loads,
    OctoArmError,
    Plane,
    PointLoad,
    solve_displacements,
)
from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.estimation.estimate import Estimate, contact_of
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import BaseWrench, Markers, Tensions, TipPosition
from octo_arm_model.estimation.model import ArmModel, Prediction
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.estimation.unknowns import Unknowns, Walk
from octo_arm_model.rod.displacements import displacements_of
from octo_arm_model.simulation.movements import find_profile
from octo_arm_model.simulation.pushed_arm import PERIOD, Push, PushedArm, Sensors, touched
from octo_arm_model.simulation.simulator import SimulatorConfig, TendonDrive, in_water

VALUES = load_parameters('renda2012_prototype') | {'model': 'exact', 'stations': 31}
VALUES['solve_budget.seconds'] = 60.0  # for busy machines
CONFIG = Config.from_parameters(VALUES)
LENGTH = CONFIG.arm.length
TENSIONS = np.array([1.0, 0.4, 0.3, 0.5])
FORCE = np.array([0.001, -0.004, 0.006])
PLACES = (0.05, 0.101, LENGTH)
EXACT = Sensors(tip_pose_rate=10.0, markers_rate=10.0, marker_s=PLACES, base_wrench_rate=10.0)


@pytest.mark.parametrize('s', [0.0, 0.1, LENGTH])
def test_the_shape_is_that_of_the_arm_under_the_force(s):
    arm = PushedArm(CONFIG, Push(tuple(FORCE), s), EXACT)
    arm.advance(TENSIONS, FORCE)
    place = s or LENGTH
    loads = Loads(points=(PointLoad(place, tuple(FORCE)),))
    expected = dataclasses.replace(CONFIG, loads=loads).solver(stations=401).solve([TENSIONS])
    pose = arm.tip_pose()
    np.testing.assert_allclose(pose.position, expected.tip, atol=1e-8)
    back = Rotation.from_quat(expected.quaternion[-1]).inv()
    turned = Rotation.from_quat(pose.quaternion) * back
    assert turned.magnitude() < 1e-6
    places = [np.interp(PLACES, expected.s, axis) for axis in expected.position.T]
    np.testing.assert_allclose(arm.markers(), np.transpose(places), atol=1e-6)
    # A force alone acts: its moment is about the base.
    lever = [np.interp(place, expected.s, axis) for axis in expected.position.T]
    wrench = np.concatenate([FORCE, np.cross(lever, FORCE)])
    np.testing.assert_allclose(arm.base_wrench(), wrench, atol=1e-8)


@pytest.mark.parametrize('s', [0.0, 0.1])
def test_encoders_read_the_arm_that_is_pushed_and_winches_hold_their_lengths(s):
    given = VALUES | {'tendons.axial_stiffness': 4 * [500.0], 'push.force': FORCE.tolist()}
    config = SimulatorConfig.from_parameters(given | {'push.s': s})
    loads = Loads(points=(PointLoad(s or LENGTH, tuple(FORCE)),))
    solver = dataclasses.replace(config.model, loads=loads).solver()
    drive = TendonDrive(config)

    def step(config: SimulatorConfig = config) -> FloatArray:
        drive.move(drive.advance(drive.set_points(TENSIONS), 0.01), FORCE, 0.01)
        assert config.pushed_arm is not None
        return config.pushed_arm.reeled_in()

    expected = displacements_of(solver, solver.solve([TENSIONS])).ravel()
    free = displacements_of(solver, CONFIG.solver().solve([TENSIONS])).ravel()
    np.testing.assert_allclose(step(), expected, atol=1e-8)
    assert np.abs(expected - free).max() > 1e-4
    names = config.model.arm.tendon_names
    drive.hold(dict(zip(names, free.tolist(), strict=True)), TENSIONS)
    np.testing.assert_allclose(step(), free, atol=1e-8)
    held = solve_displacements(solver, dict(zip(names, free.tolist(), strict=True)))
    read = drive.hardware.read()
    assert read is not None and np.abs(read - TENSIONS).max() > 0.02
    np.testing.assert_allclose(read, held.backbone.tensions.ravel(), atol=1e-5)
    # The push moves to another place.
    config = SimulatorConfig.from_parameters(given | {'push.s': 0.15})
    drive.go_on_with(config)
    moved = [step(config) for _ in range(2)][-1]
    np.testing.assert_allclose(moved, free, atol=1e-8)


def test_the_noise_is_as_large_as_it_is_said_to_be():
    sensors = Sensors(
        tip_position_stddev=1e-3,
        tip_rotation_stddev=0.02,
        marker_s=PLACES,
        marker_stddev=2e-3,
        base_force_stddev=3e-3,
        base_moment_stddev=4e-4,
    )
    arm, exact = (PushedArm(CONFIG, Push(), own) for own in (sensors, EXACT))
    for one in (arm, exact):
        one.advance(TENSIONS, np.zeros(3))
    true, count = exact.tip_pose(), 2000
    poses = [arm.tip_pose() for _ in range(count)]
    away = np.array([pose.position for pose in poses]) - true.position
    turns = Rotation.from_quat([pose.quaternion for pose in poses])
    turned = (turns * Rotation.from_quat(true.quaternion).inv()).as_rotvec()
    markers = np.array([arm.markers() for _ in range(count)]) - exact.markers()
    wrench = np.array([arm.base_wrench() for _ in range(count)]) - exact.base_wrench()
    each = away, turned, markers, wrench[:, :3], wrench[:, 3:]
    for found, stddev in zip(each, (1e-3, 0.02, 2e-3, 3e-3, 4e-4)):
        # Four standard errors of what numbers without a correlation give.
        assert found.std() == pytest.approx(stddev, rel=4.0 / np.sqrt(2 * found.size))
        assert np.abs(found.mean()) < 4.0 * stddev / np.sqrt(found.size)


def test_a_push_lasts_the_second_half_of_each_period():
    push = Push((0.0, 0.0, 2.0), period=4.0)
    acts = [push.at(time)[2] for time in (0.0, 1.9, 2.0, 3.9, 4.0, 6.5)]
    assert acts == [0.0, 0.0, 2.0, 2.0, 0.0, 2.0]
    assert Push((0.0, 0.0, 2.0)).at(0.0)[2] == 2.0


@pytest.mark.parametrize(
    ('values', 'complaint'),
    [
        ({'push.force': [1.0, 0.0]}, r'push.force is \[1.0, 0.0\], expected 3 finite numbers'),
        ({'push.force': [0.0, np.nan, 0.0]}, r'push.force\[1\] is nan, expected a finite number'),
        ({'push.force': [0.0, 0.0, 0.01], 'push.s': 1.0}, 'push.s is 1.0, expected .* within'),
        ({'sensors.markers_rate': 1.0}, 'sensors.marker_s is'),
        ({'sensors.markers_rate': 1.0, 'sensors.marker_s': [0.3]}, 'sensors.marker_s is 0.3'),
        ({'sensors.marker_s': [0.1] * 2000, 'sensors.markers_rate': 1.0}, 'at most 300'),
    ],
)
def test_impossible_pushes_and_sensors_are_refused_by_name(values, complaint):
    with pytest.raises(OctoArmError, match=complaint):
        SimulatorConfig.from_parameters({**VALUES, **values})


def test_what_cannot_be_solved_is_refused_with_a_reason():
    force = {'push.force': [0.0, 0.0, 0.01]}
    with pytest.raises(ConfigError, match='renda2012'):
        SimulatorConfig.from_parameters({**VALUES, **force, 'model': 'renda2012'})
    # Seen without being pushed an arm of any model is.
    for seen in ({'sensors.tip_pose_rate': 10.0}, {'winches.encoders': True}):
        of_paper = {**VALUES, **seen, 'model': 'renda2012'}
        assert SimulatorConfig.from_parameters(of_paper).pushed_arm is not None
    assert SimulatorConfig.from_parameters(VALUES).pushed_arm is None


def test_a_change_of_what_does_not_concern_the_arm_leaves_noise_and_lengths_as_they_are():
    noisy = {'sensors.tip_pose_rate': 10.0, 'sensors.tip_position_stddev': 1e-3}
    given = VALUES | noisy | {'push.force': FORCE.tolist(), 'push.s': 0.1, 'push.period': 2.0}
    results = []
    for changes in ({}, {'rate': 50.0}):
        config = SimulatorConfig.from_parameters(given)
        drive, found = TendonDrive(config), []
        drive.move(drive.advance(TENSIONS, 0.01), 0.0 * FORCE, 0.01)
        drive.hold({CONFIG.arm.tendon_names[0]: 0.003}, TENSIONS)
        for more in ({}, changes, changes):
            config = SimulatorConfig.from_parameters(given | more)
            drive.go_on_with(config)
            # The push does not act at present.
            pulled = drive.set_points(TENSIONS)
            drive.move(drive.advance(pulled, 0.01), 0.0 * FORCE, 0.01)
            found.append([*pulled, *config.pushed_arm.tip_pose().position])
        assert np.ptp(found, axis=0)[4:].min() > 1e-5
        results.append(found)
        config.pushed_arm.reset()
        drive = TendonDrive(config)
        drive.move(drive.advance(pulled, 0.01), 0.0 * FORCE, 0.01)
        again = config.pushed_arm.tip_pose().position
        np.testing.assert_allclose(again, found[0][4:], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(*results, rtol=0.0, atol=1e-9)


def test_tendons_with_friction_keep_their_history_while_they_are_pushed():
    rough = dataclasses.replace(CONFIG, arm=dataclasses.replace(CONFIG.arm, friction=4 * (0.2,)))
    loads = Loads(points=(PointLoad(0.1, tuple(FORCE)),))
    solver = dataclasses.replace(rough, loads=loads).solver()
    push, pulled = Push(tuple(FORCE), 0.1), None
    arm = PushedArm(rough, push, EXACT)
    for part in (0.6, 1.0, 0.7):
        pulled = solver.follow(part * TENSIONS.reshape(1, -1), pulled)
        arm.advance(part * TENSIONS, FORCE)
        np.testing.assert_allclose(arm.tip_pose().position, pulled.tip, rtol=0.0, atol=1e-8)
    assert np.linalg.norm(pulled.tip - solver.solve([0.7 * TENSIONS]).tip) > 1e-4
    # A change of what does not concern the balance leaves them as they are.
    quieter = dataclasses.replace(rough, markers_rate=5.0)
    other = PushedArm(quieter, push, dataclasses.replace(EXACT, markers_rate=1.0))
    assert other.go_on_from(arm)
    other.advance(0.72 * TENSIONS, FORCE)
    expected = solver.follow(0.72 * TENSIONS.reshape(1, -1), pulled)
    np.testing.assert_allclose(other.tip_pose().position, expected.tip, rtol=0.0, atol=1e-8)
    # What is pushed elsewhere, or another arm, begins anew.
    for config, elsewhere in ((rough, Push(tuple(FORCE), 0.2)), (CONFIG, push)):
        anew = PushedArm(config, elsewhere, EXACT)
        assert not anew.go_on_from(arm)
        anew.advance(0.72 * TENSIONS, FORCE)
        fresh = PushedArm(config, elsewhere, EXACT)
        fresh.advance(0.72 * TENSIONS, FORCE)
        np.testing.assert_array_equal(anew.tip_pose().position, fresh.tip_pose().position)


class Tracked:
    """An arm that is pushed, and the estimator of `touched` that is told what its sensors read."""

    def __init__(self, name: str, is_moving: bool) -> None:
        values = load_parameters(name) | {'stations': 31}
        plain = Config.from_parameters(values)
        of_simulator, of_estimator = touched(plain, is_moving=is_moving)
        water = in_water(plain) if is_moving else {}
        self.simulated = SimulatorConfig.from_parameters(values | water | of_simulator)
        own = {key: of_estimator.pop(key) for key in list(of_estimator) if 'estimator.' in key}
        water.pop('dynamics', None)
        self.config = Config.from_parameters(values | water | of_estimator)
        settings = EstimatorSettings.from_parameters(own, self.config)
        models = settings.models(self.config)
        self.estimator = Estimator(models, settings.rules, settings.given.window)
        self.noise, self.random = settings.tension_stddev, np.random.default_rng(3)
        self.arm, self.push = self.simulated.pushed_arm, self.simulated.push
        self.tendons = len(self.config.arm.tendons)

    def add(self, stamp: int, pull: float) -> Estimate:
        """Return the estimate after the readings of a ``stamp`` [ns] under a ``pull`` [N]."""
        sensors, read = self.simulated.sensors, self.random.standard_normal(self.tendons)
        data = [
            Tensions(np.maximum(pull + self.noise * read, 0.0), self.noise),
            TipPosition(self.arm.tip_pose().position, sensors.tip_position_stddev),
            Markers(sensors.marker_s, self.arm.markers(), sensors.marker_stddev),
        ]
        return self.estimator.add(stamp, data).estimate


@pytest.mark.parametrize('name', PRESETS)
def test_the_force_that_pushes_the_arm_is_found(name):
    tracked, errors = Tracked(name, is_moving=False), []
    for step, time in enumerate((0.0, 0.2, 0.4, PERIOD / 2 + 0.1, PERIOD / 2 + 0.3, 4.0)):
        force = tracked.push.at(time)
        tracked.arm.advance(np.full(tracked.tendons, 0.1), force)
        contact = contact_of(tracked.add(step * 10**8, 0.1), tracked.config.arm)
        away, known = contact.wrench[:3] - force, contact.covariance[:3, :3]
        errors.append(away @ np.linalg.solve(known, away))
        # What pushes is seen, and nothing else is.
        square = contact.wrench[:3] @ np.linalg.solve(known, contact.wrench[:3])
        assert (square > 16.3) == force.any()  # chi-square of 3, 0.1 %
    assert np.mean(errors) < 10.0


def test_a_sensor_under_the_base_is_refused_beside_obstacles():
    floor = Loads(obstacles=(Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0), stiffness=1e4),))
    beside = dataclasses.replace(CONFIG, loads=floor)
    assert PushedArm(beside, Push(), Sensors(tip_pose_rate=10.0))
    with pytest.raises(MeasurementError, match='obstacles are not covered'):
        PushedArm(beside, Push(), EXACT)
    model = ArmModel(CONFIG.arm, Unknowns(Walk(5.0, 1.0)), loads=floor)
    prediction = Prediction(model, np.zeros(model.state.size), None)
    with pytest.raises(MeasurementError, match='obstacles are not covered'):
        BaseWrench(np.zeros(6), 1.0).innovation(prediction)


@pytest.mark.parametrize('name', ['fetching', 'rotating'])
def test_a_profile_changes_tensions_as_slowly_as_the_estimator_expects(name):
    config = Config.from_parameters(load_parameters('renda2012_table4'))
    profile = find_profile(name, config.arm)
    simulator, estimator = touched(config, profile)
    time = np.arange(0.0, profile.duration / simulator['profile.speed'], 0.2)
    change = np.diff(profile.at(simulator['profile.speed'] * time), axis=0)
    assert 0.0 < np.abs(change).max() < 1.01 * estimator['estimator.tension_rate'] * np.sqrt(0.2)


@pytest.mark.parametrize('name', ['renda2012_prototype', 'renda2012_table4'])
def test_the_estimate_of_an_arm_that_swings_is_as_exact_as_it_says(name):
    tracked = Tracked(name, is_moving=True)
    squares, refused, tips, between = [], 0, [], []
    for step in range(50):
        # From shortly before the push begins.
        force = tracked.push.at(0.5 * PERIOD - 0.2 + 0.04 * step)
        tracked.arm.advance(np.full(tracked.tendons, 0.02), force, 0.04)
        estimate = tracked.add(40_000_000 * step, 0.02)
        refused += len(estimate.refused)
        shape = tracked.arm.backbone
        away = estimate.backbone.position - shape.position
        tips.append(shape.tip)
        for station in (15, 30):
            known = estimate.pose_covariance[station, :3, :3]
            squares.append(away[station] @ np.linalg.solve(known, away[station]))
        # By tensions alone, before the next measured tip.
        cells = Tensions(np.full(tracked.tendons, 0.02), tracked.noise)
        later = tracked.estimator.add(40_000_000 * step + 20_000_000, [cells]).estimate
        between.append(np.sqrt(np.trace(later.pose_covariance[-1, :3, :3])))
    assert np.median(between) < 0.048 * tracked.config.arm.length
    assert np.ptp(tips, axis=0).max() > 0.05 * tracked.config.arm.length
    assert refused <= 2  # of 150
    assert np.mean(squares) < 1.5 * 3  # chi-square of 3
    assert np.max(squares) < 50.0
