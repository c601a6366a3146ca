"""How far winches have reeled in the tendons of a known shape, and how that changes.

By what the arm gives way and what the tendons stretch; `displacement` explains it, and finds the
shape for given displacements.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.sensitivity import Change, Sensitivity
from octo_arm_model.rod.solver import Solver


def tendon_compliance(solver: Solver) -> FloatArray:
    """By how much each tendon itself stretches per newton [m/N], (tendons,)."""
    return solver.arm.tendon_compliance(solver.rest_lengths.ravel())


def displacements_of(solver: Solver, backbone: Backbone) -> FloatArray:
    """Length that the winch of each tendon has reeled in [m], of `Arm.tension_shape`.

    For a single solution of ``solver``; of a slack tendon the least that makes it taut.

    Raises:
        ConfigError: if ``backbone`` is that of a batch or of another solver.
    """
    shortened = solver.rest_lengths - solver.tendon_lengths(backbone)
    if not solver.arm.axial_stiffness:
        return shortened
    stretched = solver.arm.stretched(solver.tension_integrals(backbone).ravel())
    return shortened + stretched.reshape(shortened.shape)


def displacements_by_tension(solver: Solver, sensitivity: Sensitivity) -> FloatArray:
    """Derivative of all displacements by all tensions at the base [m/N], (tendons, tendons)."""
    return displacement_change(solver, sensitivity.by_tension, np.eye(solver.rest_lengths.size))


def displacement_change(
    solver: Solver, change: Change, at_base: FloatArray | float = 0.0
) -> FloatArray:
    """Change of all displacements [m], (tendons, quantities), with a ``change`` of the shape.

    And with one of the tensions ``at_base`` (tendons, quantities) [N]; that of unloaded lengths
    comes besides.
    """
    arm, rest = solver.arm, solver.rest_lengths.reshape(-1, 1)
    mean = at_base if change.tendon_tension is None else change.tendon_tension
    free = arm.stretching_lengths(rest.ravel())[:, np.newaxis] - rest
    integrals = np.broadcast_to(rest * mean + free * at_base, change.tendon_length.shape)
    return arm.stretched(integrals.T).T - change.tendon_length
