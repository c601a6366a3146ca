"""Turn a recording into the measured shapes of its steps of constant tension.

All frames of a step share the errors of the model and of the tensions, but not those of the
camera. Frames are therefore averaged and fits count steps: more frames make a step's midline more
accurate, but they are not independent observations. Markers are compared as points, never as a
curve through them; a marker that is not visible is NaN. If the arm moves each frame is a step.
"""

import dataclasses
import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from octo_arm_model.arm.errors import ConfigError, MeasurementError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.camera import FARTHEST, clock_offset
from octo_arm_model.experiment.midlines import is_tip_first, resample
from octo_arm_model.experiment.recording import Recording
from octo_arm_model.experiment.steady_windows import (
    SteadyRule,
    Window,
    by_length,
    held_readings,
    pose_windows,
    ramp_windows,
    steady_windows,
)
from octo_arm_model.rod.stations import interpolated, nearest

POINTS = 101  # points of a step's midline
_FINE = 401  # points that its length is measured with
# A frame is an outlier if it is this many times as far from the median as the median frame.
OUTLYING = 3.0
FLOOR = 1e-6  # [m], so that rounding does not make outliers
# With fewer frames outliers cannot be identified, and the median is used.
FEW = 5
_FEW_STEADY = 0.2  # part of the time that steps of a staircase exceed
MOST_FRAMES = 5000  # frames of an arm that moves
STEPS, RAMP, POSES, MOMENTS = 'steady steps', 'windows of a ramp', 'poses', 'moments of a motion'
_ELSE = (
    'where it changes slowly instead of in steps, say --ramp; where each row is a static pose, '
    'as in a table of poses, say --poses'
)
_APART = '--clock-offset is added to stamps of frames'


@dataclass(frozen=True)
class MeasuredShape:
    """Measured shape of one steady step."""

    window: Window  #: interval of the step, with its tensions
    #: mean midline from base to tip in the camera's frame, evenly along its length (`POINTS`, 3),
    #: or the tip (1, 3) [m]
    points: FloatArray
    frames: int  #: number of frames in the mean
    outliers: int  #: number of frames left out
    noise: float  #: root mean square distance of a frame from the mean [m]; 0 for one frame
    lines: tuple[FloatArray, ...] = ()  #: the midlines of all frames, including outliers
    #: arc coordinates of ``points`` if they are markers [m]; None for a midline
    s: FloatArray | None = None

    @property
    def tension(self) -> float:
        """The sum of all tensions [N]."""
        return float(self.window.tensions.sum())


def mean_shape(
    window: Window, frames: Sequence[FloatArray], s: FloatArray | None = None
) -> MeasuredShape | None:
    """Return the mean of ``frames`` (m, 3), or None if no point is visible in any.

    Frames are midlines from base to tip, tips of one point, or markers at ``s``. A frame is an
    outlier if its distance from the median of all is over three times that of the median frame.
    Each marker is judged by itself, by the larger of its own median distance and that of all.
    """
    fraction = np.linspace(0.0, 1.0, POINTS)
    is_line = s is None and len(frames[0]) > 1
    stack = np.array([resample(line, fraction) for line in frames] if is_line else frames)
    # Parts of a frame, (frames, parts, points, 3): each marker, or all points together.
    parts = stack[:, np.newaxis] if s is None else stack[:, :, np.newaxis]
    with warnings.catch_warnings():
        # The mean of a marker that no frame shows is NaN.
        warnings.simplefilter('ignore', RuntimeWarning)
        median = np.nanmedian(parts, axis=0)
        away = np.sqrt(((parts - median) ** 2).sum(axis=-1).mean(axis=-1))
        seen = np.isfinite(away)
        if not seen.any():
            return None
        # The tip moves more than the base; the distances of a base at rest are only rounding.
        usual = np.maximum(np.nanmedian(away, axis=0), np.median(away[seen]))
        enough = seen.sum(axis=0) >= FEW
        kept = seen & ~(enough & (away > OUTLYING * usual + FLOOR))
        known = np.where(kept[..., np.newaxis, np.newaxis], parts, np.nan)
        middle = np.where(enough[:, np.newaxis, np.newaxis], np.nanmean(known, axis=0), median)
        if is_line:
            # Points are spaced again: noise lengthens frames where points are dense, not the mean.
            fine = resample(middle[0], np.linspace(0.0, 1.0, _FINE))
            middle = resample(fine, fraction)[np.newaxis]
        noise = float(np.sqrt(np.nanmean(((known - middle) ** 2).sum(axis=-1).mean(axis=-1))))
    shown = seen.any(axis=0)
    return MeasuredShape(
        window,
        middle[shown].reshape(-1, 3),
        int(kept.any(axis=1).sum()),
        int((seen & ~kept).any(axis=1).sum()),
        noise,
        tuple(frame[np.isfinite(frame).all(axis=1)] for frame in frames),
        None if s is None else s[shown],
    )


