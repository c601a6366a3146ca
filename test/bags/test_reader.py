"""Bags of every version and storage read, their tensions, and those that are refused."""

import re
import sqlite3
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_array_equal
from recordings import (
    ARM,
    ARRAY,
    JOINT_STATE,
    NAMES,
    START,
    STEP,
    TENDON_TENSIONS,
    TOPICS,
    TYPES,
    Sample,
    random_tensions,
    readings_of,
    samples,
    tensions_data,
    text_sample,
    write_bag,
)
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import StoragePlugin, Writer

from octo_arm_model.arm.errors import BagError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.topics import TYPES as TENSION_TYPES
from octo_arm_model.bags.topics import ArmTopics
from octo_arm_model.bags.types import types_for
from octo_arm_model.bags.writer import STORAGES, BagWriter


def test_a_bag_by_the_writer_of_mcap_is_read(tmp_path):
    mcap = pytest.importorskip('mcap_ros2.writer', reason='needs mcap-ros2-support')
    path = tmp_path / 'theirs.mcap'
    tensions = random_tensions(ARM, 5)
    stamp = {'sec': 7, 'nanosec': 8}
    values = [row.ravel().tolist() for row in tensions]
    with path.open('wb') as stream:
        writer = mcap.Writer(stream)
        messages = {
            TENDON_TENSIONS: lambda row: {'tension': row},
            ARRAY: lambda row: {'layout': {'dim': [], 'data_offset': 0}, 'data': row},
            JOINT_STATE: lambda row: {'position': row[:1], 'velocity': [], 'effort': row},
        }
        topics = {topic: kind for topic, kind in TOPICS.items() if kind in messages}
        for topic, kind in topics.items():
            text, _ = TYPES.generate_msgdef(kind, ros_version=2)
            schema = writer.register_msgdef(kind, text)
            for number, row in enumerate(values):
                message = messages[kind](row)
                if kind != ARRAY:
                    message |= {'header': {'stamp': stamp, 'frame_id': ''}, 'name': list(NAMES)}
                time = START + number * STEP
                writer.write_message(topic, schema, message, time, time)
        writer.finish()
    for topic, kind in topics.items():
        found = readings_of(path, topic)
        assert_array_equal([one.tensions for one in found], tensions)
        stamps = {one.stamp.ns for one in found}
        assert stamps == (
            {7 * 10**9 + 8} if kind != ARRAY else {START + i * STEP for i in range(5)}
        )


def old_bag(path: Path, version: int, type_name: str = TENDON_TENSIONS) -> np.ndarray:
    """A bag of sqlite3 as the recorders of Foxy (4) to Jazzy (9) left it; returns the tensions."""
    tensions = random_tensions(ARM, 6)
    write_bag(path, samples(ARM, tensions), 'sqlite3')
    names = 'deadline', 'lifespan', 'liveliness_lease_duration'
    qos = {name: {'sec': 9223372036, 'nsec': 854775807} for name in names}
    qos |= {'history': 3, 'depth': 0, 'reliability': 1, 'durability': 2, 'liveliness': 1}
    text = yaml.safe_dump([qos | {'avoid_ros_namespace_conventions': False}])
    data = sqlite3.connect(path / f'{path.name}.db3')
    for table in ('schema', 'metadata', 'message_definitions'):
        data.execute(f'DROP TABLE {table}')
    data.execute('ALTER TABLE topics DROP COLUMN type_description_hash')
    data.execute('UPDATE topics SET type=?, offered_qos_profiles=?', (type_name, text))
    data.commit()
    data.close()
    file = path / 'metadata.yaml'
    whole = yaml.safe_load(file.read_text())
    about = whole['rosbag2_bagfile_information']
    about |= {'version': version, 'custom_data': {'operator': 'somebody'}}
    topic = about['topics_with_message_count'][0]['topic_metadata']
    topic |= {'type': type_name, 'offered_qos_profiles': text if version < 9 else [qos]}
    for since, part, name in (
        (5, about, 'files'),
        (6, about, 'custom_data'),
        (7, topic, 'type_description_hash'),
        (8, about, 'ros_distro'),
    ):
        if version < since:
            del part[name]
    file.write_text(yaml.safe_dump(whole))
    return tensions


