"""The node functions of cross sections as loops; `section_arrays` has them for NumPy.

The energy of a cross section per reference length, of scaled strain e = (w kappa, lambda, v):

    psi = psi_material(e - e_rest) + sum T |u| + sum k |d|^2 / 2
    u = (lambda, v_n, v_b) + w kappa x (r + d) + w r'

A tendon of tension T has its path at r, from which it stands off by d in a sheath of stiffness k;
d minimises the energy. w(lambda) is the widening of the section, lambda^-1/2 for rubber. The
strain at rest e_rest changes with the stretch of rubber, as `rest_bend` says. With c = u / |u|,
the gradient of |u| by e is g = c . du/de, and its Hessian is (du/de . du/de - g g^T) / |u|.
"""

from typing import TypeAlias

import numpy as np

from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.material import LINEAR
from octo_arm_model.rod.compiled import compiled, helper, inlined
from octo_arm_model.rod.section_formulas import (
    bent_by,
    density,
    offset_stiffness,
    residual_left,
    rest_bend,
    widening,
)
from octo_arm_model.rod.tables import (
    ALONG_B,
    ALONG_N,
    AXIAL,
    LEVER,
    REST_B,
    REST_N,
    REST_T,
    SHEAR,
    SLOPE_B,
    SLOPE_N,
    SQUARED_B,
    SQUARED_N,
    TORSION,
    Tables,
    Work,
)

_MOST_STEPS = 30  # for the offset of a tendon in its sheath
_CONVERGED = 1e-14  # square of the last change of an offset, over the lever
MOST_STEPS, ROUNDING, SHORTENED, OVERSHOOT = 200, 1e-6, 0.5, 0.9  # as in `section_arrays`
_density, _widening = inlined(density), inlined(widening)
_offset_stiffness, _bent_by = inlined(offset_stiffness), helper(bent_by)
_rest_bend, _residual_left = inlined(rest_bend), inlined(residual_left)
SectionTables: TypeAlias = tuple[int, FloatArray, FloatArray, FloatArray, IntArray]


def section_tables(tables: Tables) -> SectionTables:
    """Return the fields law, body, tendons, compliance and active of ``tables``."""
    return tables.law, tables.body, tables.tendons, tables.compliance, tables.active


@inlined
def cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Compute the cross product of two vectors."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inlined
def _scaled(z: FloatArray, width: float, strain: FloatArray) -> None:
    """Compute the six scaled strains of one node, (t, n, b, lambda, v_n, v_b)."""
    strain[4] = strain[5] = 0.0
    for c in range(z.size):
        strain[c] = width * z[c] if c < 3 else z[c]


@helper
def _offset(
    tendon: FloatArray, strain: FloatArray, width: float, yielding: float, lever: float
) -> tuple[float, float]:
    """Return the offset d of a tendon from its path; ``yielding`` is T / k."""
    t, n, b, stretch = strain[0], strain[1], strain[2], strain[3]
    guess = yielding if yielding * (n * n + b * b) < 0.25 * stretch else 0.0
    d_n, d_b, change = guess * b, -guess * n, np.inf
    for _ in range(_MOST_STEPS):
        u_t, u_n, u_b = _along(tendon, strain, width, d_n, d_b)
        inverse = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
        p_n, p_b = (t * u_b - b * u_t) * inverse, (n * u_t - t * u_n) * inverse
        r_n, r_b = d_n + yielding * p_n, d_b + yielding * p_b
        nn, nb, bb = _offset_stiffness((t, n, b), (p_n, p_b), yielding * inverse)
        inverse = 1.0 / (nn * bb - nb * nb)
        s_n, s_b = (bb * r_n - nb * r_b) * inverse, (nn * r_b - nb * r_n) * inverse
        d_n, d_b = d_n - s_n, d_b - s_b
        change = (abs(s_n) + abs(s_b)) / lever
        if not change * change > _CONVERGED:
            break
    if not change * change <= _CONVERGED:
        return np.nan, np.nan
    return d_n, d_b


@inlined
def _along(
    tendon: FloatArray, strain: FloatArray, width: float, d_n: float, d_b: float
) -> tuple[float, float, float]:
    """Return the vector u of a tendon that stands off its path by (d_n, d_b)."""
    x, y = tendon[ALONG_N] + d_n, tendon[ALONG_B] + d_b
    return (
        strain[3] + strain[1] * y - strain[2] * x,
        width * tendon[SLOPE_N] - strain[0] * y + strain[4],
        width * tendon[SLOPE_B] + strain[0] * x + strain[5],
    )


