"""Least squares of a model against measured shapes: residuals, their derivatives, the minimum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from octo_arm_model.arm.errors import (
    ArmDefinitionError,
    ConvergenceError,
    SolveError,
    TensionError,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fitting.least_squares import robust_loss
from octo_arm_model.experiment.fitting.least_squares.pairing import (
    first_alignment,
    shape_residuals,
    shape_residuals_change,
)
from octo_arm_model.experiment.fitting.least_squares.solutions import Solutions
from octo_arm_model.experiment.fitting.unknowns.readings import Readings
from octo_arm_model.experiment.fitting.unknowns.unknowns import Unknowns
from octo_arm_model.experiment.shapes.alignment import Alignment
from octo_arm_model.experiment.shapes.mean_midlines import MeasuredShape
from octo_arm_model.experiment.shapes.midlines import fraction_at_start

# Least scale of the residuals, relative to the length: recordings are not more accurate.
_FINEST = 1e-6
# Likewise of encoders: the drum of a winch and its zero are not known better.
ENCODERS_FINEST = 1e-4
SOFT_L1, LINEAR = 'soft_l1', 'linear'
LOSSES = (LINEAR, SOFT_L1)  # the plain sum of squares, and robust
_ROUNDS = 10
_SETTLED = 1e-2  # of the scale between two rounds
_TOLERANCE = 1e-8  # of the sum of squares between two steps
_EVALUATIONS = 100


class Problem:
    """Residuals of all steps, and their derivatives by the unknowns.

    Attributes:
        shapes: the measurements.
        unknowns: the parameters to fit.
        length: of the arm [m].
        solutions: of the model.
    """

    def __init__(self, shapes: Sequence[MeasuredShape], unknowns: Unknowns) -> None:
        """Fit ``unknowns`` to ``shapes``."""
        self.shapes, self.unknowns = tuple(shapes), unknowns
        self.length = unknowns.arm.length
        self.solutions = Solutions(unknowns)
        self._weight, self._is_weighed = 1.0, False

    def residuals(self, x: FloatArray, step: int) -> FloatArray:
        """Measured points of a ``step`` less those of the model at ``x``, (m, 3) [m]."""
        measured = self.unknowns.alignment(x).to_base(self.shapes[step].points)
        return shape_residuals(self.shapes[step], measured, self.solutions.backbone(x, step))

    def all_residuals(self, x: FloatArray) -> list[FloatArray]:
        """The `residuals` of each step."""
        return [self.residuals(x, step) for step in range(len(self.shapes))]

    def change(self, x: FloatArray, step: int) -> FloatArray:
        """Derivative of `residuals` by x, (m, 3, unknowns)."""
        points, backbone = self.shapes[step].points, self.solutions.backbone(x, step)
        alignment, columns = self.unknowns.alignment(x), self.unknowns.alignment_columns
        by_measured = np.zeros((*points.shape, x.size))
        if columns:
            parts = alignment.by_parameters(points)[..., self.unknowns.alignment_parts]
            by_measured[..., columns] = parts
        by_model = self.solutions.position_change(x, step)
        measured = alignment.to_base(points)
        return shape_residuals_change(self.shapes[step], measured, by_measured, backbone, by_model)

    def weighed(self, x: FloatArray, step: int) -> FloatArray:
        """All residuals of a ``step`` as points, (m + taut, 3) [m].

        Those of encoders, of one coordinate each, come before the `residuals` of the camera and
        are weighed so that both are of one size.
        """
        camera = self.residuals(x, step)
        if not self.unknowns.reads_encoders:
            return camera
        encoders = self.solutions.encoder_residuals(x, step)
        return np.concatenate([self._as_points(encoders), camera])

    def weighed_change(self, x: FloatArray, step: int) -> FloatArray:
        """Derivative of what is `weighed` by x, (m + taut, 3, unknowns)."""
        camera = self.change(x, step)
        if not self.unknowns.reads_encoders:
            return camera
        return np.concatenate([self._as_points(self.solutions.encoder_change(x, step)), camera])

    def jacobian(self, x: FloatArray) -> list[FloatArray]:
        """Derivative of what is `weighed` of each step by x, (m + taut, 3, unknowns)."""
        return [self.weighed_change(x, step) for step in range(len(self.shapes))]

    def _as_points(self, readings: FloatArray) -> FloatArray:
        """Weighed ``readings`` (taut, ...) as the first coordinate of points (taut, 3, ...)."""
        points = np.zeros((len(readings), 3, *readings.shape[1:]))
        points[:, 0] = self._weight * readings
        return points

    def encoder_scale(self, x: FloatArray) -> float:
        """Scale of the residuals of encoders at ``x`` [m]: their accuracy, as far as it shows."""
        away = [self.solutions.encoder_residuals(x, step) for step in range(len(self.shapes))]
        least = ENCODERS_FINEST * self.length
        return robust_loss.scale_of(np.concatenate(away)[:, np.newaxis], least)

    def _weigh(self, x: FloatArray) -> None:
        """Settle the weight of encoder readings beside the camera, from the fit at ``x`` on."""
        for _ in range(_ROUNDS):
            x = self.minimise(x, None)
            before, self._weight = self._weight, self.scale(x) / self.encoder_scale(x)
            if abs(self._weight - before) < _SETTLED * before:
                return

    def scale(self, x: FloatArray) -> float:
        """Scale of the robust loss, from the residuals at ``x`` [m]."""
        away = np.concatenate(self.all_residuals(x))
        return robust_loss.scale_of(away, _FINEST * self.length)

    def _count(self, step: int) -> int:
        """Number of coordinates that are `weighed` in a ``step``."""
        taut = int(self.unknowns.taut[step].sum()) if self.unknowns.reads_encoders else 0
        return 3 * taut + self.shapes[step].points.size

    def minimise(
        self, x: FloatArray, scale: float | None, steps: Sequence[int] | None = None
    ) -> FloatArray:
        """Least sum over ``steps``, all if None, of the robust loss, from ``x`` on.

        Without a ``scale`` it is the sum of squares.

        Raises:
            SolveError: if the model has no answer at ``x``.
            ConvergenceError: if no minimum is found.
        """
        chosen = range(len(self.shapes)) if steps is None else steps
        for step in chosen:
            # Without a solution here it is an error, not a rejected trial.
            self.solutions.backbone(x, step)

        def fun(x: FloatArray) -> FloatArray:
            try:
                return np.concatenate([self.weighed(x, step) for step in chosen]).ravel()
            except (SolveError, TensionError, ArmDefinitionError):
                # No such arm or no solution: infinite residuals, so that the step is shortened.
                return np.full(sum(self._count(step) for step in chosen), np.inf)

        def jacobian(x: FloatArray) -> FloatArray:
            changes = [self.weighed_change(x, step) for step in chosen]
            return np.concatenate(changes).reshape(-1, x.size)

        unknowns = self.unknowns.unknowns
        low, high = ([getattr(u, end) for u in unknowns] for end in ('low', 'high'))
        found = least_squares(
            fun, np.clip(x, low, high), jacobian, bounds=(low, high), method='trf',
            x_scale=[u.scale for u in unknowns],
            loss='linear' if scale is None else robust_loss.loss,
            f_scale=1.0 if scale is None else scale,
            ftol=_TOLERANCE, xtol=_TOLERANCE, gtol=None, max_nfev=_EVALUATIONS,
        )  # fmt: skip
        if found.status <= 0:
            raise ConvergenceError(
                f'the fit of {self.unknowns.model}', float(found.optimality), int(found.nfev)
            )
        return found.x

    def solve(
        self, loss: str = SOFT_L1, start: FloatArray | None = None
    ) -> tuple[FloatArray, float | None]:
        """The fit by one of `LOSSES`: of soft_l1 minimum and scale alternately, until both settle.

        From ``start`` on, or else from where the unknowns begin.

        Returns:
            x and the scale of the robust loss [m], None of the sum of squares.

        Raises:
            SolveError: if the model has no answer to begin with.
            ConvergenceError: if no minimum is found.
            MeasurementError: if a midline does not begin near the base.
        """
        x = self.unknowns.start if start is None else start
        if self.unknowns.reads_encoders and not self._is_weighed:
            self._weigh(x)
            self._is_weighed = True
        found: float | None = None
        if loss == SOFT_L1:
            scale = self.scale(x)
            for _ in range(_ROUNDS):
                x = self.minimise(x, scale)
                previous, scale = scale, self.scale(x)
                if abs(scale - previous) < _SETTLED * previous:
                    break
            found = scale
        x = self.minimise(x, found)
        for step, shape in enumerate(self.shapes):
            if shape.s is not None:
                continue
            measured = self.unknowns.alignment(x).to_base(shape.points)
            fraction_at_start(measured, self.solutions.backbone(x, step).position, check=True)
        return x, found


def fit_alignment(
    shapes: Sequence[MeasuredShape], parameters: Mapping[str, Any], model: str
) -> Alignment:
    """Alignment, one for all steps, that brings ``shapes`` nearest to an arm as it is.

    Raises:
        SolveError: if the model has no answer, or no minimum is found.
        MeasurementError: if there are too few points, or a midline does not begin near the base.
    """
    readings = Readings.of(shapes)
    unknowns = Unknowns(parameters, model, ['alignment'], readings, Alignment.none())
    problem = Problem(shapes, unknowns)
    found = [problem.solutions.backbone(unknowns.start, step) for step in range(len(shapes))]
    begin = first_alignment(shapes, [backbone.position for backbone in found], found[0].s)
    x, _ = problem.solve(start=np.concatenate([begin.shift, begin.turn]))
    return unknowns.alignment(x)
