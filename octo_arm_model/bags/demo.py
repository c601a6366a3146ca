"""A simulated experiment: tensions and camera midlines of an arm with another modulus E."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rosbags.interfaces import Connection
from scipy.interpolate import CubicSpline

from octo_arm_model.analysis.displacement import displacements_of
from octo_arm_model.bags.arms import STRING
from octo_arm_model.bags.topics import DESCRIPTION, MIDLINE
from octo_arm_model.bags.types import known_types
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config, load_config, parameters_as_yaml
from octo_arm_model.config.paper_data import PROTOTYPE_ERRORS
from octo_arm_model.config.presets import preset_path
from octo_arm_model.core.arm.validation import finite, not_negative, positive
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.section.highest_tensions import default_highest
from octo_arm_model.core.solver import Solver
from octo_arm_model.wire.displacement_messages import TOPIC as DISPLACEMENTS
from octo_arm_model.wire.displacement_messages import TYPE_NAME as DISPLACEMENT_TYPE
from octo_arm_model.wire.tension_messages import TENSION_TOPICS

PRESET = 'renda2012_prototype'
CAMERA_FRAME = 'camera'
# Pose of the camera's frame in base_frame: beside the arm, looking at it.
CAMERA_POSITION = (0.12, 0.05, 0.60)  # [m]
CAMERA_QUATERNION = (0.8, -0.36, 0.288, 0.384)  # x, y, z, w
_START = 1_335_830_400 * 10**9  # 1 May 2012 [ns]
_POINTS = 41  # of a midline
_LEVELS = 41  # tensions that encoders are computed at, between which they are interpolated


@dataclass(frozen=True)
class Experiment:
    """What is simulated and how well it is measured; see `add_demo` for what it makes.

    Attributes:
        stiffness: true Young's modulus over that of the config [-].
        clock_offset: how far the camera's clock is ahead [s].
        hold: how long each tension is held [s].
        ramp: how long it takes to the next [s].
        tension_rate: messages of tensions a second [Hz].
        camera_rate: midlines a second [Hz].
        tension_noise: standard deviation of the tension of the tendon that is pulled [N].
        midline_noise: standard deviation of each coordinate of a midline [m].
        dropped: share of the midlines that are missing [-].
        outliers: share of the midlines with points that are nowhere near the arm [-].
        sheath: true stiffness of the tendons' sheaths [Pa]; 0 for that of the config. With it, or
            with the next, the encoders of the winches are recorded as well.
        axial_stiffness: true E A of the tendons themselves [N]; 0 for that of the config.
        encoder_noise: standard deviation of what an encoder reads [m].
        friction: coefficient of friction of the tendons [-]; where there is some, the tensions go
            down again the way they came.

    Raises:
        ArmDefinitionError: if a value is impossible.
    """

    stiffness: float = 1.1
    clock_offset: float = 0.08
    hold: float = 4.0
    ramp: float = 1.0
    tension_rate: float = 100.0
    camera_rate: float = 10.0
    tension_noise: float = 0.005
    midline_noise: float = 0.0005
    dropped: float = 0.05
    outliers: float = 0.03
    sheath: float = 0.0
    axial_stiffness: float = 0.0
    encoder_noise: float = 2e-5
    friction: float = 0.0

    def __post_init__(self) -> None:
        """Validate what the command line sets."""
        positive('--stiffness', self.stiffness, 'of that of the config')
        finite('--clock-offset', self.clock_offset)
        not_negative('--sheath', self.sheath, 'stiffness', 'Pa')
        not_negative('--axial-stiffness', self.axial_stiffness, 'stiffness', 'N')
        not_negative('--friction', self.friction, 'coefficient', '-')


def add_demo(
    writer: BagWriter, parameters: Mapping[str, Any], experiment: Experiment, seed: int
) -> None:
    """Write a simulated experiment on the arm of ``parameters``, the same for the same ``seed``.

    The first tendon is pulled by the tensions of the paper's Table 1 one after the other (by as
    large a part of what other arms than its prototype bear). What a camera sees of the arm is the
    answer of the model exact, in the camera's frame and with the stamps of its clock.

    Raises:
        OctoArmError: if the parameters are those of no arm, or the bag cannot be written.
    """
    config = Config.from_parameters(parameters)
    rng = np.random.default_rng(seed)
    levels = _levels(config)
    if experiment.friction:
        levels = np.concatenate([levels, levels[-2::-1]])
    times, pulls = _schedule(levels, experiment)
    messages = _Messages(writer, config)
    text = parameters_as_yaml(parameters)
    messages.say(f'/{DESCRIPTION}', text)
    messages.say('/note', _note(experiment, seed))

    sampled = np.arange(0.0, times[-1], 1.0 / experiment.tension_rate)
    measured = np.interp(sampled, times, pulls)
    # The load cell of a slack tendon reads zero, without noise.
    noise = experiment.tension_noise * rng.standard_normal(measured.size)
    measured = np.where(measured > 0.0, np.maximum(measured + noise, 0.0), 0.0)
    for time, tension in zip(sampled, measured):
        messages.add_tension(time, tension)

    if experiment.sheath or experiment.axial_stiffness:
        reeled_in = _reeled_in(parameters, np.interp(sampled, times, pulls), experiment)
        # Random numbers of their own: all else is the same with encoders and without.
        noise = np.random.default_rng([seed, 1]).standard_normal(reeled_in.shape)
        reeled_in += experiment.encoder_noise * noise
        for time, displacements in zip(sampled, reeled_in):
            messages.add_displacements(time, displacements)

    seen = np.arange(0.0, times[-1], 1.0 / experiment.camera_rate)
    seen = seen[rng.random(seen.size) >= experiment.dropped]
    midlines = _midlines(parameters, np.interp(seen, times, pulls), experiment)
    midlines += experiment.midline_noise * rng.standard_normal(midlines.shape)
    for time, midline in zip(seen, midlines):
        if rng.random() < experiment.outliers:
            # From a random point on the tracking is lost, as at a reflection.
            lost = slice(int(rng.integers(_POINTS // 4, _POINTS)), None)
            midline[lost] += rng.normal(0.0, 0.05 * config.arm.length, 3)
        messages.add_midline(time, midline, experiment.clock_offset)
    messages.write()


def truth(experiment: Experiment, seed: int) -> dict[str, Any]:
    """What a demo was made with, for its metadata."""
    return {
        'model': 'exact',
        **asdict(experiment),
        'seed': seed,
        'camera_position': CAMERA_POSITION,
        'camera_quaternion': CAMERA_QUATERNION,
    }


def custom_data(experiment: Experiment, seed: int) -> dict[str, str]:
    """Custom data for the metadata of a demo, with what it was made with."""
    return {'note': _note(experiment, seed), 'truth': json.dumps(truth(experiment, seed))}


def _note(experiment: Experiment, seed: int) -> str:
    return (
        'This recording is synthetic: nothing of it was measured. octo-arm record-demo made it '
        f'with {json.dumps(truth(experiment, seed))}.'
    )


def _levels(config: Config) -> FloatArray:
    """Tensions to hold [N], one after the other."""
    prototype = load_config(preset_path(PRESET)).arm
    bears, usual = (default_highest(arm).flat[0] for arm in (config.arm, prototype))
    return np.array(list(PROTOTYPE_ERRORS)) * (bears / usual)


def _schedule(levels: FloatArray, experiment: Experiment) -> tuple[FloatArray, FloatArray]:
    """Corners of the tension over time: [s] and [N]."""
    held = np.concatenate([[0.0], levels])
    begins = np.arange(held.size) * (experiment.hold + experiment.ramp)
    return np.stack([begins, begins + experiment.hold], axis=1).ravel(), np.repeat(held, 2)


def _true_config(parameters: Mapping[str, Any], experiment: Experiment) -> Config:
    """The arm as it is, not as the bag describes it."""
    stiffer: dict[str, Any] = {'model': 'exact'}
    for name in ('material.youngs_modulus', 'material.table_youngs_modulus'):
        if parameters.get(name):
            stiffer[name] = (experiment.stiffness * np.array(parameters[name])).tolist()
    if experiment.sheath:
        stiffer['tendons.sheath_stiffness'] = [experiment.sheath]
    if experiment.axial_stiffness:
        stiffer['tendons.axial_stiffness'] = [experiment.axial_stiffness]
    if experiment.friction:
        stiffer['tendons.friction'] = [experiment.friction]
    return Config.from_parameters({**parameters, **stiffer})


def _reeled_in(
    parameters: Mapping[str, Any], pulls: FloatArray, experiment: Experiment
) -> FloatArray:
    """Lengths that the winches of all tendons have reeled in, (pulls, tendons) [m]."""
    config = _true_config(parameters, experiment)
    solver, levels = config.solver(), np.linspace(0.0, pulls.max(), _LEVELS)
    known = np.empty((_LEVELS, len(config.arm.tendons)))
    for row, level in zip(known, levels):
        tensions = np.zeros(row.size)
        tensions[0] = level
        backbone = solver.solve(tensions.reshape(config.arm.tension_shape))
        row[:] = displacements_of(solver, backbone).ravel()
    return np.asarray(CubicSpline(levels, known)(pulls))


def _midlines(
    parameters: Mapping[str, Any], pulls: FloatArray, experiment: Experiment
) -> FloatArray:
    """True midlines in the camera's frame, base first, (frames, points, 3) [m]."""
    config = _true_config(parameters, experiment)
    tensions = np.zeros((pulls.size, len(config.arm.tendons)))
    tensions[:, 0] = pulls
    solver = config.solver()
    shaped = tensions.reshape(-1, *config.arm.tension_shape)
    positions = _sequence(solver, shaped) if config.arm.friction else solver.solve(shaped).position
    at = np.linspace(0.0, config.arm.length, _POINTS)
    points = np.empty((pulls.size, _POINTS, 3))
    for frame, position in zip(points, positions):
        for axis in range(3):
            frame[:, axis] = np.interp(at, solver.grid.s, position[:, axis])
    rotation = Quaternions.from_xyzw(CAMERA_QUATERNION).matrix()
    # Row vectors times the matrix are rotated by its inverse: base_frame to the camera's.
    return (points - CAMERA_POSITION) @ rotation


