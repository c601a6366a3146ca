"""A simulated experiment: its parameters, and the arm as it really is."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import MAX_FRICTION
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.arm.validation import not_negative, positive, whole, within
from octo_arm_model.config.config import Config, load_config
from octo_arm_model.config.paper_data import PROTOTYPE_ERRORS
from octo_arm_model.config.presets import preset_path
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import displacements_of

PRESET = 'renda2012_prototype'
# Pose of the camera's frame in base_frame: beside the arm, looking at it.
CAMERA_POSITION = (0.12, 0.05, 0.60)  # [m]
CAMERA_QUATERNION = (0.8, -0.36, 0.288, 0.384)  # x, y, z, w
TOUCH_DIRECTION = (0.0, 0.6, 0.8)  # in base_frame
# Parts of the time that a tension is held: before a touch, and while it grows; it ends likewise.
_TOUCH_AFTER, _TOUCH_GROWN = 0.125, 0.1875
_LEVELS = 41  # tensions that encoders are computed at, between which they are interpolated
_MOST_AHEAD = 1e8  # [s] of a clock: seconds of a stamp are an int32


@dataclass(frozen=True)
class Experiment:
    """Parameters of a simulation and the noise of its sensors; see `add_demo`.

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
        touch: force on the tip [N] along `TOUCH_DIRECTION`, while the middle tension is held. With
            it the pose of the tip is measured as well.
        markers: arc coordinates of markers that are measured [m].
        marker_rate: poses of the tip, and frames of markers, a second [Hz].
        marker_noise: standard deviation of each coordinate of tip and markers [m].
        turn_noise: of each component of the rotation vector of the tip [rad].
        seed: of everything random.

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
    touch: float = 0.0
    markers: tuple[float, ...] = ()
    marker_rate: float = 20.0
    marker_noise: float = 0.0005
    turn_noise: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        """Validate what the command line sets."""
        positive('--stiffness', self.stiffness, '-')
        within('--clock-offset', self.clock_offset, -_MOST_AHEAD, _MOST_AHEAD, 's')
        not_negative('--sheath', self.sheath, 'stiffness', 'Pa')
        not_negative('--axial-stiffness', self.axial_stiffness, 'stiffness', 'N')
        not_negative('--friction', self.friction, 'coefficient', '-', MAX_FRICTION)
        not_negative('--touch', self.touch, 'force', 'N')
        whole('--seed', self.seed)
        if self.touch and (self.sheath or self.axial_stiffness):
            # Encoders are interpolated over the tensions alone.
            raise ConfigError('--touch does not go with --sheath or --axial-stiffness')

    def schedule(self, config: Config) -> tuple[FloatArray, FloatArray]:
        """Corners of the tension of the first tendon over time: [s] and [N].

        Those of the paper's Table 1 one after the other, or as large a part of what other arms
        than its prototype bear.
        """
        prototype = load_config(preset_path(PRESET)).arm
        bears, usual = (default_highest(arm).flat[0] for arm in (config.arm, prototype))
        held = np.concatenate([[0.0], np.array(list(PROTOTYPE_ERRORS)) * (bears / usual)])
        if self.friction:
            held = np.concatenate([held, held[-2:0:-1]])
        begins = np.arange(held.size) * (self.hold + self.ramp)
        return np.stack([begins, begins + self.hold], axis=1).ravel(), np.repeat(held, 2)

    def touches(self, time: FloatArray, corners: FloatArray) -> FloatArray:
        """Force on the tip at each ``time`` (n,) [s], (n, 3) [N]; ``corners`` of the tension."""
        parts = [_TOUCH_AFTER, _TOUCH_GROWN, 1.0 - _TOUCH_GROWN, 1.0 - _TOUCH_AFTER]
        at = corners[2 * (len(corners) // 4)] + self.hold * np.array(parts)
        return np.outer(np.interp(time, at, [0.0, self.touch, self.touch, 0.0]), TOUCH_DIRECTION)


def truth(experiment: Experiment) -> dict[str, Any]:
    """The parameters of a demo, for its metadata."""
    return {
        'model': 'exact',
        **asdict(experiment),
        'camera_position': CAMERA_POSITION,
        'camera_quaternion': CAMERA_QUATERNION,
    }


def custom_data(experiment: Experiment) -> dict[str, str]:
    """Custom data for the metadata of a demo, with what it was made with."""
    return {'note': note(experiment), 'truth': json.dumps(truth(experiment))}


def note(experiment: Experiment) -> str:
    """Text of the topic note: the data are synthetic, and their parameters."""
    return (
        'This recording is synthetic: nothing of it was measured. octo-arm record-demo made it '
        f'with {json.dumps(truth(experiment))}.'
    )


class TrueArm:
    """Its shapes and lengths while the first tendon is pulled.

    Attributes:
        config: what it is.
        solver: of its shape.
    """

    def __init__(self, parameters: Mapping[str, Any], experiment: Experiment) -> None:
        """Change the arm of ``parameters`` as the ``experiment`` says."""
        changed: dict[str, Any] = {'model': 'exact'}
        for name in ('material.youngs_modulus', 'material.table_youngs_modulus'):
            if parameters.get(name):
                changed[name] = (experiment.stiffness * np.array(parameters[name])).tolist()
        for name, value in (
            ('tendons.sheath_stiffness', experiment.sheath),
            ('tendons.axial_stiffness', experiment.axial_stiffness),
            ('tendons.friction', experiment.friction),
        ):
            if value:
                changed[name] = [value]
        self.config = Config.from_parameters({**parameters, **changed})
        self.solver = self.config.solver()

    def reeled_in(self, pulls: FloatArray) -> FloatArray:
        """Lengths that the winches of all tendons have reeled in, (pulls, tendons) [m].

        Under one pull after another [N].
        """
        if self.config.arm.friction:
            # They depend on the pulls before.
            shapes = self.shapes(pulls, np.zeros((pulls.size, 3)))
            return np.array([displacements_of(self.solver, shape).ravel() for shape in shapes])
        levels = np.linspace(0.0, pulls.max(), _LEVELS)
        known = [
            displacements_of(self.solver, self.solver.solve(self._tensions(level))).ravel()
            for level in levels
        ]
        return np.asarray(CubicSpline(levels, known)(pulls))

    def shapes(self, pulls: FloatArray, forces: FloatArray) -> list[Backbone]:
        """Shapes under one pull after another [N], with ``forces`` (pulls, 3) on the tip [N]."""
        last: Backbone | None = None
        found: list[Backbone] = []
        for pull, force in zip(pulls, forces, strict=True):
            tensions, wrench = self._tensions(pull), np.append(force, np.zeros(3))
            if (
                last is None
                or (tensions != last.tensions).any()
                or (wrench != last.tip_wrench).any()
            ):
                last = self.solver.follow(tensions, last, wrench if wrench.any() else None)
            found.append(last)
        return found

    def _tensions(self, pull: float) -> FloatArray:
        arm = self.config.arm
        tensions = np.zeros(len(arm.tendons))
        tensions[0] = pull
        return tensions.reshape(arm.tension_shape)
