"""Where an unknown force acts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from estimation_arms import TENSIONS, rubber

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.estimation.estimator import Estimator
from octo_arm_model.estimation.measurements import Markers, Tensions
from octo_arm_model.estimation.model import Prediction
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk

UNKNOWNS = Unknowns(Walk(5.0, 1.0))
PLACES = (0.07, 0.13, 0.19)
FORCE = Walk.stationary(0.02, 0.2)


SECOND = 10**9


def models() -> dict[str, object]:
    found = {
        f'{s} m': rubber(dataclasses.replace(UNKNOWNS, point_forces=(PointForce(s, FORCE),)))
        for s in PLACES
    }
    return {'free': rubber(UNKNOWNS), **found}


@pytest.mark.parametrize('place', [
    0.13, None, *(pytest.param(place, marks=pytest.mark.endurance) for place in (0.07, 0.19))
])  # fmt: skip
def test_the_place_is_found(place: float | None) -> None:
    rng = np.random.default_rng(7)
    given = models()
    name = 'free' if place is None else f'{place} m'
    model = given[name]
    x = np.zeros(model.state.size)
    x[:4] = TENSIONS
    if place is not None:
        x[model.state.point_forces] = [0.0, 0.02, -0.015]
    shape = Prediction(model, x, None).solved
    s = np.array([0.05, 0.1, 0.15, 0.2])
    at = Markers(s, np.zeros((4, 3)), 1e-3)
    positions = -at.innovation(Prediction(model, x, None)).reshape(4, 3)
    bank = Estimator(given)
    for step in range(3):
        noisy = positions + 1e-3 * rng.normal(size=(4, 3))
        found = bank.add(step * SECOND // 10, [Tensions(TENSIONS, 0.01), Markers(s, noisy, 1e-3)])
    assert sum(found.probabilities.values()) == pytest.approx(1.0)
    best = found
    assert best.hypothesis == name and best.probabilities[name] > 0.9
    np.testing.assert_allclose(best.estimate.backbone.tip, shape.tip, atol=2e-3)
    if place is not None:
        where = model.state.point_forces
        error = best.estimate.mean[where] - x[where]
        assert error @ np.linalg.solve(best.estimate.covariance[where, where], error) < 16.0


def test_a_truth_that_changes_is_followed() -> None:
    given = {name: model for name, model in models().items() if name in ('free', '0.19 m')}
    s = np.array([0.1, 0.2])
    bank = Estimator(given, change_time=1.0)
    for step, force in enumerate([0.0, 0.0, 0.02, 0.02, 0.02]):
        model = given['0.19 m']
        x = np.concatenate([TENSIONS, [0.0, force, 0.0]])
        positions = -Markers(s, np.zeros((2, 3)), 1e-3).innovation(Prediction(model, x, None))
        measured = [Tensions(TENSIONS, 0.01), Markers(s, positions.reshape(2, 3), 1e-3)]
        found = bank.add(step * SECOND // 10, measured)
        assert found.hypothesis == ('0.19 m' if force else 'free')
        # Neither is ever beyond doubt.
        assert min(found.probabilities.values()) > 1e-20
    with pytest.raises(MeasurementError, match='before the window'):
        bank.add(-SECOND, [])
    assert bank.late == 1
    with pytest.raises(MeasurementError, match='at least one'):
        Estimator({})
    with pytest.raises(MeasurementError, match='change_time'):
        Estimator(given, change_time=0.0)


def test_late_measurements_count_as_in_time() -> None:
    """In any order within the window: the same probabilities and the same states."""
    given = {name: model for name, model in models().items() if name in ('free', '0.19 m')}
    model, s = given['0.19 m'], np.array([0.1, 0.2])
    x = np.concatenate([TENSIONS, [0.0, 0.004, 0.0]])
    positions = -Markers(s, np.zeros((2, 3)), 1e-3).innovation(Prediction(model, x, None))
    seen = Markers(s, positions.reshape(2, 3), 3e-3)
    measured = [[Tensions(TENSIONS, 0.01)], [seen], [Tensions(TENSIONS, 0.01)], [seen]]
    results = []
    for order in ((0, 1, 2, 3), (0, 2, 3, 1)):
        bank = Estimator(given, change_time=1.0, window=1.0)
        for step in order:
            found = bank.add(step * SECOND // 10, measured[step])
            assert [one.name for one in found.innovations] == [measured[step][0].name]
        results.append(found)
    one, other = results
    assert one.hypothesis == other.hypothesis
    for name, probability in one.probabilities.items():
        assert 1e-3 < probability < 0.999
        assert probability == pytest.approx(other.probabilities[name], rel=1e-2)
    assert one.estimate.time == other.estimate.time == pytest.approx(0.3)
    np.testing.assert_allclose(one.estimate.mean, other.estimate.mean, atol=5e-3)