def _sequence(solver: Solver, tensions: FloatArray) -> list[FloatArray]:
    """Stations under one set of ``tensions`` after another, with the history of friction."""
    last: Backbone | None = None
    positions = []
    for pulled in tensions:
        if last is None or (pulled != last.tensions).any():
            last = solver.follow(pulled, last)
        positions.append(last.position)
    return positions


class _Messages:
    """Collects messages and writes them in order of receipt."""

    def __init__(self, writer: BagWriter, config: Config) -> None:
        self._writer, self._config = writer, config
        self._types = known_types()
        self._topics: dict[str, Connection] = {}
        self._messages: list[Message] = []

    def say(self, topic: str, text: str) -> None:
        """Add a latched text at the start."""
        message = self._make(STRING, data=text)
        self._add(topic, STRING, 0.0, message, latched=True)

    def add_tension(self, time: float, tension: float) -> None:
        """Add tensions measured at ``time`` [s]: that of the first tendon [N], the others none."""
        arm = self._config.arm
        tensions = np.zeros(len(arm.tendons))
        tensions[0] = tension
        (topic, kind), *_ = TENSION_TOPICS.items()
        assert kind.names is not None
        fields = {kind.names: list(arm.tendon_names), kind.tensions: tensions}
        header = self._header(time, self._config.base_frame)
        message = self._make(kind.type_name, header=header, **fields)
        self._add(f'/{topic}', kind.type_name, time, message)

    def add_displacements(self, time: float, displacements: FloatArray) -> None:
        """Add lengths that the winches have reeled in at ``time`` [s], (tendons,) [m]."""
        arm, none = self._config.arm, np.zeros(0)
        header = self._header(time, self._config.base_frame)
        message = self._make(
            DISPLACEMENT_TYPE, header=header, name=list(arm.tendon_names),
            position=displacements, velocity=none, effort=none,
        )  # fmt: skip
        self._add(f'/{DISPLACEMENTS}', DISPLACEMENT_TYPE, time, message)

    def add_midline(self, time: float, points: FloatArray, ahead: float) -> None:
        """Add ``points`` (n, 3) [m] seen at ``time`` [s], by a clock that is ``ahead`` [s]."""
        header = self._header(time + ahead, CAMERA_FRAME)
        # A camera does not see the orientation of cross sections.
        level = self._make('geometry_msgs/msg/Quaternion', x=0.0, y=0.0, z=0.0, w=1.0)
        poses = []
        for x, y, z in points.tolist():
            place = self._make('geometry_msgs/msg/Point', x=x, y=y, z=z)
            pose = self._make('geometry_msgs/msg/Pose', position=place, orientation=level)
            poses.append(self._make('geometry_msgs/msg/PoseStamped', header=header, pose=pose))
        name = 'nav_msgs/msg/Path'
        self._add(f'/{MIDLINE}', name, time, self._make(name, header=header, poses=poses))

    def write(self) -> None:
        """Write all of them."""
        self._writer.write(sorted(self._messages, key=lambda message: message[1]))

    def _header(self, time: float, frame: str) -> Any:
        sec, nanosec = divmod(_nanoseconds(time), 10**9)
        stamp = self._make('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
        return self._make('std_msgs/msg/Header', stamp=stamp, frame_id=frame)

    def _make(self, name: str, /, **fields: Any) -> Any:
        return self._types.types[name](**fields)

    def _add(
        self, topic: str, name: str, time: float, message: Any, latched: bool = False
    ) -> None:
        if topic not in self._topics:
            self._topics[topic] = self._writer.add(topic, name, latched)
        data = bytes(self._types.serialize_cdr(message, name))
        self._messages.append((self._topics[topic], _nanoseconds(time), data))


def _nanoseconds(time: float) -> int:
    """Stamp of a ``time`` from the start [s]."""
    return _START + round(time * 1e9)
