"""From a recording to the shapes of its steady steps."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.alignment import Alignment
from octo_arm_model.experiment.clock_offset import RANGE, clock_offset
from octo_arm_model.experiment.measured_shapes import MeasuredShape, mean_markers, mean_shape
from octo_arm_model.experiment.midlines import is_tip_first
from octo_arm_model.experiment.recording import Recording
from octo_arm_model.experiment.steady_windows import (
    SteadyRule,
    Window,
    by_length,
    pose_windows,
    ramp_windows,
    steady_windows,
    with_displacements,
)
from octo_arm_model.rod.interpolation import interpolated, nearest

_FEW_STEADY = 0.2  # of the time: steps of a staircase take more
STEPS, RAMP, POSES = 'steady steps', 'windows of a ramp', 'poses'
_ELSE = (
    'where it changes slowly instead of in steps, say --ramp; where each row is a static pose, '
    'as in a table of poses, say --poses'
)


@dataclass(frozen=True)
class Pairing:
    """How frames are paired with tensions.

    Attributes:
        steady: what counts as steady.
        tolerance: how far stamps may be off: a frame has a sample of tensions within this time,
            and lies at least that far inside its window [s].
        offset: added to the stamps of frames [s]; None to find it from the motion.
        base_end: 'first' or 'last' point of the midlines; None for the one that moves less.
        kind: what is recorded: `STEPS`, a `RAMP` of tensions that change slowly, see
            `ramp_windows`, or a table of `POSES`, see `pose_windows`.
        ramp_width: of the windows of a ramp [N]; None for the default.
    """

    steady: SteadyRule = field(default_factory=SteadyRule)
    tolerance: float = 0.1
    offset: float | None = None
    base_end: str | None = None
    kind: str = STEPS
    ramp_width: float | None = None


@dataclass(frozen=True)
class Observations:
    """The shapes of a recording.

    Attributes:
        shapes: one for each steady step with frames.
        offset: added to the stamps of frames [s].
        notes: the decisions made, in words.
    """

    shapes: tuple[MeasuredShape, ...]
    offset: float
    notes: tuple[str, ...]


def observe(
    recording: Recording,
    pairing: Pairing = Pairing(),
    known: Alignment | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Observations:
    """Shapes of the steady steps of ``recording``; ``known`` is the alignment, where it is.

    ``progress`` is called with the numbers of clock offsets tried and of all.

    Raises:
        MeasurementError: if neither end of the midlines is clearly the base.
        SolveError: if there is no steady step with a frame.
    """
    notes = list(recording.notes)
    config = Config.from_parameters(recording.parameters)
    time, sampled = recording.held
    what, unit = ('length', 'm') if recording.is_driven else ('tension', 'N')
    rule, is_stepped = pairing.steady, pairing.kind == STEPS
    if pairing.kind == POSES:
        windows = pose_windows(time, sampled, pairing.tolerance)
    elif pairing.kind == RAMP:
        windows = ramp_windows(time, sampled, pairing.ramp_width)
    else:
        windows = steady_windows(time, sampled, rule)
    if not windows:
        raise SolveError(
            f'nothing to compare: no {what} stays within {rule.tolerance_for(sampled):.3g} {unit} '
            f'for {rule.duration:g} s, and beyond the first {rule.settle:g} s; {_ELSE}'
        )
    frames = base_first(recording, pairing, config, known, notes)
    offset = camera_offset(recording, pairing, config, frames, notes, progress)
    span = float(np.ptp(time))
    share = sum(window.stop - window.start for window in windows) / max(span, 1e-9)
    seen = recording.frame_time + offset
    usable = _distance(seen, time) <= pairing.tolerance
    steady = f'{len(windows)} {pairing.kind}'
    paired: list[tuple[Window, list[FloatArray]]] = []
    margin = pairing.tolerance if is_stepped else 0.0
    for window in windows:
        inside = usable & (seen >= window.start + margin) & (seen <= window.stop - margin)
        if inside.any():
            at = seen[inside] if pairing.kind == RAMP else None
            window = _read_in(window, at, recording)
            paired.append((window, list(itertools.compress(frames, inside))))
    if recording.is_driven:
        followed = by_length([window for window, _ in paired], config)
        paired = [(window, shown) for window, (_, shown) in zip(followed, paired, strict=True)]
        notes.append(
            'no load cells: tensions follow from the lengths that winches reeled in, by the arm '
            'as the config has it'
        )
    shapes, used = [], 0
    for window, shown in paired:
        shape = (
            mean_shape(window, shown) if recording.marker_s is None
            else mean_markers(window, shown, recording.marker_s)
        )  # fmt: skip
        if shape is not None:
            shapes.append(shape)
            used += len(shown)
    if not shapes:
        raise SolveError(
            f'nothing to compare: none of {len(frames)} frames from {seen[0]:.3f} to '
            f'{seen[-1]:.3f} s lies in one of {steady} from {windows[0].start:.3f} to '
            f'{windows[-1].stop:.3f} s with {what}s within {pairing.tolerance:g} s'
            + (f'; {_ELSE}' if is_stepped else '')
        )
    notes.append(f'{steady}, {len(shapes)} of them with frames: {used} of {len(frames)} used')
    if share < _FEW_STEADY and is_stepped:
        notes.append(f'{what}s are steady in {100.0 * share:.0f} % of the time: {_ELSE}')
    notes += recording.refusals.lines()
    notes += _unseen(recording)
    return Observations(tuple(shapes), offset, tuple(notes))


def base_first(
    recording: Recording,
    pairing: Pairing,
    config: Config,
    known: Alignment | None,
    notes: list[str],
) -> Sequence[FloatArray]:
    """Midlines from base to tip."""
    if recording.is_tips or recording.marker_s is not None:
        return recording.frames
    tip_first, why = pairing.base_end == 'last', 'by --base-end'
    if pairing.base_end is None:
        base = known.to_camera(np.array(config.base.position)) if known is not None else None
        tip_first, why = is_tip_first(recording.frames, base)
    notes.append(f'midlines run from {"tip to base" if tip_first else "base to tip"}: {why}')
    return [points[::-1] for points in recording.frames] if tip_first else recording.frames


def camera_offset(
    recording: Recording,
    pairing: Pairing,
    config: Config,
    frames: Sequence[FloatArray],
    notes: list[str],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> float:
    """Offset of the camera's clock, given or estimated."""
    if pairing.offset is not None:
        return pairing.offset
    if pairing.kind == POSES:
        notes.append('clock offset taken as 0 s: the stamps say which frames show which pose')
        return 0.0
    if recording.is_driven:
        notes.append('clock offset taken as 0 s: without load cells it is not looked for')
        return 0.0
    tips = np.array([points[-1] for points in frames])
    seen = np.isfinite(tips).all(axis=1)
    found = None
    if seen.any():
        found = clock_offset(
            config.arm, recording.tension_time, recording.tensions, recording.frame_time[seen],
            tips[seen], progress,
        )  # fmt: skip
    if found is None:
        notes.append(
            f'clock offset taken as 0 s: the motion does not clearly tell one within {RANGE:g} s'
        )
        return 0.0
    notes.append(f'clock offset {found:+.2f} s on the stamps of frames, found from the motion')
    return found


