"""Unloaded arms by `exact`: balanced at every node, alone as in a batch."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helical_arm import HELICAL

from octo_arm_model import Arm, Config, Material, ProfiledBody, Solver, Table
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.core.models.exact import Exact
from octo_arm_model.core.models.unloaded_exact import RESOLVED
from octo_arm_model.core.section.newton import TOLERANCE, force_scale
from octo_arm_model.core.section.strain_measures import to_scaled

UNEVEN = Table((0.0, 0.1, 0.2, 0.4), (0.016, 0.012, 0.015, 0.009))


@pytest.fixture(params=[False, True], ids=['NumPy', 'compiled'])
def compiled(request: pytest.FixtureRequest) -> bool:
    if request.param:
        pytest.importorskip('numba')
    return bool(request.param)


def sheathed(arm: Arm, times: float) -> Arm:
    stiffness = times * float(arm.material.shear_modulus_at(np.zeros(1))[0])
    return dataclasses.replace(arm, sheath_stiffness=(stiffness,) * len(arm.tendons))


def cases(config: Config) -> list[tuple[Arm, np.ndarray]]:
    """Arms, and tensions for one in a batch: resolved, refined in one panel, and everywhere."""
    random = np.random.default_rng(7)
    sets = np.concatenate([
        np.array(FETCHING_IN_SPACE)[np.newaxis], random.random((3, 3, 4)), np.zeros((1, 3, 4))
    ])  # fmt: skip
    uneven = Arm(Material(1.1e5), ProfiledBody(0.4, UNEVEN), HELICAL.sections)
    few = random.random((4, 2, 3)) * [[0.3], [0.6]]
    return [(config.arm, sets), (sheathed(config.arm, 7.0), sets), (uneven, few), (HELICAL, few)]


def test_a_batch_is_its_arms_one_by_one(table4: Config, compiled: bool) -> None:
    for arm, sets in cases(table4):
        solver = Solver(arm, 'exact', compiled=compiled)
        assert solver.is_compiled == compiled
        batch = solver.solve(sets)
        for number, tensions in enumerate(sets):
            alone = solver.solve(tensions)
            np.testing.assert_allclose(batch.position[number], alone.position, atol=1e-12)
            for name in ('tau', 'xi', 'k', 'q'):
                one, other = getattr(batch, name)[number], getattr(alone, name)
                np.testing.assert_allclose(one, other, atol=1e-11 * max(1.0, np.abs(other).max()))


def test_every_node_is_in_balance(table4: Config, compiled: bool) -> None:
    """Evaluated anew: as exactly as sections are solved, or strains interpolated."""
    for arm, sets in cases(table4):
        solver = Solver(arm, 'exact', compiled=compiled)
        statics = solver._statics
        assert isinstance(statics, Exact)
        energy = statics.sections
        for tensions in sets:
            found = solver.solve(tensions)
            assert found.twist is not None and found.residual <= TOLERANCE
            local = energy.local_tensions(tensions.reshape(1, -1))
            strain = to_scaled(energy.law, found.twist[:, np.newaxis])
            gradient, _ = energy.derivatives(strain, local, energy.widening(strain[3]))
            left = np.abs(gradient / force_scale(energy, local)).max()
            assert left <= 100.0 * RESOLVED


def test_only_panels_that_points_do_not_resolve_are_refined(table4: Config) -> None:
    """On the thin tip of Table 4's arm sheaths make strains less smooth."""
    arm = sheathed(table4.arm, 7.0)
    unloaded = Solver(arm, 'exact')._statics.unloaded  # type: ignore[attr-defined]
    found = unloaded.solve(0.7 * np.array(FETCHING_IN_SPACE).reshape(1, -1))
    assert list(unloaded._at_nodes) == [2] and found.residual.max() <= TOLERANCE
    unloaded.solve(np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]]))
    assert list(unloaded._at_nodes) == [2]


@pytest.mark.parametrize('at', [0.3, 0.37, 0.44])
def test_a_neck_between_two_points_counts(prototype: Config, compiled: bool, at: float) -> None:
    """As where the rod is solved as a whole, in elements that end at the points of the table."""
    length, body = prototype.arm.length, prototype.arm.body
    s = np.array([0.0, at * length - 3e-3, at * length, at * length + 3e-3, length])
    radius = body.radius(s) * [1.0, 1.0, 0.5, 1.0, 1.0]
    necked = ProfiledBody(length, Table(tuple(s), tuple(radius)))
    solver = Solver(dataclasses.replace(prototype.arm, body=necked), 'exact', compiled=compiled)
    tensions = np.array([[0.5, 0.2, 0.0, 0.0]])
    found = solver.solve(tensions)
    whole = solver.solve(tensions, [0.0, 1e-12, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(found.position, whole.position, rtol=0.0, atol=1e-6)
    # The neck is where the arm bends.
    smooth = Solver(prototype.arm, 'exact').solve(tensions)
    assert np.linalg.norm(found.tip - smooth.tip) > 1e-3
