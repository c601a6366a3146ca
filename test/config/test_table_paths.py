"""Tendons on tabulated paths: what they do between the points."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path

PRESET = load_parameters(preset_path('renda2012_prototype'))
LENGTH = Config.from_parameters(PRESET).arm.length
KINK, NEAR, FAR = 0.4 * LENGTH, 2e-3, 8e-3  # where, and distances there and at the ends [m]


def arm_of(s: np.ndarray, offset: np.ndarray, **more: object) -> Config:
    """The prototype with all four tendons at an ``offset`` (n,) [m] at ``s`` (n,) [m]."""
    values = {name: value for name, value in PRESET.items() if 'offset' not in name}
    table = {'tendons.table_s': s.tolist(), 'tendons.table_offset': np.tile(offset, 4).tolist()}
    more = {name.replace('__', '.'): value for name, value in more.items()}
    whole = {'body.radius_tip': 9e-3, 'body.radius_base': 12e-3, 'model': 'exact', 'stations': 21}
    return Config.from_parameters({**values, **table, **whole, **more})


def tip_of(config: Config) -> np.ndarray:
    pull = np.array([2.0, 0.7, 0.0, 0.0]).reshape(config.arm.tension_shape)
    return config.solver().solve(pull).tip


def test_a_linear_path_is_the_limit_of_smooth_ones_and_pchip_is_another():
    s, offset = np.array([0.0, KINK, LENGTH]), np.array([FAR, NEAR, FAR])
    kinked = tip_of(arm_of(s, offset, tendons__table_between='linear'))
    away = []
    for half in (0.02, 0.01, 0.005):
        # Points of the same lines, but for those within `half` of the kink.
        places = np.array(
            [*np.linspace(0.0, KINK - half, 30), *np.linspace(KINK + half, LENGTH, 30)]
        )
        smooth = tip_of(arm_of(places, np.interp(places, s, offset)))
        away.append(np.linalg.norm(smooth - kinked))
    assert away[2] < away[1] < away[0] < 0.02 * LENGTH and away[2] < 0.2 * away[0]
    assert np.linalg.norm(tip_of(arm_of(s, offset)) - kinked) > 0.01 * LENGTH


def test_what_is_neither_and_friction_at_kinks_are_refused():
    s, offset = np.array([0.0, KINK, LENGTH]), np.array([FAR, NEAR, FAR])
    with pytest.raises(ConfigError, match="table_between is 'cubic', expected pchip or linear"):
        arm_of(s, offset, tendons__table_between='cubic')
    with pytest.raises(ConfigError, match=r'is linear, and tendons\.friction is given'):
        arm_of(s, offset, tendons__table_between='linear', tendons__friction=[0.2])
