"""The files of bags, MCAP and SQLite: checked while they are read, with a bound on every size.

Nothing that a file states is trusted: records must fit into it, chunks must expand to the stated
size, and messages are counted and compared with its summary.
"""

import heapq
import io
import itertools
import stat
import struct
import sys
import tempfile
import urllib.parse
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import apsw
import lz4.frame
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2.metadata import parse_qos

from octo_arm_model.arm.errors import BagError, shown
from octo_arm_model.config.files import load_yaml, reading

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

LARGEST = 256 * 2**20  # bytes in a message, and in a chunk of messages
LARGEST_OVERLAP = 4 * LARGEST  # bytes in the chunks that are open at the same time
# A compressed file may expand to this many times its size, plus this many bytes.
_FILE_RATIO, _FILE_MORE = 1000, 64 * 2**20
_PART = 2**20  # bytes that are read at a time
_MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')  # kind, bytes that follow
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _ATTACHMENT, _STATISTICS = 2, 3, 4, 5, 6, 9, 11
_MESSAGE_HEAD = struct.Struct('<HIQQ')  # channel, sequence, times of receipt and of publication
_CHUNK_HEAD = struct.Struct('<QQQI')  # first and last time, size when expanded, its checksum
_FOOTER_FIELDS = struct.Struct('<QQI')  # summary, its offsets, its checksum
_STATISTICS_HEAD = '<QHIIIIQQI'  # messages, ..., chunks at 5; bytes of counts
_RECOVER = '`mcap recover` saves what is whole of a file that was cut short'
_STEPS = 100_000  # instructions of SQLite between checks for a signal
_FORMATS = {
    'ros2msg': MessageDefinitionFormat.MSG,
    'ros2idl': MessageDefinitionFormat.IDL,
    'omgidl': MessageDefinitionFormat.IDL,
}
_UNDEFINED = MessageDefinition(MessageDefinitionFormat.NONE, '')
Found = tuple[Connection, int, bytes]  # connection, time of receipt [ns], and bytes of a message
# Messages in the order of receipt, none of them received before a time [ns].
Source = tuple[int, Callable[[], Iterator[Found]]]


def check_file(path: Path) -> None:
    """Refuse a ``path`` that is not a regular file, because reading a pipe would block.

    Raises:
        ValueError: if ``path`` is not a regular file, or does not exist.
    """
    if not path.exists():
        raise ValueError(f'{path.name} is not there')
    letter = stat.filemode(path.stat().st_mode)[0]
    if letter != '-':
        kind = {'d': 'folder', 'p': 'pipe', 's': 'socket'}.get(letter, 'device')
        raise ValueError(f'{path.name} is a {kind}, expected a file')


def check_size(size: int, label: str) -> None:
    """Raise ValueError if a ``size`` is more than `LARGEST` bytes, too large for memory."""
    if size > LARGEST:
        raise ValueError(f'{label} of {size} bytes, at most {LARGEST} are read')


def checked_yaml(text: str, label: str) -> Any:
    """Return the content of a ``text`` in YAML.

    Raises:
        BagError: if ``text`` is too large or too deep, also by aliases, or is not YAML.
    """
    with reading(label, BagError):
        return load_yaml(text)


def _expand_file(path: Path, folder: Path) -> Path:
    """Expand a file compressed by zstd into ``folder``; ValueError if it expands too much."""
    most = _FILE_RATIO * path.stat().st_size + _FILE_MORE
    with (folder / path.stem).open('wb') as out:
        _copy(zstd.open(path, 'rb'), out, most, path.name)
    return folder / path.stem


def expand_message(data: bytes) -> bytes:
    """Expand a message compressed by zstd; ValueError if it is larger than `LARGEST`."""
    return _read(zstd.open(io.BytesIO(data), 'rb'), LARGEST, 'a compressed message')


def _read(stream: Any, limit: int, label: str) -> bytes:
    """Read all of a ``stream``; ValueError if it has more than ``limit`` bytes."""
    _copy(stream, parts := io.BytesIO(), limit, label)
    return parts.getvalue()


def _copy(stream: Any, out: BinaryIO, limit: int, label: str) -> None:
    with stream:
        while part := stream.read(min(_PART, limit + 1 - out.tell())):
            out.write(part)
            if out.tell() > limit:
                raise ValueError(f'{label} expands to more than {limit} bytes')


