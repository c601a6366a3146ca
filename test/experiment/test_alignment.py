"""The transform from the camera's frame to base_frame."""

from __future__ import annotations

import numpy as np
from experiments import circle, midline, one_tendon
from hypothesis import given
from hypothesis import strategies as st

from octo_arm_model.experiment.alignment import Alignment, align, undetermined

numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
turns = st.tuples(numbers, numbers, numbers).map(lambda v: 3.0 * np.array(v))


@given(turns, st.tuples(numbers, numbers, numbers))
def test_the_rigid_motion_of_points_is_found(turn: np.ndarray, shift: tuple[float, ...]) -> None:
    points = midline('closed_form', one_tendon(2.0))
    true = Alignment(turn, np.array(shift))
    found = align(true.to_camera(points), points)
    np.testing.assert_allclose(found.to_base(true.to_camera(points)), points, atol=1e-12)
    np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-9)


def test_what_an_alignment_leaves_open_is_said() -> None:
    line = np.linspace(0.0, 1.0, 10)[:, np.newaxis] * [1.0, 2.0, 0.5]
    assert 'rotation about it is open' in undetermined(line, 0.0)[0]
    assert 'mirror image' in undetermined(circle(), 0.0)[0]
    assert undetermined(np.concatenate([circle(), circle()[:, [0, 2, 1]]]), 1e-3) == ()
    assert 'no rotation' in undetermined(np.zeros((4, 3)), 0.0)[0]


def test_a_plane_is_told_from_an_arm_out_of_it_by_the_noise() -> None:
    # An arm of 200 mm goes 5.5 mm out of its plane.
    points = circle()
    points[:, 2] = 5.5e-3 * np.sin(np.linspace(0.0, 2.0 * np.pi, len(points)))
    noisy = points + 1e-4 * np.random.default_rng(0).standard_normal(points.shape)
    assert undetermined(noisy, 1e-4 * np.sqrt(3.0)) == ()
    assert 'mirror image' in undetermined(noisy, 5e-3)[0]
