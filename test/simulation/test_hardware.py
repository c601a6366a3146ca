"""Winches, relaxation and load cells in series."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from strategies import commands

from octo_arm_model.simulation.hardware import Hardware, SimulatedHardware
from octo_arm_model.simulation.relaxation import Relaxation


@given(commands, st.floats(0.0, 10.0))
def test_perfect_hardware_measures_what_was_commanded(given_commands, dt) -> None:
    hardware = SimulatedHardware(Hardware(), 3)
    for command in given_commands:
        measured, effective = hardware.step(command, dt)
        np.testing.assert_array_equal(measured, command)
        np.testing.assert_array_equal(effective, command)


def test_the_shape_at_rest_is_that_of_the_elastic_arm_and_a_pull_shows_in_part_at_once() -> None:
    hardware = SimulatedHardware(Hardware(relaxation=Relaxation(0.25, 1.0)), 2)
    pull = np.array([1.0, 3.0])
    measured, effective = hardware.step(pull, 0.0)
    np.testing.assert_array_equal(measured, pull)
    np.testing.assert_allclose(effective, pull / 1.25, rtol=1e-12)
    for _ in range(100):
        measured, effective = hardware.step(pull, 1.0)
    np.testing.assert_allclose(effective, pull, rtol=1e-12)


def test_the_simulation_needs_neither_ros_nor_matplotlib() -> None:
    code = 'import octo_arm_model.simulation.parameters, octo_arm_model.cli.play, sys; '
    done = subprocess.run(
        [sys.executable, '-c', code + 'print(*sys.modules)'], capture_output=True, text=True
    )
    loaded = {name.split('.')[0] for name in done.stdout.split()}
    assert 'octo_arm_model' in loaded
    assert not loaded & {'rclpy', 'octo_arm_msgs', 'matplotlib', 'viser'}
