"""The paper's model against its statements (4), (9b) and (11) integrated by other means."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from strategies import arms, loaded_arms, tensions_for

from octo_arm_model import Arm, Config, ConvergenceError, SolveError, Solver
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.rod import paper_arrays, paper_equations

# Largest tensions of the paper on each arm [N], by section: Tables 1, 3 and 5; what the paper
# pulled in Figure 8 is not printed, so the tip of that arm is compressed like that of Figure 15.
PAPER_SIZE = {
    0.3: (0.3,),
    0.27: (3.95,),
    0.31: (1.75, 4.0, 13.0),
    0.45: (0.5, 4.0, 13.0),
}
ONE = (1.0, 0.0, 0.0, 0.0)


def paper_sized(arm: Arm, seed: int) -> np.ndarray:
    """Tensions of the paper's size: seed 0 one tendon to a section, else any share of them."""
    random = np.random.default_rng(seed)
    largest = np.array(PAPER_SIZE[arm.length])[:, np.newaxis]
    if seed == 0:
        return largest * random.permuted([ONE] * len(largest), axis=1)
    shares = random.uniform(size=(len(largest), 4)) * random.integers(0, 2, (len(largest), 4))
    return largest * shares / np.maximum(1.0, shares.sum(axis=1, keepdims=True))


@pytest.mark.parametrize(
    'seed', [1, *(pytest.param(seed, marks=pytest.mark.endurance) for seed in (0, 2, 3, 4, 5))]
)
def test_shape_and_strains_are_those_of_an_ode_solver_at_tight_tolerance(
    preset: Config, papers_model: str, seed: int
) -> None:
    tensions = paper_sized(preset.arm, seed)
    backbone = preset.solver(papers_model).solve(tensions)
    expected = reference.solve(preset.arm, tensions, papers_model, backbone.s, preset.base)
    strains = np.stack([backbone.tau, backbone.xi, backbone.k, backbone.q], axis=1)
    largest = np.abs(expected.strains[:, :3]).max()
    np.testing.assert_allclose(strains[:, :3], expected.strains[:, :3], atol=1e-8 * largest)
    np.testing.assert_allclose(strains[:, 3], expected.strains[:, 3], atol=1e-9)
    assert np.linalg.norm(backbone.tip - expected.position[-1]) < 1e-6 * preset.arm.length
    np.testing.assert_allclose(backbone.position, expected.position, atol=1e-6 * preset.arm.length)
    tangent = reference.Rotation.from_quat(backbone.quaternion).as_matrix()
    np.testing.assert_allclose(tangent, expected.rotation, atol=1e-5)


@settings(max_examples=4)
@given(loaded_arms(max_sections=3))
def test_any_arm_is_that_of_the_reference(case: tuple[Arm, np.ndarray]) -> None:
    arm, tensions = case
    try:
        backbone = Solver(arm, 'renda2012', 21).solve(tensions)
    except SolveError:
        reject()
    expected = reference.solve(arm, tensions, 'renda2012', backbone.s)
    np.testing.assert_allclose(backbone.position, expected.position, atol=1e-6 * arm.length)


@settings(max_examples=25)
@given(arms(), st.data())
def test_it_equals_the_closed_form_when_one_section_is_loaded(
    arm: Arm, data: st.DataObject
) -> None:
    loaded = data.draw(st.integers(0, len(arm.sections) - 1))
    tensions = np.zeros(arm.tension_shape)
    tensions[loaded] = data.draw(tensions_for(arm))[loaded]
    published, closed = (
        Solver(arm, name).solve(tensions) for name in ('renda2012', 'closed_form')
    )
    for name in ('xi', 'k', 'q'):
        expected = getattr(closed, name)
        # Opposite pulls cancel to rounding.
        atol = 1e-9 * np.abs(expected).max() + 1e-11 / arm.length
        np.testing.assert_allclose(getattr(published, name), expected, rtol=1e-9, atol=atol)
    largest = np.abs([closed.xi, closed.k]).max()
    np.testing.assert_allclose(published.tau, 0.0, atol=1e-9 * largest + 1e-11 / arm.length)
    np.testing.assert_allclose(published.position, closed.position, atol=1e-9 * arm.length)


def test_several_loaded_sections_are_where_the_two_readings_differ(table4: Config) -> None:
    published, closed = (
        table4.solver(name).solve(FETCHING_IN_SPACE) for name in ('renda2012', 'closed_form')
    )
    outermost = published.section == 1
    np.testing.assert_allclose(published.k[outermost], closed.k[outermost], rtol=1e-12)
    assert np.abs(published.tip - closed.tip).max() > 1e-3 * table4.arm.length


def test_no_convergence_is_an_error_that_says_how_far_it_got(
    table4: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paper_arrays, 'MOST_PAPER_SWEEPS', 2)
    with pytest.raises(ConvergenceError, match=r'equation \(10\) in section 3 did not conv') as e:
        table4.solver('renda2012', compiled=False).solve(10.0 * np.array(FETCHING_IN_SPACE))
    assert isinstance(e.value, SolveError)
    assert e.value.iterations == 2
    assert e.value.residual > paper_equations.TOLERANCE


def test_elements_are_cut_where_sweeps_over_the_whole_diverge(table4: Config) -> None:
    # No tendon beyond its tension in Table 5; (10) has a plain solution, q > -0.47.
    tensions = np.array([[0, 0, 0.5, 0], [0, 4, 4, 0], [0, 0, 0, 0.0]])
    backbone = table4.solver('renda2012').solve(tensions)
    expected = reference.solve(table4.arm, tensions, 'renda2012', backbone.s, table4.base)
    np.testing.assert_allclose(backbone.tip, expected.position[-1], atol=1e-6 * table4.arm.length)
