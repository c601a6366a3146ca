"""Tendons that stand off their paths, against minimisation over strains and places at once."""

import dataclasses
import math

import numpy as np
import pytest
import strategies
from helical_arm import PULL, helical_arm
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import minimize

from octo_arm_model import Arm, ArmDefinitionError, Body, Material, Section, SolveError, Solver
from octo_arm_model.arm.stiffness import estimate_sheath_stiffness

RUBBER = Material(1.1e5, 0.5, 1080.0)
SHEAR_MODULUS = 1.1e5 / 3.0
# One keeps its place.
HELICAL = helical_arm(RUBBER, sheath_stiffness=(3e5, 5e5, 0.0, 4e5, 2e5, 6e5))


def with_sheath(arm: Arm, stiffness: float) -> Arm:
    return dataclasses.replace(arm, sheath_stiffness=(stiffness,))


def energy_of(
    arm: Arm, s: float, tensions: np.ndarray, strain: np.ndarray, offset: np.ndarray
) -> float:
    """Energy psi of one cross section of rubber, term by term as the manual has it.

    For tau, xi, k about t, n, b per reference length, the stretch, and (n, b) of every tendon that
    passes; the body by quadrature over the circle.
    """
    (t, n, b, stretch), radius = strain, float(arm.body.radius(s))
    shape = np.sqrt(1.0 / stretch)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    r = radius * np.sqrt(0.5 * (nodes + 1.0))[:, np.newaxis]
    angle = 2.0 * np.pi * np.arange(48) / 48
    y, z = r * np.cos(angle), r * np.sin(angle)
    fibre = stretch + shape * (n * z - b * y)
    area = math.pi * radius**2
    mean = float(np.sum(0.5 * weights[:, np.newaxis] * (fibre**2 + 2.0 / fibre - 3.0)) / 48)
    torsion = SHEAR_MODULUS * area * radius**2 / 2.0
    total = 0.5 * SHEAR_MODULUS * area * mean + 0.5 * torsion * (shape * t) ** 2
    x, y = (table[:, 0] for table in arm.tendon_offsets(np.array([s])))
    dx, dy = (table[:, 0] for table in arm.tendon_slopes(np.array([s])))
    for j in range(len(arm.tendons)):
        if arm.sections[arm.tendon_section[j] - 1].anchorage < s:
            continue
        place = shape * np.array([0.0, x[j] + offset[2 * j], y[j] + offset[2 * j + 1]])
        tangent = np.array([stretch, shape * dx[j], shape * dy[j]])
        tangent += np.cross([t, n, b], place)
        total += tensions[j] * float(np.linalg.norm(tangent))
        place_off = offset[2 * j : 2 * j + 2]
        total += 0.5 * arm.sheath_stiffness[j] * float(place_off @ place_off)
    return total


@pytest.mark.parametrize('s', [0.1, 0.3])
def test_strains_are_those_of_least_energy_over_strains_and_places(s):
    """A general optimiser of all unknowns at once finds no less."""
    # Sheaths of equal stiffness: the optimiser moves none that is rigid.
    arm = with_sheath(HELICAL, 3e5)
    backbone = Solver(arm, 'exact', 41).solve(PULL)
    i = int(np.argmin(np.abs(backbone.s - s)))
    stretch = 1.0 + backbone.q[i]
    found = np.array([backbone.tau[i], backbone.xi[i], backbone.k[i]]) * stretch
    units = np.concatenate([[10.0, 10.0, 10.0, 0.1], np.full(12, 1e-3)])

    def scaled(x):
        # The energy at rest is some 1e-1 N, its changes by rounding far less.
        tensions = PULL.ravel()
        return energy_of(arm, float(backbone.s[i]), tensions, (units * x)[:4], (units * x)[4:])

    start = np.zeros(16)
    start[3] = 10.0
    best = minimize(scaled, start, method='BFGS', options={'gtol': 1e-9, 'maxiter': 2000})
    reached = (units * best.x)[:4]
    assert_allclose(reached[:3], found, atol=2e-4 * np.abs(found).max())
    assert reached[3] == pytest.approx(stretch, abs=2e-5)
    assert np.abs(best.x[4:]).max() > 0.01  # and tendons moved by more than 10 micrometres


