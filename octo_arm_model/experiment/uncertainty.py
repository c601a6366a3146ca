"""Confidence intervals and correlations of a fit.

**Intervals** come from leaving out one load at a time, all its repeats together: the delete-one
jackknife, which is the cluster-robust variance CV3 of econometrics (MacKinnon, Nielsen and Webb
2023), with Student's t. Its degrees of freedom are one less than the effective number of loads
(Carter, Schnepel and Steigerwald 2017): loads with little influence on a parameter hardly count.
Nothing is assumed of the errors within a load: they are correlated along a midline, and those of a
tension or of the model are shared by all frames and repeats, so formulas that count points, frames
or steps give too narrow intervals. Loads are assumed to be independent.

**Model error.** What is wrong at all loads alike the jackknife cannot see. At each held-back load
the residuals have a part that a change of material or tensions at this load alone would explain,
and a rest that none explains. The rest, less the noise of the camera, is of the model. An error of
the model of the same size may as well lie along what the parameters change, the same at all loads:
that shifts the estimates, and no measurement at these loads shows it. `floor_of` bounds this
shift, which is added in quadrature.

**Correlations** are those of the parameters in the sum of squares itself; repeating the experiment
does not lower them.
"""

import itertools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from scipy.special import ndtri, stdtrit

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fit import Problem
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.experiment.unknowns import is_of_arm

P = TypeVar('P', bound=Problem)
T = TypeVar('T')

AUTO = 'auto'
SAME = 0.02  # loads are one if no tension differs by more than this part of the highest
MOST_FOLDS = 20  # fits at most: of more loads several are left out together
_CONFIDENCE = 0.95
# Singular values of the Jacobian below this part of the largest count as zero.
_SINGULAR = 1e-4
# Without effect: a change of an unknown by its `scale` moves no point by this part of the length.
_NO_EFFECT = 1e-6
# An unknown takes part in a direction with at least this share of that which moves most.
_PART = 0.1


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
class Estimate:
    """Estimate of one parameter.

    Attributes:
        value: in ``unit``; None where the data do not determine it.
        stddev: its standard deviation; None where there is no other step to confirm it.
        interval95: its 95 % confidence interval; None likewise.
        unit: of all of these.
        model_stddev: the part of ``stddev`` that is the error of the model; None likewise.
    """

    value: float | None
    stddev: float | None
    interval95: tuple[float, float] | None
    unit: str
    model_stddev: float | None = None


def misfit_of(away: Sequence[FloatArray], length: float) -> Misfit:
    """Misfit of steps with residuals ``away`` (m, 3) [m] of an arm of ``length`` [m]."""
    squares = np.mean([(part**2).sum(axis=-1).mean() for part in away])
    tip = np.mean([np.linalg.norm(part[-1]) for part in away])
    return Misfit(float(np.sqrt(squares)), float(tip) / length)


def noise_of(shapes: Sequence[MeasuredShape]) -> float:
    """Root mean square distance of the mean midlines from the truth by the camera's noise [m]."""
    return float(np.sqrt(np.mean([shape.noise**2 / shape.frames for shape in shapes])))


def steps_by_load(tensions: FloatArray) -> list[list[int]]:
    """Numbers of the steps, from 0, of each load among ``tensions`` (steps, tendons) [N]."""
    band = SAME * float(tensions.max(initial=0.0))
    loads: list[list[int]] = []
    for step, pulled in enumerate(tensions):
        for load in loads:
            if np.abs(pulled - tensions[load[0]]).max(initial=0.0) <= band:
                load.append(step)
                break
        else:
            loads.append([step])
    return loads


def folds_of(loads: list[list[int]]) -> list[list[int]]:
    """Steps to be left out together: those of one load, of several where there are many."""
    number = min(len(loads), MOST_FOLDS)
    return [sorted(itertools.chain.from_iterable(loads[first::number])) for first in range(number)]


def model_error(problem: Problem, x: FloatArray, away: Sequence[FloatArray]) -> float:
    """Distance at held-back loads that neither noise nor a change at single steps explains [m].

    Of the residuals ``away`` of each step (m, 3) [m]; what may change from step to step is all of
    the fit ``x`` that is of the arm.
    """
    columns = [n for n, name in enumerate(problem.unknowns.names) if is_of_arm(name)]
    squares = []
    for residuals, derivatives in zip(away, problem.camera_jacobian(x), strict=True):
        rest, by = residuals.ravel(), derivatives.reshape(residuals.size, -1)[:, columns]
        if columns:
            rest = rest - by @ np.linalg.lstsq(by, rest, rcond=None)[0]
        squares.append(rest @ rest / len(residuals))
    return float(np.sqrt(max(float(np.mean(squares)) - noise_of(problem.shapes) ** 2, 0.0)))


def floor_of(problem: Problem, x: FloatArray, size: float) -> FloatArray:
    """Shift of each of ``x``, (n,), by a model error of root mean square ``size`` [m] along it.

    The error is of what the camera sees, the last residuals of each step.
    """
    jacobian = problem.jacobian(x)
    parts = zip(jacobian, problem.shapes, strict=True)
    seen = [np.arange(len(part)) >= len(part) - len(shape.points) for part, shape in parts]
    is_seen = np.repeat(np.concatenate(seen), 3)
    inverse = np.linalg.pinv(np.concatenate(jacobian).reshape(-1, x.size))
    along = np.linalg.norm(inverse[:, is_seen], axis=1)
    return np.asarray(size * np.sqrt(is_seen.sum() / 3) * along)


