"""Poses of the bases of eight arms around a body."""

import itertools

import numpy as np
from rotations import matrix_of

from octo_arm_model.analysis.drawing import ARMS, base_pose


def test_octopus_has_its_arms_evenly_around_its_body():
    poses = [base_pose(number, 0.05) for number in range(1, ARMS + 1)]
    positions = np.array([position for position, _ in poses])
    np.testing.assert_allclose(np.linalg.norm(positions, axis=1), 0.05)
    gaps = [np.linalg.norm(a - b) for a, b in itertools.pairwise([*positions, positions[0]])]
    np.testing.assert_allclose(gaps, gaps[0])
    for position, quaternion in poses:
        turn = matrix_of(quaternion)
        np.testing.assert_allclose(turn[:, 0] * 0.05, position, atol=1e-12)
        np.testing.assert_allclose(turn[:, 2], [0.0, 0.0, 1.0], atol=1e-12)
