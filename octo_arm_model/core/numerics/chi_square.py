"""Quantiles of the chi-square distribution."""

from __future__ import annotations

import functools

from scipy.special import gammaincinv


@functools.lru_cache(maxsize=1024)
def chi_square_limit(probability: float, size: int) -> float:
    """Quantile of the chi-square distribution of ``size`` degrees of freedom."""
    # As scipy.stats.chi2.ppf, whose import takes a quarter of a second.
    return float(2.0 * gammaincinv(0.5 * size, probability))
