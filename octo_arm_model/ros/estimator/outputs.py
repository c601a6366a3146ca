"""What the estimator says: topics of the estimate, and diagnostics of what it believes."""

from __future__ import annotations

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from octo_arm_model.arm.errors import OctoArmError, in_short
from octo_arm_model.config.config import Config
from octo_arm_model.estimation.estimate import NO_CONTACT, Estimate, contact_of
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput
from octo_arm_model.estimation.rules import Consistency
from octo_arm_model.rod.sensitivity import chi_square_limit
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.node.diagnostics import make_status
from octo_arm_model.ros.node.outputs import BackbonePublishers
from octo_arm_model.ros.topics import message_class
from octo_arm_model.wire.estimate import BESIDES, EstimateWriter
from octo_arm_model.wire.markers import UncertaintyMarkersWriter
from octo_arm_model.wire.messages import Stamp

_BAND = 0.999  # of the chi-square distribution; innovations beyond it are too large
_FEWEST = 30  # innovations from which on that is judged
_LONGEST = 900  # characters of what is not observable


class EstimateStatus:
    """A status of the diagnostics: how well measurements agree with the estimate."""

    def __init__(self, node: Node) -> None:
        """Report as part of ``node``."""
        self._node = node
        self._run_back: dict[str, int] = {}
        self.follow(None, None)

    def follow(self, estimator: Estimator | None, config: Config | None) -> None:
        """Report of ``estimator`` from now on; None while there is none."""
        self._estimator, self._config = estimator, config
        self._found: EstimatorOutput | None = None
        self._newest_ns = 0
        self._late = self._restarts = 0
        self._used, self._unused, self._reason = 0, 0, ''

    def add(self, found: EstimatorOutput, stamp_ns: int) -> None:
        """Note what came of a measurement, and the newest stamp."""
        self._newest_ns = stamp_ns
        self._found = found
        self._used += 1

    def refused(self, topic: str, error: OctoArmError) -> None:
        """Note that nothing came of a measurement on ``topic``."""
        self._unused += 1
        self._reason = f'{topic}: {in_short(error)}'

    def ran_back(self, topic: str) -> None:
        """Note that the estimate begins anew because of the stamps of ``topic``."""
        self._run_back[topic] = self._run_back.get(topic, 0) + 1

    def report(self, idle: str) -> DiagnosticStatus:
        """The status now, of a node that is ``idle`` in some state, or of one that is not."""
        estimator, config, found = self._estimator, self._config, self._found
        problems = [
            f'stamps of {topic} ran back, it began anew {count} time(s)'
            for topic, count in sorted(self._run_back.items())
        ]
        if self._unused and not self._used:
            problems.append(f'none of {self._unused} measurements could be used: {self._reason}')
        fine = 'estimating' if self._used else 'waiting'
        self._run_back, self._used, self._unused = {}, 0, 0
        if estimator is None or config is None or found is None:
            problem = idle or '; '.join(problems)
            return make_status('estimate', DiagnosticStatus.WARN, problem, 'waiting', {})
        values: dict[str, object] = {
            'hypothesis': found.hypothesis,
            'probabilities': ', '.join(
                f'{name}: {part:.3f}' for name, part in found.probabilities.items()
            ),
            'came too late': estimator.late,
            'without a shape': estimator.failed,
            'restarts': estimator.restarts,
        }
        for name, one in estimator.consistency.items():
            values[f'{name} accepted'] = one.accepted
            values[f'{name} refused'] = one.refused
            words, is_large = consistency(one)
            values[f'{name} normalised square'] = words
            if is_large:
                problems.append(f'innovations of {name} are larger than told: {words}')
        for name, since in sorted(estimator.refused_since.items()):
            seconds = 1e-9 * (self._newest_ns - since)
            problems.append(f'{name} is refused since {1e-9 * since:.3f} s, for {seconds:.1f} s')
        if estimator.suspects:
            problems.append(f'one of these sensors may lie: {", ".join(estimator.suspects)}')
        if (lately := estimator.late - self._late) > 0:
            problems.append(f'{lately} came too late')
        if (lately := estimator.restarts - self._restarts) > 0:
            problems.append(f'contradicted by its sensors, it began anew {lately} time(s)')
        self._late, self._restarts = estimator.late, estimator.restarts
        values |= self._contact(found, config)
        reasons = '; '.join(one.reason for one in found.estimate.unobserved)
        values['not observable'] = reasons[:_LONGEST]
        return make_status('estimate', DiagnosticStatus.WARN, '; '.join(problems), fine, values)

    def _contact(self, found: EstimatorOutput, config: Config) -> dict[str, object]:
        contact = contact_of(found.estimate, config.arm)
        if contact is None:
            return {}
        force, covariance = contact.wrench[:3], contact.covariance[:3, :3]
        square = float(force @ np.linalg.pinv(covariance) @ force)
        deviation = np.sqrt(covariance.diagonal())
        return {
            'contact at s [m]': f'{contact.s:.4g}',
            'contact force [N]': ' '.join(f'{one:.4g}' for one in force),
            'standard deviation of it [N]': ' '.join(f'{one:.2g}' for one in deviation),
            'normalised square of it, chi-square of 3': f'{square:.3g}',
        }


def consistency(one: Consistency) -> tuple[str, bool]:
    """Recent normalised squares of one kind of measurement in words, and if they are too large.

    Their sum is chi-square distributed where noise and priors are right. Smaller ones are no
    fault: a prior that allows for changes is too wide while nothing changes.
    """
    if not one.recent:
        return '', False
    square, size = (sum(column) for column in zip(*one.recent, strict=True))
    low, high = (
        chi_square_limit(side, size) / size for side in (0.5 - 0.5 * _BAND, 0.5 + 0.5 * _BAND)
    )
    mean, count = square / size, len(one.recent)
    words = f'{mean:.2f} a number of the last {count}, expected {low:.2f} to {high:.2f}'
    return words, count >= _FEWEST and mean > high


class EstimatePublishers(BackbonePublishers):
    """Publishes estimates on all topics of one node."""

    def __init__(self, node: Node) -> None:
        """Create the publishers on ``node``; raises ConfigError as `BackbonePublishers`."""
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
        """Publish an ``estimate`` of the arm that was described."""
        assert self._solver is not None
        backbone = estimate.backbone
        contact = contact_of(estimate, self._solver.arm)
        known = contact or NO_CONTACT

        def markers() -> bytes:
            return self._tube.write(
                backbone.position,
                backbone.quaternion,
                estimate.pose_covariance[:, :3, :3],
                (known.s, known.wrench[:3], known.covariance[:3, :3]),
                *stamp,
            )

        of_tip = estimate.pose_covariance[-1] if self.is_tip_heard else None
        self.publish(backbone, of_tip, stamp, markers)
        self.publish_tensions(backbone, stamp)
        unheard = tuple(topic for topic, output in self._besides.items() if not output.is_heard)
        messages = self._estimate_writer.write(estimate, contact, stamp, unheard)
        for topic, data in messages.items():
            self._besides[topic].publish(data)
