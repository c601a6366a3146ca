"""Recordings of an arm that moves: a shape for each frame, and those of the moving model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import ConfigError, MeasurementError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.alignment import Alignment
from octo_arm_model.experiment.measured_shapes import MeasuredShape, mean_markers, mean_shape
from octo_arm_model.experiment.observations import Observations, Pairing, base_first
from octo_arm_model.experiment.recording import Recording
from octo_arm_model.experiment.steady_windows import Window
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.interpolation import interpolated, nearest
from octo_arm_model.rod.motion import Dynamics
from octo_arm_model.simulation.driven_motion import DrivenMotion

MOST_FRAMES = 5000


class TensionTrajectory(NamedTuple):
    """Tensions over time, along which an arm moves.

    Attributes:
        time: ascending (n,) [s].
        tensions: (n, tendons) [N].
        step: of the integration [s].
    """

    time: FloatArray
    tensions: FloatArray
    step: float


def observe_motion(
    recording: Recording, pairing: Pairing, known: Alignment | None, step: float
) -> tuple[Observations, TensionTrajectory]:
    """A shape for each frame of ``recording``, and its tensions; ``known`` is the alignment.

    Raises:
        ConfigError: if there is no alignment, which only equilibria are fitted with.
        MeasurementError: if there are too many frames, no load cells, or neither end of the
            midlines is clearly the base.
        SolveError: if no frame was taken when tensions were.
    """
    if known is None:
        raise ConfigError(
            "the alignment of an arm that moves is not fitted: --align is expected to be 'none' "
            'or a pose, as compare or identify finds it where the arm is at rest'
        )
    if recording.is_driven:
        raise MeasurementError('there are no tensions in this recording, expected load cells')
    if len(recording.frames) > MOST_FRAMES:
        raise MeasurementError(
            f'{len(recording.frames)} frames of an arm that moves, expected at most {MOST_FRAMES}'
        )
    notes = list(recording.notes)
    config = Config.from_parameters(recording.parameters)
    frames = base_first(recording, pairing, config, known, notes)
    offset = pairing.offset or 0.0
    if pairing.offset is None:
        notes.append('clock offset taken as 0 s: that of an arm that moves is not looked for')
    time, tensions = recording.tension_time, recording.tensions
    seen = recording.frame_time + offset
    away = np.abs(seen - time[nearest(seen, time)])
    usable = (away <= pairing.tolerance) & (seen >= time[0]) & (seen <= time[-1])
    shapes = []
    for number in np.flatnonzero(usable).tolist():
        at, points = float(seen[number]), frames[number]
        pulled = interpolated(at, time, tensions)
        window = Window(at, at, pulled, np.zeros(pulled.size))
        marked = recording.marker_s
        shape = (
            mean_shape(window, [points]) if marked is None
            else mean_markers(window, [points], marked)
        )  # fmt: skip
        shapes += [] if shape is None else [shape]
    if not shapes:
        raise SolveError(
            f'nothing to compare: none of {len(frames)} frames from {seen[0]:.3f} to '
            f'{seen[-1]:.3f} s has tensions within {pairing.tolerance:g} s'
        )
    notes += [
        f'{len(shapes)} of {len(frames)} frames are used, each by itself',
        'the arm moves from rest at the first tensions on',
    ]
    notes += recording.refusals.lines()
    return Observations(tuple(shapes), offset, tuple(notes)), TensionTrajectory(
        time, tensions, step
    )


def moving_shapes(
    dynamics: Dynamics, trajectory: TensionTrajectory, shapes: Sequence[MeasuredShape],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[Backbone], str]:  # fmt: skip
    """The arm along a ``trajectory`` at the time of each of ``shapes``, in order of time.

    Returns:
        The shapes up to where the motion ends, and why it does; '' where it does not.
    """
    motion, by_stamp, reason = DrivenMotion(dynamics, trajectory.step), dict[int, Backbone](), ''
    wanted = [round(1e9 * shape.window.start) for shape in shapes]
    stamps = sorted({*wanted, *np.round(1e9 * trajectory.time).astype(int).tolist()})
    rows = interpolated(1e-9 * np.array(stamps), trajectory.time, trajectory.tensions)
    due = set(wanted)
    try:
        for stamp, row in zip(stamps, rows):
            motion.read(stamp, row.reshape(dynamics.solver.arm.tension_shape))
            if stamp in due:
                by_stamp[stamp] = dynamics.backbone(motion.state)
                progress(len(by_stamp), len(due))
            if len(by_stamp) == len(due):
                break
    except SolveError as error:
        reason = str(error)
    return [by_stamp[stamp] for stamp in wanted if stamp in by_stamp], reason
