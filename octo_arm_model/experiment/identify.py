"""Parameters of the arm from measured shapes: fits to all steps, and to all but some.

Estimates minimise a sum of squares or a robust loss; `uncertainty` has their intervals.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment import uncertainty
from octo_arm_model.experiment.camera import Alignment, undetermined
from octo_arm_model.experiment.fit import LOSSES, Problem, fit_alignment
from octo_arm_model.experiment.identification import (
    Identification,
    at_ends,
    strong_pairs,
    unfitted,
)
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.experiment.steady_windows import (
    STILL,
    UNLOADING,
    directions,
    part_along,
    remarks,
)
from octo_arm_model.experiment.uncertainty import OpenDirection, misfit_of, noise_of
from octo_arm_model.experiment.unknowns import ALIGNMENT, AXIAL, Readings, Unknowns

# A misfit above so many times that of noise is not explained by noise.
_BIASED = 2.0
# A robust loss is taken where its misfit at held-back loads is below this part of the plain one's.
_CLEARLY = 0.95


class _Fit(NamedTuple):
    """A fit ``x`` by one ``loss``, with its scale [m]; None of the plain sum of squares."""

    loss: str
    x: FloatArray
    scale: float | None


class _HeldBack(NamedTuple):
    """Fits (folds, n) without some loads, and residuals of each step (m, 3) by that without it.

    Both are empty where none can be left out.
    """

    found: FloatArray = np.zeros((0, 0))
    away: tuple[FloatArray, ...] = ()

    @property
    def size(self) -> float:
        """Mean over the steps of the root mean square distance where they are held back [m].

        A mean of distances, not of their squares: a midline that was tracked wrongly is equally
        far from every fit, and its square would outweigh the differences at all others.
        """
        return float(np.mean([np.sqrt((part**2).sum(axis=-1).mean()) for part in self.away]))


def identify(
    shapes: Sequence[MeasuredShape],
    parameters: Mapping[str, Any],
    model: str,
    fits: Sequence[str] = ('youngs_modulus',),
    alignment: Alignment | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    loss: str = uncertainty.AUTO,
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
        ConfigError: if the model has no derivative by what is to be fitted, or no reading is
            of it.
        SolveError: if the model has no answer, or no minimum is found.
        MeasurementError: if a midline does not begin near the base.
    """
    readings, losses = Readings.of(shapes), LOSSES if loss == uncertainty.AUTO else (loss,)
    if alignment is None and 'alignment' in fits:
        alignment = fit_alignment(shapes, parameters, model)
    start = alignment or Alignment.none()

    def without(names: Collection[str]) -> Problem:
        return Problem(shapes, Unknowns(parameters, model, fits, readings, start, names))

    def fit_all(problem: Problem) -> list[_Fit] | OpenDirection:
        tried = [_Fit(name, *problem.solve(name)) for name in losses]
        opened = (uncertainty.open_direction(problem, one.x) for one in tried)
        return next(filter(None, opened), tried)

    nothing, left_out = unfitted(without(()), loss, parameters, start), dict[str, str]()
    while True:
        progress(0, len(losses))
        found = uncertainty.determined(without, fit_all, left_out)
        result = dataclasses.replace(nothing, undetermined=tuple(left_out.values()))
        if found is None:
            progress(len(losses), len(losses))
            return result
        result = _with_intervals(result, *found, progress)
        stretch = result.estimates.get(AXIAL)
        if stretch is None or stretch.value is None:
            return result
        low, high = stretch.interval95 or (stretch.value, stretch.value)
        if high < math.inf:
            return result
        least = '' if low == math.inf else f'; all from {low:.3g} N on explain them'
        left_out[AXIAL] = (
            f'{AXIAL} is left as it is: what the readings leave uncertain is more than what '
            f'tendons stretch by{least}'
        )


def _with_intervals(
    result: Identification,
    problem: Problem,
    tried: Sequence[_Fit],
    progress: Callable[[int, int], None],
) -> Identification:
    """The ``result`` of the best of the fits ``tried``, by the misfit at held-back loads."""
    loads = uncertainty.steps_by_load(problem.unknowns.readings.tensions)
    loose = _needed(problem, tried[0].x, loads)
    folds = [] if loose else uncertainty.folds_of(loads)
    total, begun = len(tried) * (len(folds) + 1), itertools.count()
    steps, held_back = range(len(problem.shapes)), []
    for one in tried:
        progress(next(begun), total)
        found, away = list[FloatArray](), dict[int, FloatArray]()
        for fold in folds:
            progress(next(begun), total)
            others = [step for step in steps if step not in fold]
            found.append(problem.minimise(one.x, one.scale, others))
            left = problem.residuals(found[-1])
            away |= {step: left[step] for step in fold}
        held_back.append(_HeldBack(np.array(found), tuple(away[step] for step in sorted(away))))
    best = 0
    if folds and len(tried) > 1:
        robust = min(range(1, len(tried)), key=lambda number: held_back[number].size)
        best = robust if held_back[robust].size < _CLEARLY * held_back[0].size else 0
    progress(total, total)
    result = _with_fit(result, problem, tried[best], held_back[best], folds)
    notes = [*_on_misfit(problem, result), *_on_branches(problem, tried[best].x)]
    if folds and len(tried) > 1:
        pairs = zip(held_back, tried, strict=True)
        words = ', '.join(f'{left.size * 1e3:.4f} mm by {one.loss}' for left, one in pairs)
        notes.append(f'loss {result.loss}, by the misfit at held-back loads: {words}')
    notes += _on_unknowns(problem, tried[best].x, result, len(loads))
    return dataclasses.replace(result, notes=(*notes, *([loose] if loose else [])))


