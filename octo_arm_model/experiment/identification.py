"""The result of a fit: its parameter file, and the choice among several models."""

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import parameters_as_yaml
from octo_arm_model.experiment.compare import ModelComparison, compare
from octo_arm_model.experiment.motion import TensionTrajectory
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.experiment.uncertainty import Estimate, Misfit
from octo_arm_model.experiment.unknowns import ALIGNMENT, Unknowns, is_of_arm


@dataclass(frozen=True)
class Identification:
    """A fitted model."""

    model: str  #: name of the model
    loss: str  #: loss that was minimised, of `fit.LOSSES`
    #: estimates by name; one that the data leave open has no value
    estimates: Mapping[str, Estimate]
    before: Misfit  #: misfit of the parameters that the fit started with
    parameters: Mapping[str, Any]  #: parameters of the fitted arm, as for `Config.from_parameters`
    alignment: Pose  #: transform camera to base
    #: tensions of each step by the fitted load cells or, without load cells, by the lengths that
    #: winches reeled in, (steps, tendons) [N]
    tensions: FloatArray
    undetermined: tuple[str, ...] = ()  #: reasons why the others keep their values, in words
    #: correlations of the estimates with a value, (n, n), in their order, or None
    correlations: FloatArray | None = None
    notes: tuple[str, ...] = ()  #: remarks, in words
    #: misfit of the fit, on the data it was fitted to; None if nothing is fitted
    after: Misfit | None = None
    #: misfit at loads left out of the fit; None for fewer than two loads
    cross_validation: Misfit | None = None
    #: numbers of the steps of each left-out fold, from 1, and its misfit
    step_misfits: tuple[tuple[tuple[int, ...], Misfit], ...] = ()
    #: distance at left-out loads that neither noise nor a change at single steps explains,
    #: contained in `Estimate.model_stddev` [m]; None if no load was left out
    floor: float | None = None
    #: standard deviation of each coordinate of the tip at left-out loads, without the camera's
    #: noise, over the length [-]; None if no load was left out
    tip_stddev: float | None = None
    shapes: tuple[MeasuredShape, ...] = ()  #: the measurements that it is fitted to
    #: tensions along which the arm moves; None for equilibria
    trajectory: TensionTrajectory | None = None

    @property
    def is_trustworthy(self) -> bool:
        """Whether the data determine a parameter other than poses and zeros, if one was fitted."""
        names = [name for name in self.estimates if is_of_arm(name)] or list(self.estimates)
        return any(self.estimates[name].value is not None for name in names)

    @functools.cached_property
    def comparison(self) -> ModelComparison:
        """The fitted arm compared with the measurements, under the tensions of the fit.

        Raises:
            OctoArmError: as `compare`.
        """
        shapes = [
            dataclasses.replace(shape, window=dataclasses.replace(shape.window, tensions=row))
            for shape, row in zip(self.shapes, self.tensions, strict=True)
        ]
        fitted = self.parameters, self.model, self.alignment
        return compare(shapes, *fitted, trajectory=self.trajectory)


def as_config(fitted: Identification, source: str) -> str:
    """Return the ROS parameter file of a fitted arm, with standard deviations of its material.

    The calibration of load cells is among the parameters, so that the same recording read with
    this file has the misfit of the fit.

    Raises:
        ConfigError: if no node could load it.
    """
    values = dict(fitted.parameters)
    estimates = fitted.estimates
    young, ratio = estimates.get('youngs_modulus'), estimates.get('poisson_ratio')
    if young is not None and young.value is not None and young.stddev is not None:
        values['material.youngs_modulus_stddev'] = young.stddev / young.value
    if ratio is not None and ratio.stddev is not None:
        values['material.poisson_ratio_stddev'] = ratio.stddev
    if fitted.tip_stddev is not None:
        values['model_error_stddev'] = fitted.tip_stddev
    Config.from_parameters(values)  # a node must be able to load it
    lines = [f'# Fitted to {source} by octo-arm identify.']
    for name, estimate in estimates.items():
        lines.append(f'# {name}: {in_words(estimate)}')
    return '\n'.join(lines) + '\n' + parameters_as_yaml(values)


