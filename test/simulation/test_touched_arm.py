"""The touched arm of any preset: its parameters are accepted, and the force is found by them."""

from __future__ import annotations

import numpy as np
import pytest
from checkout import PRESETS

from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.estimation.estimate import contact_of
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Markers, Tensions, TipPosition
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.simulation.dynamic_arm import DynamicArm
from octo_arm_model.simulation.parameters import SimulatorConfig, in_water
from octo_arm_model.simulation.pushed_arm import PERIOD, touched


@pytest.mark.parametrize('name', PRESETS)
def test_the_force_that_pushes_the_arm_is_found(name: str) -> None:
    values = load_parameters(preset_path(name)) | {'stations': 31}
    of_simulator, of_estimator = touched(Config.from_parameters(values))
    simulated = SimulatorConfig.from_parameters(values | of_simulator)
    own = {key: of_estimator.pop(key) for key in list(of_estimator) if 'estimator.' in key}
    config = Config.from_parameters(values | of_estimator)
    settings = EstimatorSettings.from_parameters(own, config)
    tracker = Estimator.from_settings(settings, settings.models(config), settings.window)
    arm, push, sensors = simulated.pushed_arm, simulated.push, simulated.sensors
    assert arm is not None
    tensions, random = np.full(len(config.arm.tendons), 0.1), np.random.default_rng(3)
    errors = []
    for step, time in enumerate((0.0, 0.2, 0.4, PERIOD / 2 + 0.1, PERIOD / 2 + 0.3, 4.0)):
        force = push.at(time)
        arm.solve(tensions, force)
        pose = arm.tip_pose()
        read = tensions + settings.noise.tension * random.standard_normal(tensions.size)
        tracked = tracker.add(step * 10**8, [
            Tensions(read, settings.noise.tension),
            TipPosition(pose.position, sensors.tip_position_stddev),
            Markers(sensors.marker_s, arm.markers(), sensors.marker_stddev),
        ])  # fmt: skip
        contact = contact_of(tracked.estimate, config.arm)
        assert contact is not None
        away, known = contact.wrench[:3] - force, contact.covariance[:3, :3]
        errors.append(away @ np.linalg.solve(known, away))
        # What pushes is seen, and nothing else is.
        square = contact.wrench[:3] @ np.linalg.solve(known, contact.wrench[:3])
        assert (square > 16.3) == force.any()  # chi-square of 3, 0.1 %
    assert np.mean(errors) < 10.0


@pytest.mark.parametrize('name', ['renda2012_prototype', 'renda2012_table4'])
def test_the_estimate_of_an_arm_that_swings_is_as_exact_as_it_says(name: str) -> None:
    values = load_parameters(preset_path(name)) | {'stations': 31}
    plain = Config.from_parameters(values)
    of_simulator, of_estimator = touched(plain, is_moving=True)
    in_motion = in_water(plain)
    simulated = SimulatorConfig.from_parameters(values | in_motion | of_simulator)
    del in_motion['dynamics']
    own = {key: of_estimator.pop(key) for key in list(of_estimator) if 'estimator.' in key}
    config = Config.from_parameters(values | in_motion | of_estimator)
    settings = EstimatorSettings.from_parameters(own, config)
    tracker = Estimator.from_settings(settings, settings.models(config), settings.window)
    arm, sensors = simulated.pushed_arm, simulated.sensors
    assert isinstance(arm, DynamicArm)
    tensions, random = np.full(len(config.arm.tendons), 0.02), np.random.default_rng(3)
    squares, refused, bend = [], 0, []
    for step in range(50):
        # From shortly before the push begins.
        arm.advance(tensions, simulated.push.at(0.5 * PERIOD - 0.2 + 0.04 * step), 0.04)
        read = tensions + settings.noise.tension * random.standard_normal(tensions.size)
        tracked = tracker.add(40_000_000 * step, [
            Tensions(np.maximum(read, 0.0), settings.noise.tension),
            TipPosition(arm.tip_pose().position, sensors.tip_position_stddev),
            Markers(sensors.marker_s, arm.markers(), sensors.marker_stddev),
        ])  # fmt: skip
        refused += len(tracked.estimate.refused)
        away = tracked.estimate.backbone.position - arm.backbone.position
        bend.append(arm.backbone.tip)
        for station in (15, 30):
            known = tracked.estimate.pose_covariance[station, :3, :3]
            squares.append(away[station] @ np.linalg.solve(known, away[station]))
    assert np.ptp(bend, axis=0).max() > 0.05 * config.arm.length
    assert refused <= 2  # of 150
    assert np.mean(squares) < 1.5 * 3  # chi-square of 3
    assert np.max(squares) < 50.0
