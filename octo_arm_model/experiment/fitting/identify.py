"""Parameters of the arm from measured shapes: fits to all steps, and to all but some.

Estimates minimise a sum of squares or a robust loss (`fit`, `robust_loss`); `uncertainty` has
their intervals and correlations.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fitting import held_back, model_error
from octo_arm_model.experiment.fitting.held_back import AUTO, HeldBackFit, misfit_of
from octo_arm_model.experiment.fitting.identification import Identification
from octo_arm_model.experiment.fitting.least_squares.fit import (
    LOSSES,
    SOFT_L1,
    Problem,
    fit_alignment,
)
from octo_arm_model.experiment.fitting.loads import folds_of, loaded, steps_by_load
from octo_arm_model.experiment.fitting.notes import notes_on
from octo_arm_model.experiment.fitting.uncertainty import (
    Estimate,
    correlations_of,
    estimates_of,
    freedom_of,
)
from octo_arm_model.experiment.fitting.unknowns.open_directions import open_direction
from octo_arm_model.experiment.fitting.unknowns.readings import Readings
from octo_arm_model.experiment.fitting.unknowns.unknown import AXIAL, is_of_arm
from octo_arm_model.experiment.fitting.unknowns.unknowns import Unknowns
from octo_arm_model.experiment.shapes.alignment import Alignment
from octo_arm_model.experiment.shapes.mean_midlines import MeasuredShape


def identify(
    shapes: Sequence[MeasuredShape],
    parameters: Mapping[str, Any],
    model: str,
    fits: Sequence[str] = ('youngs_modulus',),
    alignment: Alignment | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    loss: str = AUTO,
) -> Identification:
    """Fit ``fits`` of ``model`` to measured ``shapes``.

    Args:
        shapes: one for each steady step.
        parameters: what is not fitted, and where the fit begins.
        model: name of the model.
        fits: of `unknown.FITS`.
        alignment: transform camera to base, or the start of its fit; None for the identity, or,
            where it is fitted, for a fit of the alignment alone as the start.
        progress: called with the numbers of fits done and of all fits.
        loss: of `fit.LOSSES`, or 'auto' for that with the lesser misfit at held-back loads.

    Raises:
        ConfigError: if the model has no derivative by what is to be fitted, or no reading is
            of it.
        SolveError: if the model has no answer, or no minimum is found.
        MeasurementError: if a midline does not begin near the base.
    """
    fit = _Fit(shapes, parameters, model, fits, alignment, loss)
    left_out: dict[str, str] = {}
    while True:
        found = fit.without(left_out, progress)
        stretch = found.estimates.get(AXIAL)
        if stretch is None or stretch.value is None:
            return found
        low, high = stretch.interval95 or (stretch.value, stretch.value)
        if high < math.inf:
            return found
        least = '' if low == math.inf else f'; all from {low:.3g} N on explain them'
        left_out[AXIAL] = (
            f'{AXIAL} is left as it is: what the readings leave uncertain is more than what '
            f'tendons stretch by{least}'
        )


@dataclass
class _Fit:
    """A fit of some unknowns, to be repeated without those that the data leave open.

    Its fields are the arguments of `identify`.
    """

    shapes: Sequence[MeasuredShape]
    parameters: Mapping[str, Any]
    model: str
    fits: Sequence[str]
    alignment: Alignment | None
    loss: str

    def __post_init__(self) -> None:
        self._readings = Readings.of(self.shapes)
        self._loads = steps_by_load(self._readings.tensions)
        self._folds = folds_of(self._loads)
        self._losses: tuple[str, ...] = (self.loss,)
        if self.loss == AUTO:  # where nothing can be held back the robust one
            self._losses = LOSSES if self._folds else (SOFT_L1,)
        self._alignment = self.alignment or (
            fit_alignment(self.shapes, self.parameters, self.model)
            if 'alignment' in self.fits
            else Alignment.none()
        )
        self._every = self._unknowns(())
        every = Problem(self.shapes, self._every)
        self._before = misfit_of(every.all_residuals(self._every.start), every.length)

    def _unknowns(self, without: Collection[str]) -> Unknowns:
        return Unknowns(
            self.parameters, self.model, self.fits, self._readings, self._alignment, without
        )

    def without(
        self, left_out: dict[str, str], progress: Callable[[int, int], None]
    ) -> Identification:
        """The fit without those ``left_out``, and why; what else is open is added to them."""
        total = len(self._losses) * (len(self._folds) + 1)
        progress(0, total)
        problem, fitted = self._determined(left_out)
        tensions = self._readings.tensions
        nothing = Identification(
            model=self.model,
            loss=self.loss,
            estimates={u.name: Estimate(None, None, None, u.unit) for u in self._every.unknowns},
            undetermined=tuple(left_out.values()),
            before=self._before,
            parameters=self.parameters,
            alignment=self._alignment,
            tensions=tensions,
        )
        if problem is None:
            progress(total, total)
            return nothing
        first = next(iter(fitted.values()))[0]
        loose = _needed(problem, first, self._folds, self._loads, tensions)
        used = [] if loose else self._folds
        begun = iter(range(total))

        def tick() -> None:
            progress(next(begun), total)

        tried = []
        for name, (x, scale) in fitted.items():
            tick()
            tried.append(held_back.fit_by(problem, x, scale, name, used, tick))
        best = held_back.better(tried)
        progress(total, total)
        found = _with_fit(nothing, problem, best, used)
        notes = notes_on(problem, best, found, loose=loose, fits=self.fits, tried=tried)
        return dataclasses.replace(found, notes=tuple(notes))

    def _determined(
        self, left_out: dict[str, str]
    ) -> tuple[Problem | None, dict[str, tuple[FloatArray, float | None]]]:
        """The fit of what the data determine, and what it comes to by each loss; None of nothing.

        What else is open is added to ``left_out``.
        """
        while (unknowns := self._unknowns(tuple(left_out))).unknowns:
            problem = Problem(self.shapes, unknowns)
            start = unknowns.start
            # Checked before: with an undetermined direction the minimisation does not converge.
            found = open_direction(np.concatenate(problem.jacobian(start)), unknowns, start)
            if found is None:
                fitted = {name: problem.solve(name) for name in self._losses}
                for x, _ in fitted.values():
                    jacobian = np.concatenate(problem.jacobian(x))
                    found = found or open_direction(jacobian, unknowns, x)
            if found is None:
                return problem, fitted
            left_out[found.name] = f'{found.name} is left as it is: {found.reason}'
        return None, {}


def _with_fit(
    nothing: Identification,
    problem: Problem,
    best: HeldBackFit,
    folds: Sequence[Sequence[int]],
) -> Identification:
    """The result ``nothing`` with the values of the ``best`` fit of a ``problem``."""
    unknowns, x, length = problem.unknowns, best.x, problem.length
    jacobian = problem.jacobian(x)
    floor, tip_stddev = None, None
    if folds:
        columns = [n for n, name in enumerate(unknowns.names) if is_of_arm(name)]
        seen = [problem.change(x, step) for step in range(len(problem.shapes))]
        rest = model_error.unexplained(best.away, seen, columns)
        floor = float(np.sqrt(max(rest**2 - model_error.noise_of(problem.shapes) ** 2, 0.0)))
        tip_stddev = model_error.tip_error(best.away, problem.shapes, length)
    found = estimates_of(
        unknowns, x, best.found,
        freedom_of(jacobian, folds) if folds else np.ones(x.size),
        model_error.floor_of(floor or 0.0, jacobian, [len(s.points) for s in problem.shapes]),
    )  # fmt: skip
    return dataclasses.replace(
        nothing,
        loss=best.loss,
        estimates={**nothing.estimates, **found},
        correlations=correlations_of(np.concatenate(jacobian)),
        after=misfit_of(problem.all_residuals(x), length),
        cross_validation=misfit_of(best.away, length) if folds else None,
        step_misfits=tuple(
            (tuple(step + 1 for step in fold), misfit_of([best.away[n] for n in fold], length))
            for fold in folds
        ),
        floor=floor,
        tip_stddev=tip_stddev,
        parameters=unknowns.parameters(x),
        alignment=unknowns.alignment(x),
        tensions=np.array([
            problem.solutions.backbone(x, step).tensions.ravel()
            for step in range(len(problem.shapes))
        ]),
    )  # fmt: skip


def _needed(
    problem: Problem,
    x: FloatArray,
    folds: Sequence[Sequence[int]],
    loads: Sequence[Sequence[int]],
    tensions: FloatArray,
) -> str:
    """Why there are no intervals: a load that cannot be left out; '' if each can."""
    pulled = [load for load in loads if loaded(tensions, list(load))]
    if len(loads) == 1 or len(pulled) == 1:
        steps = ', '.join(str(step + 1) for step in (pulled or loads)[0])
        return (
            f'there is one load (step {steps}): repeats of it say nothing of how loads differ, '
            'so nothing confirms the estimates and there are no intervals'
        )
    jacobian = problem.jacobian(x)
    for fold in folds:
        others = [part for step, part in enumerate(jacobian) if step not in fold]
        if found := open_direction(np.concatenate(others), problem.unknowns, x):
            numbers = ', '.join(str(step + 1) for step in fold)
            return (
                f'without step {numbers} it would be open ({found.reason}), so nothing confirms '
                'the estimates: there are no intervals'
            )
    return ''
