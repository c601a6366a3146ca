"""Parameters of the arm from measured shapes: fits to all steps, and to all but some.

Estimates minimise a robust sum of squares (`fit`, `robust_loss`); `uncertainty` has their
intervals and correlations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.experiment.fitting.fit import Problem, fit_alignment
from octo_arm_model.experiment.fitting.uncertainty import (
    Estimate,
    at_ends,
    correlations_of,
    estimates_of,
    freedom_of,
    strong_pairs,
    undetermined_by,
)
from octo_arm_model.experiment.fitting.unknowns import Unknowns
from octo_arm_model.experiment.recording.alignment import Alignment, undetermined
from octo_arm_model.experiment.recording.mean_midlines import MeasuredShape

# Fits at most: of more steps several are left out together.
_MOST_FOLDS = 20
# A misfit above so many times that of noise is not explained by noise.
_BIASED = 2.0


@dataclass(frozen=True)
class Misfit:
    """Distance of model and measurement.

    Attributes:
        rms: root mean square distance of paired points [m].
        tip_error: mean distance of the tips, relative to the length [-].
    """

    rms: float
    tip_error: float


@dataclass(frozen=True)
class Identification:
    """A fitted model.

    Attributes:
        model: its name.
        estimates: by name.
        correlations: of the estimates, (n, n), in their order; None where undetermined.
        undetermined: directions that the data do not determine, in words; if there is one, there
            are no estimates.
        notes: remarks, in words.
        before: misfit of the parameters the fit began with.
        after: misfit of the fit, on the data it was fitted to; None where undetermined.
        cross_validation: misfit of steps on which the model was not fitted; None of fewer than
            two steps.
        step_misfits: that of each fold of steps left out, and which these are, from 1.
        parameters: of the fitted arm; see `Config.from_parameters`.
        alignment: transform camera to base.
    """

    model: str
    estimates: Mapping[str, Estimate]
    correlations: FloatArray | None
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    before: Misfit
    after: Misfit | None
    cross_validation: Misfit | None
    step_misfits: tuple[tuple[tuple[int, ...], Misfit], ...]
    parameters: Mapping[str, Any]
    alignment: Alignment

    @property
    def is_trustworthy(self) -> bool:
        """Whether the data determine all parameters to fit."""
        return not self.undetermined


def identify(
    shapes: Sequence[MeasuredShape],
    parameters: Mapping[str, Any],
    model: str,
    fits: Sequence[str] = ('youngs_modulus',),
    alignment: Alignment | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
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

    Raises:
        ConfigError: if the model has no derivative by what is to be fitted.
        SolveError: if the model has no answer, or no minimum is found.
        MeasurementError: if a midline does not begin near the base.
    """
    tensions = np.array([shape.window.tensions for shape in shapes])
    if alignment is None:
        alignment = Alignment.none()
        if 'alignment' in fits:
            alignment = fit_alignment(shapes, parameters, model)
    unknowns = Unknowns(parameters, model, fits, tensions, alignment)
    problem = Problem(shapes, unknowns)
    before = _misfit(problem, unknowns.start)
    # Checked before: with an undetermined direction the minimisation does not converge.
    jacobian = problem.jacobian(unknowns.start)
    open_ends = undetermined_by(np.concatenate(jacobian), unknowns)
    folds = _folds(len(shapes))
    if not open_ends:
        progress(0, len(folds) + 1)
        x, scale = problem.solve()
        jacobian = problem.jacobian(x)
        open_ends = undetermined_by(np.concatenate(jacobian), unknowns)
    if open_ends:
        estimates = {u.name: Estimate(None, None, None, u.unit) for u in unknowns.unknowns}
        return Identification(
            model, estimates, None, open_ends, (), before, None, None, (), parameters, alignment
        )
    after, correlations = _misfit(problem, x), correlations_of(np.concatenate(jacobian))
    notes = [
        *_notes(problem, fits, len(folds), after),
        *at_ends(unknowns, x),
        *strong_pairs(correlations, unknowns),
    ]
    found, misfits = [], []
    if missing := _needed(jacobian, folds, unknowns):
        notes.append(missing)
    else:
        for number, fold in enumerate(folds):
            progress(number + 1, len(folds) + 1)
            others = [step for step in range(len(shapes)) if step not in fold]
            found.append(problem.minimise(x, scale, others))
            misfits.append(_misfit(problem, found[-1], fold))
    progress(len(folds) + 1, len(folds) + 1)
    return Identification(
        model=model,
        estimates=estimates_of(unknowns, x, np.array(found), freedom_of(jacobian, folds)),
        correlations=correlations,
        undetermined=(),
        notes=tuple(notes),
        before=before,
        after=after,
        cross_validation=_together(misfits, folds),
        step_misfits=tuple(
            (tuple(step + 1 for step in fold), misfit) for fold, misfit in zip(folds, misfits)
        ),
        parameters=unknowns.parameters(x),
        alignment=unknowns.alignment(x),
    )


