"""Energies of cross sections: tendons that do not pull count for nothing."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from helical_arm import HELICAL

from octo_arm_model import Arm
from octo_arm_model.core.section import energy as energy_module
from octo_arm_model.core.arm.laws import LAWS
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.sheaths.sheath import sections_of

IN_SHEATHS = dataclasses.replace(HELICAL, sheath_stiffness=(3e5, 5e5, 0.0, 4e5, 2e5, 6e5))
STRAIN = np.array([8.0, -12.0, 20.0, 0.8, 0.02, -0.03])


def sections(arm: Arm, law: str = 'neo_hookean', shear: bool = False) -> SectionEnergy:
    return sections_of(arm, np.array([0.05, 0.3]), np.array([2, 1]), LAWS[law], shear)


def strain_of(energy: SectionEnergy, arms: int) -> np.ndarray:
    """Different in each of the ``arms``."""
    return np.tile(
        STRAIN[: energy.strains, np.newaxis, np.newaxis]
        * np.linspace(1.0, 1.05, arms)[:, np.newaxis],
        (1, 1, 2),
    )


@pytest.mark.parametrize(
    'energy',
    [sections(HELICAL), sections(HELICAL, 'linear', True), sections(IN_SHEATHS)],
    ids=['rubber', 'shear', 'sheaths'],
)
@pytest.mark.parametrize('pull', [(0, 3, 4), (1,), (), range(6)], ids=str)
def test_slack_tendons_can_be_left_out(energy: SectionEnergy, pull: tuple[int, ...]) -> None:
    tensions = np.zeros((2, 6))
    tensions[1, list(pull)] = np.linspace(0.2, 0.5, len(pull))
    tensions[0, list(pull)[1:]] = 0.4  # slack in one arm alone
    some, local_tensions = energy.pulled(tensions)
    assert len(local_tensions) == len(pull)
    strain = strain_of(energy, 2)
    widening = energy.widening(strain[3])
    expected = energy.tendon_derivatives(strain, energy.local_tensions(tensions), widening)
    for found, value in zip(some.tendon_derivatives(strain, local_tensions, widening), expected):
        np.testing.assert_allclose(found, value, rtol=1e-12, atol=1e-12)
    gradient = some.tendon_gradient(strain, local_tensions, *widening[:2])
    np.testing.assert_allclose(gradient, expected[0], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(
        some.resultants(local_tensions), energy.resultants(energy.local_tensions(tensions))
    )


def test_tables_are_kept_for_so_many_sets_of_tendons(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(energy_module, 'MOST_PULLED', 3)
    energy = sections(HELICAL)
    for which in itertools.product([0.0, 1.0], repeat=6):
        tensions = np.array([which])
        some, local_tensions = energy.pulled(tensions)
        assert energy.pulled(tensions)[0] is some
        np.testing.assert_allclose(
            some.resultants(local_tensions), energy.resultants(energy.local_tensions(tensions))
        )
        assert len(energy._pulled) <= 3
