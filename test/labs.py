"""Simulated laboratories for tests: bags of the prototype with shapes of finite elements.

The shapes are from validation/results.json, independent of all models. Bags are written by
rosbags.
"""

import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from checkout import ROOT
from experiments import ARM, bag_of, description, nanoseconds, staircase, tension_samples
from recordings import Sample, header, make, message, point, pose, quaternion
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

_CASE = json.loads((ROOT / 'validation' / 'results.json').read_text())['cases']['prototype']
TENSIONS = tuple(tension for (tension,) in _CASE['tensions_N'])
# The elements use the axes of the arm's base: n is -y and b is -z.
_SHAPES = 1e-3 * np.array(_CASE['midlines_mm']) * [1.0, -1.0, -1.0]
# Error of the model exact by tension [% of L].
TIP_ERRORS = tuple(_CASE['tip_error_percent']['exact'])
_DISC = 1e-3 * _CASE['disc_mm']
HOLD, RAMP = 2.0, 1.0
MARKER_S = (0.0, 0.09, 0.18, 0.27)


def _planes() -> np.ndarray:
    """Arc coordinates of the points of the shapes: layers of one radius, then a disc."""
    fine = np.linspace(0.0, ARM.length, 2001)
    in_radii = cumulative_trapezoid(1.0 / ARM.body.radius(fine), fine, initial=0.0)
    last = np.interp(ARM.length - _DISC, fine, in_radii)
    layers = np.interp(np.linspace(0.0, last, _SHAPES.shape[1] - 1), in_radii, fine)
    return np.append(layers[:-1], [ARM.length - _DISC, ARM.length])


STATIONS = _planes()
_STEP = {tension: CubicSpline(STATIONS, shape) for tension, shape in zip(TENSIONS, _SHAPES)}


def seen(tension: float, s: Sequence[float]) -> np.ndarray:
    """Return points (m, 3) [m] at ``s`` [m] of the arm with one of `TENSIONS`."""
    return np.asarray(_STEP[tension](np.array(s)))


def at_any(tension: float, s: Sequence[float]) -> np.ndarray:
    """Return points at ``s`` [m] for any tension in the range of `TENSIONS`, by interpolation."""
    shape = CubicSpline(TENSIONS, _SHAPES)(tension)
    return np.asarray(CubicSpline(STATIONS, shape)(np.array(s)))


def transform(
    stamp_ns: int,
    child: str,
    at: np.ndarray,
    parent: str = 'arm_base',
    turned: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
) -> Any:
    """Return the transform from ``child`` to ``parent`` with the quaternion ``turned``."""
    return make(
        'geometry_msgs/msg/TransformStamped',
        header=header(stamp_ns, parent),
        child_frame_id=child,
        transform=make(
            'geometry_msgs/msg/Transform',
            translation=point(at, 'Vector3'),
            rotation=quaternion(turned),
        ),
    )


def tf_message(transforms: Sequence[Any], stamp_ns: int, topic: str = '/tf') -> Sample:
    """Return a message of TF."""
    return message(topic, 'tf2_msgs/msg/TFMessage', stamp_ns, transforms=list(transforms))


def pose_array(points: np.ndarray, stamp_ns: int) -> list[Sample]:
    kind = 'geometry_msgs/msg/PoseArray'
    poses = [pose(each) for each in points]
    header_ = header(stamp_ns, 'arm_base')
    return [message('/mocap/markers', kind, stamp_ns, header=header_, poses=poses)]


def one_topic_each(points: np.ndarray, stamp_ns: int, kind: str = 'PoseStamped') -> list[Sample]:
    header_ = header(stamp_ns, 'arm_base')
    field, make_field = {'PoseStamped': ('pose', pose), 'PointStamped': ('point', point)}[kind]
    return [
        message(
            f'/mocap/m{number}',
            f'geometry_msgs/msg/{kind}',
            stamp_ns,
            header=header_,
            **{field: make_field(each)},
        )
        for number, each in enumerate(points)
    ]


def tf(points: np.ndarray, stamp_ns: int) -> list[Sample]:
    frames = [transform(stamp_ns, f'm{n}', each) for n, each in enumerate(points)]
    frames.append(transform(stamp_ns, 'another body', np.ones(3)))
    return [tf_message(frames, stamp_ns)]


WAYS: dict[str, tuple[Callable[[np.ndarray, int], list[Sample]], list[str]]] = {
    'pose array': (pose_array, []),
    'poses': (one_topic_each, ['--midlines', *(f'/mocap/m{n}' for n in range(4))]),
    'points': (
        partial(one_topic_each, kind='PointStamped'),
        ['--midlines', *(f'/mocap/m{n}' for n in range(4))],
    ),
    'tf': (tf, ['--marker-frames', 'm0', 'm1', 'm2', 'm3']),
}


def staircase_of(held: Sequence[float] = TENSIONS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s], tensions of the first tendon [N], and times of frames at rest [s]."""
    time, pulled = staircase(held, hold=HOLD, ramp=RAMP, rate=20.0)
    at_rest = [n * (HOLD + RAMP) + np.arange(0.8, HOLD, 0.1) for n in range(len(held))]
    return time, pulled, np.concatenate(at_rest)


def marker_bag(
    path: Path,
    see: Callable[[np.ndarray, int], list[Sample]] = pose_array,
    s: Sequence[float] = MARKER_S,
    change: Callable[[np.ndarray, int], np.ndarray] = lambda points, number: points,
    held: Sequence[float] = TENSIONS,
) -> Path:
    """Write a bag of held tensions and points at ``s``; ``change`` gets the frame's number."""
    time, pulled, times = staircase_of(held)
    samples = [description(model='exact'), *tension_samples(time, pulled)]
    for number, (at, tension) in enumerate(zip(times, np.interp(times, time, pulled))):
        samples += see(change(seen(float(tension), s), number), nanoseconds(at))
    return bag_of(path, samples)
