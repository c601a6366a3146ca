"""Diagnostics of the simulator: numbers of commands and readings."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from octo_arm_model.arm.errors import OctoArmError, in_short
from octo_arm_model.ros.node import diagnostics
from octo_arm_model.ros.qos import create_publisher
from octo_arm_model.ros.refusal_log import RefusalLog

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
