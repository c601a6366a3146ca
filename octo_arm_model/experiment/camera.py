"""The camera: its pose, the offset of its clock, and its frames compared with estimates.

The pose is the rigid motion from the frame of the camera to base_frame. The offset of the clock
follows from the motion of the tip and the tensions. Friction of tendons also delays the tip, which
stays behind after each reversal of a tension. But friction keeps it behind at rest too, where an
offset of the clock has no effect. The tips are therefore fitted to the model's tips with and
without friction at once, so that friction is not mistaken for an offset.
"""

import contextlib
import dataclasses
import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import MeasurementError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.experiment.midlines import Curve, midline_errors
from octo_arm_model.experiment.recording import Recording
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver
from octo_arm_model.rod.stations import interpolated

# Points lie on a line or plane if they are within this multiple of their noise, or within this
# part of their extent.
_TIMES_NOISE = 3.0
_FLAT = 1e-4
RANGE = 2.0  # [s] offsets of clocks that are set, either way
_STEP = 0.01  # [s] between offsets
# [s] offsets of clocks that were started by hand, either way, and the steps between these.
FARTHEST, _COARSE = 30.0, 0.1
_STATIONS = 31
# Largest number of tensions that are solved, and of frames that are used.
_SAMPLES = 5000
# Largest residual of the best offset over the median of all; above it no offset is clear.
_CLEAR = 0.5
# Part of the tension lost to friction, well above the noise of load cells. Other friction differs
# from this mostly in size, which is fitted.
_PLAY = 0.1
_STIFFER = 0.7  # part of the tensions that bends the arm like all of them a stiffer arm
_KEPT = 0.9  # fraction of the frames that count: the worst may be outliers
_FRAMES = 30  # fewest frames: three for each of the ten coefficients of a coordinate of the tips
LONGEST = 0.1  # [s] between a frame and the estimate that it is compared with
_OUTLYING = 3.0  # outliers of a fitted alignment are this many median distances away
_FITS = 4  # fits of the alignment, each without the outliers of the previous one


def undetermined(points: FloatArray, noise: float) -> tuple[str, ...]:
    """Describe the degrees of freedom of a fitted alignment that ``points`` (n, 3) leave open.

    ``noise`` is the root mean square distance of the fit [m]: points that close to a line or a
    plane cannot be distinguished from points on it.
    """
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[0] == 0.0:
        return ('all measured points are one: the alignment has no rotation',)
    # The square of a coordinate is on average a third of that of a distance.
    flat = max(_TIMES_NOISE * noise * np.sqrt(len(points) / 3.0), _FLAT * spread[0])
    within = f'within {_TIMES_NOISE:g} times their misfit of {1e3 * noise:.3g} mm '
    if spread[1] <= flat:
        return (f'all measured points lie {within}on a line: the rotation about it is open',)
    if spread[2] <= flat:
        return (
            f'all measured points lie {within}in a plane: the fitted alignment cannot tell the '
            'arm from its mirror image',
        )
    return ()


