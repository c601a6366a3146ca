"""A recording of an arm that is touched, through filter and smoother: the truth in its bands."""

import dataclasses
import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from touched_demo import FORCE, MARKERS, PARAMETERS, PUSH, TOUCHED, record, touched, touched_bag

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.bags.outputs import true_config
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.cli.estimate import summary
from octo_arm_model.estimation.measurements import Tensions
from octo_arm_model.experiment.estimates import Result, estimate
from octo_arm_model.experiment.sensor_recording import (
    SensorRecording,
    Sources,
    read_sensor_recording,
)

MARKED = {'estimator.marker_s': list(MARKERS)}


def read(
    path: Path, start: float = -np.inf, stop: float = np.inf, **sources: Any
) -> SensorRecording:
    """What was measured between ``start`` and ``stop`` [s]."""
    with BagReader(path) as reader:
        recorded = read_sensor_recording(reader, Sources(**sources))
    some = [
        group
        for group in recorded.groups
        if start < 1e-9 * (group[0].stamp_ns - recorded.origin_ns) < stop
    ]
    return dataclasses.replace(recorded, groups=some)


@functools.cache
def result(is_smooth: bool = False) -> Result:
    """Of the whole recording; of that around the touch by the smoother."""
    around = TOUCHED + [-3.0, 1.5] if is_smooth else ()
    return estimate(read(touched_bag(), *around, values=MARKED), is_smooth)


def forces(found: Result) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, forces and standard deviations."""
    rows = [(one.time, one.wrench[:3], one.wrench_stddev[:3]) for one in found.moments]
    time, force, stddev = map(np.array, zip(*rows))
    return time, force, stddev


@pytest.mark.parametrize('is_smooth', [False, True])
def test_the_touch_is_found_when_where_and_as_hard_as_it_was(is_smooth):
    found = result(is_smooth)
    (touch,) = found.touches
    # It grows before and falls after the times of its full size.
    assert TOUCHED[0] - 0.2 < touch.start <= TOUCHED[0] + 0.25
    assert TOUCHED[1] - 0.25 <= touch.stop < TOUCHED[1] + 0.25
    assert (np.abs(touch.force - PUSH) < 3.0 * touch.stddev).all()
    assert np.linalg.norm(touch.force) == pytest.approx(FORCE, rel=0.1)
    assert touch.hypothesis == 'tip'
    assert not found.failures.total and not found.recorded.refusals.total


@pytest.mark.parametrize('is_smooth', [False, True])
def test_the_bands_hold_the_truth(is_smooth):
    found = result(is_smooth)
    time, force, stddev = forces(found)
    corners, _ = touched().schedule(true_config(PARAMETERS, touched()))
    true = touched().touches(time, corners)
    # Where the arm is straight the prior of the force along it does not hold what never acts.
    bent = time > corners[3]
    inside = np.abs(force - true) <= 1.96 * stddev
    assert inside[bent].mean() > 0.9
    # The arm is not touched most of the time, which the prior does not know.
    assert found.consistency['tip pose'].mean < 1.3
    assert found.consistency['tip pose'].refused <= 2


def test_without_a_touch_none_is_found(tmp_path):
    path = record(tmp_path / 'bag', touch=0.0, markers=(0.27,), camera_rate=0.1)
    values = {'estimator.marker_s': [0.27], 'estimator.marker_stddev': 5e-4}
    found = estimate(read(path, values=values))
    assert not found.touches and found.consistency['markers'].accepted > 60


def test_against_the_camera_the_estimator_knows_of_the_touch():
    camera = result(True).camera
    inside = (camera.time > TOUCHED[0]) & (camera.time < TOUCHED[1])
    found, plain = (np.median(one[inside]) for one in camera.tip)
    assert plain > 0.03 > 0.003 > found
    mean, plain = (np.median(one[inside]) for one in camera.mean)
    assert mean < 1e-3 < plain


@functools.cache
def lost(is_smooth: bool, recover_after: float = 1.0) -> Result:
    """An arm whose tensions change by more than 0.01 N in a second, which is what is told."""
    own = {'estimator.tension_rate': 0.01, 'estimator.recover_after': recover_after}
    return estimate(read(touched_bag(), stop=4.0, values={**MARKED, **own}), is_smooth)


@pytest.mark.parametrize('is_smooth', [False, pytest.param(True, marks=pytest.mark.endurance)])
def test_an_arm_that_was_lost_is_found_again_and_told(is_smooth):
    found = lost(is_smooth)
    (time,) = found.restarts
    assert 2.0 < time < 3.5 and f'reset at {time:.2f} s' in summary(found, (), [])
    after = (found.camera.time > time) & (found.camera.time < 4.0)
    assert after.any() and (found.camera.tip[0][after] < 3e-3).all()


def test_the_place_of_a_touch_is_told_by_probabilities():
    values = {**MARKED, 'estimator.contact': 'somewhere', 'estimator.contact_s': [0.12, 0.27]}
    some = read(touched_bag(), TOUCHED[0] - 3.0, TOUCHED[1], values=values)
    found = estimate(dataclasses.replace(some, camera=None))
    assert set(found.hypotheses) == {'none', '0.12 m', '0.27 m'}
    touch = max(found.touches, key=lambda one: one.stop - one.start)
    assert touch.hypothesis == '0.27 m'
    assert touch.start <= np.mean(TOUCHED) <= touch.stop
    time = np.array([one.time for one in found.moments])
    free = (time > time[0] + 0.5) & (time < TOUCHED[0] - 0.5)
    names = np.array([one.hypothesis for one in found.moments])
    assert (names[free] == 'none').mean() > 0.8


def test_where_no_time_has_a_shape_the_reason_is_the_error():
    recorded = read(touched_bag(), values={**MARKED, 'estimator.tension_rate': 1e6})
    crushed = recorded.groups[0][0]._replace(measurement=Tensions([3e4, 0.0, 0.0, 0.0], 0.1))
    with pytest.raises(SolveError, match=r'no estimate at any time; 1 left out, as tensions '):
        estimate(dataclasses.replace(recorded, groups=[[crushed]]))
