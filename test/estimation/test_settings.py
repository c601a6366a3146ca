"""Unknowns and noise of the estimator from its parameters, the arm's and a recording."""

from typing import Any

import numpy as np
import pytest

from octo_arm_model import Config, ConfigError, OctoArmError
from octo_arm_model.arm.stiffness import bending_force, default_highest
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.estimation.settings import (
    BENT,
    PREFIX,
    EstimatorParameters,
    EstimatorSettings,
    TensionStatistics,
)
from octo_arm_model.estimation.unknowns import State
from octo_arm_model.experiment.recording import check_marker_s

VALUES = load_parameters('renda2012_prototype')
CONFIG = Config.from_parameters(VALUES)
LENGTH = CONFIG.arm.length


def settings(config: Config = CONFIG, **values: Any) -> EstimatorSettings:
    parameters = {f'{PREFIX}{name}': value for name, value in values.items()}
    return EstimatorSettings.from_parameters(parameters, config)


def rates(settings_: EstimatorSettings) -> list[float]:
    """Return the rates of all tensions."""
    tension = settings_.unknowns['tip'].tension
    return [walk.rate for walk in tension]


def test_default_is_a_tip_force_that_bends_the_arm():
    chosen = settings()
    ((name, unknowns),) = chosen.unknowns.items()
    assert name == 'tip' and unknowns.tip_force is not None
    assert unknowns.tip_force.stddev == pytest.approx(bending_force(CONFIG.arm, BENT))
    assert rates(chosen) == default_highest(CONFIG.arm).ravel().tolist()
    assert unknowns.tip_moment is unknowns.tension_bias is unknowns.log_modulus is None
    # Notes name the defaults.
    assert len(chosen.notes) == 3
    assert any('tension_stddev is not given' in note for note in chosen.notes)


def test_arm_and_recording_override_defaults():
    config = Config.from_parameters(
        {
            **VALUES,
            'model': 'exact',
            'tension_stddev': 0.03,
            'model_error_stddev': 0.01,
            'material.youngs_modulus_stddev': 0.1,
        }
    )
    recorded = TensionStatistics(0.007, 0.2)
    chosen = EstimatorSettings.from_parameters({}, config, recorded)
    assert chosen.tension_stddev == 0.03
    assert rates(chosen) == [0.2] * 4
    assert chosen.unknowns['tip'].log_modulus is not None
    chosen = EstimatorSettings.from_parameters({}, CONFIG, recorded)
    assert chosen.tension_stddev == 0.007
    parameters = {f'{PREFIX}tension_rate': 1.5}
    chosen = EstimatorSettings.from_parameters(parameters, CONFIG, recorded)
    assert rates(chosen) == [1.5] * 4


@pytest.mark.parametrize(
    ('recorded', 'given', 'words'),
    [
        (
            TensionStatistics(0.01, 3e33),
            {'estimator.tension_rate': 0.5},
            r'tensions change by 3e\+33 N in a second as recorded, .* give estimator.tension_rate',
        ),
        (
            TensionStatistics(2e30, 0.2),
            {'tension_stddev': 0.02},
            r'tensions vary by 2e\+30 N as recorded, expected at most 1e\+30: give tension_stddev',
        ),
    ],
)
def test_statistics_of_a_recording_are_bounded_unless_given(recorded, given, words):
    with pytest.raises(ConfigError, match=words):
        EstimatorSettings.from_parameters({}, CONFIG, recorded)
    of_arm = {name: value for name, value in given.items() if not name.startswith(PREFIX)}
    config = Config.from_parameters({**VALUES, **of_arm})
    EstimatorSettings.from_parameters(
        {name: given[name] for name in given.keys() - of_arm.keys()}, config, recorded
    )


@pytest.mark.parametrize(
    ('values', 'expected'),
    [
        ({'contact': 'none'}, {'none': 0}),
        ({'contact': 'at', 'contact_s': [0.1, 0.2]}, {'at': 2}),
        ({'contact': 'somewhere', 'contact_s': [0.1]}, {'none': 0, '0.1 m': 1}),
        (
            {'contact': 'somewhere'},
            {'none': 0, **{f'{part * LENGTH:.4g} m': 1 for part in (0.2, 0.4, 0.6, 0.8, 1.0)}},
        ),
    ],
)
def test_contact_determines_the_hypotheses(values, expected):
    unknowns = settings(**values).unknowns
    assert {name: len(each.point_forces) for name, each in unknowns.items()} == expected
    assert all(each.tip_force is None for each in unknowns.values())


