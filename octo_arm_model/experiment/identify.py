"""Parameters of the arm from measured shapes: fits to all steps, and to all but some.

Estimates minimise a sum of squares or a robust loss; `uncertainty` has their intervals.
"""

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment import uncertainty
from octo_arm_model.experiment.camera import Alignment, undetermined
from octo_arm_model.experiment.fit import LOSSES, SOFT_L1, Problem, fit_alignment
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
from octo_arm_model.experiment.unknowns import AXIAL, Readings, Unknowns, is_of_arm

Fits = dict[str, tuple[FloatArray, float | None]]  # x and the scale, by each loss
# A misfit above so many times that of noise is not explained by noise.
_BIASED = 2.0


def notes_on(
    problem: Problem,
    best: uncertainty.HeldBackFit,
    found: Identification,
    *,
    loose: str,
    fits: Sequence[str],
    tried: Sequence[uncertainty.HeldBackFit],
) -> list[str]:
    """All remarks on the ``best`` of the fits ``tried`` of ``fits``, which was ``found``.

    ``loose`` is the reason why no load can be left out; '' where each can.
    """
    after, correlations = found.after, found.correlations
    assert after is not None and correlations is not None
    notes = [
        *_of_misfit(problem, after, found.floor),
        *_of_branches(problem, best),
        *_of_loss(tried, best),
        *at_ends(problem.unknowns, best.x),
        *strong_pairs(correlations, problem.unknowns),
    ]
    tensions = np.array([shape.window.tensions for shape in problem.shapes])
    loads = len(uncertainty.steps_by_load(tensions))
    if loads < len(problem.shapes):
        notes.append(f'{len(problem.shapes)} steps are of {loads} loads; repeats count as one')
    if loads > uncertainty.MOST_FOLDS:
        notes.append(f'{loads} loads are left out in {uncertainty.MOST_FOLDS} groups')
    if 'tension_offset' in fits:
        notes.append(
            'one tension offset for all tendons that read at least 1 % of the highest tension'
        )
    if problem.unknowns.reads_encoders:
        notes.append(
            f'residuals of encoders are weighed by {problem.encoder_scale(best.x) * 1e3:.3g} mm, '
            f'those of the camera by {problem.scale(best.x) * 1e3:.3g} mm: what each has left'
        )
    if 'alignment' in fits:
        notes += undetermined(
            np.concatenate([shape.points for shape in problem.shapes]), after.rms
        )
    return [*notes, loose] if loose else notes


def _of_misfit(problem: Problem, after: uncertainty.Misfit, floor: float | None) -> list[str]:
    noise = uncertainty.noise_of(problem.shapes)
    notes = []
    if 0.0 < _BIASED * noise < after.rms:
        notes.append(
            f'noise of the camera explains {noise * 1e3:.3f} mm of the distance of '
            f'{after.rms * 1e3:.3f} mm that is left: the rest is of the model or of the tensions, '
            'and what is alike at all loads biases the estimates beyond their intervals'
        )
    if floor:
        notes.append(
            f'model error floor: {floor * 1e3:.3f} mm ({100.0 * floor / problem.length:.2f} % of '
            'the length) at held-back loads is neither noise nor a change of the fitted '
            'parameters; the intervals hold a bias of this size'
        )
    return notes


def _of_branches(problem: Problem, best: uncertainty.HeldBackFit) -> list[str]:
    """Remarks on loading and unloading, where the modulus is fitted."""
    if 'youngs_modulus' not in problem.unknowns.names:
        return []
    column = problem.unknowns.names.index('youngs_modulus')
    steps, least = range(len(problem.shapes)), STILL * problem.length
    ways = directions(np.array([shape.window.tensions for shape in problem.shapes]))
    # Residuals change opposite to the model's tip, which a softer arm moves as tensions do.
    by = problem.camera_jacobian(best.x)
    bends = [
        part_along(problem.residuals(best.x, step)[-1], by[step][-1, :, column], least)
        for step in steps
    ]
    tensions = [shape.tension for shape in problem.shapes]
    notes = remarks(
        tensions, bends, ways, uncertainty.noise_of(problem.shapes) / 3.0**0.5, problem.length
    )
    if UNLOADING in ways and notes:
        notes.append(
            'intervals take this difference for scatter from load to load, so they are wider than '
            '95 %: the branches cancel where each load is reached from both sides'
        )
    return notes


