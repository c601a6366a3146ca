"""Steps of one load: repeats, which share the errors of their tensions and of the model."""

from __future__ import annotations

import itertools

import numpy as np

from octo_arm_model.arm.hints import FloatArray

# Loads are one if no tension differs by more than this part of the highest.
_PART = 0.02
# Fits at most: of more loads several are left out together.
MOST_FOLDS = 20


def steps_by_load(tensions: FloatArray) -> list[list[int]]:
    """Numbers of the steps, from 0, of each load among ``tensions`` (steps, tendons) [N]."""
    band = _PART * float(tensions.max(initial=0.0))
    loads: list[list[int]] = []
    for step, pulled in enumerate(tensions):
        for load in loads:
            if np.abs(pulled - tensions[load[0]]).max(initial=0.0) <= band:
                load.append(step)
                break
        else:
            loads.append([step])
    return loads


def folds_of(loads: list[list[int]]) -> list[list[int]]:
    """Steps to be left out together: those of one load, of several where there are many."""
    number = min(len(loads), MOST_FOLDS)
    return [sorted(itertools.chain.from_iterable(loads[first::number])) for first in range(number)]


def loaded(tensions: FloatArray, load: list[int]) -> bool:
    """Whether any tendon is pulled in a ``load`` of `steps_by_load`."""
    return bool(tensions[load[0]].max() > _PART * float(tensions.max(initial=0.0)))
