"""Confidence intervals and correlations of a fit.

**Intervals** come from leaving out one load at a time, all its repeats together: the delete-one
jackknife, which is the cluster-robust variance CV3 of econometrics (MacKinnon, Nielsen and Webb
2023), with Student's t; each fit without a load is one Newton step from that of all. Its degrees
of freedom are one less than the effective number of loads (Carter, Schnepel and Steigerwald 2017):
loads with little influence on a parameter hardly count. Errors within a load may have any
correlation: they are correlated along a midline, and those of a tension or of the model are shared
by all frames and repeats, so that formulas that count points, frames or steps give too narrow
intervals. Loads are assumed to be independent.

**Model error.** The jackknife does not see an error that is the same at all loads. At each load
left out, a change of material or tensions at this load alone explains a part of the residuals. The
rest, without the noise of the camera, is an error of the model. An error of the same size may also
lie in the directions of the parameters, the same at all loads: it shifts the estimates, and no
measurement at these loads shows it. `estimates_of` adds a bound of this shift in quadrature.

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

T = TypeVar('T')

AUTO = 'auto'
SAME = 0.02  # steps have the same load if no tension differs by more than this of the highest
MOST_FOLDS = 20  # largest number of folds: if there are more loads, several are left out together
_CONFIDENCE = 0.95
# Singular values of the Jacobian below this part of the largest count as zero.
_SINGULAR = 1e-4
# An unknown has no effect if its `scale` moves no point by this part of the length.
_NO_EFFECT = 1e-6
# An unknown belongs to a direction if it has at least this part of the largest share.
_PART = 0.1


@dataclass(frozen=True)
class Misfit:
    """Distance of model and measurement."""

    rms: float  #: root mean square distance of paired points [m]
    tip_error: float  #: mean distance of the tips, relative to the length [-]


@dataclass(frozen=True)
class Estimate:
    """Estimate of one parameter."""

    value: float | None  #: value in ``unit``; None if the data do not determine it
    stddev: float | None  #: standard deviation; None if no other step confirms the value
    #: 95 % confidence interval; None if no other step confirms the value
    interval95: tuple[float, float] | None
    unit: str  #: unit of all numbers
    #: part of ``stddev`` due to the error of the model; None as ``stddev``
    model_stddev: float | None = None


def misfit_of(away: Sequence[FloatArray], length: float) -> Misfit:
    """Return the misfit of residuals ``away`` (m, 3) [m] of an arm of ``length`` [m]."""
    squares = np.mean([(part**2).sum(axis=-1).mean() for part in away])
    tip = np.mean([np.linalg.norm(part[-1]) for part in away])
    return Misfit(float(np.sqrt(squares)), float(tip) / length)


def noise_of(shapes: Sequence[MeasuredShape]) -> float:
    """Return the root mean square error of the mean midlines by the camera's noise [m]."""
    return float(np.sqrt(np.mean([shape.noise**2 / shape.frames for shape in shapes])))


def steps_by_load(tensions: FloatArray) -> list[list[int]]:
    """Return the indices of the steps of each load among ``tensions`` (steps, tendons) [N]."""
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
    """Return the steps to leave out together: those of one load, or of several if many."""
    number = min(len(loads), MOST_FOLDS)
    return [sorted(itertools.chain.from_iterable(loads[first::number])) for first in range(number)]


def model_error(
    problem: Problem, x: FloatArray, found: FloatArray, away: Sequence[FloatArray]
) -> float:
    """Return the distance at left-out loads that noise and changes at single steps leave [m].

    ``away`` has the residuals of each step (m, 3) [m]; changes at a single step are of those
    components of ``x`` that belong to the arm and, unless both together explain any residuals
    there, of all pulls. The other components, such as the pose of the camera, are not exact in a
    fit without a load: what the scatter of the fits ``found`` (folds, n) makes of this is no error
    of the model.
    """
    columns = [n for n, name in enumerate(problem.unknowns.names) if is_of_arm(name)]
    squares = []
    steps = zip(away, problem.camera_jacobian(x), problem.camera_by_pull(x), strict=True)
    for residuals, by_x, by_pull in steps:
        by, _ = _normalised(np.concatenate([by_pull, by_x[..., columns]], axis=-1))
        if np.linalg.matrix_rank(by, _SINGULAR) == residuals.size:
            by = by[:, by_pull.shape[-1] :]
        scatter = by_x.reshape(residuals.size, -1) @ (found - x).T
        both = np.column_stack([residuals.ravel(), scatter])
        square, *others = ((both - by @ np.linalg.lstsq(by, both, rcond=_SINGULAR)[0]) ** 2).sum(0)
        squares.append((square - np.sum(others)) / len(residuals))
    return float(np.sqrt(max(float(np.mean(squares)) - noise_of(problem.shapes) ** 2, 0.0)))


