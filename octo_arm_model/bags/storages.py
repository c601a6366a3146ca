"""The storages of rosbags, with bounds on what a bag may ask for.

Files, YAML and what compressed data expand to are bounded; records that do not fit and lost rows
are found. rosbags expands chunks and loads YAML whatever they claim, so that a bag of some
kilobytes could take all memory. Importing this puts bounded ones into its tables.
"""

from __future__ import annotations

import contextlib
import copy
import heapq
import io
import itertools
import stat
import struct
import sys
import urllib.parse
import zlib
from collections.abc import Callable, Collection, Generator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import apsw
import lz4.frame
from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import Reader, storage_mcap, storage_sqlite3
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from octo_arm_model.arm.errors import BagError
from octo_arm_model.config.files import load_yaml, reading

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

LARGEST = 256 * 2**20  # bytes of a message, and of a chunk of messages
LARGEST_OVERLAP = 4 * LARGEST  # bytes of the chunks that are open at one moment
# A compressed file becomes so many times as large, and so much more.
_FILE_RATIO, _FILE_MORE = 1000, 64 * 2**20
_PART = 2**20  # bytes read at once


def check_file(path: Path) -> None:
    """Refuse what is no regular file: reading a pipe would block.

    Raises:
        ValueError: if ``path`` is no regular file, or not there.
    """
    if not path.exists():
        raise ValueError(f'{path.name} is not there')
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode):
        kinds = {
            'a folder': stat.S_ISDIR, 'a pipe': stat.S_ISFIFO, 'a socket': stat.S_ISSOCK,
            'a device': lambda mode: stat.S_ISCHR(mode) or stat.S_ISBLK(mode),
        }  # fmt: skip
        kind = next((name for name, holds in kinds.items() if holds(mode)), 'something else')
        raise ValueError(f'{path.name} is {kind}, expected a file')


def checked_yaml(text: str, what: str) -> Any:
    """Content of a text in YAML, see `load_yaml`.

    Raises:
        BagError: if ``text`` is too large or too deep, aliases followed, or no YAML.
    """
    with reading(what, BagError):
        return load_yaml(text)


def check_compressed_file(path: Path) -> None:
    """Refuse a compressed file that becomes out of proportion large; ValueError if it does."""
    most = _FILE_RATIO * path.stat().st_size + _FILE_MORE
    size = 0
    with zstd.open(path, 'rb') as stream:
        while part := stream.read(_PART):
            size += len(part)
            if size > most:
                raise ValueError(
                    f'{path.name}: {path.stat().st_size} bytes expand to more than {most}'
                )


def expand_message(data: bytes) -> bytes:
    """A message compressed by zstd; ValueError if it is larger than `LARGEST`."""
    return _read(zstd.open(io.BytesIO(data), 'rb'), LARGEST, 'a compressed message')


def _read(stream: Any, most: int, what: str) -> bytes:
    """All of ``stream``, of at most so many bytes."""
    parts = io.BytesIO()
    with stream:
        while part := stream.read(min(_PART, most + 1 - parts.tell())):
            parts.write(part)
            if parts.tell() > most:
                raise ValueError(f'{what} expands to more than {most} bytes')
    return parts.getvalue()


def check_size(size: int, what: str) -> None:
    """Refuse what is too large for memory; ValueError if ``size`` is more than `LARGEST` bytes."""
    if size > LARGEST:
        raise ValueError(f'{what} of {size} bytes, at most {LARGEST} are read')


def _chunk(expand: Callable[[BinaryIO], Any]) -> Callable[[bytes, int], bytes]:
    """Expands a chunk to the size that it claims, and no more."""

    def expanded(data: bytes, size: int) -> bytes:
        check_size(size, 'a chunk')
        return _read(expand(io.BytesIO(data)), size, 'a chunk')

    return expanded


def _bounded_qos(profiles: object) -> list[Qos]:
    if isinstance(profiles, str):
        checked_yaml(profiles, 'offered_qos_profiles')
    return parse_qos(profiles)  # type: ignore[arg-type]


