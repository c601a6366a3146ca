"""Parameters of the node: declared from the one table, read as the core wants them.

Each is declared with a value: where one has none, rclpy answers a request for several parameters
with an empty list, and `ros2 param dump` prints nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from octo_arm_model.config.config import is_of_every_node
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
_LISTS = (
    RosParameter.Type.BYTE_ARRAY,
    RosParameter.Type.BOOL_ARRAY,
    RosParameter.Type.INTEGER_ARRAY,
    RosParameter.Type.DOUBLE_ARRAY,
    RosParameter.Type.STRING_ARRAY,
)


def read_parameters(node: Node, table: Sequence[Parameter] = PARAMETERS) -> dict[str, Any]:
    """Declare every parameter of ``table`` on ``node``; return what was given.

    Names that are not in the table are returned as well, but not declared.

    Raises:
        ConfigError: if a value is of another type than ROS needs.
    """
    # rclpy has no public name for them. To declare them all by itself, as it offers, fails for an
    # empty list, of which a file does not say the type.
    overrides = node._parameter_overrides
    given = {
        name: [] if parameter.value is None else plain_value(parameter.value)
        for name, parameter in overrides.items()
        if not is_of_every_node(name)
    }
    check_types(given, table)
    values = []
    for parameter in table:
        descriptor = ParameterDescriptor(
            name=parameter.name,
            description=parameter.description,
            additional_constraints=parameter.range,
        )
        ros_type = _ROS_TYPES[parameter.type_name]
        node.declare_parameter(parameter.name, ros_type, descriptor, ignore_override=True)
        value = given.get(parameter.name, parameter.default_or_none_given)
        values.append(ros_parameter(parameter, value))
    # Together, and with their type, which rclpy cannot tell from an empty list.
    node.set_parameters_atomically(values)
    return given


def plain_value(value: Any) -> Any:
    """The ``value`` of a parameter as YAML has it: lists instead of arrays."""
    return list(value) if hasattr(value, 'typecode') or isinstance(value, tuple) else value


def ros_parameter(parameter: Parameter, value: Any) -> RosParameter:
    """The ``parameter`` with ``value``, as rclpy sets it.

    Raises:
        ConfigError: if the value is of another type.
    """
    converted = parameter.convert(value)
    plain = list(converted) if parameter.is_array else converted
    return RosParameter(parameter.name, _ROS_TYPES[parameter.type_name], plain)


def type_empty_lists(
    changes: Sequence[RosParameter], table: Sequence[Parameter]
) -> list[RosParameter]:
    """The ``changes``, with every empty list as one of what its parameter holds.

    Whoever reads it from a file takes it for one of booleans, as `ros2 param load` does.
    """
    lists = {parameter.name: parameter for parameter in table if parameter.is_array}
    return [
        ros_parameter(lists[change.name], [])
        if change.name in lists and change.type_ in _LISTS and not len(change.value)
        else change
        for change in changes
    ]


def check_types(given: Mapping[str, Any], table: Sequence[Parameter] = PARAMETERS) -> None:
    """Explain what ROS would not take.

    Raises:
        ConfigError: if a value is of another type than its parameter, or an integer is given where
            ROS needs a double.
    """
    for parameter in table:
        if parameter.name in given:
            _explain_integers(parameter, given[parameter.name])
            parameter.convert(given[parameter.name])


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