def in_words(estimate: Estimate) -> str:
    """Return an ``estimate`` with unit, standard deviation and interval as text."""
    if estimate.value is None:
        return 'not determined'
    text = f'{estimate.value:.6g} {estimate.unit}'
    if estimate.stddev is None or estimate.interval95 is None:
        return f'{text}, no interval'
    low, high = estimate.interval95
    return f'{text}, stddev {estimate.stddev:.2g}, 95 % interval {low:.6g} to {high:.6g}'


_STRONG = 0.95  # correlations above this are reported


def strong_pairs(correlations: FloatArray, unknowns: Unknowns) -> list[str]:
    """Describe strongly correlated pairs, except within the alignment, which always correlates."""
    names = unknowns.names
    return [
        f'the data hardly tell {names[first]} and {names[second]} apart: their correlation is '
        f'{correlations[first, second]:+.4f}'
        for first, second in zip(*np.triu_indices(len(names), 1))
        if abs(correlations[first, second]) > _STRONG
        and not {names[first], names[second]} <= set(ALIGNMENT)
    ]


def at_ends(unknowns: Unknowns, x: FloatArray) -> list[str]:
    """Return remarks on unknowns at an end of their range."""
    return [
        f'{unknown.name} is at the end of its range, where its interval is not to be relied on'
        for unknown, at in zip(unknowns.unknowns, x, strict=True)
        if not math.isinf(unknown.high) and min(at - unknown.low, unknown.high - at) < 1e-3
    ]


# Misfits are nearly equal if their mean squares over the left-out loads differ by less than this
# number of standard errors, or if one exceeds the other by less than this part.
_ERRORS = 2.0
_NEAR = 0.1
# Estimates agree if they differ by less than the larger standard deviation or this part.
_SAME = 1e-3


def rank(fit: Identification) -> float:
    """Return the misfit [m] at loads left out of the fit, or of a single load the fit's own."""
    misfit = fit.cross_validation or fit.after
    return math.inf if misfit is None else misfit.rms


def best_of(fitted: Sequence[Identification]) -> Identification:
    """Return the fit that best explains loads it was not fitted to."""
    return min(fitted, key=rank)


def _near_best(fitted: Sequence[Identification]) -> list[Identification]:
    """Return the best fit and those with nearly the same misfit."""
    best = best_of(fitted)
    near = []
    for other in fitted:
        pairs = list(zip(best.step_misfits, other.step_misfits))
        is_near = other is best or rank(other) <= (1.0 + _NEAR) * rank(best)
        if not is_near and len(best.step_misfits) == len(other.step_misfits) >= 2:
            worse = np.array([theirs.rms**2 - ours.rms**2 for (_, ours), (_, theirs) in pairs])
            is_near = worse.mean() < _ERRORS * worse.std(ddof=1) / math.sqrt(len(worse))
        near += [other] if is_near else []
    return near


def envelope_of(fitted: Sequence[Identification], name: str) -> tuple[float, float] | None:
    """Return the union of the 95 % intervals of all models near the best, or None."""
    intervals = [
        fit.estimates[name].interval95 for fit in _near_best(fitted) if name in fit.estimates
    ]
    known = [interval for interval in intervals if interval is not None]
    return (min(low for low, _ in known), max(high for _, high in known)) if known else None


def disagreements(fitted: Sequence[Identification]) -> list[str]:
    """Describe estimates that differ between the best model and those with nearly its misfit."""
    best = best_of(fitted)
    notes = []
    for other in _near_best(fitted):
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
                f'MODELS DISAGREE: {other.model} explains loads left out as well as {best.model} '
                f'up to chance or {_NEAR:.0%} ({rank(other) * 1e3:.3f} and '
                f'{rank(best) * 1e3:.3f} mm), but says {name} {rival.value:.4g} {rival.unit} '
                f'instead of {estimate.value:.4g}; these data do not tell which, and an interval '
                f'of one model does not hold this: all models near the best together '
                f'say {low:.4g} to {high:.4g}'
            )
    return notes
