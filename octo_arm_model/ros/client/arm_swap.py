"""Give a running node another arm: all parameters of the arm set in one atomic call."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import rclpy
from rcl_interfaces.srv import ListParameters, SetParametersAtomically
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.config.parameter import Parameter, refuse_unknown
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.ros.live_parameters import ros_parameter
from octo_arm_model.ros.start import client_node

_QUESTIONS = 2  # requests sent before a node counts as one that does not answer


def swap_arm(
    values: Mapping[str, Any], others: Sequence[Parameter], node_name: str, timeout: float
) -> None:
    """Give the node ``node_name`` the arm that ``values`` describe, in one step or not at all.

    Parameters of the arm missing in ``values`` return to their defaults; other parameters of the
    node are set if given and unchanged if not.

    Args:
        values: by their dotted names.
        others: parameters that the node may have besides those of the arm.
        node_name: with its namespace, such as ``/octo_arm``.
        timeout: to wait for the node, and then for each of its answers [s].

    Raises:
        ConfigError: if there is no such node, it has no arm, it does not know a parameter, a value
            is of the wrong type, or the node refuses.
    """
    with client_node('octo_arm_load') as node:
        _swap(node, values, others, node_name, timeout)


def _swap(
    node: Node,
    values: Mapping[str, Any],
    others: Sequence[Parameter],
    node_name: str,
    timeout: float,
) -> None:
    try:
        client = AsyncParameterClient(node, node_name)
    except NameValidationException as error:
        expected = 'expected the name of a node, such as /octo_arm'
        raise ConfigError(f'--node is {node_name!r}, {expected}') from error
    if not client.wait_for_services(timeout):
        raise ConfigError(
            f'no node {node_name} within {timeout} s: `ros2 node list` names those that run'
        )
    listed: ListParameters.Response = _ask(node, client.list_parameters, node_name, timeout)
    names = set(listed.result.names)
    arm = {parameter.name: parameter for parameter in PARAMETERS}
    if not names >= arm.keys():
        raise ConfigError(f'{node_name} has no arm, expected an octo_arm_node or octo_arm_sim')
    known = arm | {p.name: p for p in others if p.name in names}
    refuse_unknown(values, list(known), node_name)
    wanted = {name: parameter.default_or_none_given for name, parameter in arm.items()}
    wanted.update(values)
    changes = [ros_parameter(known[name], value) for name, value in wanted.items()]
    answer: SetParametersAtomically.Response = _ask(
        node, lambda: client.set_parameters_atomically(changes), node_name, timeout
    )
    if not answer.result.successful:
        raise ConfigError(f'{node_name} stays as it is: {answer.result.reason}')


def _ask(node: Node, ask: Callable[[], Future], node_name: str, timeout: float) -> Any:
    """Result of the request ``ask``, sent up to twice; ConfigError after ``timeout`` [s]."""
    # A server that has not discovered the reader of its answers yet loses the first.
    asked, begin = list[Future](), time.monotonic()
    for part in range(_QUESTIONS):
        asked.append(ask())
        while (left := begin + (part + 1) / _QUESTIONS * timeout - time.monotonic()) > 0.0:
            rclpy.spin_once(node, timeout_sec=left)
            for answer in asked:
                if answer.done():
                    return answer.result()
    raise ConfigError(f'{node_name} has not answered within {timeout} s')