def estimates_of(
    problem: Problem,
    x: FloatArray,
    found: FloatArray,
    folds: Sequence[Sequence[int]],
    size: float = 0.0,
) -> dict[str, Estimate]:
    """Return the estimates ``x`` with their intervals.

    The intervals come from the fits ``found`` (folds, n) without the steps of each of ``folds``,
    and from an error of the model of root mean square ``size`` [m]. With fewer than two folds
    there are no intervals.
    """
    unknowns, count = problem.unknowns.unknowns, len(found)
    if count < 2:
        pairs = zip(unknowns, x.tolist(), strict=True)
        return {one.name: Estimate(one.value(at), None, None, one.unit) for one, at in pairs}
    jackknife = np.sqrt((count - 1) / count * ((found - x) ** 2).sum(axis=0))
    jacobian = problem.jacobian(x)
    inverse = np.linalg.pinv(np.concatenate(jacobian).reshape(-1, x.size))
    # The error of the model is in the residuals of the camera, the last ones of each step.
    parts = zip(jacobian, problem.shapes, strict=True)
    seen = [np.arange(len(part)) >= len(part) - len(shape.points) for part, shape in parts]
    is_seen = np.repeat(np.concatenate(seen), 3)
    floor = size * np.sqrt(is_seen.sum() / 3) * np.linalg.norm(inverse[:, is_seen], axis=1)
    freedom = _freedom(np.split(inverse, 3 * np.cumsum(list(map(len, jacobian)))[:-1], 1), folds)
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


def _freedom(inverses: Sequence[FloatArray], folds: Sequence[Sequence[int]]) -> FloatArray:
    """Return the degrees of freedom of the standard deviation of each of x, at least 1, (n,).

    ``inverses`` have the change of x by the residuals of each step, (n, 3 points).
    """
    of_step = np.array([(part**2).sum(axis=1) for part in inverses])
    # The share of each fold in the variance, for independent residuals of equal variance.
    share = np.array([of_step[list(fold)].sum(axis=0) for fold in folds])
    variation = share.var(axis=0) / share.mean(axis=0) ** 2
    return np.maximum(len(folds) / (1.0 + variation) - 1.0, 1.0)


def correlations_of(problem: Problem, x: FloatArray) -> FloatArray:
    """Return the correlations of the fit ``x``, (n, n)."""
    flat, _ = _normalised(np.concatenate(problem.jacobian(x)))
    covariance = np.linalg.inv(flat.T @ flat)
    deviation = np.sqrt(np.diag(covariance))
    return covariance / np.outer(deviation, deviation)


class OpenDirection(NamedTuple):
    """A direction that the data leave open."""

    name: str  #: name of the unknown to leave out, so that the others are determined
    reason: str  #: description of the direction


def open_direction(
    problem: Problem, x: FloatArray, without: Collection[int] = ()
) -> OpenDirection | None:
    """Return a direction from ``x`` that changes no residual, except of the steps ``without``.

    An unknown without any effect comes first. If several unknowns together change nothing, the
    last in the order of `unknowns.FITS` is the one to leave out.
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
    # Small components are left out of the description.
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
    """Return derivatives (3 points, n) with columns of norm 1, and the norms."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    norms = np.linalg.norm(flat, axis=0)
    return flat / np.where(norms > 0.0, norms, 1.0), norms


def determined(
    problem_without: Callable[[Collection[str]], Problem],
    fit: Callable[[Problem], T | OpenDirection],
) -> tuple[T | None, tuple[str, ...]]:
    """Return the ``fit`` of the problem of the determined unknowns, None if there are none.

    Return also why the others keep their values. Open unknowns are looked for at the start,
    because no minimisation converges with an undetermined direction, and by ``fit``.
    """
    left_out: dict[str, str] = {}
    while (problem := problem_without(tuple(left_out))).unknowns.unknowns:
        found = open_direction(problem, problem.unknowns.start) or fit(problem)
        if not isinstance(found, OpenDirection):
            return found, tuple(left_out.values())
        left_out[found.name] = f'{found.name} is left as it is: {found.reason}'
    return None, tuple(left_out.values())
