"""Parameters of a simulated arm that is pushed again and again, and of the estimator of it.

Forces and noise in proportion to the arm, so that they are for any.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from octo_arm_model.arm.stiffness import bending_force, default_highest
from octo_arm_model.config.config import Config
from octo_arm_model.rod.rotations import axes_of

PERIOD = 6.0  # [s] of the push, which lasts half of it
_PUSHED = 0.3  # of the length: how far the push moves the tip
_RATE = 25.0  # [Hz]
# Noise: in parts of the length, [rad], in parts of how hard tendons are pulled.
_POSITION, _ROTATION, _TENSION = 2e-3, 0.03, 1e-3
_CHANGE = 0.05  # of that: by how much tensions change in a second
_MARKERS = (1 / 3, 2 / 3)  # of the length


def touched(config: Config, is_moving: bool = False) -> tuple[dict[str, Any], dict[str, Any]]:
    """Parameters of `octo_arm_sim` and of `octo_arm_estimator`, besides those of the arm.

    Inertia and drag of an arm that moves are taken for unknown forces at the tip and the markers,
    as the estimator has the arm in balance; they change faster than a push.
    """
    length = config.arm.length
    axes = axes_of(np.array(config.base.quaternion))
    force = bending_force(config.arm, _PUSHED) * axes @ np.array([0.0, 0.6, 0.8])
    highest = float(default_highest(config.arm).min())
    tension = _TENSION * highest
    markers = [part * length for part in _MARKERS]
    simulator = {
        'model': 'exact',
        'load_cells.noise_stddev': tension,
        'push.force': force.tolist(),
        'push.period': PERIOD,
        'sensors.tip_pose_rate': _RATE,
        'sensors.tip_position_stddev': _POSITION * length,
        'sensors.tip_rotation_stddev': _ROTATION,
        'sensors.markers_rate': _RATE,
        'sensors.marker_s': markers,
        'sensors.marker_stddev': _POSITION * length,
    }
    estimator = {
        'tension_stddev': tension,
        'estimator.tension_rate': _CHANGE * highest,
        'estimator.marker_s': markers,
        'estimator.marker_stddev': _POSITION * length,
        'estimator.force_time': 0.5,
    }
    if is_moving:
        estimator |= {
            'estimator.contact': 'at',
            'estimator.contact_s': [length, *markers],
            'estimator.force_time': 0.2,
        }
    return simulator, estimator
