"""Measurements other than tensions, and points: the types of their messages, and their reading.

A message is an object of the library that decoded it, as in `wire.tensions`.
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
from octo_arm_model.estimation.measurement import checked_numbers
from octo_arm_model.estimation.settings import EstimatorSettings
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
    """Return the points (n, 3) of a ``value`` of a message: points, poses or triples.

    ``names`` selects entries by their names, or by their numbers from 0 on unless numbers are the
    names, such as ids; a missing one is NaN.

    Raises:
        MeasurementError: if there are no points, or none of the names.
    """
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in 'fiu' or value.size % 3:
            raise MeasurementError(f'{value.size} values, expected x, y, z of each point')
        points, numbers = np.asarray(value, np.float64).reshape(-1, 3), {}
    else:
        entries = value if isinstance(value, (list, tuple)) else [value]
        points = np.array([_position(entry) for entry in entries], np.float64).reshape(-1, 3)
        numbers = {_name_of(entry): number for number, entry in enumerate(entries)}
    if not names:
        return points
    # Ids that are all the same are not set.
    if not any(map(str.isdigit, numbers)) or len(numbers) == 1 < len(points):
        numbers |= {str(number): number for number in range(len(points))}
    if not any(name in numbers for name in names):
        raise MeasurementError(f'none of {listed(names)}; there are {listed(list(numbers))}')
    hidden = np.full(3, np.nan)
    return np.array([points[numbers[name]] if name in numbers else hidden for name in names])


def _position(value: Any) -> tuple[float, float, float]:
    for _ in range(4):
        if all(hasattr(value, axis) for axis in 'xyz'):
            return value.x, value.y, value.z
        names = ('position', 'point', 'translation', 'pose', 'transform')
        value = next((getattr(value, name) for name in names if hasattr(value, name)), None)
    raise MeasurementError('it has entries that are neither points nor poses')


def _name_of(value: Any) -> str:
    """Return the name of an entry of a message; '' if it has none."""
    for name in ('name', 'marker_name', 'label', 'child_frame_id', 'id', 'marker_id'):
        if isinstance(text := getattr(value, name, None), (str, int, np.integer)):
            return str(text)
    return str(getattr(getattr(value, 'header', None), 'frame_id', ''))


def _cloud(message: Any) -> FloatArray:
    kinds = {7: 'f4', 8: 'f8'}  # FLOAT32, FLOAT64
    order = '>' if message.is_bigendian else '<'
    fields = {str(field.name): field for field in message.fields}
    if any(axis not in fields or fields[axis].datatype not in kinds for axis in 'xyz'):
        raise MeasurementError('its fields x, y, z are missing, or no floating point numbers')
    step, shape = int(message.point_step), (int(message.height), int(message.width))
    row, count = int(message.row_step) if shape[0] > 1 else shape[1] * step, math.prod(shape)
    formats = [order + kinds[fields[axis].datatype] for axis in 'xyz']
    offsets = [int(fields[axis].offset) for axis in 'xyz']
    ends = [offset + int(form[-1]) for offset, form in zip(offsets, formats)]
    data = np.asarray(message.data, np.uint8)
    fits = max(ends) <= step and shape[1] * step <= row and shape[0] * row <= data.size
    if not fits or count > MAX_VALUES:
        raise MeasurementError(
            f'{count} points of {step} bytes in rows of {row} do not fit into its {data.size}, '
            f'or are more than {MAX_VALUES}'
        )
    layout = np.dtype(
        {'names': ['x', 'y', 'z'], 'formats': formats, 'offsets': offsets, 'itemsize': step}
    )
    points = np.ndarray(shape, layout, data.tobytes(), 0, (row, step))
    return np.stack([points[axis] for axis in 'xyz'], axis=-1).astype(np.float64).ravel()


# The positions in a message, by its type: types of many points, and types of one.
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


# Asymmetry of a covariance, over its deviations, that rounding in single precision may cause.
_ASYMMETRY = 1e-6
# Bounds of the length of a quaternion that `TipPose` is left to check.
_SHORTEST, _LONGEST = 0.5, 2.0
# Pose of a frame in base_frame by its name and a stamp [ns].
PoseOf: TypeAlias = Callable[[str, int], Pose]


@dataclass(frozen=True)
class MeasuredArm:
    """The arm that is measured, with its sensors."""

    config: Config  #: the description of the arm
    settings: EstimatorSettings  #: the settings of its estimator, among them the noise of sensors
    #: pose of a frame in base_frame; None if measurements are in base_frame
    pose_of: PoseOf | None = None
    #: stamp of headers in which none is set [ns]; 0 if frames are not known then
    received_ns: int = 0

    def frame(self, header: Any) -> Pose:
        """Return the pose of the frame of a ``header`` in base_frame.

        Raises:
            MeasurementError: if the frame is not known.
        """
        frame = str(header.frame_id)
        if frame in ('', self.config.base_frame):
            return Pose()
        if self.pose_of is None:
            raise MeasurementError(
                f'its frame is {frame[:MAX_NAME]!r}, expected {self.config.base_frame!r}'
            )
        return self.pose_of(frame, Stamp.of(header.stamp).ns or self.received_ns)


@dataclass(frozen=True)
class MeasurementMessage:
    """A type of message that carries a measurement."""

    type_name: str  #: name of the type, such as 'geometry_msgs/msg/PoseArray'
    description: str  #: meaning of the message, in a few words
    parameters: str  #: prefix of the parameters of the estimator that describe its sensor
    #: returns the measurement in a message of an ``arm``, or raises OctoArmError
    read: Callable[..., measurements.Measurement]


def tensions_of(readings: FloatArray, arm: MeasuredArm) -> measurements.Tensions:
    """Return calibrated tensions for ``readings`` of load cells, of `Arm.tension_shape` [N].

    Readings below zero are kept, because for a slack tendon they are as probable as those above.

    Raises:
        MeasurementError: if a tension is not finite.
    """
    tensions = arm.config.load_cells.scale_and_offset(readings)
    return measurements.Tensions(tensions.ravel(), arm.settings.tension_stddev)


def displacements_of(message: Any, arm: MeasuredArm, field: str = '') -> measurements.Measurement:
    """Return the lengths reeled in that `read_displacements` finds in a ``message``.

    Raises:
        TensionError: if they cannot be read, or there are none.
    """
    lengths = read_displacements(message, arm.config.arm, arm.config.encoders, field)
    if not lengths:
        raise TensionError('it has no displacements')
    return measurements.TendonDisplacements(
        list(lengths.values()), arm.settings.given.displacement_stddev, tuple(lengths)
    )


def _tip_pose(message: Any, arm: MeasuredArm) -> measurements.Measurement:
    given, frame = arm.settings.given, arm.frame(message.header)
    p, orientation = message.pose.pose.position, message.pose.pose.orientation
    # Numbers are checked before the rotation, which would spread a wrong one to others.
    position = frame.to_base(checked_numbers('tip pose: position', [p.x, p.y, p.z]))
    sensor: FloatArray = np.array(message.pose.covariance, np.float64).reshape(6, 6)
    is_too_large = ~(np.abs(sensor) <= LARGEST**2)  # or NaN
    if is_too_large.any():
        i, j = np.argwhere(is_too_large)[0]
        raise MeasurementError(
            f'its covariance is {sensor[i, j]:g} at {i}, {j}, expected finite numbers of at most '
            f'{LARGEST**2:g}'
        )
    # `Measurement` checks only the sum with the errors of the model, which may be positive.
    if (np.diag(sensor) < 0.0).any():
        i = int(np.diag(sensor).argmin())
        raise MeasurementError(
            f'its covariance is {sensor[i, i]:g} at {i}, {i}, expected a positive definite one'
        )
    deviation = np.sqrt(np.diag(sensor))
    is_skew = np.abs(sensor - sensor.T) > _ASYMMETRY * np.outer(deviation, deviation)
    if is_skew.any():
        i, j = np.argwhere(is_skew)[0]
        raise MeasurementError(
            f'its covariance is {sensor[i, j]:g} at {i}, {j} and {sensor[j, i]:g} at {j}, {i}, '
            'expected a symmetric one'
        )
    for part, quantity in ((slice(0, 3), 'position'), (slice(3, 6), 'rotation')):
        if not sensor[part, part].any():
            sensor[part, part] = getattr(given, f'tip_{quantity}_stddev') ** 2 * np.eye(3)
    if not sensor[:3, :3].any():
        raise MeasurementError(
            'its covariance is zero and estimator.tip_position_stddev is 0: its noise is not known'
        )
    turn = np.kron(np.eye(2), frame.rotation.as_matrix())
    covariance = turn @ sensor @ turn.T
    covariance[:3, :3] += arm.config.uncertainty.model_position**2 * np.eye(3)
    if not sensor[3:, 3:].any():
        return measurements.TipPosition(position, covariance[:3, :3])
    covariance[3:, 3:] += arm.config.uncertainty.model_rotation**2 * np.eye(3)
    quaternion: FloatArray = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    length = math.hypot(*quaternion.tolist())
    if _SHORTEST < length < _LONGEST:
        # A product with a rotation keeps the length, which `TipPose` checks.
        quaternion = length * (frame.rotation * Rotation.from_quat(quaternion)).as_quat()
    return measurements.TipPose(position, quaternion, covariance)


def markers_of(
    message: Any, arm: MeasuredArm, field: str = '', names: Sequence[str] = ()
) -> measurements.Measurement:
    """Return the markers at estimator.marker_s in a PoseArray, or in a ``field`` of any message.

    ``names`` selects them, as in `points_of`.

    Raises:
        MeasurementError: if there are not as many as estimator.marker_s, or all are hidden.
        TensionError: if there is no such field.
    """
    given, frame = arm.settings.given, arm.frame(message.header)
    places = given.marker_s
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
    is_seen = ~np.isnan(points).any(axis=1)
    if not is_seen.any():
        raise MeasurementError('it shows no marker')
    s = np.array(places)[is_seen]
    stddev = float(np.hypot(given.marker_stddev, arm.config.uncertainty.model_position))
    visible = checked_numbers('markers: value', points[is_seen])
    return measurements.Markers(s, frame.to_base(visible), stddev)


def _base_wrench(message: Any, arm: MeasuredArm) -> measurements.Measurement:
    given, frame = arm.settings.given, arm.frame(message.header)
    stddevs = [getattr(given, f'base_{part}_stddev') for part in ('force', 'moment')]
    if not all(stddevs):
        raise MeasurementError(
            'estimator.base_force_stddev or base_moment_stddev is 0: its noise is not known'
        )
    force, moment = message.wrench.force, message.wrench.torque
    numbers = [force.x, force.y, force.z, moment.x, moment.y, moment.z]
    wrench = checked_numbers('base wrench: value', numbers)
    # This transforms from the frame of the sensor to base_frame, with moments about the base.
    turn = np.kron(np.eye(2), frame.rotation.as_matrix())
    lever = skew(np.subtract(frame.position, arm.config.base.position))
    turn[3:, :3] = lever @ turn[:3, :3]
    stddev = np.repeat(stddevs, 3)
    return measurements.BaseWrench(turn @ wrench, (turn * stddev**2) @ turn.T)


TIP_POSE, MARKERS, BASE_WRENCH = 'measured/tip_pose', 'measured/markers', 'measured/base_wrench'
# All measurements but tensions, for the node and the bag tools: one row each.
MEASUREMENT_TOPICS: dict[str, MeasurementMessage] = {
    DISPLACEMENTS: MeasurementMessage(
        DISPLACEMENT_TYPE,
        'lengths that winches have reeled in, as positions by tendon name [m]',
        'displacement_',
        displacements_of,
    ),
    TIP_POSE: MeasurementMessage(
        'geometry_msgs/msg/PoseWithCovarianceStamped',
        'pose of the tip, x axis along the tangent',
        'tip_',
        _tip_pose,
    ),
    MARKERS: MeasurementMessage(
        'geometry_msgs/msg/PoseArray',
        'points of the midline at given arc coordinates, NaN where hidden',
        'marker_',
        markers_of,
    ),
    BASE_WRENCH: MeasurementMessage(
        'geometry_msgs/msg/WrenchStamped',
        'sum of all external loads, by a sensor under the base',
        'base_',
        _base_wrench,
    ),
}
