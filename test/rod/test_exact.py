"""The model exact without loads: every cross section has the least energy; stations and nodes."""

import dataclasses
import math

import numpy as np
import pytest
import reference
import reference_exact
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from rods import CONE, HELICAL, HELICES, PULL, RUBBER
from scipy.linalg import expm
from strategies import arms, fractions, tensions_for

from octo_arm_model import (
    Arm,
    Backbone,
    Body,
    ConfigError,
    Constant,
    Function,
    Material,
    RoutedSection,
    Section,
    SolveError,
    Solver,
    Table,
    Tendon,
)
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE

LAWS = ('linear', 'neo_hookean')
STRAIGHT = Arm(RUBBER, CONE, tuple(dataclasses.replace(one, twist=()) for one in HELICES))
THREE_TENSIONS = np.array([[0.5, 1.0, 0.0], [2.0, 0.5, 3.0]])


def assert_least_energy(
    arm: Arm, tensions: np.ndarray, law: str, backbone: Backbone, shear: bool
) -> None:
    for i in np.linspace(0, backbone.s.size - 1, 5).astype(int):
        expected = reference_exact.least_strain(arm, tensions, backbone.s[i], law, shear)
        stretch = 1.0 + backbone.q[i]
        strains = stretch * np.array([backbone.tau[i], backbone.xi[i], backbone.k[i]])
        largest = np.abs(expected[:3]).max() + 1e-6 / arm.length
        assert_allclose(strains, expected[:3], atol=1e-8 * largest)
        assert_allclose(stretch, expected[3], atol=1e-9)


@pytest.mark.parametrize(
    ('law', 'shear'), [('linear', False), ('linear', True), ('neo_hookean', False)]
)
@pytest.mark.parametrize('name', ['helical', 'straight', 'profiles'])
def test_strains_have_the_least_energy_in_general_arms(name, law, shear):
    moduli = Table((0.0, 0.1, 0.2, 0.3, 0.4), (1e5, 1.2e5, 1.5e5, 1.1e5, 0.9e5))
    varied = Material(moduli, Function(lambda s: 0.3 + 0.5 * s, 0.4))
    arms_of = {'helical': HELICAL, 'straight': STRAIGHT}
    arm = arms_of.get(name, dataclasses.replace(HELICAL, material=varied))
    backbone = Solver(arm, 'exact', 31, material=law, shear=shear).solve(THREE_TENSIONS)
    assert_least_energy(arm, THREE_TENSIONS, law, backbone, shear)
    assert (np.abs(backbone.tau).max() > 1.0) == (name != 'straight')
    assert not shear or np.abs(backbone.twist[4:]).max() > 1e-3


# Any arm ---------------------------------------------------------------------------------------


def test_peak_of_strain_between_points_is_resolved():
    # Interpolation from Chebyshev points would invert sections near this tip.
    section = Section(0.5705063220799433, 0.013006051446039847, 3.5939145729918886e-06)
    body = Body(0.5705063220799433, 0.03323038907833264, 8.38382386761339e-06)
    arm = Arm(Material(1.1e5), body, (section,))
    tensions = [[6.587250390349166e-07, 1.303460156279126e-06, 0.0, 3.008288874788476e-07]]
    exact, closed = (Solver(arm, model).solve(tensions) for model in ('exact', 'closed_form'))
    assert exact.residual <= 1e-11
    # A tenth of the deflection.
    assert np.linalg.norm(exact.tip - closed.tip) < 1e-5 * arm.length
    assert np.hypot(*exact.tip[1:]) > 1e-4 * arm.length


@given(arms(), st.data(), fractions(0.5, 10.0))
@settings(max_examples=20)
def test_excessive_tension_gives_a_balanced_shape_or_an_error(arm, data, load):
    tensions = data.draw(tensions_for(arm, load))
    for law in LAWS:
        try:
            backbone = Solver(arm, 'exact', 21, material=law).solve(tensions)
        except SolveError:
            continue
        assert backbone.residual <= 1e-10
        assert np.isfinite(backbone.position).all()
        residuals = [reference_exact.imbalance(arm, law, backbone, i) for i in range(0, 21, 5)]
        # Strains at stations are interpolated from those at the nodes.
        assert max(residuals) < 1e-5


