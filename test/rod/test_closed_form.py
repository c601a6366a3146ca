"""The closed form, held against the full 3x3 balance of moments assembled tendon by tendon."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from hypothesis import given
from paper_strains import closed_form_strains, tendon_sums
from scipy.linalg import expm
from strategies import arms, loaded_arms

from octo_arm_model import Arm, Body, Config, ConfigError, Material, Section, Solver
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.rod.rotations import skew


@given(arms())
def test_stiffness_is_that_of_a_disc(arm: Arm) -> None:
    s = 0.4 * arm.length
    axial, torsion, bending, *_ = np.ravel(SectionStiffness.at(arm, np.array([s]))).tolist()
    assert [torsion, bending, bending, axial] == pytest.approx(reference.stiffness(arm, s))


@given(loaded_arms())
def test_sums_are_those_over_the_tendons_that_pass(case: tuple[Arm, np.ndarray]) -> None:
    arm, tensions = case
    s = arm.sections[-1].anchorage * 0.7
    for active in range(len(arm.sections) + 1):
        _, n, b = reference.cables(arm, active, s)[0].T if active else np.zeros((3, 0))
        pull = tensions[:active].ravel()
        terms = [pull, pull * n, pull * b, pull * n * n, pull * b * b, 0.0 * n, 0.0 * n]
        for got, expected in zip(tendon_sums(arm, tensions, s, active), terms, strict=True):
            assert got == pytest.approx(expected.sum(), rel=1e-12, abs=1e-12 * pull.sum())


@given(loaded_arms())
def test_strains_solve_the_balance_of_moments(case: tuple[Arm, np.ndarray]) -> None:
    arm, tensions = case
    for active, section in enumerate(arm.sections, start=1):
        for s in (0.0, 0.6 * section.anchorage, section.anchorage):
            got = closed_form_strains(arm, tensions, s, active)
            omega = reference.closed_form_omega(arm, tensions, active, s)
            q = reference.longitudinal_strain(arm, tensions, active, s, omega)
            # Opposite pulls cancel to rounding: 1e-11 of a radian over the length of the arm.
            atol = 1e-11 * np.abs(omega).max() + 1e-11 / arm.length
            np.testing.assert_allclose(got[:3], omega, rtol=1e-11, atol=atol)
            assert got[3] == pytest.approx(q, abs=1e-12)


def test_strains_solve_equation_10_between_anchorages(table4: Config) -> None:
    tensions, h = np.array(FETCHING_IN_SPACE), 1e-5
    for s, active in ((0.4, 1), (0.2, 2), (0.05, 3)):
        before, here, after = (
            closed_form_strains(table4.arm, tensions, s + d, active) for d in (-h, 0, h)
        )
        slope = (after - before)[:3] / (2 * h)
        expected = reference.omega_rate(table4.arm, tensions, active, s, here[:3])
        np.testing.assert_allclose(slope, expected, rtol=1e-6, atol=1e-4)


def test_four_straight_tendons_never_twist_the_arm(table4: Config) -> None:
    backbone = table4.solver('closed_form').solve(FETCHING_IN_SPACE)
    np.testing.assert_allclose(backbone.tau, 0.0, atol=1e-12 * np.abs(backbone.k).max())


def test_pulling_harder_compresses_more(prototype: Config) -> None:
    tensions = np.linspace(0.0, 3.0, 7)[:, np.newaxis, np.newaxis] * [[0.0, 1.0, 0.0, 0.0]]
    q = prototype.solver('closed_form').solve(tensions).q
    assert (np.diff(q, axis=0) < 0.0).all()


@pytest.fixture(params=[False, None], ids=['NumPy', 'as installed'])
def compiled(request: pytest.FixtureRequest) -> bool | None:
    """Which form of the node functions."""
    return request.param


def wound_arm(turns: float) -> Arm:
    """A cylinder about which one tendon winds so many times."""
    helix = Section(0.3, 0.008, 0.008, (0.0,), (2.0 * np.pi * turns,))
    return Arm(Material(1e5, 0.5), Body(0.3, 0.01, 0.01), (helix,))


@pytest.mark.parametrize('turns', [0.5, 3.0, 40.0, 100.0, -100.0])
def test_a_wound_tendon_makes_a_screw_about_which_sections_turn(
    turns: float, compiled: bool | None
) -> None:
    # In axes that turn with the tendon nothing changes along the arm.
    arm, tensions = wound_arm(turns), np.array([[1.0]])
    backbone = Solver(arm, 'closed_form', compiled=compiled).solve(tensions)
    strains = closed_form_strains(arm, tensions, 0.0, 1)
    rates = (1.0 + strains[3]) * strains[:3] + [2.0 * np.pi * turns / arm.length, 0.0, 0.0]
    screw = np.zeros((4, 4))
    screw[:3, :3] = skew(rates)
    screw[0, 3] = 1.0 + strains[3]
    pose = expm(arm.length * screw)
    np.testing.assert_allclose(backbone.tip, pose[:3, 3], rtol=0.0, atol=1e-8 * arm.length)


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_more_turns_than_nodes_show_are_refused(model: str) -> None:
    with pytest.raises(ConfigError, match='turns of tendons'):
        Solver(wound_arm(3000.0), model)
