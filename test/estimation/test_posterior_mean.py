"""The mean of a posterior apart from its mode: by definition, and what it does to a filter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from estimation_arms import TENSIONS, WEIGHT, rubber
from scipy.stats import chi2

from octo_arm_model import Arm, Body, Material, Section
from octo_arm_model.estimation.belief import Belief, gain
from octo_arm_model.estimation.filter import Filter
from octo_arm_model.estimation.measurements import Tensions, TipPosition
from octo_arm_model.estimation.posterior_mean import shift_to_mean
from octo_arm_model.estimation.prediction import ArmModel, Prediction
from octo_arm_model.estimation.unknowns import Unknowns, Walk

# A steel-like rod of 1.2 mm whose tip forces move by hundreds of times what it is measured to.
ROD = Arm(
    Material.from_moduli(40e9, 15e9),
    Body(0.25, 0.0006, 0.0006, disc_radius=0.01),
    (
        Section(
            0.25, 0.01, 0.01,
            angles=(0.0, math.pi, 1.5 * math.pi, 0.0),
            twist=(2.0 * math.pi, 0.0, 0.0, 0.0),
        ),
    ),
)  # fmt: skip


def test_the_shift_is_the_gradient_of_the_determinant() -> None:
    model = rubber(Unknowns(Walk(1.0), tip_force=Walk(0.01)), loads=WEIGHT)
    x = np.concatenate([TENSIONS, [0.004, -0.006, 0.008]])
    at = Prediction(model, x, None)
    tip = TipPosition(at.solved.tip, 1e-5)
    # Small, so that differences are those of the first order.
    prior = Belief(x, np.diag([2e-3, 3e-3, 2e-3, 1e-3, 1e-4, 2e-4, 1e-4]))

    def half_log_determinant(x: np.ndarray) -> float:
        jacobian = tip.jacobian(Prediction(model, x, at.solved))
        expected = jacobian @ prior.covariance @ jacobian.T + tip.covariance
        return 0.5 * float(np.linalg.slogdet(expected)[1])

    gradient = np.array([
        (half_log_determinant(x + step) - half_log_determinant(x - step)) / (2.0 * step.sum())
        for step in 0.1 * prior.root
    ])  # fmt: skip
    by = gain(prior.root, tip.jacobian(at), tip.noise_root)
    expected = -by.root @ by.root.T @ gradient
    found = shift_to_mean(prior, [tip], at, by)
    posterior = Belief(x, by.root)
    size = np.linalg.norm(posterior.whitened(expected))
    assert np.linalg.norm(posterior.whitened(found - expected)) < 0.02 * size


@pytest.mark.slow
def test_a_filter_that_remembers_is_as_sure_as_it_should_be() -> None:
    unknowns = Unknowns(
        Walk(20.0, 50.0),
        tension_bias=Walk.stationary(0.1, 1.0),
        tip_force=Walk.stationary(0.05, 1.0),
    )
    model = ArmModel(ROD, unknowns, material='linear', stations=31)
    state, runs, steps, period = model.state, 5, 60, 1.0 / 30.0
    squares, errors = [], []
    for seed in range(runs):
        rng, own, shape = np.random.default_rng(seed), Filter(model), None
        x = state.prior_stddev() * rng.normal(size=state.size)
        for step in range(steps):
            if step:
                x = state.decay(period) * x + state.growth(period) * rng.normal(size=state.size)
            x[state.tension] = 2.0 + 1.5 * np.sin(
                2.0 * math.pi * 0.25 * step * period + np.arange(4.0) + seed
            )
            at = Prediction(model, x, shape)
            shape = at.solved
            reading = x[state.tension] + x[state.tension_bias] + 1e-3 * rng.normal(size=4)
            tip = shape.tip + 1e-4 * rng.normal(size=3)
            found = own.add(step * period, [Tensions(reading, 1e-3), TipPosition(tip, 1e-4)])
        error = (found.mean - x)[state.tip_force]
        errors.append(error)
        covariance = found.covariance[state.tip_force, state.tip_force]
        squares.append(float(error @ np.linalg.solve(covariance, error)))
    # The last steps of runs are independent.
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], 3 * runs)
    assert low < sum(squares) < high, squares
    # Of what guessing zero errs by, 0.05 N a component, hardly more than half is left.
    assert np.sqrt(np.mean(np.square(errors))) < 0.6 * 0.05