storage_mcap.DECOMPRESSORS['zstd'] = _chunk(lambda stream: zstd.open(stream, 'rb'))
storage_mcap.DECOMPRESSORS['lz4'] = _chunk(lambda stream: lz4.frame.open(stream, 'rb'))
for _module in (vars(storage_mcap), vars(storage_sqlite3)):
    _module['parse_qos'] = _bounded_qos


_MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')  # kind, bytes that follow
_CHUNK, _CHUNK_HEAD = 6, struct.Struct('<QQQ')  # first and last time, size when expanded
_ATTACHMENT = 9
_FOOTER, _FOOTER_FIELDS = 2, struct.Struct('<QQI')  # summary, its offsets, its checksum
_MOST_TOGETHER = 8  # files of a bag that are read at once
_STEPS = 100_000  # instructions of SQLite between checks for a signal


class BoundedMcapReader(McapReader):
    """An MCAP file whose records fit into it and are all found by its index."""

    path: Path

    def open(self) -> None:
        """Open it; ValueError if it is damaged, or needs more memory than is allowed."""
        check_file(self.path)
        with self.path.open('rb') as file:
            chunks = _chunks(file, self.path.stat().st_size)
        super().open()
        try:
            self._check(chunks)
        except BaseException:
            self.close()
            raise

    def _check(self, found: set[int]) -> None:
        if self.chunks and {chunk.chunk_start_offset for chunk in self.chunks} != found:
            raise ValueError(f'its index has {len(self.chunks)} chunks, and it has {len(found)}')
        changes: list[tuple[int, int]] = []
        for chunk in self.chunks:
            check_size(max(chunk.compressed_size, chunk.uncompressed_size), 'a chunk')
            size = chunk.uncompressed_size
            changes += [(chunk.message_start_time, size), (chunk.message_end_time + 1, -size)]
        together = itertools.accumulate(size for _, size in sorted(changes))
        if max(together, default=0) > LARGEST_OVERLAP:
            raise ValueError(
                f'chunks of more than {LARGEST_OVERLAP} bytes in all are of the same time'
            )


def _chunks(file: BinaryIO, size: int) -> set[int]:
    """Where the chunks of an MCAP file begin; ValueError if a record does not fit into it."""
    if file.read(len(_MAGIC)) != _MAGIC:
        return set()  # rosbags says so.
    chunks: set[int] = set()
    place, end = len(_MAGIC), size - len(_MAGIC)
    kind = 0
    while place < end:
        file.seek(place)
        head = file.read(_RECORD.size)
        kind, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, size)
        start, place = place, place + _RECORD.size + length
        if place > end:
            raise ValueError(f'the record at byte {start} claims {length} bytes, too many')
        if kind == _CHUNK:
            chunks.add(start)
            head = file.read(_CHUNK_HEAD.size)
            if len(head) == _CHUNK_HEAD.size:
                check_size(_CHUNK_HEAD.unpack(head)[-1], f'the chunk at byte {start}')
        if kind != _ATTACHMENT:
            check_size(length, f'the record at byte {start}')
    if kind != _FOOTER or length != _FOOTER_FIELDS.size:
        raise ValueError('its last record is no footer')
    file.seek(start + _RECORD.size)
    summary, _, checksum = _FOOTER_FIELDS.unpack(file.read(_FOOTER_FIELDS.size))
    if summary and checksum and checksum != _checksum(file, summary, end - 4):
        raise ValueError('the checksum of its summary is another')
    return chunks


def _checksum(file: BinaryIO, start: int, end: int) -> int:
    """CRC-32 of the bytes from ``start`` to ``end``."""
    checksum = 0
    file.seek(start)
    while start < end and (part := file.read(min(_PART, end - start))):
        checksum = zlib.crc32(part, checksum)
        start += len(part)
    return checksum