def clock_offset(
    arm: Arm,
    tension_time: FloatArray,
    tensions: FloatArray,
    frame_time: FloatArray,
    tips: FloatArray,
) -> float | None:
    """Return the offset [s] of ``frame_time`` (f,) at which ``tips`` (f, 3) agree with tensions.

    The model closed_form gives tips under ``tensions`` (n, tendons) [N] at ``tension_time`` (n,),
    under a part of them, and under tensions with friction. For each offset up to `RANGE` an affine
    function of these is fitted to the measured tips; the offset with the least residual is taken,
    or of equally good ones that nearest to zero. A larger one has to be clearly better, because a
    staircase resembles itself one step later. The affine function absorbs the pose of the camera,
    a wrong modulus, most of the model's error and the size of the friction. A delay of the arm
    counts as an offset of the clock.

    Returns:
        The offset; None if no minimum is clear, as for an arm at rest, or if there are so few
        frames that the function fits them at any offset.
    """
    if len(tips) < _FRAMES:
        return None
    rows = np.linspace(0, len(tensions) - 1, min(len(tensions), _SAMPLES)).astype(int)
    plain = dataclasses.replace(arm, friction=(), sheath_stiffness=())
    stations = max(_STATIONS, len(arm.sections) + 2)
    solver = Solver(plain, 'closed_form', stations, Pose(), compiled=None)
    try:
        tips_of = [
            solver.solve(scaled[rows].reshape(-1, *arm.tension_shape)).tip
            for scaled in (tensions, _STIFFER * tensions, _with_friction(tensions))
        ]
    except SolveError:
        return None
    expected = np.concatenate(tips_of, axis=1)
    frames = np.linspace(0, len(tips) - 1, min(len(tips), _SAMPLES)).astype(int)
    times, tips = frame_time[frames], tips[frames]
    known = tips, tension_time[rows], expected

    def misfits_at(offsets: FloatArray) -> FloatArray:
        return np.array([_residual(times + offset, *known) for offset in offsets])

    offsets, coarse = (
        np.arange(-end, end + 0.5 * step, step)
        for end, step in ((RANGE, _STEP), (FARTHEST, _COARSE))
    )
    misfits, far = misfits_at(offsets), misfits_at(coarse)
    usual = np.median(misfits)
    if far.min() < _CLEAR * misfits.min():
        offsets = coarse[far.argmin()] + np.arange(-_COARSE, _COARSE + 0.5 * _STEP, _STEP)
        misfits, usual = misfits_at(offsets), np.median(far)
    best = int(misfits.argmin())
    if best in (0, len(misfits) - 1) or misfits[best] >= _CLEAR * usual:
        return None
    # If frames show the arm only at rest, a range of offsets is equally good within noise, by
    # which the mean square of n frames scatters by some 1/n.
    bound = (1.0 + 1.0 / len(times)) * misfits[best] + 1e-12 * misfits.max()
    equal = np.flatnonzero(misfits <= bound)
    return round(float(offsets[equal[np.abs(offsets[equal]).argmin()]]), 3)


def _with_friction(tensions: FloatArray) -> FloatArray:
    """Return ``tensions`` (n, tendons) [N] behind friction that takes the part `_PLAY` of them.

    This is the play operator: the transmitted tension is constant while it differs from the given
    one by less than this part, and otherwise follows it at that distance.
    """
    ends = zip((1.0 - _PLAY) * tensions, (1.0 + _PLAY) * tensions)
    none = np.zeros(tensions.shape[1])
    held = itertools.accumulate(ends, lambda last, end: np.clip(last, *end), initial=none)
    return np.array([*held][1:])


def _residual(
    times: FloatArray, tips: FloatArray, tension_time: FloatArray, expected: FloatArray
) -> float:
    """Return the mean squared residual of ``tips`` at ``times``, without the worst [m^2]."""
    at = interpolated(times, tension_time, expected)
    regressors = np.column_stack([np.ones(len(times)), at])
    kept = np.arange(len(times))
    for _ in range(2):  # outliers have no effect on the second fit
        coefficients = np.linalg.lstsq(regressors[kept], tips[kept], rcond=1e-9)[0]
        squares = ((tips - regressors @ coefficients) ** 2).sum(axis=1)
        kept = squares.argsort()[: max(1, int(_KEPT * len(squares)))]
    return float(squares[kept].mean())


@dataclass(frozen=True)
class CameraErrors:
    """Distances between midlines and shapes with and without the estimator, each (frames,) [m]."""

    time: FloatArray  #: times of the compared frames [s]
    tip: tuple[FloatArray, FloatArray]  #: distances of the tip, with the estimator and without it
    #: mean distances of the midline, with the estimator and without it; NaN for tips
    mean: tuple[FloatArray, FloatArray]


