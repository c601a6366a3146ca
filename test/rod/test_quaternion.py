"""Quaternions: the axioms, and SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from octo_arm_model.rod.quaternion import Quaternions

COMPONENTS = st.floats(-1.0, 1.0, allow_subnormal=False)
XYZW = arrays(np.float64, (4,), elements=COMPONENTS)
UNIT = XYZW.filter(lambda q: np.linalg.norm(q) > 0.1).map(lambda q: q / np.linalg.norm(q))


def xyzw(quaternions: Quaternions) -> np.ndarray:
    out = np.empty((*quaternions.a.shape, 4))
    quaternions.write_xyzw(out)
    return out


def product(*factors: np.ndarray) -> np.ndarray:
    result = Quaternions.from_xyzw(factors[0])
    for factor in factors[1:]:
        result = result.times(Quaternions.from_xyzw(factor))
    return xyzw(result)


def random_units(*shape: int) -> np.ndarray:
    units = np.random.default_rng(2012).normal(size=(*shape, 4))
    return units / np.linalg.norm(units, axis=-1, keepdims=True)


def test_i_j_k_multiply_as_defined() -> None:
    i, j, k, one = np.eye(4)
    np.testing.assert_array_equal(product(i, j), k)
    np.testing.assert_array_equal(product(j, k), i)
    np.testing.assert_array_equal(product(k, i), j)
    np.testing.assert_array_equal(product(j, i), -k)
    np.testing.assert_array_equal(product(i, j, k), -one)


@given(XYZW)
def test_components_are_read_and_written_in_the_order_x_y_z_w(q: np.ndarray) -> None:
    np.testing.assert_array_equal(xyzw(Quaternions.from_xyzw(q)), q)


@given(XYZW, XYZW, XYZW)
def test_products_are_associative(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> None:
    np.testing.assert_allclose(product(product(p, q), r), product(p, product(q, r)), atol=1e-12)


@given(XYZW, XYZW)
def test_the_norm_of_a_product_is_the_product_of_norms(p: np.ndarray, q: np.ndarray) -> None:
    norm = np.linalg.norm(product(p, q))
    assert norm == pytest.approx(np.linalg.norm(p) * np.linalg.norm(q), abs=1e-12)


@given(UNIT, UNIT)
def test_products_compose_rotations(p: np.ndarray, q: np.ndarray) -> None:
    composed = (Rotation.from_quat(p) * Rotation.from_quat(q)).as_matrix()
    np.testing.assert_allclose(Rotation.from_quat(product(p, q)).as_matrix(), composed, atol=1e-12)


@given(UNIT)
def test_matrices_are_those_of_scipy(q: np.ndarray) -> None:
    matrix = Quaternions.from_xyzw(q).matrix()
    np.testing.assert_allclose(matrix, Rotation.from_quat(q).as_matrix(), atol=1e-12)
