"""The camera: where it is, how its clock is off, and estimates against what it saw.

Its pose is the rigid motion from its frame to base_frame. The offset of its clock follows from the
motion of the tip and the tensions. Where tendons rub, the tip comes late as well: after each
reversal of a tension it stays behind. But friction keeps it behind at rest too, where an offset of
the clock does nothing. So the tip is compared with the model's under the tensions and under what
friction would make of them, both at once: what friction explains no offset is needed for.
"""

import dataclasses
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
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

# Points within so many times their noise of a line or plane, or within this part of their extent,
# lie in it.
_TIMES_NOISE = 3.0
_FLAT = 1e-4
RANGE = 2.0  # [s] searched either way
_STEP = 0.01  # [s]
_STATIONS = 31
# Tensions solved, and frames used, at most.
_SAMPLES = 5000
# Residual of the best offset over the median of all: above this no offset is clear.
_CLEAR = 0.5
# Part of the tension that friction takes: well above the noise of load cells. What other friction
# does differs from this mostly in size, which is fitted.
_PLAY = 0.1
_STIFFER = 0.7  # part of the tensions, under which the arm is as under all if it were stiffer
_KEPT = 0.9  # fraction of the frames: the worst may be outliers
_FRAMES = 30  # at least: three for each of the ten numbers that fit a coordinate of the tips
LONGEST = 0.1  # [s] from a frame to the next estimate
_OUTLYING = 3.0  # times the median distance: what is left out of a fitted alignment
_FITS = 4  # of the alignment, each without the outliers of the one before