def in_order(sources: Iterable[Source], limit: int | None = None) -> Iterator[Found]:
    """Merge the messages of ``sources`` in the order of receipt; each is open only when needed.

    Raises:
        ValueError: if more than ``limit`` would be open together.
    """
    count = 0

    def messages(source: Source) -> Iterator[tuple[Connection | None, int, bytes]]:
        nonlocal count
        start, open_source = source
        yield None, start, b''  # the source is opened when this is the next of all
        count += 1
        if limit is not None and count > limit:
            raise ValueError(f'more than {limit} files hold messages of the same time')
        yield from open_source()
        count -= 1

    ordered = sorted(sources, key=itemgetter(0))
    for connection, time, data in heapq.merge(*map(messages, ordered), key=itemgetter(1)):
        if connection is not None:
            yield connection, time, data


class _Fields:
    """The fields of a record of MCAP, one after another."""

    def __init__(self, data: bytes) -> None:
        self.data, self.place = data, 0

    def take(self, layout: str) -> tuple[Any, ...]:
        values = struct.unpack_from(layout, self.data, self.place)
        self.place += struct.calcsize(layout)
        return values

    def bytes(self, layout: str = '<I') -> bytes:
        (length,) = self.take(layout)
        self.place += length
        if self.place > len(self.data):
            raise ValueError(f'a field of {length} bytes, more than its record has')
        return self.data[self.place - length : self.place]

    def text(self) -> str:
        return self.bytes().decode()


class _Chunk(NamedTuple):
    place: int
    length: int
    start: int
    stop: int
    size: int  # when it is expanded


def _read_at(file: BinaryIO, place: int, length: int) -> bytes:
    file.seek(place)
    data = file.read(length)
    if len(data) < length:
        raise ValueError(f'it ends within {length} bytes at byte {place}')
    return data


