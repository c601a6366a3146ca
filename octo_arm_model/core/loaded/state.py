"""The loads on a rod, its state under them, and the stability of that."""

from __future__ import annotations

from typing import NamedTuple

from octo_arm_model.core.hints import FloatArray, IntArray, Number
from octo_arm_model.core.loaded.linearised import Response
from octo_arm_model.core.loaded.sliding.friction import Sliding
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.solution import Shape


class Condition(NamedTuple):
    """What acts on the arm.

    Attributes:
        tensions: (tendons,), or (arms, tendons) of several arms [N].
        tip_wrench: force and moment on the tip in base_frame, (6,) or (arms, 6) [N, N m].
        factor: part of all other loads.
        before: where tendons have friction, their tensions at the points before, (tendons,
            points) [N]; None for slack ones.
    """

    tensions: FloatArray
    tip_wrench: FloatArray
    factor: float
    before: FloatArray | None = None

    def towards(self, other: Condition, part: float) -> Condition:
        """This one, moved by ``part`` of the way to ``other``."""
        return Condition(
            self.tensions + part * (other.tensions - self.tensions),
            self.tip_wrench + part * (other.tip_wrench - self.tip_wrench),
            self.factor + part * (other.factor - self.factor),
            other.before,
        )


class State(NamedTuple):
    """A loaded arm, in balance or not, or several: (..., arms, points) where (..., points) stands.

    Attributes:
        condition: what acts on it.
        shape: twists and orientations.
        rotation: orientation at the points as matrices, (3, 3, points).
        tangent: u', the derivative of the position by s, (3, points) [-].
        moment: of the loads from there to the tip, in base_frame, (3, points) [N m].
        force: likewise [N].
        imbalance: both less the gradient of the energy, in the axes of the cross section,
            (n, points).
        residual: largest imbalance over its scale, of each arm.
        sliding: where tendons have friction, what is left of their tension.
        hessian: of the energy by the twist, (n, n, points), where that is known already.
    """

    condition: Condition
    shape: Shape
    rotation: FloatArray
    tangent: FloatArray
    moment: FloatArray
    force: FloatArray
    imbalance: FloatArray
    residual: Number
    sliding: Sliding | None = None
    hessian: FloatArray | None = None

    def of(self, arms: IntArray) -> State:
        """That of some ``arms`` of several without friction."""
        condition, (a, b) = self.condition, self.shape.orientation
        return State(
            condition._replace(
                tensions=condition.tensions[arms], tip_wrench=condition.tip_wrench[arms]
            ),
            Shape(self.shape.twist[:, arms], Quaternions(a[arms], b[arms])),
            self.rotation[:, :, arms], self.tangent[:, arms], self.moment[:, arms],
            self.force[:, arms], self.imbalance[:, arms], self.residual[arms],
            hessian=None if self.hessian is None else self.hessian[:, :, arms],
        )  # fmt: skip


class Stability(NamedTuple):
    """Stability of an equilibrium.

    Attributes:
        is_stable: whether it returns after small perturbations; None under moments, where that is
            not known.
        sign: of the determinant of its equations, over that without loads, 1 or -1; where it
            changes, one branch has been left for another.
        softest_mode: of what is not stable, the change of least, or most negative, stiffness,
            scaled to turn the arm by about one radian.
    """

    is_stable: bool | None
    sign: int
    softest_mode: Response | None
