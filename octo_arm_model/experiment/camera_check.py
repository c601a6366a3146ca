"""Estimates against the midlines of a camera, which the estimator does not use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import MeasurementError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.alignment import Alignment, align
from octo_arm_model.experiment.midlines import Curve, midline_errors
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.interpolation import interpolated
from octo_arm_model.rod.solver import Solver

LONGEST = 0.1  # [s] from a frame to the next estimate
_OUTLYING = 3.0  # times the median distance: what is left out of a fitted alignment
_FITS = 4  # of the alignment, each without the outliers of the one before


class CameraFrames(NamedTuple):
    """Midlines, or tips.

    Attributes:
        time: ascending, by the clock of the estimates (f,) [s].
        lines: each (m, 3) in the frame of the camera, from the base on [m].
        alignment: from there to base_frame; None for one to be fitted.
    """

    time: FloatArray
    lines: Sequence[FloatArray]
    alignment: Alignment | None


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
        self, frames: CameraFrames, solver: Solver, time: FloatArray, tensions: FloatArray
    ) -> None:
        """Compare with ``frames``.

        Without the estimator the shape is that of ``solver`` under the ``tensions`` (n, tendons)
        [N] measured at ``time`` (n,) [s].

        Raises:
            MeasurementError: if an alignment is to be fitted to tips.
        """
        if frames.alignment is None and any(len(line) < 2 for line in frames.lines):
            raise MeasurementError(
                'tips alone do not tell the pose of the camera, expected --align with its pose'
            )
        self._frames, self._solver = frames, solver
        self._time, self._tensions = time, np.maximum(tensions, 0.0)
        self._next = 0
        self._last: tuple[float, FloatArray] | None = None
        self._pairs: list[tuple[int, FloatArray]] = []

    def add(self, time: float, shape: Backbone) -> None:
        """Take the ``shape`` estimated at a ``time`` [s], later than the one before."""
        new = time, shape.position
        last = self._last or new
        frames = self._frames.time
        while self._next < len(frames) and frames[self._next] <= time:
            at = frames[self._next]
            near = last if at - last[0] < time - at else new
            if abs(near[0] - at) <= LONGEST:
                self._pairs.append((self._next, near[1]))
            self._next += 1
        self._last = new

    def errors(self) -> CameraErrors | None:
        """Errors of all frames with an estimate; None if there are none."""
        kept, plain = [], []
        last: Backbone | None = None
        for number, position in self._pairs:
            at = self._frames.time[number]
            pulled = interpolated(at, self._time, self._tensions)
            try:
                shape = pulled.reshape(self._solver.arm.tension_shape)
                last = self._solver.follow(shape, last)
            except SolveError:
                continue
            kept.append((number, position))
            plain.append(last.position)
        if not kept:
            return None
        numbers = [number for number, _ in kept]
        lines = [self._frames.lines[number] for number in numbers]
        found = [
            _distances(lines, shapes, self._frames.alignment)
            for shapes in ([position for _, position in kept], plain)
        ]
        (tip, mean), (plain_tip, plain_mean) = found
        return CameraErrors(self._frames.time[numbers], (tip, plain_tip), (mean, plain_mean))


def _distances(
    lines: Sequence[FloatArray], shapes: Sequence[FloatArray], alignment: Alignment | None
) -> tuple[FloatArray, FloatArray]:
    """Distances of the tip and of midlines on average, (frames,) [m]."""
    alignment = alignment or _fitted(lines, shapes)
    tips, means = [], []
    for line, shape in zip(lines, shapes, strict=True):
        measured = alignment.to_base(line)
        errors = midline_errors(measured, Curve(shape))
        tips.append(np.nan if errors.tip is None else errors.tip)
        means.append(np.nan if errors.mean is None else errors.mean)
    return np.array(tips), np.array(means)


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
