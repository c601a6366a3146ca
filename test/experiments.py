"""Simulated experiments: recordings of an arm with known parameters, or of finite elements.

Shapes of finite elements are from validation/results.json, independent of all models. Bags are
written by rosbags.
"""

import dataclasses
import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from checkout import ROOT
from recordings import (
    START,
    Sample,
    header,
    make,
    message,
    point,
    pose,
    quaternion,
    tensions_data,
    text_sample,
    write_bag,
)
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from octo_arm_model import Config
from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.parameter_files import load_parameters, parameters_as_yaml
from octo_arm_model.experiment.midlines import resample
from octo_arm_model.experiment.observations import MeasuredShape, mean_shape
from octo_arm_model.experiment.recording import Recording
from octo_arm_model.experiment.steady_windows import Window

PARAMETERS = {**load_parameters('renda2012_prototype'), 'stations': 41}
ARM = Config.from_parameters(PARAMETERS).arm
HELD = (0.0, 0.53, 1.09, 2.0, 2.6, 3.06, 3.44, 3.95)  # steps of Table 1, and rest [N]
STEPS = HELD[1:]
TRUE = 1.23e5  # Young's modulus of the arms of `measured` [Pa]; the preset has 1.1e5
FAR = Pose((0.12, 0.05, 0.6), tuple(Rotation.from_rotvec([2.0, -0.9, 0.7]).as_quat()))


def one_tendon(tension: float) -> np.ndarray:
    return np.array([tension, 0.0, 0.0, 0.0])


PULLS = tuple(one_tendon(tension) for tension in STEPS[::2])


def circle(angle: float = 2.0, count: int = 41) -> np.ndarray:
    """Return points of an arc of 0.1 m in the plane z = 0, from the origin along x [m]."""
    angles = np.linspace(0.0, angle, count)
    return 0.1 * np.stack([np.sin(angles), 1.0 - np.cos(angles), 0.0 * angles], axis=1)


def midline(model: str, pulled: np.ndarray, count: int = 61, **changes: Any) -> np.ndarray:
    """Return the midline of the prototype after changes of parameters, at even distances."""
    values = {**PARAMETERS, **{name.replace('__', '.'): value for name, value in changes.items()}}
    config = Config.from_parameters({**values, 'model': model, 'stations': 101})
    shape = config.solver().solve(pulled.reshape(config.arm.tension_shape)).position
    return resample(shape, np.linspace(0.0, 1.0, count))


def shapes(
    lines: Sequence[np.ndarray],
    tensions: Sequence[np.ndarray],
    rng: np.random.Generator | None = None,
    noise: float = 0.0,
    frames: int = 5,
) -> list[MeasuredShape]:
    """Return steps with the mean of ``frames`` noisy copies of each of the true ``lines``."""
    rng = rng or np.random.default_rng(0)
    return [
        mean_shape(
            Window(0.0, 1.0, np.array(pulled), np.zeros(len(pulled))),
            [line + noise * rng.standard_normal(line.shape) for _ in range(frames)],
        )
        for line, pulled in zip(lines, tensions, strict=True)
    ]


def measured(
    model: str = 'closed_form',
    seed: int = 0,
    noise: float = 0.0,
    wrong: float = 0.0,
    pulls: tuple[np.ndarray, ...] = PULLS,
    count: int = 61,
    parameters: dict | None = None,
    **changes: float,
) -> list[MeasuredShape]:
    """Return steps of an arm of modulus `TRUE`; ``wrong`` is the tensions' stddev [N]."""
    rng = np.random.default_rng(seed)
    changes = {'material__youngs_modulus': TRUE, **(parameters or {}), **changes}
    pulled = [
        np.maximum(pull + wrong * rng.standard_normal() * (pull > 0.0), 0.0) for pull in pulls
    ]
    lines = [midline(model, pull, count, **changes) for pull in pulled]
    return shapes(lines, pulls, rng, noise, frames=8)


def tips(steps: list[MeasuredShape]) -> list[MeasuredShape]:
    """Return ``steps`` with only the tips as measured points."""
    return [dataclasses.replace(step, points=step.points[-1:]) for step in steps]


