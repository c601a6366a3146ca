"""Steady windows: intervals of constant tensions, in which the arm has come to rest.

They also have the side from which they were reached, by loading or unloading. Without load cells,
lengths that winches have reeled in [m] replace tensions. A reading that a row does not have is
NaN, because each encoder may publish its own messages.
"""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, SolveError, TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import not_negative, positive
from octo_arm_model.config.config import Config
from octo_arm_model.rod.displacements import Wound, solve_displacements
from octo_arm_model.rod.solver import Solver

# The default tolerance is this part of the highest tension, or this multiple of the noise.
_PART = 0.02
_TIMES_NOISE = 4.0
# Standard deviation of normal noise over the median of its absolute values.
MAD = 1.4826
# Changes count as noise if at least the part _MOVED of readings differs from the previous one, at
# least _TURNED of these changes reverse, and noise is below _LARGEST of the highest reading.
_MOVED, _TURNED, _LARGEST = 0.05, 0.5, 0.05
_ROUNDING = 1e-12  # over the largest reading
_RAMP_PART = 0.05  # default width of the windows of a ramp, over the highest tension
MOST_WINDOWS = 1000  # windows of a ramp, and poses of a table
_APART = 0.49  # largest reach of the window of a pose, over the time to the next pose


@dataclass(frozen=True)
class SteadyRule:
    """Rule for steady tensions.

    A window lasts while no tension leaves a band of twice the ``tolerance`` and no gap between
    samples is longer than ``duration``. Neighbours whose means agree within the tolerance are
    joined if less than ``duration`` is between them. A window begins and ends within half the
    tolerance of its median, which excludes ramps, and must last ``duration``; its first ``settle``
    seconds do not count, because the arm is still coming to rest.

    Raises:
        ArmDefinitionError: if a value is impossible.
    """

    #: tolerance [N]; None for the larger of 2 percent of the highest tension and four times the
    #: noise, which is estimated from differences of neighbouring samples
    tolerance: float | None = None
    duration: float = 1.0  #: least duration of a window [s]
    settle: float = 0.5  #: time until the arm is at rest [s]

    def __post_init__(self) -> None:
        """Validate."""
        if self.tolerance is not None:
            positive('--steady: steady tolerance', self.tolerance, 'N')
        positive('--hold: steady duration', self.duration, 's')
        not_negative('--settle: settling time', self.settle, 'time', 's')

    def tolerance_for(self, tensions: FloatArray) -> float:
        """Return the tolerance [N] for a recording of ``tensions`` (n, tendons) [N]."""
        if self.tolerance is not None:
            return self.tolerance
        noise = _TIMES_NOISE * reading_noise(tensions)
        return max(_PART * float(np.abs(held_readings(tensions)).max()), noise, 1e-9)


def reading_noise(tensions: FloatArray) -> float:
    """Return the largest standard deviation of a reading of ``tensions`` (n, tendons) [N].

    It is estimated from the differences of neighbouring readings, which have the noise of both.
    Noise changes readings often and in both directions: at least one of twenty readings differs
    from the previous one, and half of these changes are followed by one of the other sign (two of
    three for white noise). Equal readings are ignored: they come from a slack tendon, or are
    repeated until the next reading of the cell. Noise is at most a twentieth of the highest
    reading of all tendons. Otherwise the tension itself changes, and the noise is 0. The noise of
    a load cell with coarse steps has the size of a step if its readings change that often.
    """
    columns = [column[np.isfinite(column)] for column in tensions.T]
    most = _LARGEST * max((float(np.abs(one).max(initial=0.0)) for one in columns), default=0.0)
    largest = 0.0
    for readings in columns:
        steps = np.diff(readings)
        # Readings that differ only by rounding count as equal.
        is_other = np.abs(steps) > _ROUNDING * np.abs(readings).max(initial=0.0)
        turned = np.diff(np.signbit(steps[is_other]))
        if turned.size and is_other.mean() >= _MOVED and turned.mean() >= _TURNED:
            noise = MAD / np.sqrt(2.0) * float(np.median(np.abs(steps[is_other])))
            largest = max(largest, noise if noise <= most else 0.0)
    return largest


def held_readings(rows: FloatArray) -> FloatArray:
    """Return ``rows`` (n, tendons) with each NaN replaced by the last, or else first, reading.

    A column without any reading is zero.
    """
    known = np.isfinite(rows)
    if known.all():
        return rows
    last = np.maximum.accumulate(np.where(known, np.arange(len(rows))[:, np.newaxis], -1), axis=0)
    first = known.argmax(axis=0)
    held = np.take_along_axis(rows, np.where(last < 0, first, last), axis=0)
    return np.where(known.any(axis=0), held, 0.0)


