"""Parameters of the arm from measured shapes: fits to all steps, and without some loads.

Estimates minimise a sum of squares or a robust loss; `uncertainty` has their intervals. Damping,
drag and added mass follow from an arm that moves, by a fit to every frame. The intervals of that
fit come from leaving out one of a few stretches of time after the other, to first order: errors of
neighbouring frames may be alike, but those of different stretches are taken to be independent.
"""

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.experiment import uncertainty
from octo_arm_model.experiment.camera import undetermined
from octo_arm_model.experiment.fit import LOSSES, SOFT_L1, Problem, fit_alignment
from octo_arm_model.experiment.identification import Identification, at_ends, strong_pairs
from octo_arm_model.experiment.motion import MotionProblem, TensionTrajectory
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.experiment.steady_windows import UNLOADING
from octo_arm_model.experiment.uncertainty import Estimate, OpenDirection, misfit_of, noise_of
from octo_arm_model.experiment.unknowns import ALIGNMENT, AXIAL, Readings, Scale, Unknowns

# Noise does not explain a misfit above this multiple of the noise.
_BIASED = 2.0
# The robust loss is chosen if its misfit at left-out loads is below this part of the plain one's.
_CLEARLY = 0.95
_STRETCHES = 10  # largest number of stretches of time of a motion
_FEWEST = 4  # frames of a stretch
_ALIKE = 0.7  # correlation of neighbouring residuals above which the model is wrong


class _Fit(NamedTuple):
    """A fit by one loss, and what it would be without some loads."""

    loss: str
    x: FloatArray  #: the fit (n,)
    scale: float | None  #: scale of the loss [m]; None for the plain sum of squares
    #: fits without each fold of loads (folds, n); none if no load can be left out
    without: FloatArray = np.zeros((0, 0))
    left_out: Sequence[FloatArray] = ()  #: residuals of each step (m, 3) by the fit without it [m]

    @property
    def left_out_misfit(self) -> float:
        """Mean over the left-out steps of the root mean square distance [m].

        It is a mean of distances, not of their squares: a wrongly tracked midline is equally far
        from every fit, and its square would outweigh the differences at all others.
        """
        return float(np.mean([np.sqrt((part**2).sum(axis=-1).mean()) for part in self.left_out]))


def identify(  # noqa: PLR0913 - options of a command
    shapes: Sequence[MeasuredShape],
    parameters: Mapping[str, Any],
    model: str,
    fits: Sequence[str] = ('youngs_modulus',),
    alignment: Pose | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    loss: str = uncertainty.AUTO,
    trajectory: TensionTrajectory | None = None,
) -> Identification:
    """Fit the parameters ``fits`` of ``model`` to measured ``shapes``.

    A parameter keeps its value if the data leave it open or, in a motion, determine it less than
    its `scale`.

    Args:
        shapes: a shape for each steady step.
        parameters: parameters that are not fitted, and initial values of the others.
        model: name of the model.
        fits: names of `unknowns.FITS`.
        alignment: transform camera to base, or the start of its fit; None for the identity or, if
            the alignment is fitted, for a separate fit of the alignment as the start.
        progress: called with the numbers of fits done and of all fits.
        loss: a loss of `fit.LOSSES`, or 'auto' for the one with less misfit at left-out loads; of
            a motion that is soft_l1.
        trajectory: tensions along which the arm of the model exact moves, whose moments the steps
            are; None for equilibria.

    Raises:
        ConfigError: if the model has no derivative by one of ``fits``, or no reading, or not this
            motion, depends on it.
        SolveError: if the model has no solution, no minimum is found, or a motion has no swing.
        MeasurementError: if a midline does not begin near the base.
    """
    if loss == uncertainty.AUTO and trajectory is not None:
        loss = SOFT_L1
    readings, losses = Readings.of(shapes), LOSSES if loss == uncertainty.AUTO else (loss,)
    if alignment is None and 'alignment' in fits:
        alignment = fit_alignment(shapes, parameters, model)
    start = alignment or Pose()

    def without(names: Collection[str]) -> Problem:
        moves = trajectory is not None
        unknowns = Unknowns(parameters, model, fits, readings, start, names, moves)
        if trajectory is None:
            return Problem(shapes, unknowns)
        return MotionProblem(shapes, unknowns, trajectory)

    first = without(())
    if isinstance(first, MotionProblem):
        first.check_swing()
    unknowns = first.unknowns
    nothing = Identification(
        model=model,
        loss=loss,
        estimates={one.name: Estimate(None, None, None, one.unit) for one in unknowns.unknowns},
        before=misfit_of(first.residuals(unknowns.start), first.length),
        parameters=parameters,
        alignment=start,
        tensions=readings.tensions,
        shapes=first.shapes,
        trajectory=trajectory,
    )

    def fit_all(problem: Problem) -> Identification | OpenDirection:
        tried = []
        for number, name in enumerate(losses):
            progress(number, len(losses))
            tried.append(_Fit(name, *problem.solve(name)))
        open_directions = (uncertainty.open_direction(problem, fit.x) for fit in tried)
        if found := next(filter(None, open_directions), None):
            return found
        if trajectory is not None:
            return _of_motion(nothing, problem, tried[0])
        result = _with_intervals(nothing, problem, tried)
        return _vague(result, problem.unknowns) or result

    result, left_out = uncertainty.determined(without, fit_all)
    progress(len(losses), len(losses))
    return dataclasses.replace(result or nothing, undetermined=left_out)


