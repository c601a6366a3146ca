"""Bags read and written: every version and storage, and those that are broken."""

from __future__ import annotations

import dataclasses
import json
import sqlite3
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip('rosbags', reason='needs rosbags')

from recordings import (
    ARRAY,
    JOINT_STATE,
    START,
    STEP,
    TENDON_TENSIONS,
    TYPES,
    Sample,
    fingerprint,
    random_tensions,
    samples,
    tensions_data,
    text_sample,
    write_bag,
)
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import StoragePlugin, Writer

from octo_arm_model import Config, load_config
from octo_arm_model.bags.demo import (
    CAMERA_POSITION,
    CAMERA_QUATERNION,
    Experiment,
    add_demo,
    custom_data,
)
from octo_arm_model.bags.reader import BagReader, stamp_of
from octo_arm_model.bags.tensions import TYPES as TENSION_TYPES
from octo_arm_model.bags.tensions import Reading, TensionTopic, read_tensions
from octo_arm_model.bags.types import types_for
from octo_arm_model.bags.writer import STORAGES, BagWriter
from octo_arm_model.cli.main import main
from octo_arm_model.config.config import load_parameters, parse_parameters
from octo_arm_model.config.paper_data import PROTOTYPE_ERRORS
from octo_arm_model.config.presets import preset_path
from octo_arm_model.core.errors import BagError
from octo_arm_model.core.numerics.quaternion import Quaternions

CONFIG = load_config(preset_path('renda2012_table4'))
ARM = CONFIG.arm
NAMES = ARM.tendon_names
TOPICS = {
    '/tendon_tensions': TENDON_TENSIONS,
    '/tendon_tensions/array': ARRAY,
    '/tendon_tensions/joint_state': JOINT_STATE,
}
# Hypothesis has no fixtures that last for all examples.
FOLDER = tempfile.TemporaryDirectory()
BAG_OF_ALL = write_bag(
    Path(FOLDER.name) / 'all',
    [one for topic, kind in TOPICS.items() for one in samples(ARM, np.ones((1, 12)), topic, kind)],
)
FLIPPED = next(BAG_OF_ALL.glob('*.mcap')).read_bytes()


def readings_of(path: Path, topic: str = '/tendon_tensions') -> list[Reading]:
    with BagReader(path) as reader:
        return list(read_tensions(reader, topic, CONFIG))


# What comes in is what went out -----------------------------------------------------------------


@pytest.mark.parametrize('storage', STORAGES)
def test_what_is_written_is_read(tmp_path: Path, storage: str) -> None:
    content = [
        sample
        for topic, kind in TOPICS.items()
        for sample in samples(ARM, random_tensions(ARM, 40), topic, kind)
    ]
    content.sort(key=lambda sample: sample.received_ns)
    with BagWriter(tmp_path / 'bag', storage, {'arm': 'left'}) as writer:
        topics = {topic: writer.add(topic, kind) for topic, kind in TOPICS.items()}
        writer.write((topics[one.topic], one.received_ns, one.data) for one in content)
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.topics == TOPICS
        assert reader.metadata == {'arm': 'left'}
        assert reader.count() == 120
        assert reader.count(['/tendon_tensions']) == 40
        assert reader.start_ns == content[0].received_ns
        assert reader.duration == pytest.approx(39 * STEP * 1e-9)
        assert [tuple(record) for record in reader.messages()] == [tuple(one) for one in content]


