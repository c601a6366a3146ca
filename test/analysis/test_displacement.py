"""Tendons of prescribed displacement: the tensions that hold them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from octo_arm_model import Arm, Config, Loads, Solver, TensionError, solve_displacements
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE

TENSIONS = 0.5 * np.array(FETCHING_IN_SPACE)


@pytest.fixture(scope='module')
def solver(table4: Config) -> Solver:
    return Solver(table4.arm, 'exact')


def displacements_of(solver: Solver, tensions: np.ndarray) -> dict[str, float]:
    """Displacement of every tendon [m], by name."""
    whole = solver.rest_lengths - solver.tendon_lengths(solver.solve(tensions))
    return dict(zip(solver.arm.tendon_names, whole.ravel().tolist(), strict=True))


def test_lengths_are_those_of_polygons_through_the_tendons(solver: Solver, table4: Config) -> None:
    fine = Solver(table4.arm, 'exact', 2001, material='linear')
    backbone = fine.solve(TENSIONS)
    rotation = np.array([np.eye(3)] * 2001)
    x, y, z, w = backbone.quaternion.T
    rotation[:, :, 1] = np.stack(
        [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)], 1
    )
    rotation[:, :, 2] = np.stack(
        [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)], 1
    )
    lengths = fine.tendon_lengths(backbone).ravel()
    offsets = np.stack(table4.arm.tendon_offsets(backbone.s), axis=-1)
    for tendon, section in enumerate(table4.arm.tendon_section):
        acts = backbone.s <= table4.arm.sections[section - 1].anchorage
        n, b = offsets[tendon].T
        path = backbone.position + n[:, None] * rotation[:, :, 1] + b[:, None] * rotation[:, :, 2]
        polygon = np.linalg.norm(np.diff(path[acts], axis=0), axis=1).sum()
        # At an anchorage the strain jumps and the polygon with it: second order in the step.
        assert lengths[tendon] == pytest.approx(polygon, rel=2e-5)


def test_a_straight_unloaded_tendon_is_as_long_as_its_slope_makes_it(
    solver: Solver, table4: Config
) -> None:
    for lengths, section in zip(solver.rest_lengths, table4.arm.sections, strict=True):
        expected = math.hypot(section.anchorage, section.offset_anchorage - section.offset_base)
        np.testing.assert_allclose(lengths, expected, rtol=1e-12)


def test_the_tensions_come_back_from_the_displacements_they_made(solver: Solver) -> None:
    wound = solve_displacements(solver, displacements_of(solver, TENSIONS))
    np.testing.assert_allclose(wound.backbone.tensions, TENSIONS, atol=1e-6)
    np.testing.assert_allclose(wound.backbone.tip, solver.solve(TENSIONS).tip, atol=1e-8)


def test_a_wound_tendon_meets_its_length_beside_others_held_by_tension(solver: Solver) -> None:
    wound = solve_displacements(
        solver, {'tendon_1_1': 0.02, 'tendon_2_2': 0.01}, {'tendon_3_1': 1}
    )
    assert wound.displacement[0, 0] == pytest.approx(0.02, abs=1e-9)
    assert wound.displacement[1, 1] == pytest.approx(0.01, abs=1e-9)
    assert wound.backbone.tensions[2, 0] == 1.0
    assert wound.slack == ()
    assert np.count_nonzero(wound.backbone.tensions) == 3


def test_a_tendon_that_would_have_to_push_is_slack(solver: Solver) -> None:
    wound = solve_displacements(solver, {'tendon_1_1': -0.01}, {'tendon_3_1': 1.0})
    assert wound.slack == ('tendon_1_1',)
    assert wound.backbone.tensions[0, 0] == 0.0
    # Its path is shorter than the length paid out: it is slack.
    assert wound.displacement[0, 0] > -0.01
    alone = solver.solve([[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]])
    np.testing.assert_allclose(wound.backbone.tip, alone.tip, atol=1e-12)


def test_opposite_tendons_wound_alike_compress_the_arm_straight(solver: Solver) -> None:
    names = solver.arm.tendon_names[:4]
    wound = solve_displacements(solver, dict.fromkeys(names, 0.03))
    tensions = wound.backbone.tensions[0]
    np.testing.assert_allclose(tensions, tensions[0], rtol=1e-6)
    np.testing.assert_allclose(wound.backbone.tip[1:], 0.0, atol=1e-9)


def test_it_holds_under_loads_and_from_a_start(table4: Config) -> None:
    loads = Loads(gravity=(0, 0, -9.81), fluid_density=1000)
    loaded = Solver(table4.arm.with_density(1080), 'exact', loads=loads)
    wanted = {'tendon_1_1': 0.02, 'tendon_2_2': 0.01}
    cold = solve_displacements(loaded, wanted)
    assert cold.displacement[0, 0] == pytest.approx(0.02, abs=1e-9)
    wanted['tendon_1_1'] = 0.021
    warm = solve_displacements(loaded, wanted, start=cold.backbone)
    np.testing.assert_allclose(warm.displacement[[0, 1], [0, 1]], [0.021, 0.01], atol=1e-9)


def test_metal_rods_wind_too(rod: Config) -> None:
    solver = rod.solver()
    wound = solve_displacements(solver, {'tendon_1_1': 0.004, 'tendon_2_2': 0.003})
    np.testing.assert_allclose(
        [wound.displacement[0, 0], wound.displacement[1, 1]], [0.004, 0.003], atol=1e-9
    )


@pytest.mark.parametrize(
    ('displacements', 'tensions', 'message'),
    [
        ({'elbow': 0.01}, {}, 'unknown tendon elbow; this arm has tendon_1_1, '),
        ({'tendon_1_1': 0.01}, {'elbow': 1.0}, 'unknown tendon elbow'),
        (
            {'tendon_1_1': 0.01},
            {'tendon_1_1': 1.0},
            'tendon_1_1 has both a displacement',
        ),
        ({'tendon_1_1': math.nan}, {}, 'displacement of tendon_1_1 is nan m, expected a finite'),
        ({'tendon_1_1': 0.01}, {'tendon_1_2': -1.0}, 'tension of tendon_1_2 is -1.0 N'),
    ],
)
def test_bad_input_is_named(
    solver: Solver, displacements: dict[str, float], tensions: dict[str, float], message: str
) -> None:
    with pytest.raises(TensionError, match=message):
        solve_displacements(solver, displacements, tensions)


def test_rest_lengths_do_not_depend_on_the_model(table4: Config) -> None:
    arm: Arm = table4.arm
    lengths = [Solver(arm, model).rest_lengths for model in ('renda2012', 'closed_form', 'exact')]
    np.testing.assert_allclose(lengths[0], lengths[2], rtol=1e-12)
    np.testing.assert_allclose(lengths[1], lengths[2], rtol=1e-12)
