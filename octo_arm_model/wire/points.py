"""Points as messages carry them: midlines, tips, markers, clouds, and entries of any message."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, listed
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.wire.tensions import MAX_VALUES


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
    """Where a point or a pose of any kind is."""
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
    """The points of a PointCloud2, (3 n,)."""
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
