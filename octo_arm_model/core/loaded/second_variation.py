"""Whether balances of loaded rods are of least energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.linearised import Linearised
from octo_arm_model.core.numerics.batched_ldlt import are_definite

_ONE = np.eye(3)


def are_least(system: Linearised, weights: FloatArray) -> NDArray[np.bool_]:
    """Whether the second variation of the energy of each arm is seen to be positive, (arms,).

    From the ``system`` linearised about balances under loads that have an energy; ``weights`` are
    of the integral over an element of length one, (each,).

    The variation is a quadratic form of the bends k at all points. It is positive if that of each
    element with its end free is, and what is left of it as the bends are eliminated with the
    rotations of all ends held, a form of these rotations (inertia is additive, Haynsworth 1968).
    False where an element with its end free is unstable: other ways have to tell.
    """
    ends, axial = system.ends, system.axial
    arms, elements = ends.shape[:2]
    is_stretched = (np.einsum('kkan->kan', axial) > 0.0).all(axis=(0, 2))
    # The rows of an element are those of the form over the weights of their points.
    by_row = system.matrix.reshape(arms, elements, 3, weights.size, -1)
    are_free = are_definite((by_row * weights[:, np.newaxis]).reshape(system.matrix.shape))
    try:
        stiffness = np.linalg.inv(ends[..., :3, 3:])
    except np.linalg.LinAlgError:
        return np.zeros(arms, bool)
    # Moments at both ends of an element by the rotations of both.
    by_first, by_last = _ONE + ends[..., :3, :3], _ONE + ends[..., 3:, 3:]
    before = by_last @ stiffness
    at_first = before @ by_first - ends[..., 3:, :3]
    form = np.zeros((arms, elements, 3, elements, 3))
    _diagonal(form)[:] = stiffness
    _diagonal(form[:, :-1, :, :-1])[:] += at_first[:, 1:]
    _diagonal(form[:, :-1, :, 1:])[:] = -before[:, 1:]
    _diagonal(form[:, 1:, :, :-1])[:] = -(stiffness @ by_first)[:, 1:]
    are_held = are_definite(form.reshape(arms, 3 * elements, -1))
    return np.asarray(is_stretched & are_free & are_held)


def _diagonal(blocks: FloatArray) -> FloatArray:
    """View of the blocks (..., n, 3, 3) on the diagonal of all, (..., n, 3, n, 3)."""
    view: FloatArray = np.einsum('aipiq->aipq', blocks)
    return view
