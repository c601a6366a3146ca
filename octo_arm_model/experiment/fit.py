"""Least squares of a model against measured shapes: residuals, their derivatives, the minimum.

Points are paired by their fraction of the length from the start of the measured midline to the
tip. This needs no markers on the arm, and is not changed by noise, which lengthens a midline
evenly. The midline begins at the point of the model nearest to its first point. Markers are
paired with the points of the model at their arc coordinates.

The robust loss is soft_l1 of distances instead of coordinates: with the distance d of a point and
the scale c, rho = 2 c^2 (sqrt(1 + (d / c)^2) - 1), quadratic in small distances and linear in
large ones. As a function of distances it does not depend on the directions of the axes.
"""

import functools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from octo_arm_model.arm.errors import (
    ArmDefinitionError,
    ConvergenceError,
    SolveError,
    TensionError,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.experiment.camera import aligned
from octo_arm_model.experiment.midlines import Curve
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.experiment.shape_changes import ShapeChange, shape_changes
from octo_arm_model.experiment.steady_windows import MAD, wound_at
from octo_arm_model.experiment.unknowns import ALIGNMENT, Readings, Unknowns
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import Wound, displacements_of
from octo_arm_model.rod.solver import Solver
from octo_arm_model.rod.stations import interpolated

# Least scale of the residuals over the length: recordings are not more accurate.
_FINEST = 1e-6
# Least scale of encoder residuals over the length: winches and their zeros are not known better.
ENCODERS_FINEST = 1e-4
SOFT_L1, LINEAR = 'soft_l1', 'linear'
LOSSES = (LINEAR, SOFT_L1)  # the plain sum of squares, and a robust loss
_ROUNDS = 10
_SETTLED = 1e-2  # relative change of the scale below which rounds end
_TOLERANCE = 1e-8  # relative change of the sum of squares below which steps end
_EVALUATIONS = 100
_EXACT = 1e-9  # norm of residuals over the length that is rounding
_STEP = 1e-4  # step of differences over the scale of an unknown, or over a pull
_NO_ANSWER = (SolveError, TensionError, ArmDefinitionError)


class SolvedSteps(NamedTuple):
    """The steps at one x."""

    solver: Solver  #: the solver of the arm
    solutions: tuple[Backbone | Wound, ...]  #: a solution for each step
    curves: tuple[Curve, ...] = ()  #: their shapes
    #: lengths reeled in (tendons,) [m], if encoder readings are residuals
    lengths: tuple[FloatArray, ...] = ()

    @property
    def backbones(self) -> list[Backbone]:
        """The shapes at all stations."""
        return [one.backbone if isinstance(one, Wound) else one for one in self.solutions]

    def moved(self, changes: Sequence[ShapeChange], by: float) -> 'SolvedSteps':
        """Return the steps with an unknown changed ``by`` this, to first order."""
        curves = [
            Curve(curve.points + by * change.position)
            for curve, change in zip(self.curves, changes, strict=True)
        ]
        lengths = [
            length + by * change.lengths
            for length, change in zip(self.lengths, changes)
            if change.lengths is not None
        ]
        return self._replace(curves=tuple(curves), lengths=tuple(lengths))


class Problem:
    """Residuals of all steps, and their derivatives by the unknowns.

    Attributes:
        shapes: the measurements.
        unknowns: the parameters to fit.
        length: length of the arm [m].
    """

    def __init__(self, shapes: Sequence[MeasuredShape], unknowns: Unknowns) -> None:
        """Set up the fit of ``unknowns`` to ``shapes``."""
        self.shapes, self.unknowns = tuple(shapes), unknowns
        self.length = unknowns.arm.length
        self._of_arm = [n for n, name in enumerate(unknowns.names) if name not in ALIGNMENT]
        self._weight, self._is_weighed = 1.0, False
        # Shapes are cached by the unknowns of the arm, because they do not depend on the camera.
        self._solved = functools.lru_cache(maxsize=4)(self._solve)
        self._derivatives = functools.lru_cache(maxsize=4)(self._differentiate)

    def _solve(self, of_arm: tuple[float, ...]) -> SolvedSteps:
        x = self.unknowns.start.copy()
        x[self._of_arm] = of_arm
        return self.solve_steps(x)

    def solve_steps(self, x: FloatArray) -> SolvedSteps:
        """Solve all steps; tendons with friction continue from the previous step."""
        return self._under(x, self.unknowns.inputs(x))

    def _under(self, x: FloatArray, inputs: FloatArray) -> SolvedSteps:
        """Solve all steps under ``inputs`` as those of `Unknowns.inputs`."""
        solver = self.unknowns.solver(x)
        solve = wound_at if self.unknowns.readings.are_lengths else followed
        steps = SolvedSteps(solver, tuple(solve(solver, inputs)))
        curves, lengths = [Curve(shape.position) for shape in steps.backbones], []
        if self.unknowns.reads_encoders:
            lengths = [displacements_of(solver, shape).ravel() for shape in steps.backbones]
        return steps._replace(curves=tuple(curves), lengths=tuple(lengths))

    def changes(self, x: FloatArray) -> dict[str, list[ShapeChange]]:
        """Return the derivatives of all steps by unknowns at ``x``, by name, where known."""
        solved = self._at(x)
        return shape_changes(self.unknowns, x, solved.solver, solved.solutions)

    def _at(self, x: FloatArray) -> SolvedSteps:
        return self._solved(tuple(x[self._of_arm].tolist()))

    def backbones(self, x: FloatArray) -> list[Backbone]:
        """Return the solutions of all steps at ``x``.

        Raises:
            SolveError: if a step has no solution.
            ArmDefinitionError: if ``x`` does not describe a possible arm.
        """
        return self._at(x).backbones

    def residuals(self, x: FloatArray, solved: SolvedSteps | None = None) -> list[FloatArray]:
        """Return the measured points of each step minus the model's at ``x``, (m, 3) [m].

        The model's are those of ``solved``, if given, instead of the steps at ``x``.
        """
        alignment, solved = self.unknowns.alignment(x), solved or self._at(x)
        return [
            shape_residuals(shape, alignment.to_base(shape.points), backbone, curve)
            for shape, backbone, curve in zip(
                self.shapes, solved.backbones, solved.curves, strict=True
            )
        ]

    def weighed(self, x: FloatArray, solved: SolvedSteps | None = None) -> list[FloatArray]:
        """Return all residuals of each step as points, (taut + m, 3) [m].

        The residuals of encoders, with one coordinate each, come before the `residuals` of the
        camera, and are weighted so that both have the same scale.
        """
        solved = solved or self._at(x)
        camera = self.residuals(x, solved)
        if not self.unknowns.reads_encoders:
            return camera
        read = self._encoders(x, solved)
        encoders = [np.outer(self._weight * away, (1.0, 0.0, 0.0)) for away in read]
        return [np.concatenate(pair) for pair in zip(encoders, camera, strict=True)]

    def _encoders(self, x: FloatArray, solved: SolvedSteps) -> list[FloatArray]:
        """Return the readings of taut tendons minus the model's, for each step (taut,) [m]."""
        expected = self.unknowns.readings_of(x, np.array(solved.lengths))
        away = self.unknowns.readings.displacements - expected
        return [row[taut] for row, taut in zip(away, self.unknowns.taut, strict=True)]

    def jacobian(self, x: FloatArray) -> list[FloatArray]:
        """Return the derivative of what is `weighed` of each step, (taut + m, 3, unknowns)."""
        return self._derivatives(tuple(x.tolist()), self._weight)

    def _differentiate(self, at: tuple[float, ...], weight: float) -> list[FloatArray]:
        """Return central differences of residuals of shapes moved by their first derivatives.

        Shapes without one are solved again: where friction makes a tendon stick there is none.
        """
        x = np.array(at)
        solved, changes = self._at(x), self.changes(x)
        residuals = np.concatenate(self.weighed(x))
        columns = []
        for number, unknown in enumerate(self.unknowns.unknowns):
            sides = [(x[number], residuals)]
            for step in (-_STEP * unknown.scale, _STEP * unknown.scale):
                moved = x.copy()
                moved[number] = min(max(x[number] + step, unknown.low), unknown.high)
                try:
                    steps = (
                        solved.moved(changes[unknown.name], moved[number] - x[number])
                        if unknown.name in changes
                        else self._at(moved)
                    )
                except _NO_ANSWER:
                    continue
                sides.append((moved[number], np.concatenate(self.weighed(moved, steps))))
            if len(sides) == 1:
                raise SolveError(f'no answer beside {unknown.name} of {unknown.value(at[number])}')
            (low, before), (high, after) = sides[-2:]
            columns.append((after - before) / (high - low))
        ends = np.cumsum([len(shape.points) for shape in self.shapes])[:-1]
        if self.unknowns.reads_encoders:
            ends += np.cumsum(self.unknowns.taut.sum(axis=1))[:-1]
        return np.split(np.stack(columns, axis=-1), ends)

    def camera_jacobian(self, x: FloatArray) -> list[FloatArray]:
        """Return the derivative of the `residuals` of each step by x, (m, 3, unknowns)."""
        pairs = zip(self.jacobian(x), self.shapes, strict=True)
        return [part[len(part) - len(shape.points) :] for part, shape in pairs]

    def camera_by_pull(self, x: FloatArray) -> list[FloatArray]:
        """Return the change of the `residuals` of each step by pulls of the tendons at ``x``.

        It is per relative change of tensions or lengths, (m, 3, tendons that are ever pulled).
        """
        inputs, before = self.unknowns.inputs(x), self.residuals(x)
        columns = []
        for tendon in np.eye(inputs.shape[1])[np.nan_to_num(inputs).any(axis=0)]:
            after = self.residuals(x, self._under(x, inputs * (1.0 + _STEP * tendon)))
            columns.append([(new - old) / _STEP for old, new in zip(before, after, strict=True)])
        return [np.stack(changes, axis=-1) for changes in zip(*columns, strict=True)]

    def encoder_scale(self, x: FloatArray) -> float:
        """Return the scale of the encoder residuals at ``x`` [m], that is their accuracy."""
        away = np.concatenate(self._encoders(x, self._at(x)))[:, np.newaxis]
        return _scale_of(away, ENCODERS_FINEST * self.length)

    def scale(self, x: FloatArray) -> float:
        """Return the scale of the robust loss [m], from the residuals at ``x``."""
        return _scale_of(np.concatenate(self.residuals(x)), _FINEST * self.length)

    def minimise(self, x: FloatArray, scale: float | None) -> FloatArray:
        """Minimise the sum of the robust loss over all steps, starting at ``x``.

        Without a ``scale`` the loss is the sum of squares.

        Raises:
            SolveError: if the model has no solution at ``x``.
            ConvergenceError: if no minimum is found.
        """
        # No solution at the start is an error, while a later one is a rejected trial.
        first = np.concatenate(self.weighed(x))
        if np.linalg.norm(first) <= _EXACT * self.length:
            return x  # changes of rounding are not small relative to it

        def fun(x: FloatArray) -> FloatArray:
            try:
                return np.concatenate(self.weighed(x)).ravel()
            except _NO_ANSWER:
                # Infinite residuals make the optimiser shorten a step without a solution.
                return np.full(first.size, np.inf)

        low, high = self.unknowns.bounds
        result = least_squares(
            fun,
            np.clip(x, low, high),
            lambda x: np.concatenate(self.jacobian(x)).reshape(-1, x.size),
            bounds=(low, high),
            method='trf',
            x_scale=[u.scale for u in self.unknowns.unknowns],
            loss='linear' if scale is None else _soft_loss,
            f_scale=1.0 if scale is None else scale,
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=None,
            max_nfev=_EVALUATIONS,
        )
        if result.status <= 0:
            raise ConvergenceError(
                f'the fit of {self.unknowns.model}', float(result.optimality), int(result.nfev)
            )
        return result.x

    def without(
        self, x: FloatArray, scale: float | None, folds: Sequence[Sequence[int]]
    ) -> tuple[FloatArray, list[FloatArray]]:
        """Return to first order the fits near ``x`` without the steps of each of ``folds``.

        These are one step of Newton's method from the minimum ``x`` of the loss of this ``scale``,
        with the shapes linear in x.

        Returns:
            The fits (folds, n), and residuals of the left-out steps (m, 3) in their order [m].
        """
        normal, score = [], []
        for by, away in zip(self.jacobian(x), self.weighed(x), strict=True):
            square = 0.0 if scale is None else (away**2).sum(axis=1) / scale**2
            weight = 1.0 / np.sqrt(1.0 + square * np.ones(len(away)))
            along = np.einsum('pci,pc->pi', by, away) / (scale or np.inf)
            normal.append(
                np.einsum('pci,p,pcj->ij', by, weight, by)
                - np.einsum('pi,p,pj->ij', along, weight**3, along)
            )
            score.append(np.einsum('pci,p,pc->i', by, weight, away))
        total, low_high = np.sum(normal, axis=0), self.unknowns.bounds
        fits, left_out = np.zeros((len(folds), x.size)), dict[int, FloatArray]()
        camera = list(zip(self.residuals(x), self.camera_jacobian(x), strict=True))
        for number, fold in enumerate(folds):
            own, gone = (np.sum([part[n] for n in fold], axis=0) for part in (normal, score))
            fits[number] = np.clip(x + np.linalg.solve(total - own, gone), *low_high)
            for step in fold:
                away, by = camera[step]
                left_out[step] = away + by @ (fits[number] - x)
        return fits, [left_out[step] for step in sorted(left_out)]

    def solve(
        self, loss: str = SOFT_L1, start: FloatArray | None = None
    ) -> tuple[FloatArray, float | None]:
        """Fit by one of `LOSSES`; for soft_l1 minimum and scale alternate until both settle.

        The fit starts at ``start``, or else at the start of the unknowns.

        Returns:
            x and the scale of the robust loss [m]; None for the sum of squares.

        Raises:
            SolveError: if the model has no solution at the start.
            ConvergenceError: if no minimum is found.
            MeasurementError: if a midline does not begin near the base.
        """
        x = self.unknowns.start if start is None else start
        if self.unknowns.reads_encoders and not self._is_weighed:
            self._is_weighed, fit = True, x
            # The weight of encoder readings against the camera settles first.
            for _ in range(_ROUNDS):
                fit = self.minimise(fit, None)
                before, self._weight = self._weight, self.scale(fit) / self.encoder_scale(fit)
                if abs(self._weight - before) < _SETTLED * before:
                    break
        final_scale: float | None = None
        if loss == SOFT_L1:
            scale = self.scale(x)
            for _ in range(_ROUNDS):
                x = self.minimise(x, scale)
                previous, scale = scale, self.scale(x)
                if abs(scale - previous) < _SETTLED * previous:
                    break
            final_scale = scale
        x = self.minimise(x, final_scale)
        alignment = self.unknowns.alignment(x)
        for shape, curve in zip(self.shapes, self._at(x).curves, strict=True):
            if shape.s is None:
                curve.fractions(alignment.to_base(shape.points), check=True)
        return x, final_scale


def followed(solver: Solver, tensions: Iterable[FloatArray]) -> list[Backbone]:
    """Return the shapes under sets of ``tensions`` (tendons,) [N], in their order.

    Each tendon with friction continues from the previous set.

    Raises:
        SolveError: if the model has no solution for a set.
    """
    backbones: list[Backbone] = []
    for row in tensions:
        last = backbones[-1] if backbones and solver.arm.friction else None
        backbones.append(solver.follow(row.reshape(solver.arm.tension_shape), last))
    return backbones


def fit_alignment(
    shapes: Sequence[MeasuredShape], parameters: Mapping[str, Any], model: str
) -> Pose:
    """Return the alignment, one for all steps, that brings ``shapes`` nearest to the given arm.

    Raises:
        SolveError: if the model has no solution, or no minimum is found.
        MeasurementError: if there are too few points, or a midline does not begin near the base.
    """
    readings = Readings.of(shapes)
    unknowns = Unknowns(parameters, model, ['alignment'], readings, Pose())
    problem = Problem(shapes, unknowns)
    models = problem.backbones(unknowns.start)
    curves = [Curve(model.position) for model in models]
    markers = [
        np.interp(shape.s, model.s, curve.lengths) / curve.lengths[-1]
        for shape, model, curve in zip(shapes, models, curves, strict=True)
        if shape.s is not None
    ]
    initial = aligned([shape.points for shape in shapes], curves, markers)
    x, _ = problem.solve(start=np.array([*initial.position, *initial.rotation.as_rotvec()]))
    return unknowns.alignment(x)


def shape_residuals(
    shape: MeasuredShape, measured: FloatArray, backbone: Backbone, curve: Curve | None = None
) -> FloatArray:
    """Return the points of a ``shape``, ``measured`` (m, 3) in base_frame, minus the model's [m].

    The model's shape is the ``curve`` if given, else that of the ``backbone``.
    """
    curve = curve or Curve(backbone.position)
    if shape.s is not None:
        return measured - interpolated(shape.s, backbone.s, curve.points)
    return measured - curve.along(curve.fractions(measured))


def _scale_of(away: FloatArray, least: float) -> float:
    """Return the scale of residuals (..., 3) [m]: 1.48 times their median, at least ``least``."""
    return max(MAD * float(np.median(np.linalg.norm(away, axis=-1))), least)


def _soft_loss(squares: FloatArray) -> FloatArray:
    """Return the loss of `least_squares` for ``squares`` (3 points,) of scaled residuals x, y, z.

    The rows (3, 3 points) are a third of rho of each point, and its first two derivatives by the
    square.
    """
    root = np.sqrt(1.0 + squares.reshape(-1, 3).sum(axis=1))
    return np.repeat([2.0 / 3.0 * (root - 1.0), 1.0 / root, -0.5 / root**3], 3, axis=1)
