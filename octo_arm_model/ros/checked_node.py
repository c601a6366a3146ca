"""A node that checks /clock and parameter requests before rclpy, and warnings of messages."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.node import Node
from rclpy.service import Service
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock

from octo_arm_model.arm.errors import OctoArmError, in_short, shown
from octo_arm_model.ros.start import read_here
from octo_arm_model.ros.work import interruptible

WARNING_PERIOD = 1.0  # [s] between warnings of one topic


class RefusalLog:
    """Warns of refused messages.

    Every topic has a period of its own, so that what is refused often does not hide what is
    refused seldom. The logger's own throttle looks up the calling line, which takes longer than to
    solve an arm.
    """

    def __init__(self, node: Node) -> None:
        """Warn by the logger of ``node``."""
        self._node = node
        self._next: dict[str, float] = {}

    def warn(self, topic: str, error: OctoArmError) -> None:
        """Say why a message on ``topic``, a subscribed one, is refused; nothing if too soon."""
        if self._is_time(topic):
            self._node.get_logger().warning(f'{topic} refused: {in_short(error)}')

    def say(self, topic: str, words: str) -> None:
        """Warn of what a message on ``topic`` led to, besides those refused."""
        if self._is_time(f'{topic}:'):
            self._node.get_logger().warning(f'{topic}: {words}')

    def _is_time(self, key: str) -> bool:
        now = time.monotonic()
        if now < self._next.get(key, now):
            return False
        self._next[key] = now + WARNING_PERIOD
        return True


# builtin_interfaces/Time holds seconds of 32 bits, and rclpy takes no negative ones.
_LAST_SECOND = 2**31 - 1
_HIGHEST_TYPE = ParameterType.PARAMETER_STRING_ARRAY
# Services of parameters, and their lists.
_LISTS = {
    DescribeParameters: 'names',
    GetParameterTypes: 'names',
    GetParameters: 'names',
    ListParameters: 'prefixes',
    SetParameters: 'parameters',
    SetParametersAtomically: 'parameters',
}


class CheckedNode(Node):
    """Checks the arguments of rclpy's own callbacks, whose exceptions would end the program.

    Parameters of a node with arguments of its own are read as `start.read_here` does.
    """

    def __init__(self, name: str, **options: Any) -> None:
        """As `Node`.

        Raises:
            ConfigError: if one of its own parameter files cannot be read.
        """
        with read_here(options.pop('cli_args', None) or ()) as given:
            super().__init__(name, cli_args=given or None, **options)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., None], *args: Any, **options: Any
    ) -> Subscription:
        """As `Node.create_subscription`; messages on /clock are checked first."""
        if msg_type is Clock and not options.get('raw'):
            callback = partial(self._take_clock, callback)
        return super().create_subscription(msg_type, topic, callback, *args, **options)

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[..., Any],
        *args: Any,
        **options: Any,
    ) -> Service:
        """As `Node.create_service`; requests of parameters are checked first."""
        if srv_type in _LISTS:
            callback = partial(self._answer_checked, _LISTS[srv_type], callback)
        return super().create_service(
            srv_type, srv_name, interruptible(callback), *args, **options
        )

    def _take_clock(self, take: Callable[[Clock], None], message: Clock) -> None:
        """Set simulated time to ``message``; a time that ROS cannot represent is refused."""
        sec, nanosec = message.clock.sec, message.clock.nanosec
        if sec < 0 or sec + nanosec // 10**9 > _LAST_SECOND:
            self.get_logger().warning(
                f'/clock refused: it is {sec} s and {nanosec} ns, expected 0 to {_LAST_SECOND} s',
                throttle_duration_sec=WARNING_PERIOD,
            )
            return
        take(message)

    def _answer_checked(
        self, field: str, answer: Callable[..., Any], request: Any, response: Any
    ) -> Any:
        """Answer a ``request`` whose list ``field`` is not too long, of known names and types."""
        given, most = getattr(request, field), len(self._parameters)
        if len(given) <= most:
            problems = [self._problem(one) for one in given]
        else:
            problems = [
                f'{len(given)} {field} in one request, expected at most {most}: no more exist'
            ]
        if not any(problems):
            return answer(request, response)
        reason = next(filter(None, problems))
        self.get_logger().warning(f'refused: {reason}', throttle_duration_sec=WARNING_PERIOD)
        if isinstance(response, SetParametersAtomically.Response):
            response.result = _refusal(reason)
        elif isinstance(response, SetParameters.Response):
            # Each by itself: what has no problem is set.
            request.parameters = [one for one, problem in zip(given, problems) if not problem]
            done = iter(answer(request, response).results)
            response.results = [_refusal(one) if one else next(done) for one in problems]
        return response

    def _problem(self, one: Any) -> str:
        """Why ``one`` is no parameter of this node, or of no type that rclpy knows; or ''."""
        if not isinstance(one, Parameter):
            return ''
        if one.name not in self._parameters:
            return f'{shown(one.name)} is no parameter of this node'  # rclpy does not say which
        if one.value.type > _HIGHEST_TYPE:
            return f'{one.name} is of type {one.value.type}, expected 0 to {_HIGHEST_TYPE}'
        return ''


def _refusal(reason: str) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=reason)
