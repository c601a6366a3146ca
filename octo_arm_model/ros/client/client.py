"""A client of the node of an arm: reads shape, strains and problems, and commands tensions."""

import collections
import contextlib
import functools
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from octo_arm_msgs.msg import TendonTensions
from rclpy.exceptions import InvalidNamespaceException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.validate_namespace import validate_namespace
from std_msgs.msg import String

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConfigError, MessageError, OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import LARGEST
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parse_parameters
from octo_arm_model.ros.client.commands import CommandPublisher, SimulatorClient
from octo_arm_model.ros.node.inputs import INPUT_QOS, MOST_BYTES
from octo_arm_model.ros.node.outputs import LATCHED_QOS
from octo_arm_model.ros.simulator.publishers import NO_COMMAND, PAUSED, PROFILE
from octo_arm_model.ros.topics import decoded, message_class, take_all
from octo_arm_model.simulation.movements import COMMAND_TOPICS, TOPIC, read_command
from octo_arm_model.wire import estimate
from octo_arm_model.wire.backbone import TENDON_LENGTHS, TIP_POSE, read_poses
from octo_arm_model.wire.tensions import JOINT_STATE

# With best effort, a slow reader never blocks the publisher.
NEWEST_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_WINDOW, _MOST_COUNTS = 2.0, 1000  # [s] over which rates are counted, and counts in it


def _reader(node: Node, kind: Any, topic: str, qos: QoSProfile) -> Subscription:
    """Return a subscription whose messages `take_all` takes; ``node`` need not be spun."""
    return node.create_subscription(kind, topic, lambda _: None, qos, raw=True)


_UNIT = 1e-3  # tolerance of the norm of a quaternion


class PublishedShape(NamedTuple):
    """One shape as the node published it."""

    #: positions of the stations in `base_frame`, base first, (stations, 3) [m]
    position: FloatArray
    quaternion: FloatArray  #: orientations of the stations x, y, z, w, (stations, 4)
    stamp: float  #: stamp of the tensions that the shape was solved for [s]
    received: float  #: time of arrival [s]


class PublishedStrains(NamedTuple):
    """Strains as the node published them, each (stations,), with the names of a `Backbone`."""

    model: str
    s: FloatArray
    tau: FloatArray
    xi: FloatArray
    k: FloatArray
    q: FloatArray


def strains_of(message: Any) -> PublishedStrains:
    """Return the strains in a SectionStrains; MessageError if no arm can have such ones."""
    names, count = PublishedStrains._fields[1:], len(message.s)
    parts = [_finite(name, getattr(message, name), count) for name in names]
    strains = PublishedStrains(message.model, *parts)
    if (strains.q <= -1.0).any():
        raise MessageError('q compresses the arm to nothing')
    return strains


def _finite(name: str, values: Any, size: int | None = None) -> FloatArray:
    """Return ``values`` of a message as an array; MessageError if its size or a value is wrong."""
    array = np.asarray(values, np.float64)
    if size is not None and array.size != size:
        raise MessageError(f'{name} has {array.size} numbers, expected {size}')
    if not (np.abs(array) <= LARGEST).all():
        raise MessageError(f'{name} holds numbers that are not finite, or beyond {LARGEST:g}')
    return array


def _variances(name: str, covariance: Any) -> FloatArray:
    """Return the diagonals (..., n) of ``covariance`` (..., n, n); MessageError if negative."""
    variances = np.diagonal(_finite(name, covariance), axis1=-2, axis2=-1)
    if (variances < 0.0).any():
        raise MessageError(f'{name} has variances below zero')
    return variances


# Topics and types of the backbone, and of further quantities at the same stations.
_SHAPES = 'backbone/poses'
_DESCRIPTION, _DIAGNOSTICS = 'arm_description', '/diagnostics'
POSES: dict[str, Any] = {_SHAPES: message_class(estimate.ESTIMATES[_SHAPES])}
_PARTS = 'strains', TIP_POSE, estimate.COVARIANCE, estimate.TIP_WRENCH, estimate.CONTACT
DETAILS: dict[str, Any] = {
    TENDON_LENGTHS: message_class(JOINT_STATE.type_name),
    **{topic: message_class(estimate.ESTIMATES[topic]) for topic in _PARTS},
}
# The commands that any node publishes, this one too.
COMMANDS: dict[str, Any] = {
    topic: message_class(kind.type_name) for topic, kind in COMMAND_TOPICS.items()
}
_LONGEST_WAIT = 2e9  # [ns] that a command waits; if it seems longer, the clock was set back
_MOST_SENT = 100  # commands of which it is known that they are of this client
_MOST_PROBLEMS, _LONGEST_PROBLEM = 64, 1000  # problems kept, and characters of each
_STALE = 5.0  # [s] without news after which a problem is forgotten, as that of a node that ended
_DIAGNOSTICS_QOS = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)


