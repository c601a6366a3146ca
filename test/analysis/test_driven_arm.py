"""Messages of tensions and displacements: history of friction, gaps and changes of the arm."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from differences import jacobian
from numpy.testing import assert_allclose

from octo_arm_model import Config, OctoArmError, Solver, Uncertainty, solve_displacements
from octo_arm_model.analysis.driven_arm import DrivenArm
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import displacements_of

HIGH, LOW = np.array([[1.0, 0.3, 0.0, 0.0]]), np.array([[0.4, 0.1, 0.0, 0.0]])
SECOND = 10**9
Follow = Callable[..., Backbone]


@pytest.fixture(scope='module')
def frictional(prototype):
    """Return the prototype with friction."""
    return dataclasses.replace(
        prototype, model='exact', arm=dataclasses.replace(prototype.arm, friction=4 * (0.3,))
    )


def solver_and_follow(config: Config, seconds: float = 0.0) -> tuple[Solver, Follow, DrivenArm]:
    """Return a solver of ``config``, a function that answers a message, and the driven arm."""
    config = dataclasses.replace(config, model='exact', friction_memory=seconds)
    solver, arm = config.solver(), DrivenArm()

    def follow(time_ns: int, **values: Any) -> Backbone:
        return arm.answer(solver, config, None, time_ns, **values).backbone

    return solver, follow, arm


@pytest.mark.parametrize(
    ('seconds', 'gap', 'forgets'),
    [(2.0, 2.001, True), (2.0, 2.0, False), (0.0, 1e6, False), (1e12, 1e6, False)],
)
def test_gap_resets_the_history(frictional, seconds, gap, forgets):
    solver, follow, arm = solver_and_follow(frictional, seconds)
    loaded = follow(SECOND, tensions=HIGH)
    shape = follow(SECOND + round(gap * SECOND), tensions=LOW)
    expected = solver.solve(LOW) if forgets else solver.follow(LOW, loaded)
    assert_allclose(shape.position, expected.position, rtol=0.0, atol=1e-12)
    assert arm.forgotten == forgets


@pytest.mark.parametrize('seconds', [1.5, 50.0])
def test_a_refused_message_leaves_no_trace(frictional, seconds):
    tips = []
    for refused in ((), (1e4 * HIGH,)):
        _, follow, arm = solver_and_follow(frictional, 2.0)
        follow(SECOND, tensions=HIGH)
        follow(2 * SECOND, tensions=LOW)
        for tensions in refused:  # before the newest stamp, and after a gap
            with pytest.raises(OctoArmError):
                follow(round(seconds * SECOND), tensions=tensions)
        tips.append(follow(3 * SECOND, tensions=LOW).tip)
        assert arm.forgotten == 0
    assert_allclose(*tips, rtol=0.0, atol=1e-12)


def test_late_encoders_do_not_reset_the_history(frictional):
    solver, follow, arm = solver_and_follow(frictional, 2.0)
    name, millisecond = frictional.arm.tendon_names[0], SECOND // 1000
    loaded = follow(SECOND, tensions=HIGH)
    displacement = float(displacements_of(solver, loaded).ravel()[0])
    for cycle in range(1, 4):
        follow(SECOND + (10 * cycle - 2) * millisecond, displacements={name: displacement})
        shape = follow(SECOND + 10 * cycle * millisecond, tensions=HIGH)
    assert_allclose(shape.position, loaded.position, rtol=0.0, atol=1e-6)
    # The other source continues, so that this is not a gap.
    for tenth in range(5, 40):
        follow(SECOND + tenth * SECOND // 10, tensions=LOW)
    released = follow(SECOND + 4 * SECOND, displacements={})
    assert_allclose(released.position, solver.follow(LOW, loaded).position, rtol=0.0, atol=1e-6)
    assert arm.forgotten == 0
    # A jump back of one source resets the history.
    reset = follow(3 * SECOND, tensions=LOW)
    assert_allclose(reset.position, solver.solve(LOW).position, rtol=0.0, atol=1e-9)


def test_gap_resets_the_history_of_displacements(frictional):
    stretching = dataclasses.replace(
        frictional, arm=dataclasses.replace(frictional.arm, axial_stiffness=(300.0,))
    )
    name = frictional.arm.tendon_names[0]
    for gap, remembers in ((SECOND, True), (3 * SECOND, False)):
        solver, follow, arm = solver_and_follow(stretching, 2.0)
        follow(0, displacements={name: 0.01})
        shape = follow(gap, displacements={name: 0.006})
        fresh = solve_displacements(solver, {name: 0.006}).backbone
        loaded = solve_displacements(solver, {name: 0.01})
        released = solve_displacements(solver, {name: 0.006}, start=loaded).backbone
        expected = released if remembers else fresh
        assert_allclose(shape.tensions, expected.tensions, rtol=1e-7, atol=1e-9)
        assert arm.forgotten == (not remembers)
        # After paying out, friction makes the tension much lower.
        assert released.tensions[0, 0] < 0.9 * fresh.tensions[0, 0]


def test_tip_covariance_includes_encoder_accuracy(prototype):
    config = dataclasses.replace(
        prototype, model='exact', uncertainty=Uncertainty(displacement=2e-4)
    )
    solver, arm = config.solver(), DrivenArm()
    names, lengths = prototype.arm.tendon_names[:2], np.array([0.010, 0.004])

    def tip(x):
        return solve_displacements(solver, dict(zip(names, x.tolist()))).backbone.tip

    displacements = dict(zip(names, lengths.tolist()))
    answer = arm.answer(solver, config, None, 0, displacements=displacements)
    deviations = 2e-4 * jacobian(tip, lengths, 1e-5)
    expected = deviations @ deviations.T
    assert_allclose(
        answer.covariance[:3, :3], expected, rtol=0.0, atol=1e-6 * np.abs(expected).max()
    )
    # It has no effect on given tensions.
    answer = arm.answer(solver, config, None, 1, tensions=HIGH, displacements={})
    assert not answer.covariance.any()


def test_values_of_removed_tendons_are_dropped(prototype):
    config = dataclasses.replace(prototype, model='exact')
    first, *rest = config.arm.tendon_names
    for names, note in (
        ((first, 'a', 'b', 'c'), 'tensions dropped: this arm has other tendons'),
        (('d', *rest), f'displacements dropped: this arm has no tendon {first}'),
    ):
        driven = DrivenArm()
        driven.answer(config.solver(), config, None, 0, tensions=HIGH)
        driven.answer(config.solver(), config, None, 1, displacements={first: 0.01})
        arm = dataclasses.replace(config.arm, tendon_names=names)
        other = dataclasses.replace(config, arm=arm)
        assert driven.change_config(config, other) == [note]
        assert driven.tensions is None
