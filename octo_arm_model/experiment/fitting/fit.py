"""Least squares of a model against measured shapes: residuals, their derivatives, the minimum."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from octo_arm_model.core.errors import ArmDefinitionError, ConvergenceError, SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.core.solver import Solver
from octo_arm_model.experiment.fitting import robust_loss
from octo_arm_model.experiment.fitting.pairing import (
    first_alignment,
    shape_residuals,
    shape_residuals_change,
)
from octo_arm_model.experiment.fitting.unknowns import Unknowns
from octo_arm_model.experiment.recording.alignment import Alignment
from octo_arm_model.experiment.recording.mean_midlines import MeasuredShape
from octo_arm_model.experiment.recording.midlines import fraction_at_start

# Least scale of the residuals, relative to the length: recordings are not more accurate.
_FINEST = 1e-6
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
    """

    def __init__(self, shapes: Sequence[MeasuredShape], unknowns: Unknowns) -> None:
        """Fit ``unknowns`` to ``shapes``."""
        self.shapes, self.unknowns = tuple(shapes), unknowns
        self.length = unknowns.arm.length
        self._read = np.array([shape.window.tensions for shape in self.shapes])
        self._at: FloatArray | None = None
        self._solver: Solver | None = None
        self._backbones: dict[int, Backbone] = {}
        self._displacements: FloatArray | None = None

    def backbone(self, x: FloatArray, step: int) -> Backbone:
        """Solution for a ``step`` at ``x``.

        Raises:
            SolveError: if it has none.
            ArmDefinitionError: if there can be no such arm.
        """
        if self._solver is None or self._at is None or (x != self._at).any():
            self._solver, self._at, self._backbones = self.unknowns.solver(x), x.copy(), {}
            self._displacements = None
        if step not in self._backbones:
            if self.unknowns.slides:
                # Tendons slide on from the step before.
                self._backbones = dict(enumerate(self._sequence(x, self._solver)))
            else:
                tensions = self.unknowns.tensions(x, self._read[step])
                shape = self._solver.arm.tension_shape
                self._backbones[step] = self._solver.solve(tensions.reshape(shape))
        return self._backbones[step]

    def _sequence(self, x: FloatArray, solver: Solver) -> list[Backbone]:
        """Solutions for all steps at ``x``, one after the other."""
        return followed(solver, [self.unknowns.tensions(x, read) for read in self._read])

    def _displacement(self, x: FloatArray, step: int) -> FloatArray:
        """Derivative of the stations of a ``step`` by x, (n, 3, unknowns)."""
        backbone, unknowns = self.backbone(x, step), self.unknowns
        assert self._solver is not None
        if not unknowns.slides:
            return unknowns.displacement(x, self._read[step], backbone, self._solver)
        if self._displacements is None:
            # Where a tendon sticks there are no others: differences of whole sequences.
            here = np.array([self.backbone(x, n).position for n in range(len(self.shapes))])
            self._displacements = np.zeros((*here.shape, x.size))
            for number in range(x.size):
                if number in unknowns.alignment_columns:
                    continue
                moved, by = x.copy(), unknowns.difference(x, number)
                moved[number] += by
                there = [b.position for b in self._sequence(moved, unknowns.solver(moved))]
                self._displacements[..., number] = (np.array(there) - here) / by
        return np.asarray(self._displacements[step])

    def residuals(self, x: FloatArray, step: int) -> FloatArray:
        """Measured points of a ``step`` less those of the model at ``x``, (m, 3) [m]."""
        measured = self.unknowns.alignment(x).to_base(self.shapes[step].points)
        return shape_residuals(self.shapes[step], measured, self.backbone(x, step))

    def change(self, x: FloatArray, step: int) -> FloatArray:
        """Derivative of `residuals` by x, (m, 3, unknowns)."""
        points, backbone = self.shapes[step].points, self.backbone(x, step)
        alignment, columns = self.unknowns.alignment(x), self.unknowns.alignment_columns
        by_measured = np.zeros((*points.shape, x.size))
        if columns:
            parts = alignment.by_parameters(points)[..., self.unknowns.alignment_parts]
            by_measured[..., columns] = parts
        by_model = self._displacement(x, step)
        measured = alignment.to_base(points)
        return shape_residuals_change(self.shapes[step], measured, by_measured, backbone, by_model)

    def jacobian(self, x: FloatArray) -> list[FloatArray]:
        """Derivative of the `residuals` of each step by x, (m, 3, unknowns)."""
        return [self.change(x, step) for step in range(len(self.shapes))]

    def scale(self, x: FloatArray) -> float:
        """Scale of the robust loss, from the residuals at ``x`` [m]."""
        away = [self.residuals(x, step) for step in range(len(self.shapes))]
        return robust_loss.scale_of(np.concatenate(away), _FINEST * self.length)

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
            self.backbone(x, step)  # Without a solution here it is an error, not a rejected trial.

        def fun(x: FloatArray) -> FloatArray:
            try:
                return np.concatenate([self.residuals(x, step) for step in chosen]).ravel()
            except (SolveError, ArmDefinitionError):
                # No such arm or no solution: infinite residuals, so that the step is shortened.
                return np.full(sum(self.shapes[step].points.size for step in chosen), np.inf)

        def jacobian(x: FloatArray) -> FloatArray:
            return np.concatenate([self.change(x, step) for step in chosen]).reshape(-1, x.size)

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

    def solve(self, loss: str = SOFT_L1) -> tuple[FloatArray, float | None]:
        """The fit by one of `LOSSES`: of soft_l1 minimum and scale alternately, until both settle.

        Returns:
            x and the scale of the robust loss [m], None of the sum of squares.

        Raises:
            SolveError: if the model has no answer to begin with.
            ConvergenceError: if no minimum is found.
            MeasurementError: if a midline does not begin near the base.
        """
        x = self.unknowns.start
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
            fraction_at_start(measured, self.backbone(x, step).position, check=True)
        return x, found


def followed(solver: Solver, tensions: Iterable[FloatArray]) -> list[Backbone]:
    """Shapes under sets of ``tensions`` (tendons,) [N], in their order.

    Each tendon with friction slides on from the set before.

    Raises:
        SolveError: if the model has no answer for one.
    """
    found: list[Backbone] = []
    for pulled in tensions:
        shaped = pulled.reshape(solver.arm.tension_shape)
        last = found[-1] if found and solver.arm.friction else None
        found.append(solver.follow(shaped, last))
    return found


def fit_alignment(
    shapes: Sequence[MeasuredShape], parameters: Mapping[str, Any], model: str
) -> Alignment:
    """Alignment, one for all steps, that brings ``shapes`` nearest to an arm as it is.

    Raises:
        SolveError: if the model has no answer, or no minimum is found.
        MeasurementError: if there are too few points, or a midline does not begin near the base.
    """
    tensions = np.array([shape.window.tensions for shape in shapes])
    unknowns = Unknowns(parameters, model, ['alignment'], tensions, Alignment.none())
    solver = unknowns.solver(unknowns.start)
    backbones = followed(solver, tensions)
    begin = first_alignment(shapes, [backbone.position for backbone in backbones], backbones[0].s)
    unknowns = Unknowns(parameters, model, ['alignment'], tensions, begin)
    x, _ = Problem(shapes, unknowns).solve()
    return unknowns.alignment(x)
