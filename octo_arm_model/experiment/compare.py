"""Errors of the model against measured midlines, step by step, as in the paper's Table 1."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.config.config import Config
from octo_arm_model.core.errors import SolveError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.rod.backbone import Backbone
from octo_arm_model.experiment.fitting.fit import fit_alignment
from octo_arm_model.experiment.fitting.pairing import shape_residuals
from octo_arm_model.experiment.fitting.unknowns import FINE_STATIONS
from octo_arm_model.experiment.recording.alignment import Alignment, undetermined
from octo_arm_model.experiment.recording.markers import is_at_tip
from octo_arm_model.experiment.recording.mean_midlines import MeasuredShape
from octo_arm_model.experiment.recording.midlines import (
    MidlineErrors,
    fraction_at_start,
    marker_errors,
    midline_errors,
)


@dataclass(frozen=True)
class StepComparison:
    """One step: the measurement, the solution and their distance.

    Attributes:
        number: of the step, from 1.
        shape: the measurement.
        measured: its midline in base_frame (m, 3) [m].
        backbone: the solution of the model.
        errors: distances between the two.
    """

    number: int
    shape: MeasuredShape
    measured: FloatArray
    backbone: Backbone
    errors: MidlineErrors


@dataclass(frozen=True)
class ModelComparison:
    """All steps of one model.

    Attributes:
        model: its name.
        length: of the arm [m].
        alignment: transform camera to base.
        steps: those with a solution.
        refused: errors of the others.
        notes: remarks on a fitted alignment.
    """

    model: str
    length: float
    alignment: Alignment
    steps: tuple[StepComparison, ...]
    refused: tuple[str, ...]
    notes: tuple[str, ...]

    def percent(self, name: str) -> FloatArray:
        """Errors ``name`` of all steps in per cent of the length, NaN where not measured."""
        values = [getattr(step.errors, name) for step in self.steps]
        return np.array([np.nan if value is None else 100.0 * value / self.length
                         for value in values])  # fmt: skip


def compare(
    shapes: Sequence[MeasuredShape],
    parameters: Mapping[str, Any],
    model: str,
    alignment: Alignment | None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> ModelComparison:
    """Compare ``model`` of the arm of ``parameters`` with measured ``shapes``.

    Without ``alignment`` one is fitted, the same for all steps: it removes the part of the model's
    error that a rigid motion of the camera explains.

    Raises:
        SolveError: if the model has no answer for any step.
        MeasurementError: if an alignment cannot be fitted, or midlines do not begin near the
            base.
    """
    config = Config.from_parameters(parameters)
    solver = config.solver(model, max(config.stations, FINE_STATIONS))
    answered: list[tuple[int, MeasuredShape, Backbone]] = []
    refused: list[str] = []
    for number, shape in enumerate(shapes, start=1):
        progress(number - 1, len(shapes))
        tensions = shape.window.tensions.reshape(solver.arm.tension_shape)
        try:
            answered.append((number, shape, solver.solve(tensions)))
        except SolveError as error:
            refused.append(f'step {number}: {error}')
    if not answered:
        raise SolveError(f'{model} has no answer for any step; {refused[0]}')
    notes: list[str] = []
    if alignment is None:
        alignment = fit_alignment([shape for _, shape, _ in answered], parameters, model)
        notes.append(
            'the alignment is fitted: it removes the error that a motion of the camera explains'
        )
        notes += undetermined(np.concatenate([shape.points for _, shape, _ in answered]))
    steps = []
    for number, shape, backbone in answered:
        measured = alignment.to_base(shape.points)
        if shape.s is None:
            fraction_at_start(measured, backbone.position, check=True)
            errors = midline_errors(measured, backbone.position)
        else:
            away = shape_residuals(shape, measured, backbone)
            errors = marker_errors(away, is_at_tip(shape.s, solver.arm.length))
        steps.append(StepComparison(number, shape, measured, backbone, errors))
    return ModelComparison(
        solver.model, solver.arm.length, alignment, tuple(steps), tuple(refused), tuple(notes)
    )