@pytest.mark.parametrize('storage', STORAGES)
def test_the_files_are_those_rosbags_writes_itself(tmp_path: Path, storage: str) -> None:
    content = samples(ARM, random_tensions(ARM, 300))
    content += samples(ARM, random_tensions(ARM, 300), '/tendon_tensions/array', ARRAY)
    (tmp_path / 'theirs').mkdir()
    plugin = StoragePlugin[storage.upper()]
    with Writer(tmp_path / 'theirs' / 'bag_0', version=9, storage_plugin=plugin) as theirs:
        add = theirs.add_connection
        topics = {topic: add(topic, kind, typestore=TYPES) for topic, kind in list(TOPICS.items())}
        for one in content:
            theirs.write(topics[one.topic], one.received_ns, one.data * 9)
    with BagWriter(tmp_path / 'bag', storage) as ours:
        with BagReader(tmp_path / 'theirs' / 'bag_0') as reader:
            copies = {c.topic: ours.add_copy(reader, c) for c in reader.connections()}
        ours.write((copies[one.topic], one.received_ns, one.data * 9) for one in content)
    if storage == 'mcap':
        assert fingerprint(tmp_path / 'bag') == fingerprint(tmp_path / 'theirs' / 'bag_0')
    with BagReader(tmp_path / 'bag') as ours, BagReader(tmp_path / 'theirs' / 'bag_0') as theirs:
        assert list(ours.messages()) == list(theirs.messages())


def test_a_bag_has_what_the_player_of_jazzy_looks_for(tmp_path: Path) -> None:
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


def test_types_hash_as_those_the_message_package_was_built_from() -> None:
    support = pytest.importorskip('octo_arm_msgs.msg', reason='needs the message package')
    for name in ('TendonTensions', 'SectionStrains'):
        theirs = getattr(support, name).get_fields_and_field_types()
        ours = [field for field, _ in TYPES.fielddefs[f'octo_arm_msgs/msg/{name}'][1]]
        assert list(theirs) == ours


# Bags of others ---------------------------------------------------------------------------------


def test_a_bag_by_the_writer_of_mcap_is_read(tmp_path: Path) -> None:
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
        for topic, kind in TOPICS.items():
            text, _ = TYPES.generate_msgdef(kind, ros_version=2)
            schema = writer.register_msgdef(kind, text)
            for number, row in enumerate(values):
                message = messages[kind](row)
                if kind != ARRAY:
                    message |= {'header': {'stamp': stamp, 'frame_id': ''}, 'name': list(NAMES)}
                time = START + number * STEP
                writer.write_message(topic, schema, message, time, time)
        writer.finish()
    for topic, kind in TOPICS.items():
        found = readings_of(path, topic)
        np.testing.assert_array_equal([one.tensions for one in found], tensions)
        stamps = {one.stamp_ns for one in found}
        assert stamps == (
            {7 * 10**9 + 8} if kind != ARRAY else {START + i * STEP for i in range(5)}
        )


def old_bag(path: Path, version: int, type_name: str = TENDON_TENSIONS) -> np.ndarray:
    """A bag of sqlite3 as the recorders of Foxy (4) to Jazzy (9) left it; returns the tensions."""
    tensions = random_tensions(ARM, 6)
    path.mkdir()
    data = sqlite3.connect(path / 'bag_0.db3')
    qos = '- history: 3\n  depth: 0\n  reliability: 1\n  durability: 2\n  ' + ''.join(
        f'{name}:\n    sec: 9223372036\n    nsec: 854775807\n  '
        for name in ('deadline', 'lifespan', 'liveliness_lease_duration')
    )
    qos += 'liveliness: 1\n  avoid_ros_namespace_conventions: false'
    data.execute(
        'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, '
        'serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)'
    )
    data.execute(
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, '
        'timestamp INTEGER NOT NULL, data BLOB NOT NULL)'
    )
    data.execute('CREATE INDEX timestamp_idx ON messages (timestamp ASC)')
    data.execute('INSERT INTO topics VALUES(1, "/tendon_tensions", ?, "cdr", ?)', (type_name, qos))
    for one in samples(ARM, tensions):
        data.execute(
            'INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)',
            (one.received_ns, one.data),
        )
    data.commit()
    data.close()
    start = {'nanoseconds_since_epoch': START}
    duration = {'nanoseconds': 5 * STEP}
    topic = {
        'name': '/tendon_tensions',
        'type': type_name,
        'serialization_format': 'cdr',
        'offered_qos_profiles': qos if version < 9 else yaml.safe_load(qos),
    }
    information: dict[str, Any] = {
        'version': version,
        'storage_identifier': 'sqlite3',
        'relative_file_paths': ['bag_0.db3'],
        'duration': duration,
        'starting_time': start,
        'message_count': 6,
        'topics_with_message_count': [{'topic_metadata': topic, 'message_count': 6}],
        'compression_format': '',
        'compression_mode': '',
    }
    file = {'path': 'bag_0.db3', 'starting_time': start, 'duration': duration, 'message_count': 6}
    if version >= 5:
        information['files'] = [file]
    if version >= 6:
        information['custom_data'] = {'operator': 'somebody'}
    if version >= 7:
        topic['type_description_hash'] = ''
    if version >= 8:
        information['ros_distro'] = 'rolling'
    content = yaml.safe_dump({'rosbag2_bagfile_information': information})
    (path / 'metadata.yaml').write_text(content)
    return tensions


