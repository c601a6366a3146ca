"""Quadrature and interpolation at Chebyshev points."""

from __future__ import annotations

import numpy as np
import pytest

from octo_arm_model.rod.chebyshev import barycentric_matrix, chebyshev_integration

TARGETS = np.linspace(0.0, 1.0, 37)


@pytest.mark.parametrize('count', [2, 3, 5, 20])
def test_points_rise_from_zero_to_one(count: int) -> None:
    points, _ = chebyshev_integration(count)
    assert (points[0], points[-1], points.size) == (0.0, 1.0, count)
    assert (np.diff(points) > 0.0).all()
    np.testing.assert_allclose(points + points[::-1], 1.0, atol=1e-12)


@pytest.mark.parametrize('count', [2, 3, 5, 20])
def test_integrals_of_polynomials_are_exact(count: int) -> None:
    points, integrals = chebyshev_integration(count)
    for degree in range(count):
        expected = points ** (degree + 1) / (degree + 1)
        np.testing.assert_allclose(points**degree @ integrals, expected, atol=1e-12)


def test_a_degree_too_many_is_not_exact() -> None:
    points, integrals = chebyshev_integration(4)
    assert np.abs(points**4 @ integrals - points**5 / 5).max() > 1e-4


def test_integrals_of_smooth_functions_converge_spectrally() -> None:
    errors = []
    for count in (6, 9, 12):
        points, integrals = chebyshev_integration(count)
        errors.append(np.abs(np.cos(3 * points) @ integrals - np.sin(3 * points) / 3).max())
    assert errors[0] > 100 * errors[1] > 1e4 * errors[2]


@pytest.mark.parametrize('count', [2, 3, 5, 20])
def test_interpolation_reproduces_polynomials(count: int) -> None:
    points, _ = chebyshev_integration(count)
    matrix = barycentric_matrix(points, TARGETS)
    for degree in range(count):
        np.testing.assert_allclose(matrix @ points**degree, TARGETS**degree, atol=1e-12)


def test_interpolation_at_a_point_picks_its_value() -> None:
    points, _ = chebyshev_integration(20)
    np.testing.assert_array_equal(barycentric_matrix(points, points), np.eye(20))
    np.testing.assert_allclose(barycentric_matrix(points, points + 2e-16), np.eye(20), atol=1e-12)


def test_interpolation_very_near_a_point_divides_by_nothing() -> None:
    points, _ = chebyshev_integration(20)
    for distance in 10.0 ** -np.arange(9.0, 18.0):
        matrix = barycentric_matrix(points, points[5:6] + distance)
        np.testing.assert_allclose(matrix @ np.sin(points), np.sin(points[5]), atol=2e-9)


def test_targets_are_left_alone() -> None:
    points, _ = chebyshev_integration(6)
    targets = points.copy()
    barycentric_matrix(points, targets)
    np.testing.assert_array_equal(targets, points)
