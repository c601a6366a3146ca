"""What the node of an arm publishes, read from its messages; every number is checked."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MessageError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import LARGEST
from octo_arm_model.wire.cdr.backbone import read_poses
from octo_arm_model.wire.cdr.covariance import BackboneCovariance, read_covariance

_UNIT = 1e-3  # by which the length of a quaternion may be off


class PublishedShape(NamedTuple):
    """One shape as the node published it.

    Attributes:
        position: of the stations in `base_frame`, base first, (stations, 3) [m].
        quaternion: their orientation x, y, z, w, (stations, 4).
        stamp: stamp of the tensions it was solved for [s].
        received: time of arrival [s].
    """

    position: FloatArray
    quaternion: FloatArray
    stamp: float
    received: float


class PublishedStrains(NamedTuple):
    """Strains as the node published them, each (stations,); see `Backbone`."""

    model: str
    s: FloatArray
    tau: FloatArray
    xi: FloatArray
    k: FloatArray
    q: FloatArray


def shape_of(data: bytes, received: float) -> PublishedShape | None:
    """Shape in the serialised poses ``data``, which arrived at ``received`` [s].

    None where it is one pose at most, which is no backbone.

    Raises:
        MessageError: if a number is not finite, or a quaternion not of length 1.
    """
    stamp, poses = read_poses(data)
    if len(poses) < 2:
        return None
    _finite('poses', poses)
    if np.abs(np.linalg.norm(poses[:, 3:], axis=1) - 1.0).max() > _UNIT:
        raise MessageError('poses have quaternions that are not of length 1')
    return PublishedShape(poses[:, :3], poses[:, 3:], stamp, received)


def strains_of(message: Any) -> PublishedStrains:
    """Strains in an ``octo_arm_msgs/msg/SectionStrains``.

    Raises:
        MessageError: if they differ in number, or one cannot be that of an arm.
    """
    names, count = PublishedStrains._fields[1:], len(message.s)
    parts = [_finite(name, getattr(message, name), count) for name in names]
    strains = PublishedStrains(message.model, *parts)
    if (strains.q <= -1.0).any():
        raise MessageError('q compresses the arm to nothing')
    return strains


def covariance_of(message: Any) -> BackboneCovariance:
    """Covariance in an ``octo_arm_msgs/msg/BackboneCovariance``.

    Raises:
        MessageError: if it cannot be one.
    """
    found = read_covariance(message)
    _variances('pose', _finite('pose', found.pose))
    _variances('contact', _finite('contact', found.contact))
    # NaN is that of what acts all along.
    if np.isinf(found.contact_s):
        raise MessageError('contact_s is infinite')
    return found


def force_of(message: Any) -> FloatArray:
    """Force in a ``geometry_msgs/msg/WrenchStamped`` (3,) [N]; MessageError if not finite."""
    force = message.wrench.force
    return _finite('force', [force.x, force.y, force.z])


def tip_deviation_of(message: Any) -> FloatArray:
    """Standard deviation of the position of a ``geometry_msgs/msg/PoseWithCovarianceStamped``.

    Along x, y and z [m], (3,).

    Raises:
        MessageError: if it has none.
    """
    covariance = _finite('covariance', message.pose.covariance).reshape(6, 6)
    return np.sqrt(_variances('covariance', covariance)[:3])


def _finite(name: str, values: Any, size: int | None = None) -> FloatArray:
    """``values`` of a message, as many as ``size`` if given.

    Raises:
        MessageError: if they are not so many, or one is not finite or beyond `LARGEST`.
    """
    array = np.asarray(values, np.float64)
    if size is not None and array.size != size:
        raise MessageError(f'{name} has {array.size} numbers, expected {size}')
    if not (np.abs(array) <= LARGEST).all():
        raise MessageError(f'{name} holds numbers that are not finite, or beyond {LARGEST:g}')
    return array


def _variances(name: str, covariance: FloatArray) -> FloatArray:
    """Diagonals (..., n) of a ``covariance`` (..., n, n); MessageError if one is below zero."""
    found = np.diagonal(covariance, axis1=-2, axis2=-1)
    if (found < 0.0).any():
        raise MessageError(f'{name} has variances below zero')
    return found
