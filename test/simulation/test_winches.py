"""Winches: lag, rate limit, floor and force limit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import commands, tensions, times

from octo_arm_model import ArmDefinitionError
from octo_arm_model.simulation.winches import SimulatedWinches, Winches


@given(tensions, times, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20))
def test_lag_is_the_exponential_whatever_the_steps(command, lag, parts) -> None:
    winches = SimulatedWinches(Winches(lag=lag), 3)
    elapsed = 0.0
    for part in parts:
        elapsed += part * lag
        tension = winches.step(command, part * lag)
        expected = command * -np.expm1(-elapsed / lag)
        np.testing.assert_allclose(tension, expected, rtol=1e-12, atol=1e-12)


@given(commands, st.floats(1e-9, 1e9), st.floats(1e-3, 1e6))
def test_lag_is_stable_and_never_overshoots_however_long_a_step(given_commands, lag, dt) -> None:
    winches = SimulatedWinches(Winches(lag=lag), 3)
    before = np.zeros(3)
    for command in given_commands:
        tension = winches.step(command, dt)
        assert (tension >= np.minimum(before, command) * (1.0 - 1e-12)).all()
        assert (tension <= np.maximum(before, command) * (1.0 + 1e-12)).all()
        before = tension


@given(commands, st.floats(0.1, 100.0), st.floats(1e-3, 1.0), st.floats(0.0, 1.0))
def test_tension_never_changes_faster_than_the_rate_limit(
    given_commands, rate_limit, dt, lag
) -> None:
    winches = SimulatedWinches(Winches(rate_limit=rate_limit, lag=lag), 3)
    before = np.zeros(3)
    for command in given_commands:
        tension = winches.step(command, dt)
        assert (np.abs(tension - before) <= rate_limit * dt * (1.0 + 1e-9) + 1e-12).all()
        before = tension


def test_rate_limit_is_reached_and_ends_at_the_command() -> None:
    winches = SimulatedWinches(Winches(rate_limit=2.0), 1)
    ramp = [winches.step(np.array([1.0]), 0.125)[0] for _ in range(6)]
    assert ramp == [0.25, 0.5, 0.75, 1.0, 1.0, 1.0]
    assert winches.step(np.zeros(1), 0.125) == 0.75


@given(commands, st.floats(0.0, 5.0), st.floats(5.0, 20.0))
def test_floor_and_limit_bound_the_tension(given_commands, floor, limit) -> None:
    winches = SimulatedWinches(Winches(slack_floor=floor, force_limit=limit), 3)
    for command in given_commands:
        np.testing.assert_array_equal(winches.step(command, 0.1), np.clip(command, floor, limit))


def test_the_force_limit_comes_before_the_rate_limit_and_that_before_the_lag() -> None:
    winches = SimulatedWinches(Winches(force_limit=3.0, rate_limit=20.0, lag=0.1), 1)
    # The set point is at its limit of 3 N after two steps, not on its way to 100 N.
    tension, set_point = 0.0, 0.0
    for _ in range(5):
        set_point = min(3.0, set_point + 2.0)
        tension = set_point + np.exp(-1.0) * (tension - set_point)
        assert winches.step(np.array([100.0]), 0.1) == pytest.approx(tension, rel=1e-12)
    assert winches.step(np.zeros(1), 0.1) < tension  # no winding down from beyond the limit


def test_a_force_limit_below_the_floor_is_refused() -> None:
    with pytest.raises(ArmDefinitionError, match=r'at least winches\.slack_floor, 2\.0'):
        Winches(slack_floor=2.0, force_limit=1.0)