@dataclass(frozen=True)
class Alignment:
    """The transform camera to base: position_in_base = R position_in_camera + shift.

    Attributes:
        turn: rotation vector of R [rad], (3,).
        shift: where the camera's origin lies in base_frame [m], (3,).
    """

    turn: FloatArray
    shift: FloatArray

    @classmethod
    def none(cls) -> 'Alignment':
        """The identity, for a camera whose frame is base_frame."""
        return cls(np.zeros(3), np.zeros(3))

    @classmethod
    def from_pose(cls, pose: Pose) -> 'Alignment':
        """From the pose of the camera in base_frame."""
        turn = Rotation.from_quat(np.array(pose.quaternion)).as_rotvec()
        return cls(turn, np.array(pose.position))

    @property
    def rotation(self) -> FloatArray:
        """The rotation R, (3, 3)."""
        return Rotation.from_rotvec(self.turn).as_matrix()

    @property
    def quaternion(self) -> FloatArray:
        """The rotation as x, y, z, w."""
        return Rotation.from_rotvec(self.turn).as_quat()

    def to_base(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of the camera's frame in base_frame [m]."""
        return points @ self.rotation.T + self.shift

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Points (..., 3) of base_frame in the camera's frame [m]."""
        return (points - self.shift) @ self.rotation

    def as_dict(self) -> dict[str, list[float]]:
        """Position [m] and quaternion x, y, z, w, ready for JSON."""
        return {'position': self.shift.tolist(), 'quaternion': self.quaternion.tolist()}


def align(camera: FloatArray, base: FloatArray, weight: ArrayLike = 1.0) -> Alignment:
    """The rigid motion that brings points ``camera`` (n, 3) nearest to ``base`` (n, 3).

    In the least squares sense, each with its ``weight``. For points on a line the rotation about
    it is undetermined and arbitrary; see `undetermined`.
    """
    weight = np.broadcast_to(np.asarray(weight, dtype=np.float64), (len(camera),))
    from_mean, to_mean = (np.average(points, 0, weight) for points in (camera, base))
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', UserWarning)  # of points on a line
        turn, _ = Rotation.align_vectors(base - to_mean, camera - from_mean, weight)
    return Alignment(turn.as_rotvec(), to_mean - turn.apply(from_mean))


def undetermined(points: FloatArray, noise: float) -> tuple[str, ...]:
    """Degrees of freedom of a fitted alignment that ``points`` (n, 3) leave open, in words.

    ``noise`` is the root mean square distance that the fit leaves [m]: what is within it of a line
    or a plane cannot be distinguished from one.
    """
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[0] == 0.0:
        return ('all measured points are one: the alignment has no rotation',)
    # A coordinate has a third of the square of a distance.
    flat = max(_TIMES_NOISE * noise * np.sqrt(len(points) / 3.0), _FLAT * spread[0])
    within = f'within {_TIMES_NOISE:g} times their noise '
    if spread[1] <= flat:
        return (f'all measured points lie {within}on a line: the rotation about it is open',)
    if spread[2] <= flat:
        return (
            f'all measured points lie {within}in a plane: the alignment cannot tell a picture '
            'from its mirror image, seen from the other side of the plane',
        )
    return ()


def clock_offset(
    arm: Arm,
    tension_time: FloatArray,
    tensions: FloatArray,
    frame_time: FloatArray,
    tips: FloatArray,
) -> float | None:
    """Seconds to add to ``frame_time`` (f,) so that ``tips`` (f, 3) agree with the tensions.

    For each offset up to `RANGE` an affine function of the tips of the model closed_form, under
    ``tensions`` (n, tendons) at ``tension_time`` (n,), under a part of these and under these
    `_rubbed`, is fitted to the tips; the offset of least residual is taken, or the one nearest to
    zero of those that do as well. The affine function absorbs the pose of the camera, a wrong
    modulus, most of the model's error and the size of the friction. A lag of the arm in time
    counts as an offset of the clock.

    Returns:
        The offset; None where no minimum is clear, as for an arm at rest, or frames are so few
        that the function passes near them at any offset.
    """
    if len(tips) < _FRAMES:
        return None
    some = np.linspace(0, len(tensions) - 1, min(len(tensions), _SAMPLES)).astype(int)
    plain = dataclasses.replace(arm, friction=(), sheath_stiffness=())
    stations = max(_STATIONS, len(arm.sections) + 2)
    solver = Solver(plain, 'closed_form', stations, Pose(), compiled=None)
    try:
        tips_of = [
            solver.solve(pulled[some].reshape(-1, *arm.tension_shape)).tip
            for pulled in (tensions, _STIFFER * tensions, _rubbed(tensions))
        ]
    except SolveError:
        return None
    expected = np.concatenate(tips_of, axis=1)
    seen = np.linspace(0, len(tips) - 1, min(len(tips), _SAMPLES)).astype(int)
    times, tips = frame_time[seen], tips[seen]
    offsets = np.arange(-RANGE, RANGE + 0.5 * _STEP, _STEP)
    shifted = (times + offset for offset in offsets)
    left = np.array([_residual(one, tips, tension_time[some], expected) for one in shifted])
    best = int(left.argmin())
    if best in (0, len(left) - 1) or left[best] >= _CLEAR * np.median(left):
        return None
    # Where frames show the arm at rest alone a range of offsets does equally well: as far as noise
    # tells, by which the mean square of n frames scatters by some 1/n.
    equal = np.flatnonzero(left <= (1.0 + 1.0 / len(times)) * left[best] + 1e-12 * left.max())
    return round(float(offsets[equal[np.abs(offsets[equal]).argmin()]]), 3)


def _rubbed(tensions: FloatArray) -> FloatArray:
    """The ``tensions`` (n, tendons) [N] left where friction takes the part `_PLAY` of them.

    The play operator: the tension that arrives stays while it is within this part of that given,
    and is drawn along at its edge.
    """
    arrives = np.empty_like(tensions)
    last = np.zeros(tensions.shape[1])
    lows, highs = (1.0 - _PLAY) * tensions, (1.0 + _PLAY) * tensions
    for row, low, high in zip(arrives, lows, highs):
        last = np.minimum(np.maximum(last, low), high)
        row[:] = last
    return arrives


def _residual(
    times: FloatArray, tips: FloatArray, tension_time: FloatArray, expected: FloatArray
) -> float:
    """Mean squared residual of ``tips`` at ``times``, without the worst frames [m^2]."""
    at = interpolated(times, tension_time, expected)
    regressors = np.column_stack([np.ones(len(times)), at])
    found = np.linalg.lstsq(regressors, tips, rcond=1e-9)[0]
    squares = np.sort(((tips - regressors @ found) ** 2).sum(axis=1))
    return float(squares[: max(1, int(_KEPT * len(squares)))].mean())


@dataclass(frozen=True)
class CameraErrors:
    """Distances between midlines and shapes, each (compared frames,) [m].

    Attributes:
        time: of the frames [s].
        tip: of the tip; by the estimator, and without it.
        mean: mean of the midline, likewise; NaN of tips.
    """

    time: FloatArray
    tip: tuple[FloatArray, FloatArray]
    mean: tuple[FloatArray, FloatArray]


class CameraCheck:
    """Takes estimates as they come, and keeps those next to frames."""

    def __init__(
        self,
        recording: Recording,
        offset: float,
        lines: Sequence[FloatArray],
        alignment: Alignment | None,
        solver: Solver,
    ) -> None:
        """Compare with the ``lines`` of a ``recording``, from the base on, in the camera's frame.

        ``offset`` [s] is added to their stamps; None as ``alignment`` stands for one to be fitted.
        Without the estimator the shape is that of ``solver`` under the tensions measured.

        Raises:
            MeasurementError: if an alignment is to be fitted to tips.
        """
        if alignment is None and any(len(line) < 2 for line in lines):
            raise MeasurementError(
                'tips alone do not tell the pose of the camera, expected --align with its pose'
            )
        self._time, self._lines = recording.frame_time + offset, lines
        self._alignment, self._solver, self._recording = alignment, solver, recording
        self._next = 0
        self._last: tuple[float, FloatArray] | None = None
        self._pairs: list[tuple[int, FloatArray]] = []

    def add(self, time: float, shape: Backbone) -> None:
        """Take the ``shape`` estimated at a ``time`` [s], later than the one before."""
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
        """Errors of all frames with an estimate; None if there are none."""
        numbers, estimated, plain = [], [], []
        last: Backbone | None = None
        measured = self._recording.tension_time, np.maximum(self._recording.tensions, 0.0)
        for number, position in self._pairs:
            pulled = interpolated(self._time[number], *measured)
            try:
                last = self._solver.follow(pulled.reshape(self._solver.arm.tension_shape), last)
            except SolveError:
                continue
            numbers.append(number)
            estimated.append(position)
            plain.append(last.position)
        if not numbers:
            return None
        lines = [self._lines[number] for number in numbers]
        found = (_distances(lines, shapes, self._alignment) for shapes in (estimated, plain))
        tips, means = zip(*found)
        return CameraErrors(self._time[numbers], tips, means)


def _distances(
    lines: Sequence[FloatArray], shapes: Sequence[FloatArray], alignment: Alignment | None
) -> tuple[FloatArray, FloatArray]:
    """Distances of the tip and of midlines on average, (frames,) [m]."""
    alignment = alignment or _fitted(lines, shapes)
    pairs = zip(lines, shapes, strict=True)
    errors = [midline_errors(alignment.to_base(line), Curve(shape)) for line, shape in pairs]
    return np.array([one.tip for one in errors]), np.array([one.mean for one in errors])


def _fitted(lines: Sequence[FloatArray], shapes: Sequence[FloatArray]) -> Alignment:
    """The rigid motion that brings midlines nearest to shapes, outliers apart."""
    seen, curves = np.concatenate(lines), list(map(Curve, shapes))
    fractions = [np.linspace(0.0, 1.0, len(line)) for line in lines]
    kept = np.ones(len(seen), dtype=bool)
    for _ in range(_FITS):
        there = np.concatenate(list(map(Curve.along, curves, fractions)))
        alignment = align(seen[kept], there[kept])
        away = np.linalg.norm(alignment.to_base(seen) - there, axis=1)
        kept = away <= _OUTLYING * np.median(away)
        # From the second fit on each point belongs to the nearest one, and the tip to the tip.
        fractions = [
            np.append(curve.nearest(alignment.to_base(line[:-1]))[1], 1.0)
            for line, curve in zip(lines, curves, strict=True)
        ]
    return alignment