@pytest.mark.parametrize('version', range(4, 10))
def test_bags_of_every_version_are_read_without_definitions(tmp_path: Path, version: int) -> None:
    tensions = old_bag(tmp_path / 'bag', version)
    found = readings_of(tmp_path / 'bag')
    np.testing.assert_array_equal([one.tensions for one in found], tensions)
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.metadata == ({'operator': 'somebody'} if version >= 6 else {})


def test_a_file_out_of_a_bag_is_read_alone(tmp_path: Path) -> None:
    tensions = old_bag(tmp_path / 'old', 5)
    (tmp_path / 'old' / 'metadata.yaml').unlink()
    found = readings_of(tmp_path / 'old' / 'bag_0.db3')
    np.testing.assert_array_equal([one.tensions for one in found], tensions)
    with pytest.raises(BagError, match=r'no metadata\.yaml.*\.mcap or \.db3'):
        BagReader(tmp_path / 'old')


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


# What is no bag, or not the one that was wanted -------------------------------------------------


def test_what_is_no_bag_is_refused_in_one_line(tmp_path: Path) -> None:
    cases: dict[str, Path] = {'no such bag': tmp_path / 'nothing'}
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


@pytest.mark.parametrize('storage', STORAGES)
@pytest.mark.parametrize('kept', [0.03, 0.3, 0.6, 0.97])
def test_a_bag_cut_short_is_an_error(tmp_path: Path, storage: str, kept: float) -> None:
    path = write_bag(tmp_path / 'bag', samples(ARM, random_tensions(ARM, 2000)), storage)
    (file,) = (one for one in path.iterdir() if one.suffix in ('.mcap', '.db3'))
    whole = file.read_bytes()
    file.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(BagError, match=r'cut short or damaged|messages found of') as caught:
        readings_of(path)
    assert '\n' not in str(caught.value)


@given(st.integers(0, 2**32 - 1))
def test_flipped_bytes_are_an_error_or_no_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(FLIPPED)
    for place in rng.integers(0, len(data), 3):
        data[place] ^= 1 << int(rng.integers(8))
    path = Path(FOLDER.name) / 'flipped.mcap'
    path.write_bytes(data)
    try:
        found = readings_of(path)
    except BagError as error:
        assert '\n' not in str(error)
    else:
        assert all((one.tensions is None) == bool(one.reason) for one in found)


def test_fewer_messages_than_the_bag_says_are_an_error(tmp_path: Path) -> None:
    old_bag(tmp_path / 'bag', 9)
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    metadata.write_text(metadata.read_text().replace('message_count: 6', 'message_count: 7'))
    with pytest.raises(BagError, match='6 messages found of 7'):
        readings_of(tmp_path / 'bag')


