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
from octo_arm_model.experiment.unknowns import Unknown, Unknowns

P = TypeVar('P', bound=Problem)
T = TypeVar('T')

# Loads are one if no tension differs by more than this part of the highest.
_SAME = 0.02
# Fits at most: of more loads several are left out together.
MOST_FOLDS = 20


def steps_by_load(tensions: FloatArray) -> list[list[int]]:
    """Numbers of the steps, from 0, of each load among ``tensions`` (steps, tendons) [N]."""
    band = _SAME * float(tensions.max(initial=0.0))
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


def loaded(tensions: FloatArray, load: list[int]) -> bool:
    """Whether any tendon is pulled in a ``load`` of `steps_by_load`."""
    return bool(tensions[load[0]].max() > _SAME * float(tensions.max(initial=0.0)))


AUTO = 'auto'
# A robust loss is taken where its misfit at held-back loads is below this part of the plain one's.
_CLEARLY = 0.95


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
class HeldBackFit:
    """A fit by one loss.

    Attributes:
        loss: which of `LOSSES`.
        x: the fit to all steps.
        found: fits without each of the folds, (folds, n); empty where none can be left out.
        away: residuals of each step (m, 3) by the fit without it [m].
    """

    loss: str
    x: FloatArray
    found: FloatArray
    away: tuple[FloatArray, ...]

    @property
    def held_back(self) -> float:
        """Mean over the steps of the root mean square distance where they are held back [m].

        A mean of distances, not of their squares: a midline that was tracked wrongly is equally
        far from every fit, and its square would outweigh the differences at all others.
        """
        return float(np.mean([np.sqrt((part**2).sum(axis=-1).mean()) for part in self.away]))


def fit_by(
    problem: Problem,
    x: FloatArray,
    scale: float | None,
    loss: str,
    folds: Sequence[Sequence[int]],
    tick: Callable[[], None],
) -> HeldBackFit:
    """The fit ``x`` by ``loss`` with its ``scale``, and the fits without each of the ``folds``."""
    found: list[FloatArray] = []
    away: dict[int, FloatArray] = {}
    for fold in folds:
        tick()
        others = [step for step in range(len(problem.shapes)) if step not in fold]
        found.append(problem.minimise(x, scale, others))
        away |= {step: problem.residuals(found[-1], step) for step in fold}
    steps = range(len(problem.shapes)) if folds else ()
    return HeldBackFit(loss, x, np.array(found), tuple(away[step] for step in steps))


def better(tried: Sequence[HeldBackFit]) -> HeldBackFit:
    """The fit with the least misfit at held-back loads; the plain sum of squares if it is near."""
    first, *others = tried
    if not first.away:
        return first
    best = min(others, key=lambda one: one.held_back, default=first)
    return best if best.held_back < _CLEARLY * first.held_back else first


def misfit_of(away: Sequence[FloatArray], length: float) -> Misfit:
    """Misfit of steps with residuals ``away`` (m, 3) [m] of an arm of ``length`` [m]."""
    squares = np.mean([(part**2).sum(axis=-1).mean() for part in away])
    tip = np.mean([np.linalg.norm(part[-1]) for part in away])
    return Misfit(float(np.sqrt(squares)), float(tip) / length)


def noise_of(shapes: Sequence[MeasuredShape]) -> float:
    """Root mean square distance of the mean midlines from the truth by the camera's noise [m]."""
    return float(np.sqrt(np.mean([shape.noise**2 / shape.frames for shape in shapes])))


def unexplained(
    away: Sequence[FloatArray], jacobian: Sequence[FloatArray], columns: Sequence[int]
) -> float:
    """Root mean square distance [m] that no change at single steps explains.

    Of the residuals ``away`` of each step (m, 3) [m] and their derivatives (m, 3, n), of which the
    ``columns`` may change from step to step.
    """
    squares = []
    for residuals, derivatives in zip(away, jacobian, strict=True):
        flat, by = residuals.ravel(), derivatives.reshape(residuals.size, -1)[:, columns]
        rest = flat - by @ np.linalg.lstsq(by, flat, rcond=None)[0] if len(columns) else flat
        squares.append(rest @ rest / len(residuals))
    return float(np.sqrt(np.mean(squares)))


def floor_of(size: float, jacobian: Sequence[FloatArray], points: Sequence[int]) -> FloatArray:
    """Shift of each of x, (n,), by a model error of root mean square ``size`` [m] along it.

    Args:
        size: of the error, at what the camera sees.
        jacobian: derivatives (m, 3, n) of all residuals of each step.
        points: how many of the m are of the camera, the last ones.
    """
    stacked = np.concatenate([part.reshape(-1, part.shape[-1]) for part in jacobian])
    inverse = np.linalg.pinv(stacked)
    seen = np.concatenate(
        [
            np.repeat(np.arange(len(part)) >= len(part) - count, 3)
            for part, count in zip(jacobian, points, strict=True)
        ]
    )
    along = np.linalg.norm(inverse[:, seen], axis=1)
    return np.asarray(size * np.sqrt(sum(points)) * along)


def tip_error(away: Sequence[FloatArray], shapes: Sequence[MeasuredShape], length: float) -> float:
    """Standard deviation of each coordinate of the tip, in parts of the ``length`` [-].

    From held-back residuals ``away`` (m, 3) [m] of each step, without the camera's noise.
    """
    squares = np.mean([part[-1] @ part[-1] for part in away]) - noise_of(shapes) ** 2
    return float(np.sqrt(max(squares, 0.0) / 3.0)) / length


