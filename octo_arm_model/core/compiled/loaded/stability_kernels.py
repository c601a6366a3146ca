"""Kernel for the stability of an equilibrium of a loaded rod."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.loaded.system_kernels import System
from octo_arm_model.core.compiled.numerics.dense_kernels import is_definite


def is_minimum(system: System, margin: float) -> bool:
    """Whether an equilibrium is a minimum of the energy, from a ``system`` linearised about it.

    The test applies to loads with a potential. The second variation of the energy is a quadratic
    form of the bends k of all elements. It is positive definite if the form of each element is,
    taken from the tip to the base. The element has its start clamped; the arm beyond acts on its
    end as a spring of stiffness S = -P, with d m = P Phi there. The form of its bends

        M = K + U S U^T    with    Phi = U^T k at its end

    has to be positive definite (eliminated from the tip, these M are the pivots of the whole form;
    inertia is additive, Haynsworth 1968). Where K is positive definite, M is so if and only if
    C + C S C is, with the flexibility C = U^T K^-1 U: both have as many negative eigenvalues as
    1 + K^-1/2 U S U^T K^-1/2. K is positive definite if the pivots of its factors are positive
    without row exchanges (Sylvester), since its rows are those of the symmetric form but for
    positive weights. The stretch, eliminated before, requires positive axial stiffness.

    With a ``margin``, C (1 - margin) + C S C has to be positive definite instead.

    The result is also False where an element by itself, with its end free, is unstable or where
    rows were exchanged. Other criteria then decide whether the equilibrium is stable.
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
