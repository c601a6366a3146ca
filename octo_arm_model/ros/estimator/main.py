"""The node ``octo_arm_estimator``: estimates shape and contact from any measurements.

``octo_arm_lifecycle_estimator`` is the same as a managed node.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.estimation.estimate import NO_CONTACT, Estimate, contact_of
from octo_arm_model.estimation.estimator import Estimator, EstimatorOutput
from octo_arm_model.estimation.measurement import Measurement
from octo_arm_model.estimation.measurements import Tensions
from octo_arm_model.estimation.model import ArmModel
from octo_arm_model.estimation.rules import Consistency
from octo_arm_model.estimation.settings import ESTIMATOR_PARAMETERS, PREFIX, EstimatorSettings
from octo_arm_model.rod.sensitivity import chi_square_limit
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.node.diagnostics import make_status
from octo_arm_model.ros.node.inputs import stamp_of
from octo_arm_model.ros.node.main import ManagedNode, ServedNode, run
from octo_arm_model.ros.node.outputs import BackbonePublishers, is_heard
from octo_arm_model.ros.node.server import Prepared, Server, described
from octo_arm_model.ros.topics import message_class
from octo_arm_model.ros.work import on_jump_back
from octo_arm_model.wire.estimate import BESIDES, EstimateWriter
from octo_arm_model.wire.markers import UncertaintyMarkersWriter
from octo_arm_model.wire.measurements import (
    MEASUREMENT_TOPICS,
    MeasuredArm,
    displacements_of,
    tensions_of,
)
from octo_arm_model.wire.messages import Stamp

TABLE = (*PARAMETERS, *ESTIMATOR_PARAMETERS)
_MODEL_PARAMETER = next(parameter for parameter in PARAMETERS if parameter.name == 'model')
MODEL = 'exact'  # used whatever the parameter says, because it alone has loads


@dataclass(frozen=True)
class PreparedEstimator(Prepared):
    """An arm ready to be estimated; a change of parameters replaces it as a whole.

    Its description is that of the arm without the settings of the estimator; its solver is that of
    the first hypothesis.
    """

    settings: EstimatorSettings  #: settings of the estimator
    models: Mapping[str, ArmModel]  #: model of each hypothesis, by its name

    @classmethod
    def of(cls, values: dict[str, Any]) -> PreparedEstimator:
        """Prepare the arm and its estimator; OctoArmError if ``values`` do not describe them."""
        estimation = {name: value for name, value in values.items() if name.startswith(PREFIX)}
        arm = {name: value for name, value in values.items() if name not in estimation}
        _MODEL_PARAMETER.check(arm['model'])
        arm['model'] = MODEL
        description, config = described(arm)
        settings = EstimatorSettings.from_parameters(estimation, config)
        models = settings.models(config)
        solver = next(iter(models.values())).solver
        prepared = cls(description, config, solver, settings, models)
        # A first update compiles and loads what messages need, before the first one comes.
        rest = Tensions(np.zeros(len(config.arm.tendons)), settings.tension_stddev)
        prepared.estimator().add(0, [rest]).estimate.pose_covariance  # noqa: B018
        return prepared

    def estimates_as(self, other: PreparedEstimator) -> bool:
        """Whether the same measurements give the same estimate as with ``other``."""
        names = 'uncertainty', 'load_cells', 'encoders', 'base_frame'
        is_same = all(getattr(self.config, name) == getattr(other.config, name) for name in names)
        return (
            is_same
            and self.settings == other.settings
            and self.config.has_balance_of(other.config)
        )

    def estimator(self) -> Estimator:
        """Return an estimator of the arm in the state of the prior."""
        given = self.settings.given
        return Estimator(self.models, self.settings.rules, given.window, given.change_time)


_BAND = 0.999  # probability of the chi-square interval; innovations above it are too large
_FEWEST = 30  # innovations that the judgement needs
_LONGEST = 900  # characters of the list of what is not observable


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


_BACK = 1.0  # [s] beyond the window; stamps that run back further reset the estimate


class EstimatorServer(Server[PreparedEstimator, EstimatePublishers]):
    """Publishes an estimate after each measurement; activation resets it to the prior."""

    def __init__(self, node: Node) -> None:
        """Declare the parameters of ``node``; ConfigError if a value has the wrong type."""
        super().__init__(node, TABLE, PreparedEstimator.of, EstimatePublishers)
        self._estimator: Estimator | None = None
        self._newest: dict[str, Stamp] = {}  # of the measurements in the estimate, by topic
        self._update: EstimatorOutput | None = None
        self._run_back = Counter[str]()  # resets of the estimate by stamps, since the last report
        self._late = self._restarts = 0  # of the estimator, as of the last report
        self._diagnostics.parts.append(self._report)
        self._jumps = on_jump_back(node, self._on_jump_back)

    def _open(self) -> None:
        self._reset_estimate()
        for topic, message in MEASUREMENT_TOPICS.items():
            self._inputs.subscribe(
                message_class(message.type_name), topic, partial(self._measure, message.read)
            )

    def _measure(self, read: Callable[..., Measurement], topic: str, message: Any) -> None:
        self._take(topic, stamp_of(message), read(message, self._measured_arm()))

    def _close(self) -> None:
        self._estimator = self._update = None

    def _change_arm(self, previous: PreparedEstimator | None, arm: PreparedEstimator) -> None:
        config, settings = arm.config, arm.settings
        if previous is not None and self._estimator is not None and not arm.estimates_as(previous):
            self._reset_estimate()
        self._node.get_logger().info(
            f'{config.arm.length} m in {config.base_frame}, contact: '
            + '; '.join([', '.join(arm.models), *settings.notes])
        )

    def _reset_estimate(self) -> Estimator:
        self._estimator = estimator = self._arm.estimator()
        self._newest, self._update = {}, None
        self._late = self._restarts = 0
        return estimator

    def _on_jump_back(self) -> None:
        # Even if all stamps would be within the window, as when a short simulation begins anew.
        if self._estimator is not None:
            self._begin_anew('/clock', 'time jumps back')

    def _begin_anew(self, topic: str, why: str) -> Estimator:
        self._diagnostics.log.add(topic, f'{why}; the estimate is reset')
        self._run_back[topic] += 1
        return self._reset_estimate()

    def _measured_arm(self) -> MeasuredArm:
        config = self._arm.config
        return MeasuredArm(
            config,
            self._arm.settings,
            lambda frame, stamp_ns: self._frames.pose_of(frame, config.base_frame, stamp_ns),
        )

    def _on_readings(self, topic: str, stamp: Stamp | None, readings: FloatArray) -> None:
        self._take(topic, stamp, tensions_of(readings, self._measured_arm()), is_tensions=True)

    def _on_motors(self, field: str, topic: str, message: Any) -> None:
        self._measure(partial(displacements_of, field=field), topic, message)

    def _take(
        self,
        topic: str,
        stamp: Stamp | None,
        measurement: Measurement,
        *,
        is_tensions: bool = False,
    ) -> None:
        """Update the estimate by a ``measurement`` and publish it; OctoArmError if refused."""
        estimator = self._estimator
        assert estimator is not None
        self._diagnostics.received(topic, stamp, is_tensions=is_tensions)
        resolved = self._resolved(stamp)
        step_back = 1e-9 * (self._newest.get(topic, resolved).ns - resolved.ns)
        if step_back > self._arm.settings.given.window + _BACK:  # as when a bag is played again
            estimator = self._begin_anew(topic, f'stamps run back by {step_back:.3g} s')
        start = time.perf_counter()
        update = estimator.add(resolved.ns, [measurement])
        duration = time.perf_counter() - start
        arm, outbox = self._arm, self._publishers
        assert outbox is not None
        self._newest[topic] = max(resolved, self._newest.get(topic, resolved))
        newest = max(self._newest.values())
        if update.begins_anew:
            words = (
                'the estimate is reset: sensors have contradicted it for '
                f'{arm.settings.rules.recover_after:g} s (estimator.recover_after)'
            )
            self._diagnostics.log.add(topic, words)
        outbox.describe(arm.models[update.hypothesis].solver, arm.config)
        outbox.publish_estimate(update.estimate, newest)
        self._diagnostics.answered(update.estimate.backbone, duration)
        self._update = update
        self._warn_of_rejected(update)

    def _resolved(self, stamp: Stamp | None) -> Stamp:
        """Return the ``stamp`` of a message, or the time of receipt if it has none.

        MessageError if it is no valid time; MeasurementError if it is ahead of the clock: all
        measurements until that time would then count as late.
        """
        clock, limit = self._diagnostics.clock, self._arm.config.diagnostic_limits.ahead_limit
        resolved = clock.time_of(stamp)
        if (ahead := clock.ahead(resolved, clock.now_ns)) > limit:
            raise MeasurementError(
                f'its stamp is {ahead:.6g} s ahead of the clock, expected at most {limit:g} s '
                '(diagnostics.ahead_limit)'
            )
        return resolved

    def _report(self) -> DiagnosticStatus:
        """Say how well measurements agree with the estimate."""
        estimator, update, diagnostics = self._estimator, self._update, self._diagnostics
        problems = [
            f'stamps of {topic} ran back, the estimate was reset {count} time(s)'
            for topic, count in sorted(self._run_back.items())
        ]
        self._run_back.clear()
        used, refused, failed = (diagnostics.lately[w] for w in ('answered', 'refused', 'failed'))
        if refused + failed and not used:
            words = f'none of {refused + failed} measurements could be used'
            problems.append(f'{words}: {diagnostics.unanswered}')
        fine = 'estimating' if used else 'waiting'
        if estimator is None or update is None:
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
        newest_ns = max(self._newest.values()).ns
        for name, since in sorted(estimator.refused_since.items()):
            seconds = 1e-9 * (newest_ns - since)
            problems.append(f'{name} is refused since {1e-9 * since:.3f} s, for {seconds:.1f} s')
        if estimator.suspects:
            problems.append(f'one of these sensors may lie: {", ".join(estimator.suspects)}')
        if (recent := estimator.late - self._late) > 0:
            problems.append(f'{recent} came too late')
        if (recent := estimator.restarts - self._restarts) > 0:
            problems.append(f'sensors contradicted the estimate, reset {recent} time(s)')
        self._late, self._restarts = estimator.late, estimator.restarts
        values |= self._contact(update.estimate)
        values['not observable'] = '; '.join(update.estimate.unobserved)[:_LONGEST]
        return make_status('estimate', DiagnosticStatus.WARN, '; '.join(problems), fine, values)

    def _contact(self, estimate: Estimate) -> dict[str, object]:
        contact = contact_of(estimate, self._arm.config.arm)
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

    def _warn_of_rejected(self, update: EstimatorOutput) -> None:
        """Log each sensor whose measurement the gate has rejected."""
        for innovation in update.innovations:
            if not innovation.is_accepted:
                square, size = innovation.normalised_square, innovation.value.size
                is_beyond = square > chi_square_limit(self._arm.settings.rules.gate, size)
                why = 'contradicts the estimate by' if is_beyond else 'is still doubted, now with'
                words = f'it {why} a normalised square of {square:.3g} in {size} number(s)'
                self._diagnostics.log.add(f'{innovation.name} refused', words)


NAME = 'octo_arm_estimator'
# Both nodes publish an estimate for each measurement they receive.
EstimatorNode = partial(ServedNode, NAME, EstimatorServer)
ManagedEstimatorNode = partial(ManagedNode, NAME, EstimatorServer)
main = partial(run, NAME, EstimatorNode)
managed = partial(run, 'octo_arm_lifecycle_estimator', ManagedEstimatorNode)


if __name__ == '__main__':
    sys.exit(main())
