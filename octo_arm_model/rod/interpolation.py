"""Linear interpolation between rows of numbers, and the nearest row."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray, IntArray


def interpolated(at: FloatArray | float, x: FloatArray, rows: FloatArray) -> FloatArray:
    """Interpolate ``rows`` (n, ...) at ascending ``x`` (n,) to ``at``: (*at.shape, ...).

    Constant before the first and after the last ``x``.
    """
    columns = rows.reshape(len(rows), -1).T
    found = np.stack([np.interp(at, x, column) for column in columns], axis=-1)
    return found.reshape(*np.shape(at), *rows.shape[1:])


def nearest(at: FloatArray, x: FloatArray) -> IntArray:
    """Index of the element of ascending ``x`` (n,) that is nearest to each ``at``."""
    return np.searchsorted(0.5 * (x[1:] + x[:-1]), at)
