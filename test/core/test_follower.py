"""Sequences of tensions with friction: what is remembered, and when it is forgotten."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from octo_arm_model import Config, Solver
from octo_arm_model.core.follower import Follower

HIGH, LOW = [[1.0, 0.3, 0.0, 0.0]], [[0.4, 0.1, 0.0, 0.0]]
SECOND = 10**9


@pytest.fixture(scope='module')
def solver(prototype: Config) -> Solver:
    return Solver(dataclasses.replace(prototype.arm, friction=4 * (0.3,)), 'exact')


def test_a_sequence_goes_on_from_the_last_shape(solver: Solver) -> None:
    follower = Follower(solver, 2.0)
    pulled = follower.follow(HIGH, 5 * SECOND)
    np.testing.assert_array_equal(pulled.position, solver.solve(HIGH).position)
    released = follower.follow(LOW, 7 * SECOND)
    expected = solver.follow(LOW, pulled)
    np.testing.assert_array_equal(released.position, expected.position)
    assert np.linalg.norm(released.tip - solver.solve(LOW).tip) > 1e-3
    assert follower.memory.forgotten == 0


@pytest.mark.parametrize(
    ('memory', 'gap', 'forgets'),
    [(2.0, 2.001, True), (2.0, 2.0, False), (0.0, 1e6, False), (1e12, 1e6, False)],
)
def test_after_a_gap_the_history_is_forgotten(
    solver: Solver, memory: float, gap: float, forgets: bool
) -> None:
    follower = Follower(solver, memory)
    pulled = follower.follow(HIGH, SECOND)
    found = follower.follow(LOW, SECOND + round(gap * SECOND))
    expected = solver.solve(LOW) if forgets else solver.follow(LOW, pulled)
    np.testing.assert_array_equal(found.position, expected.position)
    assert follower.memory.forgotten == forgets


def test_where_time_starts_over_so_does_the_arm(solver: Solver) -> None:
    follower = Follower(solver, 0.0)
    follower.follow(HIGH, 10 * SECOND)
    found = follower.follow(LOW, 9 * SECOND)
    np.testing.assert_array_equal(found.position, solver.solve(LOW).position)


def test_without_friction_there_is_no_history(prototype: Config) -> None:
    follower = Follower(Solver(prototype.arm, 'exact'), 1.0)
    follower.follow(HIGH, 0)
    follower.follow(LOW, 10 * SECOND)
    assert follower.memory.forgotten == 0
