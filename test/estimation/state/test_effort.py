"""How much one update may ask of the solver."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_arms import LIKELY, TENSIONS, rubber

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.estimation.filter import Filter
from octo_arm_model.estimation.gating import update
from octo_arm_model.estimation.measurements import Tensions, TipPosition
from octo_arm_model.estimation.state.prediction import Prediction
from octo_arm_model.estimation.state.unknowns import Unknowns, Walk

MODEL = rubber(Unknowns(Walk(10.0, 5.0), tip_force=LIKELY))
TRUTH = Prediction(MODEL, np.append(TENSIONS, [0.004, -0.003, 0.006]), None)


def test_shapes_are_solved_until_the_iterations_are_spent() -> None:
    x = TRUTH.x.copy()
    with MODEL.within(20) as effort:
        with pytest.raises(SolveError, match='within 20 iterations'):
            for _ in range(100):
                x[0] += 0.01
                MODEL.solve(x, TRUTH.solved)
        with pytest.raises(SolveError, match='within 20 iterations'):
            MODEL.derivatives(TRUTH.x, TRUTH.solved)
        with pytest.raises(SolveError, match='within 20 iterations'):
            effort.check()
    assert MODEL.solve(TRUTH.x, None).iterations > 0


def test_an_update_that_takes_too_much_leaves_a_filter_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cells, tip = Tensions(TENSIONS, 0.01), TipPosition(TRUTH.solved.tip, 1e-3)
    own = Filter(MODEL)
    before = own.add(0.0, [cells, tip])
    with monkeypatch.context() as patch:
        patch.setattr(update, 'ITERATIONS', 10)
        with pytest.raises(SolveError, match='within 10 iterations'):
            own.add(1.0, [cells, TipPosition(tip.value + [0.0, 0.05, 0.0], 1e-3)])
    assert own.last is not None
    assert own.last.time == 0.0
    after = own.add(1e-9, [])
    np.testing.assert_allclose(after.mean, before.mean, atol=1e-6)


def test_what_is_left_of_several_updates_bounds_each() -> None:
    with MODEL.within(10), MODEL.within(1000) as inner:
        MODEL.solve(TRUTH.x, None)
        inner.take(20)
        with pytest.raises(SolveError, match='within 10 iterations'):
            MODEL.solve(TRUTH.x, None)
    assert MODEL.solve(TRUTH.x, None).iterations > 0
