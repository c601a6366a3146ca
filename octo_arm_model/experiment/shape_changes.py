"""First derivatives of the shapes of all steps by the unknowns of a fit.

An unknown changes what acts on the tendons, a tension or a length reeled in, or a parameter of the
arm at constant tensions or lengths. Both follow from the sensitivities of the solution.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.unknowns import AXIAL, OFFSET, SHEATH, SPOOL, ZERO, Unknowns
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import Wound, wound_sensitivity
from octo_arm_model.rod.sensitivity import Change, Sensitivity
from octo_arm_model.rod.solver import Solver

# Unknowns with exact derivatives; all others are left to differences.
_EXACT = (
    'youngs_modulus',
    'poisson_ratio',
    SHEATH,
    'tension_scale',
    'tension_offset',
    SPOOL,
    AXIAL,
)
_OF_TENDONS = (OFFSET, ZERO)  # prefixes of such unknowns of single tendons
_STEP = 1e-4  # step of differences of what acts on tendons, over the scale of an unknown


class ShapeChange(NamedTuple):
    """The change of one step per unit of an unknown.

    Attributes:
        position: change of the positions of all stations, (stations, 3).
        lengths: change of the lengths reeled in, (tendons,); None if they are not residuals.
    """

    position: FloatArray
    lengths: FloatArray | None


def shape_changes(
    unknowns: Unknowns, x: FloatArray, solver: Solver, solutions: Sequence[Backbone | Wound]
) -> dict[str, list[ShapeChange]]:
    """Return the changes of the ``solutions`` of all steps at ``x``, by names of ``unknowns``.

    There are none by unknowns without an exact derivative, and none if tendons have friction,
    where the shape of a step depends on the steps before.

    Raises:
        OctoArmError: if an equilibrium has no sensitivities.
    """
    rates = {
        one.name: _input_rates(unknowns, x, number)
        for number, one in enumerate(unknowns.unknowns)
        if one.name in _EXACT or one.name.startswith(_OF_TENDONS)
    }
    arm = solver.arm
    if arm.friction or not rates:
        return {}
    stretching = arm.stretching_lengths(solver.rest_lengths.ravel())
    found: dict[str, list[ShapeChange]] = {name: [] for name in rates}
    for step, solution in enumerate(solutions):
        if isinstance(solution, Wound):
            backbone, wound = solution.backbone, wound_sensitivity(solver, solution)
            by_input, held = wound.by_displacement, wound.held
        else:
            backbone, held = solution, solver.sensitivity(solution)
            by_input = held.by_tension
        for name, changes in found.items():
            # At constant shape and tensions, tendons stretch, and unloaded lengths change.
            reeled_in, rate = np.zeros(stretching.size), rates[name][step]
            if name == AXIAL:
                softness = 1.0 / unknowns.unknown(name).reference
                reeled_in = softness * stretching * backbone.tensions.ravel()
                rate = rate - reeled_in * unknowns.readings.are_lengths
            elif name.startswith(OFFSET) and unknowns.reads_encoders:
                reeled_in = solver.displacements_by_offset(backbone) * _at_tendon(arm, name)
            parts = [(by_input, rate), *_by_parameter(arm, held, name, unknowns, x)]
            position = sum(change.pose[:, :3] @ weights for change, weights in parts)
            lengths = None
            if unknowns.reads_encoders:
                lengths = reeled_in + arm.stretched(stretching * rate)
                lengths -= sum(change.tendon_length @ weights for change, weights in parts)
            changes.append(ShapeChange(position, lengths))
    return found


def _input_rates(unknowns: Unknowns, x: FloatArray, number: int) -> FloatArray:
    """Return the derivative of `Unknowns.inputs` by x[number], (steps, tendons)."""
    move = np.zeros(x.size)
    move[number] = _STEP * unknowns.unknowns[number].scale
    rise = unknowns.inputs(x + move) - unknowns.inputs(x - move)
    return np.nan_to_num(rise / (2.0 * move[number]))  # NaN of tendons without an encoder


def _at_tendon(arm: Arm, name: str) -> FloatArray:
    """Return 1 at the tendon of an unknown ``name`` with the prefix `OFFSET`, else 0."""
    return np.array([name == f'{OFFSET}{tendon}' for tendon in arm.tendon_names], dtype=float)


def _by_parameter(
    arm: Arm, held: Sensitivity, name: str, unknowns: Unknowns, x: FloatArray
) -> list[tuple[Change, FloatArray]]:
    """Return the changes by parameters of the ``arm``, with those per unit of an unknown."""
    change, weights = None, np.ones(1)
    if name == 'youngs_modulus':
        change = held.by_youngs_modulus
    elif name == 'poisson_ratio':
        change = held.by_poisson_ratio
    elif name == SHEATH:
        change = held.by_sheath_stiffness
        weights = np.full(len(arm.tendons), unknowns.value(x, SHEATH, 0.0))
    elif name.startswith(OFFSET):
        change, weights = held.by_offset, _at_tendon(arm, name)
    return [] if change is None else [(change, weights)]
