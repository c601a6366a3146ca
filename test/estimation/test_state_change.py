"""A shape moved by what its derivatives say, as hypotheses beside the leading one are."""

from __future__ import annotations

import numpy as np
from estimation_arms import LIKELY, TENSIONS, WEIGHT, rubber
from scipy.spatial.transform import Rotation

from octo_arm_model.estimation.model import Prediction
from octo_arm_model.estimation.unknowns import Unknowns, Walk


def test_a_backbone_is_moved_to_first_order() -> None:
    model = rubber(Unknowns(Walk(0.3), tip_force=LIKELY), loads=WEIGHT)
    at = Prediction(model, np.append(TENSIONS, [0.004, -0.003, 0.006]), None)
    off = []
    for size in (1.0, 0.5):
        by = size * 1e-2 * at.x
        found = at.change.moved(at.solved, by, model.acting(at.x + by))
        expected = Prediction(model, at.x + by, at.solved).solved
        turned = (
            Rotation.from_quat(found.quaternion) * Rotation.from_quat(expected.quaternion).inv()
        )
        off.append([
            np.abs(found.position - expected.position).max(),
            turned.magnitude().max(),
            np.abs(found.k - expected.k).max(),
            np.abs(found.q - expected.q).max(),
        ])  # fmt: skip
        np.testing.assert_allclose(np.linalg.norm(found.quaternion, axis=1), 1.0)
        np.testing.assert_allclose(found.tensions.ravel(), (at.x + by)[:4])
        np.testing.assert_allclose(found.tip_wrench[:3], (at.x + by)[4:] + WEIGHT.tip_force)
    # What is left is of second order.
    np.testing.assert_array_less(off[1], 0.3 * np.array(off[0]))
    assert off[0][0] < 1e-4
