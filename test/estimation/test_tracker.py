"""The loop of node and bag tool: stamps, order, counts, and what is thrown out."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from estimation_arms import LIKELY, RUBBER, TENSIONS, rubber

from octo_arm_model import Solver
from octo_arm_model.arm.errors import MeasurementError, SolveError
from octo_arm_model.estimation.filter import Filter
from octo_arm_model.estimation.measurements import Markers, Measurement, Tensions, TipPosition
from octo_arm_model.estimation.state.prediction import ArmModel
from octo_arm_model.estimation.state.unknowns import PointForce, Unknowns, Walk
from octo_arm_model.estimation.tracker import Tracker
from octo_arm_model.rod.backbone import Backbone

SECOND = 10**9
ORIGIN = 1_700_000_000 * SECOND
PUSH = np.array([0.0, 0.004, 0.006])
FORCE_AT_TIP = Unknowns(Walk(5.0, 0.5), tip_force=LIKELY)


def tip(push: np.ndarray = PUSH) -> np.ndarray:
    return Solver(RUBBER, 'exact', 31).solve([TENSIONS], np.append(push, np.zeros(3))).tip


def places() -> dict[str, ArmModel]:
    return {
        f'{s:g} m': rubber(Unknowns(Walk(5.0, 0.5), point_forces=(PointForce(s, LIKELY),)))
        for s in (0.1, 0.2)
    }


def test_it_is_the_filter_by_seconds_from_the_first_stamp() -> None:
    tracker, one = Tracker({'tip': rubber(FORCE_AT_TIP)}), Filter(rubber(FORCE_AT_TIP))
    for step in range(3):
        given = [Tensions(TENSIONS, 0.01), TipPosition(tip(), 1e-3)]
        found = tracker.add(ORIGIN + step * SECOND // 4, given)
        expected = one.add(0.25 * step, given)
        np.testing.assert_allclose(found.estimate.mean, expected.mean, rtol=0, atol=1e-12)
    assert (found.hypothesis, found.probabilities) == ('tip', {'tip': 1.0})
    assert found.estimate.time == 0.5
    kinds = tracker.consistency
    assert [kinds[name].accepted for name in ('tensions', 'tip position')] == [3, 3]
    assert kinds['tip position'].size == 9 and len(kinds['tip position'].recent) == 3


def test_late_ones_are_put_in_place_within_the_window_and_refused_beyond() -> None:
    in_order, late = (Tracker({'tip': rubber(FORCE_AT_TIP)}, window=0.3) for _ in range(2))
    messages = [
        (0, Tensions(TENSIONS, 0.01)), (1, TipPosition(tip(), 1e-3)),
        (2, Tensions(TENSIONS, 0.01)), (3, TipPosition(tip(), 1e-3)),
    ]  # fmt: skip
    for tracker, order in ((in_order, (0, 1, 2, 3)), (late, (0, 2, 3, 1))):
        for number in order:
            step, one = messages[number]
            found = tracker.add(ORIGIN + step * SECOND // 10, [one])
            assert [part.name for part in found.innovations] == [one.name]
    first, second = (one.add(ORIGIN + SECOND // 2, []).estimate for one in (in_order, late))
    np.testing.assert_allclose(first.mean, second.mean, rtol=0, atol=1e-6)
    with pytest.raises(MeasurementError, match='before the window'):
        late.add(ORIGIN + SECOND // 20, [Tensions(TENSIONS, 0.01)])
    assert (late.late, in_order.late) == (1, 0)
    for tracker in (late, in_order):
        assert [one.accepted for one in tracker.consistency.values()] == [2, 2]


def test_where_the_place_is_unknown_late_ones_are_put_in_place_too() -> None:
    tracker = Tracker(places(), window=1.0)
    tracker.add(ORIGIN, [Tensions(TENSIONS, 0.01)])
    newest = tracker.add(ORIGIN + SECOND, [Tensions(TENSIONS, 0.01)])
    found = tracker.add(ORIGIN + SECOND // 2, [TipPosition(tip(), 1e-3)])
    assert found.estimate.time == newest.estimate.time
    before, after = (np.trace(one.estimate.covariance) for one in (newest, found))
    assert after < before
    tracker.add(ORIGIN + 3 * SECOND, [])
    with pytest.raises(MeasurementError, match='before the window'):
        tracker.add(ORIGIN + SECOND // 2, [Tensions(TENSIONS, 0.01)])
    assert tracker.late == 1 and tracker.consistency['tensions'].accepted == 2


def test_the_place_of_a_force_is_found() -> None:
    true = rubber(Unknowns(Walk(1.0), point_forces=(PointForce(0.1, LIKELY),)))
    x = np.concatenate([TENSIONS, [0.0, 0.02, 0.01]])
    shape = true.solve(x, None)
    tracker = Tracker(places())
    at = np.array([5, 15, 25, 30])
    for step in range(4):
        given = [Tensions(TENSIONS, 0.01),
                 Markers(shape.s[at], shape.position[at], 5e-4)]  # fmt: skip
        found = tracker.add(ORIGIN + step * SECOND // 10, given)
    assert found.hypothesis == '0.1 m' and found.probabilities['0.1 m'] > 0.99
    np.testing.assert_allclose(found.estimate.point_forces[0], [0.0, 0.02, 0.01], atol=5e-3)


def test_a_sensor_that_lies_is_thrown_out_and_counted() -> None:
    # Three markers tell where the arm is; a tip ten standard deviations off does not fit them.
    tracker, shape = Tracker({'tip': rubber(FORCE_AT_TIP)}), Solver(RUBBER, 'exact', 31).solve(
        [TENSIONS], np.append(PUSH, np.zeros(3))
    )  # fmt: skip
    at = np.array([10, 20, 30])
    for step in range(6):
        stamp = ORIGIN + step * SECOND // 10
        markers = Markers(shape.s[at], shape.position[at], 5e-4)
        tracker.add(stamp, [Tensions(TENSIONS, 0.01), markers])
        wrong = step in (3, 4)
        lie = TipPosition(shape.tip + [0.0, 0.0, 0.02 if wrong else 0.0], 5e-4)
        found = tracker.add(stamp, [lie])
        assert found.innovations[0].is_accepted is not wrong
        force, covariance = found.estimate.tip_wrench[:3] - PUSH, found.estimate.covariance
        assert force @ np.linalg.solve(covariance[4:7, 4:7], force) < 16.3
    kind = tracker.consistency['tip position']
    assert (kind.accepted, kind.refused) == (4, 2)
    assert kind.refused_from == ORIGIN + 3 * SECOND // 10
    assert kind.refused_to == ORIGIN + 4 * SECOND // 10


CELL, PLACE, LIE = 0.01, 5e-4, 0.3  # noise [N], [m], and what a load cell shows too much [N]
LIAR = f'load cell {RUBBER.tendon_names[2]}'


def sensors(lie: float = 0.0) -> list[Measurement]:
    """What load cells, three markers and a camera that sees the tip measure of one shape."""
    shape = Solver(RUBBER, 'exact', 31).solve([TENSIONS], np.append(PUSH, np.zeros(3)))
    at = np.array([10, 20, 30])
    readings = TENSIONS + np.array([0.0, 0.0, lie, 0.0])
    markers = Markers(shape.s[at], shape.position[at], PLACE)
    return [Tensions(readings, CELL), markers, TipPosition(shape.tip, PLACE)]


def quick() -> Tracker:
    """Of an arm whose tensions may change by far more than what a load cell lies."""
    return Tracker({'tip': rubber(Unknowns(Walk(5.0, 5.0), tip_force=LIKELY))})


@pytest.mark.parametrize('order', [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_what_is_measured_at_one_time_is_judged_together_whichever_comes_first(
    order: tuple[int, ...],
) -> None:
    """Whether in one message or in several, and a load cell that lies is found in both."""
    together, apart = quick(), quick()
    for tracker in (together, apart):
        tracker.add(ORIGIN, sensors())
    for step in range(1, 5):
        stamp, given = ORIGIN + step * SECOND // 10, sensors(LIE if step in (2, 3) else 0.0)
        expected = together.add(stamp, given).estimate
        for number in order:
            found = apart.add(stamp, [given[number]]).estimate
        stddev = np.sqrt(np.diag(expected.covariance))
        # As exactly as either of them converges.
        assert (np.abs(found.mean - expected.mean) < 0.15 * stddev).all()
        np.testing.assert_allclose(
            np.sqrt(np.diag(found.covariance)), stddev, rtol=0.05, atol=1e-9
        )
        assert np.abs(found.tensions - TENSIONS).max() < 0.1 * LIE
    for tracker in (together, apart):
        counts = {name: (one.accepted, one.refused) for name, one in tracker.consistency.items()}
        assert counts.pop(LIAR) == (0, 2)
        # Of a load cell that lies for the first time and one sensor nobody knows which is right.
        assert sum(refused for _, refused in counts.values()) <= (tracker is apart)
        assert {sum(count) for count in counts.values()} == {5} and len(counts) == 3


def test_a_load_cell_that_lied_is_doubted_until_it_agrees() -> None:
    """By itself it is refused as long as it is off, however fast tensions may change."""
    own = quick()
    own.add(ORIGIN, sensors())
    own.add(ORIGIN + SECOND // 10, sensors(LIE))
    doubted = own.add(ORIGIN + 2 * SECOND // 10, sensors(LIE)[:1])
    assert [(one.name, one.is_accepted) for one in doubted.innovations] == [
        ('tensions', True), (LIAR, False)
    ]  # fmt: skip
    right = own.add(ORIGIN + 3 * SECOND // 10, sensors()[:1])
    assert [(one.name, one.is_accepted) for one in right.innovations] == [('tensions', True)]
    # It is believed again, as all are that contradict nobody.
    moved = own.add(ORIGIN + 4 * SECOND // 10, sensors(LIE)[:1])
    assert [(one.name, one.is_accepted) for one in moved.innovations] == [('tensions', True)]


def test_a_sensor_that_measures_twice_at_one_time_counts_twice() -> None:
    own = Tracker({'tip': rubber(Unknowns(Walk(1e4)))})
    for count in range(1, 6):
        found = own.add(ORIGIN, [Tensions(TENSIONS, 0.02)])
        variance = np.diag(found.estimate.covariance)[:4]
        np.testing.assert_allclose(variance, 0.02**2 / count, rtol=1e-6)


def test_a_failure_changes_nothing_but_the_counts() -> None:
    unbounded = Unknowns(Walk(1e4, 1e4), tip_force=LIKELY)
    tracker = Tracker({'tip': rubber(unbounded)})
    given = [Tensions(TENSIONS, 0.01), TipPosition(tip(), 1e-3)]
    tracker.add(ORIGIN, given)
    crushed = Tensions([3e3, 0.0, 0.0, 0.0], 0.1)  # no shape holds that
    with pytest.raises(SolveError):
        tracker.add(ORIGIN + SECOND, [crushed])
    with pytest.raises(MeasurementError, match='one for each tendon'):
        tracker.add(ORIGIN + SECOND, [Tensions([1.0], 0.1)])
    assert tracker.failed == 1 and tracker.consistency['tensions'].accepted == 1
    other = Tracker({'tip': rubber(unbounded)})
    other.add(ORIGIN, given)
    found, expected = (one.add(ORIGIN + SECOND // 5, given).estimate for one in (tracker, other))
    np.testing.assert_allclose(found.mean, expected.mean, rtol=0, atol=1e-12)


def test_it_pauses_before_every_solve_and_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    models, pauses, seen = places(), [0], [0]
    for model in models.values():
        follow = model.solver.follow

        def checked(*given: Any, follow: Callable[..., Backbone] = follow) -> Backbone:
            assert pauses[0] > seen[0]
            seen[0] = pauses[0]
            return follow(*given)

        monkeypatch.setattr(model.solver, 'follow', checked)

    def pause() -> None:
        pauses[0] += 1

    paused, plain = Tracker(models), Tracker(places())
    for step in range(2):
        given = [Tensions(TENSIONS, 0.01), TipPosition(tip(), 1e-3)]
        found = paused.add(ORIGIN + step * SECOND, given, pause)
        expected = plain.add(ORIGIN + step * SECOND, given)
        np.testing.assert_allclose(found.estimate.mean, expected.estimate.mean, rtol=1e-9)
    assert seen[0] > 2


def test_what_is_ended_in_a_pause_leaves_all_as_it_was() -> None:
    class Ended(BaseException):
        pass

    left = [3]

    def pause() -> None:
        left[0] -= 1
        if not left[0]:
            raise Ended

    one, other = (Tracker({'tip': rubber(FORCE_AT_TIP)}) for _ in range(2))
    for tracker in (one, other):
        tracker.add(ORIGIN, [Tensions(TENSIONS, 0.01)])
    with pytest.raises(Ended):
        one.add(ORIGIN + SECOND, [TipPosition(tip() + 0.02, 1e-3)], pause)
    given = [TipPosition(tip(), 1e-3)]
    found, expected = (tracker.add(ORIGIN + SECOND, given) for tracker in (one, other))
    np.testing.assert_allclose(found.estimate.mean, expected.estimate.mean, rtol=1e-9)


def test_of_nothing_accepted_the_mean_is_not_a_number() -> None:
    tracker = Tracker({'tip': rubber(FORCE_AT_TIP)})
    tracker.add(ORIGIN, [TipPosition([5.0, 0.0, 0.0], 1e-6)])
    assert math.isnan(tracker.consistency['tip position'].mean)
