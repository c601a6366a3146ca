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

from octo_arm_model.arm.errors import BagError
from octo_arm_model.config.yaml_files import load_yaml, reading

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
        checked_yaml(profiles, 'offered_qos_profiles')
    return parse_qos(profiles)  # type: ignore[arg-type]


storage_mcap.DECOMPRESSORS['zstd'] = _chunk(lambda stream: zstd.open(stream, 'rb'))
storage_mcap.DECOMPRESSORS['lz4'] = _chunk(lambda stream: lz4.frame.open(stream, 'rb'))
for _module in (vars(storage_mcap), vars(storage_sqlite3)):
    _module['parse_qos'] = _bounded_qos