@pytest.mark.parametrize('version', range(4, 10))
def test_bags_of_every_version_are_read_without_definitions(tmp_path, version):
    tensions = old_bag(tmp_path / 'bag', version)
    found = readings_of(tmp_path / 'bag')
    assert_array_equal([one.tensions for one in found], tensions)
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.metadata == ({'operator': 'somebody'} if version >= 6 else {})


def test_a_file_out_of_a_bag_is_read_alone(tmp_path):
    tensions = old_bag(tmp_path / 'old', 5)
    (tmp_path / 'old' / 'metadata.yaml').unlink()
    for path in (tmp_path / 'old' / 'old.db3', tmp_path / 'old'):
        assert_array_equal([one.tensions for one in readings_of(path)], tensions)
    with BagReader(tmp_path / 'old') as reader:
        assert '1 file(s) are read' in reader.notes[0] and 'ros2 bag reindex' in reader.notes[0]
    (tmp_path / 'old' / 'old.db3').unlink()
    with pytest.raises(BagError, match=r'neither metadata\.yaml nor \.mcap or \.db3'):
        BagReader(tmp_path / 'old')


def test_what_is_no_bag_is_refused_in_one_line(tmp_path):
    cases = {'no such bag': tmp_path / 'nothing'}
    for name in ('empty.mcap', 'empty.db3'):
        (tmp_path / name).write_bytes(b'')
        cases[f'{name}: not a bag'] = tmp_path / name
    for name in ('text.mcap', 'text.db3', 'text.txt'):
        (tmp_path / name).write_text('Once upon a time there was an octopus.' * 9)
        cases[f'{name}: not a bag'] = tmp_path / name
    for name, text in (
        ('list', '[1, 2]'),
        ('yaml', '{'),
        ('future', 'rosbag2_bagfile_information: {version: 99}'),
        ('null', 'rosbag2_bagfile_information: null'),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'metadata.yaml').write_text(text)
        cases[f'{name}: not a bag'] = tmp_path / name
    for expected, path in cases.items():
        with pytest.raises(BagError) as caught:
            BagReader(path)
        assert expected in str(caught.value)
        assert '\n' not in str(caught.value)


def test_a_type_that_nothing_defines_is_an_error(tmp_path):
    old_bag(tmp_path / 'bag', 5, 'robot_msgs/msg/Pull')
    with BagReader(tmp_path / 'bag') as reader:
        with pytest.raises(BagError, match=r'nothing defines the type robot_msgs/msg/Pull'):
            ArmTopics(reader).pick(None, ['robot_msgs/msg/Pull'], 'pulls')


def string_bag(path: Path, topics: dict[str, str]) -> Path:
    """A bag with one message on each of the ``topics``."""
    row = np.ones(12)
    content = [
        Sample(topic, kind, START, tensions_data(kind, NAMES, row, START))
        if kind in TENSION_TYPES
        else text_sample(topic, 'hello')
        for topic, kind in topics.items()
    ]
    return write_bag(path, content)


STRING, BOTH = {'/note': 'std_msgs/msg/String'}, {'/a': ARRAY, '/b': ARRAY}
LENGTHS = {'/tendon_lengths': JOINT_STATE}  # an answer of the model