@dataclass(frozen=True)
class Pairing:
    """Rules that pair frames with tensions."""

    steady: SteadyRule = field(default_factory=SteadyRule)  #: rule for steady tensions
    #: tolerance of stamps: a frame needs a sample of tensions within this time, and lies at least
    #: that far inside its window [s]
    tolerance: float = 0.1
    #: offset added to the stamps of frames [s]; None to find it from the motion
    offset: float | None = None
    #: 'first' or 'last' point of the midlines; None for the one that moves less
    base_end: str | None = None
    #: kind of the recording: `STEPS`, a `RAMP` of slowly changing tensions, a table of `POSES`, or
    #: `MOMENTS` of a motion
    kind: str = STEPS
    ramp_width: float | None = None  #: width of the windows of a ramp [N]; None for the default


@dataclass(frozen=True)
class Observations:
    """The shapes of a recording."""

    shapes: tuple[MeasuredShape, ...]  #: a shape for each steady step with frames
    offset: float  #: offset added to the stamps of frames [s]
    notes: tuple[str, ...]  #: the decisions made, in words


def observe(
    recording: Recording, pairing: Pairing = Pairing(), known: Pose | None = None
) -> Observations:
    """Return the shapes of the steps of ``recording``; ``known`` is the alignment, if known.

    Raises:
        ConfigError: if the arm moves and the alignment is not known: it is fitted to equilibria.
        MeasurementError: if neither end of the midlines is clearly the base, or if the arm moves
            and there are too many frames, or no load cells.
        SolveError: if there is no step with a frame.
    """
    notes = list(recording.notes)
    config = Config.from_parameters(recording.parameters)
    time, _ = recording.held
    what, kind = 'length' if recording.is_driven else 'tension', pairing.kind
    windows = _windows(recording, pairing, known, what)
    frames = base_first(recording, pairing, config, known, notes)
    offset = camera_offset(recording, pairing, config, frames, notes)
    seen = recording.frame_time + offset
    usable = np.abs(seen - time[nearest(seen, time)]) <= pairing.tolerance
    if kind == MOMENTS:
        usable &= (seen >= time[0]) & (seen <= time[-1])
        none = np.zeros(len(config.arm.tendons))
        windows = [Window(at, at, none, none) for at in np.unique(seen[usable]).tolist()]
    paired: list[tuple[Window, list[FloatArray]]] = []
    margin = pairing.tolerance if kind == STEPS else 0.0
    for window in windows:
        inside = usable & (seen >= window.start + margin) & (seen <= window.stop - margin)
        if inside.any():
            at = seen[inside] if kind in (RAMP, MOMENTS) else None
            window = _read_in(window, at, recording)
            paired.append((window, list(itertools.compress(frames, inside))))
    if recording.is_driven:
        followed = by_length([window for window, _ in paired], config)
        paired = [(window, shown) for window, (_, shown) in zip(followed, paired, strict=True)]
        notes.append(
            'no load cells: tensions follow from the lengths that winches reeled in, by the arm '
            'as the config has it'
        )
        if not any(window.tensions.any() for window in followed):
            notes.append(
                'no tendon is taut in any step: the sign of displacement_scale, or '
                'displacement_offset, does not fit the readings'
            )
    seen_in = [(mean_shape(*pair, recording.marker_s), len(pair[1])) for pair in paired]
    shapes = [shape for shape, _ in seen_in if shape is not None]
    used = sum(count for shape, count in seen_in if shape is not None)
    if not shapes:
        within = ' has'
        if kind != MOMENTS:
            ends = f'{windows[0].start:.3f} to {windows[-1].stop:.3f} s'
            within = f' lies in one of {len(windows)} {kind} from {ends} with'
        is_apart = seen[0] > time[-1] or seen[-1] < time[0]
        raise SolveError(
            f'nothing to compare: none of {len(frames)} frames from {seen[0]:.3f} to '
            f'{seen[-1]:.3f} s{within} {what}s within {pairing.tolerance:g} s; '
            + (_ELSE if kind == STEPS and not is_apart else _APART)
        )
    notes.append(
        f'{len(windows)} {kind}, {len(shapes)} of them with frames: {used} of {len(frames)} used'
    )
    share = sum(window.stop - window.start for window in windows) / max(np.ptp(time), 1e-9)
    if kind == STEPS and share < _FEW_STEADY:
        notes.append(f'{what}s are steady in {100.0 * share:.0f} % of the time: {_ELSE}')
    if kind == MOMENTS:
        notes.append('the arm moves from rest at the first tensions on')
    return Observations(
        tuple(shapes), offset, (*notes, *recording.refusals.lines(), *_unseen(recording))
    )


