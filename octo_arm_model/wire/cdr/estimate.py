"""The messages of an estimate, as bytes: those of its backbone, and what it knows besides."""

from __future__ import annotations

from collections.abc import Sequence

from octo_arm_model.core.errors import ConfigError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.contact import NO_CONTACT, contact_of
from octo_arm_model.estimation.estimate import Estimate
from octo_arm_model.estimation.state.prediction import ArmModel
from octo_arm_model.wire.cdr.backbone import (
    BACKBONE_TOPICS,
    TENSION_ESTIMATES,
    BackboneWriter,
    tendon_tensions,
)
from octo_arm_model.wire.cdr.covariance import TOPIC as COVARIANCE
from octo_arm_model.wire.cdr.covariance import TYPE_NAME as COVARIANCE_TYPE
from octo_arm_model.wire.cdr.covariance import CovarianceWriter
from octo_arm_model.wire.cdr.layout import Layout, text_field
from octo_arm_model.wire.cdr.templates import Template

TIP_WRENCH, CONTACT, BIAS = 'tip_wrench/estimate', 'contact/estimate', 'tension_bias'
# Topics of an estimate and their types.
ESTIMATES: dict[str, str] = {
    **BACKBONE_TOPICS,
    TENSION_ESTIMATES: 'octo_arm_msgs/msg/TendonTensions',
    COVARIANCE: COVARIANCE_TYPE,
    TIP_WRENCH: 'geometry_msgs/msg/WrenchStamped',
    CONTACT: 'geometry_msgs/msg/WrenchStamped',
    BIAS: 'octo_arm_msgs/msg/TendonTensions',
}


class EstimateWriter:
    """Writes forces and biases of one arm, for one thread at a time, as `BackboneWriter` does."""

    def __init__(self, frame_id: str, tendon_names: Sequence[str]) -> None:
        """Lay out the messages.

        Raises:
            ConfigError: if a name is not one that UTF-8 can hold.
        """
        frame, self._tendons = text_field('frame_id', frame_id), len(tendon_names)
        wrench = Layout(frame)
        wrench.numbers(6)
        self._wrench = Template(wrench)
        self._bias = Template(tendon_tensions(frame, tendon_names))

    def wrench(self, values: FloatArray, sec: int, nanosec: int) -> bytes:
        """Message geometry_msgs/WrenchStamped: force [N] and moment [N m], (6,).

        Raises:
            ConfigError: if there are not six, or a ROS stamp cannot hold the time.
        """
        if values.shape != (6,):
            raise ConfigError(f'wrench is of shape {values.shape}, expected (6,)')
        return self._wrench.write(sec, nanosec, values)

    def tension_bias(self, values: FloatArray, sec: int, nanosec: int) -> bytes:
        """Message octo_arm_msgs/TendonTensions: what each load cell shows too much [N].

        Raises:
            ConfigError: if there is not one for each tendon, or no stamp can hold the time.
        """
        if values.shape != (self._tendons,):
            raise ConfigError(f'bias is of shape {values.shape}, expected ({self._tendons},)')
        return self._bias.write(sec, nanosec, values)


class EstimateMessages:
    """All messages of the estimates of one model of an arm."""

    def __init__(self, frame_id: str, model: ArmModel) -> None:
        """Lay them out for ``model`` in the frame ``frame_id``.

        Raises:
            ConfigError: if a name is not one that UTF-8 can hold.
        """
        grid, names = model.solver.grid, model.arm.tendon_names
        self._arm = model.arm
        self._shape = BackboneWriter(frame_id, model.solver.model, grid.s, grid.section, names)
        self._covariance = CovarianceWriter(frame_id, grid.s)
        self._others = EstimateWriter(frame_id, names)

    def write(self, estimate: Estimate, sec: int, nanosec: int) -> dict[str, bytes]:
        """Bytes by topic of `ESTIMATES`; those of a contact and of biases if they are estimated.

        Raises:
            ConfigError: if a ROS stamp cannot hold ``sec`` [s] and ``nanosec`` [ns].
        """
        shape, stamp = estimate.backbone, (sec, nanosec)
        pose, contact = estimate.pose_covariance, contact_of(estimate, self._arm)
        known = contact or NO_CONTACT
        messages = {
            'backbone/path': self._shape.path(shape, *stamp),
            'backbone/poses': self._shape.poses(shape, *stamp),
            'strains': self._shape.strains(shape, *stamp),
            'tip_pose': self._shape.tip_pose(shape, pose[-1], *stamp),
            TENSION_ESTIMATES: self._shape.tensions(estimate.tensions, *stamp),
            COVARIANCE: self._covariance.write(pose, known.s, known.covariance, *stamp),
        }
        if contact is not None:
            topic = TIP_WRENCH if contact.is_at_tip else CONTACT
            messages[topic] = self._others.wrench(contact.wrench, *stamp)
        if estimate.tension_bias.size:
            messages[BIAS] = self._others.tension_bias(estimate.tension_bias, *stamp)
        return messages
