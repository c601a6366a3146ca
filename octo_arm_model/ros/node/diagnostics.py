"""How the node is doing, on ``/diagnostics``: its solver, its input and its output."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

from octo_arm_model.core.errors import OctoArmError, SolveError
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.ros.qos import create_publisher
from octo_arm_model.wire.tension_template import Stamp

TOPIC = '/diagnostics'
QOS = QoSProfile(depth=5)
PERIOD = 1.0  # [s]
# Stamps this far ahead of the node's clock are of another clock [s].
_AHEAD = 0.1


def seconds(stamp: Time | Stamp) -> float:
    """A stamp in seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


class Health:
    """Counts what comes in, what goes out and what goes wrong; reports once a period.

    Attributes:
        model: name of the model that solves.
        is_compiled: whether it does so in machine code.
        is_active: whether the node listens, so that silence means something.
    """

    def __init__(self, node: Node) -> None:
        """Report as part of ``node``."""
        self._node = node
        self.model, self.is_compiled = '', False
        self.is_active = False
        self._totals = dict.fromkeys(
            ('answered', 'refused', 'failed', 'skipped', 'backwards', 'ahead', 'unstamped'), 0
        )
        self._lately = dict(self._totals)
        self._topics: dict[str, int] = {}
        self._received = 0
        self._newest: float | None = None
        self._now = 0.0
        self._reason = self._failure = ''
        self._residual, self._iterations, self._busy = 0.0, 0, 0.0
        self._publisher = create_publisher(node, DiagnosticArray, TOPIC, QOS)
        # Time of ROS may stand still or jump; silence has to be noticed all the same.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(PERIOD, self._report, clock=clock)

    def _count(self, what: str, number: int = 1) -> None:
        self._totals[what] += number
        self._lately[what] += number

    def received(self, topic: str, stamp: Stamp | None) -> bool:
        """Count a message with its ``stamp``, None where it has none.

        Returns:
            Whether time has gone back since the last one, as when a bag begins anew.
        """
        self._received += 1
        self._topics[topic] = self._topics.get(topic, 0) + 1
        if stamp is None or not any(stamp):
            self._count('unstamped')
            return False
        time = seconds(stamp)
        is_back = self._newest is not None and time < self._newest
        if is_back:
            self._count('backwards')
            self._now = 0.0  # A clock that has gone back as well.
        self._newest = time
        # Reading the clock takes longer than all else here, and an earlier look often tells.
        if time > self._now + _AHEAD:
            self._now = seconds(self._node.get_clock().now().to_msg())
            if time > self._now + _AHEAD:
                self._count('ahead')
        return is_back

    def skipped(self, number: int) -> None:
        """Count messages that were passed over for a newer one."""
        self._count('skipped', number)

    def answered(self, backbone: Backbone, duration: float) -> None:
        """Count a solution and the ``duration`` of solving [s]."""
        self._count('answered')
        self._busy += duration
        self._residual = float(backbone.residual)
        self._iterations = int(backbone.iterations)

    def refused(self, topic: str, error: OctoArmError) -> None:
        """Count a message that was not answered, and why."""
        if isinstance(error, SolveError):
            self._count('failed')
            self._failure = str(error)
        else:
            self._count('refused')
            self._reason = f'{topic}: {error}'

    def _report(self) -> None:
        name = self._node.get_fully_qualified_name()
        message = DiagnosticArray(status=[self._solver(), self._input(), self._output()])
        for status in message.status:
            status.name = f'{name.lstrip("/")}: {status.name}'
            status.hardware_id = name
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._now = seconds(message.header.stamp)
        self._publisher.publish(message)
        self._lately = dict.fromkeys(self._lately, 0)
        self._topics, self._received, self._busy = {}, 0, 0.0

    def _solver(self) -> DiagnosticStatus:
        failed, answered = self._lately['failed'], self._lately['answered']
        problem = f'no answer to {failed}: {self._failure}' if failed else ''
        level = DiagnosticStatus.ERROR if failed and not answered else DiagnosticStatus.WARN
        return _status('solver', level, problem, 'solving', {
            'model': self.model,
            'compiled': self.is_compiled,
            'residual': f'{self._residual:.3e}',
            'iterations': self._iterations,
            'time per solve [ms]': f'{1e3 * self._busy / answered:.3f}' if answered else '',
            'failures': self._totals['failed'],
            'last failure': self._failure,
        })  # fmt: skip

    def _input(self) -> DiagnosticStatus:
        problems = []
        lately = self._lately
        if not self._received and self.is_active:
            problems.append('silent')
        if lately['refused']:
            problems.append(f'{lately["refused"]} refused: {self._reason}')
        if len(self._topics) > 1:
            problems.append(f'several sources: {", ".join(sorted(self._topics))}')
        for what, words in (
            ('backwards', 'stamps running backwards'),
            ('ahead', 'stamps from the future'),
            ('unstamped', 'without a stamp'),
        ):
            if lately[what]:
                problems.append(f'{lately[what]} {words}')
        age = ''
        if self._newest is not None:
            now = seconds(self._node.get_clock().now().to_msg())
            age = f'{now - self._newest:.3f}'
        fine = 'receiving' if self.is_active else 'inactive'
        return _status('input', DiagnosticStatus.WARN, '; '.join(problems), fine, {
            'rate [Hz]': f'{self._received / PERIOD:.1f}',
            'age of the newest stamp [s]': age,
            'source': ', '.join(sorted(self._topics)),
            'refused': self._totals['refused'],
            'last refusal': self._reason,
            'stamps running backwards': self._totals['backwards'],
            'stamps from the future': self._totals['ahead'],
            'without a stamp': self._totals['unstamped'],
        })  # fmt: skip

    def _output(self) -> DiagnosticStatus:
        skipped = self._lately['skipped']
        problem = f'{skipped} skipped for newer ones' if skipped else ''
        return _status('output', DiagnosticStatus.WARN, problem, 'publishing', {
            'rate [Hz]': f'{self._lately["answered"] / PERIOD:.1f}',
            'answered': self._totals['answered'],
            'skipped': self._totals['skipped'],
        })  # fmt: skip


def _status(
    name: str, level: bytes, problem: str, fine: str, values: dict[str, object]
) -> DiagnosticStatus:
    status = DiagnosticStatus(name=name, message=problem or fine)
    status.level = level if problem else DiagnosticStatus.OK
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return status
