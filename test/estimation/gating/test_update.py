"""Which measurements are used: those that lie, are lost and come back, of every kind."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from checkout import ROOT
from estimation_arms import LIKELY, TENSIONS, WEIGHT, rubber
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.estimation.beliefs.belief import Belief
from octo_arm_model.estimation.beliefs.fit import Fit, fit
from octo_arm_model.estimation.filter import Filter
from octo_arm_model.estimation.gating import judgement, taken, update
from octo_arm_model.estimation.measurements import (
    Curvatures,
    Markers,
    Measurement,
    TendonDisplacements,
    Tensions,
    TipPose,
    TipPosition,
)
from octo_arm_model.estimation.measurements.base_wrench import BaseWrench
from octo_arm_model.estimation.state.prediction import Prediction
from octo_arm_model.estimation.state.unknowns import Unknowns, Walk

sys.path.insert(0, str(ROOT / 'benchmarks'))

from tip_force_scenario import arm_model, simulated

MODEL = rubber(Unknowns(Walk(10.0, 5.0), tip_force=LIKELY), loads=WEIGHT)
TRUTH = Prediction(MODEL, np.append(TENSIONS, [0.004, -0.003, 0.006]), None)
PLACES = [0.05, 0.12]


def _exact(one: Measurement) -> np.ndarray:
    """What a measurement of zero would have been."""
    return -one.innovation(TRUTH)


def tip_pose(lie: float) -> TipPose:
    turned = Rotation.from_rotvec([0.0, 0.01 * lie, 0.0])
    quaternion = (turned * Rotation.from_quat(TRUTH.solved.quaternion[-1])).as_quat()
    return TipPose(TRUTH.solved.tip, quaternion, [1e-3] * 3 + [0.01] * 3)


# All with an error of so many standard deviations.
KINDS: dict[str, Callable[[float], Measurement]] = {
    'tensions': lambda lie: Tensions(TENSIONS + [0.02 * lie, 0.0, 0.0, 0.0], 0.02),
    'tendon displacements': lambda lie: TendonDisplacements(
        _exact(TendonDisplacements(np.zeros(4), 1.0)) + [2e-4 * lie, 0.0, 0.0, 0.0], 2e-4
    ),
    'tip position': lambda lie: TipPosition(TRUTH.solved.tip + [0.0, 1e-3 * lie, 0.0], 1e-3),
    'tip pose': tip_pose,
    'markers': lambda lie: Markers(
        PLACES, _exact(Markers(PLACES, np.zeros((2, 3)), 1.0)) + 1e-3 * lie * np.eye(6)[1], 1e-3
    ),
    'curvatures': lambda lie: Curvatures(
        PLACES, _exact(Curvatures(PLACES, np.zeros((2, 2)), 1.0)) + 0.1 * lie * np.eye(4)[0], 0.1
    ),
    'base wrench': lambda lie: BaseWrench(
        _exact(BaseWrench(np.zeros(6), 1.0)) + 1e-3 * lie * np.eye(6)[1], 1e-3
    ),
}


FIRST, *OTHERS = MODEL.arm.tendon_names


@pytest.mark.endurance
@pytest.mark.parametrize('liar', KINDS)
def test_one_that_lies_is_refused_and_named(liar: str) -> None:
    own = Filter(MODEL)
    found = own.add(0.0, [make(30.0 * (name == liar)) for name, make in KINDS.items()])
    # Of load cells it is the one that lies.
    name = f'load cell {FIRST}' if liar == 'tensions' else liar
    assert own.refused == {name: 1}
    assert [one.name for one in found.innovations if not one.is_accepted] == [name]
    stddev = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.mean - TRUTH.x) < stddev).all()


@pytest.mark.parametrize('lost', KINDS)
def test_one_that_is_lost_is_welcome_when_it_comes_back(lost: str) -> None:
    own = Filter(MODEL)
    for time, is_lost in ((0.0, False), (0.1, True), (60.0, True), (60.1, False)):
        made = [make(0.0) for name, make in KINDS.items() if not (is_lost and name == lost)]
        found = own.add(time, made)
        stddev = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.mean - TRUTH.x) < stddev).all()
    assert not own.refused


@pytest.mark.parametrize('others', [[], ['markers']])
def test_what_was_refused_is_looked_into_where_nothing_else_tells_of_the_shape(
    others: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a wrong shape what is right seems far off, as where the arm has left its branch."""
    monkeypatch.setattr(judgement, 'far_off', lambda prior, doubted, at, gate: {
        id(one): np.inf for one in doubted
    })  # fmt: skip
    own = Filter(MODEL)
    for step, lie in enumerate((0.0, 100.0, 0.0)):
        names = ['tensions', *others]
        own.add(0.1 * step, [*(KINDS[name](0.0) for name in names), KINDS['tip position'](lie)])
        monkeypatch.setattr(update, 'nearby', lambda *_: None)  # nothing near the last state
    assert own.refused == {'tip position': 1 + len(others)}


