"""Cross sections in balance by few operations on arrays.

Newton's method with the Hessian of the body: it is as stiff in bending about one axis as about
another, so that no matrix is factorised for a step. Tendons add little to it, and compliant
sheaths take a stiffness from it that is nearly the same about all axes. Where the method does not
converge at once, `newton` descends along the energy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number
from octo_arm_model.core.section.formulas import bending_factors

if TYPE_CHECKING:
    from octo_arm_model.core.section.energy import SectionEnergy

_MOST_STEPS = 12
_SLOW = 0.7  # of the imbalance, what a step leaves at most if another is worth while
# Relative imbalance from which on steps allow for the stiffness of the tendons: before, it is less
# than what the step leaves as it is finite.
_NEAR = 1e-3
_ROUNDING = 1e-13  # relative imbalance that no step makes less


class Tendons(Protocol):
    """The tendons of cross sections under given tensions, in one search for the balance.

    Strains are the rows (n, b, stretch) of the scaled strain, (3, batch, nodes), with torsion
    before them where tendons twist the arm.

    Attributes:
        has_torsion: whether they do.
        softening: bending stiffness that sheaths take from the body at the last strain [N m^2].
        torsion: torsional stiffness of the tendons there [N m^2].
        coupling: second derivatives by torsion and the two curvatures there, (2, batch, nodes).
        imbalance: of the tendons in their sheaths there, over the lever arm.
    """

    has_torsion: bool
    softening: Number
    torsion: Number
    coupling: Number
    imbalance: float

    def gradient(self, strain: FloatArray) -> FloatArray:
        """Gradient of the energy of tendons, and sheaths, by the ``strain``."""

    def stiffened(self, step: FloatArray) -> FloatArray:
        """What a ``step`` changes that by at the last strain, asked for without torsion."""


class Balance(NamedTuple):
    """Sections in balance.

    Attributes:
        strain: rows of the scaled strain, as of `Tendons`.
        residual: largest imbalance over its scale in each arm, (batch,).
        iterations: number of steps.
    """

    strain: FloatArray
    residual: FloatArray
    iterations: int


def balance(
    energy: SectionEnergy, tendons: Tendons, strain: FloatArray, scale: FloatArray,
    tolerance: float,
) -> Balance | None:  # fmt: skip
    """The balance near ``strain``, see `Tendons`, its imbalance within ``tolerance``.

    Of ``scale``, see `newton.force_scale`. None where it takes too many steps.
    """
    over, axial = 1.0 / scale, energy.stiffness.axial
    previous = np.inf
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
        left = np.abs(gradient * over)
        worst = float(left.max(initial=0.0))
        is_balanced = worst <= tolerance and tendons.imbalance <= tolerance
        if is_balanced and worst <= _ROUNDING:
            return Balance(strain, left.max(axis=(0, 2), initial=0.0), iterations)
        if not worst <= max(_SLOW * previous, tolerance):  # nor where it is NaN
            return None
        previous = worst
        body = _Body(
            bending, square, once - tendons.softening, both, second, axial * f.by_stretch_stretch
        )
        if tendons.has_torsion:
            about_t = energy.stiffness.torsion + tendons.torsion
            step = _with_torsion(body, gradient, about_t, tendons.coupling)
        else:
            step = body.step(gradient)
        if is_balanced:
            # A last step leaves rounding, whatever the tolerance is.
            return Balance(strain + step, left.max(axis=(0, 2), initial=0.0), iterations)
        if worst < _NEAR and not tendons.has_torsion:
            step = body.step(gradient + tendons.stiffened(step))
        strain = strain + step
    return None


def _with_torsion(
    body: _Body, gradient: FloatArray, torsion: Number, coupling: Number
) -> FloatArray:
    """Step of torsion and body, where the ``torsion``'s ``coupling`` with bending is weak."""
    step = np.empty_like(gradient)
    rest = gradient[1:].copy()
    rest[:2] -= coupling * (gradient[0] / torsion)
    step[1:] = body.step(rest)
    step[0] = (gradient[0] + np.add.reduce(coupling * step[1:3])) / -torsion
    return step


class _Body(NamedTuple):
    """The Hessian of the body by two curvatures c and the stretch.

    Its parts are ``once`` 1 + ``second`` c c^T, ``both`` c, see `bending_factors`, and ``axial``.
    """

    bending: FloatArray
    square: FloatArray
    once: FloatArray
    both: FloatArray
    second: FloatArray
    axial: FloatArray

    def step(self, gradient: FloatArray) -> FloatArray:
        """What takes a ``gradient`` (3, batch, nodes) to zero."""
        bending, square, once, both, second, axial = self
        along = np.add.reduce(bending * gradient[:2])
        about, cross = once + square * second, square * both
        over = 1.0 / (about * axial - cross * both)
        found = np.empty_like(gradient)
        stretch = found[2] = (both * along - about * gradient[2]) * over
        # Product of c and its own step.
        turned = (cross * gradient[2] - axial * along) * over
        found[:2] = (gradient[:2] + bending * (second * turned + both * stretch)) / -once
        return found
