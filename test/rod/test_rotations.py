"""Rotation vectors, quaternions and their derivatives."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from octo_arm_model.rod.rotations import axes_of, left_jacobian, quaternion_product

components = st.floats(-1.0, 1.0, allow_subnormal=False)


@given(st.tuples(components, components, components), st.sampled_from([1e-5, 1e-3, 3.0]))
def test_the_left_jacobian_is_the_derivative_of_a_rotation(
    direction: tuple[float, float, float], size: float
) -> None:
    turn = size * np.array(direction)
    small = np.array([1e-6, -2e-6, 3e-6])
    change = Rotation.from_rotvec(turn + small) * Rotation.from_rotvec(turn).inv()
    np.testing.assert_allclose(change.as_rotvec(), left_jacobian(turn) @ small, atol=1e-10)


def test_quaternions_turn_as_those_of_scipy() -> None:
    first, second = (Rotation.random(7, random_state=seed) for seed in (1, 2))
    found = axes_of(quaternion_product(first.as_quat(), second.as_quat()))
    np.testing.assert_allclose(np.moveaxis(found, -1, 0), (first * second).as_matrix(), atol=1e-15)
    one = quaternion_product(first.as_quat(), second.as_quat()[0])
    np.testing.assert_allclose(
        np.moveaxis(axes_of(one), -1, 0), (first * second[0]).as_matrix(), atol=1e-15
    )
