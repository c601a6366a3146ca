"""The fields of metadata.yaml, checked before rosbags reads them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

import yaml

from octo_arm_model.arm.errors import shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.bags.storages import check_compressed_file, check_file, checked_yaml
from octo_arm_model.config.files import compose_yaml

NAME = 'metadata.yaml'
_ROOT = 'rosbag2_bagfile_information'
_NONE, _FILE = ('', 'none'), 'file'
_MODES = (*_NONE, _FILE, 'message')

# What a field is: a type; a range of integers; texts to choose from, in a tuple; a map of fields,
# of which those with a question mark may be missing or null; or a list, all of one kind.
_COUNT, _INTEGER = range(2**63), range(-(2**63), 2**63)
_DURATION = dict.fromkeys(('sec', 'nsec'), range(-(2**63), 2**64))
_QOS = {
    **dict.fromkeys(('history', 'reliability', 'durability', 'liveliness'), int | str),
    'depth': _COUNT,
    **dict.fromkeys(('deadline', 'lifespan', 'liveliness_lease_duration'), _DURATION),
    'avoid_ros_namespace_conventions': bool,
}
_TOPIC = {
    'message_count': _COUNT,
    'topic_metadata': {
        'name': str, 'type': str, 'serialization_format': str, 'type_description_hash?': str,
    },
}  # fmt: skip
_BAG = {
    'version': range(1, 10),  # to that of Jazzy, the newest
    'storage_identifier': ('mcap', 'sqlite3'),
    'relative_file_paths': [str],
    'duration': {'nanoseconds': _COUNT},
    'starting_time': {'nanoseconds_since_epoch': _INTEGER},
    'message_count': _COUNT,
    'topics_with_message_count': [_TOPIC],
}
_EXPECTED = {
    int: 'an integer', str: 'text', list: 'a list', dict: 'a map', bool: 'true or false',
}  # fmt: skip


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
    _check(whole, {_ROOT: _BAG})
    about = whole[_ROOT]
    # rosbags looks beside the metadata, whatever folder is named.
    files = [folder / PurePath(file).name for file in about['relative_file_paths']]
    for number, file in enumerate(files):
        check_file(file)
        if file in files[:number]:
            where = f'relative_file_paths[{number}]'
            raise ValueError(f'{NAME}: {where} is {shown(file.name)}, expected each file once')
    for number, topic in enumerate(about['topics_with_message_count']):
        where = f'topics_with_message_count[{number}].topic_metadata.offered_qos_profiles'
        profiles = topic['topic_metadata'].get('offered_qos_profiles') or []
        if isinstance(profiles, str):
            profiles = checked_yaml(profiles, where) or []
        _check(profiles, [_QOS], where)
    mode = 'none'
    if 'compression_mode' in about:
        _check(about, {'compression_mode': str})
        mode = about['compression_mode'].lower()
        if mode not in _MODES:
            _check(about, {'compression_mode': _MODES})
    if mode not in _NONE:
        _check(about, {'compression_format': ('zstd',)})
    if mode == _FILE:
        for file in files:
            check_compressed_file(file)
    if 'files' in about:
        _check(about, {'files': list})
    _check(about, {'custom_data?': dict})
    return _custom_data(about, text)


def _check(value: Any, kind: Any, where: str = '') -> None:
    """Check that the ``value`` at ``where`` is of a ``kind``, see above; ValueError if not."""
    expected = ''
    if isinstance(kind, dict):
        _check_type(value, dict, where)
        for field, inner in kind.items():
            name = field.removesuffix('?')
            place = f'{where}.{name}'.removeprefix('.').removeprefix(f'{_ROOT}.')
            if value.get(name) is not None or (name in value and name == field):
                _check(value[name], inner, place)
            elif name == field:
                raise ValueError(f'{NAME}: {place} is missing')
    elif isinstance(kind, list):
        _check_type(value, list, where)
        for number, one in enumerate(value):
            _check(one, kind[0], f'{where}[{number}]')
    elif isinstance(kind, range):
        _check_type(value, int, where)
        expected = f'{kind.start} to {kind.stop - 1}'
    elif isinstance(kind, tuple):
        _check_type(value, str, where)
        expected = f'one of {", ".join(map(repr, kind))}'
    else:
        _check_type(value, kind, where)
    if expected and value not in kind:
        raise ValueError(f'{NAME}: {where} is {_shown(value)}, expected {expected}')


def _check_type(value: object, kind: Any, where: str) -> None:
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        expected = _EXPECTED.get(kind, _EXPECTED[str])
        raise ValueError(f'{NAME}: {where} is {_shown(value)}, expected {expected}')


def _custom_data(about: Mapping[str, Any], text: str) -> dict[str, str]:
    """Custom data, each entry as it is written: the recorder puts no quotes around 007 or true."""
    custom = about.get('custom_data')
    if custom is None:
        return {}
    node = compose_yaml(text)
    for name in (_ROOT, 'custom_data'):
        assert isinstance(node, yaml.MappingNode)  # as it was loaded
        node = next(value for key, value in node.value if key.value == name)
    assert isinstance(node, yaml.MappingNode)
    written = {
        key.value: value.value if isinstance(value, yaml.ScalarNode) else custom[key.value]
        for key, value in node.value
    }
    for key, value in written.items():
        _check(value, str, f'custom_data.{key}')
    return written


def _shown(value: object) -> str:
    """A value in an error; of lists and maps the type."""
    is_plain = isinstance(value, str | int | float | None)
    return shown(value) if is_plain else type(value).__name__
