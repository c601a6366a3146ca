"""Directions of a state in which measurements have told nothing: there it keeps its prior."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray

# Nothing was learnt where this part of the standard deviation of the prior is left.
LEFT = 0.99
_PART = 0.1  # of its largest, that a component of a direction has to be mentioned


class Unlearnt(NamedTuple):
    """A direction of the state.

    Attributes:
        left: part of the standard deviation of the prior that is left in it [-].
        direction: change of the state in it, of one standard deviation of the prior, (n,).
        reason: the direction in words.
    """

    left: float
    direction: FloatArray
    reason: str


def unlearnt(
    root: FloatArray, prior_stddev: FloatArray, names: Sequence[str]
) -> tuple[Unlearnt, ...]:
    """Where a covariance of ``root`` is still that of the prior, independent in all components."""
    _, left, axes = np.linalg.svd((root / prior_stddev[:, np.newaxis]).T, full_matrices=False)
    found = []
    for part, axis in zip(left, axes, strict=True):
        if part >= LEFT:
            found.append(Unlearnt(float(part), axis * prior_stddev, _told(axis, names)))
    return tuple(found)


def _told(axis: FloatArray, names: Sequence[str]) -> str:
    """A direction in words, in standard deviations of the prior."""
    largest = axis[np.abs(axis).argmax()]
    words = [
        f'{part / largest:+.2g} {name}'
        for name, part in zip(names, axis, strict=True)
        if abs(part / largest) >= _PART
    ]
    if len(words) == 1:
        return f'{words[0].split(" ", 1)[1]} keeps its prior'
    return f'changed together, {", ".join(words)} keep their prior'
