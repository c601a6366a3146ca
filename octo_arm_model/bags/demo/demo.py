"""A simulated experiment: tensions and camera midlines of an arm with another modulus E."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rosbags.interfaces import Connection
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import within
from octo_arm_model.bags.demo.experiment import (
    CAMERA_POSITION,
    CAMERA_QUATERNION,
    Experiment,
    TrueArm,
    note,
)
from octo_arm_model.bags.topics import DESCRIPTION, MIDLINE
from octo_arm_model.bags.writer import BagWriter, Message
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.interpolation import interpolated
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.wire.cdr.backbone import (
    path,
    pose_array,
    pose_with_covariance,
    tendon_tensions,
)
from octo_arm_model.wire.cdr.layout import text_field
from octo_arm_model.wire.cdr.templates import Template
from octo_arm_model.wire.displacement_messages import DISPLACEMENT_TYPE, DISPLACEMENTS
from octo_arm_model.wire.measurement_messages import MARKERS, MEASUREMENT_TOPICS, TIP_POSE
from octo_arm_model.wire.stamp import Stamp
from octo_arm_model.wire.tension_messages import TENSION_TOPICS

START = 1_335_830_400 * 10**9  # 1 May 2012 [ns]
TENSIONS = 'tendon_tensions'
# Orientation of points: a camera does not see that of cross sections.
LEVEL = (0.0, 0.0, 0.0, 1.0)
_POINTS = 41  # of a midline


def add_demo(writer: BagWriter, parameters: Mapping[str, Any], experiment: Experiment) -> None:
    """Write a simulated ``experiment`` on the arm of ``parameters``, the same for the same seed.

    The first tendon is pulled by the tensions of the paper's Table 1 one after the other (by as
    large a part of what other arms than its prototype bear). What a camera sees of the arm is the
    answer of the model exact, in the camera's frame and with the stamps of its clock.

    Raises:
        OctoArmError: if the parameters are those of no arm, or a marker is not on it, or the bag
            cannot be written.
    """
    config = Config.from_parameters(parameters)
    for s in experiment.markers:
        within('--markers', s, 0.0, config.arm.length, 'm')
    rng = np.random.default_rng(experiment.seed)
    times, pulls = experiment.schedule(config)
    messages = DemoMessages(writer, config, _POINTS, len(experiment.markers))
    true = TrueArm(parameters, experiment)
    writer.add_text(f'/{DESCRIPTION}', parameters_as_yaml(parameters), START)
    writer.add_text('/note', note(experiment), START)

    sampled = np.arange(0.0, times[-1], 1.0 / experiment.tension_rate)
    measured = np.interp(sampled, times, pulls)
    # The load cell of a slack tendon reads zero, without noise.
    noise = experiment.tension_noise * rng.standard_normal(measured.size)
    measured = np.where(measured > 0.0, np.maximum(measured + noise, 0.0), 0.0)
    tensions = np.zeros((measured.size, len(config.arm.tendons)))
    tensions[:, 0] = measured
    for time, row in zip(sampled, tensions):
        messages.add(TENSIONS, time, row)

    if experiment.sheath or experiment.axial_stiffness:
        reeled_in = true.reeled_in(np.interp(sampled, times, pulls))
        # Random numbers of their own: all else is the same with encoders and without.
        noise = np.random.default_rng([experiment.seed, 1]).standard_normal(reeled_in.shape)
        reeled_in += experiment.encoder_noise * noise
        for time, displacements in zip(sampled, reeled_in):
            messages.add(DISPLACEMENTS, time, displacements)

    seen = np.arange(0.0, times[-1], 1.0 / experiment.camera_rate)
    seen = seen[rng.random(seen.size) >= experiment.dropped]
    shapes = true.shapes(np.interp(seen, times, pulls), experiment.touches(seen, times))
    midlines = _seen_by_camera(shapes)
    midlines += experiment.midline_noise * rng.standard_normal(midlines.shape)
    for time, midline in zip(seen, midlines):
        if rng.random() < experiment.outliers:
            # From a random point on the tracking is lost, as at a reflection.
            lost = slice(int(rng.integers(_POINTS // 4, _POINTS)), None)
            midline[lost] += rng.normal(0.0, 0.05 * config.arm.length, 3)
        messages.add(MIDLINE, time, midline, LEVEL, ahead=experiment.clock_offset)
    if experiment.touch or experiment.markers:
        seen = np.arange(0.0, times[-1], 1.0 / experiment.marker_rate)
        shapes = true.shapes(np.interp(seen, times, pulls), experiment.touches(seen, times))
        _add_measured(messages, seen, shapes, experiment)
    messages.write()


def _seen_by_camera(shapes: Sequence[Backbone]) -> FloatArray:
    """Midlines in the camera's frame, base first, (shapes, points, 3) [m]."""
    at = np.linspace(0.0, shapes[0].s[-1], _POINTS)
    points = np.array([interpolated(at, shape.s, shape.position) for shape in shapes])
    rotation = axes_of(CAMERA_QUATERNION)
    # Row vectors times the matrix are rotated by its inverse: base_frame to the camera's.
    return (points - CAMERA_POSITION) @ rotation


