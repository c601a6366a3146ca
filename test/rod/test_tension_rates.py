"""Derivatives of the tensions that friction leaves at the nodes, and of what depends on them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from rods import CASES, TENSIONS, WRENCH, twists_at

from octo_arm_model import Loads
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.equilibrium import Condition, Problem
from octo_arm_model.rod.rod import Rod

MU = (0.3, 0.5, 0.0, 0.4, 0.2, 0.6)
WEIGHT = Loads(gravity=(0.0, 3.0, -5.0))


def rubbed(name: str) -> Rod:
    """The arm of a case of `rods` with friction."""
    arm, setting = CASES[name]
    arm = dataclasses.replace(arm, friction=MU)
    return Rod(arm, WEIGHT, setting=setting)


def jumped(problem: Problem) -> FloatArray:
    """Twists that jump wherever they may: without a jump its angle is not differentiable."""
    elements = problem.elements
    jumps = np.repeat(elements.sharp.cumsum(), elements.points)
    return twists_at(elements.s, problem.strains) - 0.05 * jumps[:, np.newaxis]


def conditions(problem: Problem, z: FloatArray) -> list[Condition]:
    """Drawn in, and after that partly let out."""
    first = Condition(TENSIONS, WRENCH)
    history = problem.history(problem.evaluate(problem.acting(first), z))
    later = TENSIONS * np.array([1.1, 0.9, 1.0, 0.85, 1.02, 0.6])
    return [first, Condition(later, WRENCH, before=history)]


@pytest.mark.parametrize('name', CASES)
def test_changes_of_tensions_are_those_of_differences(name: str) -> None:
    problem = rubbed(name).problem(0)
    z, random = jumped(problem), np.random.default_rng(3)
    size = np.where(np.arange(problem.strains) < 3, 1.0, 0.1)
    change = random.standard_normal(z.shape) * size
    for condition in conditions(problem, z):

        def at(step: float, condition: Condition = condition) -> FloatArray:
            return problem.evaluate(problem.acting(condition), z + step * change).acting.tensions

        changes = problem.tension_derivatives(problem.evaluate(problem.acting(condition), z))
        assert changes is not None
        expected = (at(1e-6) - at(-1e-6)) / 2e-6
        found = changes.by_twists(change[..., np.newaxis])[..., 0]
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize('name', CASES)
def test_the_jacobian_with_friction_is_that_of_differences(name: str) -> None:
    problem = rubbed(name).problem(1)
    z, s = jumped(problem), problem.elements.s
    change = np.cos(7.0 * s)[:, np.newaxis] * np.where(np.arange(problem.strains) < 3, 1.0, 0.1)
    for condition in conditions(problem, z):
        acting = problem.acting(condition)
        ends = [problem.evaluate(acting, z + one * change).imbalance for one in (1e-5, -1e-5)]
        expected = (ends[0] - ends[1]) / 2e-5
        problem.fill_jacobian(problem.evaluate(acting, z))
        found = (problem.work.jacobian @ change.ravel()).reshape(z.shape)
        scale = np.abs(expected).max(axis=0)
        assert (np.abs(found - expected) <= 2e-6 * scale).all()


def test_tendons_in_sheaths_recover_from_an_impossible_shape() -> None:
    problem = rubbed('neo_hookean in sheaths').problem(0)
    z, acting = jumped(problem), problem.acting(Condition(TENSIONS, WRENCH))
    expected = problem.evaluate(acting, z)
    turned_inside_out = z * np.array([1.0, 1.0, 1.0, -1.0])
    with np.errstate(invalid='ignore'):
        assert np.isnan(problem.evaluate(acting, turned_inside_out).residual)
    found = problem.evaluate(acting, z.copy())
    np.testing.assert_allclose(found.acting.tensions, expected.acting.tensions, rtol=1e-12)


@pytest.mark.parametrize('name', ['neo_hookean', 'shear in sheaths'])
def test_a_slack_tendon_is_drawn_in_next(name: str) -> None:
    problem = rubbed(name).problem(0)
    z, pulled = jumped(problem), TENSIONS * (np.arange(6) != 3)
    more = 1e-7 * (np.arange(6) == 3)
    for condition in conditions(problem, z):
        one = problem.evaluate(problem.acting(condition._replace(tensions=pulled)), z)
        rates = problem.tension_rates(one)[:, 3]
        other = problem.evaluate(problem.acting(condition._replace(tensions=pulled + more)), z)
        expected = (other.acting.tensions - one.acting.tensions)[:, 3] / 1e-7
        # After a history the tension of one that was let go follows from its end.
        if condition.before is None:
            np.testing.assert_allclose(rates, expected, rtol=1e-6)
        assert 0.1 < rates[problem.tables.reach[:, 3] > 0.0].min() < 0.95