@pytest.mark.parametrize(
    ('topics', 'wanted', 'expected'),
    [
        ({'/arm_1/tendon_tensions': TENDON_TENSIONS}, None, '/arm_1/tendon_tensions'),
        ({'/cells': ARRAY}, None, '/cells'),
        # The usual name wins.
        ({'/joints': JOINT_STATE, '/tendon_tensions': TENDON_TENSIONS}, None, '/tendon_tensions'),
        ({**LENGTHS, '/loads': JOINT_STATE}, None, '/loads'),
        (BOTH, '/b', '/b'),
        (BOTH, 'b', '/b'),
        # What cannot be picked is listed.
        (STRING, None, 'no tensions, expected octo_arm_msgs'),
        (STRING, None, 'it has /note (std_msgs/msg/String'),
        (LENGTHS, None, 'no tensions, expected octo_arm_msgs'),
        (BOTH, None, 'several topics of tensions, name one of /a, /b'),
        ({'/a': ARRAY}, '/b', 'no topic /b for tensions; it has /a (std_msgs'),
        (STRING, '/note', 'topic /note is of std_msgs/msg/String, ex'),
    ],
)
def test_the_topic_is_picked(tmp_path, topics, wanted, expected):
    with BagReader(string_bag(tmp_path / 'bag', topics)) as reader:
        if expected.startswith('/'):
            assert ArmTopics(reader).pick(wanted, TENSION_TYPES, 'tensions') == expected
        else:
            with pytest.raises(BagError, match=re.escape(expected)):
                ArmTopics(reader).pick(wanted, TENSION_TYPES, 'tensions')


def split_bag(path: Path, parts: list[list[Sample]], storage: str) -> Path:
    """A bag of as many files as there are ``parts``."""
    path.mkdir()
    names, whole = [], {}
    for number, part in enumerate(parts):
        one = write_bag(path.with_name(f'{path.name}_{number}'), part, storage)
        (file,) = (inside for inside in one.iterdir() if inside.name != 'metadata.yaml')
        whole = yaml.safe_load((one / 'metadata.yaml').read_text())
        names.append(file.rename(path / file.name).name)
    about = whole['rosbag2_bagfile_information']
    count = sum(map(len, parts))
    about |= {'relative_file_paths': names, 'message_count': count}
    about['topics_with_message_count'][0]['message_count'] = count
    (path / 'metadata.yaml').write_text(yaml.safe_dump(whole))
    return path


@pytest.mark.parametrize('storage', STORAGES)
def test_messages_of_several_files_come_in_the_order_of_receipt(tmp_path, storage):
    content = samples(ARM, random_tensions(ARM, 24))
    chained = [[content[k] for k in (i, i + 2) if k < 24] for i in range(24) if i % 4 < 2]
    for name, parts in {
        'as_recorded': [content[:8], content[8:16], content[16:]],
        'listed_backwards': [content[16:], content[8:16], content[:8]],
        'of_one_time': [content[::3], content[1::3], content[2::3]],
        'within': [content[:4] + content[20:], content[4:12], content[12:20]],
        # As where several topics are recorded, whose messages are written from a cache.
        'chained': chained,
    }.items():
        with BagReader(split_bag(tmp_path / name, parts, storage)) as reader:
            found = [one.received_ns for one in reader.messages()]
        assert found == [one.received_ns for one in content], name
    many = [content[number::12] for number in range(12)]
    with BagReader(split_bag(tmp_path / 'many', many, storage)) as reader:
        with pytest.raises(BagError, match='more than 8 files hold messages of the same time'):
            list(reader.messages())


def test_bytes_that_are_no_message_are_refused_with_the_time_of_receipt(tmp_path):
    content = samples(ARM, tensions := random_tensions(ARM, 3))
    content[1] = content[1]._replace(data=b'\0\1\0\0garbage')
    # What rclpy serialises, without positions and velocities, may end with bytes of no meaning.
    content[2] = content[2]._replace(data=bytes(content[2].data) + 8 * b'\x7f')
    found = readings_of(write_bag(tmp_path / 'bag', content))
    assert found[1].stamp.ns == content[1].received_ns
    assert 'bytes that are no octo_arm_msgs/msg/TendonTensions' in found[1].reason
    assert_array_equal(found[2].tensions, tensions[2])