def _records(file: BinaryIO, place: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Iterate over kind, place and length of the records of a ``file`` from ``place`` to ``end``.

    ValueError is raised if one does not fit.
    """
    while place < end:
        start = place
        file.seek(start)
        head = file.read(_RECORD.size)
        kind, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, end)
        place += _RECORD.size + length
        if place > end:
            raise ValueError(
                f'the record at byte {start} claims {length} bytes, too many; {_RECOVER}'
            )
        yield kind, start + _RECORD.size, length


class McapFile:
    """An MCAP file.

    Attributes:
        path: path of the file.
        connections: connections of the topics.
        start_ns: time of receipt of the first message [ns].
        stop_ns: time of receipt of the last message [ns].
        missing: number of missing messages; always 0, as MCAP does not number them.
    """

    missing = 0

    def __init__(self, path: Path, resources: ExitStack) -> None:
        """Open the file at ``path``, which is closed with the ``resources``.

        Raises:
            ValueError: if it is damaged, or needs more memory than is allowed.
        """
        self.path = path
        self._file: BinaryIO = resources.enter_context(path.open('rb'))
        self._end = path.stat().st_size - len(_MAGIC)
        self._chunks: list[_Chunk] = []
        self._outer_times: list[int] = []  # of the first and last message outside of chunks
        self._schemas: dict[int, tuple[str, MessageDefinition]] = {}
        self._channels: dict[int, Connection] = {}
        stated, counts = self._scan()
        self._check_overlap()
        if stated is None or not stated.keys() <= self._channels.keys():
            counts += self._scan_chunks()
            stated = stated or counts
        if unknown := stated.keys() - self._channels.keys():
            raise ValueError(f'{stated[min(unknown)]} message(s) of a topic that it does not have')
        self.connections = [
            one._replace(msgcount=stated[number]) for number, one in self._channels.items()
        ]
        times = [*self._outer_times, *(time for one in self._chunks for time in one[2:4])]
        self.start_ns, self.stop_ns = min(times, default=0), max(times, default=0)

    def messages(self, topics: Collection[str]) -> Iterator[Found]:
        """Iterate over messages of ``topics`` in order of receipt; ValueError if damaged."""
        sources: list[Source] = [
            (chunk.start, partial(self._in_chunk, chunk, topics)) for chunk in self._chunks
        ]
        if self._outer_times:
            unchunked = partial(self._messages, self._file, len(_MAGIC), self._end, topics)
            sources.append((self._outer_times[0], unchunked))
        return in_order(sources)

    def _scan(self) -> tuple[Counter[int] | None, Counter[int]]:
        """Find chunks and topics; return the counts of the summary, and of messages out of chunks.

        ValueError is raised if a record or a checksum is wrong, or the summary contradicts itself.
        """
        stated: Counter[int] | None = None
        counts = Counter[int]()
        if _read_at(self._file, 0, len(_MAGIC)) != _MAGIC:
            raise ValueError('it does not begin like an MCAP file')
        kind = place = length = 0
        for kind, place, length in _records(self._file, len(_MAGIC), self._end):
            where = f'at byte {place - _RECORD.size}'
            if kind != _ATTACHMENT:
                check_size(length, f'the record {where}')
            if kind == _CHUNK:
                header = _CHUNK_HEAD.unpack(_read_at(self._file, place, _CHUNK_HEAD.size))
                check_size(header[2], f'the chunk {where}')
                self._chunks.append(_Chunk(place, length, *header[:3]))
            elif kind == _MESSAGE:
                head = _read_at(self._file, place, _MESSAGE_HEAD.size)
                channel, _, time, _ = _MESSAGE_HEAD.unpack(head)
                counts[channel] += 1
                if time < (self._outer_times or [0])[-1]:
                    raise ValueError('messages outside of chunks are not in the order of receipt')
                self._outer_times = [*self._outer_times[:1], time]
            elif kind == _STATISTICS:
                stated = self._stated_counts(_Fields(_read_at(self._file, place, length)))
            elif kind in (_SCHEMA, _CHANNEL):
                self._define(kind, _Fields(_read_at(self._file, place, length)))
        self._check_footer(kind, place, length)
        return stated, counts

    def _check_footer(self, kind: int, place: int, length: int) -> None:
        """Check the last record, and the checksum of the summary that is in it."""
        if kind != _FOOTER or length != _FOOTER_FIELDS.size:
            raise ValueError(f'its last record is no footer; {_RECOVER}')
        summary, _, expected = _FOOTER_FIELDS.unpack(_read_at(self._file, place, length))
        if not (summary and expected):
            return
        end, checksum = self._end - 4, 0
        for start in range(summary, end, _PART):
            part = _read_at(self._file, start, min(_PART, end - start))
            checksum = zlib.crc32(part, checksum)
        if checksum != expected:
            raise ValueError('the checksum of its summary does not match')

    def _stated_counts(self, fields: _Fields) -> Counter[int]:
        """Return the counts of a summary by channel; ValueError if it contradicts itself."""
        count, *_, chunks, _, _, length = fields.take(_STATISTICS_HEAD)
        if chunks != len(self._chunks):
            raise ValueError(f'its summary has {chunks} chunks, and it has {len(self._chunks)}')
        pair = '<HQ'
        pairs = (fields.take(pair) for _ in range(length // struct.calcsize(pair)))
        counts = Counter[int](dict(pairs))
        if counts.total() != count:
            raise ValueError(f'its summary has {count} messages, and {counts.total()} of topics')
        return counts

    def _define(self, kind: int, fields: _Fields) -> None:
        """Read a schema or a channel."""
        (number,) = fields.take('<H')
        if kind == _SCHEMA:
            name, encoding, text = fields.text(), fields.text(), fields.text()
            form = _FORMATS.get(encoding, MessageDefinitionFormat.NONE)
            self._schemas[number] = name, MessageDefinition(form, text)
            return
        (schema,) = fields.take('<H')
        topic, encoding = fields.text(), fields.text()
        if encoding != 'cdr':
            raise ValueError(f'{shown(topic)} is in {shown(encoding)}, expected cdr')
        metadata, more = _Fields(fields.bytes()), {}
        while metadata.place < len(metadata.data):
            key = metadata.text()
            more[key] = metadata.text()
        type_name, definition = self._schemas.get(schema, ('__schemaless__', _UNDEFINED))
        digest, qos = more.get('topic_type_hash', ''), more.get('offered_qos_profiles', '')
        self._channels[number] = Connection(
            number, topic, type_name, definition, digest, 0, _extension(qos), self
        )

    def _scan_chunks(self) -> Counter[int]:
        """Find the topics in chunks, and return the number of messages of each channel."""
        counts = Counter[int]()
        for chunk in self._chunks:
            file = io.BytesIO(self._expanded(chunk))
            for kind, place, length in _records(file, 0, chunk.size):
                data = _read_at(file, place, length)
                if kind == _MESSAGE:
                    counts[_MESSAGE_HEAD.unpack_from(data)[0]] += 1
                elif kind in (_SCHEMA, _CHANNEL):
                    self._define(kind, _Fields(data))
        return counts

    def _check_overlap(self) -> None:
        changes = [(chunk.start, chunk.size) for chunk in self._chunks]
        changes += [(chunk.stop + 1, -chunk.size) for chunk in self._chunks]
        open_bytes = itertools.accumulate(size for _, size in sorted(changes))
        if max(open_bytes, default=0) > LARGEST_OVERLAP:
            raise ValueError(
                f'chunks of more than {LARGEST_OVERLAP} bytes in all are of the same time'
            )

    def _expanded(self, chunk: _Chunk) -> bytes:
        """Return the records of a ``chunk``, expanded."""
        fields = _Fields(_read_at(self._file, chunk.place, chunk.length))
        *_, checksum = fields.take(_CHUNK_HEAD.format)
        compression, stored = fields.text(), fields.bytes('<Q')
        if compression == 'zstd':
            stored = _read(zstd.open(io.BytesIO(stored), 'rb'), chunk.size, 'a chunk')
        elif compression == 'lz4':
            stored = _read(lz4.frame.open(io.BytesIO(stored), 'rb'), chunk.size, 'a chunk')
        elif compression:
            raise ValueError(f'a chunk is compressed by {shown(compression)}, expected zstd, lz4')
        if len(stored) != chunk.size:
            raise ValueError(f'a chunk has {len(stored)} bytes, and says {chunk.size}')
        if checksum and checksum != zlib.crc32(stored):
            raise ValueError('the checksum of a chunk does not match')
        return stored

    def _in_chunk(self, chunk: _Chunk, topics: Collection[str]) -> Iterator[Found]:
        found = self._messages(io.BytesIO(self._expanded(chunk)), 0, chunk.size, topics)
        return iter(sorted(found, key=itemgetter(1)))

    def _messages(
        self, file: BinaryIO, place: int, end: int, topics: Collection[str]
    ) -> Iterator[Found]:
        """Iterate over messages of ``topics`` in a ``file``, from ``place`` to ``end``."""
        for kind, at, length in _records(file, place, end):
            if kind != _MESSAGE:
                continue
            data = _read_at(file, at, length)
            channel, _, time, _ = _MESSAGE_HEAD.unpack_from(data)
            if (connection := self._channels.get(channel)) is None:
                raise ValueError('a message of a topic that it does not have')
            if connection.topic in topics:
                yield connection, time, data[_MESSAGE_HEAD.size :]


def _extension(qos: str) -> ConnectionExtRosbag2:
    """Return what only bags of ROS 2 have, from their text of QoS profiles."""
    return ConnectionExtRosbag2('cdr', parse_qos(checked_yaml(qos, 'offered_qos_profiles') or []))


class Sqlite3File:
    """An SQLite file without damage, in which every message has a known topic.

    Attributes:
        path: path of the file.
        connections: connections of the topics.
        start_ns: time of receipt of the first message [ns].
        stop_ns: time of receipt of the last message [ns].
        missing: number of messages that are missing by their numbers.
    """

    def __init__(self, path: Path, resources: ExitStack) -> None:
        """Open the file at ``path``, closed with the ``resources``; ValueError if damaged."""
        for ending in ('-wal', '-journal'):
            beside = path.with_name(path.name + ending)
            if beside.exists() and beside.stat().st_size:
                raise ValueError(
                    f'{beside.name} beside it holds what its recorder had no time to put into it; '
                    f'`sqlite3 {path.name} .schema` does'
                )
        self.path = path
        flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
        name = f'file:{urllib.parse.quote(str(path))}?immutable=1'
        self._data = apsw.Connection(name, flags=flags)
        resources.callback(self._data.close)
        # Ctrl-C can end queries, and no value can be too large for memory.
        self._data.limit(apsw.SQLITE_LIMIT_LENGTH, LARGEST)
        self._data.set_progress_handler(lambda: False, _STEPS)
        self._check()
        self.connections = list(self._topics())

    def messages(self, topics: Collection[str]) -> Iterator[Found]:
        """Iterate over messages of ``topics`` in the order of receipt."""
        selected = {c.id: c for c in self.connections if c.topic in topics}
        rows = self._data.execute(
            f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN '
            f'({",".join("?" * len(selected))}) ORDER BY timestamp',
            tuple(selected),
        )
        for number, time, data in rows:
            yield selected[number], time, data

    def _check(self) -> None:
        # The integrity check is first: other queries may loop for ever in a damaged tree.
        for statement, problem in (
            ('PRAGMA integrity_check(1)', ''),
            (
                "SELECT (SELECT count(*) FROM sqlite_master WHERE type NOT IN ('table', 'index')"
                "  OR sql LIKE 'CREATE VIRTUAL%') + (SELECT count(*) FROM sqlite_master AS of_all,"
                '  pragma_table_xinfo(of_all.name) AS its WHERE its.hidden)',
                'it has {} views, triggers or columns that compute, as no recorder does',
            ),
            (
                'SELECT count(*) FROM messages WHERE topic_id NOT IN (SELECT id FROM topics)',
                '{} message(s) of topics that it does not have',
            ),
            (
                "SELECT count(*) FROM messages WHERE typeof(timestamp) != 'integer' "
                "OR typeof(data) != 'blob'",
                '{} message(s) without a time of receipt or bytes',
            ),
        ):
            ((result,),) = self._data.execute(statement)
            if result not in ('ok', 0):
                raise ValueError(problem.format(result) or str(result))
        ((count, newest, first, last),) = self._data.execute(
            'SELECT count(*), max(id), min(timestamp), max(timestamp) FROM messages'
        )
        self.missing = max((newest or 0) - count, 0)
        self.start_ns, self.stop_ns = first or 0, last or 0

    def _topics(self) -> Iterator[Connection]:
        tables = {
            table: {row[1] for row in self._data.execute(f'PRAGMA table_info({table})')}
            for table in ('topics', 'message_definitions')
        }
        # Older recorders have fewer columns, and no definitions.
        texts: dict[str, MessageDefinition] = {}
        if tables['message_definitions']:
            for name, encoding, text in self._data.execute(
                'SELECT topic_type, encoding, encoded_message_definition '
                'FROM message_definitions ORDER BY id DESC'
            ):
                form = _FORMATS.get(encoding, MessageDefinitionFormat.NONE)
                texts[name] = MessageDefinition(form, text)
        extra = ('offered_qos_profiles', 'type_description_hash')
        columns = ', '.join(name if name in tables['topics'] else "''" for name in extra)
        counts = 'SELECT count(*) FROM messages WHERE topic_id = topics.id'
        for number, topic, kind, form, count, qos, digest in self._data.execute(
            f'SELECT id, name, type, serialization_format, ({counts}), {columns} FROM topics '
            'ORDER BY id'
        ):
            if not all(isinstance(value, str) for value in (topic, kind, form, qos, digest)):
                raise ValueError(f'topic {number} is of other types than a recorder writes')
            if form != 'cdr':
                raise ValueError(f'{shown(topic)} is in {shown(form)}, expected cdr')
            definition = texts.get(kind, _UNDEFINED)
            yield Connection(number, topic, kind, definition, digest, count, _extension(qos), self)


File = McapFile | Sqlite3File


def open_file(path: Path, resources: ExitStack) -> File:
    """Open the storage at ``path``, expanded if it is compressed; ``resources`` close it.

    Raises:
        ValueError: if it is not a storage, or is damaged.
    """
    check_file(path)
    if path.suffix == '.zstd':
        path = _expand_file(path, Path(resources.enter_context(tempfile.TemporaryDirectory())))
    kinds: dict[str, Callable[[Path, ExitStack], File]] = {'.mcap': McapFile, '.db3': Sqlite3File}
    if path.suffix not in kinds:
        raise ValueError(f'{path.name} is neither a .mcap nor a .db3 file')
    return kinds[path.suffix](path, resources)
