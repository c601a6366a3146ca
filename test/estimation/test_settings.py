"""What an estimator takes for unknown, from its parameters and the arm's."""

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
    given = {f'{PREFIX}{name}': value for name, value in values.items()}
    return EstimatorSettings.from_parameters(given, config)


def rates(found: EstimatorSettings) -> list[float]:
    """How fast the tension of every tendon may change."""
    tension = found.unknowns['tip'].tension
    return [walk.rate for walk in tension]


def test_without_a_word_it_is_a_force_on_the_tip_of_the_size_that_bends_the_arm():
    found = settings()
    ((name, unknowns),) = found.unknowns.items()
    assert name == 'tip' and unknowns.tip_force is not None
    assert unknowns.tip_force.stddev == pytest.approx(bending_force(CONFIG.arm, BENT))
    assert rates(found) == default_highest(CONFIG.arm).ravel().tolist()
    assert unknowns.tip_moment is unknowns.tension_bias is unknowns.log_modulus is None
    # What was not given is said.
    assert len(found.notes) == 3
    assert any('tension_stddev is not given' in note for note in found.notes)


def test_what_the_arm_and_the_recording_say_comes_first():
    known = Config.from_parameters(
        {
            **VALUES,
            'model': 'exact',
            'tension_stddev': 0.03,
            'model_error_stddev': 0.01,
            'material.youngs_modulus_stddev': 0.1,
        }
    )
    recorded = TensionStatistics(0.007, 0.2)
    found = EstimatorSettings.from_parameters({}, known, recorded)
    assert found.noise.tension == 0.03
    assert found.noise.model_position == pytest.approx(0.01 * LENGTH)
    assert rates(found) == [0.2] * 4
    assert found.unknowns['tip'].log_modulus is not None
    found = EstimatorSettings.from_parameters({}, CONFIG, recorded)
    assert found.noise.tension == 0.007
    given = {f'{PREFIX}tension_rate': 1.5}
    found = EstimatorSettings.from_parameters(given, CONFIG, recorded)
    assert rates(found) == [1.5] * 4


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
def test_what_a_recording_says_is_within_the_range_of_the_parameter_or_not_needed(
    recorded, given, words
):
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
def test_places_of_contact(values, expected):
    found = settings(**values).unknowns
    assert {name: len(one.point_forces) for name, one in found.items()} == expected
    assert all(one.tip_force is None for one in found.values())


def test_places_near_each_other_have_names_of_their_own():
    places = [0.1, 0.100001, 0.2]
    found = settings(contact='somewhere', contact_s=places).unknowns
    assert list(found) == ['none', '0.1 m', '0.100001 m', '0.2 m']
    state = State(settings(contact='at', contact_s=places).unknowns['at'], CONFIG.arm)
    assert len(set(state.names)) == state.size


def test_what_is_beyond_the_tip_by_rounding_is_at_the_tip():
    beyond = LENGTH * (1.0 + 5e-10)
    found = settings(contact='at', contact_s=[beyond], marker_s=[0.1, beyond])
    assert found.unknowns['at'].point_forces[0].s == LENGTH
    assert found.noise.given.marker_s == (0.1, LENGTH)
    assert check_marker_s([0.1, beyond], LENGTH).tolist() == [0.1, LENGTH]


def test_a_current_presses_as_hard_as_the_force():
    found = settings(contact='current', force_stddev=0.1).unknowns['current'].current
    area = LENGTH * (0.015 + 0.0074)  # of the trapezium that is seen from the side
    assert found.stddev == pytest.approx(0.1 / area)
    given = settings(contact='current', current_stddev=3.0).unknowns['current'].current
    assert given is not None and given.stddev == 3.0


def test_models_are_those_of_the_file_solved_by_the_model_exact():
    loaded = Config.from_parameters(
        {
            **VALUES,
            'model': 'exact',
            'stations': 41,
            'material.density': 1080.0,
            'loads.gravity': [0.0, 0.0, -9.81],
            'base.position': [0.1, 0.0, 0.2],
        }
    )
    (model,) = settings(loaded).models(loaded, compiled=False).values()
    solver = model.solver
    assert (solver.model, solver.grid.s.size) == ('exact', 41)
    assert solver.base.position == (0.1, 0.0, 0.2)
    assert model.loads.gravity == (0.0, 0.0, -9.81)


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'contact': 'elbow'}, "contact is 'elbow', expected one of tip, at"),
        ({'contact': 'at'}, 'contact_s is empty, expected where the arm is touched'),
        ({'contact_s': [0.1]}, 'contact_s is given, which goes not with contact tip'),
        ({'contact': 'current', 'moment_stddev': 0.1}, 'no effect with contact current'),
        ({'current_stddev': 3.0}, 'current_stddev is 3, which has no effect with contact tip'),
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
def test_wrong_values_are_named(values, words):
    with pytest.raises(OctoArmError, match=words):
        settings(**values)


@pytest.mark.parametrize('values', [{'contact': 'elbow'}, {'gate': 0.0}, {'cell_fault': 1.0}])
def test_parameters_are_checked_before_any_arm(values):
    with pytest.raises(OctoArmError, match=f'estimator.{next(iter(values))} is .*, expected'):
        EstimatorParameters(**values)


def test_an_unknown_modulus_and_sheaths_are_refused_by_their_parameters():
    values = {**VALUES, 'model': 'exact', 'tendons.sheath_stiffness': [2.5e5]}
    settings(Config.from_parameters(values))
    both = Config.from_parameters({**values, 'material.youngs_modulus_stddev': 0.05})
    words = 'youngs_modulus_stddev is 0.05, expected 0 with tendons.sheath_stiffness'
    with pytest.raises(ConfigError, match=words):
        settings(both)


def test_friction_makes_the_loss_of_tension_unknown():
    rough = Config.from_parameters({**VALUES, 'model': 'exact', 'tendons.friction': [0.1]})
    found = settings(rough)
    (model,) = found.models(rough).values()
    loss = model.state.unknowns.tension_loss
    assert loss is not None and loss.stddev == pytest.approx(0.2)
    assert any('friction may hold back 0.2 of each tension' in note for note in found.notes)
    # Without friction there is one where it is asked for.
    given = settings(tension_loss_stddev=0.02).unknowns['tip'].tension_loss
    assert given is not None and given.stddev == 0.02
    assert settings().unknowns['tip'].tension_loss is None