@dataclass(frozen=True)
class Window:
    """An interval of a recording with steady tensions, without its settling time."""

    start: float  #: time of its start [s]
    stop: float  #: time of its end [s]
    tensions: FloatArray  #: mean of each tension (tendons,) [N]
    noise: FloatArray  #: standard deviation of each tension (tendons,) [N]
    #: mean reading of each encoder (tendons,) [m], NaN without a reading; None without encoders
    displacements: FloatArray | None = None
    is_driven: bool = False  #: whether tensions were not read, but follow from ``displacements``


def steady_windows(time: FloatArray, tensions: FloatArray, rule: SteadyRule) -> list[Window]:
    """Return the steady windows of ``tensions`` (n, tendons) [N] at ascending ``time`` (n,) [s].

    There are none if the usual change from one row to the next exceeds the band of a window: rows
    that agree then do so by chance, and nothing was steady.
    """
    if not len(time):
        return []
    band = 2.0 * rule.tolerance_for(tensions)
    tensions = held_readings(tensions)
    changes = np.abs(np.diff(tensions, axis=0)).max(axis=1, initial=0.0)
    if changes.size and np.median(changes) > band:
        return []
    gap = _longest_gap(time, rule.duration)
    ranges: list[tuple[int, int]] = []
    for first, stop in _bands(time, tensions, band, gap):
        if time[stop - 1] - time[first] >= rule.duration:
            # Two windows that only a glitch separates are one step.
            is_one = False
            if ranges and time[first] - time[ranges[-1][1] - 1] < rule.duration:
                before = tensions[slice(*ranges[-1])].mean(axis=0)
                changed = np.abs(before - tensions[first:stop].mean(axis=0))
                is_one = bool((changed <= 0.5 * band).all())
            ranges.append((ranges.pop()[0] if is_one else first, stop))
    windows = [_window(time, tensions, samples, band, rule) for samples in ranges]
    return [window for window in windows if window is not None]


def ramp_windows(time: FloatArray, tensions: FloatArray, width: float | None) -> list[Window]:
    """Return windows of slowly changing ``tensions`` (n, tendons) [N], each within a band.

    This is for quasi-static recordings, in which the arm is always in equilibrium. A window ends,
    and the next begins, when a tension leaves its band of ``width`` [N], by default a twentieth of
    the highest tension, or eight times the noise.

    Raises:
        ArmDefinitionError: if the width is not > 0.
        MeasurementError: if there are too many windows.
    """
    if width is None:
        noise = 2.0 * SteadyRule().tolerance_for(tensions) if len(time) > 1 else 0.0
        highest = float(np.abs(held_readings(tensions)).max(initial=0.0))
        width = max(highest * _RAMP_PART, noise, 1e-9)
    positive('--ramp', width, 'N')
    tensions = held_readings(tensions)
    gap = _longest_gap(time, 1.0)
    windows: list[Window] = []
    for first, stop in _bands(time, tensions, width, gap):
        if len(windows) == MOST_WINDOWS:
            raise MeasurementError(
                f'more than {MOST_WINDOWS} windows of {width:g} N, expected a wider --ramp'
            )
        part = tensions[first:stop]
        ends = float(time[first]), float(time[stop - 1])
        windows.append(Window(*ends, part.mean(axis=0), np.zeros(tensions.shape[1])))
    return windows


def pose_windows(time: FloatArray, tensions: FloatArray, tolerance: float) -> list[Window]:
    """Return the windows of a table of static poses with ``tensions`` (n, tendons) [N].

    Each reaches ``tolerance`` [s] to both sides of its stamp, or nearly halfway to the next pose.

    Raises:
        MeasurementError: if there are too many poses, or two of the same time.
    """
    if len(time) > MOST_WINDOWS:
        raise MeasurementError(f'{len(time)} poses, expected at most {MOST_WINDOWS}')
    gaps = np.diff(time)
    if not gaps.all():
        same = float(time[int(gaps.argmin())])
        raise MeasurementError(
            f'two rows of tensions at {same:g} s, expected another time for each pose'
        )
    reach = min(tolerance, _APART * float(gaps.min(initial=np.inf)))
    return [
        Window(float(at) - reach, float(at) + reach, row, np.zeros(row.size))
        for at, row in zip(time, held_readings(tensions))
    ]


