"""The chain rule from what a shape depends on to a state."""

from __future__ import annotations

import numpy as np
from estimation_arms import LIKELY, TENSIONS, WEIGHT, rubber
from scipy.spatial.transform import Rotation

from octo_arm_model.estimation.model import Part, Prediction, StateChange
from octo_arm_model.estimation.unknowns import Unknowns, Walk
from octo_arm_model.rod.sensitivity import Change

RNG = np.random.default_rng(0)
CHANGE = Change(RNG.normal(size=(5, 6, 3)), RNG.normal(size=(5, 4, 3)), RNG.normal(size=(2, 3)))


def test_every_component_changes_the_shape_through_what_it_changes() -> None:
    found = StateChange(
        5,
        [
            Part(slice(0, 2), CHANGE, slice(1, 3), np.array([2.0, -3.0])),
            Part(slice(2, 2), CHANGE, slice(None), np.ones(1)),
            Part(slice(4, 5), CHANGE, slice(0, 1), np.array([0.5])),
        ],
    )
    by_state = np.zeros((3, 5))
    by_state[1, 0], by_state[2, 1], by_state[0, 4] = 2.0, -3.0, 0.5
    for one, expected in (
        (found.pose, CHANGE.pose),
        (found.tip, CHANGE.tip),
        (found.strain, CHANGE.strain),
        (found.tendon_length, CHANGE.tendon_length),
    ):
        np.testing.assert_allclose(one, expected @ by_state)


def test_a_state_of_which_nothing_changes_the_shape_has_no_derivatives_but_zero() -> None:
    assert not StateChange(2, [Part(slice(0, 0), CHANGE, slice(None), np.ones(1))]).pose.any()


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
