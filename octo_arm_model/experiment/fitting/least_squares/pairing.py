"""Pairs of measured points and points of the model, and their residuals.

Points are paired by their fraction of the length from the beginning of the measured midline to the
tip. That needs no markers on the arm, and noise, which lengthens a midline evenly, does not change
it. The midline begins at the point of the model nearest to its first point. Markers are
paired with the points of the model at their arc coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fitting.least_squares import robust_loss
from octo_arm_model.experiment.shapes.alignment import Alignment, align
from octo_arm_model.experiment.shapes.curves import along, along_change, place_change
from octo_arm_model.experiment.shapes.mean_midlines import MeasuredShape
from octo_arm_model.experiment.shapes.midlines import fraction_at_start
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.interpolation import interpolated

_ROUNDS = 20


def _fractions(count: int, start: float) -> tuple[FloatArray, FloatArray]:
    """Fractions of the model's length for ``count`` points, and their derivatives by the start."""
    share = np.linspace(0.0, 1.0, count) if count > 1 else np.ones(1)
    return start + (1.0 - start) * share, 1.0 - share


def residuals(measured: FloatArray, model: FloatArray) -> FloatArray:
    """Points ``measured`` (m, 3) less those of ``model`` (n, 3) they are paired with [m]."""
    fraction, _ = _fractions(len(measured), fraction_at_start(measured, model))
    return measured - along(model, fraction)


def residuals_change(
    measured: FloatArray, by_measured: FloatArray, model: FloatArray, by_model: FloatArray
) -> FloatArray:
    """Derivative of `residuals` (m, 3, p) for those of its arguments, (m, 3, p) and (n, 3, p)."""
    start = fraction_at_start(measured, model)
    fraction, by_start = _fractions(len(measured), start)
    start_change = place_change(model, by_model, start, measured[0], by_measured[0])
    by_fraction = np.outer(by_start, start_change)
    return by_measured - along_change(model, by_model, fraction, by_fraction)


def shape_residuals(shape: MeasuredShape, measured: FloatArray, backbone: Backbone) -> FloatArray:
    """Points of a ``shape``, ``measured`` (m, 3) in base_frame, less those of the model [m]."""
    if shape.s is None:
        return residuals(measured, backbone.position)
    return measured - interpolated(shape.s, backbone.s, backbone.position)


def shape_residuals_change(
    shape: MeasuredShape,
    measured: FloatArray,
    by_measured: FloatArray,
    backbone: Backbone,
    by_model: FloatArray,
) -> FloatArray:
    """Derivative of `shape_residuals` (m, 3, p) for (m, 3, p) and (n, 3, p) of its points."""
    if shape.s is None:
        return residuals_change(measured, by_measured, backbone.position, by_model)
    return by_measured - interpolated(shape.s, backbone.s, by_model)


def first_alignment(
    shapes: Sequence[MeasuredShape], models: Sequence[FloatArray], stations: FloatArray
) -> Alignment:
    """Alignment of ``shapes``, in the camera's frame, with ``models`` (n, 3), roughly.

    The models have ``stations`` (n,) [m]. As if all midlines began at the base. Iteratively
    reweighted, so that outliers count less.

    Raises:
        MeasurementError: if there are fewer than three points.
    """
    camera = np.concatenate([shape.points for shape in shapes])
    if len(camera) < 3:
        raise MeasurementError(
            f'{len(camera)} measured point(s), expected at least 3 to fit an alignment to'
        )
    base = np.concatenate([
        along(model, _fractions(len(shape.points), 0.0)[0]) if shape.s is None
        else interpolated(shape.s, stations, model)
        for shape, model in zip(shapes, models, strict=True)
    ])  # fmt: skip
    finest = 1e-6 * float(np.ptp(base, axis=0).max())
    alignment = align(camera, base)
    for _ in range(_ROUNDS):
        away = alignment.to_base(camera) - base
        alignment = align(
            camera, base, robust_loss.weights(away, robust_loss.scale_of(away, finest))
        )
    return alignment