def test_what_is_refused_may_be_more_exact_than_rounding() -> None:
    """The covariance of its innovation is then singular but for its square root."""
    own, places = Filter(MODEL), np.linspace(0.02, 0.2, 10)
    own.add(0.0, [make(0.0) for make in KINDS.values()])
    at = _exact(Markers(places, np.zeros((10, 3)), 1.0)) + 0.05 * np.resize([1.0, -1.0], 30)
    found = own.add(0.1, [KINDS['tensions'](0.0), Markers(places, at, 1e-13)])
    assert own.refused == {'markers': 1}
    assert np.isfinite(found.covariance).all()


@pytest.mark.parametrize('number', range(4))
def test_the_load_cell_that_lies_is_thrown_out_by_tip_and_markers(number: int) -> None:
    own, lie = Filter(MODEL), np.zeros(4)
    lie[number] = 0.8
    for step, wrong in enumerate((np.zeros(4), lie, lie, np.zeros(4))):
        made = [Tensions(TENSIONS + wrong, 0.02), KINDS['tip pose'](0.0), KINDS['markers'](0.0)]
        found = own.add(0.1 * step, made)
        stddev = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.mean - TRUTH.x) < stddev).all()
        assert found.innovations[0].value.size == (3 if wrong.any() else 4)
    assert own.refused == {f'load cell {MODEL.arm.tendon_names[number]}': 2}


def test_a_single_sensor_of_the_shape_contradicts_no_load_cell() -> None:
    """A tip that lies is refused, though a tension and a force might explain it."""
    own = Filter(MODEL)
    own.add(0.0, [Tensions(TENSIONS, 0.02), KINDS['tip position'](0.0)])
    own.add(0.01, [Tensions(TENSIONS, 0.02), KINDS['tip position'](60.0)])
    assert own.refused == {'tip position': 1}


def test_a_load_cell_that_jumps_is_refused_without_other_sensors() -> None:
    model = rubber(Unknowns(Walk(10.0, 0.1)))
    own = Filter(model)
    own.add(0.0, [Tensions(TENSIONS, 0.02)])
    found = own.add(0.1, [Tensions(TENSIONS + [0.0, 0.0, 2.0, 0.0], 0.02)])
    rest, jumped = found.innovations
    assert rest.is_accepted and rest.value.size == 3
    assert (jumped.name, jumped.is_accepted) == (f'load cell {OTHERS[1]}', False)
    np.testing.assert_allclose(found.tensions, TENSIONS, atol=0.1)
    # Two of them are a motion, or lie both: nobody knows which.
    found = own.add(0.2, [Tensions(TENSIONS + [0.0, 2.0, 2.0, 0.0], 0.02)])
    assert [one.name for one in found.innovations if not one.is_accepted] == ['tensions']


