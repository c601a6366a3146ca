"""Kernel for the stability of an equilibrium of a loaded rod."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.loaded.system_kernels import System
from octo_arm_model.core.compiled.numerics.dense_kernels import is_definite

# Part of what unstable parts beyond an element have left of its stiffness: where as much is left,
# a small change of shape and loads does not take an equilibrium to where it is no longer stable.
FIRM = 0.2


def is_minimum(system: System, margin: float) -> bool:
    """Whether an equilibrium is a minimum of the energy, from a ``system`` linearised about it.

    For loads with a potential. The second variation of the energy is a quadratic form of the bends
    k of all elements. It is positive definite if, element by element from the tip, that of the
    element is: with its start clamped and the rest of the arm beyond as a spring S = -P at its end
    (d m = P Phi), the form of its bends

        M = K + U S U^T    with    Phi = U^T k at its end

    has to be positive definite (eliminated from the tip, these M are the pivots of the whole form;
    inertia is additive, Haynsworth 1968). Where K is, M is if and only if C + C S C is, with the
    flexibility C = U^T K^-1 U: both have as many negative eigenvalues as 1 + K^-1/2 U S U^T K^-1/2
    has. K is, if the pivots of its factors are positive without row exchange (Sylvester), its rows
    being those of the symmetric form but for positive weights. The stretch, eliminated before,
    requires positive axial stiffness.

    With a ``margin``, C (1 - margin) + C S C has to be.

    Also False where an element by itself, with its end free, is unstable or rows were exchanged:
    stability is then decided by other criteria.
    """
    axial = system.at_points[9]
    for i in range(axial.size):
        if not axial[i] > 0.0:
            return False
    linked = np.empty((3, 3))
    for element in range(len(system.ends)):
        factors, pivots = system.factors[element], system.pivots[element]
        for j in range(pivots.size):
            if pivots[j] != j or not factors[j, j] > 0.0:
                return False
        flexibility, beyond = system.ends[element, :3, 3:], system.by_turn[element + 1]
        for i in range(3):
            for j in range(3):
                linked[i, j] = (1.0 - margin) * flexibility[i, j]
                for k in range(3):
                    for m in range(3):
                        linked[i, j] -= flexibility[k, i] * beyond[k, m] * flexibility[m, j]
        if not is_definite(linked):
            return False
    return True