class ArmClient:
    """Subscribes to the topics of one arm's node and publishes commands for its tendons.

    Attributes:
        command_topic: full name of the topic of the commands.
        config: configuration of the arm, from the topic arm_description; None until received.
        shape: newest shape of that arm; None until received.
        strains: newest strains; None until received.
        tensions: tensions of the newest shape [N], (tendons,); None until received.
        tip_deviation: standard deviation of the tip's position along x, y, z [m], (3,).
        covariance: newest covariance of shape and contact, from an estimator; None until received.
        force: newest estimated force on the arm [N], (3,); None until received.
        is_paused: whether the diagnostics of a simulator report a pause; None until received.
        has_no_command: whether what the last `poll` has taken says that a simulator has no
            command, or plays a profile instead.
    """

    def __init__(self, node: Node, namespace: str = '') -> None:
        """Create the entities on ``node`` for the arm in ``namespace``, which must be valid."""
        try:
            validate_namespace(namespace if namespace.startswith('/') else f'/{namespace}')
        except InvalidNamespaceException as error:
            expected = 'expected one such as arm_3'
            raise ConfigError(f'namespace is {namespace!r}, {expected}') from error
        self._node = node
        self._prefix = f'{namespace}/' if namespace else ''
        self.command_topic = node.resolve_topic_name(self._prefix + TOPIC)
        self._namespace = self.command_topic.rpartition('/')[0]
        self._commands = CommandPublisher(node, self._prefix + TOPIC)
        self._always = {
            _DESCRIPTION: _reader(node, String, self._prefix + _DESCRIPTION, LATCHED_QOS),
            _DIAGNOSTICS: _reader(node, DiagnosticArray, _DIAGNOSTICS, _DIAGNOSTICS_QOS),
        }
        self._topics: dict[str, Subscription] = {}
        self._problems: dict[str, tuple[float, str]] = {}  # time of the news [s] and words
        # By a clock that does not jump; `received` and stamps are by the clock of the system.
        self._counts: collections.deque[tuple[float, int]] = collections.deque(maxlen=_MOST_COUNTS)
        self._counted, self._heard = 0, 0.0
        self._text = ''
        self.config: Config | None = None
        self.is_paused: bool | None = None
        self.has_no_command = False
        self._sent: collections.deque[TendonTensions] = collections.deque(maxlen=_MOST_SENT)
        self._sent_ns = 0  # time of the newest of them [ns]
        self._commanded: dict[str, float] = {}
        self._forget()

    @functools.cached_property
    def simulator(self) -> SimulatorClient:
        """The client of the simulator in the same namespace."""
        return SimulatorClient(self._node, self._prefix)

    def _forget(self) -> None:
        self.shape: PublishedShape | None = None
        self.strains: PublishedStrains | None = None
        self.tensions: FloatArray | None = None
        self.tip_deviation = np.zeros(3)
        self.covariance: estimate.BackboneCovariance | None = None
        self.force: FloatArray | None = None

    def listen(self, topics: Mapping[str, Any]) -> None:
        """Subscribe to ``topics``, as `POSES`, `DETAILS` or `COMMANDS`, and to no others.

        Every subscription costs the node of the arm time for each shape.
        """
        for name in self._topics.keys() - topics.keys():
            self._node.destroy_subscription(self._topics.pop(name))
        for name in topics.keys() - self._topics.keys():
            qos = INPUT_QOS if name in COMMANDS else NEWEST_QOS
            self._topics[name] = _reader(self._node, topics[name], self._prefix + name, qos)
        if _SHAPES not in topics:
            self._forget()

    def poll(self) -> bool:
        """Take what has come; return if a shape has. OctoArmError for a wrong description."""
        before, told, oldest = self.shape, self._problems, time.monotonic() - _STALE
        self.has_no_command = False
        self._problems = {name: told[name] for name in told if told[name][0] > oldest}
        for name, topic in (*self._always.items(), *self._topics.items()):
            for data, info in list(take_all(topic, topic.msg_type)):
                problem = ''
                try:
                    self._read(name, data, info)
                except MessageError as error:
                    problem = f'{name}: {error}'
                self._note(name, problem)
        return self.shape is not before

    def _note(self, source: str, problem: str) -> None:
        """Keep the ``problem`` that a topic or a status has now, '' for none."""
        if not problem:
            self._problems.pop(source, None)
        elif source in self._problems or len(self._problems) < _MOST_PROBLEMS:
            self._problems[source] = time.monotonic(), problem

    def _read(self, name: str, data: bytes, info: dict[str, Any]) -> None:
        if name == _DESCRIPTION:
            self._read_description(decoded(data, String).data)
        elif name == _DIAGNOSTICS:
            self._read_status(decoded(data, DiagnosticArray))
        elif self.config is None:
            pass  # of an arm that is not described yet
        elif name == _SHAPES:
            self._read_shape(data, info)
        elif name in COMMANDS:
            if len(data) > MOST_BYTES:
                raise MessageError(f'{len(data)} bytes, expected at most {MOST_BYTES}')
            message = decoded(data, COMMANDS[name])
            # One that came before a command of this client is out of date.
            older_ns = self._sent_ns - (info.get('received_timestamp') or self._sent_ns)
            # rclpy does not tell who has published it.
            if not (0 < older_ns < _LONGEST_WAIT or message in self._sent):
                self._read_command(name, message, self.config)
        else:
            self._read_detail(name, decoded(data, DETAILS[name]), self.config.arm)

    def _read_detail(self, name: str, message: Any, arm: Arm) -> None:
        if name == 'strains':
            self.strains = strains_of(message)
        elif name == TENDON_LENGTHS:
            self.tensions = None
            with contextlib.suppress(OctoArmError):  # another arm's, whose description comes later
                self.tensions = JOINT_STATE.read(message, arm).ravel()
        elif name == estimate.COVARIANCE:
            self.covariance = None
            covariance = estimate.read_covariance(message)
            _variances('pose', covariance.pose)
            _variances('contact', covariance.contact)
            # NaN stands for a contact that acts along the whole arm.
            if np.isinf(covariance.contact_s):
                raise MessageError('contact_s is infinite')
            self.covariance = covariance
        elif name in (estimate.TIP_WRENCH, estimate.CONTACT):
            force = message.wrench.force
            self.force = _finite('force', [force.x, force.y, force.z])
        else:
            variances = _variances('covariance', np.reshape(message.pose.covariance, (6, 6)))
            self.tip_deviation = np.sqrt(variances[:3])

    def _read_description(self, text: str) -> None:
        if text != self._text:
            self._text, self.config, self._commanded = text, None, {}
            self._forget()
            config = Config.from_parameters(parse_parameters(text, _DESCRIPTION))
            self._commands.use(config)
            self.config = config

    def _read_shape(self, data: bytes, info: dict[str, Any]) -> None:
        received = 1e-9 * (info.get('received_timestamp') or time.time_ns())
        stamp, poses = read_poses(data)
        if len(poses) < 2:
            return  # too few poses for a backbone
        _finite('poses', poses)
        if np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0).max() > _UNIT:
            raise MessageError('poses have quaternions that are not of length 1')
        self.shape = PublishedShape(poses[:, :3], poses[:, 3:], stamp, received)
        # The publisher's sequence number also counts skipped shapes; some middleware has none.
        self._counted += 1
        number = info.get('publication_sequence_number') or self._counted
        self._heard = time.monotonic()
        if self._counts and number < self._counts[-1][1]:
            self._counts.clear()  # the node has restarted
        self._counts.append((self._heard, number))

    @property
    def problem(self) -> str:
        """The warnings and errors about the arm, separated by semicolons; '' for none.

        They come from its newest diagnostics, invalid messages, and a second publisher of shapes.
        """
        problems = [words for _, words in self._problems.values()]
        if (nodes := self._publisher_count) > 1:
            problems.insert(0, f'{nodes} nodes publish shapes on {self._prefix}{_SHAPES}')
        return '; '.join(problems)

    @property
    def _publisher_count(self) -> int:
        topic = self._topics.get(_SHAPES)
        return 0 if topic is None else int(topic.get_publisher_count())

    def rate(self) -> float:
        """Return how many shapes per second the node publishes [Hz], including skipped ones.

        It is NaN if several nodes publish, because a message does not tell whose count it has.
        """
        if self._publisher_count > 1:
            return np.nan
        since = time.monotonic() - _WINDOW
        recent = [count for count in self._counts if count[0] >= since]
        if len(recent) < 2:
            return 0.0
        (first, before), (last, after) = recent[0], recent[-1]
        return (after - before) / max(last - first, 1e-3)

    @property
    def latency(self) -> float:
        """The time from the stamp of the tensions to the arrival of their shape [s], or NaN."""
        return self.shape.received - self.shape.stamp if self.shape else np.nan

    def age(self) -> float:
        """Return the time since the newest shape arrived [s]; infinite if there is no shape."""
        return time.monotonic() - self._heard if self.shape else np.inf

    def command(self, tensions: FloatArray) -> None:
        """Command ``tensions`` (tendons,) [N]; TensionError if one is invalid or beyond limits."""
        assert self.config is not None
        stamp = self._node.get_clock().now().to_msg()
        self._sent.append(self._commands.publish(tensions, stamp))
        self._sent_ns = time.time_ns()

    def take_command(self) -> dict[str, float]:
        """Return the newest tensions [N] by tendon that other nodes command since the last call.

        It is empty if they command none; messages of joint states may name some tendons only.
        """
        command, self._commanded = self._commanded, {}
        return command

    def _read_command(self, name: str, message: Any, config: Config) -> None:
        with contextlib.suppress(OctoArmError):  # refused by what drives the tendons too
            tensions, _ = read_command(name, message, config.arm, self._commands.limits)
            self._commanded |= tensions

    def _read_status(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.hardware_id.rpartition('/')[0] != self._namespace:
                continue
            task = status.name.rpartition(': ')[2]
            if task == 'simulator':
                source = next((item.value for item in status.values if item.key == 'source'), '')
                self.is_paused = source == PAUSED
                self.has_no_command = source in (NO_COMMAND, PROFILE)
            # The output warns of skipped tensions, which are expected at high rates.
            is_well = status.level == DiagnosticStatus.OK or task == 'output'
            problem = '' if is_well else f'{task}: {status.message}'[:_LONGEST_PROBLEM]
            self._note(status.name, problem)
