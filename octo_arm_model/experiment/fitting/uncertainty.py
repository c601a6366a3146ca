"""Confidence intervals, correlations and undetermined directions of a fit.

**Intervals** come from leaving out one step at a time: the delete-one jackknife, which is the
cluster-robust variance CV3 of econometrics (MacKinnon, Nielsen and Webb 2023), with Student's t.
Its degrees of freedom are one less than the effective number of steps (Carter, Schnepel and
Steigerwald 2017): steps with little influence on a parameter hardly count. Nothing is assumed of
the errors within a step: they are correlated along a midline, and those of a tension or of the
model are shared by all frames, so formulas that count points or frames give too narrow intervals.
Steps are assumed to be independent.

**Correlations** are those of the parameters in the sum of squares itself; repeating the experiment
does not lower them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.experiment.fitting.unknowns import Unknown, Unknowns

_CONFIDENCE = 0.95
_STRONG = 0.95  # correlations above this are reported
# Singular values of the Jacobian below this part of the largest count as zero.
_SINGULAR = 1e-4
# Without effect: a change of an unknown by its `scale` moves no point by this part of the length.
_NO_EFFECT = 1e-6


@dataclass(frozen=True)
class Estimate:
    """Estimate of one parameter.

    Attributes:
        value: in ``unit``; None where the data do not determine it.
        stddev: its standard deviation; None where there is no other step to confirm it.
        interval95: its 95 % confidence interval; None likewise.
        unit: of all of these.
    """

    value: float | None
    stddev: float | None
    interval95: tuple[float, float] | None
    unit: str


def estimates_of(
    unknowns: Unknowns, x: FloatArray, found: FloatArray, freedom: FloatArray
) -> dict[str, Estimate]:
    """Estimates ``x`` with intervals from the fits ``found`` (folds, n) without some steps."""
    count = len(found)
    if count < 2:
        return {
            unknown.name: Estimate(unknown.value(float(at)), None, None, unknown.unit)
            for unknown, at in zip(unknowns.unknowns, x, strict=True)
        }
    deviation = np.sqrt((count - 1) / count * ((found - x) ** 2).sum(axis=0))
    reach = stdtrit(freedom, 0.5 + 0.5 * _CONFIDENCE) * deviation
    return {
        unknown.name: _estimate(unknown, *numbers)
        for unknown, *numbers in zip(
            unknowns.unknowns, x.tolist(), deviation.tolist(), reach.tolist(), strict=True
        )
    }


def _estimate(unknown: Unknown, at: float, deviation: float, reach: float) -> Estimate:
    low, high = (min(max(end, unknown.low), unknown.high) for end in (at - reach, at + reach))
    return Estimate(
        unknown.value(at),
        unknown.stddev(at, deviation),
        (unknown.value(low), unknown.value(high)),
        unknown.unit,
    )


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


def undetermined_by(jacobian: FloatArray, unknowns: Unknowns) -> tuple[str, ...]:
    """Directions of x that change no residual, in words, from derivatives (points, 3, n)."""
    scales = np.array([unknown.scale for unknown in unknowns.unknowns])
    moves = np.linalg.norm(jacobian * scales, axis=1)
    names = np.array(unknowns.names)
    still = moves.max(axis=0) < _NO_EFFECT * unknowns.arm.length
    if still.any():
        return tuple(f'{name} changes nothing that was measured' for name in names[still])
    flat, norms = _normalised(jacobian)
    _, singular, directions = np.linalg.svd(flat, full_matrices=False)
    return tuple(
        _told(unknowns.unknowns, direction / norms, scales)
        for size, direction in zip(singular, directions)
        if size < _SINGULAR * singular[0]
    )


def _normalised(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives (3 points, n) as columns of length 1, and their lengths."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    norms = np.linalg.norm(flat, axis=0)
    return flat / norms, norms


def _told(unknowns: Sequence[Unknown], move: FloatArray, scales: FloatArray) -> str:
    """A direction of x in words, without its small components."""
    share = np.abs(move / scales)
    largest = np.abs(move[share > 0.01 * share.max()]).max()
    words = []
    for unknown, step, part in zip(unknowns, move / largest, share / share.max(), strict=True):
        if part > 0.01:
            change = f'{step:+.3g} {unknown.unit}'
            if unknown.reference is not None:
                change = f'{100.0 * step:+.3g} %'
            words.append(f'{unknown.name} {change}')
    return f'changed together in this proportion nothing measured changes: {", ".join(words)}'


def correlations_of(jacobian: FloatArray) -> FloatArray:
    """Correlations of x from derivatives (points, 3, n), (n, n)."""
    flat, _ = _normalised(jacobian)
    covariance = np.linalg.inv(flat.T @ flat)
    deviation = np.sqrt(np.diag(covariance))
    return covariance / np.outer(deviation, deviation)


def strong_pairs(correlations: FloatArray, unknowns: Unknowns) -> list[str]:
    """Pairs of strong correlation, but for those within the alignment, which always correlate."""
    names = unknowns.names
    alignment = range(*unknowns.alignment_columns.indices(len(names)))
    return [
        f'the data hardly tell {names[one]} and {names[other]} apart: their correlation is '
        f'{correlations[one, other]:+.4f}'
        for one, other in zip(*np.triu_indices(len(names), 1))
        if abs(correlations[one, other]) > _STRONG
        and not (one in alignment and other in alignment)
    ]


def at_ends(unknowns: Unknowns, x: FloatArray) -> list[str]:
    """Remarks on unknowns at an end of their range."""
    return [
        f'{unknown.name} is at the end of its range, where its interval is not to be relied on'
        for unknown, at in zip(unknowns.unknowns, x, strict=True)
        if not math.isinf(unknown.high) and min(at - unknown.low, unknown.high - at) < 1e-3
    ]
