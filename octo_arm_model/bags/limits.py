"""How much a bag may ask for: files, YAML and what compressed data expand to are bounded.

rosbags expands chunks and loads YAML whatever they claim, so that a bag of some kilobytes could
take all memory. Importing this puts bounded ones into its tables.
"""

from __future__ import annotations

import io
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
from rosbags.interfaces import Qos
from rosbags.rosbag2 import storage_mcap, storage_sqlite3
from rosbags.rosbag2.metadata import parse_qos
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    ScalarEvent,
)

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

LARGEST = 256 * 2**20  # bytes of a message, and of a chunk of messages
LARGEST_OVERLAP = 4 * LARGEST  # bytes of the chunks that are open at one moment
LARGEST_YAML = 2 * 2**20  # bytes
_NODES, _DEPTH = 200_000, 32  # of YAML, each alias counted as what it stands for
# A compressed file becomes so many times as large, and so much more.
_FILE_RATIO, _FILE_MORE = 1000, 64 * 2**20
_PART = 2**20  # bytes read at once


def check_file(path: Path) -> None:
    """Refuse what is no file, such as a pipe, at which reading would wait for ever.

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


def check_yaml(text: str, what: str) -> None:
    """Refuse YAML that is large, or becomes so when its aliases are followed.

    Raises:
        ValueError: if ``text`` is too large or too deep, or no YAML.
    """
    if len(text) > LARGEST_YAML:
        raise ValueError(f'{what} has {len(text)} characters, at most {LARGEST_YAML} are read')
    sizes: dict[str, int] = {}  # of what aliases stand for
    opened: list[tuple[str | None, int]] = []  # anchor, and how many nodes came before it
    nodes = 0
    try:
        for event in YAML(typ='safe', pure=True).parse(text):
            if isinstance(event, CollectionStartEvent):
                opened.append((event.anchor, nodes))
                nodes += 1
            elif isinstance(event, CollectionEndEvent):
                anchor, before = opened.pop()
                if anchor:
                    sizes[anchor] = nodes - before
            elif isinstance(event, ScalarEvent):
                nodes += 1
                if event.anchor:
                    sizes[event.anchor] = 1
            elif isinstance(event, AliasEvent):
                if any(anchor == event.anchor for anchor, _ in opened):
                    raise ValueError(f'{what}: alias *{event.anchor} stands for itself')
                nodes += sizes.get(event.anchor, 1)
            if nodes > _NODES:
                raise ValueError(f'{what} has more than {_NODES} entries, aliases followed')
            if len(opened) > _DEPTH:
                raise ValueError(f'{what} is nested more than {_DEPTH} deep')
    except YAMLError as error:
        raise ValueError(f'{what} is no YAML: {error}') from error


def check_compressed_file(path: Path) -> None:
    """Refuse a compressed file that becomes out of proportion large.

    Raises:
        ValueError: if it does.
    """
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
    """A message compressed by zstd.

    Raises:
        ValueError: if it is larger than `LARGEST`.
    """
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
    """Refuse what is too large for memory.

    Raises:
        ValueError: if ``size`` is more than `LARGEST` bytes.
    """
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
        check_yaml(profiles, 'offered_qos_profiles')
    return parse_qos(profiles)  # type: ignore[arg-type]


storage_mcap.DECOMPRESSORS['zstd'] = _chunk(lambda stream: zstd.open(stream, 'rb'))
storage_mcap.DECOMPRESSORS['lz4'] = _chunk(lambda stream: lz4.frame.open(stream, 'rb'))
for _module in (vars(storage_mcap), vars(storage_sqlite3)):
    _module['parse_qos'] = _bounded_qos
