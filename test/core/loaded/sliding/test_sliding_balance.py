"""How Newton's method finds the angles that tendons with friction turn by."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from octo_arm_model import Arm, Body, Loads, Material, Section, Solver
from octo_arm_model.config.config import load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.sliding.coupling import couplings
from octo_arm_model.core.loaded.sliding.sliding_balance import ExactSections
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.rod.stations import StationGrid
from octo_arm_model.core.rod.kinematics import Frame
from octo_arm_model.core.arm.laws import LAWS


@pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
def test_couplings_are_the_derivatives_of_rates_by_tensions_of_parallel_tendons(law: str) -> None:
    """Their directions are those of the midline, whatever the tensions are."""
    length, radius = 0.4, 0.01
    arm = Arm(
        Material(1e5, 0.5), Body(length, radius, radius), (Section(length, 0.006, 0.006),),
        friction=(0.3,),
    )  # fmt: skip
    grid = StationGrid.build(arm, 21)
    base = Frame(np.zeros(3), Quaternions.from_xyzw((0.0, 0.0, 0.0, 1.0)))
    rod = LoadedRod(arm, grid, base, LAWS[law], False, Loads(), 1)
    energy, friction = rod.equilibrium.energy, rod.equilibrium.friction
    assert friction is not None
    along = 1.0 - friction.collocation.s / length
    local = np.array([1.0, 0.4, 0.2, 0.0])[:, np.newaxis, np.newaxis] * (0.5 + 0.5 * along)

    def rate(tensions: np.ndarray) -> np.ndarray:
        twist = ExactSections(energy)(tensions)
        return friction.turning(twist, tensions).rate

    twist = ExactSections(energy)(local)
    found = couplings(energy, twist, local, friction.turning(twist, local)).rates
    step = 1e-5
    for number in range(len(local)):
        more, less = local.copy(), local.copy()
        more[number] += step
        less[number] -= step
        expected = (rate(more) - rate(less)) / (2.0 * step)
        scale = np.abs(found).max()
        np.testing.assert_allclose(found[:, number], expected, rtol=0.0, atol=1e-6 * scale)


@pytest.mark.parametrize('friction', [0.1, 0.5])
@pytest.mark.parametrize('sheath', [0.0, 7.0])
def test_few_steps_find_the_angles_of_tendons_that_bend_each_other(
    friction: float, sheath: float
) -> None:
    arm = load_config('renda2012_table4').arm
    stiffness = (sheath * arm.material.shear_modulus,) if sheath else ()
    rough = dataclasses.replace(arm, friction=(friction,), sheath_stiffness=stiffness)
    solver, pull = Solver(rough, 'exact'), 0.5 * np.array(FETCHING_IN_SPACE)
    drawn = solver.solve(pull)
    assert drawn.iterations <= 8
    assert solver.follow(0.9 * pull, drawn).iterations <= 8
