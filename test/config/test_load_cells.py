"""Calibration of load cells, and parameters that are the fields of a dataclass."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, OctoArmError, TensionError
from octo_arm_model.config.build import LoadCellCalibration
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter import ParameterGroup, stated
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.simulation.hardware import Hardware, SimulatedHardware

TABLE4 = load_parameters(preset_path('renda2012_table4'))
CONFIG = Config.from_parameters(TABLE4)
OFFSETS = tuple(0.1 * n - 0.3 for n in range(12))
SCALES = tuple(0.8 + 0.05 * n for n in range(12))


def test_readings_are_scaled_then_moved_and_what_is_near_zero_is_zero() -> None:
    cells = LoadCellCalibration(0.02, OFFSETS, SCALES)
    readings = np.random.default_rng(0).uniform(0.5, 2.0, (5, 3, 4))
    expected = np.reshape(SCALES, (3, 4)) * readings + np.reshape(OFFSETS, (3, 4))
    np.testing.assert_allclose(cells.tensions(CONFIG.arm, readings), expected, rtol=1e-12)
    flat = cells.scale_and_offset(readings.reshape(5, 12))
    np.testing.assert_array_equal(flat, cells.tensions(CONFIG.arm, readings).reshape(5, 12))
    zeroed = LoadCellCalibration(0.02).tensions(
        CONFIG.arm, np.full((3, 4), -0.02) + 0.01 * np.eye(3, 4)
    )
    assert (zeroed == 0.0).all()
    assert LoadCellCalibration(0.02).scale_and_offset(np.array([0.021])).item() == 0.021


@pytest.mark.parametrize('reading', [-0.021, np.nan, np.inf, -np.inf])
def test_what_is_below_the_deadband_or_no_number_is_refused(reading: float) -> None:
    readings = np.zeros((3, 4))
    readings[1, 2] = reading
    with pytest.raises(TensionError, match=r'tension of tendon_2_3 is .*_deadband of 0.02 N'):
        LoadCellCalibration(0.02).tensions(CONFIG.arm, readings)


def test_shapes_of_another_arm_are_refused_as_without_calibration() -> None:
    for wrong in (np.zeros(5), [['a', 'b']], np.zeros((4, 3)), [[1.0], [1.0, 2.0]]):
        with pytest.raises(TensionError, match='expected'):
            LoadCellCalibration(0.02, OFFSETS).tensions(
                CONFIG.arm, np.array(wrong, dtype=object) if len(wrong) == 2 else wrong
            )


@pytest.mark.parametrize(
    ('name', 'value', 'kind', 'message'),
    [
        ('tension_deadband', -0.1, ArmDefinitionError, 'tension_deadband is -0.1'),
        ('tension_deadband', np.inf, ArmDefinitionError, 'tension_deadband is inf'),
        ('tension_offset', [0.1], ConfigError, 'tension_offset has 1 values, expected 12'),
        ('tension_offset', 12 * [np.nan], ArmDefinitionError, 'tension_offset is nan'),
        ('tension_scale', 11 * [1.0], ConfigError, 'tension_scale has 11 values, expected 12'),
        ('tension_scale', 12 * [0.0], ArmDefinitionError, 'tension_scale is 0.0'),
    ],
)
def test_calibrations_that_cannot_be_are_refused(
    name: str, value: object, kind: type[OctoArmError], message: str
) -> None:
    with pytest.raises(kind, match=message):
        Config.from_parameters({**TABLE4, name: value})


def test_simulated_cells_read_what_the_calibration_undoes() -> None:
    cells = LoadCellCalibration(0.0, OFFSETS, SCALES)
    hardware = SimulatedHardware(Hardware(calibration=cells), 12)
    command = np.linspace(0.0, 2.0, 12)
    moment = hardware.step(command, 0.01)
    np.testing.assert_allclose(cells.scale_and_offset(moment.measured), command, atol=1e-12)
    np.testing.assert_array_equal(moment.effective, command)


@dataclass(frozen=True)
class Pump(ParameterGroup):
    GROUP = 'pump'

    pressure: float = stated('what it holds [Pa]; 0 for off', 0.0, '>= 0', 'pressure')
    time: float = stated('how long it takes [s]', 1.0, '> 0')
    share: float = stated('of the flow [-]', 0.5, 'in [0, 1]')
    places: tuple[float, ...] = stated('of its valves [m]', (), 'on the arm')
    seed: int = stated('of its noise', 0, '>= 0')


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'pressure': -1.0}, 'pump.pressure is -1.0, expected a finite pressure >= 0 [Pa]'),
        ({'pressure': math.nan}, 'pump.pressure is nan, expected a finite pressure >= 0 [Pa]'),
        ({'time': 0.0}, 'pump.time is 0.0, expected a finite number > 0 [s]'),
        ({'share': 1.1}, 'pump.share is 1.1, expected a finite number within [0, 1] [-]'),
        ({'seed': -1}, 'pump.seed is -1, expected an integer >= 0'),
    ],
)
def test_values_outside_their_range_are_refused_by_name(given, message) -> None:
    with pytest.raises(ArmDefinitionError) as caught:
        Pump(**given)
    assert str(caught.value) == message
