"""Kernel for the lengths of tendons, as in `tendon_lengths`."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.section.elastic_laws import incompressible_widening
from octo_arm_model.core.section.formulas import tendon_direction


def find_lengths(
    path: FloatArray, weights: FloatArray, widens: bool, twist: FloatArray, lengths: FloatArray
) -> None:
    """Fill in the ``lengths`` (tendons,) [m] under ``twist`` (4, nodes).

    ``path`` (tendons, 4, nodes) has offsets along n and b and their slopes, ``weights`` (tendons,
    nodes) are those of the integral, zero where a tendon does not act.
    """
    count = twist.shape[1]
    scaled, stretch = twist.copy(), np.empty(count)
    width = np.ones(count)
    if widens:
        for i in range(count):
            width[i] = incompressible_widening(twist[3, i])[0]
            for k in range(3):
                scaled[k, i] *= width[i]
    t, n, b, s = scaled[0], scaled[1], scaled[2], scaled[3]
    for tendon in range(len(path)):
        x, y, dx, dy = path[tendon]
        # In a loop of its own, which is vectorised.
        for i in range(count):
            stretch[i] = tendon_direction(
                t[i], n[i], b[i], s[i], width[i], x[i], y[i], dx[i], dy[i]
            )[3]
        weight, total = weights[tendon], 0.0
        for i in range(count):
            total += weight[i] * stretch[i]
        lengths[tendon] = total
