"""The publishers of an estimate: those of a backbone, and what is known of it besides."""

from __future__ import annotations

from geometry_msgs.msg import WrenchStamped
from octo_arm_msgs.msg import BackboneCovariance, TendonTensions
from rclpy.node import Node

from octo_arm_model.config.config import Config
from octo_arm_model.core.solver import Solver
from octo_arm_model.estimation.contact import NO_CONTACT, contact_of
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.ros.node.outputs.backbone_publishers import BackbonePublishers
from octo_arm_model.wire.cdr.covariance import TOPIC as COVARIANCE
from octo_arm_model.wire.cdr.covariance import CovarianceWriter
from octo_arm_model.wire.cdr.estimate import BIAS, CONTACT, TIP_WRENCH, EstimateWriter
from octo_arm_model.wire.cdr.uncertainty import UncertaintyMarkersWriter
from octo_arm_model.wire.stamp import Stamp


class EstimatePublishers(BackbonePublishers):
    """Publishes estimates on all topics of one node."""

    def __init__(self, node: Node) -> None:
        """Create the publishers on ``node``; raises ConfigError as `BackbonePublishers`."""
        super().__init__(node)
        self._covariance = self._open(BackboneCovariance, COVARIANCE)
        self._tip_wrench = self._open(WrenchStamped, TIP_WRENCH)
        self._contact = self._open(WrenchStamped, CONTACT)
        self._bias = self._open(TendonTensions, BIAS)

    def describe(self, solver: Solver, config: Config) -> None:
        """Prepare the messages for estimates of ``solver``, with the frames of ``config``."""
        if solver is self._solver:
            return
        super().describe(solver, config)
        self._tube = UncertaintyMarkersWriter(config.arm, solver.grid.s, config.base_frame)
        self._covariances = CovarianceWriter(config.base_frame, solver.grid.s)
        self._estimate_writer = EstimateWriter(config.base_frame, config.arm.tendon_names)

    def publish_estimate(self, estimate: Estimate, stamp: Stamp) -> None:
        """Publish an ``estimate`` of the arm that was described."""
        assert self._solver is not None
        backbone, covariance = estimate.backbone, estimate.pose_covariance
        contact = contact_of(estimate, self._solver.arm)
        known = contact or NO_CONTACT

        def markers() -> bytes:
            return self._tube.write(
                backbone.position, backbone.quaternion, covariance[:, :3, :3],
                known.s, known.wrench[:3], known.covariance[:3, :3], *stamp,
            )  # fmt: skip

        self.publish(backbone, covariance[-1], stamp, markers)
        self.publish_tensions(backbone, stamp)
        if contact is not None:
            publisher = self._tip_wrench if contact.is_at_tip else self._contact
            publisher.publish(self._estimate_writer.wrench(contact.wrench, *stamp))
        if self._covariance.get_subscription_count():
            data = self._covariances.write(covariance, known.s, known.covariance, *stamp)
            self._covariance.publish(data)
        if estimate.tension_bias.size:
            bias = self._estimate_writer.tension_bias(estimate.tension_bias, *stamp)
            self._bias.publish(bias)