def _with_fit(
    result: Identification,
    problem: Problem,
    fit: _Fit,
    held_back: _HeldBack,
    folds: Sequence[Sequence[int]],
) -> Identification:
    """The ``result`` with the values of a ``fit`` and their intervals."""
    x, length, away = fit.x, problem.length, held_back.away
    floor = tip_stddev = None
    if folds:
        floor = uncertainty.model_error(problem, x, away)
        square = np.mean([part[-1] @ part[-1] for part in away]) - noise_of(problem.shapes) ** 2
        tip_stddev = float(np.sqrt(max(square, 0.0) / 3.0)) / length
    shift = uncertainty.floor_of(problem, x, floor or 0.0)
    found = uncertainty.estimates_of(problem, x, held_back.found, folds, shift)
    tensions = [backbone.tensions.ravel() for backbone in problem.backbones(x)]
    return dataclasses.replace(
        result,
        loss=fit.loss,
        estimates={**result.estimates, **found},
        correlations=uncertainty.correlations_of(problem, x),
        after=misfit_of(problem.residuals(x), length),
        cross_validation=misfit_of(away, length) if folds else None,
        step_misfits=tuple(
            (tuple(step + 1 for step in fold), misfit_of([away[n] for n in fold], length))
            for fold in folds
        ),
        floor=floor,
        tip_stddev=tip_stddev,
        parameters=problem.unknowns.parameters(x),
        alignment=problem.unknowns.alignment(x),
        tensions=np.array(tensions),
    )


def _needed(problem: Problem, x: FloatArray, loads: list[list[int]]) -> str:
    """Why there are no intervals: a load that cannot be left out; '' if each can."""
    tensions = problem.unknowns.readings.tensions
    slack = uncertainty.SAME * float(tensions.max(initial=0.0))
    pulled = [load for load in loads if tensions[load[0]].max() > slack]
    if len(loads) == 1 or len(pulled) == 1:
        steps = ', '.join(str(step + 1) for step in (pulled or loads)[0])
        return (
            f'there is one load (step {steps}): repeats of it say nothing of how loads differ, '
            'so nothing confirms the estimates and there are no intervals'
        )
    for fold in uncertainty.folds_of(loads):
        if found := uncertainty.open_direction(problem, x, fold):
            numbers = ', '.join(str(step + 1) for step in fold)
            return (
                f'without step {numbers} it would be open ({found.reason}), so nothing confirms '
                'the estimates: there are no intervals'
            )
    return ''


def _on_misfit(problem: Problem, result: Identification) -> list[str]:
    """Remarks on what noise does not explain."""
    noise, rms = noise_of(problem.shapes), result.after.rms if result.after else 0.0
    notes = []
    if 0.0 < _BIASED * noise < rms:
        notes.append(
            f'noise of the camera explains {noise * 1e3:.3f} mm of the distance of '
            f'{rms * 1e3:.3f} mm that is left: the rest is of the model or of the tensions, '
            'and what is alike at all loads biases the estimates beyond their intervals'
        )
    if floor := result.floor:
        notes.append(
            f'model error floor: {floor * 1e3:.3f} mm ({100.0 * floor / problem.length:.2f} % of '
            'the length) at held-back loads is neither noise nor a change of the fitted '
            'parameters; the intervals hold a bias of this size'
        )
    return notes


def _on_branches(problem: Problem, x: FloatArray) -> list[str]:
    """Remarks on loading and unloading, where the modulus is fitted."""
    if 'youngs_modulus' not in problem.unknowns.names:
        return []
    shapes, least = problem.shapes, STILL * problem.length
    column = problem.unknowns.names.index('youngs_modulus')
    branches = directions(np.array([shape.window.tensions for shape in shapes]))
    # Residuals change opposite to the model's tip, which a softer arm moves as tensions do.
    pairs = zip(problem.residuals(x), problem.camera_jacobian(x), strict=True)
    bends = [part_along(away[-1], by[-1, :, column], least) for away, by in pairs]
    notes = remarks(
        [shape.tension for shape in shapes],
        bends,
        branches,
        noise_of(shapes) / 3.0**0.5,
        problem.length,
    )
    if UNLOADING in branches and notes:
        notes.append(
            'intervals take this difference for scatter from load to load, so they are wider than '
            '95 %: the branches cancel where each load is reached from both sides'
        )
    return notes


def _on_unknowns(problem: Problem, x: FloatArray, result: Identification, loads: int) -> list[str]:
    """Remarks on what is fitted, by steps of so many ``loads``."""
    shapes, unknowns = problem.shapes, problem.unknowns
    assert result.after is not None and result.correlations is not None
    notes = [*at_ends(unknowns, x), *strong_pairs(result.correlations, unknowns)]
    if loads < len(shapes):
        notes.append(f'{len(shapes)} steps are of {loads} loads; repeats count as one')
    if loads > uncertainty.MOST_FOLDS:
        notes.append(f'{loads} loads are left out in {uncertainty.MOST_FOLDS} groups')
    if 'tension_offset' in unknowns.names:
        notes.append(
            'one tension offset for all tendons that read at least 1 % of the highest tension'
        )
    if unknowns.reads_encoders:
        notes.append(
            f'residuals of encoders are weighed by {problem.encoder_scale(x) * 1e3:.3g} mm, '
            f'those of the camera by {problem.scale(x) * 1e3:.3g} mm: what each has left'
        )
    if {*ALIGNMENT} & {*unknowns.names}:
        points = np.concatenate([shape.points for shape in shapes])
        notes += undetermined(points, result.after.rms)
    return notes
