"""Balance of a loaded arm: a boundary value problem, solved by Newton's method.

The unknowns are the twists at all nodes. Given them, the shape follows, and from it the wrench
that the loads put on every cross section; what each cross section answers with is the gradient of
its energy. A step takes how both change, with the shape, into account at once: the rotation phi
of the cross sections and the moment mu added to them, in their own axes, obey

    phi' = -w x phi + d kappa    mu' = -w x mu + n x (d v - v x phi)

for a change (d kappa, d v) = C (residual + (mu + m x phi, n x phi)) of the twist (w, v), where
(m, n) is the wrench and C the compliance of the cross section.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.load_resultants import LoadTable
from octo_arm_model.core.numerics.batched_ldlt import factorise, invert
from octo_arm_model.core.numerics.boundary_value import TwoPointProblem
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.numerics.vectors import skew
from octo_arm_model.core.rod.grid import StationGrid
from octo_arm_model.core.rod.kinematics import Frame, node_frames
from octo_arm_model.core.rod.quadrature import integration_weights
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import force_scale
from octo_arm_model.core.section.strain_measures import to_scaled, unscale

# A compliance this many times the others is that of something that moves freely.
_FREE = 1e6


class State(NamedTuple):
    """A loaded arm, in balance or not, at every node.

    Attributes:
        twist: (n, nodes).
        local_tensions: of every tendon at every node [N], (tendons, 1, nodes).
        position: from the base, in base_frame, (3, nodes) [m].
        rotation: orientation of the cross sections, (1, nodes).
        wrench: moment and force of what lies beyond, in the axes of the cross section, (6, nodes).
        imbalance: the part of it that the cross section does not answer, (n, nodes).
        hessian: of the energy by the twist, (n, n, nodes).
        residual: largest imbalance over its scale.
    """

    twist: FloatArray
    local_tensions: FloatArray
    position: FloatArray
    rotation: Quaternions
    wrench: FloatArray
    imbalance: FloatArray
    hessian: FloatArray
    residual: float


class Condition(NamedTuple):
    """What acts on the arm.

    Attributes:
        tensions: (tendons,) [N].
        tip_wrench: force and moment on the tip in base_frame, (6,) [N, N m].
        factor: part of all other loads.
    """

    tensions: FloatArray
    tip_wrench: FloatArray
    factor: float

    def towards(self, other: Condition, part: float) -> Condition:
        """This one, moved by ``part`` of the way to ``other``."""
        return Condition(
            self.tensions + part * (other.tensions - self.tensions),
            self.tip_wrench + part * (other.tip_wrench - self.tip_wrench),
            self.factor + part * (other.factor - self.factor),
        )


class Stability(NamedTuple):
    """Stability of an equilibrium.

    Attributes:
        is_stable: whether it would come back; None under moments, where that is not known.
        sign: of the determinant of its equations, over that without loads, 1 or -1; where it
            changes, one branch has been left for another.
        softest_mode: change of twist (n, nodes) of least, or most negative, stiffness, scaled to
            turn the arm by about one radian.
    """

    is_stable: bool | None
    sign: int
    softest_mode: FloatArray


class Equilibrium:
    """The equations of one arm under loads."""

    def __init__(
        self, energy: SectionEnergy, grid: StationGrid, loads: LoadTable, base: Frame
    ) -> None:
        """Prepare for the cross sections ``energy`` at the nodes of ``grid``."""
        self._energy, self._grid, self._loads = energy, grid, loads
        # Only differences of positions matter here: from the base they keep their digits.
        self._base = Frame(np.zeros(3), base.rotation)
        self._problem = TwoPointProblem(grid.step)
        self._weights = integration_weights(grid)
        # Moments are measured in this, so that both halves of the system are of one size.
        self._unit = float(energy.stiffness.bending.mean()) / float(grid.s[-1])
        # Without loads every balance is stable.
        nothing = np.zeros((6, 6, grid.nodes.size))
        _, self._sign = self._problem.solve(nothing, nothing[:, :1])

    def state(self, condition: Condition, twist: FloatArray) -> State:
        """Evaluate the balance of ``twist`` (n, nodes)."""
        energy = self._energy
        local_tensions = energy.local_tensions(condition.tensions[np.newaxis])
        strain = to_scaled(energy.law, twist[:, np.newaxis])
        gradient, hessian = energy.material(strain)
        pulled, across = energy.tendon_derivatives(strain, local_tensions)
        gradient += pulled
        hessian += across
        gradient, hessian = unscale(energy, twist[:, np.newaxis], gradient, hessian)

        position, rotation = node_frames(twist[:, np.newaxis], self._grid, self._base)
        position = position[0].T
        force = condition.factor * self._loads.force + condition.tip_wrench[:3, np.newaxis]
        moment = self._loads.moment(position, force, condition.tip_wrench, condition.factor)
        wrench = np.concatenate([into_section(rotation, moment), into_section(rotation, force)])
        imbalance = wrench[: len(twist)] - gradient[:, 0]
        scale = force_scale(energy, local_tensions)[:, 0]
        outside = np.abs(wrench[: len(twist)]).max(axis=1, keepdims=True)
        residual = float((np.abs(imbalance) / (scale + outside)).max())
        return State(
            twist,
            local_tensions,
            position,
            rotation,
            wrench,
            imbalance,
            hessian[:, :, 0],
            residual,
        )

    def compliance(self, state: State) -> FloatArray:
        """Change of the whole twist per change of wrench at every cross section, (6, 6, nodes)."""
        count = len(state.twist)
        small = invert(factorise(state.hessian))
        compliance = np.zeros((6, 6, state.twist.shape[1]))
        compliance[:count, :count] = small
        return compliance

    def respond(self, state: State, compliance: FloatArray, wrench: FloatArray) -> FloatArray:
        """Change of twist (6, columns, nodes) under small ``wrench`` (6, columns, nodes) more.

        It acts on the cross sections, in their axes; what moving loads add is taken into account.
        """
        return self._respond(state, compliance, wrench)[0]

    def _respond(
        self, state: State, compliance: FloatArray, wrench: FloatArray
    ) -> tuple[FloatArray, int]:
        """`respond`, and the sign of the determinant of what it solves."""
        direct = np.einsum('ijn,jcn->icn', compliance, wrench)
        moment, force = state.wrench[:3], state.wrench[3:]
        if not (np.count_nonzero(moment) or np.count_nonzero(force)):
            return direct, self._sign  # No external wrench: no geometric stiffness.
        angular = state.twist[:3]
        linear = np.zeros_like(angular)
        linear[: len(state.twist) - 3] = state.twist[3:]
        turn, carry = skew(angular), skew(force)
        unit = self._unit
        # How the wrench in the axes of a cross section changes with its rotation phi and with mu.
        by_phi = np.concatenate([skew(moment), carry])
        kappa_by_phi = np.einsum('ijn,jkn->ikn', compliance, by_phi)
        kappa_by_mu = compliance[:, :3] * unit
        a = np.empty((6, 6, angular.shape[1]))
        a[:3, :3] = kappa_by_phi[:3] - turn
        a[:3, 3:] = kappa_by_mu[:3]
        over = carry / unit
        a[3:, :3] = np.einsum('ijn,jkn->ikn', over, kappa_by_phi[3:] - skew(linear))
        a[3:, 3:] = np.einsum('ijn,jkn->ikn', over, kappa_by_mu[3:]) - turn
        f = np.concatenate([direct[:3], np.einsum('ijn,jcn->icn', over, direct[3:])])
        y, sign = self._problem.solve(a, f)
        changes = np.concatenate([kappa_by_phi, kappa_by_mu], axis=1)
        return direct + np.einsum('ijn,jcn->icn', changes, y), sign

    def step(self, state: State, damping: float = 0.0) -> FloatArray:
        """Newton's step of the twist, (n, nodes), for cross sections stiffer by ``damping``."""
        count = len(state.twist)
        residual = np.zeros((6, 1, state.twist.shape[1]))
        residual[:count, 0] = state.imbalance
        return self.respond(state, self.compliance(state) / (1.0 + damping), residual)[:count, 0]

    def stability(self, state: State) -> Stability:
        """Whether a balanced ``state`` is stable.

        A stable arm yields to every small wrench on its tip in the direction of the wrench, and
        the determinant of its equations has the sign it has without loads: of one mode of
        buckling it is the other one, of two at once the compliance tells.
        """
        rotation = Quaternions(state.rotation.a[0], state.rotation.b[0]).matrix()
        lever = state.position[:, self._grid.step.size, np.newaxis] - state.position
        # Unit forces and moments (over a length, so that they compare) in the axes of each.
        wrench = np.zeros((6, 6, lever.shape[1]))
        wrench[3:, :3] = rotation.transpose(1, 0, 2)
        wrench[:3, :3] = np.einsum('jin,jkn->ikn', rotation, skew(lever))
        wrench[:3, 3:] = rotation.transpose(1, 0, 2) * float(self._grid.s[-1])
        changes, sign = self._respond(state, self.compliance(state), wrench)
        compliance = np.tensordot(wrench * self._weights, changes, axes=([0, 2], [0, 2]))
        values, vectors = np.linalg.eigh(0.5 * (compliance + compliance.T))
        worst = int(np.argmin(values)) if values.min() <= 0.0 else int(np.argmax(values))
        softest_mode = np.einsum('icn,c->in', changes, vectors[:, worst])[: len(state.twist)]
        softest_mode /= self.turn(softest_mode)
        # What yields without end in one direction is neither: an arm that may turn about the
        # vertical, say. Rounding gives that any sign.
        is_free = np.abs(values) > _FREE * np.median(np.abs(values))
        is_stable: bool | None = bool(values[~is_free].min(initial=1.0) > 0.0)
        if not is_free.any() and sign != self._sign:
            is_stable = False
        # A moment that keeps its direction has no energy, and nothing follows from compliance.
        if self._loads.has_moments or np.abs(state.wrench[:3, self._grid.step.size]).any():
            is_stable = None
        return Stability(is_stable, sign * self._sign, softest_mode)

    def turn(self, step: FloatArray) -> float:
        """How far a small ``step`` of the twist turns the arm, all its bends added up [rad]."""
        return float(np.sqrt(np.add.reduce(step[:3] * step[:3])) @ self._weights)

    def work(self, state: State, step: FloatArray) -> float:
        """What the imbalance of ``state`` does on a small ``step`` of the twist [J].

        The rate at which the step takes energy from the arm and its loads.
        """
        return float(np.add.reduce(state.imbalance * step) @ self._weights)


def into_section(rotation: Quaternions, vector: FloatArray) -> FloatArray:
    """Turn ``vector`` (3, nodes) from base_frame into the axes of the cross sections."""
    inverse = Quaternions(rotation.a.conj(), -rotation.b)
    turned = inverse.rotate(Quaternions.from_vector(*vector[:, np.newaxis]))
    return np.stack([turned.a.imag[0], turned.b.real[0], turned.b.imag[0]])
