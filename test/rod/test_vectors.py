"""Rotation vectors and their derivatives."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from octo_arm_model.rod.rotations import left_jacobian

components = st.floats(-1.0, 1.0, allow_subnormal=False)


@given(st.tuples(components, components, components), st.sampled_from([1e-5, 1e-3, 3.0]))
def test_the_left_jacobian_is_the_derivative_of_a_rotation(
    direction: tuple[float, float, float], size: float
) -> None:
    turn = size * np.array(direction)
    small = np.array([1e-6, -2e-6, 3e-6])
    change = Rotation.from_rotvec(turn + small) * Rotation.from_rotvec(turn).inv()
    np.testing.assert_allclose(change.as_rotvec(), left_jacobian(turn) @ small, atol=1e-10)
