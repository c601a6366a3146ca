"""The messages of an estimate as bytes: backbone, contact, biases and covariances."""

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import MessageError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.estimation.estimate import NO_CONTACT, Contact, Estimate
from octo_arm_model.wire.backbone import BACKBONE_TOPICS, TENSION_ESTIMATES, tendon_tensions
from octo_arm_model.wire.cdr import Template, text_field

COVARIANCE = 'backbone/covariance'
COVARIANCE_TYPE = 'octo_arm_msgs/msg/BackboneCovariance'
_PARTS = 6  # three of position or force, three of rotation or moment


class BackboneCovariance(NamedTuple):
    """The contents of an octo_arm_msgs/BackboneCovariance."""

    s: FloatArray  #: arc coordinates of the stations [m], (stations,)
    pose: FloatArray  #: covariance of position [m] and rotation vector [rad], (stations, 6, 6)
    #: arc coordinate of the estimated wrench [m]; NaN for a current, or no wrench
    contact_s: float
    contact: FloatArray  #: covariance of force [N] and moment [N m], (6, 6)


def read_covariance(message: Any) -> BackboneCovariance:
    """Return the contents of a decoded ``message``.

    Raises:
        MessageError: if it does not have 36 numbers for each station.
    """
    s, pose = np.asarray(message.s, np.float64), np.asarray(message.pose, np.float64)
    if pose.size != s.size * _PARTS**2:
        raise MessageError(
            f'pose has {pose.size} numbers, expected {_PARTS**2} for each of {s.size} stations'
        )
    contact = np.asarray(message.contact, np.float64).reshape(_PARTS, _PARTS)
    return BackboneCovariance(
        s, pose.reshape(-1, _PARTS, _PARTS), float(message.contact_s), contact
    )


TIP_WRENCH, CONTACT, BIAS = 'tip_wrench/estimate', 'contact/estimate', 'tension_bias'
# Topics of an estimate besides those of its backbone, and all topics, with their types.
BESIDES: dict[str, str] = {
    COVARIANCE: COVARIANCE_TYPE,
    TIP_WRENCH: 'geometry_msgs/msg/WrenchStamped',
    CONTACT: 'geometry_msgs/msg/WrenchStamped',
    BIAS: 'octo_arm_msgs/msg/TendonTensions',
}
ESTIMATES: dict[str, str] = {
    **BACKBONE_TOPICS,
    TENSION_ESTIMATES: 'octo_arm_msgs/msg/TendonTensions',
    **BESIDES,
}


class EstimateWriter:
    """Writes contacts, biases and covariances of one arm, for one thread at a time."""

    def __init__(self, frame_id: str, arm: Arm, s: FloatArray) -> None:
        """Lay out the messages of ``arm`` with the stations ``s`` (stations,) [m].

        Raises:
            ConfigError: if UTF-8 cannot hold a name.
        """
        frame = text_field('frame_id', frame_id)
        covariance, wrench = Template(frame), Template(frame)
        covariance.count(s.size)
        covariance.constants(s.astype('<f8'))
        covariance.sequence(s.size * _PARTS**2)
        covariance.numbers(1)
        covariance.numbers(_PARTS, _PARTS)
        wrench.numbers(_PARTS)
        self._covariance, self._wrench = covariance, wrench
        self._bias = tendon_tensions(frame, arm.tendon_names)

    def write(
        self,
        estimate: Estimate,
        contact: Contact | None,
        stamp: tuple[int, int],
        without: Collection[str] = (),
    ) -> dict[str, bytes]:
        """Return the messages by topic of `BESIDES`; contact and biases only if estimated.

        ``contact`` is that of the ``estimate``, ``stamp`` is in [s] and [ns], and the topics
        ``without`` are left out.

        Raises:
            ConfigError: if a ROS stamp cannot hold the time.
        """
        messages, force = {}, contact or NO_CONTACT
        topic = TIP_WRENCH if force.is_at_tip else CONTACT
        if contact is not None and topic not in without:
            messages[topic] = self._wrench.write(*stamp, contact.wrench)
        if COVARIANCE not in without:
            parts = estimate.pose_covariance.ravel(), np.array(force.s), force.covariance
            messages[COVARIANCE] = self._covariance.write(*stamp, *parts)
        if estimate.tension_bias.size and BIAS not in without:
            messages[BIAS] = self._bias.write(*stamp, estimate.tension_bias)
        return messages