def test_a_type_that_nothing_defines_is_an_error(tmp_path: Path) -> None:
    old_bag(tmp_path / 'bag', 5, 'robot_msgs/msg/Pull')
    with BagReader(tmp_path / 'bag') as reader:
        with pytest.raises(BagError, match=r'nothing defines the type robot_msgs/msg/Pull'):
            reader.pick(None, ['robot_msgs/msg/Pull'], 'pulls')


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


@pytest.mark.parametrize(
    ('topics', 'wanted', 'expected'),
    [
        ({'/tendon_tensions': TENDON_TENSIONS}, None, '/tendon_tensions'),
        ({'/arm_1/tendon_tensions': TENDON_TENSIONS}, None, '/arm_1/tendon_tensions'),
        ({'/cells': ARRAY}, None, '/cells'),
        # The usual name wins, and an answer of the model is none.
        ({'/joint_states': JOINT_STATE, **{'/tendon_tensions': TENDON_TENSIONS}}, None,
         '/tendon_tensions'),
        ({'/tendon_lengths': JOINT_STATE, '/loads': JOINT_STATE}, None, '/loads'),
        ({'/a': ARRAY, '/b': ARRAY}, '/b', '/b'),
        ({'/a': ARRAY, '/b': ARRAY}, 'b', '/b'),
    ],
)  # fmt: skip
def test_the_topic_is_picked(
    tmp_path: Path, topics: dict[str, str], wanted: str | None, expected: str
) -> None:
    with BagReader(string_bag(tmp_path / 'bag', topics)) as reader:
        assert reader.pick(wanted, TENSION_TYPES, 'tensions') == expected


@pytest.mark.parametrize(
    ('topics', 'wanted', 'expected'),
    [
        ({'/note': 'std_msgs/msg/String'}, None, r'no tensions.*it has /note \(std_msgs/msg/Str'),
        ({'/a': ARRAY, '/b': ARRAY}, None, r'several topics of tensions, name one of /a, /b$'),
        ({'/a': ARRAY}, '/b', r'no topic /b for tensions; it has /a \(std_msgs'),
        ({'/note': 'std_msgs/msg/String'}, '/note', r'topic /note is of std_msgs/msg/String, ex'),
        ({'/tendon_lengths': JOINT_STATE}, None, r'no tensions, expected octo_arm_msgs'),
    ],
)
def test_what_cannot_be_picked_is_listed(
    tmp_path: Path, topics: dict[str, str], wanted: str | None, expected: str
) -> None:
    with BagReader(string_bag(tmp_path / 'bag', topics)) as reader:
        with pytest.raises(BagError, match=expected):
            reader.pick(wanted, TENSION_TYPES, 'tensions')


# Tensions ---------------------------------------------------------------------------------------


def test_a_stamp_is_that_of_the_header_or_of_receipt() -> None:
    message = TYPES.deserialize_cdr(tensions_data(ARRAY, NAMES, np.ones(12), 7), ARRAY)
    assert stamp_of(message, 5) == (0, 5)
    for stamp, expected in ((7, (0, 7)), (0, (0, 5)), (3 * 10**9 + 4, (3, 4))):
        data = tensions_data(JOINT_STATE, NAMES, np.ones(12), stamp)
        assert stamp_of(TYPES.deserialize_cdr(data, JOINT_STATE), 5) == expected


BAD = {
    'NaN': (NAMES, [np.nan] * 12, 'tendon_1_1 is nan N'),
    'negative': (NAMES, [-0.5] * 12, 'tendon_1_1 is -0.5 N'),
    'too few': (NAMES[:11], [0.1] * 11, 'no tension for tendon tendon_3_4'),
    'too many': ((*NAMES, 'elbow'), [0.1] * 13, 'unknown tendon elbow'),
    'lengths': (NAMES, [0.1] * 11, 'name has 12 entries but tension has 11'),
    'twice': ((*NAMES[:11], NAMES[0]), [0.1] * 12, 'named more than once: tendon_1_1'),
}