def _add_measured(
    messages: DemoMessages, times: FloatArray, shapes: Sequence[Backbone], experiment: Experiment
) -> None:
    """Add what is measured of ``shapes`` at ``times`` (n,) [s] besides midlines."""
    # Random numbers of their own: all else is the same with a touch and without.
    rng = np.random.default_rng([experiment.seed, 2])
    stddev = np.repeat([experiment.marker_noise, experiment.turn_noise], 3)
    for time, shape in zip(times, shapes, strict=True):
        if experiment.touch:
            error = stddev * rng.standard_normal(6)
            turned = Rotation.from_rotvec(error[3:]) * Rotation.from_quat(shape.quaternion[-1])
            position, covariance = shape.tip + error[:3], np.diag(stddev**2)
            messages.add(TIP_POSE, time, position, turned.as_quat(), covariance)
        if experiment.markers:
            points = interpolated(np.array(experiment.markers), shape.s, shape.position)
            noise = experiment.marker_noise * rng.standard_normal(points.shape)
            messages.add(MARKERS, time, points + noise, LEVEL)


class DemoMessages:
    """Collects messages and writes them in order of receipt."""

    def __init__(self, writer: BagWriter, config: Config, points: int, markers: int) -> None:
        """Lay out messages of the arm of ``config``, with so many ``points`` and ``markers``."""
        frame, names = text_field('base_frame', config.base_frame), config.arm.tendon_names
        lengths = tendon_tensions(frame, names)  # but that the numbers are positions
        lengths.count(0)  # no velocities
        lengths.count(0)  # no efforts
        layouts = {
            TENSIONS: (TENSION_TOPICS[TENSIONS].type_name, tendon_tensions(frame, names)),
            DISPLACEMENTS: (DISPLACEMENT_TYPE, lengths),
            MIDLINE: ('nav_msgs/msg/Path', path(b'camera', points)),
            TIP_POSE: (MEASUREMENT_TOPICS[TIP_POSE].type_name, pose_with_covariance(frame)),
        }
        if markers:
            layouts[MARKERS] = MEASUREMENT_TOPICS[MARKERS].type_name, pose_array(frame, markers)
        self._layouts = {
            topic: (type_name, Template(layout)) for topic, (type_name, layout) in layouts.items()
        }
        self._writer = writer
        self._connections: dict[str, Connection] = {}
        self._messages: list[Message] = []

    def add(self, topic: str, time: float, *values: Any, ahead: float = 0.0) -> None:
        """Add a message received at ``time`` [s] after the start.

        It holds the ``values`` of the slots of its layout in their order, and a stamp of a clock
        that is ``ahead`` [s].
        """
        type_name, template = self._layouts[topic]
        if topic not in self._connections:
            self._connections[topic] = self._writer.add(f'/{topic}', type_name)
        data = template.write(*Stamp.from_ns(_nanoseconds(time + ahead)), *values)
        self._messages.append((self._connections[topic], _nanoseconds(time), data))

    def write(self) -> None:
        """Write all of them."""
        self._writer.write(sorted(self._messages, key=lambda message: message[1]))


def _nanoseconds(time: float) -> int:
    """Stamp of a ``time`` from the start [s]."""
    return START + round(time * 1e9)