def _window(
    time: FloatArray, tensions: FloatArray, samples: tuple[int, int], band: float, rule: SteadyRule
) -> Window | None:
    """Return the window of the range ``samples`` without ramps at its ends; None if too short."""
    inside = np.arange(*samples)
    away = np.abs(tensions[inside] - np.median(tensions[inside], axis=0)).max(axis=1)
    near = inside[away <= 0.25 * band]
    if near.size:
        kept = slice(near[0] - samples[0], near[-1] + 1 - samples[0])
        inside, away = inside[kept], away[kept]
    settled = time[inside] >= time[inside[0]] + rule.settle
    # A glitch between two joined windows is left out.
    taken = inside[settled & (away <= band)]
    if time[inside[-1]] - time[inside[0]] < rule.duration or not taken.size:
        return None
    mean, noise = tensions[taken].mean(axis=0), tensions[taken].std(axis=0)
    return Window(float(time[taken[0]]), float(time[taken[-1]]), mean, noise)


def _longest_gap(time: FloatArray, least: float) -> float:
    """Return the longest gap within a window: five times the usual one, or ``least`` [s]."""
    return max(least, 5.0 * float(np.median(np.diff(time)))) if len(time) > 1 else least


def _bands(
    time: FloatArray, tensions: FloatArray, band: float, gap: float
) -> Iterator[tuple[int, int]]:
    """Yield the ranges of samples, each as long as it is within a band and without a gap."""
    first, low, high = 0, tensions[:1], tensions[:1]
    for number in range(1, len(time)):
        low, high = np.minimum(low, tensions[number]), np.maximum(high, tensions[number])
        if time[number] - time[number - 1] > gap or (high - low > band).any():
            yield first, number
            first, low, high = number, tensions[number], tensions[number]
    if len(time):
        yield first, len(time)


def by_length(windows: Sequence[Window], config: Config) -> list[Window]:
    """Return windows of constant lengths with their tensions on the arm of ``config``.

    Args:
        windows: windows with ``displacements``; their tensions are not used.
        config: the arm as known so far. A tendon without an encoder is slack, and one with
            friction slides from window to window, and to the first from slack.

    Raises:
        SolveError: if lengths of a window cannot be held.
    """
    lengths = [window.displacements for window in windows if window.displacements is not None]
    wound = wound_at(config.solver('exact'), lengths)
    found: list[Window] = []
    for window in windows:
        try:
            tensions = next(wound).backbone.tensions.ravel()
        except (SolveError, TensionError) as error:
            raise SolveError(
                f'lengths held from {window.start:.3f} to {window.stop:.3f} s: {error}'
            ) from error
        noise = np.zeros(tensions.size)
        found.append(dataclasses.replace(window, tensions=tensions, noise=noise, is_driven=True))
    return found


def wound_at(solver: Solver, lengths: Iterable[FloatArray]) -> Iterator[Wound]:
    """Solve for ``lengths`` reeled in (tendons,) [m] one after the other, NaN for free tendons.

    Raises:
        OctoArmError: if lengths cannot be held.
    """
    last: Wound | None = None
    for row in lengths:
        pairs = zip(solver.arm.tendon_names, row.tolist(), strict=True)
        held = {name: length for name, length in pairs if math.isfinite(length)}
        last = solve_displacements(solver, held, start=last)
        yield last


LOADING, UNLOADING, MIXED, REST = 'loading', 'unloading', 'mixed', 'rest'
# Changes below this part of the highest tension do not count.
CHANGE = 0.02


def directions(tensions: FloatArray) -> list[str]:
    """Return the direction of each step of ``tensions`` (steps, tendons) [N], in order of time.

    It is 'loading' if tensions have only risen since the previous step, or since rest, 'unloading'
    if they have only fallen, and 'mixed' if some rose and others fell. A step with the same
    tensions has the direction of the previous one, or 'rest' if there is none.
    """
    band = CHANGE * float(tensions.max(initial=0.0))
    found: list[str] = []
    before = np.zeros(tensions.shape[-1])
    for pulled in tensions:
        rose, fell = bool((pulled - before > band).any()), bool((before - pulled > band).any())
        if rose or fell:
            found.append(MIXED if rose and fell else LOADING if rose else UNLOADING)
        else:
            found.append(found[-1] if found else REST)
        before = pulled
    return found