def staircase(
    held: Sequence[float] = HELD, hold: float = 3.0, ramp: float = 1.0, rate: float = 50.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and tensions of the first tendon [N], which are held with ramps between."""
    begins = np.arange(len(held)) * (hold + ramp)
    corners = np.stack([begins, begins + hold], axis=1).ravel()
    time = np.arange(0.0, corners[-1], 1.0 / rate)
    return time, np.interp(time, corners, np.repeat(held, 2))


def recording(
    model: str = 'closed_form',
    ahead: float = 0.0,
    held: Sequence[float] = HELD,
    rate: float = 10.0,
    **changes: Any,
) -> Recording:
    """Return a recording of a staircase; the camera's clock is ``ahead`` [s]."""
    time, pulled = staircase(held)
    tensions = np.zeros((time.size, 4))
    tensions[:, 0] = pulled
    times = np.arange(0.0, time[-1], 1.0 / rate)
    lines = {
        tension: midline(model, one_tendon(tension), 31, **changes)
        for tension in np.unique(np.interp(times, time, pulled))
    }
    frames = [FAR.from_base(lines[tension]) for tension in np.interp(times, time, pulled)]
    return Recording(PARAMETERS, time, tensions, times + ahead, tuple(frames), 'camera')


def path_sample(
    points: np.ndarray, stamp_ns: int, topic: str = '/camera/midline', frame: str = 'arm_base'
) -> Sample:
    """Return a nav_msgs/Path."""
    header_ = header(stamp_ns, frame)
    kind = 'geometry_msgs/msg/PoseStamped'
    poses = [make(kind, header=header_, pose=pose(point)) for point in points]
    return message(topic, 'nav_msgs/msg/Path', stamp_ns, header=header_, poses=poses)


def pose_sample(point: np.ndarray, stamp_ns: int) -> Sample:
    """Return a geometry_msgs/PoseStamped."""
    kind, header_ = 'geometry_msgs/msg/PoseStamped', header(stamp_ns, 'arm_base')
    return message('/tracker/tip', kind, stamp_ns, header=header_, pose=pose(point))


def nanoseconds(time: float) -> int:
    return START + round(time * 1e9)


def tension_sample(row: Any, stamp_ns: int) -> Sample:
    """Return a message with the tension of the first tendon, or of all."""
    kind = 'octo_arm_msgs/msg/TendonTensions'
    tensions = row if np.ndim(row) else one_tendon(row)
    data = tensions_data(kind, ARM.tendon_names, tensions, stamp_ns)
    return Sample('/tendon_tensions', kind, stamp_ns, data)


def tension_samples(time: np.ndarray, pulled: Sequence[Any]) -> list[Sample]:
    """Return messages with the tension of the first tendon, or of all."""
    return [tension_sample(row, nanoseconds(at)) for at, row in zip(time, pulled)]


def description(**changes: Any) -> Sample:
    """Return the description of the arm that the node publishes."""
    return text_sample('/arm_description', parameters_as_yaml({**PARAMETERS, **changes}))


def arm_file(folder: Path, parameters: Mapping[str, Any]) -> Path:
    """Write ``parameters`` to the file arm.yaml in a ``folder``."""
    path = folder / 'arm.yaml'
    path.write_text(parameters_as_yaml(parameters))
    return path


def bag_of(path: Path, samples: Sequence[Sample]) -> Path:
    """Write a bag of ``samples`` in order of receipt."""
    return write_bag(path, sorted(samples, key=lambda sample: sample.received_ns))


def staircase_bag(path: Path, held: Sequence[float], see: Callable[[float, int], Sample]) -> Path:
    """Write a bag of tensions held for 2 s each, with messages of a camera at 10 Hz.

    ``see`` returns the camera's message for a tension [N] and a stamp [ns].
    """
    time, pulled = staircase(held, hold=2.0)
    times = np.arange(0.0, time[-1], 0.1)
    samples = [description(), *tension_samples(time, pulled)]
    samples += [
        see(tension, nanoseconds(at))
        for at, tension in zip(times, np.interp(times, time, pulled))
        if tension in held
    ]
    return bag_of(path, samples)


# The prototype as finite elements have it --------------------------------------------------------


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


def pose_array(points: np.ndarray, stamp_ns: int, frame: str = 'arm_base') -> list[Sample]:
    kind = 'geometry_msgs/msg/PoseArray'
    poses = [pose(each) for each in points]
    header_ = header(stamp_ns, frame)
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
    change: Callable[[np.ndarray, int], np.ndarray] = lambda points, number: points,
    held: Sequence[float] = TENSIONS,
    read: Callable[[float, int], Sample] = tension_sample,
    **parameters: Any,
) -> Path:
    """Write a bag of held tensions and points at `MARKER_S`.

    ``see`` and ``read`` return the messages of points and of a tension [N] for a stamp [ns];
    ``change`` gets the frame's number.
    """
    time, pulled, times = staircase_of(held)
    samples = [description(model='exact', **parameters)]
    samples += [read(pull, nanoseconds(at)) for at, pull in zip(time, pulled.tolist())]
    for number, (at, tension) in enumerate(zip(times, np.interp(times, time, pulled))):
        samples += see(change(seen(float(tension), MARKER_S), number), nanoseconds(at))
    return bag_of(path, samples)