def _of_loss(tried: Sequence[uncertainty.HeldBackFit], best: uncertainty.HeldBackFit) -> list[str]:
    if len(tried) < 2 or not best.away:
        return []
    words = ', '.join(f'{one.held_back * 1e3:.4f} mm by {one.loss}' for one in tried)
    return [f'loss {best.loss}, by the misfit at held-back loads: {words}']


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
        self._loads = uncertainty.steps_by_load(self._readings.tensions)
        self._folds = uncertainty.folds_of(self._loads)
        self._losses: tuple[str, ...] = (self.loss,)
        if self.loss == uncertainty.AUTO:  # where nothing can be held back the robust one
            self._losses = LOSSES if self._folds else (SOFT_L1,)
        self._alignment = self.alignment or (
            fit_alignment(self.shapes, self.parameters, self.model)
            if 'alignment' in self.fits
            else Alignment.none()
        )
        self._nothing = unfitted(self._problem(()), self.loss, self.parameters, self._alignment)

    def _problem(self, without: Collection[str]) -> Problem:
        unknowns = Unknowns(
            self.parameters, self.model, self.fits, self._readings, self._alignment, without
        )
        return Problem(self.shapes, unknowns)

    def without(
        self, left_out: dict[str, str], progress: Callable[[int, int], None]
    ) -> Identification:
        """The fit without those ``left_out``, and why; what else is open is added to them."""
        total = len(self._losses) * (len(self._folds) + 1)
        progress(0, total)
        found = uncertainty.determined(self._problem, self._fits, left_out)
        nothing = dataclasses.replace(self._nothing, undetermined=tuple(left_out.values()))
        if found is None:
            progress(total, total)
            return nothing
        problem, fitted = found
        first = next(iter(fitted.values()))[0]
        loose = _needed(problem, first, self._folds, self._loads)
        used = [] if loose else self._folds
        begun = iter(range(total))

        def tick() -> None:
            progress(next(begun), total)

        tried = []
        for name, (x, scale) in fitted.items():
            tick()
            tried.append(uncertainty.fit_by(problem, x, scale, name, used, tick))
        best = uncertainty.better(tried)
        progress(total, total)
        fit = _with_fit(nothing, problem, best, used)
        notes = notes_on(problem, best, fit, loose=loose, fits=self.fits, tried=tried)
        return dataclasses.replace(fit, notes=tuple(notes))

    def _fits(self, problem: Problem) -> Fits | uncertainty.OpenDirection:
        """What the fit comes to by each loss, or what one of them leaves open."""
        fits = {name: problem.solve(name) for name in self._losses}
        for x, _ in fits.values():
            jacobian = np.concatenate(problem.jacobian(x))
            if found := uncertainty.open_direction(jacobian, problem.unknowns, x):
                return found
        return fits


def _with_fit(
    nothing: Identification,
    problem: Problem,
    best: uncertainty.HeldBackFit,
    folds: Sequence[Sequence[int]],
) -> Identification:
    """The result ``nothing`` with the values of the ``best`` fit of a ``problem``."""
    unknowns, x, length = problem.unknowns, best.x, problem.length
    jacobian = problem.jacobian(x)
    floor, tip_stddev = None, None
    if folds:
        columns = [n for n, name in enumerate(unknowns.names) if is_of_arm(name)]
        rest = uncertainty.unexplained(best.away, problem.camera_jacobian(x), columns)
        floor = float(np.sqrt(max(rest**2 - uncertainty.noise_of(problem.shapes) ** 2, 0.0)))
        tip_stddev = uncertainty.tip_error(best.away, problem.shapes, length)
    found = uncertainty.estimates_of(
        unknowns,
        x,
        best.found,
        uncertainty.freedom_of(jacobian, folds) if folds else np.ones(x.size),
        uncertainty.floor_of(floor or 0.0, jacobian, [len(s.points) for s in problem.shapes]),
    )
    return dataclasses.replace(
        nothing,
        loss=best.loss,
        estimates={**nothing.estimates, **found},
        correlations=uncertainty.correlations_of(np.concatenate(jacobian)),
        after=uncertainty.misfit_of(problem.all_residuals(x), length),
        cross_validation=uncertainty.misfit_of(best.away, length) if folds else None,
        step_misfits=tuple(
            (
                tuple(step + 1 for step in fold),
                uncertainty.misfit_of([best.away[n] for n in fold], length),
            )
            for fold in folds
        ),
        floor=floor,
        tip_stddev=tip_stddev,
        parameters=unknowns.parameters(x),
        alignment=unknowns.alignment(x),
        tensions=np.array(
            [problem.backbone(x, step).tensions.ravel() for step in range(len(problem.shapes))]
        ),
    )


def _needed(
    problem: Problem, x: FloatArray, folds: Sequence[Sequence[int]], loads: Sequence[Sequence[int]]
) -> str:
    """Why there are no intervals: a load that cannot be left out; '' if each can."""
    tensions = problem.unknowns.readings.tensions
    pulled = [load for load in loads if uncertainty.loaded(tensions, list(load))]
    if len(loads) == 1 or len(pulled) == 1:
        steps = ', '.join(str(step + 1) for step in (pulled or loads)[0])
        return (
            f'there is one load (step {steps}): repeats of it say nothing of how loads differ, '
            'so nothing confirms the estimates and there are no intervals'
        )
    jacobian = problem.jacobian(x)
    for fold in folds:
        others = [part for step, part in enumerate(jacobian) if step not in fold]
        if found := uncertainty.open_direction(np.concatenate(others), problem.unknowns, x):
            numbers = ', '.join(str(step + 1) for step in fold)
            return (
                f'without step {numbers} it would be open ({found.reason}), so nothing confirms '
                'the estimates: there are no intervals'
            )
    return ''
