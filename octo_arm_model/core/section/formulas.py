"""The energy of a cross section and its derivatives, as functions of numbers or of arrays.

The kernels call them with numbers, tendon by tendon, NumPy some of them with arrays of tendons and
nodes; `energy` and `strain_measures` compute the others by products of arrays. (t, n, b, stretch)
is the scaled strain, see `energy` for it and for u; width, slope and bend are the widening of the
section and its first two derivatives by the stretch; (x, y) is the offset of a tendon along n and
b and (dx, dy) its slope. Of symmetric Hessians the lower half is returned, row by row.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.hints import Number


def tendon_direction(
    t: Number, n: Number, b: Number, stretch: Number, width: Number,
    x: Number, y: Number, dx: Number, dy: Number,
) -> tuple[Number, Number, Number, Number]:  # fmt: skip
    """Components of u along t, n and b and its length |u|."""
    u_t = stretch + n * y - b * x
    u_n = width * dx - t * y
    u_b = width * dy + t * x
    return u_t, u_n, u_b, np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)


def tendon_gradient(
    u_t: Number, u_n: Number, u_b: Number, slope: Number,
    x: Number, y: Number, dx: Number, dy: Number,
) -> tuple[Number, Number, Number, Number]:  # fmt: skip
    """Gradient of |u| by the scaled strain, from u / |u|."""
    return x * u_b - y * u_n, y * u_t, -x * u_t, u_t + slope * (dx * u_n + dy * u_b)


def tendon_hessian(
    g_t: Number, g_n: Number, g_b: Number, g_s: Number, u_n: Number, u_b: Number,
    slope: Number, bend: Number, x: Number, y: Number, dx: Number, dy: Number,
) -> tuple[Number, ...]:  # fmt: skip
    """Hessian of |u| by the scaled strain times |u|, from the gradient g and u."""
    return (
        x * x + y * y - g_t * g_t,
        -g_n * g_t, y * y - g_n * g_n,
        -g_b * g_t, -x * y - g_b * g_n, x * x - g_b * g_b,
        slope * (x * dy - y * dx) - g_s * g_t, y - g_s * g_n, -x - g_s * g_b,
        1.0 + slope * slope * (dx * dx + dy * dy) + bend * (dx * u_n + dy * u_b) - g_s * g_s,
    )  # fmt: skip


def offset_direction(
    t: Number, n: Number, b: Number, width: Number, x: Number, y: Number, dx: Number, dy: Number
) -> tuple[Number, Number, Number]:
    """Derivative of u by the tendon's distance from the midline.

    Here (x, y) is the unit vector from the midline to the tendon, and (dx, dy) its slope.
    """
    return n * y - b * x, width * dx - t * y, width * dy + t * x


def unit_change(
    u_t: Number, u_n: Number, u_b: Number, over: Number, c_t: Number, c_n: Number, c_b: Number
) -> tuple[Number, Number, Number, Number]:
    """Changes of |u| and of u / |u| by a change c of u.

    From (u_t, u_n, u_b) = u / |u| and ``over`` = 1 / |u|.
    """
    along = u_t * c_t + u_n * c_n + u_b * c_b
    return (
        along,
        (c_t - u_t * along) * over,
        (c_n - u_n * along) * over,
        (c_b - u_b * along) * over,
    )


def offset_gradient(
    u_t: Number, u_n: Number, u_b: Number, c_t: Number, c_n: Number, c_b: Number, slope: Number,
    x: Number, y: Number, dx: Number, dy: Number,
    out_x: Number, out_y: Number, out_dx: Number, out_dy: Number,
) -> tuple[Number, Number, Number, Number]:  # fmt: skip
    """Derivative of `tendon_gradient` by the tendon's distance from the midline.

    (u_t, u_n, u_b) is u / |u| and (c_t, c_n, c_b) its derivative. (out_x, out_y) is the unit
    vector from the midline to the tendon, (out_dx, out_dy) its slope.
    """
    t, n, b, stretch = tendon_gradient(c_t, c_n, c_b, slope, x, y, dx, dy)
    more = tendon_gradient(u_t, u_n, u_b, slope, out_x, out_y, out_dx, out_dy)
    return t + more[0], n + more[1], b + more[2], stretch + (more[3] - u_t)


def sheath_pull(
    t: Number, n: Number, b: Number, e_t: Number, e_n: Number, e_b: Number
) -> tuple[Number, Number]:
    """Derivatives p of |u| by the offset d from the path, see `sheath`; from e = u / |u|."""
    return t * e_b - b * e_t, n * e_t - t * e_n


def sheath_inverse(
    t: Number, n: Number, b: Number, p_n: Number, p_b: Number, stiff: Number
) -> tuple[Number, Number, Number]:
    """Inverse k D^-1 (nn, nb, bb), see `sheath`, from the derivatives p of `sheath_pull`.

    ``stiff`` is the tension over k |u|.
    """
    nn = 1.0 + stiff * (b * b + t * t - p_n * p_n)
    nb = -stiff * (b * n + p_n * p_b)
    bb = 1.0 + stiff * (n * n + t * t - p_b * p_b)
    over = 1.0 / (nn * bb - nb * nb)
    return bb * over, -nb * over, nn * over


def sheath_mixed(
    t: Number, n: Number, b: Number, slope: Number, x: Number, y: Number, dx: Number, dy: Number,
    e_t: Number, e_n: Number, e_b: Number, p_n: Number, p_b: Number,
    g_t: Number, g_n: Number, g_b: Number, g_s: Number, tension: Number, weight: Number,
) -> tuple[Number, ...]:  # fmt: skip
    """C of `sheath`: second derivatives of T |u| by d, along n and b, and by t, n, b, stretch.

    From e = u / |u|, the gradients p of `sheath_pull` and g of `tendon_gradient`, and ``weight`` =
    T / |u|; (x, y) is the offset including d.
    """
    return (
        tension * e_b + weight * (t * x - p_n * g_t),
        weight * (-b * y - p_n * g_n),
        weight * (b * x - p_n * g_b) - tension * e_t,
        weight * (slope * t * dy - b - p_n * g_s),
        weight * (t * y - p_b * g_t) - tension * e_n,
        tension * e_t + weight * (n * y - p_b * g_n),
        weight * (-n * x - p_b * g_b),
        weight * (n - slope * t * dx - p_b * g_s),
    )  # fmt: skip


def condensed_terms(
    nn: Number, nb: Number, bb: Number,
    m_t: Number, m_n: Number, m_b: Number, m_s: Number,
    c_t: Number, c_n: Number, c_b: Number, c_s: Number,
) -> tuple[Number, ...]:  # fmt: skip
    """C D^-1 C^T, which condensing out d subtracts from the Hessian by the strain, see `sheath`.

    From D^-1 (nn, nb, bb) and the columns m and c of C, by d along n and along b.
    """
    o_t, o_n, o_b, o_s = (
        nn * m_t + nb * c_t, nn * m_n + nb * c_n, nn * m_b + nb * c_b, nn * m_s + nb * c_s
    )  # fmt: skip
    q_t, q_n, q_b, q_s = (
        nb * m_t + bb * c_t, nb * m_n + bb * c_n, nb * m_b + bb * c_b, nb * m_s + bb * c_s
    )  # fmt: skip
    return (
        m_t * o_t + c_t * q_t,
        m_n * o_t + c_n * q_t, m_n * o_n + c_n * q_n,
        m_b * o_t + c_b * q_t, m_b * o_n + c_b * q_n, m_b * o_b + c_b * q_b,
        m_s * o_t + c_s * q_t, m_s * o_n + c_s * q_n, m_s * o_b + c_s * q_b,
        m_s * o_s + c_s * q_s,
    )  # fmt: skip


def bending_factors(
    by_bend: Number, stretch_bend: Number, bend_bend: Number, twice: Number, fourth: Number
) -> tuple[Number, Number, Number]:
    """Factors (once, both, second) in the Hessian of the elastic energy.

    With c the two curvatures, its block by c is once 1 + second c c^T, its column by c and the
    stretch is both c, and the gradient by c is once c. From derivatives of the `Density` of the
    law, ``twice`` = 2 E A R^2 and ``fourth`` = 4 E A R^4.
    """
    return twice * by_bend, twice * stretch_bend, fourth * bend_bend


def bending_terms(
    n: Number, b: Number, by_stretch: Number, by_bend: Number, stretch_stretch: Number,
    stretch_bend: Number, bend_bend: Number, axial: Number, squared: Number,
) -> tuple[Number, ...]:  # fmt: skip
    """Gradient and Hessian of the elastic energy by n, b and stretch, without torsion.

    From the derivatives in the `Density` of the law, ``axial`` = E A and ``squared`` = R^2.

    Returns:
        Gradient by n, b and stretch, then the lower half of the Hessian, row by row.
    """
    twice = 2.0 * axial * squared
    once, both, second = bending_factors(
        by_bend, stretch_bend, bend_bend, twice, 2.0 * squared * twice
    )
    return (
        once * n, once * b, axial * by_stretch,
        second * n * n + once,
        second * n * b, second * b * b + once,
        both * n, both * b, axial * stretch_stretch,
    )  # fmt: skip


def unscaled_gradient(
    t: Number, n: Number, b: Number, width: Number, slope: Number,
    g_t: Number, g_n: Number, g_b: Number, g_s: Number,
) -> tuple[Number, Number, Number, Number]:  # fmt: skip
    """Gradient by the twist (t, n, b, stretch), from that by the scaled strain."""
    return width * g_t, width * g_n, width * g_b, g_s + slope * (t * g_t + n * g_n + b * g_b)


def unscaled_hessian(
    t: Number, n: Number, b: Number, width: Number, slope: Number, bend: Number,
    g_t: Number, g_n: Number, g_b: Number,
    tt: Number, nt: Number, nn: Number, bt: Number, bn: Number, bb: Number,
    st: Number, sn: Number, sb: Number, ss: Number,
) -> tuple[Number, ...]:  # fmt: skip
    """Hessian by the twist (t, n, b, stretch), from the derivatives by the scaled strain."""
    by_t = tt * t + nt * n + bt * b
    by_n = nt * t + nn * n + bn * b
    by_b = bt * t + bn * n + bb * b
    square = width * width
    return (
        square * tt,
        square * nt, square * nn,
        square * bt, square * bn, square * bb,
        width * (st + slope * by_t) + slope * g_t,
        width * (sn + slope * by_n) + slope * g_n,
        width * (sb + slope * by_b) + slope * g_b,
        ss + slope * (2.0 * (t * st + n * sn + b * sb) + slope * (t * by_t + n * by_n + b * by_b))
        + bend * (t * g_t + n * g_n + b * g_b),
    )  # fmt: skip


def planar_start(load: Number, force: Number, softening: Number) -> tuple[Number, Number, Number]:
    """Approximate equilibrium of a cross section that is bent in one plane.

    Exact to first order in the loads for every law, near the equilibrium of rubber for much larger
    loads, and a possible state for any.

    Args:
        load: moment over E A R [-].
        force: compressive force over E A [-].
        softening: loss of bending stiffness by sheaths, over 2 E A R^2 [-].

    Returns:
        Stretch without the moment, stretch, and curvature times R [-].
    """
    # Straight rubber is in balance where this is lambda + 3 force, nearly, and 1 / lambda^2.
    stress = 1.0 + force + force + force * force / (1.0 + force)
    straight = 1.0 / np.sqrt(stress)
    ratio = 12.0 * load / (straight * (1.0 - 24.0 * softening) + stress + stress)
    # Bending lengthens rubber.
    secant = np.sqrt(1.0 + ratio * ratio)
    stretch = straight * np.sqrt(secant)
    return straight, stretch, stretch * ratio / secant


def planar_step(
    stretch: Number, bend: Number, load: Number, force: Number, softening: Number,
    by_stretch: Number, by_bend: Number, stretch_stretch: Number, stretch_bend: Number,
    bend_bend: Number,
) -> tuple[Number, Number]:  # fmt: skip
    """Stretch and bend (curvature times R) [-] after a Newton step.

    For arguments of `planar_start`; the derivatives are those of the `Density` of the law at the
    ``stretch`` and z = ``bend``^2.
    """
    twice, secant = bend + bend, by_bend - softening
    left, moved = by_stretch + force, twice * secant - load
    cross = twice * stretch_bend
    about = secant + secant + twice * twice * bend_bend
    over = 1.0 / (stretch_stretch * about - cross * cross)
    return (
        stretch - over * (about * left - cross * moved),
        bend - over * (stretch_stretch * moved - cross * left),
    )
