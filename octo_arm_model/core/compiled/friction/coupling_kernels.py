"""Kernels for the coupling of tensions along tendons with friction and cross sections.

They are the compiled counterpart of `Coupling` and `next_angle` of `sliding.coupling`: they
compute how the twist of cross sections in equilibrium changes with the tension of each tendon
there, and improve the angles by which tendons have turned. Arrays are those of `turning_kernels`.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.numerics.references import borrows
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.formulas import (
    sheath_inverse,
    sheath_mixed,
    sheath_pull,
    tendon_direction,
    tendon_gradient,
    unscaled_gradient,
)

# Rows of the arrays ``hessian`` (`HESSIAN`, points): the lower half of the Hessian of the energy
# by the twist, row by row.
TT, NT, NN, BT, BN, BB, ST, SN, SB, SS = range(10)
HESSIAN = 10


@borrows
def eliminate(hessian: FloatArray) -> None:
    """Factorise the ``hessian`` (`HESSIAN`, points) in place as L D L^T.

    L replaces the elements below the diagonal, the inverse of D those on the diagonal.
    """
    for i in range(hessian.shape[1]):
        nt, bt, bn = hessian[NT, i], hessian[BT, i], hessian[BN, i]
        st, sn, sb = hessian[ST, i], hessian[SN, i], hessian[SB, i]
        over = 1.0 / hessian[TT, i]
        f_n, f_b, f_s = nt * over, bt * over, st * over
        hessian[TT, i], hessian[NT, i], hessian[BT, i], hessian[ST, i] = over, f_n, f_b, f_s
        over = 1.0 / (hessian[NN, i] - f_n * nt)
        bn, sn = bn - f_n * bt, sn - f_n * st
        h_b, h_s = bn * over, sn * over
        hessian[NN, i], hessian[BN, i], hessian[SN, i] = over, h_b, h_s
        over = 1.0 / (hessian[BB, i] - f_b * bt - h_b * bn)
        sb = sb - f_b * st - h_b * sn
        k_s = sb * over
        hessian[BB, i], hessian[SB, i] = over, k_s
        hessian[SS, i] = 1.0 / (hessian[SS, i] - f_s * st - h_s * sn - k_s * sb)


@borrows
def set_forces(
    pulled: IntArray, reach: IntArray, place: FloatArray, dx: FloatArray, dy: FloatArray,
    strain: FloatArray, unit: FloatArray, force: FloatArray,
) -> None:  # fmt: skip
    """Fill in the ``force`` (pulled, 4, points) on cross sections per tension of each tendon.

    It is the negative gradient by the scaled strain of |u|, the stretch of the tendon. ``place``
    (2, pulled, points) and ``unit`` (3, pulled, points) are as in `TurningState`.
    """
    for number in range(pulled.size):
        tendon = pulled[number]
        for i in range(reach[number]):
            g_t, g_n, g_b, g_s = tendon_gradient(
                -unit[0, number, i], -unit[1, number, i], -unit[2, number, i], strain[5, i],
                place[0, number, i], place[1, number, i], dx[tendon, i], dy[tendon, i],
            )  # fmt: skip
            force[number, 0, i] = g_t
            force[number, 1, i] = g_n
            force[number, 2, i] = g_b
            force[number, 3, i] = g_s


@borrows
def add_yielding(
    pulled: IntArray, reach: IntArray, place: FloatArray, dx: FloatArray, dy: FloatArray,
    along: FloatArray, compliance: FloatArray, strain: FloatArray, force: FloatArray,
) -> None:  # fmt: skip
    """Add to the ``force`` (pulled, 4, points) what follows from tendons moving in their sheaths.

    Tendons are in equilibrium in compliant sheaths under the tensions ``along`` (tendons, points).
    With the tension the offset of a tendon changes, and with that the gradient of its stretch.
    """
    for number in range(pulled.size):
        tendon = pulled[number]
        for i in range(reach[number]):
            t, n, b, slope = strain[0, i], strain[1, i], strain[2, i], strain[5, i]
            x, y = place[0, number, i], place[1, number, i]
            soft, local = compliance[tendon, i], along[tendon, i]
            u_t, u_n, u_b, length = tendon_direction(
                t, n, b, strain[3, i], strain[4, i], x, y, dx[tendon, i], dy[tendon, i]
            )
            over = 1.0 / length
            e_t, e_n, e_b, weight = u_t * over, u_n * over, u_b * over, local * over
            p_n, p_b = sheath_pull(t, n, b, e_t, e_n, e_b)
            nn, nb, bb = sheath_inverse(t, n, b, p_n, p_b, soft * weight)
            g_t, g_n, g_b, g_s = tendon_gradient(
                e_t, e_n, e_b, slope, x, y, dx[tendon, i], dy[tendon, i]
            )
            m_t, m_n, m_b, m_s, c_t, c_n, c_b, c_s = sheath_mixed(
                t, n, b, slope, x, y, dx[tendon, i], dy[tendon, i], e_t, e_n, e_b, p_n, p_b,
                g_t, g_n, g_b, g_s, local, weight,
            )  # fmt: skip
            off_n, off_b = soft * (nn * p_n + nb * p_b), soft * (nb * p_n + bb * p_b)
            force[number, 0, i] += m_t * off_n + c_t * off_b
            force[number, 1, i] += m_n * off_n + c_n * off_b
            force[number, 2, i] += m_b * off_n + c_b * off_b
            force[number, 3, i] += m_s * off_n + c_s * off_b


@borrows
def unscale(reach: IntArray, twist: FloatArray, strain: FloatArray, force: FloatArray) -> None:
    """Convert the ``force`` (pulled, 4, points), in place, from scaled strain to twist.

    It is a gradient by the scaled ``strain`` on entry, and by the ``twist`` (4, points) on return.
    """
    for number in range(force.shape[0]):
        for i in range(reach[number]):
            f_t, f_n, f_b, f_s = unscaled_gradient(
                twist[0, i], twist[1, i], twist[2, i], strain[4, i], strain[5, i],
                force[number, 0, i], force[number, 1, i], force[number, 2, i],
                force[number, 3, i],
            )  # fmt: skip
            force[number, 0, i] = f_t
            force[number, 1, i] = f_n
            force[number, 2, i] = f_b
            force[number, 3, i] = f_s


@borrows
def substitute(reach: IntArray, factors: FloatArray, right: FloatArray) -> None:
    """Solve for ``right`` (pulled, 4, points) in place, with the ``factors`` of `eliminate`."""
    for number in range(right.shape[0]):
        for i in range(reach[number]):
            t = right[number, 0, i]
            n = right[number, 1, i] - factors[NT, i] * t
            b = right[number, 2, i] - factors[BT, i] * t - factors[BN, i] * n
            s = right[number, 3, i] - factors[ST, i] * t - factors[SN, i] * n - factors[SB, i] * b
            right[number, 1, i] = n
            right[number, 2, i] = b
            right[number, 3, i] = s
        for i in range(reach[number]):
            s = right[number, 3, i] * factors[SS, i]
            b = right[number, 2, i] * factors[BB, i] - factors[SB, i] * s
            n = right[number, 1, i] * factors[NN, i] - factors[BN, i] * b - factors[SN, i] * s
            right[number, 0, i] = (
                right[number, 0, i] * factors[TT, i] - factors[NT, i] * n - factors[BT, i] * b
                - factors[ST, i] * s
            )  # fmt: skip
            right[number, 1, i] = n
            right[number, 2, i] = b
            right[number, 3, i] = s


@borrows
def follow_tensions(
    reach: IntArray, by_pull: FloatArray, change: FloatArray, twist: FloatArray
) -> None:
    """Add to the ``twist`` (4, points) its linear change with the tensions along the tendons.

    ``by_pull`` (pulled, 4, points) are the derivatives by the tensions and ``change`` (pulled,
    points) the changes of the tensions [N].
    """
    for number in range(by_pull.shape[0]):
        for k in range(4):
            for i in range(reach[number]):
                twist[k, i] += by_pull[number, k, i] * change[number, i]


@borrows
def improve(
    coefficient: FloatArray, pulled: IntArray, reach: IntArray, along: FloatArray,
    quadrature: FloatArray, slip: FloatArray, across: FloatArray, by_pull: FloatArray,
    turned: FloatArray, few: FloatArray, angle: FloatArray,
) -> float:  # fmt: skip
    """Improve ``angle`` (pulled, points), by which tendons have turned, in one Newton step.

    The compiled counterpart of `next_angle`: it solves Volterra's equation of the module
    `coupling`, but in one sweep from the base to the tip. At each point half of its own
    contribution to the integrals counts, which is accurate enough. ``turned`` are the angles in
    the equilibrium under the tensions ``along`` and, on return, the changes of ``angle``; ``few``
    (2, pulled) is scratch space; the other arrays are those of `TurningState`.

    Returns:
        The largest relative change of the tensions; NaN where any change is not finite.
    """
    several, largest, sum_of_all = pulled.size, 0.0, 0.0
    for k in range(several):
        few[1, k] = 0.0
    for i in range(angle.shape[1]):
        # The change of the curvatures with the tensions, and of these with the angles.
        t, n, b, weight = 0.0, 0.0, 0.0, quadrature[i]
        for k in range(several):
            if i < reach[k]:
                tendon = pulled[k]
                left = turned[k, i] - angle[k, i] + few[1, k]
                pull = slip[k, i] * coefficient[tendon] * along[tendon, i] * weight * left
                t += by_pull[k, 0, i] * pull
                n += by_pull[k, 1, i] * pull
                b += by_pull[k, 2, i] * pull
                few[0, k] = left
        for k in range(several):
            if i < reach[k]:
                more = across[0, k, i] * t + across[1, k, i] * n + across[2, k, i] * b
                few[1, k] += more
                old = angle[k, i]
                new = max(old + few[0, k] + 0.5 * more, 0.0)
                angle[k, i], turned[k, i] = new, new - old
                largest = max(largest, coefficient[pulled[k]] * abs(new - old))
    for k in range(several):
        sum_of_all += few[1, k]
    # The sum is not finite if the change at any point is not.
    return largest if np.isfinite(sum_of_all) else np.nan