class CameraCheck:
    """Compares the frames of a camera with the estimates nearest in time.

    Attributes:
        topic: topic of the frames.
    """

    def __init__(
        self,
        topic: str,
        recording: Recording,
        offset: float,
        lines: Sequence[FloatArray],
        alignment: Pose | None,
        solver: Solver,
    ) -> None:
        """Compare with the ``lines`` of a ``recording`` of a ``topic``, from the base on.

        They are in the camera's frame. ``offset`` [s] is added to their stamps; an ``alignment``
        of None is fitted. The shape without the estimator is that of ``solver`` under the
        measured tensions.

        Raises:
            MeasurementError: if an alignment is to be fitted to tips.
        """
        if alignment is None and any(len(line) < 2 for line in lines):
            raise MeasurementError(
                'tips alone do not tell the pose of the camera, expected --align with its pose'
            )
        self._time, self._lines = recording.frame_time + offset, lines
        self._alignment, self._solver, self._recording = alignment, solver, recording
        self.topic, self._next = topic, 0
        self._last: tuple[float, FloatArray] | None = None
        self._pairs: list[tuple[int, FloatArray]] = []

    def add(self, time: float, shape: Backbone) -> None:
        """Compare the ``shape`` estimated at ``time`` [s]; times must ascend."""
        new = time, shape.position
        last = self._last or new
        while self._next < len(self._time) and self._time[self._next] <= time:
            at = self._time[self._next]
            near = last if at - last[0] < time - at else new
            if abs(near[0] - at) <= LONGEST:
                self._pairs.append((self._next, near[1]))
            self._next += 1
        self._last = new

    def errors(self) -> CameraErrors | None:
        """Return the errors of all frames with an estimate; None if there are none."""
        found: list[tuple[int, FloatArray, FloatArray]] = []
        last: Backbone | None = None
        measured = self._recording.tension_time, np.maximum(self._recording.tensions, 0.0)
        for number, position in self._pairs:
            tensions = interpolated(self._time[number], *measured)
            with contextlib.suppress(SolveError):
                last = self._solver.follow(tensions.reshape(self._solver.arm.tension_shape), last)
                found.append((number, position, last.position))
        if not found:
            return None
        numbers, estimated, plain = zip(*found)
        lines = [self._lines[number] for number in numbers]
        pairs = (_distances(lines, shapes, self._alignment) for shapes in (estimated, plain))
        tips, means = zip(*pairs)
        return CameraErrors(self._time[[*numbers]], tips, means)


def _distances(
    lines: Sequence[FloatArray], shapes: Sequence[FloatArray], alignment: Pose | None
) -> tuple[FloatArray, FloatArray]:
    """Return the distances of the tip and the mean ones of midlines, each (frames,) [m]."""
    curves = list(map(Curve, shapes))
    alignment = alignment or aligned(lines, curves)
    pairs = zip(lines, curves, strict=True)
    errors = [midline_errors(alignment.to_base(line), curve) for line, curve in pairs]
    return np.array([error.tip for error in errors]), np.array([error.mean for error in errors])


def aligned(
    lines: Sequence[FloatArray],
    curves: Sequence[Curve],
    marker_fractions: Sequence[FloatArray] = (),
) -> Pose:
    """Return the rigid motion that brings ``lines`` nearest to ``curves``, without outliers.

    It minimises the sum of squared distances; the rotation about points on a line is arbitrary,
    which `undetermined` reports.
    Markers are paired with the points of the curves at ``marker_fractions`` of the lengths.
    Midlines are taken to begin at the base at first, and then paired with the nearest points.

    Raises:
        MeasurementError: if there are fewer than three points.
    """
    points = np.concatenate(lines)
    if len(points) < 3:
        raise MeasurementError(
            f'{len(points)} measured point(s), expected at least 3 to fit an alignment to'
        )
    fractions = marker_fractions or [
        np.linspace(0.0, 1.0, len(line)) if len(line) > 1 else np.ones(1) for line in lines
    ]
    kept, rounding = np.ones(len(points), dtype=bool), 1e-9 * curves[0].lengths[-1]
    for _ in range(_FITS):
        targets = np.concatenate(list(map(Curve.along, curves, fractions)))
        from_mean, to_mean = points[kept].mean(axis=0), targets[kept].mean(axis=0)
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', UserWarning)  # of points on a line
            turn, _ = Rotation.align_vectors(targets[kept] - to_mean, points[kept] - from_mean)
        alignment = Pose(tuple(to_mean - turn.apply(from_mean)), tuple(turn.as_quat()))
        distances = np.linalg.norm(alignment.to_base(points) - targets, axis=1)
        kept = distances <= _OUTLYING * np.median(distances) + rounding
        if not marker_fractions:
            fractions = [
                np.append(curve.nearest(alignment.to_base(line[:-1]))[1], 1.0)
                for line, curve in zip(lines, curves, strict=True)
            ]
    return alignment