@inlined
def _material(
    law: int,
    body: FloatArray,
    strain: FloatArray,
    widening: tuple[float, float, float],
    g: FloatArray,
    h: FloatArray,
) -> None:
    """Compute the gradient and the lower half of the Hessian of the energy of the material."""
    axial, about_n, about_b = body[AXIAL], body[SQUARED_N], body[SQUARED_B]
    bend, by_stretch = _rest_bend(law, strain[3])
    t = strain[0] - widening[0] * body[REST_T]
    n, b = strain[1] - bend * body[REST_N], strain[2] - bend * body[REST_B]
    by_s, by_bend, by_ss, by_sb, by_bb = _density(
        law, strain[3], n * n * about_n + b * b * about_b
    )
    twice = 2.0 * axial
    x, y, once = about_n * n, about_b * b, twice * by_bend
    g[0], g[1], g[2], g[3] = body[TORSION] * t, once * x, once * y, axial * by_s
    g[4], g[5] = body[SHEAR] * strain[4], body[SHEAR] * strain[5]
    if h.shape[0]:
        both, second = twice * by_sb, 2.0 * twice * by_bb
        for a in range(6):
            for c in range(a):
                h[a, c] = 0.0
        h[0, 0], h[4, 4], h[5, 5] = body[TORSION], body[SHEAR], body[SHEAR]
        h[1, 1], h[2, 1] = once * about_n + second * x * x, second * x * y
        h[2, 2] = once * about_b + second * y * y
        h[3, 1], h[3, 2], h[3, 3] = both * x, both * y, axial * by_ss
    if law != LINEAR:
        _add_rest(body, widening, by_stretch, g, h)


@inlined
def _add_rest(
    body: FloatArray,
    widening: tuple[float, float, float],
    by_stretch: float,
    g: FloatArray,
    h: FloatArray,
) -> None:
    """Add to the rows of the stretch the terms of the bend at rest, which changes with it."""
    _, slope, second = widening
    t, n, b = slope * body[REST_T], by_stretch * body[REST_N], by_stretch * body[REST_B]
    if t == 0.0 and n == 0.0 and b == 0.0:
        return
    g[3] -= t * g[0] + n * g[1] + b * g[2]
    if h.shape[0]:
        by_n, by_b = h[1, 1] * n + h[2, 1] * b, h[2, 1] * n + h[2, 2] * b
        h[3, 3] += t * h[0, 0] * t + n * by_n + b * by_b - second * body[REST_T] * g[0]
        h[3, 3] -= 2.0 * (n * h[3, 1] + b * h[3, 2])
        h[3, 0] -= t * h[0, 0]
        h[3, 1] -= by_n
        h[3, 2] -= by_b


