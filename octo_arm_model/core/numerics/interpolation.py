"""Linear interpolation of rows of numbers."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray


def interpolated(at: FloatArray | float, x: FloatArray, rows: FloatArray) -> FloatArray:
    """``rows`` (n, k) of ascending ``x`` (n,) at ``at`` (m,), (m, k); of one number (k,).

    Before the first and after the last row it is that row.
    """
    return np.stack([np.interp(at, x, column) for column in rows.T], axis=-1)
