"""The iteration to what measurements and a belief agree on: what it does where it errs."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from checkout import ROOT
from estimation_arms import TENSIONS, rubber

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.beliefs.belief import Belief
from octo_arm_model.estimation.beliefs.curvature import Curvature
from octo_arm_model.estimation.beliefs.fit import Fit, fit
from octo_arm_model.estimation.beliefs.local import Local
from octo_arm_model.estimation.beliefs.posterior import Posterior
from octo_arm_model.estimation.measurements import TipPosition
from octo_arm_model.estimation.state.prediction import ArmModel, Prediction
from octo_arm_model.estimation.state.unknowns import PointForce, Unknowns, Walk

sys.path.insert(0, str(ROOT / 'benchmarks'))

from tip_force_scenario import arm_model

MODEL = rubber(Unknowns(Walk(1.0), tip_force=Walk(0.01)))
STDDEV = np.array([0.1, 0.1, 0.1, 0.1, 5e-3, 5e-3, 5e-3])
PRIOR = Belief(np.concatenate([TENSIONS, np.zeros(3)]), np.diag(STDDEV))
TRUE = PRIOR.mean + STDDEV * [0.5, -0.8, 0.7, 0.3, 0.6, -0.9, 0.4]


class ByDifferences(TipPosition):
    """A tip whose second derivatives nothing but differences tell."""

    def second(self, at: Prediction) -> FloatArray | None:
        return None


def misled(monkeypatch: pytest.MonkeyPatch, kind: type[TipPosition]) -> tuple[Fit, int]:
    """A fit that begins with second derivatives far from right, and how many shapes it takes."""
    taken = 0

    def derivatives(model: ArmModel, *given: object) -> object:
        nonlocal taken
        taken += 1
        return original(model, *given)  # type: ignore[arg-type]

    original = ArmModel.derivatives
    tip = kind(Prediction(MODEL, TRUE, None).solved.tip, 1e-4)
    at = Prediction(MODEL, PRIOR.mean, None)
    jacobian, own = tip.jacobian(at), tip.second(at)
    given = np.zeros((3, 7, 7)) if own is None else own
    wrong = 0.015 * np.random.default_rng(2).normal(size=given.shape)
    wrong *= np.abs(jacobian).max(axis=0) / STDDEV
    wrong += wrong.transpose(0, 2, 1)
    with monkeypatch.context() as patch:
        patch.setattr(ArmModel, 'derivatives', derivatives)
        known = Curvature(given + wrong, jacobian, given)
        return fit(PRIOR, [tip], at, known), taken


def test_nothing_that_was_learnt_is_used_where_the_tip_tells_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, taken = misled(monkeypatch, TipPosition)
    expected, more = misled(monkeypatch, ByDifferences)
    off = found.belief.whitened(found.belief.mean - expected.belief.mean)
    assert np.linalg.norm(off) / np.sqrt(off.size) < 0.2
    assert found.curvature is not None
    np.testing.assert_array_equal(found.curvature.second, found.at.tip_curvature)
    assert taken <= more - 3, (taken, more)  # as many as the tip has directions


@pytest.mark.parametrize(
    ('more', 'is_learnt'),
    [
        ({}, False),
        ({'tension_loss': Walk(0.1)}, False),
        ({'log_modulus': Walk(0.05)}, True),
        ({'tip_moment': Walk(1e-4)}, True),
        ({'point_forces': (PointForce(0.1, Walk(1e-3)),)}, True),
        ({'current': Walk(0.1)}, True),
    ],
)
def test_what_geometry_does_not_tell_the_second_derivatives_by_is_learnt(
    more: dict[str, Any], is_learnt: bool
) -> None:
    model = rubber(Unknowns(Walk(1.0), tip_force=Walk(0.01), **more))
    stddev = np.append(STDDEV, 0.2 * model.state.prior_stddev()[7:])
    prior = Belief(np.append(PRIOR.mean, np.zeros(stddev.size - 7)), np.diag(stddev))
    true = prior.mean + stddev * np.resize([0.5, -0.8, 0.7, 0.3, 0.6, -0.9, 0.4], stddev.size)
    tip = TipPosition(Prediction(model, true, None).solved.tip, 1e-4)
    found = fit(prior, [tip], Prediction(model, prior.mean, None), None)
    assert found.curvature is not None
    is_given = np.array_equal(found.curvature.second, found.curvature.given)
    assert is_given is not is_learnt


def test_a_state_that_goes_on_as_it_went_is_foretold_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = arm_model(remembers=True)
    change = np.array([0.2, -0.3, 0.25, -0.1, 0.0, 0.0, 0.0, 0.0, 0.005, -0.01, 0.008])
    states = [np.append(np.full(4, 2.0), np.zeros(7)) + number * change for number in range(3)]
    tips = [TipPosition(Prediction(model, x, None).solved.tip, 1e-3) for x in states]
    prior = Belief(states[0], np.diag(np.append(np.full(8, 0.3), np.full(3, 0.01))))
    begun = fit(prior, [tips[1]], Prediction(model, states[0], None), None).curvature
    assert begun is not None
    at = Prediction(model, states[1], None)
    seen: list[FloatArray] = []

    def local(self: Posterior, *given: FloatArray) -> Local:
        seen.append(given[3])
        return original(self, *given)

    original = Posterior.local
    monkeypatch.setattr(Posterior, 'local', local)
    off = []
    for is_new in (True, False):
        seen.clear()
        fit(prior, [tips[2]], at, begun, is_new=is_new)
        foretold = tips[1].jacobian(at) @ change + 0.5 * seen[0] @ change @ change
        off.append(np.linalg.norm(tips[2].value - tips[1].value - foretold))
    assert off[1] < 0.6 * off[0], off
