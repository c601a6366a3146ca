"""The covariance of an estimated shape as octo_arm_msgs/BackboneCovariance, written and read."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.errors import ConfigError, MessageError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.wire.cdr.layout import Layout, text_field
from octo_arm_model.wire.cdr.templates import Template

COVARIANCE = 'backbone/covariance'
COVARIANCE_TYPE = 'octo_arm_msgs/msg/BackboneCovariance'
_PARTS = 6  # three of position or force, three of rotation or moment


class BackboneCovariance(NamedTuple):
    """Contents of the message.

    Attributes:
        s: arc coordinates of the stations [m], (stations,).
        pose: covariance of position [m] and rotation vector [rad] of each, (stations, 6, 6).
        contact_s: where the estimated wrench acts [m]; NaN for a current, or where there is none.
        contact: covariance of force [N] and moment [N m], (6, 6).
    """

    s: FloatArray
    pose: FloatArray
    contact_s: float
    contact: FloatArray


class CovarianceWriter:
    """Writes the covariances of estimates of one arm, for one thread at a time."""

    def __init__(self, frame_id: str, s: FloatArray) -> None:
        """Lay out the message for the stations ``s`` (stations,) [m].

        Raises:
            ConfigError: if UTF-8 cannot hold ``frame_id``.
        """
        self._shape = (s.size, _PARTS, _PARTS)
        layout = Layout(text_field('frame_id', frame_id))
        layout.constant_sequence(s.astype('<f8'))
        layout.sequence(s.size * _PARTS**2)
        layout.numbers(1)
        layout.numbers(_PARTS**2)
        self._template = Template(layout)

    def write(
        self, pose: FloatArray, contact_s: float, contact: FloatArray, sec: int, nanosec: int
    ) -> bytes:
        """The message; see `BackboneCovariance`.

        Raises:
            ConfigError: if the sizes are others, or a ROS stamp cannot hold ``sec`` [s] and
                ``nanosec`` [ns].
        """
        if pose.shape != self._shape or contact.shape != self._shape[1:]:
            raise ConfigError(
                f'covariances are of shape {pose.shape} and {contact.shape}, expected '
                f'{self._shape} and {self._shape[1:]}'
            )
        return self._template.write(
            sec, nanosec, pose.ravel(), np.array(contact_s), contact.ravel()
        )


def read_covariance(message: Any) -> BackboneCovariance:
    """Contents of a ``message``, an object of its type.

    Raises:
        MessageError: if it has not 36 numbers for each station.
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
