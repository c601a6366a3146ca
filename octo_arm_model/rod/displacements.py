"""Shapes, tensions and derivatives of arms with prescribed displacements of tendons.

A winch that reels in D leaves its tendon of axial stiffness k [N] under the tension T with

    D(T) = l(0) - l(T) + T (l(0) + f) / k

where l is its length in the arm and f that between base and winch. The first two terms are the
shortening of the path, the last one is the stretch of the whole tendon; with friction T is the
local tension there. A tendon that would have to push is slack. `winches` finds the tensions.

For the displacements D(T, p) of taut driven tendons, p any other quantity, the change of tensions
follows from D_T dT = dD - D_p dp, and the change of the shape from dT. D_T is singular if more
tendons are taut than the arm has ways to deform, such as four parallel ones that do not twist it.
Then consistent displacements leave one combination of tensions undetermined, which changes no
shape: the least change of tensions is taken. Others are met by least squares.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ArmDefinitionError, TensionError, listed, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import LARGEST, check_class, finite
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty
from octo_arm_model.rod.solver import Solver

_MET = 1e-9  # allowed error of displacements over the length
# Singular values of D_T below this part of the largest are zero. Zeros come out as 1e-10 or less;
# the smallest others of tapered arms are 1e-4 to 1e-2.
_SINGULAR = 1e-8


@dataclass(frozen=True)
class Wound:
    """An arm with tendons of prescribed displacement.

    Attributes:
        backbone: shape of the arm; ``backbone.tensions`` are the tensions of all tendons [N].
        displacement: length that the winch of each tendon has reeled in [m], of
            `Arm.tension_shape`; for a slack one the larger length that would make it taut.
        slack: names of tendons of prescribed displacement that are longer than their path.
        driven: whether the displacement of each tendon was prescribed, (tendons,).
    """

    backbone: Backbone
    displacement: FloatArray
    slack: tuple[str, ...]
    driven: NDArray[np.bool_] = field(repr=False)


def solve_displacements(
    solver: Solver,
    displacements: Mapping[str, float],
    tensions: Mapping[str, float] | None = None,
    start: Backbone | Wound | None = None,
    tip_wrench: ArrayLike | None = None,
) -> Wound:
    """Return the shape and tensions if some tendons have given lengths, and others tensions.

    Args:
        solver: the solver, of any model.
        displacements: length reeled in, by tendon name [m], zero for the taut unloaded arm;
            negative for length paid out.
        tensions: tension by tendon name [N]; zero for those named in neither.
        start: solution to begin from; one of this function takes less time. Tendons with friction
            slide from their tensions there, without one from slack.
        tip_wrench: force and moment on the tip in base_frame, (6,) [N, N m]; None for zero.

    Raises:
        TensionError: if a tendon is unknown, named in both, or a value is impossible, such as a
            displacement that is longer than the tendon.
        ConvergenceError: if no tensions are found that hold these lengths; a `ContinuationError`
            if the search would take more than the budget of one solve.
        OctoArmError: if the tip wrench is invalid, or the shape is not trustworthy.
    """
    check_class('solver', solver, Solver)
    arm, by_name = solver.arm, {} if tensions is None else tensions
    check_displacements(arm, displacements, by_name)
    driven = np.array([name in displacements for name in arm.tendon_names])
    lengths = np.array([displacements.get(name, 0.0) for name in arm.tendon_names])
    solver.check_displacements(lengths[driven], np.flatnonzero(driven).tolist())
    held_tensions = np.array([by_name.get(name, 0.0) for name in arm.tendon_names])
    initial = start.backbone if isinstance(start, Wound) else start
    with solver.together():
        backbone, reached = solver.wind(lengths, driven, held_tensions, tip_wrench, initial)
    is_slack = driven & (backbone.tensions.ravel() == 0.0)
    is_slack &= reached > lengths + _MET * arm.length
    slack = tuple(arm.tendon_names[tendon] for tendon in np.flatnonzero(is_slack).tolist())
    return Wound(backbone, reached.reshape(arm.tension_shape), slack, driven)


def check_displacements(
    arm: Arm, displacements: Mapping[str, float], tensions: Mapping[str, float]
) -> None:
    """Check that the values are finite, and of different tendons of ``arm``.

    Raises:
        TensionError: if they are not; the message names the tendon.
    """
    for kind, values in (('displacements', displacements), ('tensions', tensions)):
        if not isinstance(values, Mapping):
            raise TensionError(f'{kind} are {shown(values)}, expected a dict by names of tendons')
    names = frozenset(arm.tendon_names)
    for name in [*displacements, *tensions]:
        if name not in names:
            known = listed(arm.tendon_names)
            raise TensionError(f'unknown tendon {listed([str(name)])}; this arm has {known}')
    if both := sorted(displacements.keys() & tensions.keys()):
        raise TensionError(f'tendon {both[0]} has both a displacement and a tension')
    for kind, values, unit in (('displacement', displacements, 'm'), ('tension', tensions, 'N')):
        for name, value in values.items():
            # The squares of larger ones are beyond the range of floats.
            try:
                finite(name, value)
            except ArmDefinitionError:
                raise TensionError(
                    f'{kind} of {name} is {shown(value)} {unit}, expected a finite number of at '
                    f'most {LARGEST:g}'
                ) from None


# Of a known shape -------------------------------------------------------------------------------


def displacements_of(solver: Solver, backbone: Backbone) -> FloatArray:
    """Return the lengths reeled in at the shape ``backbone`` [m], of `Arm.tension_shape`."""
    check_class('solver', solver, Solver)
    return solver.displacements(backbone)


# First derivatives ------------------------------------------------------------------------------


@dataclass(frozen=True)
class WoundSensitivity:
    """The first derivatives of a `Wound`, while the same tendons stay slack.

    Attributes:
        by_displacement: derivatives by the length that each tendon is reeled in [m]; zero for
            tendons that are slack or not driven.
        tension: derivatives of all tensions by these lengths [N/m], (tendons, tendons).
        held: derivatives by other quantities, for constant displacements of driven tendons and
            constant tensions of the others.
    """

    by_displacement: Change
    tension: FloatArray
    held: Sensitivity

    def tip_covariance(self, uncertainty: Uncertainty) -> FloatArray:
        """Return the covariance of the tip's position [m] and rotation [rad] in base_frame.

        Raises:
            ConfigError: if the model has no derivative by a quantity that is uncertain.
        """
        tip = uncertainty.displacement * self.by_displacement.tip
        return self.held.tip_covariance(uncertainty) + tip @ tip.T


def wound_sensitivity(solver: Solver, wound: Wound) -> WoundSensitivity:
    """Return the derivatives of a ``wound`` arm of ``solver``.

    If a tendon is about to get slack, they are those on the side of its tension.

    Raises:
        OctoArmError: if the equilibrium has no sensitivities.
    """
    check_class('solver', solver, Solver)
    check_class('wound', wound, Wound)
    sensitivity = solver.sensitivity(wound.backbone)
    tensions = wound.backbone.tensions.ravel()
    taut = np.flatnonzero(wound.driven & (tensions > 0.0))
    by_tension = sensitivity.by_tension
    changes = _reeled_in(solver, by_tension, np.eye(tensions.size))
    tension = np.zeros((tensions.size, tensions.size))
    tension[np.ix_(taut, taut)] = np.linalg.pinv(changes[np.ix_(taut, taut)], _SINGULAR)

    def held(name: str) -> Any:
        change = getattr(sensitivity, f'by_{name}')
        if change is None:
            return None
        reeled_in = changes if name == 'tension' else _reeled_in(solver, change)
        if name == 'offset':  # unloaded lengths change too
            reeled_in = reeled_in + np.diag(solver.displacements_by_offset(wound.backbone))
        return _combined(change, by_tension, -tension @ reeled_in)

    at_once = 'tension', 'youngs_modulus', 'tip_wrench', 'friction'
    others = Sensitivity(**{f'by_{name}': held(name) for name in at_once}, find=held)
    for array in vars(others.by_tension).values():
        if array is not None:
            array[..., wound.driven] = 0.0  # tensions that follow from displacements
    return WoundSensitivity(_combined(None, by_tension, tension), tension, others)


def _reeled_in(solver: Solver, change: Change, at_base: FloatArray | float = 0.0) -> FloatArray:
    """Return the change of all displacements, (tendons, quantities) [m], by that of the shape.

    Tensions at the base change by ``at_base`` (tendons, quantities) [N]. A change of unloaded
    lengths is not included.
    """
    arm, rest = solver.arm, solver.rest_lengths.reshape(-1, 1)
    mean = at_base if change.tendon_tension is None else change.tendon_tension
    free = arm.stretching_lengths(rest.ravel())[:, np.newaxis] - rest
    integrals = np.broadcast_to(rest * mean + free * at_base, change.tendon_length.shape)
    return arm.stretched(integrals.T).T - change.tendon_length


def _combined(change: Change | None, by_tension: Change, tension: FloatArray) -> Change:
    """Return a ``change``, if any, plus that by a change of ``tension`` (tendons, quantities)."""
    parts: list[Any] = [
        None if part is None else part @ tension for part in vars(by_tension).values()
    ]
    if change is not None:
        for number, own in enumerate(vars(change).values()):
            parts[number] = own if own is None or parts[number] is None else own + parts[number]
    return Change(*parts)
