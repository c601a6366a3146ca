"""Tensions along tendons as bytes, read by the real serialiser and by their own field table."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

pytest.importorskip('rclpy', reason='needs ROS 2')

from clouds import profiles_of
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from octo_arm_model import ConfigError, Solver, load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.wire.backbone import TensionProfilesWriter

CONFIG = load_config(preset_path('renda2012_table4'))
TENSIONS = np.arange(1.0, 13.0).reshape(3, 4) / 40.0
TEXTS = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=40)


def solved(friction=0.0, stations=11):
    arm = dataclasses.replace(CONFIG.arm, friction=friction) if friction else CONFIG.arm
    return Solver(arm, 'exact', stations, CONFIG.base).solve(TENSIONS)


@given(
    frame=TEXTS, names=st.lists(TEXTS, min_size=12, max_size=12),
    stations=st.integers(4, 60), sec=st.integers(-(2**31), 2**31 - 1),
    nanosec=st.integers(0, 2**32 - 1),
)  # fmt: skip
@example('', [''] * 12, 4, -1, 2**32 - 1)
@example('触手😀', ['x', 'y', 'z', 's', *map(str, range(8))], 5, 7, 0)
def test_a_reader_finds_each_number_where_the_fields_say(frame, names, stations, sec, nanosec):
    backbone = CONFIG.solver('closed_form', stations).solve(TENSIONS)
    writer = TensionProfilesWriter(frame, backbone.s, names)
    for stamp in ((0, 0), (sec, nanosec)):  # the template holds another stamp by then
        ours = writer.write(backbone, *stamp)
    message = deserialize_message(ours, PointCloud2)
    assert len(serialize_message(message)) == len(ours)
    header = message.header
    assert (header.frame_id, header.stamp.sec, header.stamp.nanosec) == (frame, sec, nanosec)
    fields = [field.name for field in message.fields]
    assert fields == ['x', 'y', 'z', 's', *(f'tension_{name}' for name in names)]
    found = profiles_of(message)
    np.testing.assert_allclose(found[:, :3], backbone.position, rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(found[:, 3], backbone.s)
    np.testing.assert_array_equal(found[:, 4:], backbone.tendon_tensions)


def test_without_friction_tension_is_the_same_up_to_the_anchorage_and_none_beyond():
    backbone = solved()
    writer = TensionProfilesWriter('', backbone.s, CONFIG.arm.tendon_names)
    found = profiles_of(deserialize_message(writer.write(backbone, 0, 0), PointCloud2))
    anchorages = np.repeat([section.anchorage for section in CONFIG.arm.sections], 4)
    for tensions, anchorage, whole in zip(found.T[4:], anchorages, TENSIONS.ravel(), strict=True):
        np.testing.assert_array_equal(tensions, np.where(found[:, 3] <= anchorage, whole, 0.0))


def test_friction_lowers_tension_from_the_base_on_and_never_raises_it():
    backbone = solved(friction=(0.3,) * 12)
    writer = TensionProfilesWriter('', backbone.s, CONFIG.arm.tendon_names)
    tensions = profiles_of(deserialize_message(writer.write(backbone, 0, 0), PointCloud2))[:, 4:]
    np.testing.assert_allclose(tensions[0], TENSIONS.ravel(), rtol=1e-12)
    assert (np.diff(tensions, axis=0) <= 1e-12).all()
    assert (tensions[2] < 0.999 * tensions[0]).any()


def test_another_arm_is_refused():
    backbone = solved()
    for s, names in ((backbone.s[1:], CONFIG.arm.tendon_names), (backbone.s, ['one'])):
        with pytest.raises(ConfigError, match=r'tensions are of shape \(11, 12\), expected'):
            TensionProfilesWriter('', s, names).write(backbone, 0, 0)
    with pytest.raises(ConfigError, match='which UTF-8 cannot hold'):
        TensionProfilesWriter('', backbone.s, ['\ud800'])
