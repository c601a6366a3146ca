"""The markers of an estimate, read by the real serialiser."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')

from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from octo_arm_model import Solver, load_config
from octo_arm_model.analysis.drawing import (
    ARROW_TRIANGLES,
    CONE_TRIANGLES,
    UncertaintyDrawing,
)
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.wire.markers import UncertaintyMarkersWriter

ARM = load_config(preset_path('renda2012_prototype')).arm
SHAPE = Solver(ARM, 'exact', 21).solve([[1.0, 0.4, 0.3, 0.5]])
COVARIANCE, OF_FORCE = np.tile(1e-6 * np.eye(3), (21, 1, 1)), 1e-6 * np.eye(3)
FORCE = np.array([0.0, -0.006, 0.01])


def markers(force, frame='arm_base'):
    writer = UncertaintyMarkersWriter(ARM, SHAPE.s, frame)
    data = writer.write(
        SHAPE.position, SHAPE.quaternion, COVARIANCE, ARM.length, force, OF_FORCE, 3, 4
    )
    message = deserialize_message(data, MarkerArray)
    assert len(serialize_message(message)) == len(data)
    for marker in message.markers:
        assert (marker.header.frame_id, marker.header.stamp.sec) == (frame, 3)
        assert marker.header.stamp.nanosec == 4 and marker.type == Marker.TRIANGLE_LIST
        assert marker.pose.orientation.w == 1.0 and marker.scale.x == marker.scale.z == 1.0
    return {marker.ns: marker for marker in message.markers}


def points(marker):
    return np.array([(p.x, p.y, p.z) for p in marker.points])


@pytest.mark.parametrize('frame', ['arm_base', '', '触手'])
def test_the_markers_are_the_tube_and_the_arrow_in_its_cone(frame):
    found = markers(FORCE, frame)
    drawing = UncertaintyDrawing(ARM, SHAPE.s)
    tube = drawing.tube(SHAPE.position, SHAPE.quaternion, COVARIANCE)[drawing.triangles]
    arrow = drawing.arrow(SHAPE.tip, FORCE, OF_FORCE)
    for name, expected in (
        ('covariance', tube),
        ('contact', arrow.shaft[ARROW_TRIANGLES]),
        ('cone', arrow.cone[CONE_TRIANGLES]),
    ):
        np.testing.assert_array_equal(points(found[name]), expected.reshape(-1, 3))
        assert found[name].action == Marker.ADD
    assert found['contact'].color.a == 1.0 and 0.0 < found['covariance'].color.a < 0.5


def test_a_force_that_may_be_none_is_deleted():
    found = markers(0.1 * FORCE)
    assert [found[name].action for name in ('covariance', 'contact', 'cone')] == [
        Marker.ADD, Marker.DELETE, Marker.DELETE
    ]  # fmt: skip
    assert not found['contact'].points
