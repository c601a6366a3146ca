"""What a balance is refused for, in the words of the solver."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from octo_arm_model import Arm, Body, Loads, Material, Section, SolveError
from octo_arm_model.rod.rod import Rod, Setting

COLUMN = Arm(Material(1e5, density=1080.0), Body(0.4, 0.01, 0.01), (Section(0.4, 0.005, 0.005),))
AXIAL = 1e5 * np.pi * 0.01**2
BENDING = 0.25 * AXIAL * 0.01**2
LOADS = pytest.mark.parametrize('is_loaded', [False, True])


def refusal(arm: Arm, tensions: list[float], is_loaded: bool, law: str) -> str:
    """What the rod says; nothing where it solves."""
    loads = Loads(gravity=(0.0, 0.0, -0.01)) if is_loaded else Loads()
    rod = Rod(arm, loads, setting=Setting(law == 'neo_hookean'))
    try:
        rod.solve(np.array(tensions), np.zeros(6))
    except SolveError as error:
        return str(error)
    return ''


@LOADS
def test_rubber_is_not_compressed_to_nothing(is_loaded: bool) -> None:
    part = [refusal(COLUMN, 4 * [pull * AXIAL], is_loaded, 'neo_hookean')
            for pull in (150.0, 250.0)]  # fmt: skip
    assert not part[0]
    says = 'tensions compress a fibre of the arm to nothing at s = '
    assert part[1].startswith(says) and part[1].endswith('of its length, must be > 0.02)')


@LOADS
def test_a_tendon_stays_in_the_body(is_loaded: bool) -> None:
    sections = (Section(0.4, 0.009, 0.009),)
    stiffness = (2.0 * AXIAL**2 / BENDING,)
    arm = dataclasses.replace(COLUMN, sections=sections, sheath_stiffness=stiffness)
    for pull, is_out in ((0.4, False), (1.0, True)):
        says = refusal(arm, [pull * AXIAL, 0.0, 0.0, 0.0], is_loaded, 'neo_hookean')
        expected = 'tensions press a tendon out of the body at s = '
        assert says.startswith(expected if is_out else '') and bool(says) == is_out
        assert says.endswith('m: its sheath is too soft' if is_out else '')


def test_an_unloaded_arm_is_stable_in_its_sheaths() -> None:
    # Four tendons of 1 N take nine tenths of the bending stiffness.
    arm = dataclasses.replace(COLUMN, sheath_stiffness=(4.0 / (0.9 * BENDING),))
    assert not refusal(arm, 4 * [1.0], False, 'linear')
    says = refusal(arm, 4 * [1.1], False, 'linear')
    assert says.startswith('tensions bend the arm without end at s = ')
    assert says.endswith('m: sheaths are too soft')
    # Under a load it buckles, and is stable there or finds nothing.
    assert not says == refusal(arm, 4 * [1.1], True, 'linear')
