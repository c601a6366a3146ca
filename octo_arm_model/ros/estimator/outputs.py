"""Outputs of the estimator: topics of the estimate, and diagnostics of its consistency."""

from __future__ import annotations

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from octo_arm_model.config.config import Config
from octo_arm_model.estimation.estimate import NO_CONTACT, Estimate, contact_of
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput
from octo_arm_model.estimation.rules import Consistency
from octo_arm_model.rod.sensitivity import chi_square_limit
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.node.diagnostics import Diagnostics, make_status
from octo_arm_model.ros.node.outputs import BackbonePublishers, is_heard
from octo_arm_model.ros.topics import message_class
from octo_arm_model.wire.estimate import BESIDES, EstimateWriter
from octo_arm_model.wire.markers import UncertaintyMarkersWriter
from octo_arm_model.wire.messages import Stamp

_BAND = 0.999  # probability of the chi-square interval; innovations above it are too large
_FEWEST = 30  # innovations that the judgement needs
_LONGEST = 900  # characters of the list of what is not observable


class EstimateStatus:
    """Diagnostic status that says how well measurements agree with the estimate."""

    def __init__(self) -> None:
        """Report that there is no estimator."""
        self._run_back: dict[str, int] = {}
        self.follow(None, None)

    def follow(self, estimator: Estimator | None, config: Config | None) -> None:
        """Report on ``estimator`` from now on; None while there is no estimator."""
        self._estimator, self._config = estimator, config
        self._update: EstimatorOutput | None = None
        self._newest_ns = 0
        self._late = self._restarts = 0

    def add(self, update: EstimatorOutput, stamp_ns: int) -> None:
        """Record the ``update`` by a measurement, and the newest stamp [ns]."""
        self._newest_ns = stamp_ns
        self._update = update

    def ran_back(self, topic: str) -> None:
        """Record a reset of the estimate because the stamps of ``topic`` ran back."""
        self._run_back[topic] = self._run_back.get(topic, 0) + 1

    def report(self, diagnostics: Diagnostics) -> DiagnosticStatus:
        """Return the present status, with what ``diagnostics`` have counted lately."""
        estimator, config, update = self._estimator, self._config, self._update
        problems = [
            f'stamps of {topic} ran back, the estimate was reset {count} time(s)'
            for topic, count in sorted(self._run_back.items())
        ]
        self._run_back = {}
        used, refused, failed = (diagnostics.lately[w] for w in ('answered', 'refused', 'failed'))
        if refused + failed and not used:
            reason = diagnostics.reason if refused else diagnostics.failure
            problems.append(f'none of {refused + failed} measurements could be used: {reason}')
        fine = 'estimating' if used else 'waiting'
        if estimator is None or config is None or update is None:
            problem = diagnostics.idle or '; '.join(problems)
            return make_status('estimate', DiagnosticStatus.WARN, problem, 'waiting', {})
        values: dict[str, object] = {
            'hypothesis': update.hypothesis,
            'probabilities': ', '.join(
                f'{name}: {part:.3f}' for name, part in update.probabilities.items()
            ),
            'came too late': estimator.late,
            'without a shape': estimator.failed,
            'restarts': estimator.restarts,
        }
        for name, record in estimator.consistency.items():
            values[f'{name} accepted'] = record.accepted
            values[f'{name} refused'] = record.refused
            words, is_large = consistency(record)
            values[f'{name} normalised square'] = words
            if is_large:
                problems.append(f'innovations of {name} are larger than expected: {words}')
        for name, since in sorted(estimator.refused_since.items()):
            seconds = 1e-9 * (self._newest_ns - since)
            problems.append(f'{name} is refused since {1e-9 * since:.3f} s, for {seconds:.1f} s')
        if estimator.suspects:
            problems.append(f'one of these sensors may lie: {", ".join(estimator.suspects)}')
        if (recent := estimator.late - self._late) > 0:
            problems.append(f'{recent} came too late')
        if (recent := estimator.restarts - self._restarts) > 0:
            problems.append(f'sensors contradicted the estimate, reset {recent} time(s)')
        self._late, self._restarts = estimator.late, estimator.restarts
        values |= self._contact(update, config)
        reasons = '; '.join(direction.reason for direction in update.estimate.unobserved)
        values['not observable'] = reasons[:_LONGEST]
        return make_status('estimate', DiagnosticStatus.WARN, '; '.join(problems), fine, values)

    def _contact(self, update: EstimatorOutput, config: Config) -> dict[str, object]:
        contact = contact_of(update.estimate, config.arm)
        if contact is None:
            return {}
        force, covariance = contact.wrench[:3], contact.covariance[:3, :3]
        square = float(force @ np.linalg.pinv(covariance) @ force)
        deviation = np.sqrt(covariance.diagonal())
        return {
            'contact at s [m]': f'{contact.s:.4g}',
            'contact force [N]': ' '.join(f'{value:.4g}' for value in force),
            'standard deviation of it [N]': ' '.join(f'{value:.2g}' for value in deviation),
            'normalised square of it, chi-square of 3': f'{square:.3g}',
        }


def consistency(record: Consistency) -> tuple[str, bool]:
    """Describe the recent normalised squares of one sensor, and say if they are too large.

    If noise and priors are right, their sum is chi-square distributed. Smaller values are no
    fault: a prior that allows for changes is too wide while nothing changes.
    """
    if not record.recent:
        return '', False
    square, size = (sum(column) for column in zip(*record.recent, strict=True))
    low, high = (
        chi_square_limit(side, size) / size for side in (0.5 - 0.5 * _BAND, 0.5 + 0.5 * _BAND)
    )
    mean, count = square / size, len(record.recent)
    words = f'{mean:.2f} a number of the last {count}, expected {low:.2f} to {high:.2f}'
    return words, count >= _FEWEST and mean > high


class EstimatePublishers(BackbonePublishers):
    """Publishes estimates on all topics of one node."""

    def __init__(self, node: Node) -> None:
        """Create the publishers on ``node``; ConfigError if rclpy refuses a QoS override."""
        super().__init__(node)
        self._besides = {
            topic: self._open(message_class(kind), topic) for topic, kind in BESIDES.items()
        }

    def describe(self, solver: Solver, config: Config) -> None:
        """Prepare the messages for estimates of ``solver``, with the frames of ``config``."""
        if solver is self._solver:
            return
        super().describe(solver, config)
        self._tube = UncertaintyMarkersWriter(config.arm, solver.grid.s, config.base_frame)
        self._estimate_writer = EstimateWriter(config.base_frame, config.arm, solver.grid.s)

    def publish_estimate(self, estimate: Estimate, stamp: Stamp) -> None:
        """Publish an ``estimate`` of the arm that `describe` was called with."""
        assert self._solver is not None
        backbone = estimate.backbone
        contact = contact_of(estimate, self._solver.arm)
        shown_contact = contact or NO_CONTACT

        def markers() -> bytes:
            return self._tube.write(
                backbone.position,
                backbone.quaternion,
                estimate.pose_covariance[:, :3, :3],
                (shown_contact.s, shown_contact.wrench[:3], shown_contact.covariance[:3, :3]),
                *stamp,
            )

        tip_covariance = estimate.pose_covariance[-1] if self.is_tip_heard else None
        self.publish(backbone, tip_covariance, stamp, markers)
        self.publish_tensions(backbone, stamp)
        unheard = tuple(topic for topic, output in self._besides.items() if not is_heard(output))
        messages = self._estimate_writer.write(estimate, contact, stamp, unheard)
        for topic, data in messages.items():
            self._besides[topic].publish(data)
