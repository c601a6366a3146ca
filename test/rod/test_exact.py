"""The model exact without loads: the least energy of every cross section, by other means."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import reference_exact as reference
from differences import jacobian
from helical_arm import CONE, HELICAL, RUBBER
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, root
from strategies import arms, extreme_arms, fractions, loaded_arms, scaled, tensions_for

from octo_arm_model import (
    Arm,
    Backbone,
    Body,
    Config,
    Constant,
    Function,
    Linear,
    Material,
    ProfiledBody,
    RoutedSection,
    Section,
    SolveError,
    Solver,
    Table,
    Tendon,
)
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_SPACE
from octo_arm_model.rod.equilibrium import Condition
from octo_arm_model.rod.rod import Rod, Setting
from octo_arm_model.rod.unloaded import balance_sections

LAWS = ('linear', 'neo_hookean')
# Largest tensions of the paper on each arm [N], by section, as in test_renda2012.
PAPER_SIZE = {0.3: (0.3,), 0.27: (3.95,), 0.31: (1.75, 4.0, 13.0), 0.45: (0.5, 4.0, 13.0)}
THIRDS = (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)
THREE_TENDONS = Arm(
    RUBBER,
    CONE,
    (Section(0.4, 0.008, 0.004, angles=THIRDS), Section(0.25, 0.01, 0.007, angles=THIRDS)),
)
THREE_TENSIONS = np.array([[0.5, 1.0, 0.0], [2.0, 0.5, 3.0]])
UNIFORM_HELIX = Arm(
    Material(1e6, 0.4),
    Body(0.5, 0.01, 0.01),
    (Section(0.5, 0.007, 0.007, angles=(0.4,), twist=(7.0,)),),
)


def strain_at(backbone: Backbone, i: int) -> np.ndarray:
    """(kappa, lambda) at station ``i``, as the reference has it."""
    stretch = 1.0 + backbone.q[i]
    omega = np.array([backbone.tau[i], backbone.xi[i], backbone.k[i]])
    return np.append(stretch * omega, stretch)


def assert_least_energy(
    arm: Arm, tensions: np.ndarray, law: str, backbone: Backbone, shear: bool
) -> None:
    for i in np.linspace(0, backbone.s.size - 1, 5).astype(int):
        expected = reference.least_strain(arm, tensions, backbone.s[i], law, shear)
        found = strain_at(backbone, i)
        largest = np.abs(expected[:3]).max() + 1e-6 / arm.length
        np.testing.assert_allclose(found[:3], expected[:3], atol=1e-8 * largest)
        np.testing.assert_allclose(found[3], expected[3], atol=1e-9)


# Against an optimiser and a root finder --------------------------------------------------------


def test_the_references_resultants_are_the_slopes_of_its_energy() -> None:
    strain = np.array([[20.0, 30.0, -15.0, 0.8]]).T
    for law in LAWS:
        cut = reference.Cut(HELICAL, np.array([0.1]), 2, THREE_TENSIONS, law)
        slopes = jacobian(
            lambda x: cut.energy(x[:, np.newaxis])[0], strain[:, 0], (1e-1, 1e-1, 1e-1, 1e-4)
        )
        np.testing.assert_allclose(cut.resultants(strain)[:, 0], slopes, rtol=1e-7)


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('seed', range(2))
def test_strains_are_those_of_least_energy(preset: Config, law: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    # Not so much that the inner fibres of a thin tip of the linear law have no length left.
    largest = 0.7 * np.array(PAPER_SIZE[preset.arm.length])[:, np.newaxis]
    shares = random.uniform(size=(len(largest), 4))
    tensions = largest * shares / shares.sum(axis=1, keepdims=True)
    if seed == 0:
        tensions = largest * random.permuted([(1.0, 0.0, 0.0, 0.0)] * len(largest), axis=1)
    backbone = Solver(preset.arm, 'exact', 31, material=law).solve(tensions)
    assert_least_energy(preset.arm, tensions, law, backbone, False)


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('arm', [HELICAL, THREE_TENDONS], ids=['helical', 'three'])
def test_so_they_are_of_helical_tendons_and_of_three(arm: Arm, law: str) -> None:
    backbone = Solver(arm, 'exact', 31, material=law).solve(THREE_TENSIONS)
    assert_least_energy(arm, THREE_TENSIONS, law, backbone, False)
    twisted = np.abs(backbone.tau).max() > 1.0
    assert twisted == (arm is HELICAL)


def test_so_they_are_with_shear() -> None:
    backbone = Solver(HELICAL, 'exact', 31, material='linear', shear=True).solve(THREE_TENSIONS)
    assert_least_energy(HELICAL, THREE_TENSIONS, 'linear', backbone, True)
    assert backbone.twist is not None
    assert np.abs(backbone.twist[4:]).max() > 1e-3


def test_beyond_the_last_anchorage_the_arm_is_as_it_was_made() -> None:
    arm = Arm(RUBBER, CONE, (Section(0.3, 0.008, 0.004),))
    backbone = Solver(arm, 'exact').solve([[1.0, 0.0, 2.0, 0.5]])
    outside = backbone.s > 0.3
    for name in ('tau', 'xi', 'k', 'q'):
        np.testing.assert_array_equal(getattr(backbone, name)[outside], 0.0)
        assert (getattr(backbone, name)[~outside] != 0.0).all() or name == 'tau'


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('pull', [0.01, 0.3, 3.0])
def test_equal_tendons_compress_by_the_scalar_equation(law: str, pull: float) -> None:
    arm = Arm(RUBBER, CONE, (Section(0.4, 0.005, 0.005),))
    backbone = Solver(arm, 'exact', 11, material=law).solve(np.full((1, 4), pull))
    for s, q in zip(backbone.s, backbone.q):
        load = 4.0 * pull / (1.1e5 * math.pi * float(arm.body.radius(s)) ** 2)
        expected = -load
        if law == 'neo_hookean':
            expected = brentq(lambda x: (x - x**-2) / 3.0 + load, 0.05, 1.0, xtol=1e-14) - 1.0
        assert q == pytest.approx(expected, abs=1e-10)
    np.testing.assert_allclose([backbone.tau, backbone.xi, backbone.k], 0.0, atol=1e-11)


def test_a_helical_tendon_twists_and_bends_by_four_equations() -> None:
    pull, y, rate = 20.0, 0.007, 14.0
    backbone = Solver(UNIFORM_HELIX, 'exact', 41, material='linear').solve([[pull]])
    area = math.pi * 1e-4
    bending, axial = 1e6 * area * 1e-4 / 4.0, 1e6 * area
    torsion = 2.0 * bending / 2.8
    for i in (0, 13, 40):
        phi = 0.4 + rate * backbone.s[i]
        out, around = np.array([math.cos(phi), math.sin(phi)]), np.array([-math.sin(phi), 1.0])
        around[1] = math.cos(phi)

        def left(x: np.ndarray) -> np.ndarray:
            # By hand, in the axes t, out, around: r = y e_out, r' = y rate e_around.
            twist, about_out, about_around, stretch = x
            u = np.array([stretch - y * about_around, 0.0, y * (twist + rate)])
            unit = u / np.linalg.norm(u)
            return np.array([
                torsion * twist + pull * y * unit[2],
                bending * about_out,
                bending * about_around - pull * y * unit[0],
                axial * (stretch - 1.0) + pull * unit[0],
            ])  # fmt: skip

        found = root(left, [0.0, 0.0, 0.0, 1.0], tol=1e-14).x
        n, b = found[1] * out + found[2] * around
        expected = np.array([found[0], n, b, found[3]])
        np.testing.assert_allclose(strain_at(backbone, i), expected, rtol=1e-9, atol=1e-9)
    assert np.ptp(backbone.tau) < 1e-8
    assert backbone.tau[0] < -1.0


# Balance ---------------------------------------------------------------------------------------


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('which', ['table4', 'helical', 'three'])
def test_rod_and_tendons_balance_at_every_station(table4: Config, law: str, which: str) -> None:
    arm, tensions = {
        'table4': (table4.arm, np.array(FETCHING_IN_SPACE)),
        'helical': (HELICAL, THREE_TENSIONS),
        'three': (THREE_TENDONS, THREE_TENSIONS),
    }[which]
    backbone = Solver(arm, 'exact', material=law).solve(tensions)
    for i, s in enumerate(backbone.s):
        cut = reference.Cut(arm, s, int(backbone.section[i]), tensions, law, reference.FINE_DISC)
        left = cut.resultants(strain_at(backbone, i)[:, np.newaxis])
        moment, force = cut.scale
        assert np.abs(left[:3]).max() <= 1e-8 * moment[0]
        assert np.abs(left[3]) <= 1e-8 * force[0]
    assert backbone.residual <= 1e-10


def test_the_residual_is_that_of_the_balance_where_profiles_have_corners() -> None:
    # Corners that no polynomial resolves: what is interpolated must have been found to be right.
    s = np.linspace(0.0, 0.4, 9)
    body = ProfiledBody(0.4, Table(tuple(s), tuple(0.01 + 0.003 * np.cos(4.0 * np.arange(9)))))
    arm = Arm(RUBBER, body, (Section(0.4, 0.005, 0.004),))
    backbone = Solver(arm, 'exact').solve([[0.7, 0.0, 0.0, 0.4]])
    radius = body.radius(backbone.s)
    for i in range(0, backbone.s.size, 7):
        local = Arm(RUBBER, Body(0.4, radius[i], radius[i]), arm.sections)
        cut = reference.Cut(
            local, backbone.s[i], 1, np.array([0.7, 0, 0, 0.4]), 'neo_hookean', reference.FINE_DISC
        )
        left = cut.resultants(strain_at(backbone, i)[:, np.newaxis])
        assert np.abs(left[:3]).max() <= 1e-10 * cut.scale[0][0]
        assert np.abs(left[3]) <= 1e-10 * cut.scale[1][0]


# Facts -----------------------------------------------------------------------------------------


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('seed', range(5))
def test_parallel_tendons_bend_the_arm_in_the_papers_plane_to_rounding(
    law: str, seed: int
) -> None:
    arm = Arm(RUBBER, CONE, (Section(0.4, 0.005, 0.005),))
    t1, t2, t3, t4 = local_tensions = np.random.default_rng(seed).uniform(0.0, 0.8, 4)
    _, n, b = Solver(arm, 'exact', material=law).solve(local_tensions[np.newaxis]).tip
    # In the axes (b, -n); the base here is the frame itself.
    assert math.atan2(-n, b) == pytest.approx(math.atan2(t3 - t1, t2 - t4), abs=1e-11)


@pytest.mark.parametrize('panel', BENDING)
def test_converging_tendons_bend_it_in_that_plane_but_for_their_slope_squared(
    table2: Config, panel: str
) -> None:
    t1, t2, t3, t4 = BENDING[panel][0]
    _, n, b = Solver(table2.arm, 'exact').solve(BENDING[panel]).tip
    slope = table2.arm.sections[0].offset_slope
    assert math.atan2(-n, b) == pytest.approx(math.atan2(t3 - t1, t2 - t4), abs=slope**2)


@given(loaded_arms(max_sections=3), fractions(0.2, 5.0), st.sampled_from(LAWS))
@settings(max_examples=20)
def test_shapes_scale_with_the_arm(case: tuple[Arm, np.ndarray], scale: float, law: str) -> None:
    arm, tensions = case
    larger = scaled(arm, scale)
    try:
        small = Solver(arm, 'exact', 31, material=law).solve(tensions)
    except SolveError:
        with pytest.raises(SolveError):
            Solver(larger, 'exact', 31, material=law).solve(scale**2 * tensions)
        return
    large = Solver(larger, 'exact', 31, material=law).solve(scale**2 * tensions)
    np.testing.assert_allclose(large.position, scale * small.position, atol=1e-8 * larger.length)
    np.testing.assert_allclose(scale * large.k, small.k, rtol=1e-6, atol=1e-6 / arm.length)
    np.testing.assert_allclose(large.q, small.q, atol=1e-8)


@given(arms(max_sections=3), fractions(0.2, 5.0))
@settings(max_examples=10)
def test_stiffness_and_tensions_in_proportion_change_nothing(arm: Arm, scale: float) -> None:
    tensions = np.full(arm.tension_shape, 0.02) * float(arm.material.youngs_modulus) * 1e-5
    tensions = tensions * arm.length**2 * np.linspace(0.1, 1.0, tensions.size).reshape(-1, 4)
    material = dataclasses.replace(
        arm.material, youngs_modulus=scale * float(arm.material.youngs_modulus)
    )
    before = Solver(arm, 'exact', 31).solve(tensions)
    after = Solver(dataclasses.replace(arm, material=material), 'exact', 31).solve(
        scale * tensions
    )
    np.testing.assert_allclose(after.position, before.position, atol=1e-9 * arm.length)


@pytest.mark.parametrize('shear', [False, True])
def test_the_linear_law_reaches_the_same_strains_from_any_start(shear: bool) -> None:
    rod = Rod(HELICAL, setting=Setting(widens=False, shear=shear))
    problem, condition = rod.problem(0), Condition(THREE_TENSIONS.ravel(), np.zeros(6))
    usual = rod.unloaded(problem, condition)[0]
    given = problem.form, problem.tables, problem.work
    tensions = problem.acting(condition).tensions
    random = np.random.default_rng(0)
    for _ in range(25):
        start = random.normal(size=usual.shape)
        start[:, :3] *= 50.0
        balance_sections(*given, tensions, start)
        np.testing.assert_allclose(start, usual, rtol=1e-7, atol=1e-7)


def test_all_laws_agree_where_strains_are_small() -> None:
    tensions = 1e-4 * THREE_TENSIONS
    linear, rubber = (Solver(THREE_TENDONS, 'exact', material=law).solve(tensions) for law in LAWS)
    np.testing.assert_allclose(rubber.k, linear.k, rtol=1e-3, atol=1e-3 * linear.k.max())
    np.testing.assert_allclose(rubber.q, linear.q, rtol=1e-3)


# Any arm ---------------------------------------------------------------------------------------


@given(loaded_arms(), st.sampled_from(LAWS))
def test_any_arm_is_in_balance_or_an_error(case: tuple[Arm, np.ndarray], law: str) -> None:
    arm, tensions = case
    try:
        backbone = Solver(arm, 'exact', 21, material=law).solve(tensions)
    except SolveError:
        # Sections that overlap compress more than each alone.
        assert law == 'linear'
        return
    assert backbone.residual <= 1e-10
    for name in ('position', 'quaternion', 'tau', 'xi', 'k', 'q'):
        assert np.isfinite(getattr(backbone, name)).all()
    assert backbone.q.min() > -1.0


@given(extreme_arms(), st.data())
@settings(max_examples=30)
def test_arms_as_thin_as_needles_are_in_balance(arm: Arm, data: st.DataObject) -> None:
    # So little that linear superposition leaves no doubt that there is an answer.
    tensions = data.draw(tensions_for(arm, 0.05 / len(arm.sections)))
    for law in LAWS:
        backbone = Solver(arm, 'exact', 21, material=law).solve(tensions)
        assert backbone.residual <= 1e-10


def test_a_peak_of_strain_between_the_points_is_followed() -> None:
    # Interpolated from Chebyshev points, the curvature towards this tip turns sections inside out.
    section = Section(0.5705063220799433, 0.013006051446039847, 3.5939145729918886e-06)
    body = Body(0.5705063220799433, 0.03323038907833264, 8.38382386761339e-06)
    arm = Arm(Material(1.1e5), body, (section,))
    tensions = [[6.587250390349166e-07, 1.303460156279126e-06, 0.0, 3.008288874788476e-07]]
    exact, closed = (Solver(arm, model).solve(tensions) for model in ('exact', 'closed_form'))
    assert exact.residual <= 1e-11
    assert np.linalg.norm(exact.tip - closed.tip) < 0.01 * arm.length


@given(arms(), st.data(), fractions(0.5, 10.0))
@settings(max_examples=20)
def test_far_too_much_tension_is_an_answer_in_balance_or_an_error(
    arm: Arm, data: st.DataObject, load: float
) -> None:
    tensions = data.draw(tensions_for(arm, load))
    for law in LAWS:
        try:
            backbone = Solver(arm, 'exact', 21, material=law).solve(tensions)
        except SolveError:
            continue
        assert backbone.residual <= 1e-10
        assert np.isfinite(backbone.position).all()


@pytest.mark.parametrize('law', LAWS)
def test_positions_are_those_of_far_more_nodes(law: str) -> None:
    for arm, tensions in (
        (UNIFORM_HELIX, np.array([[20.0]])),
        (HELICAL, 0.5 * THREE_TENSIONS),
    ):
        found = Solver(arm, 'exact', 41, material=law).solve(tensions)
        rod = Rod(arm, setting=Setting(law == 'neo_hookean', accuracy=1e-13))
        finest = rod.solve(tensions.ravel(), np.zeros(6))
        expected = rod.readout(finest.level, found.s).read(finest.state)[0]
        np.testing.assert_allclose(found.position, expected, rtol=0.0, atol=1e-8 * arm.length)


# Profiles --------------------------------------------------------------------------------------


@pytest.mark.parametrize('law', LAWS)
def test_profiles_that_describe_the_same_arm_give_the_same_shape(law: str) -> None:
    s = np.linspace(0.0, 0.4, 41)
    radius = CONE.radius(s)

    def routed(section: Section, kind: str) -> RoutedSection:
        offset, tendons = section.offset(s), []
        for angle in section.angles:
            place = {
                'table': Table(tuple(s), tuple(offset)),
                'function': Function(section.offset, 0.4),
                'linear': Linear(section.offset_base, section.offset_anchorage, section.anchorage),
            }[kind]
            tendons.append(Tendon(place, Constant(angle)))
        return RoutedSection(section.anchorage, tuple(tendons))

    expected = Solver(THREE_TENDONS, 'exact', material=law).solve(THREE_TENSIONS)
    bodies = {
        'table': ProfiledBody(0.4, Table(tuple(s), tuple(radius))),
        'function': ProfiledBody(0.4, Function(CONE.radius, 0.4)),
        'linear': CONE,
    }
    for kind, body in bodies.items():
        arm = Arm(RUBBER, body, tuple(routed(x, kind) for x in THREE_TENDONS.sections))
        found = Solver(arm, 'exact', material=law).solve(THREE_TENSIONS)
        np.testing.assert_allclose(found.position, expected.position, atol=1e-8 * arm.length)
        np.testing.assert_allclose(found.q, expected.q, atol=1e-8)


def test_a_profile_of_moduli_is_the_arm_of_each_modulus_at_each_station() -> None:
    s = np.linspace(0.0, 0.4, 5)
    moduli = (1e5, 1.2e5, 1.5e5, 1.1e5, 0.9e5)
    stiffer = Material(Table(tuple(s), moduli), Function(lambda s: 0.3 + 0.5 * s, 0.4))
    backbone = Solver(dataclasses.replace(HELICAL, material=stiffer), 'exact', 41).solve(
        THREE_TENSIONS
    )
    for where, modulus in zip(s, moduli):
        i = int(np.abs(backbone.s - where).argmin())
        local = dataclasses.replace(
            HELICAL,
            material=Material(
                float(stiffer.youngs_modulus_at(backbone.s[i])), 0.3 + 0.5 * backbone.s[i]
            ),
        )
        assert modulus == pytest.approx(float(stiffer.youngs_modulus_at(backbone.s[i])), rel=0.05)
        expected = reference.least_strain(local, THREE_TENSIONS, backbone.s[i], 'neo_hookean')
        np.testing.assert_allclose(strain_at(backbone, i), expected, rtol=1e-7, atol=1e-7)
