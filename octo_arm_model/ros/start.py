"""Start and end ROS, and a node that checks /clock, parameters and messages before rclpy does."""

import contextlib
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces import srv
from rcl_interfaces.msg import Parameter, ParameterType, SetParametersResult
from rclpy.node import Node
from rclpy.service import Service
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock

from octo_arm_model import terminal
from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.arm.limits import MAX_YAML_BYTES
from octo_arm_model.config import parameter_files
from octo_arm_model.config.files import load_yaml, read_text
from octo_arm_model.ros.work import guarded

# NAME is a parameter of all nodes, NODE:NAME one of a single node.
_TARGET = re.compile(r'(?:([\w/*]+):)?([\w./]+)', re.ASCII)


def start_ros(
    arguments: Sequence[str], signals: SignalHandlerOptions = SignalHandlerOptions.NO
) -> None:
    """Initialise rclpy; ConfigError if arguments are invalid, or logs cannot be written."""
    with read_here(arguments) as ros_arguments:
        try:
            rclpy.init(args=ros_arguments, signal_handler_options=signals)
        except RuntimeError as error:  # rcl raises this type
            reason = str(error).split(', at /')[0]
            if 'logging' in reason.lower():
                reason += (
                    '; logs are written to ROS_LOG_DIR, else below ROS_HOME or HOME: set one to a '
                    'folder that can be written'
                )
            raise ConfigError(reason) from error


@contextlib.contextmanager
def read_here(arguments: Sequence[str]) -> Iterator[list[str]]:
    """Yield ROS ``arguments`` whose parameter files this package has read, instead of rcl.

    Files may be presets. The parameters set by files and by -p are written to one temporary file,
    which rcl must read within the block. The last of several values of a parameter counts.

    Raises:
        ConfigError: if a file is not a parameter file, or the temporary file cannot be written.
    """
    remaining, merged = list(arguments), dict[str, dict[str, Any]]()
    passed_on, position = list[str](), 0
    while remaining:
        option, *remaining = remaining
        nodes = _parameters_of(option, remaining[0]) if remaining else None
        if nodes is None:
            passed_on.append(option)
            continue
        remaining, position = remaining[1:], position or len(passed_on)
        for node, parameters in nodes:
            merged.setdefault(node, {}).update(parameters)
    if not merged:
        yield passed_on
        return
    with contextlib.ExitStack() as stack:
        try:
            path = Path(stack.enter_context(tempfile.TemporaryDirectory())) / 'parameters.yaml'
            texts = (parameter_files.parameters_as_yaml(own, node) for node, own in merged.items())
            path.write_text(''.join(texts), encoding='utf-8')
        except OSError as error:
            raise ConfigError(f'parameters cannot be handed to ROS: {error}') from error
        yield [*passed_on[:position], '--params-file', str(path), *passed_on[position:]]


def _parameters_of(option: str, text: str) -> parameter_files.Nodes | None:
    """Return what a ROS ``option`` with the value ``text`` sets; None if rcl has to read it."""
    if option == '--params-file':
        path = parameter_files.find_path(text)
        with parameter_files.naming(path):
            return parameter_files.nodes_of(read_text(path, MAX_YAML_BYTES))
    target, _, value = text.partition(':=')
    match = _TARGET.fullmatch(target)
    if option not in ('-p', '--param') or match is None:
        return None
    node, name = match[1] or '/**', match[2]
    with parameter_files.naming(text):
        parsed = load_yaml(value)
        if parsed is None or isinstance(parsed, dict):
            return None
        parameters = {name: parameter_files.value_of_one_type(name, parsed)}
        return [(f'/{node.removeprefix("/")}', parameters)]


@contextlib.contextmanager
def client_node(name: str, arguments: Sequence[str] = ()) -> Iterator[Node]:
    """Initialise rclpy as `start_ros` and create a node, which is destroyed with the block."""
    start_ros(arguments)
    try:
        node = Node(name)
        try:
            yield node
        finally:
            # DDS threads of a node that is not destroyed crash when the process ends.
            node.destroy_node()
    finally:
        rclpy.try_shutdown()


