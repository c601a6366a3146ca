"""Parameters of the node: declared from the one table, read as the core wants them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from octo_arm_model.config.parameters import PARAMETERS, Parameter
from octo_arm_model.core.errors import ConfigError

_ROS_TYPES = {
    'bool': RosParameter.Type.BOOL,
    'double': RosParameter.Type.DOUBLE,
    'double[]': RosParameter.Type.DOUBLE_ARRAY,
    'integer': RosParameter.Type.INTEGER,
    'integer[]': RosParameter.Type.INTEGER_ARRAY,
    'string': RosParameter.Type.STRING,
    'string[]': RosParameter.Type.STRING_ARRAY,
}
# What every rclpy node declares for itself.
_RCLPY_PARAMETERS = ('start_type_description_service', 'use_sim_time')


def read_parameters(node: Node, table: Sequence[Parameter] = PARAMETERS) -> dict[str, Any]:
    """Declare every parameter of ``table`` on ``node``; return what was given.

    Raises:
        ConfigError: if an integer is given where ROS needs a double.
    """
    given = {
        name: node.get_parameter(name).value
        for name in node.get_parameters_by_prefix('')
        if name not in _RCLPY_PARAMETERS and not name.startswith('qos_overrides.')
    }
    check_types(given, table)
    for parameter in table:
        descriptor = ParameterDescriptor(
            name=parameter.name,
            description=parameter.description,
            additional_constraints=parameter.range,
            type=_ROS_TYPES[parameter.type_name].value,
        )
        if parameter.name in given:
            node.set_descriptor(parameter.name, descriptor)
        elif parameter.default not in (None, ()):
            value = parameter.default
            value = list(value) if parameter.is_array else value
            node.declare_parameter(parameter.name, value, descriptor)
        else:
            ros_type = _ROS_TYPES[parameter.type_name]
            node.declare_parameter(parameter.name, ros_type, descriptor)
    return {name: list(v) if hasattr(v, 'typecode') else v for name, v in given.items()}


def check_types(given: Mapping[str, Any], table: Sequence[Parameter] = PARAMETERS) -> None:
    """Explain what ROS would not take.

    Raises:
        ConfigError: if an integer is given where ROS needs a double.
    """
    for parameter in table:
        if parameter.name in given:
            _explain_integers(parameter, given[parameter.name])


def _explain_integers(parameter: Parameter, value: Any) -> None:
    """Say what to write where YAML makes integers of what are meant as doubles."""
    if parameter.kind is not float:
        return
    elements = value if hasattr(value, '__len__') and not isinstance(value, str) else [value]
    if any(isinstance(element, int) and not isinstance(element, bool) for element in elements):
        meant = ', '.join(str(float(element)) for element in elements)
        meant = f'[{meant}]' if parameter.is_array else meant
        raise ConfigError(
            f'{parameter.name} is an integer, expected {parameter.type_name}: ROS keeps the two '
            f'apart, write {meant}'
        )
