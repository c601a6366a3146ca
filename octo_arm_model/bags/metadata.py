"""What is read of metadata.yaml: which files a bag has, and what it says is in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import yaml

from octo_arm_model.arm.errors import shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.bags.storages import check_file, checked_yaml

NAME = 'metadata.yaml'
_ROOT = 'rosbag2_bagfile_information'
_KINDS: dict[type, str] = {int: 'an integer', str: 'text', list: 'a list', dict: 'a map'}
_MODES = ('', 'none', 'file', 'message')
Key = tuple[str, str]  # a topic and the type of messages on it


class Metadata(NamedTuple):
    """What a bag says of itself.

    Attributes:
        files: its files.
        counts: messages of each topic and type.
        is_each_compressed: whether each message is, by zstd.
        custom: data of its recording.
    """

    files: list[Path]
    counts: Counter[Key]
    is_each_compressed: bool
    custom: dict[str, str]


def read_metadata(folder: Path) -> Metadata:
    """The metadata of the bag in ``folder``.

    Raises:
        BagError: if it is no YAML, or too large.
        ValueError: if a field is missing or of another type, or a file is named twice.
        OSError: if it cannot be read.
    """
    path = folder / NAME
    check_file(path)
    if (size := path.stat().st_size) > MAX_YAML_BYTES:
        raise ValueError(f'{NAME} has {size} bytes, at most {MAX_YAML_BYTES} are read')
    text = path.read_text(encoding='utf-8')
    about = _take(_checked(checked_yaml(text, NAME), dict, _ROOT), _ROOT, dict)
    # The folder may have been moved, whatever it was called.
    files = [
        folder / PurePath(_checked(one, str, f'relative_file_paths[{number}]')).name
        for number, one in enumerate(_take(about, 'relative_file_paths', list))
    ]
    for number, file in enumerate(files):
        if file in files[:number]:
            where = f'relative_file_paths[{number}]'
            raise ValueError(f'{NAME}: {where} is {shown(file.name)}, expected each file once')
    counts = Counter[Key]()
    for number, one in enumerate(_take(about, 'topics_with_message_count', list)):
        where = f'topics_with_message_count[{number}]'
        count = _take(_checked(one, dict, where), 'message_count', int, where)
        if not 0 <= count < 2**63:
            raise ValueError(
                f'{NAME}: {where}.message_count is {count}, expected 0 to {2**63 - 1}'
            )
        topic, where = _take(one, 'topic_metadata', dict, where), f'{where}.topic_metadata'
        counts[_take(topic, 'name', str, where), _take(topic, 'type', str, where)] += count
    mode = _take({'compression_mode': '', **about}, 'compression_mode', str).lower()
    if mode not in _MODES:
        raise ValueError(
            f'{NAME}: compression_mode is {shown(mode)}, expected one of {", ".join(_MODES[1:])}'
        )
    if mode in _MODES[2:] and _take(about, 'compression_format', str) != 'zstd':
        found = shown(about['compression_format'])
        raise ValueError(f'{NAME}: compression_format is {found}, expected zstd')
    return Metadata(files, counts, mode == 'message', _custom_data(about, text))


def _take(values: Mapping[str, Any], field: str, kind: type, where: str = '') -> Any:
    """The ``field`` at ``where``, of a ``kind``; ValueError if it is missing or of another."""
    place = f'{where}.{field}'.removeprefix('.')
    if field not in values:
        raise ValueError(f'{NAME}: {place} is missing')
    return _checked(values[field], kind, place)


def _checked(value: Any, kind: type, place: str) -> Any:
    if not isinstance(value, kind) or isinstance(value, bool):
        is_plain = isinstance(value, str | int | float | None)
        found = shown(value) if is_plain else type(value).__name__
        raise ValueError(f'{NAME}: {place} is {found}, expected {_KINDS[kind]}')
    return value


def _custom_data(about: Mapping[str, Any], text: str) -> dict[str, str]:
    """Custom data, each entry as it is written: the recorder puts no quotes around 007 or true."""
    if about.get('custom_data') is None:
        return {}
    _take(about, 'custom_data', dict)
    written: dict[str, str] = yaml.load(text, yaml.BaseLoader)[_ROOT]['custom_data']
    for key in written:
        _take(written, key, str, 'custom_data')
    return written
