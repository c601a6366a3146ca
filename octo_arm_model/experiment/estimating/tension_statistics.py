"""Noise and rate of change of recorded tensions, used where no parameters give them."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.estimation.settings import TensionStatistics
from octo_arm_model.experiment.shapes.curves import without_spikes
from octo_arm_model.experiment.shapes.steady_windows import reading_noise

_TIMES = 3.0  # standard deviations that the largest change may be


def tension_statistics(time: FloatArray, tensions: FloatArray) -> TensionStatistics:
    """Noise and rate of ``tensions`` (n, tendons) [N] at ``time`` (n,) [s], as received.

    The rate is that of which the largest change from one reading to the next is three standard
    deviations; each reading is the median of three, so that one wrong reading is no change.
    """
    if len(time) < 3:
        return TensionStatistics(0.0, 0.0)
    order = np.argsort(time, kind='stable')
    time, tensions = time[order], tensions[order]
    middle = without_spikes(tensions)[1:-1]
    elapsed = np.diff(time[1:-1])
    is_later = elapsed > 0.0
    change = np.abs(np.diff(middle, axis=0))[is_later] / np.sqrt(elapsed[is_later, np.newaxis])
    rate = float(change.max()) / _TIMES if change.size else 0.0
    return TensionStatistics(reading_noise(tensions), rate)
