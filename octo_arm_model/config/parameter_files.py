"""ROS parameter files, read and written, and the files of the preset arms."""

import contextlib
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from octo_arm_model.arm.errors import ConfigError, OctoArmError, printable, shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.arm.validation import check_class
from octo_arm_model.config.files import dump_yaml, load_yaml, read_text, reading


def find_path(name: str | Path) -> Path:
    """Return the path of the parameter file ``name``, or of the preset if ``name`` is no path.

    A name is a path if it has a suffix or a folder, or if that file exists.

    Raises:
        ConfigError: if there is no such preset.
        ArmDefinitionError: if ``name`` is neither a text nor a path.
    """
    check_class('name of a file or preset', name, str, os.PathLike)
    path = Path(name)
    is_path = path.suffix or len(path.parts) > 1 or os.path.exists(name)
    return path if is_path else preset_path(str(name))


def preset_path(name: str) -> Path:
    """Return the path of the parameter file of a preset arm such as ``renda2012_table4``.

    Raises:
        ConfigError: if there is no such preset; the message lists all presets.
    """
    for parent in Path(__file__).resolve().parents[1:]:
        for folder in (parent / 'config', parent / 'share' / 'octo_arm_model' / 'config'):
            if (folder / 'renda2012_table4.yaml').is_file():
                names = {file.stem for file in folder.glob('*.yaml')} - {'simulator'}
                if name in names:
                    return folder / f'{name}.yaml'
                known = ', '.join(sorted(names))
                raise ConfigError(f'no preset arm {shown(name)}, expected one of {known}')
    raise ConfigError(f'no preset arm {shown(name)}: the presets are not installed')


# For each node its name, with its namespace, and its parameters by their dotted names.
Nodes: TypeAlias = list[tuple[str, dict[str, Any]]]


def is_of_every_node(name: str) -> bool:
    """Whether ROS declares the parameter ``name`` for every node, as `ros2 param dump` writes."""
    declared = ('start_type_description_service', 'use_sim_time')
    return name in declared or name.startswith('qos_overrides.')


def parameters_of(text: str) -> dict[str, Any]:
    """Return the parameters of the node in ``text``, without those that every node has in ROS.

    If there are several nodes, they are the parameters that ROS gives to a node /octo_arm.

    Raises:
        ConfigError: if it is no parameter file.
    """
    nodes = nodes_of(text)
    groups = [values for name, values in nodes if len(nodes) == 1 or _is_ours(name)]
    if not groups:
        raise ConfigError(
            f'ros__parameters found below {[name for name, _ in nodes] or "no node name"}, '
            "expected exactly one, best below '/**:', or /octo_arm among them"
        )
    values = {name: value for group in groups for name, value in group.items()}
    return {name: value for name, value in values.items() if not is_of_every_node(name)}


def load_parameters(name: str | Path) -> dict[str, Any]:
    """Return the parameters of a ROS parameter file or preset by their dotted names.

    `Config.from_parameters` takes them.

    Raises:
        ConfigError: if there is no such preset, or the file cannot be read or is no parameter
            file; the message names the file.
    """
    path = find_path(name)
    with naming(path):
        return parameters_of(read_text(path, MAX_YAML_BYTES))


def parse_parameters(text: str, name: str) -> dict[str, Any]:
    """Return the parameters in the ``text`` of a file, which errors call ``name``.

    Raises:
        ConfigError: if it is no parameter file.
    """
    with naming(name):
        return parameters_of(text)


def parameters_as_yaml(values: Mapping[str, Any], node: str = '/**') -> str:
    """Return the text of a ROS parameter file with these ``values`` by their dotted names.

    rcl reads neither aliases, nor a list of integers and floats, nor anything besides nodes.
    """
    return dump_yaml({node: {'ros__parameters': dict(values)}})


@contextlib.contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """Convert every error of a parameter file to a ConfigError that names the file."""
    with reading(path, ConfigError):
        try:
            yield
        except OctoArmError as error:
            raise ConfigError(f'{path}: {error}') from error


def nodes_of(text: str) -> Nodes:
    """Return the nodes in the ``text`` of a parameter file, for use within `naming`.

    Raises:
        ConfigError: if it is no parameter file.
    """
    document = load_yaml(text)
    if not isinstance(document, dict):
        raise ConfigError("no node name at the top, expected '/**:' and ros__parameters below it")
    return list(_nodes_of(document, ''))


def _nodes_of(
    names: Mapping[str, Any], namespace: str, beside: bool = False
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the nodes in ``names``; what is ``beside`` the parameters of a node must be nodes."""
    for key, content in names.items():
        name = f'{namespace}/{key}'.replace('//', '/')
        if not isinstance(content, dict):
            if beside:
                where = f'{printable(name)} is {shown(content)}'
                raise ConfigError(f'{where} beside ros__parameters, expected it below them')
            continue
        others = dict(content)
        if is_node := 'ros__parameters' in others:
            parameters = others.pop('ros__parameters')
            if not isinstance(parameters, dict):
                raise ConfigError(f'ros__parameters is {shown(parameters)}, expected parameters')
            yield name, _flatten(parameters)
        yield from _nodes_of(others, name, beside or is_node)


def _is_ours(name: str) -> bool:
    """Whether the ``name`` of a node, perhaps with wildcards, stands for /octo_arm in ROS."""
    pattern = re.escape(name).replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')
    return re.fullmatch(pattern, '/octo_arm') is not None


def _flatten(parameters: Mapping[Any, Any], prefix: str = '') -> dict[str, Any]:
    """Return nested mappings as one with dotted names, and values of one type each."""
    flat: dict[str, Any] = {}
    for key, value in parameters.items():
        name = f'{prefix}{key}'
        if isinstance(value, dict):
            entries = _flatten(value, name + '.')
        else:
            entries = {name: value_of_one_type(name, value)}
        for duplicate in flat.keys() & entries.keys():
            raise ConfigError(f'{duplicate} is given twice, nested and with a dot')
        flat.update(entries)
    return flat


def value_of_one_type(name: str, value: Any) -> Any:
    """Return the ``value`` of the parameter ``name``; a list with any float has floats only.

    Raises:
        ConfigError: if there is no value, or a list has values of several types, or lists in it.
    """
    if value is None:
        raise ConfigError(f'{name} has no value')
    if not isinstance(value, list):
        return value
    kinds = {*map(type, value)}
    if kinds == {int, float}:
        with contextlib.suppress(OverflowError):
            return [float(number) for number in value]
    if len(kinds) > 1 or not kinds <= {bool, int, float, str}:
        raise ConfigError(f'{name} is {shown(value)}, expected a list of values of one type')
    return value
