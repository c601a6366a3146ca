"""Diagnostics of the node on ``/diagnostics``: one status for solver, input and output each."""

import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile

from octo_arm_model.analysis.driven_arm import DrivenArm
from octo_arm_model.arm.errors import ContinuationError, OctoArmError, SolveError, in_short
from octo_arm_model.config.parameters import DiagnosticLimits
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.node.inputs import Inputs
from octo_arm_model.ros.topics import create_publisher
from octo_arm_model.ros.work import steady_timer
from octo_arm_model.terminal import RefusalLog
from octo_arm_model.wire.messages import Refusals, Stamp, time_of

# Tolerance in steps of /clock: a message may precede the next step, and one step may be lost.
_STEPS = 2.0


class SteppedClock:
    """The clock of a node, which advances in steps of /clock if time is simulated."""

    def __init__(self, node: Node) -> None:
        """Follow the clock of ``node``."""
        self._clock: Any = node.get_clock()
        self._step = 0.0
        every_step = JumpThreshold(
            min_forward=Duration(nanoseconds=1), min_backward=None, on_clock_change=False
        )
        self._jumps = self._clock.create_jump_callback(every_step, post_callback=self._on_step)

    def _on_step(self, jump: TimeJump) -> None:
        step = 1e-9 * jump.delta.nanoseconds
        # The first step, from zero, does not count.
        self._step = step if 1e-9 * self.now_ns > step else 0.0

    @property
    def now_ns(self) -> int:
        """The time [ns]; zero while simulated time is not known yet."""
        # Every message needs this, and the clock's own `now` takes five times as long.
        return int(self._clock.handle.get_now().nanoseconds)

    def time_of(self, stamp: Stamp | None) -> Stamp:
        """Return ``stamp``, or the time of receipt without one; MessageError if it is invalid."""
        return time_of(stamp) or Stamp.from_ns(self.now_ns)

    def ahead(self, stamp: Stamp, now_ns: int) -> float:
        """Return how far ``stamp`` is ahead of ``now_ns``, beyond the clock's step tolerance [s].

        It is negative if the stamp is behind, and zero while the time is not known.
        """
        tolerance = _STEPS * self._step * self._clock.ros_time_is_active
        return 1e-9 * (stamp.ns - now_ns) - tolerance if now_ns else 0.0


TOPIC = '/diagnostics'
QOS = QoSProfile(depth=5)
PERIOD = 1.0  # [s]
NO_TIME = 'no time: use_sim_time is set, but nothing is heard on /clock'
_LONGEST = 900  # characters of the reasons of refusals


class Report:
    """Counts what happens to a node, and publishes its statuses once a period.

    Attributes:
        log: log of what is refused.
        reason: why the last message was refused, '' before.
        totals: counts by what happened.
        lately: counts since the last report.
        period: time between the last two reports [s], since a solve may delay one.
    """

    def __init__(self, node: Node, statuses: Callable[[], list[DiagnosticStatus]]) -> None:
        """Report on ``node``; ``statuses`` makes its statuses since the last report."""
        self._node, self._statuses = node, statuses
        self.totals, self.lately = defaultdict[str, float](int), defaultdict[str, float](int)
        self.log, self.reason = RefusalLog(node.get_logger().warning), ''
        self._reported, self.period = time.monotonic(), PERIOD
        self._publisher = create_publisher(node, DiagnosticArray, TOPIC, QOS)
        steady_timer(node, PERIOD, self._report)

    def count(self, what: str, number: float = 1) -> None:
        """Add ``number`` to the counts of ``what``."""
        self.totals[what] += number
        self.lately[what] += number

    def refused(self, topic: str, error: OctoArmError) -> None:
        """Count and log a message on ``topic`` that is refused because of ``error``."""
        self.count('refused')
        self.reason = f'{topic}: {in_short(error)}'
        self.log.add(f'{topic} refused', in_short(error))

    def _report(self) -> None:
        previous, self._reported = self._reported, time.monotonic()
        self.period = self._reported - previous
        name = self._node.get_fully_qualified_name()
        message = DiagnosticArray(status=self._statuses())
        for status in message.status:
            status.name = f'{name.lstrip("/")}: {status.name}'
            status.hardware_id = name
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
        self.lately.clear()