def test_no_fit_is_made_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a tip that nothing near explains: it is looked for near the last state, then further."""
    own, fits = Filter(MODEL), []
    own.add(0.0, [Tensions(TENSIONS, 0.02), KINDS['tip position'](0.0)])

    def counted(
        prior: Belief, measurements: list[Measurement], start: Prediction, *args: Any, **how: Any
    ) -> Fit:
        fits.append(([*prior.mean], [id(one) for one in measurements], id(start), how))
        return fit(prior, measurements, start, *args, **how)

    monkeypatch.setattr(taken, 'fit', counted)
    own.add(0.01, [Tensions(TENSIONS, 0.02), KINDS['tip position'](60.0)])
    own.add(
        0.02, [Tensions(TENSIONS, 0.02), *(KINDS[name](60.0) for name in ('tip pose', 'markers'))]
    )
    assert own.refused['tip position'] == 1 and len(fits) > 2
    assert all(one not in fits[:number] for number, one in enumerate(fits))


def test_without_a_past_a_right_tip_is_never_refused() -> None:
    # A force of the prior's size moves it by hundreds of times what it is measured to.
    model = arm_model(remembers=False, stations=21)
    for measured, _ in simulated(121, 2026)[::15]:
        found = Filter(model).add(0.0, measured)
        assert all(one.is_accepted for one in found.innovations)


@pytest.mark.parametrize(('walk', 'noise'), [(Walk(10.0, 5.0), 1e-20), (Walk(1e29, 1e29), 0.02)])
@pytest.mark.parametrize('others', [[], [TipPosition(TRUTH.solved.tip, 1e-3)]])
def test_what_numbers_do_not_resolve_is_refused_and_says_of_what(
    walk: Walk, noise: float, others: list[Measurement]
) -> None:
    own = Filter(rubber(Unknowns(walk, tip_force=LIKELY)))
    with pytest.raises(SolveError, match=f'not finite.*tensions to {noise:g}'):
        own.add(0.0, [Tensions(TENSIONS, noise), *others])


def test_a_sensor_that_two_contradict_is_refused_however_exact_they_are() -> None:
    """As variances such noise is lost beside what was known before: the covariance is singular."""
    tip, turned = TRUTH.solved.tip, TRUTH.solved.quaternion[-1]
    own = Filter(MODEL)
    for lie in (0.0, 1e-3, 2e-3):
        position = TipPosition(tip + [0.0, lie, 0.0], 1e-9)
        own.add(100.0 * lie, [Tensions(TENSIONS, 0.02), position, TipPose(tip, turned, 1e-9)])
        used = [one.is_accepted for one in own.innovations]
        assert used == [True, lie == 0.0, True]
        assert np.abs(own.last.updated.shape.tip - tip).max() < 1e-12


@pytest.mark.parametrize('noise', [1e-12, 1e-20])
def test_a_search_that_takes_the_modulus_beyond_numbers_is_no_crash(noise: float) -> None:
    """For a pose that is exact, it says, and a little off it tries an E beyond all numbers."""
    own = Filter(rubber(Unknowns(Walk(1.0, 0.5), tip_force=LIKELY, log_modulus=Walk(0.3))))
    own.add(0.0, [Tensions(TENSIONS, 0.02)])
    shape = own.last.updated.shape
    pose = TipPose(shape.tip + [0.0, 1e-2, 0.0], shape.quaternion[-1], noise)
    with contextlib.suppress(SolveError):
        own.add(0.1, [Tensions(TENSIONS, 0.02), pose])
    assert np.isfinite(own.last.updated.belief.root).all()


@pytest.mark.parametrize('log', [-1e3, 80.0, 1e3, np.nan])
def test_an_arm_of_an_impossible_modulus_has_no_shape(log: float) -> None:
    model = rubber(Unknowns(Walk(1.0, 0.5), log_modulus=Walk(0.3)))
    with pytest.raises(SolveError, match='E is exp'):
        Prediction(model, np.append(TENSIONS, log), None).solved  # noqa: B018
