"""Elastic laws of a cross section: its energy of stretching and bending.

In a cross section of stretch lambda and bend c a fibre at the distance y from the centre, in the
plane of bending, has the stretch lambda + c y. c is the curvature per reference length times the
`widening` of the section. A law gives the energy per reference length over E A as a function of
lambda and z = (c R)^2. Torsion adds 1/2 G I (widening x torsion)^2.

A new law is a class that is a `Law` and an entry in `LAWS`.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from octo_arm_model.core.hints import FloatArray, Number


class Density(NamedTuple):
    """First and second derivatives, in lambda and z, of the energy over E A.

    Each has the shape of lambda and z, and is NaN where a fibre has no positive length.
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
        """Whether a section widens as it is compressed; if not, `widening` is not called."""

    @property
    def meant_for(self) -> str:
        """The kind of arm it is for, in one or two words."""

    def density(self, stretch: FloatArray, bend: FloatArray) -> Density:
        """Derivatives at lambda = ``stretch`` and z = ``bend``."""

    def slopes(self, stretch: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The first derivatives alone, the first two of `density`."""

    def widening(self, stretch: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Radius over reference radius at lambda = ``stretch``, and its first two derivatives."""


def linear_density(stretch: Number, bend: Number) -> tuple[Number, Number, Number, Number, Number]:
    """`Density` of the law linear, for numbers or arrays."""
    zero = 0.0 * (stretch + bend)
    return stretch - 1.0, zero + 0.125, zero + 1.0, zero, zero


def neo_hookean_slopes(
    stretch: Number, bend: Number
) -> tuple[Number, Number, Number, Number, Number, Number, Number]:
    """First derivatives in the `Density` of the law neo_hookean, for numbers or arrays.

    Returns:
        Both, then w of `NeoHookean`, lambda + w, 1 / (lambda + w), 1 / w, and the part of the
        derivative by z that varies: a third of 1 / w over the square of lambda + w.
    """
    # The root of lambda^2 - z; NaN where a fibre has no length left.
    w = np.sqrt(stretch * np.abs(stretch) - bend)
    total, over_w = stretch + w, 1.0 / w
    over = 1.0 / total
    third = over_w * over * (1.0 / 3.0)
    by_stretch, varying = stretch * (1.0 / 3.0) - (third + third), third * over
    return by_stretch, varying + 1.0 / 24.0, w, total, over, over_w, varying


def neo_hookean_density(
    stretch: Number, bend: Number
) -> tuple[Number, Number, Number, Number, Number]:
    """`Density` of the law neo_hookean, for numbers or arrays."""
    by_stretch, by_bend, w, total, over, over_w, varying = neo_hookean_slopes(stretch, bend)
    square = over_w * over_w
    mixed = square * varying
    return (
        by_stretch,
        by_bend,
        square * over_w * (2.0 / 3.0) + 1.0 / 3.0,
        -(total + w) * mixed,
        (w * over + 0.5) * mixed,
    )


def incompressible_widening(stretch: Number) -> tuple[Number, Number, Number]:
    """lambda^(-1/2) and its first two derivatives, for numbers or arrays."""
    over = 1.0 / stretch
    width = np.sqrt(over)
    slope = -0.5 * width * over
    return width, slope, -1.5 * slope * over


class LinearElastic:
    """Linear elasticity, the paper's (3): 1/2 E A q^2 + 1/2 E J kappa^2, without widening."""

    widens, meant_for = False, 'stiff'

    def density(self, stretch: FloatArray, bend: FloatArray) -> Density:
        """Derivatives at lambda = ``stretch`` and z = ``bend``; J = A R^2 / 4."""
        return Density(*linear_density(stretch, bend))

    def slopes(self, stretch: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The first derivatives alone, see `Law`."""
        return linear_density(stretch, bend)[:2]

    def widening(self, stretch: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """No widening: 1, and zero derivatives."""
        zero = np.zeros_like(stretch)
        return np.ones_like(stretch), zero, zero


class NeoHookean:
    """Incompressible rubber: fibres of energy mu/2 (l^2 + 2/l - 3), mu = E/3, stretched by l.

    Integrated over the circle in closed form: with w = sqrt(lambda^2 - z), the mean of 1/l is
    2 / (lambda + w). Volume is kept, so a section compressed to lambda widens by lambda^-1/2.
    """

    widens, meant_for = True, 'soft'

    def density(self, stretch: FloatArray, bend: FloatArray) -> Density:
        """Derivatives at lambda = ``stretch`` and z = ``bend``."""
        return Density(*neo_hookean_density(stretch, bend))

    def slopes(self, stretch: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The first derivatives alone, see `Law`."""
        return neo_hookean_slopes(stretch, bend)[:2]

    def widening(self, stretch: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """lambda^(-1/2) and its first two derivatives."""
        return incompressible_widening(stretch)


LAWS: dict[str, Law] = {'neo_hookean': NeoHookean(), 'linear': LinearElastic()}
DEFAULT_LAW = 'neo_hookean'
