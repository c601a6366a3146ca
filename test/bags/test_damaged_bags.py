"""Bags that are damaged or mean harm: refused in one line, within bounds, and no loss unsaid."""

import json
import os
import random
import socket
import sqlite3
import struct
import sys
import tracemalloc
from collections.abc import Callable, Iterator
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import pytest
import yaml
from recordings import (
    START,
    TENDON_TENSIONS,
    TYPES,
    random_tensions,
    samples,
    text_sample,
    write_bag,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from octo_arm_model import load_config
from octo_arm_model.arm.errors import BagError
from octo_arm_model.bags import storages
from octo_arm_model.bags.outputs import Experiment, add_demo
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.writer import STORAGES, BagWriter
from octo_arm_model.config.parameter_files import load_parameters, parameters_as_yaml, preset_path

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

PRESET = preset_path('renda2012_prototype')
ARM = load_config(PRESET).arm
CONTENT = [
    text_sample('/arm_description', parameters_as_yaml(load_parameters(PRESET))),
    *samples(ARM, random_tensions(ARM, 50)),
]
MIB = 2**20


def bag(path: Path, storage: str = 'mcap') -> Path:
    return write_bag(path, CONTENT, storage)


def compressed_bag(path: Path, mode: CompressionMode, storage: str = 'mcap') -> Path:
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topic = writer.add_connection('/tendon_tensions', TENDON_TENSIONS, typestore=TYPES)
        for one in CONTENT[1:]:
            writer.write(topic, one.received_ns, one.data)
    return path


def file_of(path: Path) -> Path:
    """The file of the bag at ``path`` that holds the messages."""
    (file,) = (one for one in path.iterdir() if one.name != 'metadata.yaml')
    return file


def single(path: Path, storage: str = 'mcap') -> Path:
    """Such a file without its metadata, which would say how many there are."""
    file = file_of(bag(path, storage))
    return file.rename(path.with_suffix(file.suffix))


def change(file: Path, *statements: str) -> Path:
    """Change an SQLite ``file``."""
    data = sqlite3.connect(file)
    for statement in statements:
        data.execute(statement)
    data.commit()
    data.close()
    return file


def problem_of(path: Path) -> str:
    """What is said of the bag at ``path``, which is refused, in one line."""
    with pytest.raises(BagError) as caught:
        with BagReader(path) as reader:
            list(reader.messages())
    assert '\n' not in str(caught.value)
    return str(caught.value)


def found_in(path: Path) -> tuple[list[tuple[str, int, bytes]], list[str]]:
    with BagReader(path) as reader:
        found = sorted((one.topic, one.received_ns, one.data) for one in reader.messages())
        return found, reader.notes


# What asks for too much -------------------------------------------------------------------------


def record(kind: int, data: bytes) -> bytes:
    return struct.pack('<BQ', kind, len(data)) + data


def text(value: bytes) -> bytes:
    return struct.pack('<I', len(value)) + value


def chunk_alone(compression: bytes, data: bytes, size: int) -> bytes:
    """An MCAP file of one chunk that claims to expand to ``size`` bytes, without an index."""
    magic = b'\x89MCAP0\r\n'
    head = struct.pack('<QQQI', 1, 2, size, 0) + text(compression) + struct.pack('<Q', len(data))
    footer = record(2, struct.pack('<QQI', 0, 0, 0))
    return magic + record(1, text(b'ros2') + text(b'')) + record(6, head + data) + footer + magic


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
@pytest.mark.parametrize(
    ('claimed', 'expected'),
    [
        (8 * 2**30, 'of 8589934592 bytes, at most 268435456 are read'),
        (100, 'a chunk expands to more than 100 bytes'),
        (20 * MIB, 'a chunk expands to more than 20971520 bytes'),
    ],
)
def test_a_chunk_that_expands_out_of_bounds_takes_no_memory(
    tmp_path, compression, claimed, expected
):
    expand = {'zstd': zstd.compress, 'lz4': lz4.frame.compress}[compression]
    path = tmp_path / 'bomb.mcap'
    path.write_bytes(chunk_alone(compression.encode(), expand(bytes(64 * MIB)), claimed))
    tracemalloc.start()
    problem = problem_of(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert expected in problem
    assert peak < 50 * MIB


@pytest.mark.parametrize('storage', STORAGES)
def test_compressed_messages_are_bounded(tmp_path, monkeypatch, storage):
    path = compressed_bag(tmp_path / 'bag', CompressionMode.MESSAGE, storage)
    found, _ = found_in(path)
    assert [data for *_, data in found] == [one.data for one in CONTENT[1:]]
    if storage == 'sqlite3':
        bomb = zstd.compress(bytes(64 * MIB)).hex()
        change(file_of(path), f"UPDATE messages SET data=x'{bomb}' WHERE id=7")
        monkeypatch.setattr(storages, 'LARGEST', MIB)
        assert 'a compressed message expands to more than 1048576 bytes' in problem_of(path)


def test_compressed_files_are_bounded(tmp_path, monkeypatch):
    path = compressed_bag(tmp_path / 'bag', CompressionMode.FILE)
    assert len(found_in(path)[0]) == 50
    file_of(path).write_bytes(zstd.compress(bytes(64 * MIB)))
    monkeypatch.setattr(storages, '_FILE_MORE', MIB)
    assert 'expands to more than' in problem_of(path)


def test_what_newer_recorders_add_to_a_channel_is_passed_over(tmp_path):
    more = text(b'offered_qos_profiles') + text(b'')
    channel = struct.pack('<HH', 1, 0) + text(b'/a') + text(b'cdr') + text(more) + b'\xff' * 8
    magic, footer = b'\x89MCAP0\r\n', record(2, bytes(20))
    path = tmp_path / 'a.mcap'
    path.write_bytes(magic + record(4, channel) + footer + magic)
    with BagReader(path) as reader:
        assert list(reader.topics) == ['/a']


def test_a_record_larger_than_its_file_or_of_another_kind_than_its_summary_says(tmp_path):
    path = single(tmp_path / 'bag')
    whole = path.read_bytes()
    chunk = 17 + struct.unpack_from('<BQ', whole, 8)[1]
    assert whole[chunk] == 6
    for place, changed, expected in (
        (9, struct.pack('<Q', 2**40), 'the record at byte 8 claims 1099511627776 bytes'),
        (chunk, b'\x86', 'its summary has 1 chunks, and it has 0'),
    ):
        path.write_bytes(whole[:place] + changed + whole[place + len(changed) :])
        assert expected in problem_of(path)


COMPUTED = 'views, triggers or columns that compute, as no recorder does'
ROWS = {
    'larger than memory': (f'UPDATE messages SET data=zeroblob({MIB + 1}) WHERE id=7', 'too big'),
    'endless': (
        'DROP TABLE message_definitions; CREATE VIEW message_definitions AS '
        'WITH RECURSIVE endless(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM endless) '
        'SELECT id, id topic_type, id encoding, id encoded_message_definition, '
        'id type_description_hash FROM endless',
        COMPUTED,
    ),
    'computed': (
        'DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, '
        'timestamp INTEGER, data BLOB AS (zeroblob(900000000)))',
        COMPUTED,
    ),
    'of no topic': ('UPDATE messages SET topic_id=9 WHERE id=5', '1 message(s) of topics that it'),
    'of no time': ("UPDATE messages SET timestamp='x' WHERE id=5", '1 message(s) without a time'),
    'of no bytes': ("UPDATE messages SET data='x' WHERE id=5", '1 message(s) without a time'),
    'early': ('UPDATE messages SET timestamp=-5', 'received at -5 ns'),
}


@pytest.mark.parametrize('kind', ROWS)
def test_rows_that_no_recorder_writes_are_refused(tmp_path, monkeypatch, kind):
    statements, expected = ROWS[kind]
    path = change(single(tmp_path / 'bag', 'sqlite3'), *statements.split('; '))
    monkeypatch.setattr(storages, 'LARGEST', MIB)
    assert expected in problem_of(path)


def test_chunks_of_one_moment_are_bounded_together(tmp_path, monkeypatch):
    path = bag(tmp_path / 'bag')
    monkeypatch.setattr(storages, 'LARGEST_OVERLAP', 1000)
    assert 'chunks of more than 1000 bytes in all are of the same time' in problem_of(path)


def test_a_bag_without_metadata_is_read_and_what_is_cut_short_refused(tmp_path):
    path = compressed_bag(tmp_path / 'bag', CompressionMode.FILE)
    expected = found_in(path)[0]
    (path / 'metadata.yaml').unlink()
    found, (note,) = found_in(path)
    assert found == expected and 'no metadata.yaml: 1 file(s) are read' in note
    whole = file_of(path)
    whole.write_bytes(zstd.decompress(whole.read_bytes())[:-100])
    whole.rename(path / 'cut.mcap')
    assert '`mcap recover`' in problem_of(path)


@pytest.mark.parametrize('field', ['string[2000000000]', 'float64[2000000000]'])
def test_a_definition_of_endless_arrays_is_refused(tmp_path, field):
    text, _ = TYPES.generate_msgdef(TENDON_TENSIONS, ros_version=2)
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection(
            '/tendon_tensions', TENDON_TENSIONS, msgdef=f'{field} x\n{text}', rihs01='RIHS01_0'
        )
        writer.write(topic, START, b'\0\1\0\0')
    with BagReader(tmp_path / 'bag') as reader:
        with pytest.raises(BagError, match='has 2000000000 of x, at most 1048576 are read'):
            reader.decode(next(reader.messages()))


@pytest.mark.parametrize('place', ['metadata', 'file', 'alone'])
@pytest.mark.parametrize('kind', ['pipe', 'socket', 'device', 'folder'])
def test_what_is_no_file_is_not_waited_for(tmp_path, monkeypatch, place, kind):
    path = bag(tmp_path / 'bag')
    target = path / 'metadata.yaml' if place == 'metadata' else file_of(path)
    target.unlink()
    if kind == 'pipe':
        os.mkfifo(target)
    elif kind == 'socket':
        monkeypatch.chdir(path)  # The name of a socket is short.
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(target.name)
    elif kind == 'device':
        target.symlink_to('/dev/zero')
    else:
        target.mkdir()
    problem = problem_of(target if place == 'alone' else path)
    if (place, kind) == ('alone', 'folder'):
        assert 'neither metadata.yaml nor .mcap or .db3 files' in problem
    else:
        assert f'{target.name} is a {kind}, expected a file' in problem


MANY_VALUES = 'more than 100000 values, with aliases written out'


def nested(entry: Callable[[str], str]) -> str:
    """YAML of twelve lines, each of nine times the one before."""
    lines = ['    l0: &l0 {x: 1}']
    lines += [f'    l{i}: &l{i} {entry(", ".join([f"*l{i - 1}"] * 9))}' for i in range(1, 12)]
    return '  custom_data:\n' + '\n'.join(lines)


@pytest.mark.parametrize(
    ('custom', 'expected'),
    [
        (nested(lambda nine: f'[{nine}]'), MANY_VALUES),
        (nested(lambda nine: f'{{<<: [{nine}]}}'), MANY_VALUES),
        ('  custom_data: &own {x: *own}', 'an alias within what it stands for'),
        (f'  custom_data: {"[" * 5000}', 'nested more than 20 deep'),
        (f'  custom_data: {{x: {"y" * (2 * MIB)}}}', 'at most 1048576 are read'),
        ('  custom_data: !!python/name:os.system {}', 'could not determine a constructor'),
        (f'  custom_data: {{}}\n  other: {"9" * 9999}', 'is no integer'),
    ],
)
def test_yaml_that_would_take_for_ever_is_refused(tmp_path, custom, expected):
    path = bag(tmp_path / 'bag')
    text = (path / 'metadata.yaml').read_text()
    (path / 'metadata.yaml').write_text(text.replace('  custom_data: null', custom))
    assert expected in problem_of(path)


def test_yaml_within_a_storage_is_bounded_too(tmp_path):
    bomb = '\n'.join(line.strip() for line in nested(lambda nine: f'[{nine}]').splitlines()[1:])
    path = bag(tmp_path / 'bag', 'sqlite3')
    change(file_of(path), f"UPDATE topics SET offered_qos_profiles='{bomb}'")
    where = 'offered_qos_profiles, line 6: not valid YAML'
    assert f'{where}, {MANY_VALUES}' in problem_of(path)


# Metadata of another type -----------------------------------------------------------------------

OTHERS: tuple[Any, ...] = (None, True, -1, 10**30, 1.5, 'x', [], [1], {}, {'x': [1]})


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where the fields of nested maps and lists are."""
    yield path
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from places(part, (*path, key))


@pytest.mark.parametrize('step', [5, pytest.param(1, marks=pytest.mark.endurance)])
def test_metadata_of_another_type_is_refused_by_name(tmp_path, step):
    """Each field is of every ``step``-th other type."""
    path = compressed_bag(tmp_path / 'bag', CompressionMode.FILE)
    file = path / 'metadata.yaml'
    whole = yaml.safe_load(file.read_text())
    root = 'rosbag2_bagfile_information'
    whole[root]['custom_data'] = {'operator': 'somebody'}
    named = 0
    for number, place in enumerate(places(whole)):
        for other in OTHERS[number % step :: step]:
            content = {'': json.loads(json.dumps(whole))}
            *outer, last = '', *place
            reduce(getitem, outer, content)[last] = other
            file.write_text(yaml.safe_dump(content['']))
            try:
                found_in(path)
            except BagError as error:
                assert '\n' not in str(error)
                named += bool(place) and str(last) in str(error)
    assert named > 60 / step


@pytest.mark.parametrize(
    ('old', 'new', 'expected'),
    [
        ('custom_data: null', 'custom_data: [1]', 'custom_data is list, expected a map'),
        ('custom_data: null', 'custom_data: {x: [1]}', 'custom_data.x is list, expected text'),
        ('message_count: 50', 'message_count: many', "message_count is 'many', expected an int"),
        ('relative_file_paths', 'paths', 'relative_file_paths is missing'),
        ("compression_mode: ''", 'compression_mode: zip', "compression_mode is 'zip', expected o"),
        ('message_count: 50', 'message_count: -1', 'message_count is -1, expected 0 to 92233'),
        ('type: std_msgs/msg/String', 'type: 5', 'topic_metadata.type is 5, expected text'),
        (
            '  - bag.mcap',
            '  - bag.mcap\n  - elsewhere/bag.mcap',
            "relative_file_paths[1] is 'bag.mcap', expected each file once",
        ),
    ],
)
@pytest.mark.parametrize('command', ['replay', 'compare', 'identify'])
def test_every_command_names_the_field(tmp_path, cli, command, old, new, expected):
    path = bag(tmp_path / 'bag')
    text = (path / 'metadata.yaml').read_text()
    assert old in text
    (path / 'metadata.yaml').write_text(text.replace(old, new))
    options = {'replay': [], 'compare': ['--out'], 'identify': ['--out']}[command]
    assert expected in cli.refused(command, path, *options, tmp_path / 'out')
    assert command == 'compare' or not (tmp_path / 'out').exists()  # a folder, and empty


def test_a_topic_that_a_terminal_would_obey_is_refused(tmp_path):
    path = write_bag(tmp_path / 'bag', [text_sample('/a\x1b[2J', 'text')])
    assert "'/a\\x1b[2J' names a topic" in problem_of(path)


# What is lost is said ---------------------------------------------------------------------------


def test_counts_of_the_metadata_are_held_against_the_file(tmp_path):
    path = bag(tmp_path / 'bag')
    file = path / 'metadata.yaml'
    text = file.read_text()
    file.write_text(text.replace('message_count: 50', 'message_count: 51'))
    assert '50 messages found of 51 on /tendon_tensions' in problem_of(path)
    file.write_text(text.replace('name: /tendon_tensions', 'name: /tendon_tension'))
    assert 'on /tendon_tensions that it does not list' in problem_of(path)
    file.write_text(text.replace('message_count: 50', 'message_count: 0'))
    found, notes = found_in(path)
    assert len(found) == len(CONTENT)
    assert notes == ['/tendon_tensions: 50 messages, more than the 0 it says']


def test_rows_that_are_not_there_are_counted_by_every_command(tmp_path, cli):
    experiment = Experiment(hold=1.0, ramp=0.5, tension_rate=20.0, camera_rate=5.0)
    with BagWriter(tmp_path / 'demo', 'sqlite3') as writer:
        add_demo(writer, load_parameters(PRESET), experiment)
    path = change(file_of(tmp_path / 'demo'), 'DELETE FROM messages WHERE id IN (100, 101)')
    total = 2 + len(found_in(path)[0])
    for command in ('replay', 'compare'):
        more = '--out --hold 0.5 --clock-offset 0'.split() if command == 'compare' else []
        given = *more[1:], *more[:1], tmp_path / command, '--model', 'closed_form'
        status, said, _ = cli(command, path, *given)
        assert status == 0
        assert f'demo_0.db3: 2 message(s) of {total} are not there, by their numbers' in said


def test_what_the_recorder_had_no_time_for_is_an_error(tmp_path):
    path = single(tmp_path / 'bag', 'sqlite3')
    path.with_name('bag.db3-wal').write_bytes(b'messages')
    assert 'bag.db3-wal beside it holds what its recorder had no time' in problem_of(path)


def test_the_checksum_of_a_summary_is_checked(tmp_path):
    writer = pytest.importorskip('mcap.writer', reason='needs mcap')
    path = tmp_path / 'theirs.mcap'
    with path.open('wb') as stream:
        theirs = writer.Writer(stream)
        theirs.start(profile='ros2')
        channel = theirs.register_channel('/note', 'cdr', 0)
        theirs.add_message(channel, START, b'\0\1\0\0', START)
        theirs.finish()
    assert len(found_in(path)[0]) == 1
    data = bytearray(path.read_bytes())
    data[data.rindex(b'/note') + 1] ^= 1
    path.write_bytes(data)
    assert 'the checksum of its summary does not match' in problem_of(path)


@pytest.mark.parametrize('count', [40, pytest.param(300, marks=pytest.mark.endurance)])
@pytest.mark.parametrize('storage', STORAGES)
def test_no_flipped_bit_loses_a_message_unsaid(tmp_path, storage, count):
    path = single(tmp_path / 'bag', storage)
    if storage == 'sqlite3':
        change(path, 'PRAGMA page_size = 1024')
        data = sqlite3.connect(path)
        data.execute('VACUUM')  # into small pages, of which more is structure
        data.close()
    expected, _ = found_in(path)
    whole = path.read_bytes()
    rng = random.Random(0)
    refused = 0
    for _ in range(count):
        damaged = bytearray(whole)
        damaged[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
        path.write_bytes(damaged)
        try:
            found, notes = found_in(path)
        except BagError as error:
            assert '\n' not in str(error)
            refused += 1
        else:
            assert notes or len(found) == len(expected)
    assert refused > count / 30


@pytest.mark.parametrize('count', [12, pytest.param(100, marks=pytest.mark.endurance)])
@pytest.mark.parametrize('storage', STORAGES)
def test_every_command_survives_damage(tmp_path, cli, storage, count):
    rng = random.Random(1)
    path = bag(tmp_path / 'bag', storage)
    file = file_of(path)
    whole = file.read_bytes()
    statuses = set()
    for number in range(count):
        damaged = bytearray(whole)
        start = rng.randrange(len(whole))
        if number % 3 == 0:
            del damaged[start:]
        elif number % 3 == 1:
            damaged[start : start + 40] = bytes(40)
        else:
            damaged[start] ^= 1 << rng.randrange(8)
        file.write_bytes(damaged)
        command = ('replay', 'compare', 'identify')[number // 3 % 3]
        out = tmp_path / f'out{number}'
        given = (out, '--model', 'closed_form') if command == 'replay' else ('--out', out)
        status, _, err = cli(command, path, *given)
        errors = [line for line in err.splitlines() if line.startswith('octo-arm: e')]
        assert len(errors) == (status != 0)
        statuses.add(status)
    assert statuses <= {0, 1, 2}
    assert 2 in statuses
    # A bag is there where it was made, and nothing unfinished is anywhere.
    assert not [one for one in tmp_path.iterdir() if one.name.startswith('.')]


def test_a_time_that_no_stamp_can_hold_is_refused(tmp_path, cli):
    (sample,) = samples(
        ARM, np.ones((1, 4)), '/tendon_tensions/array', 'std_msgs/msg/Float64MultiArray'
    )
    late = sample._replace(received_ns=2**31 * 10**9)
    path = write_bag(tmp_path / 'bag', [*CONTENT, sample, late])
    assert cli('replay', path, tmp_path / 'out')[0] == 0
    with BagReader(tmp_path / 'out') as reader:
        assert reader.count(['/backbone/path']) == 51
