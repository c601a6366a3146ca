"""A simulated recording of an arm with a contact force, with few messages."""

import functools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from octo_arm_model.bags.outputs import TOUCH_DIRECTION, Experiment, add_demo, custom_data
from octo_arm_model.bags.writer import BagWriter
from octo_arm_model.config.parameter_files import load_parameters

# Fixtures of pytest do not last for all examples of Hypothesis.
_FOLDER = tempfile.TemporaryDirectory()
PARAMETERS = {**load_parameters('renda2012_prototype'), 'stations': 31}
FORCE = 0.02
PUSH = FORCE * np.array(TOUCH_DIRECTION)
HOLD, RAMP = 2.0, 0.5
TOUCHED = 4 * (HOLD + RAMP) + np.array([0.1875, 0.8125]) * HOLD  # times of the full force [s]
MARKERS = (0.09, 0.18)


def touched(**changes: Any) -> Experiment:
    defaults = {
        'stiffness': 1.0,
        'touch': FORCE,
        'hold': HOLD,
        'ramp': RAMP,
        'tension_rate': 5.0,
        'marker_rate': 5.0,
        'camera_rate': 2.5,
        'clock_offset': 0.0,
        'dropped': 0.0,
        'outliers': 0.0,
    }
    return Experiment(**{**defaults, **changes})


def record(path: Path, **changes: Any) -> Path:
    """Write a bag of `touched` to ``path``."""
    experiment = touched(**changes)
    with BagWriter(path, custom=custom_data(experiment)) as writer:
        add_demo(writer, PARAMETERS, experiment)
    return path


@functools.cache
def touched_bag() -> Path:
    """Return a bag with markers at `MARKERS`, which lasts as long as the process."""
    return record(Path(_FOLDER.name) / 'touched', markers=MARKERS)
