"""The loads on a rod, its state under them, and the stability of that."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
        factor: factor on all other loads [-], from 0 to 1.
        before: tensions [N] at the points from which tendons with friction slide, (tendons,
            points); None for slack ones.
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
    """A loaded arm, in equilibrium or not.

    Arrays have the shapes below for one arm, and an axis of arms before that of the points for
    several.

    Attributes:
        condition: what acts on it.
        shape: twists and orientations.
        rotation: orientation of the cross sections as matrices, (3, 3, points).
        tangent: u', the derivative of the position by s, (3, points) [-].
        moment: moment that the loads beyond a point exert on the cross section there, in
            base_frame, (3, points) [N m].
        force: the force that they exert, in base_frame, (3, points) [N].
        imbalance: moment and force in the axes of the cross section, less the gradient of its
            energy by the twist, (n, points) [N m and N].
        residual: largest imbalance over its scale [-], a number or (arms,).
        sliding: tensions along tendons with friction; None without friction.
        hessian: of the energy by the twist, (n, n, points), where it has been computed already.
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
        """The states of those ``arms`` (indices) of several arms without friction."""
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


def in_sections(rotation: FloatArray, wrench: FloatArray) -> FloatArray:
    """A ``wrench`` (2, 3, ..., points) in the axes of the cross sections, (6, ..., points).

    Moment and force are given in base_frame, as is the ``rotation`` (3, 3, ..., points).
    """
    turned = np.einsum('ji...,kj...->ki...', rotation, wrench)
    return turned.reshape(6, *turned.shape[2:])


def relative(imbalance: FloatArray, scale: FloatArray, wrench: FloatArray) -> FloatArray:
    """`State.residual` of an ``imbalance``, (...); NaN where a strain is impossible.

    It is measured by a ``scale`` and the largest ``wrench`` along the arm. All are (n, ...,
    points) in the axes of the cross sections.
    """
    scale = scale + np.maximum.reduce(np.abs(wrench), axis=-1, keepdims=True)
    return np.asarray((np.abs(imbalance) / scale).max(axis=(0, -1)))


class Stability(NamedTuple):
    """Stability of an equilibrium.

    Attributes:
        is_stable: whether the arm returns after small perturbations; None where loads with
            moments have no energy to tell by.
        sign: sign of the determinant of the linearised equations over that without loads, 1 or
            -1. Where it changes, one branch of equilibria has been left for another.
        softest_mode: for an unstable equilibrium, the change of shape of least, or most negative,
            stiffness, scaled to turn the arm by about one radian; else None.
    """

    is_stable: bool | None
    sign: int
    softest_mode: Response | None