class Diagnostics(Report):
    """Counts messages received, answered, skipped, refused and failed.

    Attributes:
        is_used: says whether the newest message on a topic, by its whole name, has an effect.
        clock: the clock that stamps are compared with.
        arm: the arm that keeps the history of friction, or None.
        idle: state of an inactive node, '' for an active one.
        unanswered: topic and reason of the last message that was not answered, '' before.
        parts: functions that make further statuses.
    """

    def __init__(self, node: Node, inputs: Inputs) -> None:
        """Report as part of ``node``, which has these ``inputs``."""
        super().__init__(node, self._all)
        self._inputs = inputs
        self.describe(None)
        self.idle = ''
        self.is_used: Callable[[str], bool] = lambda topic: True
        self.parts: list[Callable[[], DiagnosticStatus]] = []
        self.arm: DrivenArm | None = None
        self._topics = set[tuple[str, bool]]()
        self._newest: dict[str, float] = {}
        self._last: float | None = None
        self.unanswered = self._failure = self._unknown = ''
        self._refusals = Refusals()
        self._backbone: Backbone | None = None
        self.clock = SteppedClock(node)

    def describe(
        self, solver: Solver | None, limits: DiagnosticLimits = DiagnosticLimits()
    ) -> None:
        """Report on ``solver`` from now on, or on none, and warn beyond ``limits``."""
        self._solver, self._limits = solver, limits

    def enter(self, state: str) -> None:
        """Report on a node that is inactive, in ``state``, from now on; '' for an active one."""
        self.idle, self._newest, self._last = state, {}, None

    def received(self, topic: str, stamp: Stamp | None, *, is_tensions: bool = False) -> None:
        """Count a message with its ``stamp``, or None.

        ``is_tensions`` marks a message with tensions, which should come on one topic only.
        """
        self.count('received')
        self._topics.add((topic, is_tensions))
        if stamp is None or not any(stamp):
            self.count('unstamped')
            return
        seconds = 1e-9 * stamp.ns
        # Stamps are compared within a topic, but all topics of tensions count as one.
        source = '' if is_tensions else topic
        if seconds < self._newest.get(source, seconds):
            self.count('backwards')
        self._newest[source] = self._last = seconds
        now = self.clock.now_ns
        if now and 1e-9 * now - seconds > self._limits.age_limit:
            self.count('old')
        elif self.clock.ahead(stamp, now) > self._limits.ahead_limit:
            self.count('ahead')

    def answered(self, backbone: Backbone, duration: float) -> None:
        """Count a solved backbone and the ``duration`` of solving [s]."""
        self.count('answered')
        self.count('busy', duration)
        self._backbone = backbone

    def tip_unknown(self, error: OctoArmError) -> None:
        """Count a backbone whose tip has no covariance because of ``error``."""
        self.count('tip unknown')
        self._unknown = in_short(error)

    def refused(self, topic: str, error: OctoArmError) -> None:
        """Count and log a message on ``topic`` that is not answered because of ``error``."""
        self.unanswered = f'{topic}: {in_short(error)}'
        if isinstance(error, SolveError):
            self.count('failed')
            self.count('unaffordable', int(isinstance(error, ContinuationError)))
            self._failure = in_short(error)
            self.log.add(f'{topic} refused', self._failure)
        else:
            super().refused(topic, error)
            self._refusals.count(topic, in_short(error))

    def _all(self) -> list[DiagnosticStatus]:
        more = (part() for part in self.parts)
        statuses = [self._solver_status(), self._input_status(), self._output_status(), *more]
        self._topics.clear()
        return statuses

    def _solver_status(self) -> DiagnosticStatus:
        failed, answered = self.lately['failed'], self.lately['answered']
        unknown, busy = self.lately['tip unknown'], self.lately['busy']
        problem = self.idle or (f'no answer to {failed}: {self._failure}' if failed else '')
        if unknown and not problem:
            problem = f'no covariance, and so no tip_pose, for {unknown}: {self._unknown}'
        level = DiagnosticStatus.ERROR if failed and not answered else DiagnosticStatus.WARN
        solver, backbone = self._solver, self._backbone
        return make_status(
            'solver',
            level,
            problem,
            'solving' if answered else 'waiting',
            {
                'model': solver.model if solver else '',
                'compiled': solver is not None and solver.is_compiled,
                'residual': f'{float(backbone.residual) if backbone else 0.0:.3e}',
                'iterations': int(backbone.iterations) if backbone else 0,
                'time per solve [ms]': f'{1e3 * busy / answered:.3f}' if answered else '',
                'failures': self.totals['failed'],
                'beyond solve_budget': self.totals['unaffordable'],
                'last failure': self._failure,
                'shapes without tip_pose': self.totals['tip unknown'],
                'friction history kept': self.arm is not None and self.arm.has_history,
                'friction history forgotten after a gap': self.arm.forgotten if self.arm else 0,
            },
        )

    def _input_status(self) -> DiagnosticStatus:
        lately = self.lately
        if self.idle:
            problems = [self.idle]
        else:
            problems = self._inputs.silent(self._limits.silence_limit, self.is_used)
        now, is_simulated = 1e-9 * self.clock.now_ns, self._node.get_parameter('use_sim_time')
        if not now:
            problems.append(NO_TIME)
        elif is_simulated.value and self._node.count_publishers('/clock') > 1:
            problems.append('several sources: several publishers on /clock')
        if lately['refused']:
            problems.append(f'{lately["refused"]} refused: {self.reason}')
        topics = sorted(topic for topic, _ in self._topics)
        tension_topics = sorted(topic for topic, is_tensions in self._topics if is_tensions)
        if len(tension_topics) > 1:
            problems.append(f'several sources: {", ".join(tension_topics)}')
        publishers = self._inputs.publishers()
        for topic in topics:
            if publishers.get(topic, 0) > 1:
                problems.append(f'several sources: {publishers[topic]} publishers on {topic}')
        for outcome, words in (
            ('backwards', 'stamps running backwards'),
            ('ahead', 'stamps from the future'),
            ('old', f'stamps older than {self._limits.age_limit:g} s'),
            ('unstamped', 'without a stamp'),
        ):
            if lately[outcome]:
                problems.append(f'{lately[outcome]} {words}')
        return make_status(
            'input',
            DiagnosticStatus.WARN,
            '; '.join(problems),
            'receiving' if lately['received'] else 'waiting',
            {
                'rate [Hz]': f'{lately["received"] / self.period:.1f}',
                'age of the newest stamp [s]': (
                    '' if self._last is None or not now else f'{now - self._last:.3f}'
                ),
                'source': ', '.join(topics),
                'publishers': sum(publishers.values()),
                'refused': self.totals['refused'],
                'last refusal': self.reason,
                'refused by reason': '; '.join(self._refusals.lines())[:_LONGEST],
                'stamps running backwards': self.totals['backwards'],
                'stamps from the future': self.totals['ahead'],
                'old stamps': self.totals['old'],
                'without a stamp': self.totals['unstamped'],
            },
        )

    def _output_status(self) -> DiagnosticStatus:
        skipped, answered = self.lately['skipped'], self.lately['answered']
        problem = self.idle or (f'{skipped} skipped for newer ones' if skipped else '')
        return make_status(
            'output',
            DiagnosticStatus.WARN,
            problem,
            'publishing' if answered else 'waiting',
            {
                'rate [Hz]': f'{answered / self.period:.1f}',
                'answered': self.totals['answered'],
                'skipped': self.totals['skipped'],
            },
        )


def make_status(
    name: str, level: bytes, problem: str, fine: str, values: dict[str, object]
) -> DiagnosticStatus:
    """Return a status of ``level`` with the ``problem``, or an OK status with text ``fine``."""
    status = DiagnosticStatus(name=name, message=problem or fine)
    status.level = level if problem else DiagnosticStatus.OK
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return status
