"""Measurements besides tensions, and points: the types of their messages, and how each is read.

A message is an object of whichever library decoded it, as in `wire.tensions`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.errors import MeasurementError, TensionError, listed
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_NAME
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.validation import LARGEST
from octo_arm_model.config.config import Config
from octo_arm_model.estimation import measurements
from octo_arm_model.estimation.base_wrench import BaseWrench
from octo_arm_model.estimation.measurement import magnitudes
from octo_arm_model.estimation.settings import SensorNoise
from octo_arm_model.rod.rotations import skew
from octo_arm_model.wire.messages import Stamp
from octo_arm_model.wire.tensions import (
    DISPLACEMENT_TYPE,
    DISPLACEMENTS,
    MAX_VALUES,
    field_of,
    read_displacements,
)


def points_of(value: Any, names: Sequence[str] = ()) -> FloatArray:
    """Points (n, 3) of a ``value`` out of a message: one or many points, poses or triples.

    Of those of ``names``, or their numbers from 0 on, in their order; NaN for those not there.

    Raises:
        MeasurementError: if it has no points, or none of the names.
    """
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in 'fiu' or value.size % 3:
            raise MeasurementError(f'{value.size} values, expected x, y, z of each point')
        points, known = np.asarray(value, np.float64).reshape(-1, 3), {}
    else:
        entries = value if isinstance(value, (list, tuple)) else [value]
        points = np.array([_position(one) for one in entries], np.float64).reshape(-1, 3)
        known = {_name_of(one): number for number, one in enumerate(entries)}
    if not names:
        return points
    known = {str(number): number for number in range(len(points))} | known
    if not any(name in known for name in names):
        raise MeasurementError(f'none of {listed(names)}; there are {listed(list(known))}')
    nothing = np.full(3, np.nan)
    return np.array([points[known[name]] if name in known else nothing for name in names])


def _position(value: Any) -> tuple[float, float, float]:
    for _ in range(4):
        if all(hasattr(value, axis) for axis in 'xyz'):
            return value.x, value.y, value.z
        names = ('position', 'point', 'translation', 'pose', 'transform')
        value = next((getattr(value, one) for one in names if hasattr(value, one)), None)
    raise MeasurementError('it has entries that are neither points nor poses')


def _name_of(value: Any) -> str:
    """What an entry of a message is called; '' if nothing says it."""
    for name in ('name', 'marker_name', 'label', 'child_frame_id', 'id', 'marker_id'):
        if isinstance(found := getattr(value, name, None), (str, int, np.integer)):
            return str(found)
    return str(getattr(getattr(value, 'header', None), 'frame_id', ''))


def _cloud(message: Any) -> FloatArray:
    kinds = {7: 'f4', 8: 'f8'}  # FLOAT32, FLOAT64
    order = '>' if message.is_bigendian else '<'
    fields = {str(one.name): one for one in message.fields}
    if any(axis not in fields or fields[axis].datatype not in kinds for axis in 'xyz'):
        raise MeasurementError('its fields x, y, z are missing, or no floating point numbers')
    step, count = int(message.point_step), int(message.width) * int(message.height)
    formats = [order + kinds[fields[axis].datatype] for axis in 'xyz']
    offsets = [int(fields[axis].offset) for axis in 'xyz']
    ends = [offset + int(form[-1]) for offset, form in zip(offsets, formats)]
    data = np.asarray(message.data, np.uint8)
    if max(ends) > step or count * step > data.size or count > MAX_VALUES:
        raise MeasurementError(
            f'{count} points of {step} bytes each do not fit into its {data.size}, or are more '
            f'than {MAX_VALUES}'
        )
    layout = np.dtype(
        {'names': ['x', 'y', 'z'], 'formats': formats, 'offsets': offsets, 'itemsize': step}
    )
    rows = np.frombuffer(data.tobytes(), layout, count)
    return np.stack([rows[axis] for axis in 'xyz'], axis=1).astype(np.float64).ravel()


# The positions in a message, by type: of many points, and of one.
_MANY: dict[str, Callable[[Any], Any]] = {
    'nav_msgs/msg/Path': lambda message: message.poses,
    'geometry_msgs/msg/PoseArray': lambda message: message.poses,
    'sensor_msgs/msg/PointCloud2': _cloud,
}
_ONE: dict[str, Callable[[Any], Any]] = {
    'geometry_msgs/msg/PoseStamped': lambda message: message.pose,
    'geometry_msgs/msg/PoseWithCovarianceStamped': lambda message: message.pose.pose,
    'geometry_msgs/msg/PointStamped': lambda message: message.point,
    'geometry_msgs/msg/TransformStamped': lambda message: message.transform,
}
POSITIONS = {**_MANY, **_ONE}
MIDLINES, ONE = tuple(_MANY), tuple(_ONE)


# Rounding, in single precision, by which a covariance may not be symmetric, of its deviations.
_ASYMMETRY = 1e-6
# Of a quaternion that `TipPose` may take for one.
_SHORTEST, _LONGEST = 0.5, 2.0
# Pose of a frame in base_frame by its name and a stamp [ns].
PoseOf: TypeAlias = Callable[[str, int], Pose]


@dataclass(frozen=True)
class MeasuredArm:
    """The arm that is measured.

    Attributes:
        config: its description.
        noise: of the sensors.
        pose_of: pose of a frame in base_frame; None where measurements are in base_frame.
    """

    config: Config
    noise: SensorNoise
    pose_of: PoseOf | None = None

    def frame(self, header: Any) -> tuple[Rotation, FloatArray]:
        """Rotation and origin (3,) [m], in base_frame, of the frame of a message's ``header``.

        Raises:
            MeasurementError: if it is not known.
        """
        frame = str(header.frame_id)
        if frame in ('', self.config.base_frame):
            return Rotation.identity(), np.zeros(3)
        if self.pose_of is None:
            raise MeasurementError(
                f'its frame is {frame[:MAX_NAME]!r}, expected {self.config.base_frame!r}'
            )
        pose = self.pose_of(frame, Stamp.of(header.stamp).ns)
        return Rotation.from_quat(np.array(pose.quaternion)), np.array(pose.position)


@dataclass(frozen=True)
class MeasurementMessage:
    """A type of message that something measured comes in.

    Attributes:
        type_name: its name, such as 'geometry_msgs/msg/PoseArray'.
        description: what it says, for the manual.
        read: what a message measures of an ``arm``; raises OctoArmError where that is nothing.
    """

    type_name: str
    description: str
    read: Callable[..., measurements.Measurement]


def tensions_of(readings: FloatArray, arm: MeasuredArm) -> measurements.Tensions:
    """Tensions for ``readings`` of the load cells, of `Arm.tension_shape` [N], calibrated.

    Readings below zero stay as they are: of a slack tendon they are as probable as those above.

    Raises:
        MeasurementError: if a tension is not finite.
    """
    tensions = arm.config.load_cells.scale_and_offset(readings)
    return measurements.Tensions(tensions.ravel(), arm.noise.tension)


def displacements_of(message: Any, arm: MeasuredArm, field: str = '') -> measurements.Measurement:
    """Lengths reeled in, see `read_displacements`.

    Raises:
        TensionError: as that, or if there are none.
    """
    found = read_displacements(message, arm.config.arm, arm.config.encoders, field)
    if not found:
        raise TensionError('it has no displacements')
    return measurements.TendonDisplacements(
        list(found.values()), arm.noise.given.displacement_stddev, tuple(found)
    )


def _tip_pose(message: Any, arm: MeasuredArm) -> measurements.Measurement:
    noise, (rotation, origin) = arm.noise, arm.frame(message.header)
    at, turned = message.pose.pose.position, message.pose.pose.orientation
    # All is checked as it came: a rotation makes of one wrong number several.
    position = rotation.apply(magnitudes('tip pose: position', [at.x, at.y, at.z])) + origin
    own: FloatArray = np.array(message.pose.covariance, np.float64).reshape(6, 6)
    wrong = ~(np.abs(own) <= LARGEST**2)  # what is no number, too
    if wrong.any():
        i, j = np.argwhere(wrong)[0]
        raise MeasurementError(
            f'its covariance is {own[i, j]:g} at {i}, {j}, expected finite numbers of at most '
            f'{LARGEST**2:g}'
        )
    # Of these `Measurement` sees the sum with the errors of the model, which may be positive.
    if (np.diag(own) < 0.0).any():
        i = int(np.diag(own).argmin())
        raise MeasurementError(
            f'its covariance is {own[i, i]:g} at {i}, {i}, expected a positive definite one'
        )
    deviation = np.sqrt(np.diag(own))
    skew = np.abs(own - own.T) > _ASYMMETRY * np.outer(deviation, deviation)
    if skew.any():
        i, j = np.argwhere(skew)[0]
        raise MeasurementError(
            f'its covariance is {own[i, j]:g} at {i}, {j} and {own[j, i]:g} at {j}, {i}, '
            'expected a symmetric one'
        )
    for part, what in ((slice(0, 3), 'position'), (slice(3, 6), 'rotation')):
        if not own[part, part].any():
            own[part, part] = getattr(noise.given, f'tip_{what}_stddev') ** 2 * np.eye(3)
    if not own[:3, :3].any():
        raise MeasurementError(
            'its covariance is zero and estimator.tip_position_stddev is 0: its noise is not known'
        )
    turn = np.kron(np.eye(2), rotation.as_matrix())
    covariance = turn @ own @ turn.T
    covariance[:3, :3] += noise.model_position**2 * np.eye(3)
    if not own[3:, 3:].any():
        return measurements.TipPosition(position, covariance[:3, :3])
    covariance[3:, 3:] += noise.model_rotation**2 * np.eye(3)
    quaternion: FloatArray = np.array([turned.x, turned.y, turned.z, turned.w])
    length = math.hypot(*quaternion.tolist())
    if _SHORTEST < length < _LONGEST:
        # `TipPose` checks the length, which a product with a rotation keeps.
        quaternion = length * (rotation * Rotation.from_quat(quaternion)).as_quat()
    return measurements.TipPose(position, quaternion, covariance)


def markers_of(
    message: Any, arm: MeasuredArm, field: str = '', names: Sequence[str] = ()
) -> measurements.Measurement:
    """Markers at estimator.marker_s in a PoseArray, or in the ``field`` of any message.

    Those of ``names``, see `points_of`.

    Raises:
        MeasurementError: if there are others, or none is seen.
        TensionError: if there is no such field.
    """
    noise, (rotation, origin) = arm.noise, arm.frame(message.header)
    places = noise.given.marker_s
    if not places:
        raise MeasurementError(
            'estimator.marker_s is empty: where the markers are on the arm is not known'
        )
    points = points_of(field_of(message, field) if field else message.poses, names)
    if len(points) != len(places):
        raise MeasurementError(
            f'it has {len(points)} marker(s), expected {len(places)}, one for each of '
            'estimator.marker_s'
        )
    if np.isinf(points).any():
        raise MeasurementError('a marker is infinite, expected finite numbers, or NaN if hidden')
    seen = ~np.isnan(points).any(axis=1)
    if not seen.any():
        raise MeasurementError('it shows no marker')
    s = np.array(places)[seen]
    stddev = float(np.hypot(noise.given.marker_stddev, noise.model_position))
    shown = magnitudes('markers: value', points[seen])
    return measurements.Markers(s, rotation.apply(shown) + origin, stddev)


def _base_wrench(message: Any, arm: MeasuredArm) -> measurements.Measurement:
    noise, (rotation, origin) = arm.noise, arm.frame(message.header)
    stddevs = [getattr(noise.given, f'base_{part}_stddev') for part in ('force', 'moment')]
    if not all(stddevs):
        raise MeasurementError(
            'estimator.base_force_stddev or base_moment_stddev is 0: its noise is not known'
        )
    force, moment = message.wrench.force, message.wrench.torque
    numbers = [force.x, force.y, force.z, moment.x, moment.y, moment.z]
    wrench = magnitudes('base wrench: value', numbers)
    # From the axes and the origin of its frame to those of base_frame, about the base.
    turn = np.kron(np.eye(2), rotation.as_matrix())
    away = skew(origin - np.array(arm.config.base.position))
    turn[3:, :3] = away @ rotation.as_matrix()
    stddev = np.repeat(stddevs, 3)
    return BaseWrench(turn @ wrench, (turn * stddev**2) @ turn.T)


TIP_POSE, MARKERS, BASE_WRENCH = 'measured/tip_pose', 'measured/markers', 'measured/base_wrench'
# Everything measured but tensions, for the node, the bag tools and the manual: one row adds one.
MEASUREMENT_TOPICS: dict[str, MeasurementMessage] = {
    DISPLACEMENTS: MeasurementMessage(
        DISPLACEMENT_TYPE,
        'lengths reeled in by the winches, as positions by tendon name [m]',
        displacements_of,
    ),
    TIP_POSE: MeasurementMessage(
        'geometry_msgs/msg/PoseWithCovarianceStamped',
        'pose of the tip, x axis along the arm; the position alone where the covariance of the '
        'rotation is zero',
        _tip_pose,
    ),
    MARKERS: MeasurementMessage(
        'geometry_msgs/msg/PoseArray',
        'points of the midline at `estimator.marker_s`, NaN where hidden',
        markers_of,
    ),
    BASE_WRENCH: MeasurementMessage(
        'geometry_msgs/msg/WrenchStamped',
        'force and moment of all external loads as a sensor under the base feels them',
        _base_wrench,
    ),
}