def _vague(result: Identification, unknowns: Unknowns) -> OpenDirection | None:
    """Return the last of the ``unknowns`` whose size is not known by the ``result``, or None."""
    for one in reversed(unknowns.unknowns):
        estimate = result.estimates[one.name]
        assert estimate.value is not None
        low, high = estimate.interval95 or (estimate.value, estimate.value)
        if one.name == AXIAL and high == math.inf:
            least = '' if low == math.inf else f'; all from {low:.3g} N on explain them'
            reason = (
                f'what the readings leave uncertain is more than what tendons stretch by{least}'
            )
            return OpenDirection(one.name, reason)
        deviation = estimate.stddev or 0.0
        if one.kind is Scale.LOGARITHM and deviation > estimate.value:
            reason = (
                f'its standard deviation, {deviation:.2g} {one.unit}, is larger than itself; all '
                f'from {low:.2g} to {high:.2g} explain what was measured'
            )
            return OpenDirection(one.name, reason)
    return None


def _of_motion(
    result: Identification, problem: Problem, fit: _Fit
) -> Identification | OpenDirection:
    """Return the ``result`` of a ``fit`` to a motion.

    Or return the unknown to leave out, if the motion hardly determines it.
    """
    unknowns, x, count = problem.unknowns, fit.x, len(problem.shapes)
    # The folds are stretches of time, as numbers of frames; none has too few frames.
    number = min(_STRETCHES, count // _FEWEST)
    parts = np.array_split(np.arange(count), number) if number else []
    folds = [part.tolist() for part in parts]
    without, _ = problem.without(x, fit.scale, folds)
    scales = np.array([unknown.scale for unknown in unknowns.unknowns])
    deviation = np.sqrt(((without - x) ** 2).sum(axis=0))  # of the jackknife, but for (n - 1) / n
    worst = int((deviation / scales).argmax())
    if deviation[worst] > scales[worst]:
        one = unknowns.unknowns[worst]
        to = one.stddev(float(x[worst]), float(deviation[worst]))
        return OpenDirection(one.name, f'the motion tells it only to {to:.2g} {one.unit}')
    away, correlations = problem.residuals(x), uncertainty.correlations_of(problem, x)
    notes = [*at_ends(unknowns, x), *strong_pairs(correlations, unknowns)]
    notes.append(f'intervals come from leaving out one of {len(folds)} stretches of time')
    tips = np.array([part[-1] for part in away])
    if (tips[1:] * tips[:-1]).sum() > _ALIKE * max((tips * tips).sum(), 1e-300):
        notes.append(
            'residuals go on from frame to frame, as noise does not: the model does not '
            'explain all of the motion, which biases the estimates beyond their intervals'
        )
    return dataclasses.replace(
        result,
        parameters=unknowns.parameters(x),
        correlations=correlations,
        notes=tuple(notes),
        estimates={**result.estimates, **uncertainty.estimates_of(problem, x, without, folds)},
        after=misfit_of(away, problem.length),
    )


def _with_intervals(
    result: Identification, problem: Problem, tried: Sequence[_Fit]
) -> Identification:
    """Return the ``result`` of the best of the fits ``tried``, by the misfit at left-out loads."""
    loads = uncertainty.steps_by_load(problem.unknowns.readings.tensions)
    reason = _why_no_intervals(problem, tried[0].x, loads)
    folds = [] if reason else uncertainty.folds_of(loads)
    tried = [_Fit(*fit[:3], *problem.without(fit.x, fit.scale, folds)) for fit in tried]
    best = tried[0]
    if folds and len(tried) > 1:
        robust = min(tried[1:], key=lambda fit: fit.left_out_misfit)
        best = robust if robust.left_out_misfit < _CLEARLY * best.left_out_misfit else best
    result = _with_fit(result, problem, best, folds)
    notes = [*_misfit_notes(problem, result), *_branch_notes(problem, result)]
    if folds and len(tried) > 1:
        words = ', '.join(f'{fit.left_out_misfit * 1e3:.4f} mm by {fit.loss}' for fit in tried)
        notes.append(f'loss {result.loss}, by the misfit at left-out loads: {words}')
    notes += _fit_notes(problem, best.x, result, len(loads))
    return dataclasses.replace(result, notes=(*notes, *([reason] if reason else [])))


def _with_fit(
    result: Identification, problem: Problem, fit: _Fit, folds: Sequence[Sequence[int]]
) -> Identification:
    """Return the ``result`` with the values of a ``fit`` and their intervals."""
    x, length, away = fit.x, problem.length, fit.left_out
    floor = tip_stddev = None
    if folds:
        floor = uncertainty.model_error(problem, x, fit.without, away)
        square = np.mean([part[-1] @ part[-1] for part in away]) - noise_of(problem.shapes) ** 2
        tip_stddev = float(np.sqrt(max(square, 0.0) / 3.0)) / length
    estimates = uncertainty.estimates_of(problem, x, fit.without, folds, floor or 0.0)
    tensions = [backbone.tensions.ravel() for backbone in problem.backbones(x)]
    return dataclasses.replace(
        result,
        loss=fit.loss,
        estimates={**result.estimates, **estimates},
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


def _why_no_intervals(problem: Problem, x: FloatArray, loads: list[list[int]]) -> str:
    """Say why there are no intervals: a load cannot be left out; '' if each can."""
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


def _misfit_notes(problem: Problem, result: Identification) -> list[str]:
    """Return remarks on the misfit that noise does not explain."""
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
            'the length) at left-out loads is neither noise nor a change of the fitted '
            'parameters; the intervals hold a bias of this size'
        )
    return notes


def _branch_notes(problem: Problem, result: Identification) -> list[str]:
    """Return remarks on loading and unloading, if the modulus is fitted."""
    if 'youngs_modulus' not in problem.unknowns.names:
        return []
    fitted = result.comparison
    if UNLOADING in (step.direction for step in fitted.steps) and fitted.notes:
        return [
            *fitted.notes,
            'intervals take this difference for scatter from load to load, so they are wider than '
            '95 %: the branches cancel where each load is reached from both sides',
        ]
    return list(fitted.notes)


def _fit_notes(problem: Problem, x: FloatArray, result: Identification, loads: int) -> list[str]:
    """Return remarks on the fitted unknowns; ``loads`` is the number of different loads."""
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
        band = result.parameters.get('tension_deadband', 0.0)
        if lost := int(((result.tensions > 0.0) & (result.tensions <= band)).sum()):
            notes.append(
                f'the fitted tension_deadband of {band:.3g} N holds slack tendons with that '
                f'offset, and {lost} fitted tension(s) of this recording too'
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
