"""When an arm was touched."""

from __future__ import annotations

import numpy as np
from estimation_arms import LIKELY, RUBBER, TENSIONS, rubber

from octo_arm_model import Solver
from octo_arm_model.estimation.filter import Filter
from octo_arm_model.estimation.measurements import Tensions, TipPosition
from octo_arm_model.estimation.unknowns import Unknowns, Walk
from octo_arm_model.experiment.estimates import GAP, Moment, find_touches, is_touched

UNKNOWNS = Unknowns(Walk(5.0), tip_force=LIKELY)


def touches(flags: list[bool], step: float = 0.1) -> list[tuple[float, float]]:
    tip, wrench, stddev = np.zeros(3), np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]), np.full(6, 0.01)
    found = find_touches([
        Moment(step * number, tip, tip, 0.3, wrench, stddev, 'tip', flag)
        for number, flag in enumerate(flags)
    ])  # fmt: skip
    assert all(one.force[2] == 0.1 and one.hypothesis == 'tip' for one in found)
    return [(round(one.start, 9), round(one.stop, 9)) for one in found]


def test_intervals_with_gaps() -> None:
    assert touches([]) == touches([False] * 9) == []
    assert touches([False, True, True, True, False]) == [(0.1, 0.3)]
    short = [*3 * [True], *[False] * round(GAP / 0.1 - 1), *3 * [True]]
    assert len(touches(short)) == 1
    longer = [*3 * [True], *[False] * round(GAP / 0.1 + 1), *3 * [True]]
    assert len(touches(longer)) == 2
    assert touches([False, True, False, False]) == []  # a single one is chance


def test_a_push_across_the_arm_is_a_touch_and_noise_is_not() -> None:
    for push, expected in ((0.0, False), (0.01, True)):
        shape = Solver(RUBBER, 'exact', 31).solve([TENSIONS], [0.0, 0.0, push, 0.0, 0.0, 0.0])
        given = [Tensions(TENSIONS, 0.01), TipPosition(shape.tip + 3e-4, 1e-3)]
        assert is_touched(Filter(rubber(UNKNOWNS)).add(0.0, given)) is expected


def test_what_nothing_was_learnt_of_is_no_touch() -> None:
    """A force along a straight arm keeps its prior, whatever its mean."""
    found = Filter(rubber(UNKNOWNS)).add(0.0, [Tensions(TENSIONS, 0.01)])
    assert not is_touched(found)
    found.mean[found.state.tip_force] = [1.0, 0.0, 0.0]
    assert not is_touched(found)
    assert not is_touched(Filter(rubber(Unknowns(Walk(5.0)))).add(0.0, [Tensions(TENSIONS, 0.01)]))
