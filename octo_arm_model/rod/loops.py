"""The node functions as loops, compiled by numba; `arrays` has the same for NumPy.

The energy of a cross section per reference length, of scaled strain e = (w kappa, lambda, v):

    psi = psi_material(e) + sum T |u| + sum k |d|^2 / 2
    u = (lambda, v_n, v_b) + w kappa x (r + d) + w r'

for a tendon of tension T at the offset r that stands off its path by d in a sheath of stiffness k;
w(lambda) is the widening of the section, lambda^-1/2 for rubber. d is the one of least energy.
With c = u / |u|, the gradient of |u| by e is g = c . du/de, and its Hessian
(du/de . du/de - g g^T) / |u|.

All take `Tables` and `Work`; z is (N, m), ``tensions`` (N, J) [N], ``force`` and ``couple`` the
force and the free moment of all that acts beyond each node, (N, 3) in base_frame.

What is compiled by itself takes the arrays that it needs, as a call would copy the hundreds of
numbers of tables, and what is inlined may as well: some have more than seven arguments for that.
"""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.compiled import compiled, helper, inlined
from octo_arm_model.rod.paper_loops import paper_twists
from octo_arm_model.rod.resolution import OF_BENDS, OF_DIRECTIONS
from octo_arm_model.rod.tables import (
    ALONG_B,
    ALONG_N,
    AXIAL,
    LEVER,
    SHEAR,
    SLOPE_B,
    SLOPE_N,
    SQUARED_RADIUS,
    TORSION,
    Places,
    Tables,
    Work,
)

# The node functions, see `forms.Form`.
__all__ = [
    'angles', 'balance', 'jacobian', 'orientations', 'paper_twists', 'poses', 'residual',
    'sections',
]  # fmt: skip

_MOST_SWEEPS = 80  # of orientations
_ROUNDING = 2e-13  # change by a sweep, which leaves a thirtieth of it
_MOST_STEPS = 30  # of the offset of a tendon in its sheath
_ROUGH = 0.5  # cosine between bends of a tendon at the ends of an element, see `angles`
_SETTLED = 1e-14  # change of an offset, over the lever
MOST_STEPS, ROUNDING, SHORTENED, OVERSHOOT = 200, 1e-6, 0.5, 0.9  # see `arrays.balance`


# Orientations ----------------------------------------------------------------------------------


