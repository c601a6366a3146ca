"""How the shape answers to small changes of what it depends on: analytic, to first order.

A change of a parameter leaves a wrench unbalanced at every cross section; the arm answers with a
change of twist (`Equilibrium.respond`), which turns and moves everything beyond: in base_frame

    phi(s) = int_0^s R d kappa    d u(s) = int_0^s phi x u' + R d v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octo_arm_model.equilibrium import Equilibrium, State, into_section
from octo_arm_model.exact import to_scaled
from octo_arm_model.grid import StationGrid
from octo_arm_model.hints import FloatArray
from octo_arm_model.physical import unscale_gradient
from octo_arm_model.quadrature import integrate_from_base, integration_weights
from octo_arm_model.rotation import Quaternions
from octo_arm_model.sectional import SectionEnergy
from octo_arm_model.vectors import cross


@dataclass(frozen=True)
class Change:
    """Change of the shape per unit of one or several quantities, the last axis.

    Attributes:
        pose: displacement [m] and rotation vector [rad] of each cross section, in base_frame,
            (stations, 6, quantities).
        strain: change of tau, xi, k [1/m] and q [-], (stations, 4, quantities).
        tendon_length: change of the length of every tendon [m], (tendons, quantities).
    """

    pose: FloatArray
    strain: FloatArray
    tendon_length: FloatArray

    @property
    def tip(self) -> FloatArray:
        """Displacement [m] and rotation [rad] of the tip, (6, quantities)."""
        return self.pose[-1]


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations of what the shape depends on, all independent of each other.

    Attributes:
        tension: of every tension [N].
        youngs_modulus: of E, relative [-].
        poisson_ratio: of nu [-].
        offset: of every tendon's distance from the midline [m].
    """

    tension: float = 0.0
    youngs_modulus: float = 0.0
    poisson_ratio: float = 0.0
    offset: float = 0.0


@dataclass(frozen=True)
class Sensitivity:
    """First derivatives of one solution.

    Attributes:
        by_tension: per newton of each tendon's tension.
        by_tip_wrench: per newton of force and newton metre of moment on the tip, in base_frame.
        by_youngs_modulus: per relative change of E (of 1 for twice the stiffness), one column.
        by_poisson_ratio: per unit of nu, one column.
        by_offset: per metre of each tendon's distance from the midline.
    """

    by_tension: Change
    by_tip_wrench: Change
    by_youngs_modulus: Change
    by_poisson_ratio: Change
    by_offset: Change

    @property
    def compliance(self) -> FloatArray:
        """Displacement [m] and rotation [rad] of the tip per [N] and [N m] on it, (6, 6)."""
        return self.by_tip_wrench.tip

    def tip_covariance(self, uncertainty: Uncertainty) -> FloatArray:
        """Covariance of the tip's position [m] and rotation vector [rad] in base_frame, (6, 6)."""
        covariance = np.zeros((6, 6))
        for deviation, change in (
            (uncertainty.tension, self.by_tension),
            (uncertainty.youngs_modulus, self.by_youngs_modulus),
            (uncertainty.poisson_ratio, self.by_poisson_ratio),
            (uncertainty.offset, self.by_offset),
        ):
            covariance += deviation**2 * change.tip @ change.tip.T
        return covariance


def sensitivity(
    energy: SectionEnergy,
    grid: StationGrid,
    problem: Equilibrium,
    state: State,
    tensions: FloatArray,
) -> Sensitivity:
    """Derivatives of the balanced ``state`` under ``tensions`` (tendons,) [N]."""
    count, tendons = len(state.twist), tensions.size
    twist = state.twist[:, np.newaxis]
    strain = to_scaled(energy.law, twist)
    pulls = energy.pulls(tensions[np.newaxis])
    # What each change of a parameter leaves unbalanced, in the axes of each cross section.
    columns = np.zeros((6, 2 * tendons + 8, state.twist.shape[1]))
    elastic, _ = energy.material(strain)
    lengthening = energy.lengthening(strain)[1]
    for part, gradient in (
        (slice(0, tendons), lengthening),
        (slice(tendons + 6, tendons + 7), elastic[:, np.newaxis]),
        (slice(tendons + 7, tendons + 8), energy.gradient_by_poisson(strain)[:, np.newaxis]),
        (slice(tendons + 8, None), energy.gradient_by_offset(strain, pulls)),
    ):
        columns[:count, part] = -unscale_gradient(energy, twist, gradient)[:, :, 0]
    arm_to_tip = state.position[:, grid.step.size, np.newaxis] - state.position
    for axis, unit in enumerate(np.eye(3)[:, :, np.newaxis]):
        local = into_section(state.rotation, np.broadcast_to(unit, state.position.shape))
        columns[:3, tendons + 3 + axis] = local
        columns[3:, tendons + axis] = local
        moment = cross(arm_to_tip, np.broadcast_to(unit, arm_to_tip.shape))
        columns[:3, tendons + axis] = into_section(state.rotation, moment)
    changes = problem.respond(state, problem.compliance(state), columns)
    pose, strains = _integrate(state.twist, state.rotation, grid, changes)
    by_twist = unscale_gradient(energy, twist, lengthening)[:, :, 0]
    weights = integration_weights(grid)
    length = np.tensordot(by_twist * weights, changes[:count], axes=([0, 2], [0, 2]))
    length[:, tendons + 8 :] += np.diag(energy.length_by_offset(strain) @ weights)
    edges = np.cumsum([tendons, 6, 1, 1])
    parts = zip(*(np.split(part, edges, axis=-1) for part in (pose, strains, length)), strict=True)
    return Sensitivity(*(Change(*part) for part in parts))


def _integrate(
    twist: FloatArray, frames: Quaternions, grid: StationGrid, changes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pose (stations, 6, columns) and strain (stations, 4, columns) from twist (6, columns, n)."""
    rotation = Quaternions(frames.a[0], frames.b[0]).matrix()
    linear = np.zeros((3, twist.shape[1]))
    linear[: len(twist) - 3] = twist[3:]
    advance = np.einsum('ijn,jn->in', rotation, linear)[:, np.newaxis]
    angle = integrate_from_base(np.einsum('ijn,jcn->icn', rotation, changes[:3]), grid)
    moved = cross(angle, np.broadcast_to(advance, angle.shape))
    moved += np.einsum('ijn,jcn->icn', rotation, changes[3:])
    at = grid.station_node
    pose = np.concatenate([integrate_from_base(moved, grid)[..., at], angle[..., at]])
    stretch = twist[3, at]
    strain = changes[:4, :, at].copy()
    omega = twist[:3, np.newaxis, at] / stretch
    strain[:3] = (strain[:3] - omega * strain[3]) / stretch
    return pose.transpose(2, 0, 1), strain.transpose(2, 0, 1)
