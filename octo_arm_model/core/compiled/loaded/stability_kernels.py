"""Whether a balance of a loaded rod is stable: what `numba_build` compiles."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.loaded.system_kernels import System
from octo_arm_model.core.compiled.numerics.dense_kernels import is_definite


def is_minimum(system: System) -> bool:
    """Whether a balance is one of least energy, from a ``system`` linearised about it.

    For loads that have an energy. Its second variation is a quadratic form of the bends k of all
    elements, positive definite if it is so element by element from the tip: with the start of an
    element held, what lies beyond is a spring S = -P at its end (d m = P Phi), and the form of the
    bends of the element

        M = K + U S U^T    with    Phi = U^T k at its end

    has to be positive definite (eliminated from the tip, these M are the pivots of the whole form;
    inertia is additive, Haynsworth 1968). Where K is, M is if and only if C + C S C is, with the
    flexibility C = U^T K^-1 U: both have as many negative eigenvalues as 1 + K^-1/2 U S U^T K^-1/2
    has. K is, if the pivots of its factors are positive without exchange (Sylvester), its rows
    being those of the symmetric form but for positive weights. The stretch, eliminated before,
    asks for positive axial stiffness.

    Where an element alone, with its end free, is unstable or rows were exchanged, False is
    returned and other ways have to tell.
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
                linked[i, j] = flexibility[i, j]
                for k in range(3):
                    for m in range(3):
                        linked[i, j] -= flexibility[k, i] * beyond[k, m] * flexibility[m, j]
        if not is_definite(linked):
            return False
    return True
