"""The paper's model against its statements (4), (9b) and (11) integrated by other means."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from hypothesis import given, reject, settings
from hypothesis import strategies as st
from strategies import arms, fractions, loaded_arms, tensions_for

from octo_arm_model import Arm, Config, ConvergenceError, SolveError, Solver
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.rod import arrays, elements, paper_arrays, paper_equations

# Largest tensions of the paper on each arm [N], by section: Tables 1, 3 and 5; what the paper
# pulled in Figure 8 is not printed, so the tip of that arm is compressed like that of Figure 15.
PAPER_SIZE = {
    0.3: (0.3,),
    0.27: (3.95,),
    0.31: (1.75, 4.0, 13.0),
    0.45: (0.5, 4.0, 13.0),
}
ONE = (1.0, 0.0, 0.0, 0.0)
OMEGA = st.tuples(*[st.floats(-300.0, 300.0, allow_subnormal=False)] * 3).map(np.array)


def paper_sized(arm: Arm, seed: int) -> np.ndarray:
    """Tensions of the paper's size: seed 0 one tendon to a section, else any share of them."""
    random = np.random.default_rng(seed)
    largest = np.array(PAPER_SIZE[arm.length])[:, np.newaxis]
    if seed == 0:
        return largest * random.permuted([ONE] * len(largest), axis=1)
    shares = random.uniform(size=(len(largest), 4)) * random.integers(0, 2, (len(largest), 4))
    return largest * shares / np.maximum(1.0, shares.sum(axis=1, keepdims=True))


@given(arms(), st.data(), fractions(), OMEGA)
def test_equation_10_follows_from_the_moments_of_the_cables(
    arm: Arm, data: st.DataObject, where: float, omega: np.ndarray
) -> None:
    tensions = data.draw(tensions_for(arm))
    for active, section in enumerate(arm.sections, start=1):
        s = where * section.anchorage
        derived = reference.omega_rate(arm, tensions, active, s, omega)
        published = reference.rebuilt_equation_10(arm, tensions, active, s, omega)
        scale = np.abs(derived).max() + 1.0
        np.testing.assert_allclose(published, derived, rtol=1e-9, atol=1e-9 * scale)


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


@pytest.mark.parametrize('tensions', [FETCHING_IN_PLANE, FETCHING_IN_SPACE])
def test_the_papers_fetching_is_that_of_the_reference(table4: Config, tensions: tuple) -> None:
    backbone = table4.solver().solve(tensions)
    expected = reference.solve(
        table4.arm, np.array(tensions), 'renda2012', backbone.s, table4.base
    )
    np.testing.assert_allclose(backbone.tip, expected.position[-1], atol=1e-6 * table4.arm.length)


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


def test_omega_jumps_by_equation_11_at_an_anchorage(table4: Config) -> None:
    arm, tensions = table4.arm, np.array([[0.2, 0.1, 0.0, 0.3], [1, 2, 3, 0], [0, 5, 1, 2.0]])
    for number in (2, 3):
        at = arm.sections[number - 1].anchorage
        places = np.array([at, at * (1.0 + 1e-9)])
        nodes = elements.build_elements(arm, added=5)
        equations = paper_equations.Renda2012(arm, nodes, places, arrays)
        twist = equations.solve(tensions.reshape(1, -1)).twist[0, nodes.s.size :][:2]
        omega = (twist[:, :3] / twist[:, 3:]).T
        expected = reference.jump(arm, tensions, number)
        np.testing.assert_allclose(omega[:, 0] - omega[:, 1], expected, rtol=1e-6, atol=1e-5)


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


def test_torsion_appears_only_below_the_second_loaded_anchorage(table4: Config) -> None:
    backbone = table4.solver('renda2012').solve(FETCHING_IN_SPACE)
    twisted = np.abs(backbone.tau) > 1e-3
    assert twisted[backbone.section == 3][:-1].all()
    # Sections 1 and 2 pull in one plane: no torsion there.
    np.testing.assert_allclose(backbone.tau[backbone.section != 3], 0.0, atol=1e-9)


def test_sections_loaded_in_one_plane_do_not_twist(table4: Config) -> None:
    backbone = table4.solver('renda2012').solve(FETCHING_IN_PLANE)
    largest = np.abs(backbone.k).max()
    np.testing.assert_allclose([backbone.tau, backbone.xi], 0.0, atol=1e-12 * largest)


@pytest.mark.parametrize('tensions', BENDING.values(), ids=BENDING)
def test_one_loaded_section_does_not_twist(table2: Config, tensions: tuple) -> None:
    backbone = table2.solver('renda2012').solve(tensions)
    assert np.abs(backbone.tau).max() < 1e-9 * np.abs(backbone.xi).max()


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


def test_the_result_does_not_depend_on_the_tolerance_of_the_sweeps(
    table4: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = table4.solver('renda2012').solve(FETCHING_IN_SPACE)
    monkeypatch.setattr(paper_equations, 'TOLERANCE', 1e-13)
    tight = table4.solver('renda2012').solve(FETCHING_IN_SPACE)
    np.testing.assert_allclose(usual.tip, tight.tip, atol=1e-7 * table4.arm.length)