_CONFIDENCE = 0.95


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


def estimates_of(
    unknowns: Unknowns, x: FloatArray, found: FloatArray, freedom: FloatArray, floor: FloatArray
) -> dict[str, Estimate]:
    """Estimates ``x`` with intervals.

    From the fits ``found`` (folds, n) without some loads, their degrees of ``freedom`` (n,), and
    the standard deviation ``floor`` (n,) that the error of the model leaves.
    """
    count = len(found)
    if count < 2:
        return {
            unknown.name: Estimate(unknown.value(float(at)), None, None, unknown.unit)
            for unknown, at in zip(unknowns.unknowns, x, strict=True)
        }
    jackknife = np.sqrt((count - 1) / count * ((found - x) ** 2).sum(axis=0))
    at = 0.5 + 0.5 * _CONFIDENCE
    reach = np.hypot(stdtrit(freedom, at) * jackknife, ndtri(at) * floor)
    columns = np.array([x, np.hypot(jackknife, floor), x - reach, x + reach, floor])
    estimates = {}
    for one, (value, deviation, *ends, least) in zip(unknowns.unknowns, columns.T.tolist()):
        low, high = sorted(one.value(min(max(end, one.low), one.high)) for end in ends)
        of_model = one.stddev(value, least)
        estimates[one.name] = Estimate(
            one.value(value), one.stddev(value, deviation), (low, high), one.unit, of_model
        )
    return estimates


def freedom_of(jacobian: Sequence[FloatArray], folds: Sequence[Sequence[int]]) -> FloatArray:
    """Degrees of freedom of the standard deviation of each of x, at least 1, (n,).

    From the derivatives of the residuals of each step, (m, 3, n).
    """
    parts = [part.reshape(-1, part.shape[-1]) for part in jacobian]
    inverse = np.linalg.pinv(np.concatenate(parts))
    ends = np.cumsum([len(part) for part in parts])[:-1]
    of_step = np.array([(part**2).sum(axis=1) for part in np.split(inverse, ends, axis=1)])
    # Contribution of each fold to the variance for independent residuals of one variance.
    share = np.array([of_step[list(fold)].sum(axis=0) for fold in folds])
    variation = share.var(axis=0) / share.mean(axis=0) ** 2
    return np.maximum(len(folds) / (1.0 + variation) - 1.0, 1.0)


def correlations_of(jacobian: FloatArray) -> FloatArray:
    """Correlations of x from derivatives (points, 3, n), (n, n)."""
    flat, _ = normalised(jacobian)
    covariance = np.linalg.inv(flat.T @ flat)
    deviation = np.sqrt(np.diag(covariance))
    return covariance / np.outer(deviation, deviation)


# Singular values of the Jacobian below this part of the largest count as zero.
_SINGULAR = 1e-4
# Without effect: a change of an unknown by its `scale` moves no point by this part of the length.
_NO_EFFECT = 1e-6
# An unknown takes part in a direction with at least this share of that which moves most.
_PART = 0.1


class OpenDirection(NamedTuple):
    """A direction that the data leave open.

    Attributes:
        name: the unknown to leave out, so that the others are determined.
        reason: the direction in words.
    """

    name: str
    reason: str


def open_direction(
    jacobian: FloatArray, unknowns: Unknowns, x: FloatArray
) -> OpenDirection | None:
    """The first direction from ``x`` that changes no residual, from derivatives (points, 3, n).

    An unknown without any effect comes first. Of several that only together change nothing, that
    which is last in the order of `unknown.FITS` is to be left out.
    """
    scales = np.array([unknown.scale for unknown in unknowns.unknowns])
    moves = np.linalg.norm(jacobian * scales, axis=1).max(axis=0)
    for name, move in zip(unknowns.names, moves, strict=True):
        if move < _NO_EFFECT * unknowns.arm.length:
            return OpenDirection(name, f'{name} changes nothing that was measured')
    flat, norms = normalised(jacobian)
    _, singular, directions = np.linalg.svd(flat, full_matrices=False)
    if singular[-1] >= _SINGULAR * singular[0]:
        return None
    move = directions[-1] / norms
    share = np.abs(directions[-1])
    last = int(np.flatnonzero(share >= _PART * share.max())[-1])
    return OpenDirection(unknowns.names[last], _in_words(unknowns.unknowns, x, move, scales))


def normalised(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives (3 points, n) as columns of length 1, and their lengths."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    norms = np.linalg.norm(flat, axis=0)
    return flat / norms, norms


def _in_words(
    unknowns: Sequence[Unknown], x: FloatArray, move: FloatArray, scales: FloatArray
) -> str:
    """A direction of x in words, without its small components."""
    share = np.abs(move / scales)
    largest = np.abs(move[share > 0.01 * share.max()]).max()
    words = []
    columns = zip(unknowns, x.tolist(), move / largest, share / share.max(), strict=True)
    for unknown, at, step, part in columns:
        if part > 0.01:
            relative = unknown.relative_change(at, step)
            change = f'{step:+.3g} {unknown.unit}'
            if relative is not None:
                change = f'{100.0 * relative:+.3g} %'
            words.append(f'{unknown.name} {change}')
    return f'changed together in this proportion nothing measured changes: {", ".join(words)}'


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
        start = problem.unknowns.start
        jacobian = np.concatenate(problem.jacobian(start))
        found = open_direction(jacobian, problem.unknowns, start) or fit(problem)
        if not isinstance(found, OpenDirection):
            return problem, found
        left_out[found.name] = f'{found.name} is left as it is: {found.reason}'
    return None
