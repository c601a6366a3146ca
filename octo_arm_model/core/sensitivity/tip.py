"""Covariance of the pose of the tip by reciprocity.

The linearised equilibrium of a rod whose tendons and loads have a potential is symmetric (Betti):
the displacement of the tip by a unit wrench on a cross section equals that of the cross section by
a unit wrench on the tip. The responses to six unit wrenches on the tip therefore give all
derivatives of its pose. Collocation at Gauss points, a symplectic rule, preserves the symmetry.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.stability import tip_answer
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.rod.solution import Shape
from octo_arm_model.core.sensitivity.imbalance import Imbalance
from octo_arm_model.core.sensitivity.results import Uncertainty, deviations_of


def is_reciprocal(rod: LoadedRod, condition: Condition) -> bool:
    """Whether all loads on ``rod`` have a potential; friction and dead moments have none."""
    problem = rod.equilibrium
    return problem.friction is None and problem.loads.has_energy(condition.tip_wrench)


def tip_covariance(
    rod: LoadedRod, condition: Condition, shape: Shape, uncertainty: Uncertainty
) -> FloatArray:
    """Covariance (6, 6) of the tip at the equilibrium ``shape`` of a ``rod``.

    The rod has to be one that `is_reciprocal` in this ``condition``.

    Raises:
        ConvergenceError: if the linearised equilibrium is singular.
    """
    if rod.add_tip_covariance is not None:
        covariance = uncertainty.of_model.copy()
        deviations = deviations_of(uncertainty, condition.tensions.size)
        rod.add_tip_covariance(condition, shape, deviations, covariance)
        return covariance
    problem = rod.equilibrium
    energy, own = problem.energy, problem.collocation
    local_tensions = energy.local_tensions(condition.tensions[np.newaxis])
    imbalance = Imbalance(energy, rod.parameters, shape.twist, local_tensions)
    state = problem.state(condition, shape)
    answer = tip_answer(problem, state, problem.linearised(state))
    by_wrench = answer.twist * own.weights
    by_wrench[:, 3:] /= own.length
    names = uncertainty.quantities
    wrenches: list[FloatArray] = [getattr(imbalance, f'by_{name}') for name in names]
    return uncertainty.tip_covariance(
        [np.tensordot(by_wrench, wrench, axes=([0, 2], [0, 2])) for wrench in wrenches]
    )
