"""Tendons of prescribed displacement instead of tension: shapes, tensions and derivatives.

A winch that reels in D leaves its tendon of axial stiffness k [N] under the tension T with

    D(T) = l(0) - l(T) + T (l(0) + f) / k

for its length l in the arm and f between base and winch: what the arm gives way, and what the
tendon stretches over its whole length, with friction under what this leaves of T. A tendon that
would have to push is slack. `winches` finds the tensions.

With D(T, p) of the taut tendons that are driven, p anything else that the shape depends on,
D_T dT = dD - D_p dp gives what the tensions change by, and they the shape. D_T is singular where
more tendons are taut than there are ways to deform, as four in parallel that do not twist:
displacements that agree then leave one combination of tensions open, which changes no shape, and
the least change of tensions is taken; those that do not agree are met by least squares.
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

_MET = 1e-9  # error of displacements over the length
# Of the largest singular value of D_T: of an arm that tapers the smallest is 1e-2 to 1e-4, and
# what is zero comes out as 1e-10 or less.
_SINGULAR = 1e-8


@dataclass(frozen=True)
class Wound:
    """An arm with tendons of prescribed displacement.

    Attributes:
        backbone: its shape; ``backbone.tensions`` are the tensions of all tendons [N].
        displacement: length that the winch of each tendon has reeled in [m], of
            `Arm.tension_shape`; of a slack one, what would make it taut, more than was asked for.
        slack: names of tendons of prescribed displacement without tension, longer than their path.
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
    """Shape and tensions for some tendons wound in by length and the others held by tension.

    Args:
        solver: of any model.
        displacements: length reeled in, by tendon name [m], zero for the taut unloaded arm;
            negative for length paid out.
        tensions: tension by tendon name [N]; zero for those named in neither.
        start: solution to begin from; one of this function takes less time. Tendons with friction
            slide from their tensions there, without one from slack.
        tip_wrench: as of `Solver.solve`.

    Raises:
        TensionError: if a tendon is unknown, named in both, or a value is impossible, as of a
            displacement that is longer than what there is to reel in.
        ConvergenceError: if no tensions were found that hold these lengths; a `ContinuationError`
            if that would take more time than the budget of one solve.
        OctoArmError: as `Solver.solve`.
    """
    check_class('solver', solver, Solver)
    arm, given = solver.arm, {} if tensions is None else tensions
    check_displacements(arm, displacements, given)
    driven = np.array([name in displacements for name in arm.tendon_names])
    wanted = np.array([displacements.get(name, 0.0) for name in arm.tendon_names])
    solver.check_displacements(wanted[driven], np.flatnonzero(driven).tolist())
    held = np.array([given.get(name, 0.0) for name in arm.tendon_names])
    known = start.backbone if isinstance(start, Wound) else start
    with solver.together():
        backbone, reached = solver.wind(wanted, driven, held, tip_wrench, known)
    is_slack = driven & (backbone.tensions.ravel() == 0.0)
    is_slack &= reached > wanted + _MET * arm.length
    slack = tuple(arm.tendon_names[tendon] for tendon in np.flatnonzero(is_slack).tolist())
    return Wound(backbone, reached.reshape(arm.tension_shape), slack, driven)


def check_displacements(
    arm: Arm, displacements: Mapping[str, float], tensions: Mapping[str, float]
) -> None:
    """Check that both are finite, and of different tendons of ``arm``.

    Raises:
        TensionError: if not; the message names the tendon.
    """
    for what, given in (('displacements', displacements), ('tensions', tensions)):
        if not isinstance(given, Mapping):
            raise TensionError(f'{what} are {shown(given)}, expected a dict by names of tendons')
    names = frozenset(arm.tendon_names)
    for name in [*displacements, *tensions]:
        if name not in names:
            known = listed(arm.tendon_names)
            raise TensionError(f'unknown tendon {listed([str(name)])}; this arm has {known}')
    if both := sorted(displacements.keys() & tensions.keys()):
        raise TensionError(f'tendon {both[0]} has both a displacement and a tension')
    for what, given, unit in (('displacement', displacements, 'm'), ('tension', tensions, 'N')):
        for name, value in given.items():
            # Of larger ones the squares are beyond the range of floats.
            try:
                finite(name, value)
            except ArmDefinitionError:
                raise TensionError(
                    f'{what} of {name} is {shown(value)} {unit}, expected a finite number of at '
                    f'most {LARGEST:g}'
                ) from None


