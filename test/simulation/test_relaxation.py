"""The relaxing material: creep, relaxation, and the instantaneous modulus."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import times

from octo_arm_model import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.simulation.relaxation import Relaxation, SimulatedRelaxation

ARM = load_parameters(preset_path('renda2012_prototype'))


@given(st.floats(0.0, 5.0), times, st.floats(0.0, 5.0))
def test_creep_under_a_steady_pull_is_that_of_the_standard_linear_solid(ratio, time, t) -> None:
    relaxing = SimulatedRelaxation(Relaxation(ratio, time), 1)
    effective = relaxing.step(np.ones(1), t * time)[0]
    retardation = (1.0 + ratio) * time
    expected = 1.0 - ratio / (1.0 + ratio) * np.exp(-t * time / retardation)
    assert effective == pytest.approx(expected, rel=1e-12)


def test_held_at_a_strain_the_pull_relaxes_like_the_modulus() -> None:
    # The tension that keeps the effective one at 1 N, step by step, is E(t) / E.
    ratio, time, dt = 0.5, 2.0, 1e-3
    relaxing = SimulatedRelaxation(Relaxation(ratio, time), 1)
    for step in range(2000):
        # Effective is affine in the tension of the step: two trials tell which one it takes.
        low, high = (copy.deepcopy(relaxing).step(np.full(1, t), dt)[0] for t in (0.0, 1.0))
        pull = (1.0 - low) / (high - low)
        assert relaxing.step(np.full(1, pull), dt)[0] == pytest.approx(1.0)
        expected = 1.0 + ratio * np.exp(-step * dt / time)
        assert pull == pytest.approx(expected, abs=2.0 * ratio * dt / time)


def test_at_once_the_shape_is_that_of_the_stiffer_arm_at_any_strain(model: str) -> None:
    ratio, pull = 0.4, np.array([[3.0, 0.0, 0.0, 1.0]])
    effective = SimulatedRelaxation(Relaxation(ratio), 4).step(pull.ravel(), 0.0)
    shape = Config.from_parameters(ARM).solver(model).solve(effective.reshape(1, 4))
    stiff = Config.from_parameters(ARM | {'material.youngs_modulus': 1.1e5 * (1.0 + ratio)})
    np.testing.assert_allclose(shape.tip, stiff.solver(model).solve(pull).tip, atol=1e-9)
    assert np.linalg.norm(shape.tip - [0.27, 0.0, 0.0]) > 0.1
