"""Balance of a loaded arm: a boundary value problem, collocated and solved by Newton's method.

The unknowns are twists and orientations at the points of a `Collocation`. From these follows the
wrench of the loads at every cross section, m' = n x u' from the tip, which balances the gradient
of its energy.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from octo_arm_model.core.arm.loads import Tangent
from octo_arm_model.core.errors import LoadError
from octo_arm_model.core.hints import FloatArray, Number
from octo_arm_model.core.loaded.collocation import Collocation
from octo_arm_model.core.loaded.kinematics import frames, matrix_of
from octo_arm_model.core.loaded.linearised import Linearised, Response, System
from octo_arm_model.core.loaded.loading.load_resultants import LoadTable
from octo_arm_model.core.loaded.loading.load_tangents import RodPoints, WithTangents
from octo_arm_model.core.loaded.sliding.friction import Friction, Sliding
from octo_arm_model.core.loaded.state import Condition, State, in_sections, relative
from octo_arm_model.core.numerics.quaternion import Quaternions, product
from octo_arm_model.core.numerics.vectors import cross, skew
from octo_arm_model.core.rod.solution import Shape
from octo_arm_model.core.section.energy import SectionEnergy
from octo_arm_model.core.section.newton import force_scale
from octo_arm_model.core.section.strain_measures import derivatives_by_twist, gradient_by_twist

# From tensions (tendons,) and twist (n, points) to the gradient of the energy by the twist,
# (n, points), its Hessian (n, n, points), and what an imbalance is measured by, (n, points).
Evaluate: TypeAlias = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray, FloatArray]]

# From angular twist (3, ..., points) to orientations of the cross sections, (..., points).
Frames: TypeAlias = Callable[[FloatArray], Quaternions]


_SOFT = 0.5  # part of the bending stiffness that sheaths take, of which a margin says little


class Pulled(NamedTuple):
    """Cross sections with the tendons that pull, see `SectionEnergy.pulled`, and `force_scale`."""

    energy: SectionEnergy
    local_tensions: FloatArray
    scale: FloatArray


class Equilibrium:
    """The equations of one arm under loads.

    Attributes:
        evaluate: derivatives of the energy of cross sections in machine code, if there is.
        frames: orientations from angular twists.
        energy: of the cross sections at the points.
        collocation: the points.
        loads: at the points.
        base: orientation of the base.
        friction: of the tendons, if any.
        unloaded_sign: sign of the determinant of the equations without loads.
    """

    def __init__(
        self, energy: SectionEnergy, collocation: Collocation, loads: LoadTable, base: Quaternions,
        friction: Friction | None = None,
    ) -> None:  # fmt: skip
        """Prepare for the cross sections ``energy`` at the points of ``collocation``."""
        self.friction = friction
        self.energy, self.collocation = energy, collocation
        self.loads, self.base = loads, base
        self.evaluate: Evaluate | None = None
        # By the very tensions and condition of the last call, as a search for balance keeps them.
        self._pulled_last: tuple[FloatArray, Pulled] | None = None
        self._resultants_last: tuple[Condition, FloatArray] | None = None
        self.frames: Frames = functools.partial(
            frames, collocation=collocation, base=matrix_of(base)
        )
        # Moments are measured in this, so that both halves of the system are of one size.
        self._unit = float(energy.stiffness.bending.mean()) / collocation.length
        beyond = collocation.length - collocation.s
        self._per_force = float((beyond * beyond / energy.stiffness.bending).max())
        # Without loads every balance is stable.
        count = collocation.s.size
        nothing = np.zeros((3, count))
        unloaded = np.broadcast_to(
            np.eye(energy.strains)[..., np.newaxis], (energy.strains, energy.strains, count)
        )
        rotation = np.broadcast_to(np.eye(3)[..., np.newaxis], (3, 3, count))
        self.unloaded_sign = Linearised(
            collocation, unloaded, rotation, nothing, nothing, nothing, 1.0
        ).sign

    def shape(self, twist: FloatArray) -> Shape:
        """The shape of a rod of ``twist`` (n, ..., points)."""
        return Shape(twist, self.frames(twist[:3]))

    def moved(self, shape: Shape, change: Response, part: float = 1.0) -> Shape:
        """``shape`` after ``part`` of a ``change`` of one column."""
        return self.shape(shape.twist + part * change.twist[:, 0])

    def extrapolate(self, before: Shape, now: Shape, part: float) -> Shape:
        """The shape after ``now`` by ``part`` of the change from ``before``."""
        return self.shape(now.twist + part * (now.twist - before.twist))

    def state(
        self, condition: Condition, shape: Shape, is_to_be_linearised: bool = False,
        sliding: Sliding | None = None,
    ) -> State:  # fmt: skip
        """Evaluate the balance of ``shape``, with the Hessian if it ``is_to_be_linearised``.

        Tendons with friction are ``sliding``, or as they slide in this shape.
        """
        twist, hessian = shape.twist, None
        if self.evaluate is not None and self.friction is None:
            gradient, hessian, scale = self.evaluate(condition.tensions, twist)
        else:
            # As a batch of cross sections, of one arm or several.
            batch = twist.reshape(len(twist), -1, twist.shape[-1])
            if self.friction is not None and sliding is None:
                tensions = np.atleast_2d(condition.tensions)
                sliding = self.friction.slide_along(batch, tensions, condition.before)
            energy, local_tensions, scale = self.pulled(condition.tensions, sliding)
            if is_to_be_linearised:
                gradient, hessian = derivatives_by_twist(energy, batch, local_tensions)
                hessian = hessian.reshape(len(twist), *twist.shape)
            else:
                gradient = gradient_by_twist(energy, batch, local_tensions)
            gradient, scale = gradient.reshape(twist.shape), scale.reshape(twist.shape)
        rotation, tangent, both = self._loaded(condition, shape)
        wrench = in_sections(rotation, both)[: len(twist)]
        imbalance = wrench - gradient
        residual = relative(imbalance, scale, wrench)
        return State(
            condition, shape, rotation, tangent, both[0], both[1], imbalance, residual, sliding,
            hessian,
        )  # fmt: skip

    def last_state(
        self, state: State, change: Response, residual: Number, sliding: Sliding | None = None
    ) -> State:
        """The ``state`` under dead loads after the last ``change`` of a search for balance.

        The change is so small that orientations follow to first order, and the ``residual`` that
        it leaves is known. Tendons with friction are ``sliding`` after it. The imbalance is the
        one before it.
        """
        twist = change.twist[:, 0]
        bends = np.einsum('ik...,k...->i...', state.rotation, twist[:3])
        t, n, b = self.collocation.integrate_from_base(0.5 * bends)
        orientation = Quaternions(*product(1.0 + 1j * t, n + 1j * b, *state.shape.orientation))
        shape = Shape(state.shape.twist + twist, orientation)
        rotation, tangent, both = self._loaded(state.condition, shape)
        return State(
            state.condition, shape, rotation, tangent, both[0], both[1], state.imbalance, residual,
            sliding,
        )  # fmt: skip

    def _loaded(
        self, condition: Condition, shape: Shape
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rotation and tangent of `State`, and its moment and force, (2, 3, ..., points)."""
        twist, rotation = shape.twist, shape.orientation.matrix()
        if len(twist) == 4:
            tangent = rotation[:, 0] * twist[3]
        else:
            tangent = np.einsum('ik...,k...->i...', rotation, twist[3:])
        both = self._resultants(condition, shape.orientation).copy()
        both[0] += self.collocation.integrate_from_tip(cross(tangent, both[1]))
        return rotation, tangent, both

    def _resultants(self, condition: Condition, orientation: Quaternions) -> FloatArray:
        """Moment, without what forces have of it, and force of all loads, (2, 3, ..., points)."""
        last = self._resultants_last
        if last is None or last[0] is not condition or self.loads.others:
            loads = self.loads.resultants(RodPoints(self.collocation, orientation))
            # Dead loads are those of all arms, the wrench on its tip is that of each.
            on_tip = condition.tip_wrench.T[..., np.newaxis]
            of_all = 3, *(1,) * (on_tip.ndim - 2), -1
            force, moment = (condition.factor * part.reshape(of_all) for part in loads)
            last = condition, np.array([moment + on_tip[3:], force + on_tip[:3]])
            self._resultants_last = last
        return last[1]

    def moment_apart(self, state: State) -> FloatArray:
        """Moment of the loads in a ``state``, without what forces have of it, (3, ..., points)."""
        moment, _ = self._resultants(state.condition, state.shape.orientation)
        return moment

    def pulled(self, tensions: FloatArray, sliding: Sliding | None = None) -> Pulled:
        """What is pulled by ``tensions``, (tendons,) or (arms, tendons) [N].

        Tendons with friction pull as they are ``sliding``.
        """
        if self.friction is not None and sliding is not None:
            some = self.friction.pulled(np.atleast_2d(tensions))
            local_tensions = sliding.tensions[some.pull]
            scale = force_scale(some.energy, local_tensions)
            return Pulled(some.energy, local_tensions, scale)
        last = self._pulled_last
        if last is None or last[0] is not tensions:
            found = self.energy.pulled(np.atleast_2d(tensions))
            self._pulled_last = last = tensions, Pulled(*found, force_scale(*found))
        return last[1]

    def hessian(self, state: State) -> FloatArray:
        """Second derivatives of the energy by the twist, (n, n, ..., points), in a ``state``."""
        if state.hessian is not None:
            return state.hessian
        twist = state.shape.twist
        energy, local_tensions, _ = self.pulled(state.condition.tensions, state.sliding)
        batch = twist.reshape(len(twist), -1, twist.shape[-1])
        hessian = derivatives_by_twist(energy, batch, local_tensions)[1]
        return hessian.reshape(len(twist), *twist.shape)

    def linearised(self, state: State, damping: float = 0.0, near: System | None = None) -> System:
        """The linear system about ``state``, for cross sections stiffer by ``damping``.

        That of a state ``near`` saves work, see `Linearised`.
        """
        hessian = self.hessian(state)
        linear = Linearised(
            self.collocation, hessian * (1.0 + damping) if damping else hessian, state.rotation,
            state.tangent, state.moment, state.force, self._unit,
            near if isinstance(near, Linearised) else None,
        )  # fmt: skip
        factor = state.condition.factor
        if not self.loads.others or not factor:
            return linear
        found = self.loads.tangents(RodPoints(self.collocation, state.shape.orientation))
        tangents = tuple(Tangent(one.s, factor * one.force, factor * one.moment) for one in found)
        if not tangents:
            return linear
        return WithTangents(
            linear, self.collocation, state.rotation, state.tangent, tangents, len(state.imbalance)
        )

    def load_change(self, before: FloatArray, tensions: FloatArray, now: FloatArray) -> float:
        """How much the loads on an arm that has hardly moved may have changed its stiffness.

        In parts of it, for the wrench ``now`` on the tip (6,) instead of ``before``, under
        ``tensions`` (tendons,): the change of the force times the square of its lever over E I,
        where that is largest; a column held at its base buckles at 2.5. Residuals do not tell of
        it, as tensions are part of their scale. Infinite where that is not known: where other
        loads have changed, or sheaths take most of the stiffness, which changes with tensions.
        """
        if self.loads.scaled is not None or self.energy.most_softened(tensions) > _SOFT:
            return math.inf
        if now is before:
            return 0.0
        return self._per_force * math.dist(now[:3].tolist(), before[:3].tolist())

    def require_tangents(self, what: str) -> None:
        """Refuse ``what`` needs the tangent stiffness of every load.

        Raises:
            LoadError: if a load states none.
        """
        if self.loads.without_tangent:
            raise LoadError(
                f'{self.loads.without_tangent} states no tangent stiffness, which {what} needs'
            )

    def tip_wrenches(self, state: State) -> FloatArray:
        """Resultants of unit forces and moments on the tip at all cross sections, (6, 6, points).

        Moment and force in the axes of each; columns are the forces and the moments on the tip,
        in base_frame.
        """
        own = self.collocation
        to_tip = own.integrate_from_tip(state.tangent)
        inverse = state.rotation.transpose(1, 0, 2)
        wrench = np.zeros((6, 6, own.s.size))
        wrench[3:, :3] = inverse
        wrench[:3, :3] = np.einsum('jin,jkn->ikn', state.rotation, skew(to_tip))
        wrench[:3, 3:] = inverse
        return wrench

    def turn(self, change: Response) -> Number:
        """How far a small ``change`` turns each arm, all its bends added up, (...) [rad]."""
        angular = change.twist[:3, 0]
        return np.sqrt(np.add.reduce(angular * angular)) @ self.collocation.weights

    def work(self, state: State, change: Response) -> float:
        """What the imbalance of ``state`` does on a small ``change`` [J].

        The rate at which the change takes energy from the arm and its loads.
        """
        power = np.add.reduce(state.imbalance * change.twist[:, 0])
        return float(power @ self.collocation.weights)