def _folds(count: int) -> list[list[int]]:
    """Groups of steps to be left out together."""
    number = min(count, _MOST_FOLDS)
    return [list(range(first, count, number)) for first in range(number)]


def _needed(
    jacobian: Sequence[FloatArray], folds: Sequence[Sequence[int]], unknowns: Unknowns
) -> str:
    """Why there are no intervals: a step that cannot be left out; '' if each can."""
    for fold in folds:
        others = [part for step, part in enumerate(jacobian) if step not in fold]
        if not others:
            return 'one step says nothing of how steps differ: there are no intervals'
        if left_open := undetermined_by(np.concatenate(others), unknowns):
            numbers = ', '.join(str(step + 1) for step in fold)
            return (
                f'without step {numbers} it would be open ({left_open[0]}), so nothing confirms '
                'the estimates: there are no intervals'
            )
    return ''


def _misfit(problem: Problem, x: FloatArray, steps: Sequence[int] | None = None) -> Misfit:
    chosen = range(len(problem.shapes)) if steps is None else steps
    away = [problem.residuals(x, step) for step in chosen]
    squares = np.mean([(part**2).sum(axis=-1).mean() for part in away])
    tip = np.mean([np.linalg.norm(part[-1]) for part in away])
    return Misfit(float(np.sqrt(squares)), float(tip) / problem.length)


def _together(misfits: Sequence[Misfit], folds: Sequence[Sequence[int]]) -> Misfit | None:
    """Misfit of all steps, each from the fold it was left out in."""
    if not misfits:
        return None
    share = np.array([len(fold) for fold in folds], dtype=np.float64)
    share /= share.sum()
    squares = share @ np.array([misfit.rms**2 for misfit in misfits])
    tip = share @ np.array([misfit.tip_error for misfit in misfits])
    return Misfit(float(np.sqrt(squares)), float(tip))


def _notes(problem: Problem, fits: Sequence[str], folds: int, after: Misfit) -> list[str]:
    """Remarks on a fit."""
    notes = []
    noise = float(np.sqrt(np.mean([shape.noise**2 / shape.frames for shape in problem.shapes])))
    if 0.0 < _BIASED * noise < after.rms:
        notes.append(
            f'noise of the camera explains {noise * 1e3:.3f} mm of the distance of '
            f'{after.rms * 1e3:.3f} mm that is left: the rest is of the model or of the tensions, '
            'and what is alike in all steps biases the estimates beyond their intervals'
        )
    if folds < len(problem.shapes):
        notes.append(f'{len(problem.shapes)} steps are left out in {folds} groups')
    if 'tension_offset' in fits:
        notes.append(
            'one tension offset for all tendons that read at least 1 % of the highest tension'
        )
    if 'alignment' in fits:
        notes += undetermined(np.concatenate([shape.points for shape in problem.shapes]))
    return notes
