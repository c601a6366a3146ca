"""The model exact, cross section by cross section: what `numba_build` compiles.

As in `kernels`, formulas are those that NumPy evaluates, imported from their modules.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.compiled.section_tables import SectionTables
from octo_arm_model.core.hints import FloatArray, IntArray
from octo_arm_model.core.section.elastic_laws import (
    incompressible_widening,
    linear_density,
    neo_hookean_density,
)
from octo_arm_model.core.section.formulas import (
    bending_terms,
    planar_start,
    planar_step,
    sheath_inverse,
    sheath_mixed,
    sheath_pull,
    tendon_direction,
    tendon_gradient,
    tendon_hessian,
    unscaled_gradient,
    unscaled_hessian,
)
from octo_arm_model.core.section.newton import FIRST_STEPS, OVERSHOOT, ROUNDING, TOLERANCE
from octo_arm_model.core.section.sheath import MOST_STEPS as STANDING_STEPS
from octo_arm_model.core.section.sheath import STANDING
from octo_arm_model.core.section.strain_measures import SHORTEST_FIBRE

MOST_STEPS = 30  # of Newton's method; NumPy goes on where these are not enough


def widening(tables: SectionTables, stretch: float) -> tuple[float, float, float]:
    """Widening of a section and its derivatives."""
    if tables.widens:
        return incompressible_widening(stretch)
    return 1.0, 0.0, 0.0


def density(
    tables: SectionTables, stretch: float, bend: float
) -> tuple[float, float, float, float, float]:
    """Derivatives of the elastic law."""
    if tables.widens:
        return neo_hookean_density(stretch, bend)
    return linear_density(stretch, bend)


def stand(
    t: float, n: float, b: float, stretch: float, width: float,
    x: float, y: float, dx: float, dy: float, gives: float,
) -> tuple[float, float]:  # fmt: skip
    """Where a tendon on the path (x, y) stands, as `SheathedSections` has it; NaN if nowhere.

    ``gives`` is its tension over the stiffness of its sheath [m^2].
    """
    off_n, off_b = 0.0, 0.0
    for _ in range(STANDING_STEPS):
        u_t, u_n, u_b, length = tendon_direction(
            t, n, b, stretch, width, x + off_n, y + off_b, dx, dy
        )
        over = 1.0 / length
        p_n, p_b = sheath_pull(t, n, b, u_t * over, u_n * over, u_b * over)
        left_n, left_b = off_n + gives * p_n, off_b + gives * p_b
        if not abs(left_n) + abs(left_b) > STANDING * (abs(x) + abs(y) + abs(off_n) + abs(off_b)):
            return x + off_n, y + off_b
        k_nn, k_nb, k_bb = sheath_inverse(t, n, b, p_n, p_b, gives * over)
        off_n -= k_nn * left_n + k_nb * left_b
        off_b -= k_nb * left_n + k_bb * left_b
    return np.nan, np.nan


def is_held(
    tables: SectionTables, i: int, tensions: FloatArray, pulled: IntArray, strain: FloatArray,
    hessian: FloatArray,
) -> bool:  # fmt: skip
    """Whether tendons of section ``i`` stay in the body, at a minimum of the energy.

    As `check_tendons` and `check_stable` ask; ``hessian`` (4, 4) is that of the balance, as
    `solve_symmetric` leaves it: the diagonal is that of D.
    """
    width = widening(tables, strain[3])[0]
    for tendon in pulled:
        gives = tables.transmission[i, tendon] * tensions[tendon] * tables.give[i, tendon]
        x, y = stand(
            strain[0], strain[1], strain[2], strain[3], width, tables.x[i, tendon],
            tables.y[i, tendon], tables.dx[i, tendon], tables.dy[i, tendon], gives,
        )  # fmt: skip
        if not x * x + y * y <= tables.farthest[i, tendon] ** 2:
            return False
    for k in range(4):
        if not hessian[k, k] > 0.0:
            return False
    return True


def balance(
    tables: SectionTables, i: int, tensions: FloatArray, pulled: IntArray, strain: FloatArray,
    gradient: FloatArray, hessian: FloatArray,
) -> None:  # fmt: skip
    """Fill in ``gradient`` (4,) and the lower half of ``hessian`` (4, 4) of section ``i``.

    By the scaled ``strain`` (4,); ``pulled`` are the numbers of tendons under tension.
    """
    t, n, b, stretch = strain[0], strain[1], strain[2], strain[3]
    axial, torsion, squared = tables.axial[i], tables.torsion[i], tables.squared[i]
    f_s, f_z, f_ss, f_sz, f_zz = density(tables, stretch, (n * n + b * b) * squared)
    g_n, g_b, g_s, nn, bn, bb, sn, sb, ss = bending_terms(
        n, b, f_s, f_z, f_ss, f_sz, f_zz, axial, squared
    )
    g_t, tt, nt, bt, st = torsion * t, torsion, 0.0, 0.0, 0.0
    width, slope, bend = widening(tables, stretch)
    for tendon in pulled:
        part = tables.transmission[i, tendon]
        if part == 0.0:
            continue
        tension = part * tensions[tendon]
        x, y = tables.x[i, tendon], tables.y[i, tendon]
        dx, dy = tables.dx[i, tendon], tables.dy[i, tendon]
        give = tables.give[i, tendon] if tables.give.size else 0.0
        if give > 0.0:
            x, y = stand(t, n, b, stretch, width, x, y, dx, dy, give * tension)
        u_t, u_n, u_b, length = tendon_direction(t, n, b, stretch, width, x, y, dx, dy)
        over = 1.0 / length
        l_t, l_n, l_b, l_s = tendon_gradient(
            u_t * over, u_n * over, u_b * over, slope, x, y, dx, dy
        )
        h = tendon_hessian(l_t, l_n, l_b, l_s, u_n, u_b, slope, bend, x, y, dx, dy)
        g_t, g_n = g_t + tension * l_t, g_n + tension * l_n
        g_b, g_s = g_b + tension * l_b, g_s + tension * l_s
        weight = tension * over
        tt, nt, nn = tt + weight * h[0], nt + weight * h[1], nn + weight * h[2]
        bt, bn, bb = bt + weight * h[3], bn + weight * h[4], bb + weight * h[5]
        st, sn = st + weight * h[6], sn + weight * h[7]
        sb, ss = sb + weight * h[8], ss + weight * h[9]
        if give > 0.0:
            # What the tendon gives way to the strain, condensed as in `SheathedSections`.
            e_t, e_n, e_b = u_t * over, u_n * over, u_b * over
            p_n, p_b = sheath_pull(t, n, b, e_t, e_n, e_b)
            k_nn, k_nb, k_bb = sheath_inverse(t, n, b, p_n, p_b, give * weight)
            m_t, m_n, m_b, m_s, c_t, c_n, c_b, c_s = sheath_mixed(
                t, n, b, slope, x, y, dx, dy, e_t, e_n, e_b, p_n, p_b, l_t, l_n, l_b, l_s,
                tension, weight,
            )  # fmt: skip
            k_nn, k_nb, k_bb = give * k_nn, give * k_nb, give * k_bb
            o_t, q_t = k_nn * m_t + k_nb * c_t, k_nb * m_t + k_bb * c_t
            o_n, q_n = k_nn * m_n + k_nb * c_n, k_nb * m_n + k_bb * c_n
            o_b, q_b = k_nn * m_b + k_nb * c_b, k_nb * m_b + k_bb * c_b
            o_s, q_s = k_nn * m_s + k_nb * c_s, k_nb * m_s + k_bb * c_s
            tt, nt = tt - m_t * o_t - c_t * q_t, nt - m_n * o_t - c_n * q_t
            nn, bt = nn - m_n * o_n - c_n * q_n, bt - m_b * o_t - c_b * q_t
            bn, bb = bn - m_b * o_n - c_b * q_n, bb - m_b * o_b - c_b * q_b
            st, sn = st - m_s * o_t - c_s * q_t, sn - m_s * o_n - c_s * q_n
            sb, ss = sb - m_s * o_b - c_s * q_b, ss - m_s * o_s - c_s * q_s
    gradient[0], gradient[1], gradient[2], gradient[3] = g_t, g_n, g_b, g_s
    hessian[0, 0], hessian[1, 0], hessian[1, 1] = tt, nt, nn
    hessian[2, 0], hessian[2, 1], hessian[2, 2] = bt, bn, bb
    hessian[3, 0], hessian[3, 1], hessian[3, 2], hessian[3, 3] = st, sn, sb, ss
    if tables.planar and t == 0.0:
        # Tendons cannot twist the arm, but for rounding.
        gradient[0] = 0.0


def solve_symmetric(matrix: FloatArray, right: FloatArray) -> None:
    """Solve in place with the lower half of a definite ``matrix`` (4, 4), by L D L^T."""
    n = 4  # A constant, for the compiler to unroll the loops.
    for j in range(n):
        over = 1.0 / matrix[j, j]
        for i in range(j + 1, n):
            factor = matrix[i, j] * over
            for k in range(i, n):
                matrix[k, i] -= factor * matrix[k, j]
            right[i] -= factor * right[j]
    for j in range(n - 1, -1, -1):
        value = right[j]
        for i in range(j + 1, n):
            value -= matrix[i, j] * right[i]
        right[j] = value / matrix[j, j]


def scales(
    tables: SectionTables, i: int, tensions: FloatArray, pulled: IntArray
) -> tuple[float, float]:
    """What an imbalance of a moment and of a force is measured by, see `force_scale`."""
    force = 1e-4 * tables.axial[i]
    for tendon in pulled:
        force += tables.transmission[i, tendon] * tensions[tendon]
    return force * tables.lever_max[i], force


def guess(
    tables: SectionTables, i: int, tensions: FloatArray, pulled: IntArray, strain: FloatArray
) -> None:
    """Fill in nearly the scaled ``strain`` (4,) of section ``i``, as `initial_strain` does."""
    moment_n, moment_b, force = 0.0, 0.0, 0.0
    over = 1.0 / tables.axial[i]
    for tendon in pulled:
        tension = tables.transmission[i, tendon] * tensions[tendon] * over
        moment_n += tables.y[i, tendon] * tension
        moment_b -= tables.x[i, tendon] * tension
        force += tension
    moment = np.sqrt(moment_n * moment_n + moment_b * moment_b)
    radius = np.sqrt(tables.squared[i])
    load = moment / radius
    straight, stretch, bend = planar_start(load, force)
    for _ in range(FIRST_STEPS):
        f_s, f_z, f_ss, f_sz, f_zz = density(tables, stretch, bend * bend)
        stretch, bend = planar_step(stretch, bend, load, force, f_s, f_z, f_ss, f_sz, f_zz)
    curvature = bend / radius
    if not stretch > abs(curvature) * tables.lever_max[i]:
        stretch, curvature = straight, 0.0
    curvature /= max(moment, 1e-300)
    strain[0], strain[3] = 0.0, stretch
    strain[1], strain[2] = -curvature * moment_n, -curvature * moment_b


def minimise_section(
    tables: SectionTables, i: int, tensions: FloatArray, pulled: IntArray, strain: FloatArray,
    gradient: FloatArray, step: FloatArray, hessian: FloatArray,
) -> tuple[float, int]:  # fmt: skip
    """Move ``strain`` (4,) of section ``i`` to least energy, as `minimise` does.

    The others, (4,) and (4, 4), are room to work in; ``hessian`` ends as `solve_symmetric` leaves
    it.

    Returns:
        What is left of the balance, relative, and the number of steps; -1 without balance.
    """
    of_moment, of_force = scales(tables, i, tensions, pulled)
    slope = 0.0
    steps = 0
    for _ in range(2 * MOST_STEPS):
        balance(tables, i, tensions, pulled, strain, gradient, hessian)
        left = max(abs(gradient[0]), abs(gradient[1]), abs(gradient[2])) / of_moment
        left = max(left, abs(gradient[3]) / of_force)
        total = gradient[0] + gradient[1] + gradient[2] + gradient[3]
        if np.isfinite(total) and left <= TOLERANCE:
            # Derivatives are known: a last step leaves rounding, whatever the tolerance is.
            solve_symmetric(hessian, gradient)
            for k in range(4):
                strain[k] -= gradient[k]
            return left, steps
        if steps:
            work = 0.0
            for k in range(4):
                work += gradient[k] * step[k]
            if not (work <= OVERSHOOT * slope or left <= ROUNDING):
                for k in range(4):
                    step[k] *= 0.5
                    strain[k] -= step[k]
                slope *= 0.5
                continue
        if steps == MOST_STEPS:
            break
        step[:] = gradient
        solve_symmetric(hessian, step)
        slope = 0.0
        for k in range(4):
            step[k] = -step[k]
            strain[k] += step[k]
            slope -= gradient[k] * step[k]
        steps += 1
    return np.inf, -1


def find_minima(
    tables: SectionTables, tensions: FloatArray, twist: FloatArray
) -> tuple[float, int]:
    """Fill in ``twist`` (4, sections) of least energy.

    Returns:
        What is left of the balance, relative, and the most steps; -1 where there is none, or a
        fibre would be compressed to nothing.
    """
    pulled, gives = np.flatnonzero(tensions), tables.give.size > 0
    residual, steps = 0.0, 0
    strain, gradient, step, hessian = np.empty(4), np.empty(4), np.empty(4), np.empty((4, 4))
    for i in range(tables.axial.size):
        guess(tables, i, tensions, pulled, strain)
        left, count = minimise_section(
            tables, i, tensions, pulled, strain, gradient, step, hessian
        )
        if count < 0:
            return left, -1
        if gives and not is_held(tables, i, tensions, pulled, strain, hessian):
            return np.inf, -1
        residual, steps = max(residual, left), max(steps, count)
        if tables.widens:
            bend = np.sqrt((strain[1] * strain[1] + strain[2] * strain[2]) * tables.squared[i])
            if not strain[3] - bend > SHORTEST_FIBRE:
                return np.inf, -1
        width = widening(tables, strain[3])[0]
        for k in range(3):
            twist[k, i] = strain[k] / width
        twist[3, i] = strain[3]
    return residual, steps


def evaluate_sections(
    tables: SectionTables, tensions: FloatArray, twist: FloatArray, gradient: FloatArray,
    hessian: FloatArray, scale: FloatArray,
) -> None:  # fmt: skip
    """Fill in how all sections answer a ``twist`` (4, sections), as `evaluate` does."""
    pulled = np.flatnonzero(tensions)
    strain, g, h = np.empty(4), np.empty(4), np.empty((4, 4))
    for i in range(tables.axial.size):
        t, n, b, stretch = twist[0, i], twist[1, i], twist[2, i], twist[3, i]
        width, slope, bend = widening(tables, stretch)
        strain[0], strain[1], strain[2], strain[3] = width * t, width * n, width * b, stretch
        balance(tables, i, tensions, pulled, strain, g, h)
        by_twist = unscaled_gradient(t, n, b, width, slope, g[0], g[1], g[2], g[3])
        for k in range(4):
            gradient[k, i] = by_twist[k]
        terms = unscaled_hessian(
            t, n, b, width, slope, bend, g[0], g[1], g[2], h[0, 0], h[1, 0], h[1, 1], h[2, 0],
            h[2, 1], h[2, 2], h[3, 0], h[3, 1], h[3, 2], h[3, 3],
        )  # fmt: skip
        place = 0
        for k in range(4):
            for m in range(k + 1):
                hessian[k, m, i] = hessian[m, k, i] = terms[place]
                place += 1
        of_moment, of_force = scales(tables, i, tensions, pulled)
        scale[0, i] = scale[1, i] = scale[2, i] = of_moment
        scale[3, i] = of_force
