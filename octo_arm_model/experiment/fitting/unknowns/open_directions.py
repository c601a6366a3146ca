"""Directions of the unknowns that change nothing measured, and what to leave out for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.fitting.unknowns.unknown import Unknown
from octo_arm_model.experiment.fitting.unknowns.unknowns import Unknowns

# Singular values of the Jacobian below this part of the largest count as zero.
_SINGULAR = 1e-4
# Without effect: a change of an unknown by its `scale` moves no point by this part of the length.
_NO_EFFECT = 1e-6
# An unknown takes part in a direction with at least this share of that which moves most.
_PART = 0.1


class OpenDirection(NamedTuple):
    """A direction that the data leave open.

    Attributes:
        name: the unknown to leave out, so that the others are determined.
        reason: the direction in words.
    """

    name: str
    reason: str


def open_direction(
    jacobian: FloatArray, unknowns: Unknowns, x: FloatArray
) -> OpenDirection | None:
    """The first direction from ``x`` that changes no residual, from derivatives (points, 3, n).

    An unknown without any effect comes first. Of several that only together change nothing, that
    which is last in the order of `unknown.FITS` is to be left out.
    """
    scales = np.array([unknown.scale for unknown in unknowns.unknowns])
    moves = np.linalg.norm(jacobian * scales, axis=1).max(axis=0)
    for name, move in zip(unknowns.names, moves, strict=True):
        if move < _NO_EFFECT * unknowns.arm.length:
            return OpenDirection(name, f'{name} changes nothing that was measured')
    flat, norms = normalised(jacobian)
    _, singular, directions = np.linalg.svd(flat, full_matrices=False)
    if singular[-1] >= _SINGULAR * singular[0]:
        return None
    move = directions[-1] / norms
    share = np.abs(directions[-1])
    last = int(np.flatnonzero(share >= _PART * share.max())[-1])
    return OpenDirection(unknowns.names[last], _in_words(unknowns.unknowns, x, move, scales))


def normalised(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives (3 points, n) as columns of length 1, and their lengths."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    norms = np.linalg.norm(flat, axis=0)
    return flat / norms, norms


def _in_words(
    unknowns: Sequence[Unknown], x: FloatArray, move: FloatArray, scales: FloatArray
) -> str:
    """A direction of x in words, without its small components."""
    share = np.abs(move / scales)
    largest = np.abs(move[share > 0.01 * share.max()]).max()
    words = []
    columns = zip(unknowns, x.tolist(), move / largest, share / share.max(), strict=True)
    for unknown, at, step, part in columns:
        if part > 0.01:
            relative = unknown.relative_change(at, step)
            change = f'{step:+.3g} {unknown.unit}'
            if relative is not None:
                change = f'{100.0 * relative:+.3g} %'
            words.append(f'{unknown.name} {change}')
    return f'changed together in this proportion nothing measured changes: {", ".join(words)}'
