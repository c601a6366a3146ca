"""Balances that are found quickly are balances, and what is none is not taken for one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import strategies
from helical_arm import HELICAL
from hypothesis import given, settings
from hypothesis import strategies as st

from octo_arm_model import Arm, Config, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.batched_ldlt import factorise
from octo_arm_model.core.section import newton, quasi_newton
from octo_arm_model.core.arm.laws import LAWS
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import TOLERANCE, force_scale, initial_strain, minimise
from octo_arm_model.core.section.sheaths.sheath import SheathedSections, sections_of
from octo_arm_model.core.section.sheaths.sheathed_tendons import SheathedTendons
from octo_arm_model.core.section.tendons.planar_tendons import PlanarTendons

FETCHING = 0.8 * np.array([[0.0, 0.0, 0.5, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0, 13.0, 0.0, 0.0]])


def energy_at(arm: Arm, law: str, sheath: float = 0.0) -> SectionEnergy:
    """A few cross sections of ``arm``, with sheaths of ``sheath`` times its shear modulus."""
    if sheath:
        stiffness = sheath * float(arm.material.shear_modulus_at(np.zeros(1))[0])
        arm = dataclasses.replace(arm, sheath_stiffness=(stiffness,) * len(arm.tendons))
    s = np.linspace(0.0, arm.sections[0].anchorage, 7)
    section = np.array([sum(part.anchorage >= at for part in arm.sections) for at in s])
    return sections_of(arm, s, section, LAWS[law])


def imbalance(energy: SectionEnergy, tensions: FloatArray, strain: FloatArray) -> float:
    """What is left of the balance over its scale, evaluated anew."""
    gradient, _ = energy.derivatives(strain, tensions, energy.widening(strain[3]))
    return float(np.abs(gradient / force_scale(energy, tensions)).max())


@settings(deadline=None)
@given(
    loaded=strategies.loaded_arms(),
    law=st.sampled_from(['linear', 'neo_hookean']),
    sheath=st.sampled_from([0.0, 5.0, 20.0]),
)
def test_what_is_found_is_in_balance(
    loaded: tuple[Arm, np.ndarray], law: str, sheath: float
) -> None:
    arm, tensions = loaded
    energy = energy_at(arm, law, sheath)
    local = energy.local_tensions(tensions.reshape(1, -1))
    with np.errstate(all='ignore'):
        try:
            found = minimise(energy, local, initial_strain(energy, local))
        except SolveError:
            return
    assert imbalance(energy, local, found.strain) <= 10.0 * TOLERANCE


@pytest.mark.parametrize('sheath', [0.0, 7.0, 20.0])
@pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
def test_it_is_the_minimum_that_a_descent_finds(
    table4: Config, law: str, sheath: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    energy = energy_at(table4.arm, law, sheath)
    random = np.random.default_rng(4).uniform(0.0, 1.0, (5, 12)) * np.repeat([0.1, 1.0, 2.0], 4)
    local = energy.local_tensions(0.4 * np.concatenate([FETCHING, random]))
    start = initial_strain(energy, local)
    descended = newton._descend(energy, local, start, force_scale(energy, local))
    monkeypatch.setattr(newton, '_descend', None)  # never called
    found = minimise(energy, local, start)
    scale = np.abs(descended.strain).max(axis=(1, 2), keepdims=True) + 1e-9
    np.testing.assert_allclose(found.strain / scale, descended.strain / scale, atol=1e-9)


@pytest.mark.parametrize('sheath', [0.0, 7.0])
@pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
def test_an_estimated_residual_is_no_less_than_the_evaluated_one(
    table4: Config, law: str, sheath: float
) -> None:
    energy, random = energy_at(table4.arm, law, sheath), np.random.default_rng(5)
    highest, estimated = np.repeat([0.5, 4.0, 13.0], 4), 0
    for size in np.geomspace(1e-3, 0.5 if sheath else 1.0, 200):
        tensions = size * highest * np.maximum(random.uniform(-1.0, 1.0, (1, 12)), 0.0)
        local = energy.local_tensions(tensions)
        found = minimise(energy, local, initial_strain(energy, local))
        left = float(found.residual[0])
        estimated += left >= quasi_newton._LEAST
        assert imbalance(energy, local, found.strain) <= max(left, quasi_newton._LEAST)
    assert estimated > 10


def test_other_starts_lead_to_the_same_strain(table4: Config) -> None:
    for sheath in (0.0, 7.0):
        energy = energy_at(table4.arm, 'neo_hookean', sheath)
        local = energy.local_tensions(FETCHING)
        start = initial_strain(energy, local)
        straight = np.zeros_like(start)
        straight[3] = start[3]
        found = minimise(energy, local, start).strain
        for other in (minimise(energy, local, found), minimise(energy, local, straight)):
            scale = np.abs(found).max(axis=(1, 2), keepdims=True) + 1e-9
            np.testing.assert_allclose(other.strain / scale, found / scale, atol=1e-12)


# What is no balance ------------------------------------------------------------------------------


def test_too_few_steps_are_no_balance(table4: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    energy = energy_at(table4.arm, 'neo_hookean')
    local = energy.local_tensions(FETCHING)
    start, scale = initial_strain(energy, local), force_scale(energy, local)
    needed = quasi_newton.balance(
        energy, PlanarTendons(energy, local), start[1:], scale[1:], TOLERANCE
    )
    assert needed is not None and needed.iterations > 0
    monkeypatch.setattr(quasi_newton, '_MOST_STEPS', needed.iterations - 1)
    tendons = PlanarTendons(energy, local)
    assert quasi_newton.balance(energy, tendons, start[1:], scale[1:], TOLERANCE) is None
    # Then it is found by descending.
    assert imbalance(energy, local, minimise(energy, local, start).strain) <= 10.0 * TOLERANCE


def test_tendons_out_of_balance_in_their_sheaths_are_none(table4: Config) -> None:
    energy = energy_at(table4.arm, 'neo_hookean', 7.0)
    assert isinstance(energy, SheathedSections)
    local = energy.local_tensions(0.5 * FETCHING)
    found = minimise(energy, local, initial_strain(energy, local)).strain

    class Drifting(SheathedTendons):
        """Never in balance."""

        def gradient(self, strain: FloatArray) -> FloatArray:
            gradient = super().gradient(strain)
            self.imbalance = 1e-6
            return gradient

    scale = force_scale(energy, local)
    assert quasi_newton.balance(energy, SheathedTendons(energy, local), found, scale, TOLERANCE)
    drifting = Drifting(energy, local)
    assert quasi_newton.balance(energy, drifting, found, scale, TOLERANCE) is None


@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_one_section_that_cannot_be_is_no_balance_for_all(table4: Config, bad: float) -> None:
    energy = energy_at(table4.arm, 'neo_hookean')
    local = energy.local_tensions(np.concatenate([FETCHING, FETCHING]))
    start = initial_strain(energy, local)[1:]
    start[0, 1, 3] = bad
    with np.errstate(all='ignore'):
        found = quasi_newton.balance(
            energy, PlanarTendons(energy, local), start, force_scale(energy, local)[1:], TOLERANCE
        )
    assert found is None


# Parts -------------------------------------------------------------------------------------------


@pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
def test_stiffness_of_planar_tendons_is_the_derivative_of_their_pull(
    table4: Config, law: str
) -> None:
    energy = energy_at(table4.arm, law)
    local = energy.local_tensions(
        np.repeat([[0.1, 1.0, 2.0]], 4, axis=1) * np.linspace(0.1, 1, 12)
    )
    strain = minimise(energy, local, initial_strain(energy, local)).strain[1:]
    step = np.stack([0.3 + strain[1], 0.2 - strain[0], 0.02 * strain[2]])
    tendons = PlanarTendons(energy, local)
    h = 3e-2
    near, far = (
        tendons.gradient(strain + k * h * step) - tendons.gradient(strain - k * h * step)
        for k in (1, 2)
    )
    tendons.gradient(strain)
    expected = (8.0 * near - far) / (12.0 * h)
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(tendons.stiffened(step) / scale, expected / scale, atol=1e-6)


def test_what_is_surely_stable_has_a_definite_hessian(table4: Config) -> None:
    """And what has none is not surely stable; both occur."""
    verdicts = set()
    for law in ('linear', 'neo_hookean'):
        for sheath in np.geomspace(0.3, 30.0, 25):
            energy = energy_at(table4.arm, law, float(sheath))
            assert isinstance(energy, SheathedSections)
            for part in (0.3, 1.0):
                local = energy.local_tensions(part * FETCHING)
                strain = initial_strain(energy, local)
                surely = energy._is_surely_stable(strain, local)
                try:
                    _, hessian = energy.derivatives(strain, local, energy.widening(strain[3]))
                except SolveError:
                    assert not surely
                    continue
                factors = factorise(hessian)
                definite = min(float(factors[k, k].min()) for k in range(4)) > 0.0
                assert definite or not surely
                verdicts.add((definite, surely))
    assert verdicts >= {(True, True), (False, False)}


def test_tendons_are_no_farther_off_than_the_quick_check_allows_for() -> None:
    energy = energy_at(HELICAL, 'neo_hookean', 4.0)
    assert isinstance(energy, SheathedSections)
    local = energy.local_tensions(np.array([[0.3, 0.6, 0.1, 1.0, 0.4, 1.5]]))
    strain = np.random.default_rng(5).normal(0.0, 8.0, (4, 1, energy.s.size))
    strain[3] = 0.9
    off = np.hypot(*energy.condensed(strain, local).offset)
    bound = energy.sheath_compliance * local * np.sqrt(np.sum(strain[:3] ** 2, axis=0))
    assert off.max() > 1e-4 and (off <= bound * (1.0 + 1e-9)).all()