# Of a known shape -------------------------------------------------------------------------------


def displacements_of(solver: Solver, backbone: Backbone) -> FloatArray:
    """See `Solver.displacements`."""
    check_class('solver', solver, Solver)
    return solver.displacements(backbone)


# First derivatives ------------------------------------------------------------------------------


@dataclass(frozen=True)
class WoundSensitivity:
    """First derivatives of a `Wound`, none of which changes what is slack.

    Attributes:
        by_displacement: per metre that each tendon is reeled in; zero of those that are slack or
            not driven.
        tension: change of all tensions by these [N/m], (tendons, tendons).
        held: per unit of all else, with the displacements of driven tendons held and the tensions
            of the others.
    """

    by_displacement: Change
    tension: FloatArray
    held: Sensitivity

    def tip_covariance(self, uncertainty: Uncertainty) -> FloatArray:
        """Covariance of the tip's position [m] and rotation vector [rad] in base_frame, (6, 6).

        Raises:
            ConfigError: if the model has no derivative by something that is uncertain.
        """
        tip = uncertainty.displacement * self.by_displacement.tip
        return self.held.tip_covariance(uncertainty) + tip @ tip.T


def wound_sensitivity(solver: Solver, wound: Wound) -> WoundSensitivity:
    """Of a ``wound`` arm of ``solver``.

    Where a tendon is just about to get slack these are the derivatives on the side of its tension.

    Raises:
        OctoArmError: as `Solver.sensitivity`.
    """
    check_class('solver', solver, Solver)
    check_class('wound', wound, Wound)
    found = solver.sensitivity(wound.backbone)
    tensions = wound.backbone.tensions.ravel()
    taut = np.flatnonzero(wound.driven & (tensions > 0.0))
    by_tension = found.by_tension
    changes = _reeled_in(solver, by_tension, np.eye(tensions.size))
    tension = np.zeros((tensions.size, tensions.size))
    tension[np.ix_(taut, taut)] = np.linalg.pinv(changes[np.ix_(taut, taut)], _SINGULAR)

    def held(name: str) -> Any:
        change = getattr(found, f'by_{name}')
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
            array[..., wound.driven] = 0.0  # they follow from the displacements
    return WoundSensitivity(_combined(None, by_tension, tension), tension, others)


def _reeled_in(solver: Solver, change: Change, at_base: FloatArray | float = 0.0) -> FloatArray:
    """Change of all displacements [m], (tendons, quantities), with a ``change`` of the shape.

    And with one of the tensions ``at_base`` (tendons, quantities) [N]; that of unloaded lengths
    comes besides.
    """
    arm, rest = solver.arm, solver.rest_lengths.reshape(-1, 1)
    mean = at_base if change.tendon_tension is None else change.tendon_tension
    free = arm.stretching_lengths(rest.ravel())[:, np.newaxis] - rest
    integrals = np.broadcast_to(rest * mean + free * at_base, change.tendon_length.shape)
    return arm.stretched(integrals.T).T - change.tendon_length


def _combined(change: Change | None, by_tension: Change, tension: FloatArray) -> Change:
    """A ``change``, if any, and what comes of that of the ``tension`` (tendons, quantities)."""
    parts: list[Any] = [
        None if part is None else part @ tension for part in vars(by_tension).values()
    ]
    if change is not None:
        for number, own in enumerate(vars(change).values()):
            parts[number] = own if own is None or parts[number] is None else own + parts[number]
    return Change(*parts)
