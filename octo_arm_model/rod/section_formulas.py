"""Formulas of cross sections that both forms of the node functions use, for numbers and arrays.

`section_loops` compiles them.
"""

import numpy as np

from octo_arm_model.arm.hints import Number, Numbers
from octo_arm_model.arm.material import LINEAR

# Factor of safety of an estimated residual, and the least estimate.
_MARGIN, _LEAST = 20.0, 1e-12


def density(
    law: int, stretch: Number, bend: Number
) -> tuple[Number, Number, Number, Number, Number]:
    """Return derivatives of psi_material / (E A) by the stretch lambda and by ``bend``.

    ``bend`` is (c R)^2 for a curvature c of a circular section, else (c_n b)^2 + (c_b a)^2 with
    the semi-axes a and b of the ellipse of the same area and second moments. The derivatives are
    by lambda, by bend, and the second ones ss, sb, bb; NaN where a fibre has no length.
    """
    if law == LINEAR:
        return stretch - 1.0, 0.125, 1.0, 0.0, 0.0
    # Rubber: the mean of 1 / l over the circle of fibres of stretch l is 2 / (lambda + root).
    root = np.sqrt(stretch * np.abs(stretch) - bend)
    inverse, inverse_root = 1.0 / (stretch + root), 1.0 / root
    third = inverse_root * inverse / 3.0
    varying, square = third * inverse, inverse_root * inverse_root
    mixed = square * varying
    return (
        stretch / 3.0 - 2.0 * third,
        varying + 1.0 / 24.0,
        square * inverse_root * (2.0 / 3.0) + 1.0 / 3.0,
        -(stretch + 2.0 * root) * mixed,
        (root * inverse + 0.5) * mixed,
    )


def widening(law: int, stretch: Number) -> tuple[Number, Number, Number]:
    """Return the radius over the reference radius, and its two derivatives by the stretch."""
    if law == LINEAR:
        none = 0.0 * stretch
        return 1.0 + none, none, none
    inverse = 1.0 / stretch
    width = np.sqrt(inverse)
    slope = -0.5 * width * inverse
    return width, slope, -1.5 * slope * inverse


def bent_by(law: int, force: Number, moment: Number) -> tuple[Number, Number, Number]:
    """Return the stretch of the section kept straight, that of the bent one, and c R of this [-].

    The pull ``force`` over E A and the ``moment`` over E A R do not depend on the strain. The
    result is exact to first order in the moment; for rubber it is the straight one and a secant.
    """
    if law == LINEAR:
        straight = np.maximum(1.0 - force, 0.05)
        return straight, straight, 4.0 * moment
    # Straight rubber is in balance where 1 / lambda^2 = lambda + 3 force, which this nearly is.
    stress = 1.0 + force + force + force * force / (1.0 + force)
    straight = 1.0 / np.sqrt(stress)
    ratio = 12.0 * moment / (straight + 2.0 * stress)
    # Bending lengthens rubber.
    secant = np.sqrt(1.0 + ratio * ratio)
    stretch = straight * np.sqrt(secant)
    return straight, stretch, stretch * ratio / secant


def rest_bend(law: int, stretch: Number) -> tuple[Number, Number]:
    """Return the factor of the curvature at rest, and its derivative by the stretch.

    A section without moment has the curvature at rest times this factor, which is linear in the
    stretch, because all fibres are then stretched alike. The factor of the torsion at rest is the
    `widening`, because fibres are then not sheared.
    """
    if law == LINEAR:
        return 1.0 + 0.0 * stretch, 0.0 * stretch
    return stretch, 1.0 + 0.0 * stretch


def offset_stiffness(
    bend: tuple[Number, Number, Number], p: tuple[Number, Number], stiff: Number
) -> tuple[Number, Number, Number]:
    """Return second derivatives of the energy by the offset in a sheath, over k: nn, nb and bb.

    ``bend`` are the scaled curvatures, ``p`` is the gradient of |u| by the offset and ``stiff`` is
    T / (k |u|).
    """
    (t, n, b), (p_n, p_b) = bend, p
    return (
        1.0 + stiff * (b * b + t * t - p_n * p_n),
        -stiff * (b * n + p_n * p_b),
        1.0 + stiff * (n * n + t * t - p_b * p_b),
    )


# The models of `papers`. ``sums`` over tendons are pull, n, b, nn, bb, mixed and torque;
# ``stiffness`` is E A, G I and E J about n and about b; vectors are along t, n and b.


def paper_twist(sums: Numbers, stiffness: Numbers, p: Numbers) -> Numbers:
    """Return omega = (K + D)^-1 (F + p) times the stretch, and the stretch, of a section."""
    pull, n, b, nn, bb, mixed, torque = sums
    axial, torsion, bending_n, bending_b = stiffness
    about_n, about_b = bending_n + bb, bending_b + nn
    moment_n, moment_b = p[1] - b, p[2] + n
    inverse = 1.0 / (about_n * about_b - mixed * mixed)
    xi = (about_b * moment_n + mixed * moment_b) * inverse
    k = (about_n * moment_b + mixed * moment_n) * inverse
    stretch = (k * n - xi * b - pull) / axial + 1.0
    tau = (p[0] - torque) / (torsion + (nn + bb))
    return tau * stretch, xi * stretch, k * stretch, stretch


def paper_moments(sums: Numbers) -> tuple[Numbers, Numbers]:
    """Return F and the diagonal of D."""
    _, n, b, nn, bb, _, torque = sums
    return (-torque, -b, n), (nn + bb, bb, nn)


def paper_jump(
    k: Number, base: tuple[Number, Number], tip: tuple[Number, Number], p: Number
) -> Number:
    """Return the imbalance at the base side of an anchorage by (11), from ``p`` at the tip side.

    It is one component, with the stiffness ``k`` and with F and D at both sides.
    """
    (f, d), (f_tip, d_tip) = base, tip
    omega = (f_tip + p) / (k + d_tip) + (f - f_tip) / (k + (d - d_tip))
    return omega * (k + d) - f


def paper_slope(stiffness: Numbers, sums: Numbers) -> Numbers:
    """Return the coefficients of p' by (10): xi_0, k_0, that of p_n p_b, and two of each p'.

    The two pairs of p_n' and p_b' are c times k_0 and xi_0, and the factors of p_b and p_n.
    """
    _, torsion, bending, _ = stiffness
    _, n, b, nn, bb, _, _ = sums
    c_t, c_n, c_b = 1.0 / (torsion + (nn + bb)), 1.0 / (bending + bb), 1.0 / (bending + nn)
    xi, k, c = -c_n * b, c_b * n, (bending + (nn + bb)) * c_t
    return xi, k, (bb - nn) * c_n * c_b, -c * k, c * xi, -bb * c_t * c_b, nn * c_t * c_n


def residual_left(size: Number, last: Number) -> Number:
    """Return a bound of the residual after a Newton step from ``size``, which followed ``last``.

    It assumes quadratic convergence with a `_MARGIN`. If ``last`` is zero, nothing is known of the
    convergence, and the bound is that of a step that leaves all of ``size``.
    """
    ratio = np.minimum(size / np.maximum(last, 1e-300), 1.0)
    return np.maximum(_MARGIN * size * np.maximum(size, ratio * ratio), _LEAST)
