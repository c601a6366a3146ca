"""Derivatives of the tip alone, by reciprocity.

A rod whose tendons and loads have an energy has a symmetric linearised equilibrium (Betti): the
tip moves under a wrench on a cross section as much as this cross section does under the same
wrench on the tip. Six answers, to unit wrenches on the tip, give all derivatives of its pose. The
collocation keeps this exactly, as Gauss points make a symplectic rule.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.stability import tip_answer
from octo_arm_model.core.loaded.state import Condition
from octo_arm_model.core.rod.solution import Shape
from octo_arm_model.core.sensitivity.imbalance import Imbalance
from octo_arm_model.core.sensitivity.results import TipBy


def is_reciprocal(rod: LoadedRod, condition: Condition) -> bool:
    """Whether all that acts on ``rod`` has an energy, as friction and dead moments have none."""
    problem = rod.equilibrium
    return problem.friction is None and problem.loads.has_energy(condition.tip_wrench)


def tip_derivatives(rod: LoadedRod, condition: Condition, shape: Shape) -> TipBy:
    """Of the balanced ``shape`` of a ``rod`` that `is_reciprocal` in this ``condition``.

    Raises:
        ConvergenceError: if the linearised equilibrium is singular.
    """
    if rod.differentiate_tip is not None:
        tip, tendons = rod.differentiate_tip(condition, shape), condition.tensions.size
        parts = np.split(tip, [tendons, tendons + 1, tendons + 2], axis=1)
        quantities = 'tension', 'youngs_modulus', 'poisson_ratio', 'offset'
        return dict(zip(quantities, parts, strict=True)).get
    problem = rod.equilibrium
    energy, own = problem.energy, problem.collocation
    local_tensions = energy.local_tensions(condition.tensions[np.newaxis])
    imbalance = Imbalance(energy, rod.parameters, shape.twist, local_tensions)
    state = problem.state(condition, shape)
    answer = tip_answer(problem, state, problem.linearised(state))
    by_wrench = answer.twist * own.weights
    by_wrench[:, 3:] /= own.length

    def tip_by(quantity: str) -> FloatArray:
        left: FloatArray = getattr(imbalance, f'by_{quantity}')
        return np.tensordot(by_wrench, left, axes=([0, 2], [0, 2]))

    return tip_by