def estimates_of(
    problem: Problem,
    x: FloatArray,
    found: FloatArray,
    folds: Sequence[Sequence[int]],
    floor: FloatArray,
) -> dict[str, Estimate]:
    """Estimates ``x`` with intervals.

    From the fits ``found`` (folds, n) without the steps of each of ``folds``, and the standard
    deviation ``floor`` (n,) that the error of the model leaves. Without two folds at least there
    are no intervals.
    """
    unknowns, count = problem.unknowns.unknowns, len(found)
    if count < 2:
        pairs = zip(unknowns, x.tolist(), strict=True)
        return {one.name: Estimate(one.value(at), None, None, one.unit) for one, at in pairs}
    jackknife = np.sqrt((count - 1) / count * ((found - x) ** 2).sum(axis=0))
    freedom = _freedom(problem.jacobian(x), folds)
    at = 0.5 + 0.5 * _CONFIDENCE
    reach = np.hypot(stdtrit(freedom, at) * jackknife, ndtri(at) * floor)
    columns = np.array([x, np.hypot(jackknife, floor), x - reach, x + reach, floor])
    estimates = {}
    for one, (value, deviation, *ends, least) in zip(unknowns, columns.T.tolist()):
        low, high = sorted(one.value(min(max(end, one.low), one.high)) for end in ends)
        of_model = one.stddev(value, least)
        estimates[one.name] = Estimate(
            one.value(value), one.stddev(value, deviation), (low, high), one.unit, of_model
        )
    return estimates


def _freedom(jacobian: Sequence[FloatArray], folds: Sequence[Sequence[int]]) -> FloatArray:
    """Degrees of freedom of the standard deviation of each of x, at least 1, (n,)."""
    parts = [part.reshape(-1, part.shape[-1]) for part in jacobian]
    inverse = np.linalg.pinv(np.concatenate(parts))
    ends = np.cumsum([len(part) for part in parts])[:-1]
    of_step = np.array([(part**2).sum(axis=1) for part in np.split(inverse, ends, axis=1)])
    # Contribution of each fold to the variance for independent residuals of one variance.
    share = np.array([of_step[list(fold)].sum(axis=0) for fold in folds])
    variation = share.var(axis=0) / share.mean(axis=0) ** 2
    return np.maximum(len(folds) / (1.0 + variation) - 1.0, 1.0)


def correlations_of(problem: Problem, x: FloatArray) -> FloatArray:
    """Correlations of the fit ``x``, (n, n)."""
    flat, _ = _normalised(np.concatenate(problem.jacobian(x)))
    covariance = np.linalg.inv(flat.T @ flat)
    deviation = np.sqrt(np.diag(covariance))
    return covariance / np.outer(deviation, deviation)


class OpenDirection(NamedTuple):
    """A direction that the data leave open.

    Attributes:
        name: the unknown to leave out, so that the others are determined.
        reason: the direction in words.
    """

    name: str
    reason: str


def open_direction(
    problem: Problem, x: FloatArray, without: Collection[int] = ()
) -> OpenDirection | None:
    """The first direction from ``x`` that changes no residual of the steps but those ``without``.

    An unknown without any effect comes first. Of several that only together change nothing, that
    which is last in the order of `unknowns.FITS` is to be left out.
    """
    parts = problem.jacobian(x)
    jacobian = np.concatenate([part for step, part in enumerate(parts) if step not in without])
    unknowns = problem.unknowns.unknowns
    scales = np.array([unknown.scale for unknown in unknowns])
    moves = np.linalg.norm(jacobian * scales, axis=1).max(axis=0)
    for one, move in zip(unknowns, moves, strict=True):
        if move < _NO_EFFECT * problem.length:
            return OpenDirection(one.name, f'{one.name} changes nothing that was measured')
    flat, norms = _normalised(jacobian)
    _, singular, directions = np.linalg.svd(flat, full_matrices=False)
    if singular[-1] >= _SINGULAR * singular[0]:
        return None
    share = np.abs(directions[-1])
    last = int(np.flatnonzero(share >= _PART * share.max())[-1])
    # In words, without small components.
    move = directions[-1] / norms
    share = np.abs(move / scales)
    is_large = share > 0.01 * share.max()
    move /= np.abs(move[is_large]).max()
    words = []
    for number in np.flatnonzero(is_large).tolist():
        one, step = unknowns[number], float(move[number])
        relative = one.relative_change(float(x[number]), step)
        change = f'{step:+.3g} {one.unit}' if relative is None else f'{100.0 * relative:+.3g} %'
        words.append(f'{one.name} {change}')
    reason = 'changed together in this proportion nothing measured changes: '
    return OpenDirection(unknowns[last].name, reason + ', '.join(words))


def _normalised(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives (3 points, n) as columns of length 1, and their lengths."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    norms = np.linalg.norm(flat, axis=0)
    return flat / norms, norms


def determined(
    problem_without: Callable[[Collection[str]], P],
    fit: Callable[[P], T | OpenDirection],
    left_out: dict[str, str],
) -> tuple[P, T] | None:
    """The problem of what the data determine, and its ``fit``; None where that is nothing.

    What else is open is added to ``left_out``, with the reason: it is looked for at the start,
    since with an undetermined direction no minimisation converges, and by ``fit``.
    """
    while (problem := problem_without(tuple(left_out))).unknowns.unknowns:
        found = open_direction(problem, problem.unknowns.start) or fit(problem)
        if not isinstance(found, OpenDirection):
            return problem, found
        left_out[found.name] = f'{found.name} is left as it is: {found.reason}'
    return None
