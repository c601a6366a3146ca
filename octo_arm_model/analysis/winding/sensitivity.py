"""First derivatives of an arm with tendons of prescribed displacement.

With D(T, p) the displacements of the taut tendons among them, p anything else that the shape
depends on: D_T dT = dD - D_p dp gives what the tensions change by, and they the shape. D_T is
singular where more tendons are taut than there are ways to deform, as four in parallel that do
not twist: displacements that agree then leave one combination of tensions open, which changes no
shape, and the least change of tensions is taken; those that do not agree are met by least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from octo_arm_model.analysis.winding.tendon_displacement import (
    displacement_change,
    displacements_by_tension,
)
from octo_arm_model.analysis.winding.wound import Wound
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty
from octo_arm_model.rod.solver import Solver

# Of the largest singular value of D_T: of an arm that tapers the smallest is 1e-2 to 1e-4, and
# what is zero comes out as 1e-10 or less.
_SINGULAR = 1e-8


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
    found = solver.sensitivity(wound.backbone)
    tensions = wound.backbone.tensions.ravel()
    taut = np.flatnonzero(wound.driven & (tensions > 0.0))
    by_tension = found.by_tension
    changes = displacements_by_tension(solver, found)
    tension = np.zeros((tensions.size, tensions.size))
    tension[np.ix_(taut, taut)] = np.linalg.pinv(changes[np.ix_(taut, taut)], _SINGULAR)

    def held(change: Change | None, rest: FloatArray | float = 0.0) -> Change | None:
        """``change`` with displacements held, which the unloaded lengths change by ``rest``."""
        if change is None:
            return None
        reeled_in = displacement_change(solver, change) + rest
        return _plus(change, by_tension, -tension @ reeled_in)

    given = _plus(by_tension, by_tension, -tension @ changes)
    for array in (given.pose, given.strain, given.tendon_length, given.tendon_tension):
        if array is not None:
            array[..., wound.driven] = 0.0  # they follow from the displacements
    young = held(found.by_youngs_modulus)
    assert young is not None
    return WoundSensitivity(
        by_displacement=_times(by_tension, tension),
        tension=tension,
        held=Sensitivity(
            given,
            young,
            held(found.by_tip_wrench),
            held(found.by_poisson_ratio),
            held(found.by_offset, np.diag(unloaded_by_offset(solver, wound.backbone))),
            held(found.by_sheath_stiffness),
            held(found.by_friction),
        ),
    )


def _times(change: Change, tension: FloatArray) -> Change:
    fields = vars(change).values()
    parts: list[Any] = [None if part is None else part @ tension for part in fields]
    return Change(*parts)


def _plus(change: Change, by_tension: Change, tension: FloatArray) -> Change:
    pairs = zip(vars(change).values(), vars(_times(by_tension, tension)).values(), strict=True)
    return Change(*(one if one is None or more is None else one + more for one, more in pairs))


def unloaded_by_offset(solver: Solver, backbone: Backbone) -> FloatArray:
    """Derivative of displacements with tendons' distances from the midline (tendons,).

    By their unloaded lengths alone, and what these stretch by; only of tendons that wind about
    the midline.
    """
    by_offset, integrals = solver.rest_lengths_by_offset(backbone)
    total: FloatArray = by_offset + solver.arm.stretched(integrals)
    return total
