"""Simulated experiments for tests: recordings and shapes of an arm with known parameters."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from recordings import (
    START,
    Sample,
    header,
    make,
    message,
    pose,
    tensions_data,
    text_sample,
    write_bag,
)

from octo_arm_model import Config
from octo_arm_model.config.parameter_files import load_parameters, parameters_as_yaml
from octo_arm_model.experiment.camera import Alignment
from octo_arm_model.experiment.midlines import resample
from octo_arm_model.experiment.observations import MeasuredShape, mean_shape
from octo_arm_model.experiment.recording import Recording
from octo_arm_model.experiment.steady_windows import Window

PARAMETERS = {**load_parameters('renda2012_prototype'), 'stations': 41}
ARM = Config.from_parameters(PARAMETERS).arm
HELD = (0.0, 0.53, 1.09, 2.0, 2.6, 3.06, 3.44, 3.95)  # steps of Table 1, and rest [N]
STEPS = HELD[1:]
TRUE = 1.23e5  # Young's modulus of the arms of `measured` [Pa]; the preset has 1.1e5
FAR = Alignment(np.array([2.0, -0.9, 0.7]), np.array([0.12, 0.05, 0.6]))


def one_tendon(tension: float) -> np.ndarray:
    return np.array([tension, 0.0, 0.0, 0.0])


PULLS = tuple(one_tendon(tension) for tension in STEPS[::2])


def circle(radius: float = 0.1, angle: float = 2.0, count: int = 41) -> np.ndarray:
    """Return points of an arc in the plane z = 0, which starts at the origin along x [m]."""
    angles = np.linspace(0.0, angle, count)
    return radius * np.stack([np.sin(angles), 1.0 - np.cos(angles), 0.0 * angles], axis=1)


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


def with_encoders(
    step: MeasuredShape, lengths: np.ndarray, is_driven: bool = False
) -> MeasuredShape:
    """Return a ``step`` with ``lengths`` (tendons,) [m] as readings of encoders."""
    window = dataclasses.replace(step.window, displacements=lengths, is_driven=is_driven)
    return dataclasses.replace(step, window=window)


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
    camera: Alignment = FAR,
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
    frames = [camera.to_camera(lines[tension]) for tension in np.interp(times, time, pulled)]
    return Recording(PARAMETERS, time, tensions, times + ahead, tuple(frames), 'camera')


def path_sample(
    points: np.ndarray, stamp_ns: int, topic: str = '/camera/midline', frame: str = 'arm_base'
) -> Sample:
    """Return a nav_msgs/Path."""
    header_ = header(stamp_ns, frame)
    kind = 'geometry_msgs/msg/PoseStamped'
    poses = [make(kind, header=header_, pose=pose(point)) for point in points]
    return message(topic, 'nav_msgs/msg/Path', stamp_ns, header=header_, poses=poses)


def pose_sample(
    point: np.ndarray, stamp_ns: int, topic: str = '/tracker/tip', frame: str = 'arm_base'
) -> Sample:
    """Return a geometry_msgs/PoseStamped."""
    header_ = header(stamp_ns, frame)
    return message(
        topic, 'geometry_msgs/msg/PoseStamped', stamp_ns, header=header_, pose=pose(point)
    )


def nanoseconds(time: float) -> int:
    return START + round(time * 1e9)


def tension_samples(time: np.ndarray, pulled: Sequence[Any]) -> list[Sample]:
    """Return messages with the tension of the first tendon, or of all."""
    kind = 'octo_arm_msgs/msg/TendonTensions'
    return [
        Sample(
            '/tendon_tensions',
            kind,
            nanoseconds(at),
            tensions_data(
                kind, ARM.tendon_names, row if np.ndim(row) else one_tendon(row), nanoseconds(at)
            ),
        )
        for at, row in zip(time, pulled)
    ]


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
