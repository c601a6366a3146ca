"""Quantiles of the chi-square distribution."""

from __future__ import annotations

import functools

from scipy.special import gammaincinv


@functools.lru_cache(maxsize=1024)
def chi_square_limit(probability: float, size: int) -> float:
    """What a normalised square of ``size`` numbers exceeds with 1 - ``probability``."""
    # That of scipy.stats, which takes a quarter of a second to import.
    return float(2.0 * gammaincinv(0.5 * size, probability))