@settings(max_examples=15, deadline=None)
@given(loaded=strategies.loaded_arms(2), scale=st.floats(0.2, 5.0))
def test_lengths_and_tensions_in_proportion_scale_the_shape(loaded, scale):
    """As k is a modulus: lengths times c, tensions times c^2, the same k."""
    arm, tensions = loaded
    stiffness = 20.0 * float(arm.material.youngs_modulus)
    small, large = (with_sheath(one, stiffness) for one in (arm, strategies.scaled(arm, scale)))
    before = Solver(small, 'exact', 31).solve(0.5 * tensions)
    after = Solver(large, 'exact', 31).solve(0.5 * scale**2 * tensions)
    assert_allclose(after.position, scale * before.position, atol=1e-8 * scale * arm.length)


@settings(max_examples=15, deadline=None)
@given(loaded=strategies.loaded_arms(1))
def test_a_pulled_arm_bends_more_where_tendons_dig_in(loaded):
    """One tendon: planar without torsion, and farther from the midline on the inside."""
    arm, tensions = loaded
    tensions[0, 1:] = 0.0
    tensions *= 0.5
    rigid = Solver(arm, 'exact', 31).solve(tensions)
    soft = Solver(with_sheath(arm, 20.0 * float(arm.material.youngs_modulus)), 'exact', 31)
    found = soft.solve(tensions)
    assert max(np.abs(found.tau).max(), np.abs(found.xi).max()) <= 1e-12 * np.abs(found.k).max()
    bend = np.abs(found.k) - np.abs(rigid.k)
    assert (bend >= -1e-9 * np.abs(rigid.k).max()).all()


def test_what_sheaths_cannot_hold_is_refused(table4):
    arm = Arm(RUBBER, Body(0.27, 0.015, 0.0074), (Section(0.27, 0.005, 0.0025),))
    soft = Solver(with_sheath(arm, 0.5 * SHEAR_MODULUS), 'exact')
    assert soft.solve([[0.5, 0, 0, 0]]).residual < 1e-10
    with pytest.raises(SolveError):
        soft.solve([[3.0, 0, 0, 0]])


def test_the_estimate_is_that_of_plane_elasticity():
    """Kelvin's line force in a disc, its displacements averaged by quadrature."""
    radius, thread = 0.011, 0.001
    angle = 2.0 * np.pi * (np.arange(400) + 0.5) / 400

    def along_force(at, sources):
        """Displacement along a force of 1 N/m spread over ``sources``, times 4 pi G."""
        away = at[:, :, np.newaxis] - sources[:, np.newaxis]
        square = np.sum(away**2, axis=0)
        return np.mean(-0.5 * np.log(square) + away[0] ** 2 / square, axis=-1)

    ring = thread * np.stack([np.cos(angle), np.sin(angle)])
    between = thread * np.stack([np.cos(angle + np.pi / 400), np.sin(angle + np.pi / 400)])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    r = radius * np.sqrt(0.5 * (nodes + 1.0))
    whole = sum(
        0.5 * w * along_force(size * np.stack([np.cos(angle), np.sin(angle)]), ring).mean()
        for w, size in zip(weights, r)
    )
    gives = (along_force(between, ring).mean() - whole) / (4.0 * np.pi * SHEAR_MODULUS)
    estimate = estimate_sheath_stiffness(thread, radius, SHEAR_MODULUS)
    assert estimate == pytest.approx(1.0 / gives, rel=5e-3)


@pytest.mark.parametrize(
    ('given', 'problem'),
    [
        ((0.0, 0.01, 1e5), 'thread_radius is 0.0, expected a finite number > 0'),
        ((0.006, 0.01, 1e5), 'thread_radius is 0.006, expected at most 0.5 of the radius'),
    ],
)
def test_an_estimate_out_of_range_is_refused(given, problem):
    with pytest.raises(ArmDefinitionError, match=problem):
        estimate_sheath_stiffness(*given)
