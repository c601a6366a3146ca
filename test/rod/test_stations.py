"""Stations, and what the nodes between them resolve."""

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
    """Softer from ``width`` / 2 before ``at`` [m] to as much after, there by ``part``."""
    s = (0.0, at - 0.5 * width, at, at + 0.5 * width, arm.length)
    modulus = Table(s, (1e5, 1e5, 1e5 * part, 1e5, 1e5))
    return dataclasses.replace(arm, material=Material(modulus))


def rerouted(arm: Arm, at: float, width: float, part: float) -> Arm:
    """Likewise with tendons nearer to the midline."""
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
def test_the_closed_form_is_integrated_as_by_an_ode_solver_also_within_few_millimetres(
    table4, case
):
    arm, tensions = {
        'helical': (HELICAL, PULL),
        'softened': (softened(table4.arm, 0.4, 4e-3, 0.5), 0.3 * np.array(FETCHING_IN_SPACE)),
        'rerouted': (rerouted(table4.arm, 0.09, 8e-3, 0.6), 0.3 * np.array(FETCHING_IN_SPACE)),
    }[case]
    backbone = Solver(arm, 'closed_form').solve(tensions)
    expected = reference.solve(arm, tensions, 'closed_form', backbone.s)
    assert_allclose(backbone.position, expected.position, rtol=0.0, atol=1e-8 * arm.length)


def wound(turns: float) -> Arm:
    """A slender arm with two tendons that wind about it on one side."""
    twist = (math.tau * turns, math.tau * turns)
    section = Section(0.3, 0.0079, 0.0079, angles=(0.0, 1.0), twist=twist)
    return Arm(Material(1e5), Body(0.3, 0.01, 0.01), (section,))


@pytest.mark.parametrize('turns', [10, 40])
@pytest.mark.parametrize('stations', [2, 6])
@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_few_stations_do_not_hide_how_a_tendon_winds(model, stations, turns):
    arm = wound(turns)
    backbone = Solver(arm, model, stations).solve([[0.5, 0.0]])
    # In axes that turn with the tendons all sections are alike, and the arm is a screw.
    stretch = 1.0 + backbone.q[0]
    x, y, z = stretch * np.array([backbone.tau[0], backbone.xi[0], backbone.k[0]])
    x += math.tau * turns / arm.length
    screw = np.array([[0, -z, y, stretch], [z, 0, -x, 0], [-y, x, 0, 0], [0, 0, 0, 0]])
    expected = expm(arm.length * screw)[:3, 3]
    # The error is estimated: with 10 turns it is 1.5e-8 where 1e-8 is asked for.
    assert_allclose(backbone.tip, expected, rtol=0.0, atol=2e-8 * arm.length)


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_what_no_nodes_resolve_is_refused(model):
    # Ten thousand waves of a tendon's distance from the midline.
    offset = Function(
        lambda s: 0.007 + 0.002 * np.sin(2e5 * s), 0.3, lambda s: 400.0 * np.cos(2e5 * s)
    )
    section = RoutedSection(0.3, (Tendon(offset, Constant(0.0)),))
    arm = Arm(Material(1e5), Body(0.3, 0.01, 0.01), (section,))
    with pytest.raises(SolveError, match='resolve'):
        Solver(arm, model).solve([[0.5]])


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_more_turns_than_nodes_show_are_refused(model):
    with pytest.raises(ConfigError, match='turns of tendons'):
        Solver(wound(3000.0), model)
