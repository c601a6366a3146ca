"""Messages of an estimate as bytes, against the definitions of their types."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='needs rosbags')
from estimation_arms import EVERYTHING, LIKELY, TENSIONS, rubber

from octo_arm_model.bags.types import known_types
from octo_arm_model.estimation.filter import Filter
from octo_arm_model.estimation.measurements import Tensions, TipPosition
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk
from octo_arm_model.wire.estimate import (
    BIAS,
    CONTACT,
    ESTIMATES,
    TIP_WRENCH,
    EstimateMessages,
    read_covariance,
)

ALWAYS = {
    'backbone/path', 'backbone/poses', 'strains', 'tip_pose', 'tendon_tension_estimates',
    'backbone/covariance',
}  # fmt: skip
AT = Unknowns(Walk(5.0), point_forces=(PointForce(0.12, LIKELY),))


def values_of(vector: object) -> list[float]:
    return [getattr(vector, axis) for axis in 'xyz']


@pytest.mark.parametrize(
    ('unknowns', 'more'),
    [(EVERYTHING, {TIP_WRENCH, BIAS}), (AT, {CONTACT}), (Unknowns(Walk(5.0)), set())],
)
def test_all_of_an_estimate_is_in_its_messages(unknowns: Unknowns, more: set[str]) -> None:
    model = rubber(unknowns)
    given = [Tensions(TENSIONS, 0.02), TipPosition([0.15, 0.05, 0.02], 0.05)]
    found = Filter(model).add(0.0, given)
    bytes_of = EstimateMessages('there', model).write(found, 7, 8)
    assert set(bytes_of) == ALWAYS | more
    types = known_types()
    read = {name: types.deserialize_cdr(data, ESTIMATES[name]) for name, data in bytes_of.items()}
    for name, message in read.items():
        assert bytes(types.serialize_cdr(message, ESTIMATES[name])) == bytes_of[name]
        header = message.header
        assert (header.frame_id, header.stamp.sec, header.stamp.nanosec) == ('there', 7, 8)
    path = [values_of(one.pose.position) for one in read['backbone/path'].poses]
    np.testing.assert_array_equal(path, found.backbone.position)
    covariance = read_covariance(read['backbone/covariance'])
    np.testing.assert_array_equal(covariance.pose, found.pose_covariance)
    tip = read['tip_pose'].pose.covariance.reshape(6, 6)
    np.testing.assert_array_equal(tip, found.pose_covariance[-1])
    np.testing.assert_array_equal(read['tendon_tension_estimates'].tension, found.tensions)
    if BIAS in more:
        np.testing.assert_array_equal(read[BIAS].tension, found.tension_bias)
    if TIP_WRENCH in more:
        wrench = read[TIP_WRENCH].wrench
        written = [*values_of(wrench.force), *values_of(wrench.torque)]
        np.testing.assert_array_equal(written, found.tip_wrench)
        np.testing.assert_array_equal(covariance.contact, found.tip_wrench_covariance)
    if CONTACT in more:
        force = values_of(read[CONTACT].wrench.force)
        np.testing.assert_array_equal(force, found.point_forces[0])
        assert covariance.contact_s == 0.12
