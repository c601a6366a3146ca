"""Commands to nodes: tensions, profiles, another arm, and forces on a simulated arm."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3, Vector3Stamped
from numpy.typing import ArrayLike
from octo_arm_msgs.msg import TendonTensions
from rcl_interfaces.srv import ListParameters, SetParametersAtomically
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException, NameValidationException
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter import Parameter, refuse_unknown
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.ros.live_parameters import ros_parameter
from octo_arm_model.ros.node.outputs import OUTPUT_QOS
from octo_arm_model.ros.simulator.services import PUSH_TOPIC
from octo_arm_model.ros.start import client_node
from octo_arm_model.ros.topics import tensions_message
from octo_arm_model.simulation.movements import TOPIC, check_command, check_profile, tendon_limits
from octo_arm_model.simulation.profiles import CommandProfile, transition
from octo_arm_model.terminal import on_signals


class CommandPublisher:
    """Publishes tensions for the tendons of one arm at a time.

    Attributes:
        publisher: the ROS publisher, which counts its subscriptions.
        limits: largest tension of each tendon (tendons,) [N].
    """

    def __init__(self, node: Node, topic: str, config: Config | None = None) -> None:
        """Publish on ``topic`` of ``node`` for the arm of ``config``, or of a later `use`."""
        self.publisher: Any = node.create_publisher(TendonTensions, topic, OUTPUT_QOS)
        self._config: Config | None = None
        if config is not None:
            self.use(config)

    def use(self, config: Config) -> None:
        """Publish for the arm of ``config`` and check its tension limits from now on."""
        self._config, self.limits = config, tendon_limits(config)

    def publish(self, tensions: ArrayLike, stamp: Time, frame: str = '') -> TendonTensions:
        """Publish ``tensions`` (tendons,) or as `Arm.tension_shape` [N]; return the message.

        TensionError if they do not fit this arm, or one is above its limit: nothing is published.
        """
        assert self._config is not None
        arm = self._config.arm
        checked = check_command(arm, tensions, self.limits)
        message = tensions_message(checked, arm, stamp, frame)
        self.publisher.publish(message)
        return message


RELEASE_TIME = 2.0  # [s] of the ramp from the last tensions to zero
_POLL = 0.05  # [s] between checks for a subscription
_SAME_SIGNAL = 0.3  # [s] within which signals count as one
_FLUSH_TIMEOUT = 5.0  # [s] to wait for the last command to arrive

Report = Callable[[str, float, float], None]


def play(  # noqa: PLR0913 - options by keyword
    profile: CommandProfile,
    config: Config,
    *,
    topic: str,
    speed: float = 1.0,
    loop: bool = False,
    rate: float = 50.0,
    release: bool = True,
    timeout: float = 5.0,
    report: Report = lambda what, played, duration: None,
) -> None:
    """Publish ``profile`` on ``topic`` until it ends or SIGINT, SIGTERM or SIGHUP comes.

    Args:
        profile: tensions over time.
        config: the arm whose tendons it pulls, with their limits.
        topic: topic of type octo_arm_msgs/TendonTensions.
        speed: factor on the speed of the profile [-].
        loop: whether to repeat the profile.
        rate: rate of the commands [Hz].
        release: whether to ramp the tensions to zero at the end; a second signal stops the ramp.
        timeout: longest time to wait for a subscription [s].
        report: called with the activity, the time it has taken and its duration [s].

    Raises:
        ConfigError: if ``topic`` is not a valid name, or nobody subscribes to it.
        ProfileError: if ``profile`` exceeds the limit of a tendon.
    """
    check_profile(profile, config.arm, tendon_limits(config))
    received: list[int] = []  # handled signals: unhandled, they would leave the tendons tensioned
    clock = Clock(clock_type=ClockType.SYSTEM_TIME)

    def publish(what: str, profile: CommandProfile, speed: float, loop: bool) -> FloatArray:
        """Publish to the end or the next signal, and return the last tensions [N]."""
        duration, start, signals = profile.duration / speed, time.monotonic(), len(received)
        played, sent = 0.0, 0
        while True:
            tensions = profile.at(speed * played, loop=loop)
            commands.publish(tensions, clock.now().to_msg())
            report(what, played if loop else min(played, duration), duration)
            # Late commands are skipped.
            sent = max(sent + 1, int(played * rate))
            if played >= duration and not loop:
                return tensions
            time.sleep(max(0.0, start + sent / rate - time.monotonic()))
            if len(received) > signals:
                return tensions
            played = time.monotonic() - start

    with on_signals(received.append, _SAME_SIGNAL), client_node('octo_arm_player') as node:
        try:
            commands = CommandPublisher(node, topic, config)
        except InvalidTopicNameException as error:
            raise ConfigError(f'topic is {topic!r}, expected a name such as {TOPIC}') from error
        if _find_listener(commands.publisher, timeout, received, report):
            final_tensions = publish('playing', profile, speed, loop)
            if release and final_tensions.any():
                ramp = transition(final_tensions, np.zeros_like(final_tensions), RELEASE_TIME)
                publish('releasing', ramp, 1.0, False)
        # The process must not end before the last command has arrived.
        commands.publisher.wait_for_all_acked(Duration(seconds=_FLUSH_TIMEOUT))


def _find_listener(
    publisher: Any, timeout: float, received: Sequence[int], report: Report
) -> bool:
    """Wait for a subscription; False if a signal came first, ConfigError after ``timeout`` [s]."""
    start = time.monotonic()
    while not publisher.get_subscription_count():
        waited = time.monotonic() - start
        if waited >= timeout:
            raise ConfigError(
                f'nobody subscribes to {publisher.topic_name}: start octo_arm_sim, or what drives '
                'the winches, or choose another topic'
            )
        report('waiting for a subscriber', waited, timeout)
        time.sleep(_POLL)
        if received:
            return False
    return True


_ATTEMPTS = 2  # requests sent before a node counts as one that does not answer


def swap_arm(
    values: Mapping[str, Any], others: Sequence[Parameter], node_name: str, timeout: float
) -> None:
    """Give the node ``node_name`` the arm that ``values`` describe, in one step or not at all.

    Parameters of the arm missing in ``values`` return to their defaults; other parameters of the
    node are set if given and unchanged if not.

    Args:
        values: values of parameters by their dotted names.
        others: parameters that the node may have besides those of the arm.
        node_name: name of the node with its namespace, such as ``/octo_arm``.
        timeout: longest time to wait for the node, and then for each of its answers [s].

    Raises:
        ConfigError: if there is no such node, it has no arm, it does not know a parameter, a value
            has the wrong type, or the node refuses.
    """
    with client_node('octo_arm_load') as node:
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
        new_values = {name: parameter.default_or_none_given for name, parameter in arm.items()}
        new_values.update(values)
        changes = [ros_parameter(known[name], value) for name, value in new_values.items()]
        answer: SetParametersAtomically.Response = _ask(
            node, lambda: client.set_parameters_atomically(changes), node_name, timeout
        )
        if not answer.result.successful:
            raise ConfigError(f'{node_name} stays as it is: {answer.result.reason}')


def _ask(node: Node, ask: Callable[[], Future], node_name: str, timeout: float) -> Any:
    """Call ``ask`` up to twice and return the answer; ConfigError after ``timeout`` [s]."""
    # A server that has not discovered the reader of its answers yet loses the first answer.
    answers, start = list[Future](), time.monotonic()
    for attempt in range(_ATTEMPTS):
        answers.append(ask())
        while (remaining := start + (attempt + 1) / _ATTEMPTS * timeout - time.monotonic()) > 0.0:
            rclpy.spin_once(node, timeout_sec=remaining)
            for answer in answers:
                if answer.done():
                    return answer.result()
    raise ConfigError(f'{node_name} has not answered within {timeout} s')


class SimulatorClient:
    """Publishes forces to a simulator and calls its services without waiting for answers."""

    def __init__(self, node: Node, prefix: str = '') -> None:
        """Create the publisher and the clients on ``node``, with ``prefix`` before their names."""
        self._force = node.create_publisher(Vector3Stamped, prefix + PUSH_TOPIC, OUTPUT_QOS)
        self._services = {
            name: node.create_client(SetBool if name == 'pause' else Trigger, prefix + name)
            for name in ('pause', 'step', 'reset')
        }

    def pull(self, force: FloatArray) -> None:
        """Pull the arm with a ``force`` (3,) [N] for half a second or until the next call."""
        x, y, z = force.tolist()
        self._force.publish(Vector3Stamped(vector=Vector3(x=x, y=y, z=z)))

    def pause(self, is_paused: bool) -> None:
        """Pause or resume the simulator; ConfigError if no simulator offers the service."""
        self._call('pause', SetBool.Request(data=is_paused))

    def trigger(self, name: str) -> None:
        """Call the service ``name``, step or reset; ConfigError if no simulator offers it."""
        self._call(name, Trigger.Request())

    def _call(self, name: str, request: SetBool.Request | Trigger.Request) -> None:
        service = self._services[name]
        if not service.service_is_ready():
            raise ConfigError(f'nobody offers {service.srv_name}, expected octo_arm_sim')
        # The request is dropped, because nothing spins the node to take the answer.
        service.remove_pending_request(service.call_async(request))
