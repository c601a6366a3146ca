"""Parameters of the arm from measured shapes: fits to all steps, and to all but some.

Estimates minimise a sum of squares or a robust loss (`fit`, `robust_loss`); `uncertainty` has
their intervals and correlations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.experiment.fitting import held_back, model_error
from octo_arm_model.experiment.fitting.fit import Problem, fit_alignment
from octo_arm_model.experiment.fitting.held_back import AUTO, HeldBackFit, Misfit, misfit_of
from octo_arm_model.experiment.fitting.loads import folds_of, loaded, steps_by_load
from octo_arm_model.experiment.fitting.notes import notes_on
from octo_arm_model.experiment.fitting.open_directions import open_direction
from octo_arm_model.experiment.fitting.uncertainty import (
    Estimate,
    correlations_of,
    estimates_of,
    freedom_of,
)
from octo_arm_model.experiment.fitting.unknowns import ALIGNMENT, Unknowns
from octo_arm_model.experiment.recording.alignment import Alignment
from octo_arm_model.experiment.recording.mean_midlines import MeasuredShape


@dataclass(frozen=True)
class Identification:
    """A fitted model.

    Attributes:
        model: its name.
        loss: what was minimised, of `fit.LOSSES`.
        estimates: by name; those that the data leave open have no value.
        correlations: of the estimates with a value, (n, n), in their order; None of none.
        undetermined: why each of the others was left as it was, in words.
        notes: remarks, in words.
        before: misfit of the parameters the fit began with.
        after: misfit of the fit, on the data it was fitted to; None if nothing is fitted.
        cross_validation: misfit of loads on which the model was not fitted; None of fewer than
            two loads.
        step_misfits: that of each fold of steps left out, and which these are, from 1.
        floor: distance that held-back loads show and neither noise nor a change at single steps
            explains, in `Estimate.model_stddev` [m]; None without held-back loads.
        tip_stddev: standard deviation of each coordinate of the tip at held-back loads, without
            the camera's noise, in parts of the length [-]; None likewise.
        parameters: of the fitted arm; see `Config.from_parameters`.
        alignment: transform camera to base.
        tensions: those of each step by the fitted load cells, (steps, tendons) [N].
    """

    model: str
    loss: str
    estimates: Mapping[str, Estimate]
    correlations: FloatArray | None
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    before: Misfit
    after: Misfit | None
    cross_validation: Misfit | None
    step_misfits: tuple[tuple[tuple[int, ...], Misfit], ...]
    floor: float | None
    tip_stddev: float | None
    parameters: Mapping[str, Any]
    alignment: Alignment
    tensions: FloatArray

    @property
    def is_trustworthy(self) -> bool:
        """Whether the data determine any parameter but the camera's pose, if others were asked."""
        own = [name for name in self.estimates if name not in ALIGNMENT] or list(self.estimates)
        return any(self.estimates[name].value is not None for name in own)

    def with_tensions(self, shapes: Sequence[MeasuredShape]) -> list[MeasuredShape]:
        """The ``shapes`` it was fitted to, with the tensions of the fitted load cells."""
        return [
            dataclasses.replace(shape, window=dataclasses.replace(shape.window, tensions=row))
            for shape, row in zip(shapes, self.tensions, strict=True)
        ]


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
        fits: of `unknowns.FITS`.
        alignment: transform camera to base, or the start of its fit; None for the identity, or,
            where it is fitted, for a fit of the alignment alone as the start.
        progress: called with the numbers of fits done and of all fits.
        loss: of `fit.LOSSES`, or 'auto' for that with the lesser misfit at held-back loads.

    Raises:
        ConfigError: if the model has no derivative by what is to be fitted.
        SolveError: if the model has no answer, or no minimum is found.
        MeasurementError: if a midline does not begin near the base.
    """
    tensions = np.array([shape.window.tensions for shape in shapes])
    loads = steps_by_load(tensions)
    folds = folds_of(loads)
    total = len(held_back.losses_of(loss, folds)) * (len(folds) + 1)
    progress(0, total)
    if alignment is None:
        alignment = Alignment.none()
        if 'alignment' in fits:
            alignment = fit_alignment(shapes, parameters, model)
    every = Unknowns(parameters, model, fits, tensions, alignment)
    before = misfit_of(_residuals(Problem(shapes, every), every.start), every.arm.length)
    left_out: dict[str, str] = {}
    unknowns, problem, fitted = every, None, {}
    while unknowns.unknowns:
        problem = Problem(shapes, unknowns)
        # Checked before: with an undetermined direction the minimisation does not converge.
        found = open_direction(np.concatenate(problem.jacobian(unknowns.start)), unknowns)
        if found is None:
            fitted = {name: problem.solve(name) for name in held_back.losses_of(loss, folds)}
            for x, _ in fitted.values():
                found = found or open_direction(np.concatenate(problem.jacobian(x)), unknowns)
        if found is None:
            break
        left_out[found.name] = f'{found.name} is left as it is: {found.reason}'
        unknowns = Unknowns(parameters, model, fits, tensions, alignment, tuple(left_out))
    estimates = {u.name: Estimate(None, None, None, u.unit) for u in every.unknowns}
    if problem is None or not unknowns.unknowns:
        progress(total, total)
        return Identification(
            model, loss, estimates, None, tuple(left_out.values()), (), before, None, None, (),
            None, None, parameters, alignment, tensions,
        )  # fmt: skip
    loose = _needed(problem, next(iter(fitted.values()))[0], folds, loads, tensions)
    used = [] if loose else folds
    begun = iter(range(total))

    def tick() -> None:
        progress(next(begun), total)

    tried = []
    for name, (x, scale) in fitted.items():
        tick()
        tried.append(held_back.fit_by(problem, x, scale, name, used, tick))
    best = held_back.better(tried)
    progress(total, total)
    return _identification(
        problem, best, used, left_out, {'loose': loose, 'fits': fits, 'tried': tried}, estimates,
        before,
    )  # fmt: skip


def _identification(
    problem: Problem,
    best: HeldBackFit,
    folds: Sequence[Sequence[int]],
    left_out: Mapping[str, str],
    for_notes: Mapping[str, Any],
    estimates: Mapping[str, Estimate],
    before: Misfit,
) -> Identification:
    """Results of the ``best`` fit of a ``problem``; ``for_notes`` are arguments of `notes_on`."""
    unknowns, x, length = problem.unknowns, best.x, problem.length
    jacobian = problem.jacobian(x)
    after, cross_validation = misfit_of(_residuals(problem, x), length), None
    floor, tip_stddev = None, None
    if folds:
        cross_validation = misfit_of(best.away, length)
        columns = [n for n, name in enumerate(unknowns.names) if name not in ALIGNMENT]
        rest = model_error.unexplained(best.away, jacobian, columns)
        floor = float(np.sqrt(max(rest**2 - model_error.noise_of(problem.shapes) ** 2, 0.0)))
        tip_stddev = model_error.tip_error(best.away, problem.shapes, length)
    correlations = correlations_of(np.concatenate(jacobian))
    found = estimates_of(
        unknowns, x, best.found,
        freedom_of(jacobian, folds) if folds else np.ones(x.size),
        model_error.floor_of(floor or 0.0, jacobian),
    )  # fmt: skip
    return Identification(
        model=unknowns.model,
        loss=best.loss,
        estimates={**estimates, **found},
        correlations=correlations,
        undetermined=tuple(left_out.values()),
        notes=tuple(notes_on(problem, best, correlations, after, floor, **for_notes)),
        before=before,
        after=after,
        cross_validation=cross_validation,
        step_misfits=tuple(
            (tuple(step + 1 for step in fold), misfit_of([best.away[n] for n in fold], length))
            for fold in folds
        ),
        floor=floor,
        tip_stddev=tip_stddev,
        parameters=unknowns.parameters(x),
        alignment=unknowns.alignment(x),
        tensions=np.array([
            unknowns.tensions(x, shape.window.tensions) for shape in problem.shapes
        ]),
    )  # fmt: skip


def _residuals(problem: Problem, x: FloatArray) -> list[FloatArray]:
    return [problem.residuals(x, step) for step in range(len(problem.shapes))]


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
        if found := open_direction(np.concatenate(others), problem.unknowns):
            numbers = ', '.join(str(step + 1) for step in fold)
            return (
                f'without step {numbers} it would be open ({found.reason}), so nothing confirms '
                'the estimates: there are no intervals'
            )
    return ''
