"""The text of a ROS parameter file as parameters by their dotted names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from octo_arm_model.config.yaml_files import load_yaml
from octo_arm_model.core.errors import ConfigError, shown


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
