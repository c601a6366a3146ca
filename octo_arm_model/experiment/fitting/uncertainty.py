"""Confidence intervals and correlations of a fit.

**Intervals** come from leaving out one load at a time, all its repeats together: the delete-one
jackknife, which is the cluster-robust variance CV3 of econometrics (MacKinnon, Nielsen and Webb
2023), with Student's t. Its degrees of freedom are one less than the effective number of loads
(Carter, Schnepel and Steigerwald 2017): loads with little influence on a parameter hardly count.
Nothing is assumed of the errors within a load: they are correlated along a midline, and those of a
tension or of the model are shared by all frames and repeats, so formulas that count points, frames
or steps give too narrow intervals. Loads are assumed to be independent.

What is wrong at all loads alike the jackknife cannot see. The error of the model that held-back
loads show (`model_error`) is added to it, in quadrature.

**Correlations** are those of the parameters in the sum of squares itself; repeating the experiment
does not lower them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fitting.unknowns.open_directions import normalised
from octo_arm_model.experiment.fitting.unknowns.unknown import Unknown
from octo_arm_model.experiment.fitting.unknowns.unknowns import Unknowns

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
    columns = (x, np.hypot(jackknife, floor), reach, floor)
    return {
        unknown.name: _estimate(unknown, *numbers)
        for unknown, *numbers in zip(
            unknowns.unknowns, *(column.tolist() for column in columns), strict=True
        )
    }


def _estimate(
    unknown: Unknown, at: float, deviation: float, reach: float, floor: float
) -> Estimate:
    ends = (min(max(end, unknown.low), unknown.high) for end in (at - reach, at + reach))
    low, high = sorted(unknown.value(end) for end in ends)
    return Estimate(
        unknown.value(at),
        unknown.stddev(at, deviation),
        (low, high),
        unknown.unit,
        unknown.stddev(at, floor),
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


def correlations_of(jacobian: FloatArray) -> FloatArray:
    """Correlations of x from derivatives (points, 3, n), (n, n)."""
    flat, _ = normalised(jacobian)
    covariance = np.linalg.inv(flat.T @ flat)
    deviation = np.sqrt(np.diag(covariance))
    return covariance / np.outer(deviation, deviation)