# builtin_interfaces/Time has 32-bit seconds, and rclpy accepts no negative ones.
_LAST_SECOND = 2**31 - 1
_HIGHEST_TYPE = ParameterType.PARAMETER_STRING_ARRAY
# The parameter services, and the list in each request.
_LISTS = {
    srv.DescribeParameters: 'names',
    srv.GetParameterTypes: 'names',
    srv.GetParameters: 'names',
    srv.ListParameters: 'prefixes',
    srv.SetParameters: 'parameters',
    srv.SetParametersAtomically: 'parameters',
}


class CheckedNode(Node):
    """A node whose callbacks are `guarded`, and which checks what rclpy's own ones receive.

    `read_here` reads the parameter files among the arguments of such a node.
    """

    def __init__(self, name: str, **options: Any) -> None:
        """Create the node ``name``; ConfigError if one of its parameter files cannot be read."""
        with read_here(options.pop('cli_args', None) or ()) as given:
            super().__init__(name, cli_args=given or None, **options)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., None], *args: Any, **options: Any
    ) -> Subscription:
        """Create a subscription; messages on /clock are checked before ``callback`` gets them."""
        if msg_type is Clock and not options.get('raw'):
            callback = partial(self._take_clock, callback)
        return super().create_subscription(
            msg_type, topic, guarded(self, callback), *args, **options
        )

    def create_timer(
        self, timer_period_sec: float, callback: Callable[[], None], *args: Any, **options: Any
    ) -> Timer:
        """Create a timer."""
        return super().create_timer(timer_period_sec, guarded(self, callback), *args, **options)

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[..., Any],
        *args: Any,
        **options: Any,
    ) -> Service:
        """Create a service; parameter requests are checked before ``callback`` gets them."""
        if srv_type in _LISTS:
            callback = partial(self._answer_checked, _LISTS[srv_type], callback)
        return super().create_service(
            srv_type, srv_name, guarded(self, callback), *args, **options
        )

    def _take_clock(self, take: Callable[[Clock], None], message: Clock) -> None:
        """Call ``take`` with a clock ``message``; refuse a time that ROS cannot represent."""
        sec, nanosec = message.clock.sec, message.clock.nanosec
        if sec < 0 or sec + nanosec // 10**9 > _LAST_SECOND:
            self.get_logger().warning(
                f'/clock refused: it is {sec} s and {nanosec} ns, expected 0 to {_LAST_SECOND} s',
                throttle_duration_sec=terminal.WARNING_PERIOD,
            )
            return
        take(message)

    def _answer_checked(
        self, field: str, answer: Callable[..., Any], request: Any, response: Any
    ) -> Any:
        """Answer a ``request`` if its list ``field`` is short and has known names and types."""
        items, most = getattr(request, field), len(self._parameters)
        if len(items) <= most:
            problems = [self._problem(item) for item in items]
        else:
            problems = [
                f'{len(items)} {field} in one request, expected at most {most}: no more exist'
            ]
        if not any(problems):
            return answer(request, response)
        reason = next(filter(None, problems))
        self.get_logger().warning(
            f'refused: {reason}', throttle_duration_sec=terminal.WARNING_PERIOD
        )
        if isinstance(response, srv.SetParametersAtomically.Response):
            response.result = SetParametersResult(successful=False, reason=reason)
        elif isinstance(response, srv.SetParameters.Response):
            # The parameters without a problem are set.
            request.parameters = [item for item, problem in zip(items, problems) if not problem]
            results = iter(answer(request, response).results)
            response.results = [
                SetParametersResult(successful=False, reason=problem) if problem else next(results)
                for problem in problems
            ]
        return response

    def _problem(self, item: Any) -> str:
        """Say why ``item`` is unknown to this node or has an unknown type; '' if neither."""
        if not isinstance(item, Parameter):
            return ''
        if item.name not in self._parameters:
            return f'{shown(item.name)} is no parameter of this node'  # rclpy does not say which
        if item.value.type > _HIGHEST_TYPE:
            return f'{item.name} is of type {item.value.type}, expected 0 to {_HIGHEST_TYPE}'
        return ''
