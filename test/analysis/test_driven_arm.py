"""Messages of tensions and displacements in turn: what is known, remembered and forgotten."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from differences import jacobian
from numpy.testing import assert_allclose

from octo_arm_model import Config, Solver, Uncertainty, solve_displacements
from octo_arm_model.analysis.driven_arm import DrivenArm
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import displacements_of

HIGH, LOW = np.array([[1.0, 0.3, 0.0, 0.0]]), np.array([[0.4, 0.1, 0.0, 0.0]])
SECOND = 10**9
Follow = Callable[..., Backbone]


@pytest.fixture(scope='module')
def rubbing(prototype):
    """The prototype with friction."""
    return dataclasses.replace(
        prototype, model='exact', arm=dataclasses.replace(prototype.arm, friction=4 * (0.3,))
    )


def following(config: Config, seconds: float = 0.0) -> tuple[Solver, Follow, DrivenArm]:
    """A solver of ``config``, what answers it message by message, and the arm that is driven."""
    config = dataclasses.replace(config, model='exact', friction_memory=seconds)
    solver, winding = config.solver(), DrivenArm()

    def follow(time_ns: int, **given: Any) -> Backbone:
        return winding.answer(solver, config, None, time_ns, **given).backbone

    return solver, follow, winding


@pytest.mark.parametrize(
    ('seconds', 'gap', 'forgets'),
    [(2.0, 2.001, True), (2.0, 2.0, False), (0.0, 1e6, False), (1e12, 1e6, False)],
)
def test_after_a_gap_the_history_is_forgotten(rubbing, seconds, gap, forgets):
    solver, follow, arm = following(rubbing, seconds)
    pulled = follow(SECOND, tensions=HIGH)
    found = follow(SECOND + round(gap * SECOND), tensions=LOW)
    expected = solver.solve(LOW) if forgets else solver.follow(LOW, pulled)
    assert_allclose(found.position, expected.position, rtol=0.0, atol=1e-12)
    assert arm.forgotten == forgets


def test_encoders_whose_stamps_come_behind_those_of_load_cells_start_nothing_over(rubbing):
    """Each of two sources has its order; 2 ms between them are neither a return nor a gap."""
    solver, follow, arm = following(rubbing, 2.0)
    driven, millisecond = rubbing.arm.tendon_names[0], SECOND // 1000
    pulled = follow(SECOND, tensions=HIGH)
    held = float(displacements_of(solver, pulled).ravel()[0])
    for cycle in range(1, 4):
        follow(SECOND + (10 * cycle - 2) * millisecond, displacements={driven: held})
        found = follow(SECOND + 10 * cycle * millisecond, tensions=HIGH)
    assert_allclose(found.position, pulled.position, rtol=0.0, atol=1e-6)
    # Only one source goes silent: that is no gap.
    for tenth in range(5, 40):
        follow(SECOND + tenth * SECOND // 10, tensions=LOW)
    released = follow(SECOND + 4 * SECOND, displacements={})
    assert_allclose(released.position, solver.follow(LOW, pulled).position, rtol=0.0, atol=1e-6)
    assert arm.forgotten == 0
    # Where either goes back by itself, all begins anew.
    anew = follow(3 * SECOND, tensions=LOW)
    assert_allclose(anew.position, solver.solve(LOW).position, rtol=0.0, atol=1e-9)


def test_lengths_have_a_history_that_a_gap_ends(rubbing):
    stretching = dataclasses.replace(
        rubbing, arm=dataclasses.replace(rubbing.arm, axial_stiffness=(300.0,))
    )
    name = rubbing.arm.tendon_names[0]
    for gap, remembers in ((SECOND, True), (3 * SECOND, False)):
        solver, follow, arm = following(stretching, 2.0)
        follow(0, displacements={name: 0.01})
        found = follow(gap, displacements={name: 0.006})
        fresh = solve_displacements(solver, {name: 0.006}).backbone
        pulled = solve_displacements(solver, {name: 0.01})
        released = solve_displacements(solver, {name: 0.006}, start=pulled).backbone
        expected = released if remembers else fresh
        assert_allclose(found.tensions, expected.tensions, rtol=1e-7, atol=1e-9)
        assert arm.forgotten == (not remembers)
        # Let out by length the tendon holds far less.
        assert released.tensions[0, 0] < 0.9 * fresh.tensions[0, 0]


def test_the_accuracy_of_encoders_is_in_the_covariance_of_the_tip(prototype):
    config = dataclasses.replace(
        prototype, model='exact', uncertainty=Uncertainty(displacement=2e-4)
    )
    solver, winding = config.solver(), DrivenArm()
    names, lengths = prototype.arm.tendon_names[:2], np.array([0.010, 0.004])

    def tip(x):
        return solve_displacements(solver, dict(zip(names, x.tolist()))).backbone.tip

    given = dict(zip(names, lengths.tolist()))
    found = winding.answer(solver, config, None, 0, displacements=given)
    moved = 2e-4 * jacobian(tip, lengths, 1e-5)
    expected = moved @ moved.T
    assert_allclose(
        found.covariance[:3, :3], expected, rtol=0.0, atol=1e-6 * np.abs(expected).max()
    )
    # Of tensions it says nothing.
    found = winding.answer(solver, config, None, 1, tensions=HIGH, displacements={})
    assert not found.covariance.any()


def test_another_balance_has_another_history_and_the_same_tensions(rubbing):
    winding = DrivenArm()
    first = rubbing.arm.tendon_names[0]
    winding.answer(rubbing.solver(), rubbing, None, 0, tensions=HIGH)
    now = dataclasses.replace(rubbing, arm=dataclasses.replace(rubbing.arm, friction=4 * (0.2,)))
    said = winding.change_config(rubbing, now)
    assert said == ['friction history forgotten: arm, model, base, loads or stations have changed']
    found = winding.answer(now.solver(), now, None, 1, displacements={first: 0.01}).backbone
    wound = solve_displacements(
        now.solver(), {first: 0.01}, dict(zip(now.arm.tendon_names[1:], HIGH[0, 1:].tolist()))
    )
    assert_allclose(found.position, wound.backbone.position, rtol=0.0, atol=1e-9)


def test_tensions_of_other_tendons_are_dropped(prototype):
    config = dataclasses.replace(prototype, model='exact')
    first, *rest = config.arm.tendon_names
    for names, said in (
        ((first, 'a', 'b', 'c'), 'tensions dropped: this arm has other tendons'),
        (('d', *rest), f'displacements dropped: this arm has no tendon {first}'),
    ):
        winding = DrivenArm()
        winding.answer(config.solver(), config, None, 0, tensions=HIGH)
        winding.answer(config.solver(), config, None, 1, displacements={first: 0.01})
        arm = dataclasses.replace(config.arm, tendon_names=names)
        other = dataclasses.replace(config, arm=arm)
        assert winding.change_config(config, other) == [said]
        assert winding.tensions is None