def _read_in(window: Window, times: FloatArray | None, recording: Recording) -> Window:
    """The ``window`` with encoder readings, and of a ramp means at the ``times`` of frames [s]."""
    if times is None:
        return with_displacements(window, recording)
    if not recording.is_driven:
        tensions = interpolated(times, recording.tension_time, recording.tensions)
        window = dataclasses.replace(window, tensions=tensions.mean(axis=0))
    if not len(recording.displacement_time):
        return window
    read = np.full(recording.displacements.shape[1], np.nan)
    for tendon, column in enumerate(recording.displacements.T):
        if (known := np.isfinite(column)).any():
            at = recording.displacement_time[known]
            read[tendon] = interpolated(times, at, column[known]).mean()
    return dataclasses.replace(window, displacements=read)


def _unseen(recording: Recording) -> list[str]:
    """How often each marker was not seen, where one was not."""
    if recording.marker_s is None:
        return []
    missing = np.isnan(np.array(recording.frames)).any(axis=2).sum(axis=0)
    return [
        f'the marker at {s:g} m is not seen in {count} of {len(recording.frames)} frames'
        for s, count in zip(recording.marker_s, missing)
        if count
    ]


def _distance(times: FloatArray, samples: FloatArray) -> FloatArray:
    """Time from each of ``times`` to the nearest of ascending ``samples`` [s]."""
    return np.abs(times - samples[nearest(times, samples)])
