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

# Names, or their prefixes, of unknowns with exact derivatives: parameters of the arm, with their
# sensitivities, and what changes the inputs of tendons. All others are left to differences.
_BY_PARAMETER = {
    'youngs_modulus': 'by_youngs_modulus',
    'poisson_ratio': 'by_poisson_ratio',
    SHEATH: 'by_sheath_stiffness',
    OFFSET: 'by_offset',
}
_OF_TENDONS = ('tension_scale', 'tension_offset', SPOOL, AXIAL, ZERO)
_STEP = 1e-4  # step of differences of what acts on tendons, over the scale of an unknown


class ShapeChange(NamedTuple):
    """The change of one step per unit of an unknown."""

    position: FloatArray  #: change of the positions of all stations, (stations, 3)
    #: change of the lengths reeled in, (tendons,); None if they are not residuals
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
    arm, exact = solver.arm, (*_BY_PARAMETER, *_OF_TENDONS)
    rates = {
        one.name: _input_rates(unknowns, x, number)
        for number, one in enumerate(unknowns.unknowns)
        if one.name.startswith(exact)
    }
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
                softness = 1.0 / unknowns.unknowns[unknowns.names.index(name)].reference
                reeled_in = softness * stretching * backbone.tensions.ravel()
                rate = rate - reeled_in * unknowns.readings.are_lengths
            parts = [(by_input, rate), *_by_parameter(arm, held, name, unknowns, x)]
            if name.startswith(OFFSET) and unknowns.reads_encoders:
                reeled_in = solver.displacements_by_offset(backbone) * parts[-1][1]
            position = sum(change.pose[:, :3] @ by for change, by in parts)
            lengths = None
            if unknowns.reads_encoders:
                lengths = reeled_in + arm.stretched(stretching * rate)
                lengths -= sum(change.tendon_length @ by for change, by in parts)
            changes.append(ShapeChange(position, lengths))
    return found


def _input_rates(unknowns: Unknowns, x: FloatArray, number: int) -> FloatArray:
    """Return the derivative of `Unknowns.inputs` by x[number], (steps, tendons)."""
    move = np.zeros(x.size)
    move[number] = _STEP * unknowns.unknowns[number].scale
    rise = unknowns.inputs(x + move) - unknowns.inputs(x - move)
    return np.nan_to_num(rise / (2.0 * move[number]))  # NaN of tendons without an encoder


def _by_parameter(
    arm: Arm, held: Sensitivity, name: str, unknowns: Unknowns, x: FloatArray
) -> list[tuple[Change, FloatArray]]:
    """Return the change by a parameter of the ``arm``, and that of it per unit of an unknown."""
    weights = np.ones(1)
    if name == SHEATH:
        weights = np.full(len(arm.tendons), unknowns.values(x)[SHEATH])
    elif name.startswith(OFFSET):
        weights = np.array([name == f'{OFFSET}{tendon}' for tendon in arm.tendon_names], float)
    sensitivities = [by for kind, by in _BY_PARAMETER.items() if name.startswith(kind)]
    return [(getattr(held, by), weights) for by in sensitivities]
