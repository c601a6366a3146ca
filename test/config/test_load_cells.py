"""Calibration of load cells, and parameters that are the fields of a dataclass."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from octo_arm_model.arm.errors import ArmDefinitionError, ConfigError, TensionError
from octo_arm_model.config.build import LoadCellCalibration
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.simulation.hardware import Hardware, SimulatedHardware

TABLE4 = load_parameters(preset_path('renda2012_table4'))
CONFIG = Config.from_parameters(TABLE4)
OFFSETS = tuple(0.1 * n - 0.3 for n in range(12))
SCALES = tuple(0.8 + 0.05 * n for n in range(12))


def test_readings_are_scaled_then_moved_and_what_is_near_zero_is_zero():
    cells = LoadCellCalibration(0.02, OFFSETS, SCALES)
    readings = np.random.default_rng(0).uniform(0.5, 2.0, (5, 3, 4))
    expected = np.reshape(SCALES, (3, 4)) * readings + np.reshape(OFFSETS, (3, 4))
    assert_allclose(cells.tensions(CONFIG.arm, readings), expected, rtol=1e-12)
    flat = cells.scale_and_offset(readings.reshape(5, 12))
    assert_array_equal(flat, cells.tensions(CONFIG.arm, readings).reshape(5, 12))
    zeroed = LoadCellCalibration(0.02).tensions(
        CONFIG.arm, np.full((3, 4), -0.02) + 0.01 * np.eye(3, 4)
    )
    assert (zeroed == 0.0).all()
    assert LoadCellCalibration(0.02).scale_and_offset(np.array([0.021])).item() == 0.021


@pytest.mark.parametrize('reading', [-0.021, np.nan, np.inf, -np.inf])
def test_what_is_below_the_deadband_or_no_number_is_refused(reading):
    readings = np.zeros((3, 4))
    readings[1, 2] = reading
    with pytest.raises(TensionError, match=r'tension of tendon_2_3 is .*_deadband of 0.02 N'):
        LoadCellCalibration(0.02).tensions(CONFIG.arm, readings)


def test_shapes_of_another_arm_are_refused_as_without_calibration():
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
def test_calibrations_that_cannot_be_are_refused(name, value, kind, message):
    with pytest.raises(kind, match=message):
        Config.from_parameters({**TABLE4, name: value})


def test_simulated_cells_read_what_the_calibration_undoes():
    cells = LoadCellCalibration(0.0, OFFSETS, SCALES)
    hardware = SimulatedHardware(Hardware(calibration=cells), 12)
    command = np.linspace(0.0, 2.0, 12)
    moment = hardware.step(command, 0.01)
    assert_allclose(cells.scale_and_offset(moment.measured), command, atol=1e-12)
    assert_array_equal(moment.effective, command)