@pytest.mark.parametrize('case', BAD)
def test_what_does_not_fit_is_refused_in_its_place(tmp_path: Path, case: str) -> None:
    names, values, reason = BAD[case]
    content = samples(ARM, random_tensions(ARM, 300))
    bad = tensions_data(TENDON_TENSIONS, names, values, START + 150 * STEP)
    content[150] = content[150]._replace(data=bad)
    found = readings_of(write_bag(tmp_path / 'bag', content))
    assert [i for i, one in enumerate(found) if one.tensions is None] == [150]
    assert reason in found[150].reason
    assert found[150].stamp_ns == START + 150 * STEP


def test_bytes_that_are_no_message_are_refused_with_the_time_of_receipt(tmp_path: Path) -> None:
    content = samples(ARM, random_tensions(ARM, 3))
    content[1] = content[1]._replace(data=b'\0\1\0\0garbage')
    found = readings_of(write_bag(tmp_path / 'bag', content))
    assert found[1].stamp_ns == content[1].received_ns
    assert 'bytes that are no octo_arm_msgs/msg/TendonTensions' in found[1].reason


@st.composite
def messages(draw: st.DrawFn) -> list[tuple[str, bytes]]:
    """Messages of one type, most of them alike but for stamp and numbers."""
    kind = draw(st.sampled_from(list(TOPICS.values())))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    some = []
    for _ in range(draw(st.integers(1, 12))):
        values = rng.uniform(0.0, 1.0, 12)
        order = rng.permutation(12)
        names = [NAMES[i] for i in order] if draw(st.integers(0, 3)) == 0 else list(NAMES)
        change: dict[str, Any] = {}
        what = draw(st.integers(0, 9))
        if what == 0:
            values[draw(st.integers(0, 11))] = draw(st.sampled_from([np.nan, np.inf, -1.0, 1e300]))
        elif what == 1:
            values = values[: draw(st.integers(0, 11))]
        elif what == 2 and kind == JOINT_STATE:
            change = {'position': rng.normal(size=draw(st.sampled_from([3, 12])))}
            change['velocity'] = rng.normal(size=15 - change['position'].size)
        elif what == 3:
            names[0] = draw(st.sampled_from(['elbow', NAMES[1]]))
        data = tensions_data(kind, names, values, draw(st.sampled_from([0, 1, START])), **change)
        if what == 4:
            data = data[: draw(st.integers(0, len(data)))]
        some.append((kind, data))
    return some


@given(messages())
def test_messages_read_together_are_those_read_one_by_one(some: list[tuple[str, bytes]]) -> None:
    kind = some[0][0]
    with BagReader(BAG_OF_ALL) as reader:
        (topic,) = (topic for topic, own in TOPICS.items() if own == kind)
        first = next(reader.messages([topic]))
        records = [first._replace(data=data, received_ns=i) for i, (_, data) in enumerate(some)]
        topic_of_all = TensionTopic(reader, CONFIG)
        found = topic_of_all.read(records) + topic_of_all.read(records)
        expected = [TensionTopic(reader, CONFIG).read([record])[0] for record in records]
    for one, other in zip(found, expected * 2, strict=True):
        assert (one.stamp_ns, one.reason) == (other.stamp_ns, other.reason)
        np.testing.assert_array_equal(one.tensions, other.tensions)


# Bags are whole or not there --------------------------------------------------------------------


@pytest.mark.parametrize('storage', STORAGES)
@pytest.mark.parametrize('error', [KeyboardInterrupt, MemoryError, ValueError])
def test_an_interrupted_bag_is_not_there(tmp_path: Path, storage: str, error: type) -> None:
    with pytest.raises(error):
        with BagWriter(tmp_path / 'bag', storage) as writer:
            topic = writer.add('/tendon_tensions', TENDON_TENSIONS)
            writer.write([(topic, START, b'1234') for _ in range(1000)])
            assert not (tmp_path / 'bag').exists()
            raise error
    assert list(tmp_path.iterdir()) == []


def test_a_bag_does_not_replace_anything(tmp_path: Path) -> None:
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


