"""Parameters that change while a node runs: checked together first, then taken together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from octo_arm_model.config.parameters import Parameter
from octo_arm_model.core.errors import OctoArmError
from octo_arm_model.ros.declared_parameters import (
    check_types,
    plain_value,
    read_parameters,
    type_empty_lists,
)

Prepared = TypeVar('Prepared')


class LiveParameters(Generic[Prepared]):
    """Keeps what the parameters of a node make, in step with them."""

    def __init__(
        self,
        node: Node,
        table: Sequence[Parameter],
        prepare: Callable[[dict[str, Any]], Prepared],
        use: Callable[[Prepared, set[str]], None],
    ) -> None:
        """Declare ``table`` on ``node``.

        Between `begin` and `end`, ``use`` gets what ``prepare`` makes of them and the names that
        were set, at every change that it can make something of. Others are always refused with
        its reason.

        Raises:
            ConfigError: if a value is of another type than ROS needs.
        """
        self._table, self._prepare, self._use = table, prepare, use
        self._values = read_parameters(node, table)
        self._candidate: tuple[dict[str, Any], Prepared] | None = None
        self._names = {parameter.name for parameter in table} | set(self._values)
        self._is_used = False
        node.add_pre_set_parameters_callback(lambda given: type_empty_lists(given, table))
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._swap)

    def begin(self) -> None:
        """Use what the parameters make.

        Raises:
            OctoArmError: if nothing can be made of them.
        """
        self._use(self._prepare(self._values), set(self._values))
        self._is_used = True

    def end(self) -> None:
        """Use it no more; changes are kept for the next time."""
        self._is_used = False

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        """Whether something can be made with these ``parameters``; nothing is changed yet."""
        changed = {p.name: p.value for p in parameters if p.name in self._names}
        self._candidate = None
        if not changed:
            return SetParametersResult(successful=True)
        values = {
            name: plain_value(value)
            for name, value in {**self._values, **changed}.items()
            if value is not None
        }
        try:
            check_types(values, self._table)
            self._candidate = values, self._prepare(values)
        except OctoArmError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _swap(self, parameters: list[RosParameter]) -> None:
        """Take what `_check` prepared."""
        candidate, self._candidate = self._candidate, None
        if candidate is not None:
            self._values, prepared = candidate
            if self._is_used:
                self._use(prepared, {parameter.name for parameter in parameters})
