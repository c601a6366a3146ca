"""Stations, and the resolution of the nodes between them."""

import dataclasses
import math

import numpy as np
import pytest
import reference
from numpy.testing import assert_allclose
from rods import HELICAL, PULL
from scipy.linalg import expm

from octo_arm_model import (
    Arm,
    Body,
    ConfigError,
    Function,
    Material,
    RoutedSection,
    Section,
    SolveError,
    Solver,
    Table,
    Tendon,
)
from octo_arm_model.arm.profile import Constant
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE


def softened(arm: Arm, at: float, width: float, part: float) -> Arm:
    """Return ``arm`` with a modulus that falls to ``part`` at ``at`` over a ``width`` [m]."""
    s = (0.0, at - 0.5 * width, at, at + 0.5 * width, arm.length)
    modulus = Table(s, (1e5, 1e5, 1e5 * part, 1e5, 1e5))
    return dataclasses.replace(arm, material=Material(modulus))


def rerouted(arm: Arm, at: float, width: float, part: float) -> Arm:
    """Return ``arm`` with offsets that fall to ``part`` at ``at`` over a ``width`` [m]."""
    s = np.array([0.0, at - 0.5 * width, at, at + 0.5 * width, arm.length])
    sections = tuple(
        RoutedSection(
            section.anchorage,
            tuple(
                Tendon(
                    Table(tuple(s), tuple(tendon.offset.value(s) * [1.0, 1.0, part, 1.0, 1.0])),
                    tendon.angle,
                )
                for tendon in section.tendons
            ),
        )
        for section in arm.sections
    )
    return dataclasses.replace(arm, sections=sections)


@pytest.mark.parametrize('case', ['helical', 'softened', 'rerouted'])
def test_closed_form_equals_an_ode_solver_with_local_changes(table4, case):
    arm, tensions = {
        'helical': (HELICAL, PULL),
        'softened': (softened(table4.arm, 0.4, 4e-3, 0.5), 0.3 * np.array(FETCHING_IN_SPACE)),
        'rerouted': (rerouted(table4.arm, 0.09, 8e-3, 0.6), 0.3 * np.array(FETCHING_IN_SPACE)),
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
