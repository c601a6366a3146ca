"""How the node is doing, on ``/diagnostics``."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from octo_arm_model.backbone import Backbone

PERIOD = 1.0  # [s]


class Health:
    """Counts answers and refusals, and reports once a period."""

    def __init__(self, node: Node, model: str) -> None:
        """Report as part of ``node``, which solves with ``model``."""
        self._node, self._model = node, model
        self._answered = self._refused = self._refused_lately = 0
        self._reason = ''
        self._residual, self._iterations = 0.0, 0
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 5)
        node.create_timer(PERIOD, self._report)

    def answered(self, backbone: Backbone) -> None:
        """Count a solution."""
        self._answered += 1
        self._residual = float(backbone.residual)
        self._iterations = int(backbone.iterations)

    def refused(self, reason: str) -> None:
        """Count a message that was not answered."""
        self._refused += 1
        self._refused_lately += 1
        self._reason = reason

    def _report(self) -> None:
        status = DiagnosticStatus(level=DiagnosticStatus.OK, message='solving')
        if self._refused_lately:
            status.level = DiagnosticStatus.WARN
            status.message = f'refused {self._refused_lately}: {self._reason}'
        elif not self._answered:
            status.message = 'no tensions yet'
        self._refused_lately = 0
        status.name = f'{self._node.get_fully_qualified_name().lstrip("/")}: solver'
        status.hardware_id = self._node.get_fully_qualified_name()
        values = {
            'model': self._model,
            'answered': self._answered,
            'refused': self._refused,
            'last refusal': self._reason,
            'residual': f'{self._residual:.3e}',
            'iterations': self._iterations,
        }
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        now = self._node.get_clock().now().to_msg()
        message = DiagnosticArray(status=[status])
        message.header.stamp = now
        self._publisher.publish(message)
