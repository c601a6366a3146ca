"""The result of a fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fitting.held_back import Misfit
from octo_arm_model.experiment.fitting.uncertainty import Estimate
from octo_arm_model.experiment.fitting.unknowns.unknown import is_of_arm
from octo_arm_model.experiment.shapes.alignment import Alignment
from octo_arm_model.experiment.shapes.mean_midlines import MeasuredShape


@dataclass(frozen=True)
class Identification:
    """A fitted model.

    Attributes:
        model: its name.
        loss: what was minimised, of `fit.LOSSES`.
        estimates: by name; those that the data leave open have no value.
        undetermined: why each of the others was left as it was, in words.
        before: misfit of the parameters the fit began with.
        parameters: of the fitted arm; see `Config.from_parameters`.
        alignment: transform camera to base.
        tensions: those of each step by the fitted load cells or, without, by the lengths that
            winches reeled in, (steps, tendons) [N].
        correlations: of the estimates with a value, (n, n), in their order; None of none.
        notes: remarks, in words.
        after: misfit of the fit, on the data it was fitted to; None if nothing is fitted.
        cross_validation: misfit of loads on which the model was not fitted; None of fewer than
            two loads.
        step_misfits: that of each fold of steps left out, and which these are, from 1.
        floor: distance that held-back loads show and neither noise nor a change at single steps
            explains, in `Estimate.model_stddev` [m]; None without held-back loads.
        tip_stddev: standard deviation of each coordinate of the tip at held-back loads, without
            the camera's noise, in parts of the length [-]; None likewise.
    """

    model: str
    loss: str
    estimates: Mapping[str, Estimate]
    undetermined: tuple[str, ...]
    before: Misfit
    parameters: Mapping[str, Any]
    alignment: Alignment
    tensions: FloatArray
    correlations: FloatArray | None = None
    notes: tuple[str, ...] = ()
    after: Misfit | None = None
    cross_validation: Misfit | None = None
    step_misfits: tuple[tuple[tuple[int, ...], Misfit], ...] = ()
    floor: float | None = None
    tip_stddev: float | None = None

    @property
    def is_trustworthy(self) -> bool:
        """Whether the data determine a parameter other than poses and zeros, if one was fitted."""
        own = [name for name in self.estimates if is_of_arm(name)] or list(self.estimates)
        return any(self.estimates[name].value is not None for name in own)

    def with_tensions(self, shapes: Sequence[MeasuredShape]) -> list[MeasuredShape]:
        """The ``shapes`` it was fitted to, with the tensions that the fit takes them for."""
        return [
            dataclasses.replace(shape, window=dataclasses.replace(shape.window, tensions=row))
            for shape, row in zip(shapes, self.tensions, strict=True)
        ]
