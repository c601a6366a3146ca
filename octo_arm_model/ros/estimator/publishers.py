"""The publishers of an estimate: those of a backbone, and what is known of it besides."""

from __future__ import annotations

from rclpy.node import Node

from octo_arm_model.config.config import Config
from octo_arm_model.estimation.contact import NO_CONTACT, contact_of
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.messages import message_class
from octo_arm_model.ros.node.outputs import BackbonePublishers
from octo_arm_model.wire.estimate import BESIDES, EstimateWriter
from octo_arm_model.wire.markers import UncertaintyMarkersWriter
from octo_arm_model.wire.stamp import Stamp


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
                backbone.position, backbone.quaternion, estimate.pose_covariance[:, :3, :3],
                (known.s, known.wrench[:3], known.covariance[:3, :3]), *stamp,
            )  # fmt: skip

        of_tip = estimate.pose_covariance[-1] if self.is_tip_heard else None
        self.publish(backbone, of_tip, stamp, markers)
        self.publish_tensions(backbone, stamp)
        unheard = tuple(topic for topic, output in self._besides.items() if not output.is_heard)
        messages = self._estimate_writer.write(estimate, contact, stamp, unheard)
        for topic, data in messages.items():
            self._besides[topic].publish(data)