# Definitions of messages: ours, and those that bags bring ----------------------------------------


def test_types_hash_as_those_the_message_package_was_built_from():
    support = pytest.importorskip('octo_arm_msgs.msg', reason='needs the message package')
    for name in ('TendonTensions', 'SectionStrains'):
        theirs = getattr(support, name).get_fields_and_field_types()
        ours = [field for field, _ in TYPES.fielddefs[f'octo_arm_msgs/msg/{name}'][1]]
        assert list(theirs) == ours


@pytest.mark.parametrize('version', [8, 9])
def test_the_definition_in_the_bag_wins(tmp_path, version):
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
    assert_array_equal(np.ravel(reading.tensions), single)


def test_a_definition_may_be_in_idl():
    rule = '=' * 80 + '\n'
    text = ''.join(
        f'{rule}IDL: {package}/msg/{name}\n'
        f'module {package} {{ module msg {{ struct {name} {{ {fields} }}; }}; }};\n'
        for package, name, fields in (
            (
                'octo_arm_msgs',
                'TendonTensions',
                'std_msgs::msg::Header header; sequence<string> name; sequence<double> tension;',
            ),
            ('std_msgs', 'Header', 'builtin_interfaces::msg::Time stamp; string frame_id;'),
            ('builtin_interfaces', 'Time', 'int32 sec; uint32 nanosec;'),
        )
    )
    definition = MessageDefinition(MessageDefinitionFormat.IDL, text)
    types = types_for(TENDON_TENSIONS, [definition])
    data = tensions_data(TENDON_TENSIONS, NAMES, np.arange(12.0), START)
    message = types.deserialize_cdr(data, TENDON_TENSIONS)
    assert_array_equal(message.tension, np.arange(12.0))
    with pytest.raises(BagError, match='the definition of octo_arm_msgs/msg/TendonTensions is'):
        types_for(TENDON_TENSIONS, [definition._replace(data='module {')])


# Written: whole or not at all --------------------------------------------------------------------


def test_a_bag_has_what_the_player_of_jazzy_looks_for(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write([(writer.add('/arm_description', 'std_msgs/msg/String', True), START, b'')])
        writer.write([(writer.add('/backbone/path', 'nav_msgs/msg/Path'), START, b'')])
    text = (tmp_path / 'bag' / 'metadata.yaml').read_text()
    information = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert information['version'] == 9
    assert information['storage_identifier'] == 'mcap'
    assert information['relative_file_paths'] == ['bag_0.mcap']
    assert (tmp_path / 'bag' / 'bag_0.mcap').is_file()
    latched, path = (one['topic_metadata'] for one in information['topics_with_message_count'])
    assert latched['type_description_hash'].startswith('RIHS01_')
    assert latched['serialization_format'] == 'cdr'
    (qos,) = latched['offered_qos_profiles']
    assert (qos['durability'], qos['reliability']) == ('transient_local', 'reliable')
    assert (qos['history'], qos['depth']) == ('keep_last', 1)
    (qos,) = path['offered_qos_profiles']
    assert (qos['durability'], qos['reliability']) == ('volatile', 'reliable')


def test_a_bag_does_not_replace_anything(tmp_path):
    (tmp_path / 'file').write_text('precious')
    (tmp_path / 'folder').mkdir()
    for name in ('file', 'folder'):
        with pytest.raises(BagError, match=f'{name}: exists already'):
            BagWriter(tmp_path / name)
    with pytest.raises(BagError, match='cannot be written: No such file or directory'):
        BagWriter(tmp_path / 'nowhere' / 'bag')
    with pytest.raises(BagError, match="storage is 'paper', expected one of mcap, sqlite3"):
        BagWriter(tmp_path / 'bag', 'paper')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['file', 'folder']
    assert (tmp_path / 'file').read_text() == 'precious'
