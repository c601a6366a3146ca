"""Faulty sensors: rows of the table of `benchmarks/faults.py`."""

import functools
import itertools
import sys

import pytest
from checkout import ROOT

sys.path.insert(0, str(ROOT / 'benchmarks'))

from faults import Bench, Case

from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.settings import EstimatorSettings

ARM = 'renda2012_table4'
bench_of = functools.cache(Bench)


@pytest.mark.parametrize(
    'case',
    [
        # The cell of tendon_2_1 reads nothing, before and after the other sensors of its stamp.
        Case(ARM, '0', 4, 'both', 10.0, is_moving=False),
        Case(ARM, '0', 4, 'tip', 10.0, is_moving=True, cells_first=False),
        Case(ARM, 'x 5', 8, 'markers', 10.0),
        # Faulty from the first message on: no earlier estimate is near the true shape.
        Case(ARM, 'x 5', 0, 'markers', begin=0.0),
        Case('rao2021', '0', 0, 'tip', begin=0.0),
        pytest.param(Case('rao2021', 'x 5', 4, 'both', begin=0.0), marks=pytest.mark.endurance),
        pytest.param(Case(ARM, 'x 0.3', 5, 'markers', 4.0), marks=pytest.mark.endurance),
        pytest.param(Case(ARM, 'x 5', 4, 'both', 50.0), marks=pytest.mark.endurance),
        pytest.param(Case(ARM, 'base offset', 0, 'both', 20.0), marks=pytest.mark.endurance),
        pytest.param(Case(ARM, 'all cells x 1000'), marks=pytest.mark.endurance),
        pytest.param(Case(ARM, 'all cells x 1000', rate=50.0), marks=pytest.mark.endurance),
    ],
)
def test_faulty_sensor_is_named_within_1_s_and_trusted_again_within_2_s(case):
    row = bench_of(case.arm).run(case)
    assert row.named_after <= 1.0 and row.named_share > 0.98
    assert row.share_beyond_five <= 0.02
    assert row.sound_refused <= 1.0 and row.refused_after <= 2.0
    assert row.published == 1.0


@pytest.mark.parametrize(
    'case',
    [
        Case(ARM, 'stuck', 6, 'markers', 10.0),
        Case('renda2012_table2', 'tip 5 mm off', 0, 'tip', 10.0),
        Case(ARM, 'drift', 0, 'markers', 10.0),
        # Faults that agree with each other look like a movement, but stay within the covariance.
        Case(ARM, 'tip and cells by 50 mm', 5, 'tip', 10.0),
        Case('rao2021', 'tip and cells by 50 mm', 1, 'tip', 4.0),  # a third is its motion
        pytest.param(Case('rao2021', 'tip and cells by 50 mm'), marks=pytest.mark.endurance),
        pytest.param(
            Case(ARM, 'tip and cells by 50 mm', 0, 'both', 50.0, is_moving=False),
            marks=pytest.mark.endurance,
        ),
        pytest.param(Case(ARM, 'marker jumps', 0, 'both', 20.0), marks=pytest.mark.endurance),
        pytest.param(Case(ARM, 'none', 0, 'both', 20.0), marks=pytest.mark.endurance),
    ],
)
def test_fault_that_is_not_detectable_stays_within_the_covariance(case):
    row = bench_of(case.arm).run(case)
    assert row.share_beyond_five <= 0.02 and row.published == 1.0
    assert row.sound_refused <= 1.0


@pytest.mark.parametrize('arm', [ARM, 'rao2021', 'renda2012_table2'])
@pytest.mark.parametrize('order', [(1, 0, 2), (2, 0, 1), (2, 1)])
def test_sound_sensors_that_are_heard_one_after_the_other_are_believed(arm, order):
    bench = bench_of(arm)
    estimator = Estimator(bench.models, bench.settings.rules)
    recording = itertools.islice(bench.measurements(Case(arm, 'none')), 5)
    for step, (_, measurements) in enumerate(recording):
        for number, sensor in enumerate(order):
            estimator.add(10**7 * (5 * step + number), [measurements[sensor]])
            # No load cell is a suspect either, least of all before it has measured.
            doubted = *estimator.refused_since, *estimator.suspects
            assert not any(name.startswith('load cell') for name in doubted)


def test_place_of_a_force_is_found_despite_a_faulty_sensor():
    bench = bench_of('renda2012_prototype')
    length = bench.config.arm.length
    values = {'contact': 'somewhere', 'contact_s': [0.5 * length, length], 'tension_rate': 1.0}
    settings = EstimatorSettings.from_parameters(
        {f'estimator.{name}': value for name, value in values.items()}, bench.config
    )
    models, change_time = settings.models(bench.config), settings.given.change_time
    estimator, correct = Estimator(models, settings.rules, 0.2, change_time), 0
    case = Case('renda2012_prototype', 'tip 5 mm off', 0, 'tip', 10.0)
    for number, (_, measurements) in enumerate(bench.measurements(case)):
        for measurement in measurements:
            last = estimator.add(10**8 * number, [measurement])
        correct += last.hypothesis == list(last.probabilities)[-1]
    # If refused readings cost no likelihood, the place that refuses most would be chosen.
    assert correct > 20
