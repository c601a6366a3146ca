"""The closed form, held against the full 3x3 balance of moments assembled tendon by tendon."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from hypothesis import given
from strategies import arms, loaded_arms

from octo_arm_model import Arm, Config
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.rod.closed_form import ClosedForm


def strains_at(arm: Arm, tensions: np.ndarray, s: float, active: int) -> np.ndarray:
    statics = ClosedForm(arm, np.array([s]), np.array([active]))
    twist = statics.solve(np.reshape(tensions, (1, -1))).twist[:, 0, 0]
    return np.append(twist[:3] / twist[3], twist[3] - 1.0)


@given(arms())
def test_stiffness_is_that_of_a_disc(arm: Arm) -> None:
    s = 0.4 * arm.length
    axial, torsion, bending = (part.item() for part in SectionStiffness.at(arm, np.array([s])))
    assert [torsion, bending, bending, axial] == pytest.approx(reference.stiffness(arm, s))


@given(loaded_arms())
def test_strains_solve_the_balance_of_moments(case: tuple[Arm, np.ndarray]) -> None:
    arm, tensions = case
    for active, section in enumerate(arm.sections, start=1):
        for s in (0.0, 0.6 * section.anchorage, section.anchorage):
            got = strains_at(arm, tensions, s, active)
            omega = reference.closed_form_omega(arm, tensions, active, s)
            q = reference.longitudinal_strain(arm, tensions, active, s, omega)
            # Opposite pulls cancel to rounding: 1e-11 of a radian over the length of the arm.
            atol = 1e-11 * np.abs(omega).max() + 1e-11 / arm.length
            np.testing.assert_allclose(got[:3], omega, rtol=1e-11, atol=atol)
            assert got[3] == pytest.approx(q, abs=1e-12)


def test_strains_solve_equation_10_between_anchorages(table4: Config) -> None:
    tensions, h = np.array(FETCHING_IN_SPACE), 1e-5
    for s, active in ((0.4, 1), (0.2, 2), (0.05, 3)):
        before, here, after = (strains_at(table4.arm, tensions, s + d, active) for d in (-h, 0, h))
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