# The made-up experiment -------------------------------------------------------------------------

PROTOTYPE = load_parameters(preset_path('renda2012_prototype'))
CLEAN = Experiment(
    clock_offset=0.25, hold=1.0, ramp=0.5, camera_rate=4.0, tension_noise=0.0, midline_noise=0.0,
    dropped=0.0, outliers=0.0,
)  # fmt: skip


def test_the_demo_without_noise_is_the_exact_arm_seen_by_the_camera(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag', custom=custom_data(CLEAN, 0)) as writer:
        add_demo(writer, PROTOTYPE, CLEAN, 0)
    stiffer = {'model': 'exact', 'material.youngs_modulus': 1.1 * 110000.0}
    config = Config.from_parameters({**PROTOTYPE, **stiffer})
    solver = config.solver()
    rotation = Quaternions.from_xyzw(CAMERA_QUATERNION).matrix()
    seen = 0
    with BagReader(tmp_path / 'bag') as reader:
        tensions = {
            one.stamp_ns: one.tensions for one in read_tensions(reader, '/tendon_tensions', config)
        }
        highest = max(float(np.max(row)) for row in tensions.values())
        assert highest == max(PROTOTYPE_ERRORS)
        for record in reader.messages(['/camera/midline']):
            message = reader.decode(record)
            stamp = stamp_of(message, 0)
            assert stamp.ns == record.received_ns + 250_000_000
            points = [one.pose.position for one in message.poses]
            points = np.array([[p.x, p.y, p.z] for p in points]) @ rotation.T + CAMERA_POSITION
            expected = solver.solve(tensions[record.received_ns])
            np.testing.assert_allclose(points[-1], expected.tip, atol=1e-9)
            np.testing.assert_allclose(points[0], expected.position[0], atol=1e-12)
            seen += 1
    assert seen > 40


def test_the_demo_says_everywhere_that_it_is_synthetic(tmp_path: Path) -> None:
    arguments = ['record-demo', str(tmp_path / 'bag'), '--seed', '3', '--storage', 'sqlite3']
    assert main(arguments) == 0
    with BagReader(tmp_path / 'bag') as reader:
        assert 'synthetic' in reader.metadata['note']
        truth = json.loads(reader.metadata['truth'])
        assert truth['seed'] == 3
        assert truth['stiffness'] == 1.1
        (note,) = reader.messages(['/note'])
        assert reader.decode(note).data == reader.metadata['note']
        (description,) = reader.messages(['/arm_description'])
        text = reader.decode(description).data
        assert Config.from_parameters(parse_parameters(text, 'it')) == load_config(
            preset_path('renda2012_prototype')
        )
        midlines = reader.count(['/camera/midline'])
        assert 0.85 * 390 < midlines < 390
        assert all(not one.reason for one in read_tensions(reader, '/tendon_tensions', load_config(
            preset_path('renda2012_prototype'))))  # fmt: skip


def test_the_demo_is_the_same_for_the_same_seed(tmp_path: Path) -> None:
    few = dataclasses.replace(CLEAN, midline_noise=1e-3, tension_noise=0.01, dropped=0.2)
    found = []
    for name, seed in (('a', 1), ('b', 1), ('c', 2)):
        with BagWriter(tmp_path / name) as writer:
            add_demo(writer, PROTOTYPE, few, seed)
        with BagReader(tmp_path / name) as reader:
            found.append([tuple(record) for record in reader.messages()])
    assert found[0] == found[1]
    assert found[0] != found[2]


def test_the_demo_refuses_nonsense(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options, expected in (
        (['--stiffness', '-1'], '--stiffness is -1.0, expected a finite number > 0'),
        (['--clock-offset', 'nan'], '--clock-offset is nan, expected a finite number'),
        (['--config', 'octopus'], "no preset arm 'octopus'"),
    ):
        assert main(['record-demo', str(tmp_path / 'bag'), *options]) == 2
        assert expected in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
