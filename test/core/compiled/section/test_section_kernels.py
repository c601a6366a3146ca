"""Cross sections by machine code are those of NumPy, whatever they are asked for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helical_arm import HELICAL

from octo_arm_model import Arm, Config, Solver
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.core.compiled import numba_build
from octo_arm_model.core.compiled.models.arm_tables import own
from octo_arm_model.core.compiled.section import minimum_kernels
from octo_arm_model.core.compiled.section.section_tables import LANES, section_tables
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import TOLERANCE, force_scale
from octo_arm_model.core.section.strain_measures import derivatives_by_twist

pytest.importorskip('numba')


def energy_of(arm: Arm, law: str, sheath: float) -> SectionEnergy:
    """Sections at the nodes of ``arm``; ``sheath`` is over the shear modulus."""
    if sheath:
        stiffness = sheath * float(arm.material.shear_modulus_at(np.zeros(1))[0])
        arm = dataclasses.replace(arm, sheath_stiffness=(stiffness,) * len(arm.tendons))
    statics = Solver(arm, 'exact', material=law)._statics
    assert isinstance(statics, Exact)
    return statics.sections


def evaluate(
    energy: SectionEnergy, tensions: FloatArray, twist: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gradient and Hessian by the ``twist`` (4, n), and what an imbalance is measured by."""
    local_tensions = energy.local_tensions(tensions[np.newaxis])
    gradient, hessian = derivatives_by_twist(energy, twist[:, np.newaxis], local_tensions)
    return gradient[:, 0], hessian[:, :, 0], force_scale(energy, local_tensions)[:, 0]


@pytest.mark.parametrize('law', ['linear', 'neo_hookean'])
@pytest.mark.parametrize('sheath', [0.0, 6.0])
def test_they_answer_any_twist_as_with_numpy(table4: Config, law: str, sheath: float) -> None:
    random = np.random.default_rng(3)
    for arm in (table4.arm, HELICAL):
        energy = energy_of(arm, law, sheath)
        count = energy.s.size
        assert count > LANES
        tensions = random.random(len(arm.tendons)) * random.integers(0, 2, len(arm.tendons))
        twist = random.normal(0.0, 5.0, (4, count))
        twist[3] = random.uniform(0.8, 1.1, count)
        expected = evaluate(energy, tensions, twist)
        found = np.empty((4, count)), np.empty((4, 4, count)), np.empty((4, count))
        numba_build.evaluate_sections()(own(section_tables(energy)), tensions, twist, *found)
        for one, other in zip(found, expected, strict=True):
            scale = np.abs(other).max(axis=-1, keepdims=True)
            np.testing.assert_allclose(one, other, atol=1e-12 * scale.max())


@pytest.mark.parametrize('sheath', [0.0, 6.0])
def test_minima_are_in_balance_by_numpy(table4: Config, sheath: float) -> None:
    for arm in (table4.arm, HELICAL):
        energy = energy_of(arm, 'neo_hookean', sheath)
        tables = own(section_tables(energy))
        random = np.random.default_rng(11)
        for _ in range(20):
            tensions = 0.5 * random.random(len(arm.tendons))
            twist = np.empty((4, energy.s.size))
            residual, steps = numba_build.find_minima()(tables, tensions, twist)
            assert steps >= 0 and residual <= TOLERANCE
            gradient, _, scale = evaluate(energy, tensions, twist)
            assert np.abs(gradient / scale).max() <= 10.0 * TOLERANCE


def test_too_few_steps_are_no_answer(table4: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    """As plain Python: with one step less than it takes there is none, and with them the same."""
    energy = energy_of(table4.arm, 'neo_hookean', 0.0)
    tables = own(section_tables(energy, [np.arange(5), np.arange(40, 44)]))
    tensions, twist = np.ravel(FETCHING_IN_SPACE), np.empty((4, 9))
    residual, steps = minimum_kernels.find_minima(tables, tensions, twist)
    machine = np.empty((4, 9))
    assert numba_build.find_minima()(tables, tensions, machine) == (
        pytest.approx(residual, rel=1e-3, abs=1e-12),
        pytest.approx(steps, abs=1),
    )
    np.testing.assert_allclose(machine, twist, atol=1e-12 * np.abs(twist).max())
    monkeypatch.setattr(minimum_kernels, 'MOST_STEPS', steps)
    assert minimum_kernels.find_minima(tables, tensions, twist)[1] == -1


def test_blocks_hold_each_section_of_a_group_once(table4: Config) -> None:
    energy = energy_of(table4.arm, 'linear', 0.0)
    groups = [np.arange(10, 150), np.arange(3), np.arange(180, 180 + LANES)]
    tables = section_tables(energy, groups)
    assert tables.blocks.tolist() == [[0, 64], [64, 64], [128, 12], [140, 3], [143, 64]]
    order = np.concatenate(groups)
    np.testing.assert_array_equal(tables.axial, energy.stiffness.axial[0, order])
    for tendon, row in enumerate(tables.acting):
        for (first, count), acting in zip(tables.blocks, row, strict=True):
            part = tables.transmission[tendon, first : first + count]
            assert not part[acting:].any() and (acting == 0 or part[acting - 1] != 0.0)
