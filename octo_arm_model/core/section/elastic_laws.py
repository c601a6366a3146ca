"""Elastic laws of a cross section: the energy of stretching and bending it.

A cross section stretched by lambda and bent has, at the distance y from its neutral axis, fibres
stretched by lambda + c y. All laws are written in lambda and z = (c R)^2, where c is the curvature
per reference length times the `widening` of the section, and give the energy per reference length
divided by E A. Torsion adds 1/2 G I (widening x torsion)^2 to each of them.

Another law is another class with these two methods and an entry in `LAWS`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from octo_arm_model.core.hints import FloatArray


class Density(NamedTuple):
    """First and second derivatives, in lambda and z, of the energy over E A.

    Each has the shape of lambda and z, and is NaN where the section cannot be: with a fibre
    compressed to nothing.
    """

    by_stretch: FloatArray
    by_bend: FloatArray
    by_stretch_stretch: FloatArray
    by_stretch_bend: FloatArray
    by_bend_bend: FloatArray


class Law(Protocol):
    """An elastic law; see the module for lambda and z."""

    @property
    def widens(self) -> bool:
        """Whether a compressed section gets wider; if not, `widening` is not asked."""

    def density(self, stretch: FloatArray, bend: FloatArray) -> Density:
        """Derivatives at lambda = ``stretch`` and z = ``bend``."""

    def widening(self, stretch: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Radius over reference radius at lambda = ``stretch``, and its two derivatives."""


class LinearElastic:
    """Linear elasticity, the paper's (3): 1/2 E A q^2 + 1/2 E J kappa^2, nothing widens."""

    widens = False

    def density(self, stretch: FloatArray, bend: FloatArray) -> Density:
        """Derivatives at lambda = ``stretch`` and z = ``bend``; J = A R^2 / 4."""
        q = stretch - 1.0
        one, zero = np.ones_like(stretch), np.zeros_like(stretch)
        return Density(q, 0.125 * one, one, zero, zero)

    def widening(self, stretch: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """One, whatever the stretch."""
        zero = np.zeros_like(stretch)
        return np.ones_like(stretch), zero, zero


class NeoHookean:
    """Incompressible rubber: fibres of energy mu/2 (l^2 + 2/l - 3), mu = E/3, stretched by l.

    Integrated over the circle in closed form: with w = sqrt(lambda^2 - z), the mean of 1/l is
    2 / (lambda + w). Volume is kept, so a section compressed to lambda widens by lambda^-1/2.
    """

    widens = True

    def density(self, stretch: FloatArray, bend: FloatArray) -> Density:
        """Derivatives at lambda = ``stretch`` and z = ``bend``."""
        w = stretch * stretch
        w -= bend
        # A fibre turned inside out: the root is NaN, and everything from it.
        np.copyto(w, np.nan, where=stretch <= 0.0)
        np.sqrt(w, out=w)
        total = stretch + w
        over = 1.0 / total
        over_w = 1.0 / w
        over_square = over * over
        both = over_w * over
        cube = over_w * over_w * over_w
        cube /= 6.0
        mixed = cube * over_square
        twice = total + w
        return Density(
            stretch / 3.0 - (2.0 / 3.0) * both,
            1.0 / 24.0 + (both * over) / 3.0,
            1.0 / 3.0 + 4.0 * cube,
            -2.0 * twice * mixed,
            (twice + w) * over * mixed,
        )

    def widening(self, stretch: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The reciprocal root of lambda."""
        over = 1.0 / stretch
        width = np.sqrt(over)
        slope = -0.5 * width * over
        return width, slope, -1.5 * slope * over


LAWS: dict[str, Law] = {'neo_hookean': NeoHookean(), 'linear': LinearElastic()}
DEFAULT_LAW = 'neo_hookean'
