"""Experiments for tests: recordings and shapes of an arm whose truth is known."""

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
HELD = (0.0, 0.53, 1.09, 2.0, 2.6, 3.06, 3.44, 3.95)  # Table 1, from rest [N]
STEPS = HELD[1:]
TRUE = 1.23e5  # Young's modulus of the arms of `measured` [Pa]; the config says 1.1e5
FAR = Alignment(np.array([2.0, -0.9, 0.7]), np.array([0.12, 0.05, 0.6]))


def one_tendon(tension: float) -> np.ndarray:
    return np.array([tension, 0.0, 0.0, 0.0])


PULLS = tuple(one_tendon(tension) for tension in STEPS[::2])


def circle(radius: float = 0.1, angle: float = 2.0, count: int = 41) -> np.ndarray:
    """An arc in the plane z = 0 from the origin along x [m]."""
    at = np.linspace(0.0, angle, count)
    return radius * np.stack([np.sin(at), 1.0 - np.cos(at), 0.0 * at], axis=1)


def midline(model: str, pulled: np.ndarray, count: int = 61, **changes: Any) -> np.ndarray:
    """Midline of the prototype with parameters changed, evenly along its length."""
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
    """Steps with ``frames`` noisy copies of each of the true ``lines``."""
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
    """Steps of an arm of modulus `TRUE`; ``wrong`` is the stddev of each step's tension [N]."""
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
    """A ``step`` in which encoders read ``lengths`` (tendons,) [m]."""
    window = dataclasses.replace(step.window, displacements=lengths, is_driven=is_driven)
    return dataclasses.replace(step, window=window)


def tips(steps: list[MeasuredShape]) -> list[MeasuredShape]:
    """The same ``steps`` of which the tips alone were measured."""
    return [dataclasses.replace(step, points=step.points[-1:]) for step in steps]


def staircase(
    held: Sequence[float] = HELD, hold: float = 3.0, ramp: float = 1.0, rate: float = 50.0
) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and tensions of the first tendon [N]: each held, then on to the next."""
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
    """Frames of an arm that follows a staircase without lag, their clock ``ahead`` by [s]."""
    time, pulled = staircase(held)
    tensions = np.zeros((time.size, 4))
    tensions[:, 0] = pulled
    seen = np.arange(0.0, time[-1], 1.0 / rate)
    known = {
        tension: midline(model, one_tendon(tension), 31, **changes)
        for tension in np.unique(np.interp(seen, time, pulled))
    }
    frames = [camera.to_camera(known[at]) for at in np.interp(seen, time, pulled)]
    return Recording(PARAMETERS, time, tensions, seen + ahead, tuple(frames), 'camera')


def path_sample(
    points: np.ndarray, stamp_ns: int, topic: str = '/camera/midline', frame: str = 'arm_base'
) -> Sample:
    """A nav_msgs/Path."""
    about = header(stamp_ns, frame)
    poses = [make('geometry_msgs/msg/PoseStamped', header=about, pose=pose(at)) for at in points]
    return message(topic, 'nav_msgs/msg/Path', stamp_ns, header=about, poses=poses)


def pose_sample(
    point: np.ndarray, stamp_ns: int, topic: str = '/tracker/tip', frame: str = 'arm_base'
) -> Sample:
    """A geometry_msgs/PoseStamped."""
    about = header(stamp_ns, frame)
    return message(
        topic, 'geometry_msgs/msg/PoseStamped', stamp_ns, header=about, pose=pose(point)
    )


def nanoseconds(time: float) -> int:
    return START + round(time * 1e9)


def tension_samples(time: np.ndarray, pulled: Sequence[Any]) -> list[Sample]:
    """Messages of the tension of the first tendon, or the tensions of all."""
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
    """The arm, as the node announces it."""
    return text_sample('/arm_description', parameters_as_yaml({**PARAMETERS, **changes}))


def arm_file(folder: Path, parameters: Mapping[str, Any]) -> Path:
    """The file arm.yaml in a ``folder`` of an arm of these ``parameters``."""
    path = folder / 'arm.yaml'
    path.write_text(parameters_as_yaml(parameters))
    return path


def bag_of(path: Path, samples: Sequence[Sample]) -> Path:
    """A bag of ``samples`` in order of receipt."""
    return write_bag(path, sorted(samples, key=lambda sample: sample.received_ns))


def staircase_bag(path: Path, held: Sequence[float], see: Callable[[float, int], Sample]) -> Path:
    """A bag of tensions held for 2 s each, and of what a camera saw ``see`` meanwhile, at 10 Hz.

    ``see`` makes the message for a tension [N] and a stamp [ns].
    """
    time, pulled = staircase(held, hold=2.0)
    seen = np.arange(0.0, time[-1], 0.1)
    samples = [description(), *tension_samples(time, pulled)]
    samples += [
        see(tension, nanoseconds(at))
        for at, tension in zip(seen, np.interp(seen, time, pulled))
        if tension in held
    ]
    return bag_of(path, samples)
