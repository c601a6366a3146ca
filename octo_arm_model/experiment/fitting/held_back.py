"""A fit to all steps, and to all but those of one load at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fitting.least_squares.fit import Problem

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
    problem: Problem, x: FloatArray, scale: float | None, loss: str,
    folds: Sequence[Sequence[int]], tick: Callable[[], None],
) -> HeldBackFit:  # fmt: skip
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
