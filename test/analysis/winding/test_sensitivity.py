"""First derivatives where displacements do not say what every tension is."""

from __future__ import annotations

import numpy as np
import pytest
from differences import jacobian

from octo_arm_model import Config, Solver, Uncertainty, Wound, solve_displacements
from octo_arm_model.analysis.winding.sensitivity import wound_sensitivity
from octo_arm_model.analysis.winding.tendon_displacement import displacements_of

TENSIONS = np.array([[0.03, 0.01, 0.02, 0.015]])  # [N]


@pytest.fixture(scope='module', params=['closed_form', 'exact'])
def solver(request: pytest.FixtureRequest, prototype: Config) -> Solver:
    return prototype.solver(request.param)


def wound_as(solver: Solver, tensions: np.ndarray) -> tuple[np.ndarray, Wound]:
    """Displacements under ``tensions``, and the arm whose four tendons hold them."""
    displacements = displacements_of(solver, solver.solve(tensions)).ravel()
    given = dict(zip(solver.arm.tendon_names, displacements.tolist(), strict=True))
    return displacements, solve_displacements(solver, given)


def test_four_taut_tendons_of_a_section_that_deforms_in_three_ways(solver: Solver) -> None:
    _, wound = wound_as(solver, TENSIONS)
    assert (wound.backbone.tensions > 0.0).all()
    found = wound_sensitivity(solver, wound)

    def tip(x: np.ndarray) -> np.ndarray:
        return solver.solve(x.reshape(1, 4)).tip

    def displacements(x: np.ndarray) -> np.ndarray:
        return displacements_of(solver, solver.solve(x.reshape(1, 4))).ravel()

    # Displacements that agree move the tip as the tensions do that they come of; closed_form has
    # an energy, and so a change of tensions that changes no shape, to 2e-5 only.
    steps = 4 * [1e-4]
    at = wound.backbone.tensions.ravel()
    moved = found.by_displacement.tip[:3] @ jacobian(displacements, at, steps)
    expected = jacobian(tip, at, steps)
    np.testing.assert_allclose(moved, expected, rtol=0.0, atol=5e-5 * np.abs(expected).max())


def test_encoders_of_a_millimetre_tenth_leave_the_tip_millimetres(solver: Solver) -> None:
    _, wound = wound_as(solver, TENSIONS)
    covariance = wound_sensitivity(solver, wound).tip_covariance(Uncertainty(displacement=1e-4))
    stddev = np.sqrt(np.trace(covariance[:3, :3]))
    # The arm bends by 1e-4 m / offset, and the tip moves by no more than its length times that.
    arm = solver.arm
    offset = float(np.hypot(*arm.tendon_offsets(np.zeros(1)))[0, 0])
    assert 1e-4 < stddev < 2.0 * 1e-4 / offset * arm.length


def test_how_well_tensions_are_known_says_nothing_of_tendons_driven_by_length(
    solver: Solver,
) -> None:
    """Of slack ones neither: what they hold follows from their displacements."""
    _, taut = wound_as(solver, TENSIONS)
    names = solver.arm.tendon_names
    slack = solve_displacements(solver, {names[0]: 0.01, names[2]: -0.05}, {names[1]: 0.01})
    assert slack.slack == (names[2],)
    known = Uncertainty(tension=0.05)
    assert not wound_sensitivity(solver, taut).tip_covariance(known).any()
    found = wound_sensitivity(solver, slack).held.by_tension
    given = [not driven for driven in slack.driven]
    assert [bool(column.any()) for column in found.tip.T] == given
