"""The model exact without loads: the least energy of every cross section, by other means."""

import dataclasses
import math

import numpy as np
import pytest
import reference_exact as reference
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from rods import CONE, HELICAL, RUBBER, THIRDS
from scipy.optimize import brentq, root
from strategies import PAPER_SIZE, arms, extreme_arms, fractions, tensions_for

from octo_arm_model import (
    Arm,
    Backbone,
    Body,
    Function,
    Material,
    Section,
    SolveError,
    Solver,
    Table,
)

LAWS = ('linear', 'neo_hookean')
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
        assert_allclose(found[:3], expected[:3], atol=1e-8 * largest)
        assert_allclose(found[3], expected[3], atol=1e-9)


# Against an optimiser and a root finder --------------------------------------------------------


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('seed', range(2))
def test_strains_are_those_of_least_energy(preset, law, seed):
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
def test_so_they_are_of_helical_tendons_and_of_three(arm, law):
    backbone = Solver(arm, 'exact', 31, material=law).solve(THREE_TENSIONS)
    assert_least_energy(arm, THREE_TENSIONS, law, backbone, False)
    twisted = np.abs(backbone.tau).max() > 1.0
    assert twisted == (arm is HELICAL)


def test_so_they_are_with_shear():
    backbone = Solver(HELICAL, 'exact', 31, material='linear', shear=True).solve(THREE_TENSIONS)
    assert_least_energy(HELICAL, THREE_TENSIONS, 'linear', backbone, True)
    assert np.abs(backbone.twist[4:]).max() > 1e-3


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('pull', [0.01, 0.3, 3.0])
def test_equal_tendons_compress_by_the_scalar_equation(law, pull):
    arm = Arm(RUBBER, CONE, (Section(0.4, 0.005, 0.005),))
    backbone = Solver(arm, 'exact', 11, material=law).solve(np.full((1, 4), pull))
    for s, q in zip(backbone.s, backbone.q):
        load = 4.0 * pull / (1.1e5 * math.pi * float(arm.body.radius(s)) ** 2)
        expected = -load
        if law == 'neo_hookean':
            expected = brentq(lambda x: (x - x**-2) / 3.0 + load, 0.05, 1.0, xtol=1e-14) - 1.0
        assert q == pytest.approx(expected, abs=1e-10)
    assert_allclose([backbone.tau, backbone.xi, backbone.k], 0.0, atol=1e-11)


def test_a_helical_tendon_twists_and_bends_by_four_equations():
    pull, y, rate = 20.0, 0.007, 14.0
    backbone = Solver(UNIFORM_HELIX, 'exact', 41, material='linear').solve([[pull]])
    area = math.pi * 1e-4
    bending, axial = 1e6 * area * 1e-4 / 4.0, 1e6 * area
    torsion = 2.0 * bending / 2.8
    for i in (0, 13, 40):
        phi = 0.4 + rate * backbone.s[i]
        out, around = np.array([math.cos(phi), math.sin(phi)]), np.array([-math.sin(phi), 1.0])
        around[1] = math.cos(phi)

        def left(x):
            # By hand, in the axes t, out, around: r = y e_out, r' = y rate e_around.
            twist, about_out, about_around, stretch = x
            u = np.array([stretch - y * about_around, 0.0, y * (twist + rate)])
            unit = u / np.linalg.norm(u)
            return np.array(
                [
                    torsion * twist + pull * y * unit[2],
                    bending * about_out,
                    bending * about_around - pull * y * unit[0],
                    axial * (stretch - 1.0) + pull * unit[0],
                ]
            )

        found = root(left, [0.0, 0.0, 0.0, 1.0], tol=1e-14).x
        n, b = found[1] * out + found[2] * around
        expected = np.array([found[0], n, b, found[3]])
        assert_allclose(strain_at(backbone, i), expected, rtol=1e-9, atol=1e-9)
    assert np.ptp(backbone.tau) < 1e-8
    assert backbone.tau[0] < -1.0


# Any arm ---------------------------------------------------------------------------------------


@given(extreme_arms(), st.data())
@settings(max_examples=30)
def test_arms_as_thin_as_needles_are_in_balance(arm, data):
    # So little that linear superposition leaves no doubt that there is an answer.
    tensions = data.draw(tensions_for(arm, 0.05 / len(arm.sections)))
    for law in LAWS:
        backbone = Solver(arm, 'exact', 21, material=law).solve(tensions)
        assert backbone.residual <= 1e-10


def test_a_peak_of_strain_between_the_points_is_followed():
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
def test_far_too_much_tension_is_an_answer_in_balance_or_an_error(arm, data, load):
    tensions = data.draw(tensions_for(arm, load))
    for law in LAWS:
        try:
            backbone = Solver(arm, 'exact', 21, material=law).solve(tensions)
        except SolveError:
            continue
        assert backbone.residual <= 1e-10
        assert np.isfinite(backbone.position).all()


# Profiles --------------------------------------------------------------------------------------


def test_a_profile_of_moduli_is_the_arm_of_each_modulus_at_each_station():
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
        assert_allclose(strain_at(backbone, i), expected, rtol=1e-7, atol=1e-7)