def test_close_places_have_different_names():
    places = [0.1, 0.100001, 0.2]
    unknowns = settings(contact='somewhere', contact_s=places).unknowns
    assert list(unknowns) == ['none', '0.1 m', '0.100001 m', '0.2 m']
    state = State(settings(contact='at', contact_s=places).unknowns['at'], CONFIG.arm)
    assert len(set(state.names)) == state.size


def test_places_beyond_the_tip_by_rounding_are_at_the_tip():
    beyond = LENGTH * (1.0 + 5e-10)
    chosen = settings(contact='at', contact_s=[beyond], marker_s=[0.1, beyond])
    assert chosen.unknowns['at'].point_forces[0].s == LENGTH
    assert chosen.given.marker_s == (0.1, LENGTH)
    assert check_marker_s([0.1, beyond], LENGTH).tolist() == [0.1, LENGTH]


def test_default_current_gives_the_default_force():
    current = settings(contact='current', force_stddev=0.1).unknowns['current'].current
    area = LENGTH * (0.015 + 0.0074)  # lateral projection
    assert current.stddev == pytest.approx(0.1 / area)
    other = settings(contact='current', current_stddev=3.0).unknowns['current'].current
    assert other is not None and other.stddev == 3.0


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'contact_s': [0.1]}, 'contact_s has no effect with contact tip'),
        ({'contact': 'current', 'moment_stddev': 0.1}, 'no effect with contact current'),
        ({'change_time': 2.0}, 'change_time is 2, which has no effect with contact tip'),
        ({'contact': 'at', 'contact_s': [0.0]}, 'contact_s has 0, expected over 0 to 0.27 m'),
        ({'contact': 'at', 'contact_s': [0.3]}, 'contact_s has 0.3, expected over 0 to 0.27 m'),
        ({'contact': 'somewhere', 'contact_s': [0.1] * 51}, '51 values, expected at most 50'),
        ({'contact': 'at', 'contact_s': [0.1, 0.1]}, r'\[0.1, 0.1\], expected each place once'),
        ({'marker_s': [float('nan')]}, r'marker_s\[0\] is nan, expected a finite number'),
        ({'force_stddev': -1.0}, r'force_stddev is -1.0, expected a finite number >= 0 \[N\]'),
        ({'marker_s': [0.1] * 301}, 'estimator.marker_s has 301 values, expected at most 300'),
        ({'force_time': 0.0}, r'force_time is 0.0, expected a finite number > 0 \[s\]'),
        ({'marker_stddev': float('inf')}, r'marker_stddev is inf, .* > 0 \[m\]'),
        ({'gate': 1.0}, r'gate is 1.0, expected a finite number within \(0, 1\)'),
        ({'gate': np.float64(2.0)}, r'gate is 2.0, expected a finite number within \(0, 1\)'),
        ({'force_stdev': 1.0}, 'did you mean estimator.force_stddev'),
        ({'marker_s': 'tip'}, r"marker_s is 'tip', expected double\[\]"),
    ],
)
def test_invalid_values_are_refused(values, words):
    with pytest.raises(OctoArmError, match=words):
        settings(**values)


@pytest.mark.parametrize('values', [{'contact': 'elbow'}, {'gate': 0.0}, {'cell_fault': 1.0}])
def test_parameters_are_checked_without_an_arm(values):
    with pytest.raises(OctoArmError, match=f'estimator.{next(iter(values))} is .*, expected'):
        EstimatorParameters(**values)


def test_unknown_modulus_with_sheaths_is_refused():
    values = {**VALUES, 'model': 'exact', 'tendons.sheath_stiffness': [2.5e5]}
    settings(Config.from_parameters(values))
    both = Config.from_parameters({**values, 'material.youngs_modulus_stddev': 0.05})
    words = 'youngs_modulus_stddev is 0.05, expected 0 with tendons.sheath_stiffness'
    with pytest.raises(ConfigError, match=words):
        settings(both)


def test_friction_makes_the_tension_loss_unknown():
    config = Config.from_parameters({**VALUES, 'model': 'exact', 'tendons.friction': [0.1]})
    chosen = settings(config)
    (model,) = chosen.models(config).values()
    loss = model.state.unknowns.tension_loss
    assert loss is not None and loss.stddev == pytest.approx(0.2)
    assert any('friction may hold back 0.2 of each tension' in note for note in chosen.notes)
    # Without friction the loss is unknown only if it is given.
    loss_given = settings(tension_loss_stddev=0.02).unknowns['tip'].tension_loss
    assert loss_given is not None and loss_given.stddev == 0.02
    assert settings().unknowns['tip'].tension_loss is None
