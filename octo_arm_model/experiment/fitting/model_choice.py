"""Which of several fitted models to take, and where near-equal misfits leave an estimate open."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from octo_arm_model.experiment.fitting.identification import Identification
from octo_arm_model.experiment.fitting.unknowns.unknown import is_of_arm

# Misfits are near-equal where their mean squares over the loads left out differ by less than so
# many standard errors, or where one is above the other by less than this part.
_ERRORS = 2.0
_NEAR = 0.1
# Estimates agree where they differ by less than the larger standard deviation or this part.
_SAME = 1e-3


def rank(one: Identification) -> float:
    """Misfit [m] at loads left out of the fit; of one load, at the load itself."""
    misfit = one.cross_validation or one.after
    return math.inf if misfit is None else misfit.rms


def best_of(fitted: Sequence[Identification]) -> Identification:
    """The one that best explains loads it was not fitted to."""
    return min(fitted, key=rank)


def near_best(fitted: Sequence[Identification]) -> list[Identification]:
    """The best and those with a misfit near it."""
    best = best_of(fitted)
    return [one for one in fitted if one is best or _is_near(best, one)]


def envelope_of(fitted: Sequence[Identification], name: str) -> tuple[float, float] | None:
    """The 95 % intervals of a parameter by all models near the best, as one; None without any."""
    intervals = [
        one.estimates[name].interval95 for one in near_best(fitted) if name in one.estimates
    ]
    known = [interval for interval in intervals if interval is not None]
    return (min(low for low, _ in known), max(high for _, high in known)) if known else None


def disagreements(fitted: Sequence[Identification]) -> list[str]:
    """Estimates that differ between the best model and those with a misfit near its, in words."""
    best = best_of(fitted)
    notes = []
    for other in near_best(fitted):
        for name, estimate in best.estimates.items():
            rival = other.estimates.get(name)
            if other is best or not is_of_arm(name) or rival is None:
                continue
            if estimate.value is None or rival.value is None:
                continue
            spread = max(estimate.stddev or 0.0, rival.stddev or 0.0, _SAME * abs(rival.value))
            if abs(estimate.value - rival.value) <= spread:
                continue
            low, high = envelope_of(fitted, name) or (-math.inf, math.inf)
            notes.append(
                f'MODELS DISAGREE: {other.model} explains loads left out nearly as well as '
                f'{best.model} ({rank(other) * 1e3:.3f} and {rank(best) * 1e3:.3f} mm) but says '
                f'{name} {rival.value:.4g} {rival.unit} instead of {estimate.value:.4g}; these '
                'data do not tell which, and an interval of one model does not hold this: all '
                f'models near the best together say {low:.4g} to {high:.4g}'
            )
    return notes


def _is_near(best: Identification, other: Identification) -> bool:
    if rank(other) <= (1.0 + _NEAR) * rank(best):
        return True
    pairs = list(zip(best.step_misfits, other.step_misfits))
    if len(pairs) < 2 or len(best.step_misfits) != len(other.step_misfits):
        return False
    worse = np.array([theirs.rms**2 - ours.rms**2 for (_, ours), (_, theirs) in pairs])
    return bool(worse.mean() < _ERRORS * worse.std(ddof=1) / math.sqrt(len(worse)))
