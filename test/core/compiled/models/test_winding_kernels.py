"""Lengths of tendons in machine code, and the tensions that hold them."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from helical_arm import helical_arm

from octo_arm_model import Config, Solver, Wound, displacements_of, solve_displacements
from octo_arm_model.analysis.winding import newton as winding
from octo_arm_model.analysis.winding.complementarity import complementary_step
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.core.compiled.models.tension_step_kernels import find_step, solve_some
from octo_arm_model.core.compiled.numba_build import is_available

pytestmark = pytest.mark.skipif(not is_available(), reason='numba is not installed')
PULL = np.array([[2.0, 0.5, 0.0, 0.0]])


@pytest.mark.parametrize('model', ['renda2012', 'closed_form', 'exact'])
def test_lengths_are_those_of_numpy(prototype: Config, model: str) -> None:
    for material in ('linear', 'neo_hookean'):
        machine, plain = (
            Solver(prototype.arm, model, material=material, compiled=compiled)
            for compiled in (True, False)
        )
        backbone = plain.solve(PULL)
        np.testing.assert_allclose(
            machine.tendon_lengths(backbone), plain.tendon_lengths(backbone), rtol=1e-12
        )
        np.testing.assert_allclose(machine.rest_lengths, plain.rest_lengths, rtol=1e-12)


@pytest.mark.parametrize('wrench', [None, (0.005, 0.0, -0.003, 0.0, 0.0, 0.0)])
@pytest.mark.parametrize('stiffness', [(), (800.0,)])
def test_tensions_that_hold_lengths_are_found_without_numpy(
    prototype: Config, stiffness: tuple[float, ...], wrench: tuple[float, ...] | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    arm = dataclasses.replace(prototype.arm, axial_stiffness=stiffness)
    solver = Solver(arm, 'exact', compiled=True)

    def lengths(tensions: np.ndarray) -> dict[str, float]:
        found = displacements_of(solver, solver.solve(tensions, wrench)).ravel()
        # Slack tendons are longer than their paths.
        found[tensions.ravel() == 0.0] -= 1e-3
        return dict(zip(arm.tendon_names, found.tolist()))

    last = solve_displacements(solver, lengths(PULL), tip_wrench=wrench)
    monkeypatch.setattr(winding.Winding, 'solve', None)
    for number in range(1, 6):
        tensions = PULL * (1.0 + 0.01 * number) + [[0.0, 0.01 * number, 0.0, 0.0]]
        last = solve_displacements(solver, lengths(tensions), start=last, tip_wrench=wrench)
        np.testing.assert_allclose(last.backbone.tensions, tensions, atol=1e-9 * 2.0)
        assert last.slack == arm.tendon_names[2:]
        expected = solver.solve(tensions, wrench)
        np.testing.assert_allclose(last.backbone.position, expected.position, atol=1e-10)


def test_tendons_that_hold_each_other_are_followed_in_machine_code(
    table4: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Of four parallel tendons two opposite lengths together are the other two: at the least error
    # one of them would pull or be slack.
    arm, solver = table4.arm, Solver(table4.arm, 'exact', compiled=True)
    rng, by_numpy = np.random.default_rng(5), list[Wound]()
    pull = 0.5 * np.array(FETCHING_IN_SPACE) * rng.uniform(0.5, 1.5, (3, 4))
    pull = np.where(rng.random((3, 4)) < 0.5, pull, rng.uniform(0.0, 3.0, (3, 4)))
    phase, solve = np.arange(12).reshape(3, 4), winding.Winding.solve

    def counted(self: winding.Winding, *arguments: Any) -> Wound:
        by_numpy.append(solve(self, *arguments))
        return by_numpy[-1]

    monkeypatch.setattr(winding.Winding, 'solve', counted)
    last: Wound | None = None
    for number in range(40):
        part = 0.9 + 0.05 * (np.sin(0.03 * number) + np.cos(0.03 * number + phase))
        lengths = displacements_of(solver, solver.solve(part * pull)).ravel()
        wanted = dict(zip(arm.tendon_names, lengths.tolist()))
        last = solve_displacements(solver, wanted, start=last)
        assert np.abs(last.displacement.ravel() - lengths).max() <= 1.01e-9 * arm.length
    assert len(by_numpy) < 10


def test_tendons_that_get_taut_or_slack_are_found() -> None:
    arm = helical_arm()
    machine, plain = (Solver(arm, 'exact', compiled=compiled) for compiled in (True, False))
    pull = np.array([[0.3, 0.6, 0.1], [1.0, 0.4, 0.2]])
    goals = [displacements_of(plain, plain.solve(part * pull)).ravel() for part in (1.0, 0.9, 1.1)]
    goals[1][3] -= 4e-3
    goals[2][:3] += 2e-3
    found: list[Wound | None] = [None, None]
    for goal in goals:
        wanted = dict(zip(arm.tendon_names, goal.tolist()))
        found = [
            solve_displacements(solver, wanted, start=start)
            for solver, start in zip((machine, plain), found)
        ]
        one, other = found
        assert one is not None and other is not None
        assert one.slack == other.slack
        np.testing.assert_allclose(one.backbone.tensions, other.backbone.tensions, atol=2e-8)
        np.testing.assert_allclose(one.displacement, other.displacement, atol=2e-9 * arm.length)


def test_a_step_leaves_tendons_taut_or_long_enough() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        root = rng.normal(size=(6, 6))
        changes, driven = root @ root.T + 0.1 * np.eye(6), rng.uniform(size=6) < 0.8
        tensions, wrong = rng.uniform(size=6) * rng.integers(0, 2, 6), rng.normal(size=6)
        step = np.zeros(6)
        assert find_step(changes, wrong, tensions, driven, 0.0, step)
        same = complementary_step(changes, wrong, tensions, driven, 0.0)
        assert same is not None
        np.testing.assert_allclose(same, step, rtol=1e-9, atol=1e-9)
        new, left = tensions + step, wrong - changes @ step
        np.testing.assert_array_equal(step[~driven], 0.0)
        assert (new[driven] >= -1e-12).all()
        assert (left[driven] <= 1e-9).all()
        np.testing.assert_allclose((new * left)[driven], 0.0, atol=1e-9)


def test_what_is_not_determined_is_not_solved() -> None:
    both = np.ones((2, 2))
    assert not solve_some(both, np.ones(2), np.array([True, True]), np.zeros(2))
    found = np.array([0.0, 3.0])
    assert solve_some(both, np.ones(2), np.array([True, False]), found)
    np.testing.assert_allclose(found, [-2.0, 3.0])
