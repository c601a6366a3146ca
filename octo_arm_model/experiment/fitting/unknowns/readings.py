"""Readings of load cells and encoders in the steps of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.shapes.mean_midlines import MeasuredShape


class Readings(NamedTuple):
    """Readings of the tendons in all steps.

    Attributes:
        tensions: (steps, tendons) [N].
        displacements: of encoders, (steps, tendons) [m], NaN where there is none.
        are_lengths: whether tensions were not read, but follow from displacements.
    """

    tensions: FloatArray
    displacements: FloatArray
    are_lengths: bool = False

    @classmethod
    def of(cls, shapes: Sequence[MeasuredShape]) -> Readings:
        """Readings in the windows of measured ``shapes``."""
        tensions = np.array([shape.window.tensions for shape in shapes])
        none = np.full(tensions.shape[1], np.nan)
        read = [shape.window.displacements for shape in shapes]
        displacements = np.array([none if row is None else row for row in read])
        return cls(tensions, displacements, any(shape.window.is_driven for shape in shapes))
