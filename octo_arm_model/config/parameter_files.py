"""ROS parameter files read and written: parameters by their dotted names."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from octo_arm_model.config.yaml_files import dump_yaml, load_yaml, read_text, reading
from octo_arm_model.core.errors import ConfigError, OctoArmError, shown
from octo_arm_model.core.limits import MAX_YAML_BYTES


def is_of_every_node(name: str) -> bool:
    """Whether ROS declares the parameter ``name`` for every node; `ros2 param dump` writes it."""
    own = ('start_type_description_service', 'use_sim_time')
    return name in own or name.startswith('qos_overrides.')


def parameters_of(text: str) -> dict[str, Any]:
    """Parameters of the one node in ``text``, without those that ROS declares for every node.

    Raises:
        ConfigError: if it is no parameter file.
    """
    values = _flatten(_ros_parameters(load_yaml(text)))
    return {name: value for name, value in values.items() if not is_of_every_node(name)}


def load_parameters(path: str | Path) -> dict[str, Any]:
    """Parameters of a ROS parameter file by their dotted names, for `Config.from_parameters`.

    Raises:
        ConfigError: if the file cannot be read or is no parameter file; the message names it.
    """
    with naming(path):
        return parameters_of(read_text(path, MAX_YAML_BYTES))


def parse_parameters(text: str, name: str) -> dict[str, Any]:
    """As `load_parameters`, from the text of a file, called ``name`` in errors.

    Raises:
        ConfigError: if it is no parameter file.
    """
    with naming(name):
        return parameters_of(text)


def parameters_as_yaml(values: Mapping[str, Any]) -> str:
    """The text of a ROS parameter file with these ``values`` by their dotted names."""
    plain = {
        name: list(value) if isinstance(value, tuple) else value for name, value in values.items()
    }
    return dump_yaml({'/**': {'ros__parameters': plain}})


@contextlib.contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """Convert every error of a parameter file to one that names the file."""
    with reading(path, ConfigError):
        try:
            yield
        except OctoArmError as error:
            raise ConfigError(f'{path}: {error}') from error


def _ros_parameters(document: object) -> Mapping[str, Any]:
    if not isinstance(document, dict):
        raise ConfigError("no node name at the top, expected '/**:' and ros__parameters below it")
    nodes = [
        name
        for name, content in document.items()
        if isinstance(content, dict) and 'ros__parameters' in content
    ]
    if len(nodes) != 1:
        raise ConfigError(
            f'ros__parameters found below {nodes or "no node name"}, '
            "expected exactly one, best below '/**:'"
        )
    parameters = document[nodes[0]]['ros__parameters']
    if not isinstance(parameters, dict):
        raise ConfigError(f'ros__parameters is {shown(parameters)}, expected parameters')
    return parameters


def _flatten(parameters: Mapping[Any, Any], prefix: str = '') -> dict[str, Any]:
    """Nested mappings to dotted names."""
    flat: dict[str, Any] = {}
    for key, value in parameters.items():
        name = f'{prefix}{key}'
        found = _flatten(value, name + '.') if isinstance(value, dict) else {name: value}
        for twice in flat.keys() & found.keys():
            raise ConfigError(f'{twice} is given twice, nested and with a dot')
        flat.update(found)
    return flat
