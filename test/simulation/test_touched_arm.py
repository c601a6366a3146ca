"""The touched arm of any preset: its parameters are accepted, and the force is found by them."""

from __future__ import annotations

import numpy as np
import pytest
from checkout import PRESETS

from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.estimation.contact import contact_of
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Markers, Tensions, TipPosition
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.simulation.parameters import SimulatorConfig
from octo_arm_model.simulation.touched_arm import PERIOD, touched


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
