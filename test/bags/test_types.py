"""Definitions of messages: ours, and those that bags bring."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recordings import (
    NAMES,
    START,
    TENDON_TENSIONS,
    TYPES,
    readings_of,
    tensions_data,
)
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import StoragePlugin, Writer

from octo_arm_model.arm.errors import BagError
from octo_arm_model.bags.types import types_for


def test_types_hash_as_those_the_message_package_was_built_from() -> None:
    support = pytest.importorskip('octo_arm_msgs.msg', reason='needs the message package')
    for name in ('TendonTensions', 'SectionStrains'):
        theirs = getattr(support, name).get_fields_and_field_types()
        ours = [field for field, _ in TYPES.fielddefs[f'octo_arm_msgs/msg/{name}'][1]]
        assert list(theirs) == ours


@pytest.mark.parametrize('version', [8, 9])
def test_the_definition_in_the_bag_wins(tmp_path: Path, version: int) -> None:
    text = 'std_msgs/Header header\nstring[] name\nfloat32[] tension\n' + '=' * 80
    _, rest = TYPES.generate_msgdef(TENDON_TENSIONS, ros_version=2)[0].split('=' * 80, 1)
    path = tmp_path / 'bag'
    with Writer(path, version=version, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection(
            '/tendon_tensions', TENDON_TENSIONS, msgdef=text + rest, rihs01='RIHS01_0'
        )
        full = tensions_data(TENDON_TENSIONS, NAMES, np.zeros(12), START)
        count = full[: len(full) - 12 * 8]
        # From where the count ends four-byte numbers need no padding.
        end = count.rindex(b'\x0c\0\0\0') + 4
        single = np.linspace(0.0, 1.1, 12).astype('<f4')
        writer.write(topic, START, count[:end] + single.tobytes())
    (reading,) = readings_of(path)
    np.testing.assert_array_equal(np.ravel(reading.tensions), single)


def test_a_definition_may_be_in_idl() -> None:
    rule = '=' * 80 + '\n'
    text = ''.join(
        f'{rule}IDL: {package}/msg/{name}\n'
        f'module {package} {{ module msg {{ struct {name} {{ {fields} }}; }}; }};\n'
        for package, name, fields in (
            ('octo_arm_msgs', 'TendonTensions',
             'std_msgs::msg::Header header; sequence<string> name; sequence<double> tension;'),
            ('std_msgs', 'Header', 'builtin_interfaces::msg::Time stamp; string frame_id;'),
            ('builtin_interfaces', 'Time', 'int32 sec; uint32 nanosec;'),
        )
    )  # fmt: skip
    definition = MessageDefinition(MessageDefinitionFormat.IDL, text)
    types = types_for(TENDON_TENSIONS, [definition])
    data = tensions_data(TENDON_TENSIONS, NAMES, np.arange(12.0), START)
    message = types.deserialize_cdr(data, TENDON_TENSIONS)
    np.testing.assert_array_equal(message.tension, np.arange(12.0))
    with pytest.raises(BagError, match='the definition of octo_arm_msgs/msg/TendonTensions makes'):
        types_for(TENDON_TENSIONS, [definition._replace(data='module {')])