# Stations, and the resolution of the nodes between them ------------------------------------------


# Four tendons that are nearer to the midline within 8 mm around 90 mm.
S = (0.0, 0.086, 0.09, 0.094, 0.4)
NEARER = Table(S, tuple(np.interp(S, S[::4], (0.008, 0.004)) * [1.0, 1.0, 0.6, 1.0, 1.0]))
RING = tuple(Tendon(NEARER, Constant(0.5 * math.pi * number)) for number in range(4))
REROUTED = Arm(RUBBER, CONE, (RoutedSection(0.4, RING),))
# A modulus that falls to a half within 4 mm around 400 mm.
SOFTENED = Material(Table((0.0, 0.398, 0.4, 0.402, 0.45), (1e5, 1e5, 0.5e5, 1e5, 1e5)))


@pytest.mark.parametrize('case', ['helical', 'softened', 'rerouted'])
def test_closed_form_equals_an_ode_solver_with_local_changes(table4, case):
    arm, tensions = {
        'helical': (HELICAL, PULL),
        'softened': (
            dataclasses.replace(table4.arm, material=SOFTENED),
            0.3 * np.array(FETCHING_IN_SPACE),
        ),
        'rerouted': (REROUTED, np.array([[2.0, 0.5, 0.0, 1.0]])),
    }[case]
    backbone = Solver(arm, 'closed_form').solve(tensions)
    expected = reference.solve(arm, tensions, 'closed_form', backbone.s)
    assert_allclose(backbone.position, expected.position, rtol=0.0, atol=1e-8 * arm.length)


def helical_arm(turns: float) -> Arm:
    """Return a slender arm with two helical tendons on one side."""
    twist = (math.tau * turns, math.tau * turns)
    section = Section(0.3, 0.0079, 0.0079, angles=(0.0, 1.0), twist=twist)
    return Arm(Material(1e5), Body(0.3, 0.01, 0.01), (section,))


@pytest.mark.parametrize('turns', [10, 40])
@pytest.mark.parametrize('stations', [2, 6])
@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_helical_tendons_are_resolved_with_few_stations(model, stations, turns):
    arm = helical_arm(turns)
    backbone = Solver(arm, model, stations).solve([[0.5, 0.0]])
    # In axes that rotate with the tendons all sections are equal, so that the midline is a screw.
    stretch = 1.0 + backbone.q[0]
    x, y, z = stretch * np.array([backbone.tau[0], backbone.xi[0], backbone.k[0]])
    x += math.tau * turns / arm.length
    screw = np.array([[0, -z, y, stretch], [z, 0, -x, 0], [-y, x, 0, 0], [0, 0, 0, 0]])
    expected = expm(arm.length * screw)[:3, 3]
    # The error is an estimate: with 10 turns it is 1.5e-8 for an accuracy of 1e-8.
    assert_allclose(backbone.tip, expected, rtol=0.0, atol=2e-8 * arm.length)


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_paths_that_nodes_do_not_resolve_are_refused(model):
    # The offset of the tendon has ten thousand waves.
    offset = Function(
        lambda s: 0.007 + 0.002 * np.sin(2e5 * s), 0.3, lambda s: 400.0 * np.cos(2e5 * s)
    )
    section = RoutedSection(0.3, (Tendon(offset, Constant(0.0)),))
    arm = Arm(Material(1e5), Body(0.3, 0.01, 0.01), (section,))
    with pytest.raises(SolveError, match='resolve'):
        Solver(arm, model).solve([[0.5]])


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_too_many_turns_are_refused(model):
    with pytest.raises(ConfigError, match='turns of tendons'):
        Solver(helical_arm(3000.0), model)