@compiled
def orientations(tables: Tables, z: FloatArray, work: Work) -> None:
    """Orientation and r' of every node: q' = q (0, kappa) / 2 collocated in each element.

    Of several arms where there are several times as many nodes.
    """
    lengths, to_point, weights, base = tables.lengths, tables.to_point, tables.weights, tables.base
    elements, points = lengths.size, to_point.shape[0]
    rate, first = np.empty((points, 4)), np.empty(4)
    for number in range(z.shape[0] // points):
        start, e = number * points, number % elements
        if e == 0:
            for c in range(4):
                first[c] = base[c]
        quaternion = work.quaternion[start : start + points]
        _collocate(first, z[start : start + points], 0.5 * lengths[e], to_point, rate, quaternion)
        for k in range(points):
            for c in range(4):
                first[c] += weights[k] / lengths[0] * rate[k, c]
        _normalise(first)
    _orient(z, work.quaternion, work.rotation, work.slope)


@helper
def _collocate(
    first: FloatArray, z: FloatArray, half: float, to_point: FloatArray, rate: FloatArray,
    now: FloatArray,
) -> None:  # fmt: skip
    """Fill in the quaternions ``now`` (p, 4) of an element and their ``rate`` in it.

    Swept from the start to the end until they stay: at every point with the rates of those before
    it from the same sweep, those after it from the last, and its own solved for.
    """
    points = z.shape[0]
    rate[:] = 0.0
    now[:] = 0.0
    for _ in range(_MOST_SWEEPS):
        change = 0.0
        for i in range(points):
            w, x, y, b = first[0], first[1], first[2], first[3]
            # That before it last, so that the others need not wait for it.
            for k in range(i + 1, points):
                part = to_point[i, k]
                w += part * rate[k, 0]
                x += part * rate[k, 1]
                y += part * rate[k, 2]
                b += part * rate[k, 3]
            for k in range(i):
                part = to_point[i, k]
                w += part * rate[k, 0]
                x += part * rate[k, 1]
                y += part * rate[k, 2]
                b += part * rate[k, 3]
            p, q, r, own = half * z[i, 0], half * z[i, 1], half * z[i, 2], to_point[i, i]
            square = p * p + q * q + r * r
            over = 1.0 / (1.0 + own * own * square)
            turn_w, turn_x = -(x * p + y * q + b * r), w * p + y * r - b * q
            turn_y, turn_b = w * q + b * p - x * r, w * r + x * q - y * p
            back = own * square
            rate[i, 0], rate[i, 1] = (turn_w - back * w) * over, (turn_x - back * x) * over
            rate[i, 2], rate[i, 3] = (turn_y - back * y) * over, (turn_b - back * b) * over
            w, x = (w + own * turn_w) * over, (x + own * turn_x) * over
            y, b = (y + own * turn_y) * over, (b + own * turn_b) * over
            moved = abs(w - now[i, 0]) + abs(x - now[i, 1]) + abs(y - now[i, 2])
            change = max(change, moved + abs(b - now[i, 3]))
            now[i, 0], now[i, 1], now[i, 2], now[i, 3] = w, x, y, b
        if not change > _ROUNDING:
            break


@inlined
def _normalise(q: FloatArray) -> None:
    over = 1.0 / np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for c in range(4):
        q[c] *= over


@helper
def _orient(
    z: FloatArray, quaternion: FloatArray, rotation: FloatArray, slope: FloatArray
) -> None:
    """Fill in rotation matrices and r' of nodes, and divide quaternions by their length."""
    for i in range(z.shape[0]):
        q, r = quaternion[i], rotation[i]
        _normalise(q)
        w, x, y, b = q[0], q[1], q[2], q[3]
        r[0, 0] = w * w + x * x - y * y - b * b
        r[1, 1] = w * w - x * x + y * y - b * b
        r[2, 2] = w * w - x * x - y * y + b * b
        r[0, 1], r[1, 0] = 2 * (x * y - w * b), 2 * (x * y + w * b)
        r[0, 2], r[2, 0] = 2 * (x * b + w * y), 2 * (x * b - w * y)
        r[1, 2], r[2, 1] = 2 * (y * b - w * x), 2 * (y * b + w * x)
        for c in range(3):
            slope[i, c] = r[c, 0] * z[i, 3]
            if z.shape[1] == 6:
                slope[i, c] += r[c, 1] * z[i, 4] + r[c, 2] * z[i, 5]


# Poses -----------------------------------------------------------------------------------------


@compiled
def poses(
    tables: Tables, z: FloatArray, places: Places, work: Work
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where places are, by integrals of r' and q' from the base, and how well this is resolved.

    After `orientations` of the same z.

    Returns:
        Positions from the base (A, S, 3) [m], orientations x, y, z, w (A, S, 4) and the estimated
        error of positions over the length of the arm (A,), see `resolution`, of A arms.
    """
    lengths, weights, integration = tables.lengths, tables.weights, places.integration
    nodes, elements, stations = integration.shape[1], lengths.size, integration.shape[0]
    points, arms = nodes // elements, z.shape[0] // nodes
    position, quaternion = np.empty((arms, stations, 3)), np.empty((arms, stations, 4))
    # Of x, y, z, position and quaternion: rates, at the starts of elements, and at a place.
    rate, reached, now = np.empty((nodes, 7)), np.zeros((elements + 1, 7)), np.empty(7)
    error = np.empty(arms)
    for c in range(4):
        reached[0, 3 + c] = tables.base[c]
    for arm in range(arms):
        first = arm * nodes
        slope, own = work.slope[first : first + nodes], z[first : first + nodes]
        _rates(slope, work.quaternion[first : first + nodes], own, rate)
        for e in range(elements):
            _advance(reached[e], weights, rate, e * points, points, reached[e + 1])
        for at in range(stations):
            e = places.element[at]
            _advance(reached[e], integration[at], rate, e * points, points, now)
            _normalise(now[3:])
            for c in range(3):
                position[arm, at, c], quaternion[arm, at, c] = now[c], now[4 + c]
            quaternion[arm, at, 3] = now[3]
        error[arm] = _position_error(lengths, places.tail, own, slope)
    return position, quaternion, error


@helper
def _rates(slope: FloatArray, quaternion: FloatArray, z: FloatArray, rate: FloatArray) -> None:
    """Fill in r' and q' of nodes, (N, 7)."""
    for i in range(z.shape[0]):
        q, to = quaternion[i], rate[i]
        w, x, y, b = 0.5 * q[0], 0.5 * q[1], 0.5 * q[2], 0.5 * q[3]
        p, q, r = z[i, 0], z[i, 1], z[i, 2]
        for c in range(3):
            to[c] = slope[i, c]
        to[3], to[4] = -(x * p + y * q + b * r), w * p + y * r - b * q
        to[5], to[6] = w * q + b * p - x * r, w * r + x * q - y * p


@inlined
def _advance(
    start: FloatArray, weights: FloatArray, rate: FloatArray, first: int, count: int,
    out: FloatArray,
) -> None:  # fmt: skip
    """Fill in ``start`` and the integral over so many nodes from the ``first`` on."""
    for c in range(7):
        out[c] = start[c]
    for i in range(first, first + count):
        for c in range(7):
            out[c] += weights[i] * rate[i, c]


@helper
def _position_error(
    lengths: FloatArray, tail: FloatArray, z: FloatArray, slope: FloatArray
) -> float:
    """See `resolution.position_errors`, of one arm."""
    points, error, whole = tail.shape[1], 0.0, 0.0
    for length in lengths:
        whole += length
    for e in range(lengths.size):
        bend = direction = 0.0
        for row in range(2):
            for c in range(3):
                of_bend = of_direction = 0.0
                for k in range(points):
                    of_bend += tail[row, k] * z[e * points + k, c]
                    of_direction += tail[row, k] * slope[e * points + k, c]
                # As `max` does not, these keep what is no number.
                if not of_bend * of_bend <= bend:
                    bend = of_bend * of_bend
                if not of_direction * of_direction <= direction:
                    direction = of_direction * of_direction
        error += OF_BENDS * lengths[e] ** 2 * bend
        error += OF_DIRECTIONS * lengths[e] / whole * direction
    return error


# Cross sections --------------------------------------------------------------------------------


@inlined
def _density(
    widens: bool, stretch: float, bend: float
) -> tuple[float, float, float, float, float]:
    """Derivatives of psi_material / (E A) by lambda and (c R)^2, c the curvature.

    By lambda, by bend, by both twice: ss, sb, bb. NaN where a fibre has no length.
    """
    if not widens:
        return stretch - 1.0, 0.125, 1.0, 0.0, 0.0
    # Rubber: the mean of 1 / l over the circle of fibres of stretch l is 2 / (lambda + root).
    root = np.sqrt(stretch * abs(stretch) - bend)
    over, over_root = 1.0 / (stretch + root), 1.0 / root
    third = over_root * over / 3.0
    varying, square = third * over, over_root * over_root
    mixed = square * varying
    return (
        stretch / 3.0 - 2.0 * third,
        varying + 1.0 / 24.0,
        square * over_root * (2.0 / 3.0) + 1.0 / 3.0,
        -(stretch + 2.0 * root) * mixed,
        (root * over + 0.5) * mixed,
    )


@inlined
def _widening(widens: bool, stretch: float) -> tuple[float, float, float]:
    """Radius over reference radius, and its two derivatives by the stretch."""
    if not widens:
        return 1.0, 0.0, 0.0
    over = 1.0 / stretch
    width = np.sqrt(over)
    slope = -0.5 * width * over
    return width, slope, -1.5 * slope * over


@inlined
def _scaled(z: FloatArray, width: float, strain: FloatArray) -> None:
    """The six scaled strains of one node, (t, n, b, lambda, v_n, v_b)."""
    strain[4] = strain[5] = 0.0
    for c in range(z.size):
        strain[c] = width * z[c] if c < 3 else z[c]


@helper
def _offset(
    tendon: FloatArray, strain: FloatArray, width: float, yielding: float, lever: float
) -> tuple[float, float]:
    """Offset d of a tendon from its path; ``yielding`` is T / k, see `loops` for the equations."""
    t, n, b, stretch = strain[0], strain[1], strain[2], strain[3]
    near = yielding if yielding * (n * n + b * b) < 0.25 * stretch else 0.0
    d_n, d_b, left = near * b, -near * n, np.inf
    for _ in range(_MOST_STEPS):
        u_t, u_n, u_b = _along(tendon, strain, width, d_n, d_b)
        over = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
        p_n, p_b = (t * u_b - b * u_t) * over, (n * u_t - t * u_n) * over
        r_n, r_b = d_n + yielding * p_n, d_b + yielding * p_b
        nn, nb, bb = _offset_stiffness(yielding * over, (t, n, b), p_n, p_b)
        over = 1.0 / (nn * bb - nb * nb)
        s_n, s_b = (bb * r_n - nb * r_b) * over, (nn * r_b - nb * r_n) * over
        d_n, d_b = d_n - s_n, d_b - s_b
        left = (abs(s_n) + abs(s_b)) / lever
        if not left * left > _SETTLED:
            break
    if not left * left <= _SETTLED:
        return np.nan, np.nan
    return d_n, d_b


@inlined
def _along(
    tendon: FloatArray, strain: FloatArray, width: float, d_n: float, d_b: float
) -> tuple[float, float, float]:
    """U of a tendon that stands off its path by (d_n, d_b)."""
    x, y = tendon[ALONG_N] + d_n, tendon[ALONG_B] + d_b
    return (
        strain[3] + strain[1] * y - strain[2] * x,
        width * tendon[SLOPE_N] - strain[0] * y + strain[4],
        width * tendon[SLOPE_B] + strain[0] * x + strain[5],
    )


@inlined
def _material(
    widens: bool, body: FloatArray, strain: FloatArray, g: FloatArray, h: FloatArray
) -> None:
    """Gradient and lower half of the Hessian of the energy of the material by the strain."""
    n, b, axial, square = strain[1], strain[2], body[AXIAL], body[SQUARED_RADIUS]
    by_s, by_bend, by_ss, by_sb, by_bb = _density(widens, strain[3], (n * n + b * b) * square)
    twice = 2.0 * axial * square
    once = twice * by_bend
    g[0], g[1], g[2], g[3] = body[TORSION] * strain[0], once * n, once * b, axial * by_s
    g[4], g[5] = body[SHEAR] * strain[4], body[SHEAR] * strain[5]
    if h.shape[0]:
        both, second = twice * by_sb, 2.0 * square * twice * by_bb
        for a in range(6):
            for c in range(a):
                h[a, c] = 0.0
        h[0, 0], h[4, 4], h[5, 5] = body[TORSION], body[SHEAR], body[SHEAR]
        h[1, 1], h[2, 1], h[2, 2] = once + second * n * n, second * n * b, once + second * b * b
        h[3, 1], h[3, 2], h[3, 3] = both * n, both * b, axial * by_ss


@compiled
def sections(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Gradient and Hessian of the energy of every cross section by the twist."""
    body, tendons, compliance = tables.body, tables.tendons, tables.compliance
    active, offsets = tables.active, work.offsets
    g, h, room = np.empty(6), np.empty((6, 6)), np.zeros((6, 6))
    for i in range(z.shape[0]):
        _section(
            tables.widens, body[i], tendons[i], compliance, active[i],
            z[i], tensions[i], offsets[i], g, h, room,
        )  # fmt: skip
        _keep(g, h, work.gradient[i], work.hessian[i])


@inlined
def _keep(g: FloatArray, h: FloatArray, gradient: FloatArray, hessian: FloatArray) -> None:
    """Fill in what `_section` found."""
    for a in range(gradient.size):
        gradient[a] = g[a]
        for c in range(a + 1):
            hessian[a, c] = hessian[c, a] = h[a, c]


@inlined
def _section(
    widens: bool, body: FloatArray, tendons: FloatArray, compliance: FloatArray, active: int,
    z: FloatArray, tensions: FloatArray, offsets: FloatArray, g: FloatArray, h: FloatArray,
    room: FloatArray,
) -> None:  # fmt: skip
    """Gradient by the twist and lower half of the Hessian at one node into ``g`` and ``h``.

    Without rows in ``h`` there is no Hessian. ``room`` has rows of one tendon in a sheath, du/de
    and C, and the scaled strain, as the last.
    """
    strain = room[5]
    width, slope, bend = _widening(widens, z[3])
    _scaled(z, width, strain)
    _material(widens, body, strain, g, h)
    for j in range(active):
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
        over = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
        u_t, u_n, u_b = u_t * over, u_n * over, u_b * over
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
        w = tension * over
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
            _condense(compliance[j], tension, (u_t, u_n, u_b, over), room, h)
    if widens:
        _unscale(z, (width, slope, bend), g, h)


@helper
def _add_shear(
    w: float, path: tuple[float, float, float, float],
    g: tuple[float, float, float, float, float, float], h: FloatArray,
) -> None:  # fmt: skip
    """The rows of shear of a tendon of tension over |u| ``w``, see `sections`."""
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
    compliance: float, tension: float, unit: tuple[float, float, float, float],
    room: FloatArray, h: FloatArray,
) -> None:  # fmt: skip
    """Subtract C D^-1 C^T, as an offset follows the strain; ``unit`` ends with 1 / |u|."""
    t, n, b = room[5, 0], room[5, 1], room[5, 2]
    u_t, u_n, u_b, over = unit
    p_n, p_b = t * u_b - b * u_t, n * u_t - t * u_n
    weight, stiff = tension * over, compliance * tension * over
    for c in range(6):
        along = room[0, c] * u_t + room[1, c] * u_n + room[2, c] * u_b
        room[3, c] = weight * (t * room[2, c] - b * room[0, c] - p_n * along)
        room[4, c] = weight * (n * room[0, c] - t * room[1, c] - p_b * along)
    room[3, 0] += tension * u_b
    room[3, 2] -= tension * u_t
    room[4, 0] -= tension * u_n
    room[4, 1] += tension * u_t
    nn, nb, bb = _offset_stiffness(stiff, (t, n, b), p_n, p_b)
    factor = compliance / (nn * bb - nb * nb)
    for a in range(6):
        of_n, of_b = bb * room[3, a] - nb * room[4, a], nn * room[4, a] - nb * room[3, a]
        for c in range(a + 1):
            h[a, c] -= factor * (of_n * room[3, c] + of_b * room[4, c])


@inlined
def _offset_stiffness(
    stiff: float, bend: tuple[float, float, float], p_n: float, p_b: float
) -> tuple[float, float, float]:
    """Second derivatives of the energy by d over k, nn, nb and bb."""
    t, n, b = bend
    nn = 1.0 + stiff * (b * b + t * t - p_n * p_n)
    bb = 1.0 + stiff * (n * n + t * t - p_b * p_b)
    return nn, -stiff * (b * n + p_n * p_b), bb


@inlined
def _unscale(
    z: FloatArray, widening: tuple[float, float, float], g: FloatArray, h: FloatArray
) -> None:
    """From gradient and lower half of the Hessian by the scaled strain to those by the twist.

    Of rubber, which has no shear.
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


@compiled
def balance(
    tables: Tables, z: FloatArray, tensions: FloatArray, wrench: FloatArray, tolerance: float,
    work: Work,
) -> tuple[float, int]:  # fmt: skip
    """Bring every cross section to balance with ``wrench`` (N, m) by Newton's method.

    From the twists ``z``, which are overwritten, or from those of parallel tendons where the
    stretch is zero. Steps at whose end the energy has risen again are halved. The last step begins
    where a residual is at most ``tolerance``.

    Returns:
        The largest residual before the last step, and the largest number of steps.
    """
    g, h, room = np.empty(6), np.empty((6, 6)), np.zeros((6, 6))
    largest, worst, most = np.zeros(6), 0.0, 0
    compliance = tables.compliance
    step, scale, count = np.zeros(6), np.zeros(6), z.shape[1]
    for i in range(z.shape[0]):
        for c in range(count):
            largest[c] = max(largest[c], abs(wrench[i, c]))
    for i in range(z.shape[0]):
        body, tendons, active = tables.body[i], tables.tendons[i], tables.active[i]
        own, pulls, offsets = z[i], tensions[i], work.offsets[i]
        gradient, hessian, left = work.gradient[i], work.hessian[i], work.residual[i]
        if own[3] == 0.0:
            _guess(tables.widens, body, tendons, active, pulls, own)
        force = tables.least_scale[i]
        for j in range(active):
            force += pulls[j]
        for c in range(count):
            scale[c] = largest[c] + force * (body[LEVER] if c < 3 else 1.0)
        slope, size, steps = 0.0, np.inf, 0
        while steps < MOST_STEPS and not size <= tolerance:
            steps += 1
            _section(
                tables.widens, body, tendons, compliance, active, own, pulls, offsets, g, h, room,
            )  # fmt: skip
            along, size = 0.0, 0.0
            for c in range(count):
                left[c] = g[c] - wrench[i, c]
                along += left[c] * step[c]
                value = abs(left[c]) / scale[c]
                if not value <= size:  # also NaN, which stays
                    size = value
            if steps > 1 and not (size <= ROUNDING or along <= OVERSHOOT * slope):
                slope *= SHORTENED
                for c in range(count):
                    step[c] *= SHORTENED
                    own[c] -= step[c]
                continue
            _keep(g, h, gradient, hessian)
            _solve_ldl(h, left, step)
            slope = 0.0
            for c in range(count):
                own[c] += step[c]
                slope -= left[c] * step[c]
        if not size <= worst:
            worst = size
        most = max(most, steps)
    return worst, most


@helper
def _guess(
    widens: bool, body: FloatArray, tendons: FloatArray, active: int, tensions: FloatArray,
    z: FloatArray,
) -> None:  # fmt: skip
    """Twist of a node as if tendons were parallel, see `arrays.initial_twists`."""
    axial, radius = body[AXIAL], np.sqrt(body[SQUARED_RADIUS])
    force = about_n = about_b = 0.0
    for j in range(active):
        pull = tensions[j] / axial
        force += pull
        about_n += pull * tendons[j, ALONG_B]
        about_b -= pull * tendons[j, ALONG_N]
    moment = np.sqrt(about_n * about_n + about_b * about_b)
    if widens:
        stress = 1.0 + force + force + force * force / (1.0 + force)
        straight = 1.0 / np.sqrt(stress)
        ratio = 12.0 * moment / radius / (straight + 2.0 * stress)
        secant = np.sqrt(1.0 + ratio * ratio)
        stretch = straight * np.sqrt(secant)
        curvature = stretch * ratio / secant / radius
    else:
        straight = stretch = max(1.0 - force, 0.05)
        curvature = 4.0 * moment / radius / radius
    if not stretch > curvature * body[LEVER]:
        stretch, curvature = straight, 0.0
    curvature /= -max(moment, 1e-300)
    if widens:
        curvature *= np.sqrt(stretch)
    z[1], z[2], z[3] = about_n * curvature, about_b * curvature, stretch


@inlined
def _solve_ldl(h: FloatArray, left: FloatArray, x: FloatArray) -> None:
    """Fill in ``x``, which a symmetric matrix of lower half ``h`` takes to minus ``left``."""
    count = left.size
    for a in range(count):
        x[a] = -left[a]
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


# Tendons with friction -------------------------------------------------------------------------


@compiled
def angles(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Angle by which every tendon under tension has turned between the base and every node.

    The integral of the length of e' + kappa x e, e the unit tangent in the axes of the section,
    and the angles between tangents where strains jump; its length has a kink where it vanishes,
    and is taken at fine points where it may. ``tensions`` displace tendons in sheaths.
    """
    lengths, to_point, friction = tables.lengths, tables.to_point, tables.friction
    points, angle, strain = to_point.shape[0], work.angle, np.empty(6)
    unit, bend, rate = np.empty((points, 3)), np.empty((points, 3)), np.empty(points)
    last, total = np.zeros((friction.size, 3)), np.zeros(friction.size)
    angle[:] = 0.0
    for e in range(lengths.size):
        start, h = e * points, lengths[e]
        for j in range(tables.active[start]):
            if tensions[start, j] == 0.0 or friction[j] == 0.0:
                continue
            for k in range(points):
                i = start + k
                _tangent(
                    tables.widens, z[i], tables.tendons[i, j], tables.body[i, LEVER],
                    tables.compliance[j] * tensions[i, j], strain, work.offsets[i, j], unit[k],
                )  # fmt: skip
            kink = _kink(tables.ends, unit, last[j])
            if tables.sharp[e]:
                total[j] += kink
            _bends(tables.differentiation, h, z[start : start + points], unit, bend, rate)
            along, end = 0.0, points - 1
            for c in range(3):
                along += bend[0, c] * bend[end, c]
            own = angle[start : start + points, j]
            if along < _ROUGH * rate[0] * rate[end]:
                total[j] = _turn_finely(
                    tables.to_fine, tables.fine_weights, h, bend, total[j], own
                )
                continue
            for i in range(points):
                value = 0.0
                for k in range(points):
                    value += to_point[i, k] * rate[k]
                own[i] = total[j] + h * value
            for k in range(points):
                total[j] += tables.weights[start + k] * rate[k]


@helper
def _tangent(
    widens: bool, z: FloatArray, tendon: FloatArray, lever: float, yielding: float,
    strain: FloatArray, offset: FloatArray, unit: FloatArray,
) -> None:  # fmt: skip
    """Unit tangent of a tendon and its offset in its sheath, see `_offset`."""
    width, _, _ = _widening(widens, z[3])
    _scaled(z, width, strain)
    d_n = d_b = 0.0
    if yielding > 0.0:
        d_n, d_b = _offset(tendon, strain, width, yielding, lever)
        offset[0], offset[1] = d_n, d_b
    u_t, u_n, u_b = _along(tendon, strain, width, d_n, d_b)
    over = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
    unit[0], unit[1], unit[2] = over * u_t, over * u_n, over * u_b


@helper
def _kink(ends: FloatArray, unit: FloatArray, last: FloatArray) -> float:
    """Angle between the tangents at the start of an element and the ``last``, before it."""
    square = 0.0
    for c in range(3):
        first = end = 0.0
        for k in range(unit.shape[0]):
            first += ends[0, k] * unit[k, c]
            end += ends[1, k] * unit[k, c]
        square += (first - last[c]) ** 2
        last[c] = end
    return 2.0 * np.arcsin(min(0.5 * np.sqrt(square), 1.0))


@helper
def _bends(
    differentiation: FloatArray, h: float, z: FloatArray, unit: FloatArray, bend: FloatArray,
    rate: FloatArray,
) -> None:  # fmt: skip
    """Derivatives of the tangents ``unit`` (p, 3) by s, and their lengths."""
    for k in range(z.shape[0]):
        p = q = r = 0.0
        for n in range(z.shape[0]):
            slope = differentiation[k, n] / h
            p += slope * unit[n, 0]
            q += slope * unit[n, 1]
            r += slope * unit[n, 2]
        _cross(z[k], unit[k], bend[k])
        p, q, r = bend[k, 0] + p, bend[k, 1] + q, bend[k, 2] + r
        bend[k, 0], bend[k, 1], bend[k, 2] = p, q, r
        rate[k] = np.sqrt(p * p + q * q + r * r)


@helper
def _turn_finely(
    to_fine: FloatArray, weights: FloatArray, h: float, bend: FloatArray, total: float,
    angle: FloatArray,
) -> float:  # fmt: skip
    """Angles (p,) of a tendon at the points of an element with its ``bend``, by fine points.

    From ``total`` at its start; returns that at its end.
    """
    points = bend.shape[0]
    for i in range(points):
        angle[i] = total
    for f in range(to_fine.shape[0]):
        p = q = r = 0.0
        for k in range(points):
            p += to_fine[f, k] * bend[k, 0]
            q += to_fine[f, k] * bend[k, 1]
            r += to_fine[f, k] * bend[k, 2]
        size = h * np.sqrt(p * p + q * q + r * r)
        for i in range(points):
            angle[i] += weights[i, f] * size
        total += weights[points, f] * size
    return total


# The whole arm ---------------------------------------------------------------------------------


@compiled
def residual(
    tables: Tables, z: FloatArray, tensions: FloatArray, force: FloatArray, couple: FloatArray,
    work: Work,
) -> float:  # fmt: skip
    """Imbalance of every cross section; fills in all but Hessian and Jacobian.

    ``work.scale`` is given, see `tables.force_scale`.

    Returns:
        Largest residual over its scale and the largest wrench along the arm [-]; NaN where a
        strain is impossible.
    """
    orientations(tables, z, work)
    moment, left, scale, count = work.moment, work.residual, work.scale, z.shape[1]
    _moments(tables.lengths, tables.weights, tables.to_end, work.slope, force, couple, moment)
    body, tendons, compliance = tables.body, tables.tendons, tables.compliance
    active, offsets = tables.active, work.offsets
    g, h, room = np.empty(6), np.empty((0, 6)), np.zeros((6, 6))
    wrench, largest, worst = np.empty(6), np.zeros(6), 0.0
    for i in range(z.shape[0]):
        gradient, own, turn = work.gradient[i], left[i], work.rotation[i]
        _section(
            tables.widens, body[i], tendons[i], compliance, active[i],
            z[i], tensions[i], offsets[i], g, h, room,
        )  # fmt: skip
        _turn_back(turn, moment[i], 0, wrench)
        _turn_back(turn, force[i], 3, wrench)
        for c in range(count):
            gradient[c] = g[c]
            own[c] = gradient[c] - wrench[c]
            largest[c] = max(largest[c], abs(wrench[c]))
    for i in range(z.shape[0]):
        for c in range(count):
            value = abs(left[i, c]) / (scale[i, c // 3] + largest[c])
            if not value <= worst:  # also NaN, which stays
                worst = value
    return worst


@inlined
def _turn_back(turn: FloatArray, vector: FloatArray, first: int, out: FloatArray) -> None:
    """Components of a ``vector`` along the columns of a rotation, from ``first`` on."""
    for c in range(3):
        out[first + c] = turn[0, c] * vector[0] + turn[1, c] * vector[1] + turn[2, c] * vector[2]


@inlined
def _cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@helper
def _moments(
    lengths: FloatArray, weights: FloatArray, to_end: FloatArray, slope: FloatArray,
    force: FloatArray, couple: FloatArray, moment: FloatArray,
) -> None:  # fmt: skip
    """M = M_free + integral to the tip of r' x F."""
    points = to_end.shape[0]
    beyond, rate = np.zeros(3), np.empty((points, 3))
    for e in range(lengths.size - 1, -1, -1):
        start, h = e * points, lengths[e]
        for k in range(points):
            _cross(slope[start + k], force[start + k], rate[k])
        for i in range(points):
            for c in range(3):
                value = 0.0
                for k in range(points):
                    value += to_end[i, k] * rate[k, c]
                moment[start + i, c] = couple[start + i, c] + beyond[c] + h * value
        for k in range(points):
            for c in range(3):
                beyond[c] += weights[start + k] * rate[k, c]


@compiled
def jacobian(
    tables: Tables, z: FloatArray, tensions: FloatArray, force: FloatArray, work: Work
) -> None:
    """Derivative of the residual by z for a fixed ``force``; after `residual` of the same z.

    With X = r' F^T - (F . r') 1 and S its integral from a node to the tip, the block of nodes i
    and k is -R_i^T (S_i + M_i x) w_k R_k where k is in an element before that of i, -R_i^T w_k S_k
    R_k where it is in one beyond, and C_ik = sum over m of B_im X_m G_mk takes the place of S
    within one; by the stretch of k it is R_i^T (F_k x t_k) B_ik.
    """
    sections(tables, z, tensions, work)
    lengths, weights, to_end, moment = tables.lengths, tables.weights, tables.to_end, work.moment
    (count, strains), points = z.shape, to_end.shape[0]
    # X, and rows of R^T, then t x F and what shear has of it.
    lever, axes = np.empty((count, 9)), np.empty((count, strains, 3))
    _levers(work.slope, work.rotation, force, lever, axes)
    # Rows of node i times 1 and k before; columns of node k times R^T and i before.
    left, base_side = np.zeros((count, strains, 3)), np.zeros((3, count * strains))
    tip_side = np.zeros((3, count * strains))
    beyond, own = np.zeros(9), np.empty(9)
    for e in range(lengths.size - 1, -1, -1):
        start, h = e * points, lengths[e]
        for i in range(start, start + points):
            for c in range(9):
                own[c] = beyond[c]
            for k in range(points):
                for c in range(9):
                    own[c] += h * to_end[i - start, k] * lever[start + k, c]
            _sides(weights[i], own, moment[i], axes[i], left[i], i, base_side, tip_side)
        _own_element(
            (h, weights[start : start + points]), (tables.to_point, to_end, tables.twice), beyond,
            lever[start : start + points], moment[start : start + points],
            axes[start : start + points], start * strains, work.jacobian,
        )  # fmt: skip
        for k in range(start, start + points):
            for c in range(9):
                beyond[c] += weights[k] * lever[k, c]
    _other_elements(points * strains, left, axes, base_side, tip_side, work.jacobian)
    for i in range(count):
        for a in range(strains):
            for c in range(strains):
                work.jacobian[i * strains + a, i * strains + c] += work.hessian[i, a, c]


@helper
def _levers(
    slope: FloatArray, rotation: FloatArray, force: FloatArray, lever: FloatArray, axes: FloatArray
) -> None:
    for i in range(slope.shape[0]):
        r, f, turn, own = slope[i], force[i], rotation[i], axes[i]
        product = r[0] * f[0] + r[1] * f[1] + r[2] * f[2]
        for a in range(3):
            for c in range(3):
                lever[i, 3 * a + c] = r[a] * f[c]
                own[a, c] = turn[c, a]
            lever[i, 4 * a] -= product
        for a in range(3, own.shape[0]):
            _cross(own[a - 3], f, own[a])


@inlined
def _add_cross(part: float, m: FloatArray, out: FloatArray) -> None:
    """Add ``part`` of the matrix (9,) that takes the cross product with ``m``."""
    x, y, b = part * m[0], part * m[1], part * m[2]
    out[1] -= b
    out[2] += y
    out[3] += b
    out[5] -= x
    out[6] -= y
    out[7] += x


@inlined
def _times(matrix: FloatArray, vector: FloatArray, factor: float, out: FloatArray) -> None:
    """A matrix (9,) times a vector, times a ``factor``."""
    for c in range(3):
        out[c] = factor * (
            matrix[3 * c] * vector[0] + matrix[3 * c + 1] * vector[1]
            + matrix[3 * c + 2] * vector[2]
        )  # fmt: skip


@helper
def _sides(
    weight: float, tail: FloatArray, moment: FloatArray, axes: FloatArray, left: FloatArray,
    i: int, base_side: FloatArray, tip_side: FloatArray,
) -> None:  # fmt: skip
    """Factors of the blocks of node ``i`` with other elements; ``tail`` is S, overwritten."""
    strains = axes.shape[0]
    side = np.empty(3)
    for a in range(strains):
        if a < 3:
            _times(tail, axes[a], weight, side)
        for c in range(3):
            if a < 3:
                base_side[c, i * strains + a] = weight * axes[a, c]
            else:
                side[c] = weight * axes[a, c]
            tip_side[c, i * strains + a] = side[c]
    _add_cross(1.0, moment, tail)
    for a in range(strains):
        for c in range(3):
            left[a, c] = axes[a, c]
            if a < 3:
                left[a, c] = (
                    axes[a, 0] * tail[c] + axes[a, 1] * tail[3 + c] + axes[a, 2] * tail[6 + c]
                )


@helper
def _own_element(
    lengths: tuple[float, FloatArray], rule: tuple[FloatArray, FloatArray, FloatArray],
    beyond: FloatArray, lever: FloatArray, moment: FloatArray, axes: FloatArray, first: int,
    out: FloatArray,
) -> None:  # fmt: skip
    """Blocks of nodes of one element but Hessians, from row and column ``first`` on.

    ``beyond`` is the integral of X beyond it.
    """
    h, weights = lengths
    to_point, to_end, twice = rule
    points, strains = axes.shape[0], axes.shape[1]
    # Moment at i, and direction there, by a strain of k.
    inner, moved, turned = np.empty(9), np.empty(3), np.zeros(3)
    for i in range(points):
        for k in range(points):
            reach, further = h * to_point[i, k], h * to_end[i, k]
            for c in range(9):
                value = 0.0
                for n in range(points):
                    value += twice[i, k, n] * lever[n, c]
                inner[c] = h * h * value + weights[k] * beyond[c]
            _add_cross(reach, moment[i], inner)
            for c in range(strains):
                if c < 3:
                    _times(inner, axes[k, c], 1.0, moved)
                for n in range(3):
                    if c >= 3:
                        moved[n] = further * axes[k, c, n]
                    turned[n] = reach * axes[k, c, n] if c < 3 else 0.0
                for a in range(strains):
                    by = moved if a < 3 else turned
                    out[first + i * strains + a, first + k * strains + c] = -(
                        axes[i, a, 0] * by[0] + axes[i, a, 1] * by[1] + axes[i, a, 2] * by[2]
                    )


@helper
def _other_elements(
    size: int, left: FloatArray, axes: FloatArray, base_side: FloatArray, tip_side: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Blocks of nodes of different elements of ``size`` rows, by their factors."""
    strains = axes.shape[1]
    for at in range(out.shape[0]):
        i, a, row, first = at // strains, at % strains, out[at], at // size * size
        p, q, r = left[i, a, 0], left[i, a, 1], left[i, a, 2]
        for k in range(first):
            row[k] = -(p * base_side[0, k] + q * base_side[1, k] + r * base_side[2, k])
        p, q, r = axes[i, a, 0], axes[i, a, 1], axes[i, a, 2]
        if a >= 3:
            p = q = r = 0.0
        for k in range(first + size, row.size):
            row[k] = -(p * tip_side[0, k] + q * tip_side[1, k] + r * tip_side[2, k])
