"""Equilibrium of cross sections by a quasi-Newton method of few array operations.

The approximate Hessian is that of the body, which is isotropic in bending, so that steps are
explicit and no matrix is factorised. Tendons add little to it, and compliant sheaths subtract a
nearly isotropic bending stiffness. Where this does not converge quickly, `newton` minimises.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number
from octo_arm_model.core.section.formulas import bending_factors

if TYPE_CHECKING:
    from octo_arm_model.core.section.energy import SectionEnergy

_MOST_STEPS = 12
_SLOW = 0.7  # largest ratio of successive residuals at which the iteration goes on
# Relative residual below which steps include the stiffness of the tendons: above, its effect is
# smaller than the error of linearisation.
_NEAR = 1e-3
_ROUNDING = 1e-13  # relative imbalance that no step makes less
# Factor on an imbalance that is estimated, not evaluated, and the least estimate: what rounding of
# elastic forces leaves of the least `newton.force_scale`.
_SAFETY, _LEAST = 10.0, 2e-12


class Tendons(Protocol):
    """The tendons of cross sections under given tensions, during one iteration.

    Strains are the rows (n, b, stretch) of the scaled strain, (3, batch, nodes), preceded by
    torsion if ``has_torsion``.

    Attributes:
        has_torsion: whether torsion is one of the unknowns.
        softening: loss of bending stiffness by sheaths at the last strain [N m^2].
        torsion: torsional stiffness of the tendons at the last strain [N m^2].
        coupling: second derivatives by torsion and each of the two curvatures at the last strain
            [N m^2], (2, batch, nodes).
        imbalance: largest residual of the offsets in the sheaths at the last strain, over the
            lever arm [-].
    """

    has_torsion: bool
    softening: Number
    torsion: Number
    coupling: Number
    imbalance: float

    def gradient(self, strain: FloatArray) -> FloatArray:
        """Gradient of the energy of tendons and sheaths at ``strain``.

        ``strain`` is the last strain from then on.
        """

    def stiffened(self, step: FloatArray) -> FloatArray:
        """Change of the gradient by a ``step`` from the last strain; without torsion only."""


class Balance(NamedTuple):
    """Cross sections in equilibrium.

    Attributes:
        strain: rows of the scaled strain, as in `Tendons`.
        residual: largest residual over its scale in each arm, (batch,).
        iterations: number of steps.
    """

    strain: FloatArray
    residual: FloatArray
    iterations: int


def balance(
    energy: SectionEnergy, tendons: Tendons, strain: FloatArray, scale: FloatArray,
    tolerance: float,
) -> Balance | None:  # fmt: skip
    """Equilibrium of cross sections, by steps from ``strain``, whose rows are those of `Tendons`.

    To a residual of at most ``tolerance`` times ``scale``, see `newton.force_scale`, of the same
    rows. None where convergence is slow.
    """
    over, axial = 1.0 / scale, energy.stiffness.axial
    previous, before = np.inf, np.array(np.inf)
    for iterations in range(_MOST_STEPS):
        bending = strain[-3:-1]
        square = np.add.reduce(bending * bending)
        f = energy.law.density(strain[-1], square * energy.squared_radius)
        once, both, second = bending_factors(
            f.by_bend, f.by_stretch_bend, f.by_bend_bend, energy.twice, energy.fourth
        )
        gradient = tendons.gradient(strain)
        gradient[-3:-1] += once * bending
        gradient[-1] += axial * f.by_stretch
        if tendons.has_torsion:
            gradient[0] += energy.stiffness.torsion * strain[0]
        left = np.maximum.reduce(np.abs(gradient * over))
        worst = float(left.max(initial=0.0))
        is_balanced = worst <= tolerance and tendons.imbalance <= tolerance
        if is_balanced and worst <= _ROUNDING:
            return Balance(strain, _largest(left), iterations)
        if not worst <= max(_SLOW * previous, tolerance):  # nor where it is NaN
            return None
        body = _Body.of(
            bending, square, once - tendons.softening, both, second, axial * f.by_stretch_stretch
        )
        if tendons.has_torsion:
            about_t = energy.stiffness.torsion + tendons.torsion
            step = _with_torsion(body, gradient, about_t, tendons.coupling)
        else:
            step = body.step(gradient)
        if is_balanced:
            # A last step leaves rounding, whatever the tolerance is.
            return Balance(strain + step, _largest(left), iterations)
        beyond = None
        if worst < _NEAR and not tendons.has_torsion:
            stiffened = tendons.stiffened(step)
            step, beyond = body.step(gradient + stiffened), stiffened * over
        strain = strain + step
        if iterations:
            after = _left_after(left, before, beyond)
            # How far offsets in sheaths are from balance goes with the last step.
            drift = _SAFETY * tendons.imbalance * worst / max(previous, _ROUNDING)
            if max(float(after.max(initial=0.0)), drift) <= tolerance:
                return Balance(strain, np.maximum(_largest(after), _LEAST), iterations + 1)
        previous, before = worst, left
    return None


def _left_after(left: FloatArray, before: FloatArray, beyond: FloatArray | None) -> FloatArray:
    """Estimate, with `_SAFETY`, of what a step leaves of what is ``left`` (batch, nodes).

    It leaves about that part which the last one left of what was ``before`` it. A step to the
    first order in the stiffness of the tendons leaves the square of that part, and of the part
    that this order is: ``beyond`` the body alone it adds that to the imbalance (3, batch, nodes).
    """
    part = left / np.maximum(before, _ROUNDING)
    if beyond is None:
        return np.asarray(_SAFETY * part * left)
    order = np.maximum.reduce(np.abs(beyond))
    return np.asarray(_SAFETY * (part * part * left + order * order / np.maximum(left, _ROUNDING)))


def _largest(left: FloatArray) -> FloatArray:
    """Of what is ``left`` (batch, nodes), in each arm."""
    return np.asarray(left.max(axis=1, initial=0.0))


def _with_torsion(
    body: _Body, gradient: FloatArray, torsion: Number, coupling: Number
) -> FloatArray:
    """Step with torsion eliminated, to first order in its weak ``coupling`` to bending."""
    step = np.empty_like(gradient)
    rest = gradient[1:].copy()
    rest[:2] -= coupling * (gradient[0] / torsion)
    step[1:] = body.step(rest)
    step[0] = (gradient[0] + np.add.reduce(coupling * step[1:3])) / -torsion
    return step


class _Body(NamedTuple):
    """Hessian of the body by the curvatures c = ``bending`` and the stretch.

    Its parts are ``once`` 1 + ``second`` c c^T, ``both`` c, see `bending_factors`, and ``axial``.
    By the curvature along c and the stretch it is ``about``, ``cross`` / |c| and ``axial``, and
    ``over`` is the inverse of the determinant of that.
    """

    bending: FloatArray
    once: FloatArray
    both: FloatArray
    second: FloatArray
    axial: FloatArray
    about: FloatArray
    cross: FloatArray
    over: FloatArray

    @classmethod
    def of(
        cls, bending: FloatArray, square: FloatArray, once: FloatArray, both: FloatArray,
        second: FloatArray, axial: FloatArray,
    ) -> _Body:  # fmt: skip
        """Of its parts, and the ``square`` of the curvature."""
        about, cross = once + square * second, square * both
        over = 1.0 / (about * axial - cross * both)
        return cls(bending, once, both, second, axial, about, cross, over)

    def step(self, gradient: FloatArray) -> FloatArray:
        """Newton step for a ``gradient``, both (3, batch, nodes)."""
        bending, once, both, second, axial, about, cross, over = self
        along = np.add.reduce(bending * gradient[:2])
        found = np.empty_like(gradient)
        stretch = found[2] = (both * along - about * gradient[2]) * over
        # Product of c and its own step.
        turned = (cross * gradient[2] - axial * along) * over
        found[:2] = (gradient[:2] + bending * (second * turned + both * stretch)) / -once
        return found