class CheckedSqlite3Reader(Sqlite3Reader):
    """An SQLite file that is sound, each message of a topic that it has.

    Attributes:
        missing: how many messages less there are than they are numbered.
    """

    path: Path
    missing = 0

    def open(self) -> None:
        """Open it; ValueError if it is damaged."""
        check_file(self.path)
        for ending in ('-wal', '-journal'):
            beside = self.path.with_name(self.path.name + ending)
            if beside.exists() and beside.stat().st_size:
                raise ValueError(
                    f'{beside.name} beside it holds what its recorder had no time to put into it; '
                    f'`sqlite3 {self.path.name} .schema` does'
                )
        with contextlib.closing(_connected(self.path)) as data:
            self._check(data)
        super().open()
        assert self.dbconn is not None
        _bound(self.dbconn)

    def _check(self, data: apsw.Connection) -> None:
        # First, as a query in a damaged tree may loop for ever, which this check does not.
        ((problem,),) = data.execute('PRAGMA integrity_check(1)')
        if problem != 'ok':
            raise ValueError(str(problem))
        ((computed,),) = data.execute(
            "SELECT (SELECT count(*) FROM sqlite_master WHERE type NOT IN ('table', 'index')"
            "  OR sql LIKE 'CREATE VIRTUAL%') + (SELECT count(*) FROM sqlite_master AS of_all,"
            '  pragma_table_xinfo(of_all.name) AS its WHERE its.hidden)'
        )
        if computed:
            raise ValueError('it has views or triggers or computes columns, as no recorder does')
        ((lost,),) = data.execute(
            'SELECT count(*) FROM messages WHERE topic_id NOT IN (SELECT id FROM topics)'
        )
        if lost:
            raise ValueError(f'{lost} message(s) of topics that it does not have')
        ((others,),) = data.execute(
            "SELECT count(*) FROM messages WHERE typeof(timestamp) != 'integer' "
            "OR typeof(data) != 'blob'"
        )
        if others:
            raise ValueError(f'{others} message(s) without a time of receipt or bytes')
        ((count, newest),) = data.execute('SELECT count(*), max(id) FROM messages')
        self.missing = max((newest or 0) - count, 0)


def _connected(path: Path) -> apsw.Connection:
    """An SQLite file open for reading, see `_bound`."""
    flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
    data = apsw.Connection(f'file:{urllib.parse.quote(str(path))}?immutable=1', flags=flags)
    _bound(data)
    return data


def _bound(data: apsw.Connection) -> None:
    """Let Ctrl-C end queries, and no value be too large for memory."""
    data.limit(apsw.SQLITE_LIMIT_LENGTH, LARGEST)
    data.set_progress_handler(lambda: False, _STEPS)


class _Folder(DirectoryReader):
    """That of rosbags, whose messages come in the order of receipt from several files too."""

    STORAGE_PLUGINS: Mapping[str, Any] = {
        'mcap': BoundedMcapReader,
        'sqlite3': CheckedSqlite3Reader,
    }

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        waiting = sorted(self.storages, key=lambda file: file.metadata.start_time)[::-1]
        # Of each file that is open the next message, by its time and the number of the file.
        heads: list[tuple[int, int, Any, Generator[Any, None, None]]] = []
        number = 0
        while waiting or heads:
            while waiting and (not heads or waiting[-1].metadata.start_time <= heads[0][0]):
                alone, number = copy.copy(self), number + 1
                alone.storages = [waiting.pop()]
                found = DirectoryReader.messages(alone, connections, start, stop)
                for message in itertools.islice(found, 1):
                    heapq.heappush(heads, (message[1], number, message, found))
                if len(heads) > _MOST_TOGETHER:
                    raise ValueError(
                        f'more than {_MOST_TOGETHER} files hold messages of the same time'
                    )
            if not heads:
                return
            _, own, message, found = heads[0]
            yield message
            if (following := next(found, None)) is None:
                heapq.heappop(heads)
            else:
                heapq.heapreplace(heads, (following[1], own, following, found))


class BoundedReader(Reader):
    """The reader of rosbags with these storages."""

    STORAGE_PLUGINS: Mapping[str, Any] = {
        'dir': _Folder,
        '.mcap': BoundedMcapReader,
        '.db3': CheckedSqlite3Reader,
    }
