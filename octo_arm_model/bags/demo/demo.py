"""A simulated experiment: tensions and camera midlines of an arm with another modulus E."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model.bags.demo.experiment import (
    CAMERA_POSITION,
    CAMERA_QUATERNION,
    Experiment,
    note,
)
from octo_arm_model.bags.demo.messages import LEVEL, START, TENSIONS, DemoMessages
from octo_arm_model.bags.demo.true_arm import TrueArm
from octo_arm_model.bags.topics import DESCRIPTION, MIDLINE
from octo_arm_model.bags.writer import BagWriter
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.core.arm.validation import within
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.interpolation import interpolated
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.wire.displacement_messages import DISPLACEMENTS
from octo_arm_model.wire.measurement_messages import MARKERS, TIP_POSE

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
    rotation = Quaternions.from_xyzw(CAMERA_QUATERNION).matrix()
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
