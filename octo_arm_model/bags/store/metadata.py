"""The fields of metadata.yaml, checked before rosbags reads them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

import yaml

from octo_arm_model.bags.store.limits import check_compressed_file, check_file, checked_yaml
from octo_arm_model.config.yaml_files import compose_yaml
from octo_arm_model.core.errors import shown
from octo_arm_model.core.limits import MAX_YAML_BYTES

NAME = 'metadata.yaml'
_ROOT = 'rosbag2_bagfile_information'
_NEWEST = 9  # version
_STORAGES = ('mcap', 'sqlite3')
_NONE, _FILE = ('', 'none'), 'file'
_MODES = (*_NONE, _FILE, 'message')
_KINDS = {int: 'an integer', str: 'text', list: 'a list', dict: 'a map'}


def check_folder(folder: Path) -> dict[str, str]:
    """Check the metadata of the bag in ``folder`` and its files; returns its custom data.

    Raises:
        BagError: if its metadata is no YAML, or too large.
        ValueError: if a field is missing, of another type or out of its range, or a file of the
            bag is not a regular file.
        OSError: if a file cannot be read or is not there.
    """
    path = folder / NAME
    check_file(path)
    if (size := path.stat().st_size) > MAX_YAML_BYTES:
        raise ValueError(f'{NAME} has {size} bytes, at most {MAX_YAML_BYTES} are read')
    text = path.read_text(encoding='utf-8')
    whole = checked_yaml(text, NAME)
    if not isinstance(whole, dict):
        raise ValueError(f'{NAME} is {_shown(whole)}, expected {_ROOT} with the fields of a bag')
    about = _field(whole, _ROOT, dict)
    _field(about, 'version', int, lowest=1, highest=_NEWEST)
    _choice(about, 'storage_identifier', _STORAGES)
    files = _field(about, 'relative_file_paths', list)
    for number, file in enumerate(files):
        # rosbags looks beside the metadata, whatever folder is named.
        check_file(folder / PurePath(_typed(file, f'relative_file_paths[{number}]', str)).name)
    for name, part in (('duration', 'nanoseconds'), ('starting_time', 'nanoseconds_since_epoch')):
        _field(_field(about, name, dict), part, int, f'{name}.', lowest=-(2**63))
    _field(about, 'message_count', int)
    for number, topic in enumerate(_field(about, 'topics_with_message_count', list)):
        _check_topic(topic, f'topics_with_message_count[{number}]')
    mode = 'none'
    if 'compression_mode' in about:
        mode = _field(about, 'compression_mode', str).lower()
        if mode not in _MODES:
            _choice(about, 'compression_mode', _MODES)
    if mode not in _NONE:
        _choice(about, 'compression_format', ('zstd',))
    if mode == _FILE:
        for file in files:
            check_compressed_file(folder / PurePath(file).name)
    if 'files' in about:
        _field(about, 'files', list)
    return _custom_data(about, text)


def _check_topic(topic: object, where: str) -> None:
    """Check an entry of topics_with_message_count."""
    entry = _typed(topic, where, dict)
    _field(entry, 'message_count', int, f'{where}.')
    about = _field(entry, 'topic_metadata', dict, f'{where}.')
    where = f'{where}.topic_metadata'
    for name in ('name', 'type', 'serialization_format'):
        _field(about, name, str, f'{where}.')
    if about.get('type_description_hash') is not None:
        _field(about, 'type_description_hash', str, f'{where}.')
    profiles = about.get('offered_qos_profiles') or []
    if isinstance(profiles, str):
        profiles = checked_yaml(profiles, f'{where}.offered_qos_profiles') or []
    for number, profile in enumerate(_typed(profiles, f'{where}.offered_qos_profiles', list)):
        _check_qos(profile, f'{where}.offered_qos_profiles[{number}]')


def _check_qos(profile: object, where: str) -> None:
    """Check how a topic was published."""
    about = _typed(profile, where, dict)
    for name in ('history', 'reliability', 'durability', 'liveliness'):
        if not isinstance(about.get(name), int | str):
            _field(about, name, str, f'{where}.')
    _field(about, 'depth', int, f'{where}.')
    for name in ('deadline', 'lifespan', 'liveliness_lease_duration'):
        time = _field(about, name, dict, f'{where}.')
        for part in ('sec', 'nsec'):
            _field(time, part, int, f'{where}.{name}.', lowest=-(2**63), highest=2**64 - 1)
    name = 'avoid_ros_namespace_conventions'
    if not isinstance(about.get(name), bool):
        shown = _shown(about.get(name))
        raise ValueError(f'{NAME}: {where}.{name} is {shown}, expected true or false')


def _custom_data(about: Mapping[str, Any], text: str) -> dict[str, str]:
    """Custom data, each entry as it is written: the recorder puts no quotes around 007 or true."""
    if about.get('custom_data') is None:
        return {}
    custom = _field(about, 'custom_data', dict)
    node = compose_yaml(text)
    for name in (_ROOT, 'custom_data'):
        assert isinstance(node, yaml.MappingNode)  # as it was loaded
        node = next(value for key, value in node.value if key.value == name)
    assert isinstance(node, yaml.MappingNode)
    written = {
        key.value: value.value if isinstance(value, yaml.ScalarNode) else custom[key.value]
        for key, value in node.value
    }
    return {key: _typed(value, f'custom_data.{key}', str) for key, value in written.items()}


def _field(
    fields: Mapping[str, Any],
    name: str,
    kind: type,
    where: str = '',
    lowest: int = 0,
    highest: int = 2**63 - 1,
) -> Any:
    """The field ``name``, of type ``kind``; integers within their range."""
    if name not in fields:
        raise ValueError(f'{NAME}: {where}{name} is missing')
    value = _typed(fields[name], where + name, kind)
    if kind is int and not lowest <= value <= highest:
        raise ValueError(
            f'{NAME}: {where}{name} is {_shown(value)}, expected {lowest} to {highest}'
        )
    return value


def _typed(value: object, where: str, kind: type) -> Any:
    """The ``value``, if it is of type ``kind``."""
    if not isinstance(value, kind) or isinstance(value, bool):
        raise ValueError(f'{NAME}: {where} is {_shown(value)}, expected {_KINDS[kind]}')
    return value


def _choice(fields: Mapping[str, Any], name: str, choices: tuple[str, ...]) -> None:
    """Check that the field ``name`` is one of ``choices``."""
    if _field(fields, name, str) not in choices:
        listed = ', '.join(map(repr, choices))
        raise ValueError(f'{NAME}: {name} is {_shown(fields[name])}, expected one of {listed}')


def _shown(value: object) -> str:
    """A value in an error; of lists and maps the type."""
    is_plain = isinstance(value, str | int | float | None)
    return shown(value) if is_plain else type(value).__name__