def _windows(
    recording: Recording, pairing: Pairing, known: Pose | None, what: str
) -> list[Window]:
    """Return the windows of a recording; none for a motion, which has one for each frame.

    SolveError if nothing is steady; ConfigError or MeasurementError if it is no motion.
    """
    (time, sampled), rule = recording.held, pairing.steady
    if pairing.kind == MOMENTS:
        if known is None:
            raise ConfigError(
                'the alignment of an arm that moves is not fitted: --align is expected to be '
                "'none' or a pose, as compare or identify finds it where the arm is at rest"
            )
        if recording.is_driven:
            raise MeasurementError('there are no tensions in this recording, expected load cells')
        if (count := len(recording.frames)) > MOST_FRAMES:
            raise MeasurementError(
                f'{count} frames of an arm that moves, expected at most {MOST_FRAMES}'
            )
        return []
    if pairing.kind == POSES:
        windows = pose_windows(time, sampled, pairing.tolerance)
    elif pairing.kind == RAMP:
        windows = ramp_windows(time, sampled, pairing.ramp_width)
    else:
        windows = steady_windows(time, sampled, rule)
    if not windows:
        unit = 'm' if recording.is_driven else 'N'
        raise SolveError(
            f'nothing to compare: no {what} stays within {rule.tolerance_for(sampled):.3g} {unit} '
            f'for {rule.duration:g} s, and beyond the first {rule.settle:g} s; {_ELSE}'
        )
    return windows


def base_first(
    recording: Recording, pairing: Pairing, config: Config, known: Pose | None, notes: list[str]
) -> Sequence[FloatArray]:
    """Return the midlines of a ``recording`` from base to tip, and add the reason to ``notes``."""
    if recording.is_tips or recording.marker_s is not None:
        return recording.frames
    tip_first, why = pairing.base_end == 'last', 'by --base-end'
    if pairing.base_end is None:
        base = known.from_base(np.array(config.base.position)) if known is not None else None
        tip_first, why = is_tip_first(recording.frames, base)
    notes.append(f'midlines run from {"tip to base" if tip_first else "base to tip"}: {why}')
    return [points[::-1] for points in recording.frames] if tip_first else recording.frames


def camera_offset(
    recording: Recording,
    pairing: Pairing,
    config: Config,
    frames: Sequence[FloatArray],
    notes: list[str],
) -> float:
    """Return the offset of the camera's clock [s], given or estimated; ``notes`` say which."""
    if pairing.offset is not None:
        return pairing.offset
    why = None
    if pairing.kind == POSES:
        why = 'the stamps say which frames show which pose'
    elif pairing.kind == MOMENTS:
        why = 'that of an arm that moves is not looked for'
    elif recording.is_driven:
        why = 'without load cells it is not looked for'
    else:
        tips = np.array([points[-1] for points in frames])
        seen = np.isfinite(tips).all(axis=1)
        if seen.any():
            held, at = (recording.tension_time, recording.tensions), recording.frame_time[seen]
            if (found := clock_offset(config.arm, *held, at, tips[seen])) is not None:
                notes.append(
                    f'clock offset {found:+.2f} s on the stamps of frames, found from the motion'
                )
                return found
        why = f'the motion does not clearly tell one within {FARTHEST:g} s'
    notes.append(f'clock offset taken as 0 s: {why}')
    return 0.0


def _read_in(window: Window, times: FloatArray | None, recording: Recording) -> Window:
    """Return the ``window`` with the mean reading of each encoder in it, NaN if there is none.

    With ``times`` of frames [s], means are those of readings and tensions at these times. Without
    load cells, an encoder without a reading in the window keeps its last one.
    """
    time, read = recording.displacement_time, recording.displacements
    if times is not None:
        if not recording.is_driven:
            tensions = interpolated(times, recording.tension_time, recording.tensions)
            window = dataclasses.replace(window, tensions=tensions.mean(axis=0))
        known = np.isfinite(read)
        columns = (
            interpolated(times, time[at], column[at]) if at.any() else np.full(1, np.nan)
            for at, column in zip(known.T, read.T, strict=True)
        )
        means = np.array([column.mean() for column in columns])
        return dataclasses.replace(window, displacements=means) if len(time) else window
    if recording.is_driven:
        read = np.where(np.isfinite(read).any(axis=0), held_readings(read), np.nan)
    inside = (time >= window.start) & (time <= window.stop)
    if not inside.any():
        return window
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', RuntimeWarning)  # of columns without a reading
        return dataclasses.replace(window, displacements=np.nanmean(read[inside], axis=0))


def _unseen(recording: Recording) -> list[str]:
    """Return a sentence for each marker that some frames do not show."""
    if recording.marker_s is None:
        return []
    missing = np.isnan(np.array(recording.frames)).any(axis=2).sum(axis=0)
    return [
        f'the marker at {s:g} m is not seen in {count} of {len(recording.frames)} frames'
        for s, count in zip(recording.marker_s, missing)
        if count
    ]
