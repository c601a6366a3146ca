"""Diagnostics of the simulator: numbers of commands and readings, and contradicting commanders."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from octo_arm_model.arm.errors import OctoArmError, in_short
from octo_arm_model.ros.checked_node import RefusalLog
from octo_arm_model.ros.node import diagnostics
from octo_arm_model.ros.qos import create_publisher

# What is commanded, and the value [N] or [m], by tendon.
Command = Mapping[str, tuple[str, float]]
_SWITCHES = 3  # from one to another that make a contradiction: one is a handover
_APART = 1e9  # distance of commands of other quantities


class Commanders:
    """Finds commands that contradict each other.

    rclpy does not tell which publisher a message is from. A command that is nearer to the one
    before the last than to the last is taken for that of another publisher of its topic, where
    there are several; that of another topic always, unless they are equal.
    """

    def __init__(self, node: Node) -> None:
        """Of the commands that ``node`` hears."""
        self._node = node
        self._last: tuple[str, Command] | None = None
        self._before: dict[str, Command] = {}
        self._switches = 0
        self._topics: Counter[str] = Counter()

    def note(self, topic: str, command: Command) -> None:
        """Take note of an accepted ``command`` on ``topic``."""
        last, self._last = self._last, (topic, command)
        if last is None:
            return
        distance = _distance(command, last[1])
        before = self._before.get(topic)
        self._before[last[0]] = last[1]
        if not distance:
            return
        is_other = last[0] != topic
        if not is_other and before is not None and self._node.count_publishers(topic) > 1:
            is_other = _distance(command, before) < 0.5 * distance
        if is_other:
            self._switches += 1
            self._topics.update((topic, last[0]))

    def report(self) -> str:
        """Which commanders have contradicted each other lately; empty for none."""
        switches, self._switches = self._switches, self._switches // 2
        topics, self._topics = sorted(self._topics), Counter()
        if switches < _SWITCHES or not topics:
            return ''
        named = [f'{topic} of {", ".join(self._publishers(topic))}' for topic in topics]
        return f'commanders contradict each other: {"; ".join(named)}'

    def _publishers(self, topic: str) -> list[str]:
        found = self._node.get_publishers_info_by_topic(topic)
        names = {f'{one.node_namespace.rstrip("/")}/{one.node_name}' for one in found}
        return sorted(names) or ['nobody any more']


def _distance(one: Command, other: Command) -> float:
    """How far two commands are apart, in the tendons that both name."""
    distance = 0.0
    for name in one.keys() & other.keys():
        (kind, value), (other_kind, other_value) = one[name], other[name]
        distance += abs(value - other_value) if kind == other_kind else _APART
    return distance


PAUSED = 'nothing, as it is paused'  # source of one that stands still


class SimulatorDiagnostics:
    """Counts what a simulator is commanded and publishes.

    Attributes:
        counts: of commands, those refused, readings published, readings lost and failed steps, and
            by how much time the arm went on [s].
    """

    def __init__(self, node: Node) -> None:
        """Publish and warn by ``node``."""
        self._node = node
        names = 'commands', 'refused', 'published', 'lost', 'failed', 'simulated'
        self.counts: dict[str, float] = dict.fromkeys(names, 0)
        self._reported = self.counts | {'time': time.monotonic()}
        self._reason = self._failure = ''
        self._refusal_log = RefusalLog(node)
        self._publisher = create_publisher(
            node, DiagnosticArray, diagnostics.TOPIC, diagnostics.QOS
        )

    def count(self, older: int) -> None:
        """Count a command, and the ``older`` ones that it replaces."""
        self.counts['commands'] += 1 + older

    def refuse(self, topic: str, error: OctoArmError) -> None:
        """Count a command on ``topic`` as refused, and say why."""
        self.counts['refused'] += 1
        self._reason = f'{topic}: {in_short(error)}'
        self.warn(topic, error)

    def warn(self, topic: str, error: OctoArmError) -> None:
        """Warn of what a message on ``topic`` led to, at most once a second."""
        self._refusal_log.warn(topic, error)

    def fail(self, error: OctoArmError) -> None:
        """Count a step of the arm as failed, and say why."""
        self.counts['failed'] += 1
        self._failure = in_short(error)
        self._refusal_log.say('the arm stays as it was', self._failure)

    def publish(self, source: str, problem: str) -> None:
        """Publish the counts since the last time.

        ``source`` is what the simulator follows, and ``problem`` what else is wrong.
        """
        now = self.counts | {'time': time.monotonic()}
        lately, self._reported = {name: now[name] - self._reported[name] for name in now}, now
        period = lately['time']  # a step may take longer than a usual one
        problems = [problem] if problem else []
        if refused := lately['refused']:
            problems.append(f'{refused} refused: {self._reason}')
        if failed := lately['failed']:
            problems.append(f'{failed} steps failed: {self._failure}')
        fine, warn = f'following {source}', DiagnosticStatus.WARN
        status = diagnostics.make_status('simulator', warn, '; '.join(problems), fine, {
            'source': source,
            'commands [Hz]': f'{lately["commands"] / period:.1f}',
            'refused': self.counts['refused'],
            'last refusal': self._reason,
            'readings [Hz]': f'{lately["published"] / period:.1f}',
            'readings lost': self.counts['lost'],
            'real time factor': f'{lately["simulated"] / period:.2f}',
            'failed steps': self.counts['failed'],
            'last failure': self._failure,
        })  # fmt: skip
        self._publisher.publish(diagnostics.diagnostics_message(self._node, status))