def sections(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Compute the gradient and the Hessian of the energy of every cross section by the twist."""
    of_sections = section_tables(tables)
    _fill_sections(of_sections, z, tensions, work.offsets, work.gradient, work.hessian)


@compiled
def _fill_sections(
    of_sections: SectionTables,
    z: FloatArray,
    tensions: FloatArray,
    offsets: FloatArray,
    gradient: FloatArray,
    hessian: FloatArray,
) -> None:
    g, h, room = np.empty(6), np.empty((6, 6)), np.zeros((6, 6))
    for i in range(z.shape[0]):
        section(of_sections, i, z[i], tensions[i], offsets[i], g, h, room)
        _store(g, h, gradient[i], hessian[i])


def add_gradients(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> float:
    """Add the gradient of every section to its residual, which `wrenches` has filled in.

    ``work.scale`` has the scales before.

    Returns:
        Largest residual over its scale and the largest wrench along the arm [-]; NaN where a
        strain is impossible.
    """
    return _add_gradients(
        section_tables(tables), z, tensions, work.offsets, work.scale, work.gradient, work.residual
    )


@compiled
def _add_gradients(
    of_sections: SectionTables,
    z: FloatArray,
    tensions: FloatArray,
    offsets: FloatArray,
    scale: FloatArray,
    gradient: FloatArray,
    residual: FloatArray,
) -> float:
    g, h, room = np.empty(6), np.empty((0, 6)), np.zeros((6, 6))
    largest, worst, count = np.zeros(6), 0.0, z.shape[1]
    for i in range(z.shape[0]):
        section(of_sections, i, z[i], tensions[i], offsets[i], g, h, room)
        for c in range(count):
            largest[c] = max(largest[c], abs(residual[i, c]))
            gradient[i, c] = g[c]
            residual[i, c] += g[c]
    for i in range(z.shape[0]):
        for c in range(count):
            value = abs(residual[i, c]) / (scale[i, c // 3] + largest[c])
            if not (value <= worst or worst != worst):  # keeps NaN
                worst = value
    return worst


@inlined
def _store(g: FloatArray, h: FloatArray, gradient: FloatArray, hessian: FloatArray) -> None:
    """Copy the gradient and the Hessian of one section to their arrays."""
    for a in range(gradient.size):
        gradient[a] = g[a]
        for c in range(a + 1):
            hessian[a, c] = hessian[c, a] = h[a, c]


@inlined
def section(
    of_sections: SectionTables,
    i: int,
    z: FloatArray,
    tensions: FloatArray,
    offsets: FloatArray,
    g: FloatArray,
    h: FloatArray,
    room: FloatArray,
) -> None:
    """Compute the gradient ``g`` and the lower half ``h`` of the Hessian at node ``i``.

    They are by the twist. If ``h`` has no rows, the Hessian is left out. ``room`` is a buffer for
    du/de and C of one tendon in a sheath, and for the scaled strain in its last row.
    """
    law, bodies, paths, compliance, active = of_sections
    body, tendons, strain = bodies[i], paths[i], room[5]
    width, slope, bend = _widening(law, z[3])
    _scaled(z, width, strain)
    _material(law, body, strain, (width, slope, bend), g, h)
    for j in range(active[i]):
        tension = tensions[j]
        if tension == 0.0:
            continue
        d_n = d_b = 0.0
        if compliance[j] > 0.0:
            d_n, d_b = _offset(tendons[j], strain, width, compliance[j] * tension, body[LEVER])
            offsets[j, 0], offsets[j, 1] = d_n, d_b
        x, y = tendons[j, ALONG_N] + d_n, tendons[j, ALONG_B] + d_b
        dx, dy = tendons[j, SLOPE_N], tendons[j, SLOPE_B]
        u_t = strain[3] + strain[1] * y - strain[2] * x
        u_n = width * dx - strain[0] * y + strain[4]
        u_b = width * dy + strain[0] * x + strain[5]
        inverse = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
        u_t, u_n, u_b = u_t * inverse, u_n * inverse, u_b * inverse
        along = bend * tension * (dx * u_n + dy * u_b)
        dx, dy = slope * dx, slope * dy
        p, y_t, x_t, q = x * u_b - y * u_n, y * u_t, x * u_t, u_t + dx * u_n + dy * u_b
        g[0] += tension * p
        g[1] += tension * y_t
        g[2] -= tension * x_t
        g[3] += tension * q
        g[4] += tension * u_n
        g[5] += tension * u_b
        if not h.shape[0]:
            continue
        # Lower half of du/de . du/de - g g^T, g = (p, y_t, -x_t, q, u_n, u_b).
        w = tension * inverse
        h[0, 0] += w * (x * x + y * y - p * p)
        h[1, 0] -= w * y_t * p
        h[1, 1] += w * (y * y - y_t * y_t)
        h[2, 0] += w * x_t * p
        h[2, 1] -= w * (x * y - x_t * y_t)
        h[2, 2] += w * (x * x - x_t * x_t)
        h[3, 0] += w * (x * dy - y * dx - q * p)
        h[3, 1] += w * (y - q * y_t)
        h[3, 2] -= w * (x - q * x_t)
        h[3, 3] += w * (1.0 + dx * dx + dy * dy - q * q) + along
        if z.size == 6:
            _add_shear(w, (x, y, dx, dy), (p, y_t, -x_t, q, u_n, u_b), h)
        if compliance[j] > 0.0:
            room[1, 0], room[2, 0], room[0, 1], room[0, 2] = -y, x, y, -x
            room[0, 3], room[1, 3], room[2, 3], room[1, 4], room[2, 5] = 1.0, dx, dy, 1.0, 1.0
            _condense(compliance[j], tension, (u_t, u_n, u_b, inverse), room, h)
    if law != LINEAR:
        _unscale(z, (width, slope, bend), g, h)


@helper
def _add_shear(
    w: float,
    path: tuple[float, float, float, float],
    g: tuple[float, float, float, float, float, float],
    h: FloatArray,
) -> None:
    """Add the rows of shear of a tendon, whose tension over |u| is ``w``, to the Hessian."""
    x, y, dx, dy = path
    for c in range(6):
        h[4, c] -= w * g[4] * g[c]
        h[5, c] -= w * g[5] * g[c]
    h[4, 0] -= w * y
    h[4, 3] += w * dx
    h[4, 4] += w
    h[5, 0] += w * x
    h[5, 3] += w * dy
    h[5, 5] += w


@helper
def _condense(
    compliance: float,
    tension: float,
    unit: tuple[float, float, float, float],
    room: FloatArray,
    h: FloatArray,
) -> None:
    """Subtract C D^-1 C^T, because an offset follows the strain; ``unit`` ends with 1 / |u|."""
    t, n, b = room[5, 0], room[5, 1], room[5, 2]
    u_t, u_n, u_b, inverse = unit
    p_n, p_b = t * u_b - b * u_t, n * u_t - t * u_n
    weight, stiff = tension * inverse, compliance * tension * inverse
    for c in range(6):
        along = room[0, c] * u_t + room[1, c] * u_n + room[2, c] * u_b
        room[3, c] = weight * (t * room[2, c] - b * room[0, c] - p_n * along)
        room[4, c] = weight * (n * room[0, c] - t * room[1, c] - p_b * along)
    room[3, 0] += tension * u_b
    room[3, 2] -= tension * u_t
    room[4, 0] -= tension * u_n
    room[4, 1] += tension * u_t
    nn, nb, bb = _offset_stiffness((t, n, b), (p_n, p_b), stiff)
    factor = compliance / (nn * bb - nb * nb)
    for a in range(6):
        of_n, of_b = bb * room[3, a] - nb * room[4, a], nn * room[4, a] - nb * room[3, a]
        for c in range(a + 1):
            h[a, c] -= factor * (of_n * room[3, c] + of_b * room[4, c])


@inlined
def _unscale(
    z: FloatArray, widening: tuple[float, float, float], g: FloatArray, h: FloatArray
) -> None:
    """Transform the gradient and the lower half of the Hessian from scaled strain to twist.

    This is for rubber, which has no shear.
    """
    width, slope, bend = widening
    t, n, b = z[0], z[1], z[2]
    along = t * g[0] + n * g[1] + b * g[2]
    if h.shape[0]:
        by_t = t * h[0, 0] + n * h[1, 0] + b * h[2, 0]
        by_n = t * h[1, 0] + n * h[1, 1] + b * h[2, 1]
        by_b = t * h[2, 0] + n * h[2, 1] + b * h[2, 2]
        mixed = t * h[3, 0] + n * h[3, 1] + b * h[3, 2]
        twice = t * by_t + n * by_n + b * by_b
        h[3, 3] += slope * (2.0 * mixed + slope * twice) + bend * along
        h[3, 0] = width * (h[3, 0] + slope * by_t) + slope * g[0]
        h[3, 1] = width * (h[3, 1] + slope * by_n) + slope * g[1]
        h[3, 2] = width * (h[3, 2] + slope * by_b) + slope * g[2]
        for a in range(3):
            for c in range(a + 1):
                h[a, c] *= width * width
    g[3] += slope * along
    for c in range(3):
        g[c] *= width


def balance(
    tables: Tables,
    z: FloatArray,
    tensions: FloatArray,
    wrench: FloatArray,
    tolerance: float,
    work: Work,
) -> tuple[float, int]:
    """Find the twists ``z`` at which every section balances ``wrench`` (N, m), by Newton's method.

    It starts from the given ``z``, or from the twists of parallel tendons where the stretch is
    zero. A step at whose end the energy rises again is halved. The last step is one after which
    `residual_left` is at most ``tolerance``.

    Returns:
        The largest of these residuals, and the largest number of steps.
    """
    out = work.offsets, work.gradient, work.hessian, work.residual
    return _balance(
        section_tables(tables), tables.least_scale, z, tensions, wrench, tolerance, out
    )


@compiled
def _balance(
    of_sections: SectionTables,
    least_scale: FloatArray,
    z: FloatArray,
    tensions: FloatArray,
    wrench: FloatArray,
    tolerance: float,
    out: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> tuple[float, int]:
    law, bodies, paths, _, active = of_sections
    all_offsets, gradients, hessians, residuals = out
    g, h, room = np.empty(6), np.empty((6, 6)), np.zeros((6, 6))
    largest, worst, most = np.zeros(6), 0.0, 0
    step, scale, count = np.zeros(6), np.zeros(6), z.shape[1]
    for i in range(z.shape[0]):
        for c in range(count):
            largest[c] = max(largest[c], abs(wrench[i, c]))
    for i in range(z.shape[0]):
        twist, tension, residual = z[i], tensions[i], residuals[i]
        if twist[3] == 0.0:
            _guess(law, bodies[i], paths[i], active[i], tension, twist)
        force = least_scale[i]
        for j in range(active[i]):
            force += tension[j]
        for c in range(count):
            scale[c] = largest[c] + force * (bodies[i, LEVER] if c < 3 else 1.0)
        slope, size, expected, steps = 0.0, 0.0, np.inf, 0
        while steps < MOST_STEPS and not expected <= tolerance:
            steps += 1
            last = size
            section(of_sections, i, twist, tension, all_offsets[i], g, h, room)
            along, size = 0.0, 0.0
            for c in range(count):
                residual[c] = g[c] - wrench[i, c]
                along += residual[c] * step[c]
                value = abs(residual[c]) / scale[c]
                if not (value <= size or size != size):  # keeps NaN
                    size = value
            expected = _residual_left(size, last)
            if steps > 1 and not (size <= ROUNDING or along <= OVERSHOOT * slope):
                slope *= SHORTENED
                size = 0.0  # A shortened step tells nothing of the convergence.
                for c in range(count):
                    step[c] *= SHORTENED
                    twist[c] -= step[c]
                continue
            _store(g, h, gradients[i], hessians[i])
            _solve_ldl(h, residual, step)
            slope = 0.0
            for c in range(count):
                twist[c] += step[c]
                slope -= residual[c] * step[c]
        if not (expected <= worst or worst != worst):
            worst = expected
        most = max(most, steps)
    return worst, most


@helper
def _guess(
    law: int,
    body: FloatArray,
    tendons: FloatArray,
    active: int,
    tensions: FloatArray,
    z: FloatArray,
) -> None:
    """Compute the twist of a node as `section_arrays.initial_twists` does."""
    axial, radius_n, radius_b = body[AXIAL], np.sqrt(body[SQUARED_N]), np.sqrt(body[SQUARED_B])
    force = about_n = about_b = 0.0
    for j in range(active):
        pull = tensions[j] / axial
        force += pull
        about_n += pull * tendons[j, ALONG_B]
        about_b -= pull * tendons[j, ALONG_N]
    about_n, about_b = about_n / radius_n, about_b / radius_b
    moment = np.sqrt(about_n * about_n + about_b * about_b)
    straight, stretch, curvature = _bent_by(law, force, moment)
    curvature /= -max(moment, 1e-300)
    n, b = about_n * curvature / radius_n, about_b * curvature / radius_b
    if not stretch > np.sqrt(n * n + b * b) * body[LEVER]:
        stretch, n, b = straight, 0.0, 0.0
    width, _, _ = _widening(law, stretch)
    bend, _ = _rest_bend(law, stretch)
    z[0] = body[REST_T]
    z[1], z[2] = (n + bend * body[REST_N]) / width, (b + bend * body[REST_B]) / width
    z[3] = stretch


@inlined
def _solve_ldl(h: FloatArray, residual: FloatArray, x: FloatArray) -> None:
    """Solve H x = -residual by L D L^T for ``x``; ``h`` is the lower half of H, overwritten."""
    count = residual.size
    for a in range(count):
        x[a] = -residual[a]
        for c in range(a):
            for k in range(c):
                h[a, c] -= h[a, k] * h[c, k] * h[k, k]
            h[a, c] /= h[c, c]
        for k in range(a):
            h[a, a] -= h[a, k] * h[a, k] * h[k, k]
            x[a] -= h[a, k] * x[k]
    for a in range(count - 1, -1, -1):
        x[a] /= h[a, a]
        for k in range(a + 1, count):
            x[a] -= h[k, a] * x[k]


@helper
def tangent(
    of_sections: SectionTables,
    i: int,
    j: int,
    z: FloatArray,
    tension: float,
    strain: FloatArray,
    offset: FloatArray,
    unit: FloatArray,
) -> None:
    """Compute the unit tangent of tendon ``j`` at node ``i`` and its offset in its sheath."""
    law, body, tendons, compliance, _ = of_sections
    tendon, width = tendons[i, j], _widening(law, z[3])[0]
    _scaled(z, width, strain)
    d_n = d_b = 0.0
    if compliance[j] > 0.0:
        d_n, d_b = _offset(tendon, strain, width, compliance[j] * tension, body[i, LEVER])
        offset[0], offset[1] = d_n, d_b
    u_t, u_n, u_b = _along(tendon, strain, width, d_n, d_b)
    inverse = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
    unit[0], unit[1], unit[2] = inverse * u_t, inverse * u_n, inverse * u_b
