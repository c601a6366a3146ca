"""The parameters of a node: declared with values and types, and changed together at run time.

Every parameter has a value: if one has none, rclpy answers a request for several parameters with
an empty list, and `ros2 param dump` prints nothing.
"""

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.config.parameter import Parameter
from octo_arm_model.config.parameter_files import is_of_every_node

Prepared = TypeVar('Prepared')


class LiveParameters(Generic[Prepared]):
    """Rebuilds an object from the parameters of a node whenever they change."""

    def __init__(
        self,
        node: Node,
        table: Sequence[Parameter],
        prepare: Callable[[dict[str, Any]], Prepared],
        use: Callable[[Prepared, set[str]], None],
    ) -> None:
        """Declare ``table`` on ``node``; ConfigError if a value has the wrong type.

        ``prepare`` builds the object from the values. If it raises an `OctoArmError`, the change
        is refused with that message. Between `begin` and `end`, ``use`` is called with each new
        object and the names of the parameters that were set.
        """
        self._prepare, self._use = prepare, use
        self._values = _declare(node, table)
        self._candidate: tuple[dict[str, Any], Prepared] | None = None
        self._names = {parameter.name for parameter in table} | set(self._values)
        self._is_used = False
        parameters = {parameter.name: parameter for parameter in table}
        node.add_pre_set_parameters_callback(
            lambda changes: [_typed(change, parameters.get(change.name)) for change in changes]
        )
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._swap)

    def begin(self) -> None:
        """Use the object of the present values; OctoArmError if ``prepare`` refuses them."""
        self._use(self._prepare(self._values), set(self._values))
        self._is_used = True

    def end(self) -> None:
        """Stop calling ``use``; changes are kept for the next `begin`."""
        self._is_used = False

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        """Build the object for the changed ``parameters`` without using it, or refuse them."""
        changed = {p.name: p.value for p in parameters if p.name in self._names}
        self._candidate = None
        if not changed:
            return SetParametersResult(successful=True)
        values = {
            name: _plain(value)
            for name, value in {**self._values, **changed}.items()
            if value is not None
        }
        try:
            self._candidate = values, self._prepare(values)
        except OctoArmError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _swap(self, parameters: list[RosParameter]) -> None:
        candidate, self._candidate = self._candidate, None
        if candidate is not None:
            self._values, prepared = candidate
            if self._is_used:
                self._use(prepared, {parameter.name for parameter in parameters})


def _declare(node: Node, table: Sequence[Parameter]) -> dict[str, Any]:
    """Declare the ``table`` on ``node``; return all its initial values, of other names too."""
    # This attribute is private in rclpy, whose automatic declaration fails for an empty list: a
    # file does not state the type of one.
    overrides = node._parameter_overrides
    initial_values = {
        name: [] if parameter.value is None else _plain(parameter.value)
        for name, parameter in overrides.items()
        if not is_of_every_node(name)
    }
    values = []
    for parameter in table:
        descriptor = ParameterDescriptor(
            name=parameter.name,
            description=parameter.description,
            additional_constraints=parameter.range,
        )
        ros_type = _ros_type(parameter)
        node.declare_parameter(parameter.name, ros_type, descriptor, ignore_override=True)
        value = initial_values.get(parameter.name, parameter.default_or_none_given)
        values.append(ros_parameter(parameter, value))
    # The values are typed because rclpy cannot derive the type of an empty list.
    node.set_parameters_atomically(values)
    return initial_values


def _plain(value: Any) -> Any:
    """Return the ``value`` of a parameter, with arrays and tuples converted to lists."""
    return list(value) if hasattr(value, 'typecode') or isinstance(value, tuple) else value


def ros_parameter(parameter: Parameter, value: Any) -> RosParameter:
    """Return ``parameter`` with ``value`` for rclpy; ConfigError if it has the wrong type."""
    converted = parameter.convert(value)
    plain = list(converted) if parameter.is_array else converted
    return RosParameter(parameter.name, _ros_type(parameter), plain)


def _ros_type(parameter: Parameter) -> RosParameter.Type:
    """Return the rclpy type of a ``parameter``, such as DOUBLE_ARRAY for ``double[]``."""
    return RosParameter.Type[parameter.type_name.upper().replace('[]', '_ARRAY')]


def _typed(change: RosParameter, parameter: Parameter | None) -> RosParameter:
    """Return ``change`` with integers and empty lists converted to the declared type."""
    # `ros2 param` reads 1 as an integer, and an empty list in a file as one of booleans.
    kind, is_list = change.type_, change.type_.name.endswith('_ARRAY')
    if parameter is None or parameter.is_array != is_list:
        return change
    if is_list and not len(change.value):
        return RosParameter(change.name, _ros_type(parameter), [])
    if parameter.kind is float and kind.name.startswith('INTEGER'):
        value = [*map(float, change.value)] if is_list else float(change.value)
        return RosParameter(change.name, _ros_type(parameter), value)
    return change
