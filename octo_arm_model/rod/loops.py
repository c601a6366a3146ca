"""The node functions as loops, compiled by numba; `arrays` has the same for NumPy.

The energy of a cross section per reference length, of scaled strain e = (w kappa, lambda, v):

    psi = psi_material(e) + sum T |u| + sum k |d|^2 / 2
    u = (lambda, v_n, v_b) + w kappa x (r + d) + w r'

for a tendon of tension T at the offset r that stands off its path by d in a sheath of stiffness k;
w(lambda) is the widening of the section, lambda^-1/2 for rubber. d is the one of least energy.
With c = u / |u|, the gradient of |u| by e is g = c . du/de, and its Hessian
(du/de . du/de - g g^T) / |u|.

All take `Tables` and `Work`; z is (N, m), ``tensions`` (N, J) [N], ``force`` and ``couple`` the
force and the free moment of all that acts beyond each node, (N, 3) in base_frame. What has more
than seven arguments here has them for numba, which inlines it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit

from octo_arm_model.arm.hints import FloatArray
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
    PaperTables,
    Places,
    Tables,
    Work,
)

_F = TypeVar('_F', bound=Callable[..., object])
_MOST_SWEEPS = 80  # of orientations
_ROUNDING = 2e-13  # change by a sweep, which leaves a thirtieth of it
_MOST_STEPS = 30  # of the offset of a tendon in its sheath
_ROUGH = 0.5  # cosine between bends of a tendon at the ends of an element, see `angles`
_SETTLED = 1e-14  # change of an offset, over the lever
MOST_PAPER_SWEEPS, SWEEPS_A_CHECK = 60, 2  # see `arrays`
MOST_STEPS, ROUNDING, SHORTENED, OVERSHOOT = 200, 1e-6, 0.5, 0.9  # see `arrays.balance`


def _compiled(function: _F, inlined: bool = False) -> _F:
    fast = {'contract', 'nsz'}
    compiled = njit(cache=True, error_model='numpy', fastmath=fast, forceinline=inlined)
    return cast(_F, compiled(function))


def _inlined(function: _F) -> _F:
    # Tables are hundreds of numbers that a call would copy.
    return _compiled(function, inlined=True)


# Orientations ----------------------------------------------------------------------------------


@_compiled
def orientations(tables: Tables, z: FloatArray, work: Work) -> None:
    """Orientation and r' of every node: q' = q (0, kappa) / 2 collocated in each element.

    Of several arms where there are several times as many nodes.
    """
    elements, points = tables.lengths.size, tables.to_point.shape[0]
    to_point, weights = tables.to_point, tables.weights
    rate, now, first = np.empty((points, 4)), np.empty((points, 4)), np.empty(4)
    for number in range(z.shape[0] // points):
        start, e = number * points, number % elements
        if e == 0:
            first[:] = tables.base
        h, own = tables.lengths[e], z[start : start + points]
        _turn(first, own, h, to_point, now)
        for _ in range(_MOST_SWEEPS):
            _rates(now, own, 0.5 * h, rate)
            change = 0.0
            for i in range(points):
                w, x, y, b = first[0], first[1], first[2], first[3]
                for k in range(points):
                    part = to_point[i, k]
                    w += part * rate[k, 0]
                    x += part * rate[k, 1]
                    y += part * rate[k, 2]
                    b += part * rate[k, 3]
                change = max(
                    change, abs(w - now[i, 0]), abs(x - now[i, 1]), abs(y - now[i, 2]),
                    abs(b - now[i, 3]),
                )  # fmt: skip
                now[i, 0], now[i, 1], now[i, 2], now[i, 3] = w, x, y, b
            if not change > _ROUNDING:
                break
        _rates(now, own, 0.5 * h, rate)
        for k in range(points):
            for c in range(4):
                first[c] += weights[k] / tables.lengths[0] * rate[k, c]
        size = 0.0
        for c in range(4):
            size += first[c] * first[c]
        for c in range(4):
            first[c] /= np.sqrt(size)
        for i in range(points):
            _orient(now[i], own[i], start + i, work)


@_compiled
def _turn(
    first: FloatArray, z: FloatArray, h: float, to_point: FloatArray, out: FloatArray
) -> None:
    """Nearly the quaternions (p, 4) of an element: turned by its mean bend so far."""
    w, x, y, b = first[0], first[1], first[2], first[3]
    for i in range(out.shape[0]):
        p = q = r = 0.0
        for k in range(out.shape[0]):
            p += to_point[i, k] * z[k, 0]
            q += to_point[i, k] * z[k, 1]
            r += to_point[i, k] * z[k, 2]
        half = 0.5 * h * np.sqrt(p * p + q * q + r * r) + 1e-150
        cosine, sine = np.cos(half), 0.5 * h * np.sin(half) / half
        p, q, r = sine * p, sine * q, sine * r
        out[i, 0] = w * cosine - x * p - y * q - b * r
        out[i, 1] = x * cosine + w * p + y * r - b * q
        out[i, 2] = y * cosine + w * q + b * p - x * r
        out[i, 3] = b * cosine + w * r + x * q - y * p


@_compiled
def _rates(quaternions: FloatArray, z: FloatArray, half: float, rate: FloatArray) -> None:
    """Derivative of quaternions (p, 4) per element, (p, 4)."""
    for k in range(quaternions.shape[0]):
        w, x, y, b = quaternions[k, 0], quaternions[k, 1], quaternions[k, 2], quaternions[k, 3]
        p, q, r = half * z[k, 0], half * z[k, 1], half * z[k, 2]
        rate[k, 0] = -(x * p + y * q + b * r)
        rate[k, 1] = w * p + y * r - b * q
        rate[k, 2] = w * q + b * p - x * r
        rate[k, 3] = w * r + x * q - y * p


@_compiled
def _orient(quaternion: FloatArray, z: FloatArray, i: int, work: Work) -> None:
    """Fill in orientation and r' of node ``i``."""
    w, x, y, b = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    over = 1.0 / np.sqrt(w * w + x * x + y * y + b * b)
    w, x, y, b = w * over, x * over, y * over, b * over
    work.quaternion[i, 0], work.quaternion[i, 1] = w, x
    work.quaternion[i, 2], work.quaternion[i, 3] = y, b
    r = work.rotation[i]
    r[0, 0], r[0, 1], r[0, 2] = (
        w * w + x * x - y * y - b * b,
        2 * (x * y - w * b),
        2 * (x * b + w * y),
    )
    r[1, 0], r[1, 1], r[1, 2] = (
        2 * (x * y + w * b),
        w * w - x * x + y * y - b * b,
        2 * (y * b - w * x),
    )
    r[2, 0], r[2, 1], r[2, 2] = (
        2 * (x * b - w * y),
        2 * (y * b + w * x),
        w * w - x * x - y * y + b * b,
    )
    for c in range(3):
        slope = r[c, 0] * z[3]
        if z.size == 6:
            slope += r[c, 1] * z[4] + r[c, 2] * z[5]
        work.slope[i, c] = slope


# Poses -----------------------------------------------------------------------------------------


@_compiled
def poses(
    tables: Tables, z: FloatArray, places: Places, work: Work
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where places are, by integrals of r' and q' from the base, and how well this is resolved.

    After `orientations` of the same z.

    Returns:
        Positions from the base (A, S, 3) [m], orientations x, y, z, w (A, S, 4) and the estimated
        error of positions over the length of the arm (A,), see `resolution`, of A arms.
    """
    points, elements = tables.to_point.shape[0], tables.lengths.size
    nodes, stations = elements * points, places.element.size
    arms = z.shape[0] // nodes
    position, quaternion = np.empty((arms, stations, 3)), np.empty((arms, stations, 4))
    error, turn, reached = np.empty(arms), np.empty((nodes, 4)), np.empty((elements + 1, 7))
    now = np.empty(7)
    for arm in range(arms):
        first = arm * nodes
        slope, own = work.slope[first : first + nodes], z[first : first + nodes]
        _rates(work.quaternion[first : first + nodes], own, 0.5, turn)
        reached[0, :3], reached[0, 3:] = 0.0, tables.base
        for e in range(elements):
            now[:] = reached[e]
            for i in range(e * points, (e + 1) * points):
                _advance(tables.weights[i], slope[i], turn[i], now)
            reached[e + 1] = now
        for at in range(stations):
            e = places.element[at]
            now[:] = reached[e]
            for i in range(e * points, (e + 1) * points):
                _advance(places.integration[at, i], slope[i], turn[i], now)
            over = 1.0 / np.sqrt(now[3] ** 2 + now[4] ** 2 + now[5] ** 2 + now[6] ** 2)
            for c in range(3):
                position[arm, at, c], quaternion[arm, at, c] = now[c], now[4 + c] * over
            quaternion[arm, at, 3] = now[3] * over
        error[arm] = _position_error(tables.lengths, places.tail, own, slope)
    return position, quaternion, error


@_inlined
def _advance(weight: float, slope: FloatArray, turn: FloatArray, now: FloatArray) -> None:
    """Add the rates of position and quaternion of a node, times its ``weight``."""
    for c in range(3):
        now[c] += weight * slope[c]
    for c in range(4):
        now[3 + c] += weight * turn[c]


@_compiled
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


@_inlined
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


@_inlined
def _widening(widens: bool, stretch: float) -> tuple[float, float, float]:
    """Radius over reference radius, and its two derivatives by the stretch."""
    if not widens:
        return 1.0, 0.0, 0.0
    over = 1.0 / stretch
    width = np.sqrt(over)
    slope = -0.5 * width * over
    return width, slope, -1.5 * slope * over


@_inlined
def _scaled(z: FloatArray, width: float, strain: FloatArray) -> None:
    """The six scaled strains of one node, (t, n, b, lambda, v_n, v_b)."""
    strain[4] = strain[5] = 0.0
    for c in range(z.size):
        strain[c] = width * z[c] if c < 3 else z[c]


@_compiled
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
        stiff = yielding * over
        nn = 1.0 + stiff * (b * b + t * t - p_n * p_n)
        bb = 1.0 + stiff * (n * n + t * t - p_b * p_b)
        nb = -stiff * (b * n + p_n * p_b)
        over = 1.0 / (nn * bb - nb * nb)
        s_n, s_b = (bb * r_n - nb * r_b) * over, (nn * r_b - nb * r_n) * over
        d_n, d_b = d_n - s_n, d_b - s_b
        left = (abs(s_n) + abs(s_b)) / lever
        if not left * left > _SETTLED:
            break
    if not left * left <= _SETTLED:
        return np.nan, np.nan
    return d_n, d_b


@_inlined
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


@_inlined
def _stress(tables: Tables, i: int, strain: FloatArray, g: FloatArray) -> None:
    """Gradient of the energy of the material by the scaled strain."""
    body, n, b = tables.body[i], strain[1], strain[2]
    by_stretch, by_bend, _, _, _ = _density(
        tables.widens, strain[3], (n * n + b * b) * body[SQUARED_RADIUS]
    )
    once = 2.0 * body[AXIAL] * body[SQUARED_RADIUS] * by_bend
    g[0], g[1], g[2] = body[TORSION] * strain[0], once * n, once * b
    g[3] = body[AXIAL] * by_stretch
    g[4], g[5] = body[SHEAR] * strain[4], body[SHEAR] * strain[5]


@_inlined
def _unscale_gradient(z: FloatArray, width: float, slope: float, g: FloatArray) -> None:
    """From the gradient by the scaled strain to that by the twist."""
    g[3] += slope * (z[0] * g[0] + z[1] * g[1] + z[2] * g[2])
    for c in range(3):
        g[c] *= width


@_compiled
def sections(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Gradient and Hessian of the energy of every cross section by the twist."""
    g, h, room = np.empty(6), np.empty((6, 6)), np.zeros((7, 6))
    for i in range(z.shape[0]):
        _section(tables, i, z[i], tensions[i], True, g, h, room, work)
        for a in range(z.shape[1]):
            work.gradient[i, a] = g[a]
            for c in range(a + 1):
                work.hessian[i, a, c] = work.hessian[i, c, a] = h[a, c]


@_inlined
def _section(
    tables: Tables, i: int, z: FloatArray, tensions: FloatArray, curves: bool, g: FloatArray,
    h: FloatArray, room: FloatArray, work: Work,
) -> None:  # fmt: skip
    """Gradient and, if it ``curves``, lower half of the Hessian at node ``i`` into g and h.

    ``room`` has rows of one tendon in a sheath, du/de, its gradient and C, and the scaled strain.
    """
    own, strain, shears = room[:6], room[6], z.size == 6
    tendons, compliance, offsets = tables.tendons[i], tables.compliance, work.offsets
    width, slope, bend = _widening(tables.widens, z[3])
    _scaled(z, width, strain)
    _stress(tables, i, strain, g)
    if curves:
        _stiffness(tables, i, strain, h)
    lever = tables.body[i, LEVER]
    for j in range(tables.active[i]):
        tension = tensions[j]
        if tension == 0.0:
            continue
        d_n = d_b = 0.0
        if compliance[j] > 0.0:
            yielding = compliance[j] * tension
            d_n, d_b = _offset(tendons[j], strain, width, yielding, lever)
            offsets[i, j, 0], offsets[i, j, 1] = d_n, d_b
        x, y = tendons[j, ALONG_N] + d_n, tendons[j, ALONG_B] + d_b
        u_t, u_n, u_b = _along(tendons[j], strain, width, d_n, d_b)
        over = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
        u_t, u_n, u_b = u_t * over, u_n * over, u_b * over
        dx, dy = tendons[j, SLOPE_N], tendons[j, SLOPE_B]
        along = tension * (dx * u_n + dy * u_b)
        dx, dy = slope * dx, slope * dy
        w, p, q = tension * over, x * u_b - y * u_n, u_t + dx * u_n + dy * u_b
        y_t, x_t = y * u_t, x * u_t
        g[0] += tension * p
        g[1] += tension * y_t
        g[2] -= tension * x_t
        g[3] += tension * q
        g[4] += tension * u_n
        g[5] += tension * u_b
        if not curves:
            continue
        # Lower half of du/de . du/de - g g^T, g = (p, y_t, -x_t, q, u_n, u_b).
        h[0, 0] += w * (x * x + y * y - p * p)
        h[1, 0] -= w * y_t * p
        h[1, 1] += w * (y * y - y_t * y_t)
        h[2, 0] += w * x_t * p
        h[2, 1] -= w * (x * y - x_t * y_t)
        h[2, 2] += w * (x * x - x_t * x_t)
        h[3, 0] += w * (x * dy - y * dx - q * p)
        h[3, 1] += w * (y - q * y_t)
        h[3, 2] -= w * (x - q * x_t)
        h[3, 3] += w * (1.0 + dx * dx + dy * dy - q * q) + bend * along
        if shears:
            _add_shear(w, (x, y, dx, dy), (p, y_t, -x_t, q, u_n, u_b), h)
        if compliance[j] > 0.0:
            own[1, 0], own[2, 0], own[0, 1], own[0, 2] = -y, x, y, -x
            own[0, 3], own[1, 3], own[2, 3] = 1.0, dx, dy
            own[1, 4] = own[2, 5] = 1.0
            for c in range(6):
                own[3, c] = own[0, c] * u_t + own[1, c] * u_n + own[2, c] * u_b
            _condense(compliance[j], tension, strain, (u_t, u_n, u_b, over), own, h)
    if curves:
        _unscale(z, (width, slope, bend), g, h)
    else:
        _unscale_gradient(z, width, slope, g)


@_compiled
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


@_compiled
def _condense(
    compliance: float, tension: float, strain: FloatArray, unit: tuple[float, float, float, float],
    own: FloatArray, h: FloatArray,
) -> None:  # fmt: skip
    """Subtract C D^-1 C^T, as an offset follows the strain; ``unit`` ends with 1 / |u|."""
    t, n, b = strain[0], strain[1], strain[2]
    u_t, u_n, u_b, over = unit
    p_n, p_b = t * u_b - b * u_t, n * u_t - t * u_n
    weight, stiff = tension * over, compliance * tension * over
    for c in range(6):
        own[4, c] = weight * (t * own[2, c] - b * own[0, c] - p_n * own[3, c])
        own[5, c] = weight * (n * own[0, c] - t * own[1, c] - p_b * own[3, c])
    own[4, 0] += tension * u_b
    own[4, 2] -= tension * u_t
    own[5, 0] -= tension * u_n
    own[5, 1] += tension * u_t
    nn, bb = 1.0 + stiff * (b * b + t * t - p_n * p_n), 1.0 + stiff * (n * n + t * t - p_b * p_b)
    nb = -stiff * (b * n + p_n * p_b)
    factor = compliance / (nn * bb - nb * nb)
    for a in range(6):
        of_n, of_b = bb * own[4, a] - nb * own[5, a], nn * own[5, a] - nb * own[4, a]
        for c in range(a + 1):
            h[a, c] -= factor * (of_n * own[4, c] + of_b * own[5, c])


@_inlined
def _stiffness(tables: Tables, i: int, strain: FloatArray, h: FloatArray) -> None:
    """Hessian of the energy of the material by the scaled strain."""
    body, n, b = tables.body[i], strain[1], strain[2]
    axial, square = body[AXIAL], body[SQUARED_RADIUS]
    _, by_bend, by_ss, by_sb, by_bb = _density(tables.widens, strain[3], (n * n + b * b) * square)
    once, both, second = (
        2.0 * axial * square * by_bend,
        2.0 * axial * square * by_sb,
        4.0 * axial * square * square * by_bb,
    )
    h[:] = 0.0
    h[0, 0] = body[TORSION]
    h[1, 1], h[2, 1], h[2, 2] = once + second * n * n, second * n * b, once + second * b * b
    h[3, 1], h[3, 2], h[3, 3] = both * n, both * b, axial * by_ss
    h[4, 4] = h[5, 5] = body[SHEAR]


@_inlined
def _unscale(
    z: FloatArray, widening: tuple[float, float, float], g: FloatArray, h: FloatArray
) -> None:
    """From gradient and lower half of the Hessian by the scaled strain to those by the twist."""
    width, slope, bend = widening
    along, twice, mixed = 0.0, 0.0, 0.0
    for a in range(3):
        along += z[a] * g[a]
        mixed += z[a] * h[3, a]
        for c in range(3):
            twice += z[a] * z[c] * (h[a, c] if c <= a else h[c, a])
    h[3, 3] += slope * (2.0 * mixed + slope * twice) + bend * along
    for a in range(3):
        by = 0.0
        for c in range(3):
            by += z[c] * (h[a, c] if c <= a else h[c, a])
        h[3, a] = width * (h[3, a] + slope * by) + slope * g[a]
    for a in range(4, 6):
        # Shear goes with the linear law, which does not widen.
        for c in range(3):
            h[a, c] *= width
    _unscale_gradient(z, width, slope, g)
    for a in range(3):
        for c in range(a + 1):
            h[a, c] *= width * width


@_compiled
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
    g, h, room = np.empty(6), np.empty((6, 6)), np.zeros((7, 6))
    count, worst, most = z.shape[1], 0.0, 0
    step, left, scale = np.zeros(count), np.zeros(count), np.zeros(count)
    largest = np.zeros(count)
    for c in range(count):
        for i in range(z.shape[0]):
            largest[c] = max(largest[c], abs(wrench[i, c]))
    for i in range(z.shape[0]):
        if z[i, 3] == 0.0:
            _guess(tables, i, tensions[i], z[i])
        force = tables.least_scale[i]
        for j in range(tables.active[i]):
            force += tensions[i, j]
        for c in range(count):
            scale[c] = largest[c] + force * (tables.body[i, LEVER] if c < 3 else 1.0)
        slope, own, steps = 0.0, np.inf, 0
        while steps < MOST_STEPS and not own <= tolerance:
            steps += 1
            _section(tables, i, z[i], tensions[i], True, g, h, room, work)
            along, own = 0.0, 0.0
            for c in range(count):
                left[c] = g[c] - wrench[i, c]
                along += left[c] * step[c]
                value = abs(left[c]) / scale[c]
                if not value <= own:  # also NaN, which stays
                    own = value
            if steps > 1 and not (own <= ROUNDING or along <= OVERSHOOT * slope):
                slope *= SHORTENED
                for c in range(count):
                    step[c] *= SHORTENED
                    z[i, c] -= step[c]
                continue
            for a in range(count):
                work.gradient[i, a], work.residual[i, a], step[a] = g[a], left[a], -left[a]
                for c in range(a + 1):
                    work.hessian[i, a, c] = work.hessian[i, c, a] = h[a, c]
            _solve_ldl(h, step)
            slope = 0.0
            for c in range(count):
                z[i, c] += step[c]
                slope -= left[c] * step[c]
        if not own <= worst:
            worst = own
        most = max(most, steps)
    return worst, most


@_inlined
def _guess(tables: Tables, i: int, tensions: FloatArray, z: FloatArray) -> None:
    """Twist of node ``i`` as if tendons were parallel, see `arrays.initial_twists`."""
    body, tendons = tables.body[i], tables.tendons[i]
    axial, radius = body[AXIAL], np.sqrt(body[SQUARED_RADIUS])
    force = about_n = about_b = 0.0
    for j in range(tables.active[i]):
        force += tensions[j] / axial
        about_n += tensions[j] * tendons[j, ALONG_B] / axial
        about_b -= tensions[j] * tendons[j, ALONG_N] / axial
    moment = np.sqrt(about_n * about_n + about_b * about_b)
    if tables.widens:
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
    if tables.widens:
        curvature *= np.sqrt(stretch)
    z[1], z[2], z[3] = about_n * curvature, about_b * curvature, stretch


@_inlined
def _solve_ldl(h: FloatArray, x: FloatArray) -> None:
    """Replace ``x`` by the solution of a symmetric system whose lower half is ``h``."""
    count = x.size
    for a in range(count):
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


@_compiled
def _relative(wrench: FloatArray, work: Work) -> float:
    """Largest residual over its scale and the largest ``wrench`` (N, m) along the arm."""
    worst = 0.0
    for c in range(wrench.shape[1]):
        largest = 0.0
        for i in range(wrench.shape[0]):
            largest = max(largest, abs(wrench[i, c]))
        for i in range(wrench.shape[0]):
            value = abs(work.residual[i, c]) / (work.scale[i, c // 3] + largest)
            if not value <= worst:  # also NaN, which stays
                worst = value
    return worst


# Tendons with friction -------------------------------------------------------------------------


@_compiled
def angles(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
    """Angle by which every tendon under tension has turned between the base and every node.

    The integral of the length of e' + kappa x e, e the unit tangent in the axes of the section,
    and the angles between tangents where strains jump; its length has a kink where it vanishes,
    and is taken at fine points where it may. ``tensions`` displace tendons in sheaths.
    """
    elements, points, tendons = tables.lengths.size, tables.to_end.shape[0], tables.friction.size
    width, strain = np.empty(points), np.empty((points, 6))
    unit, bend, rate = np.empty((points, 3)), np.empty((points, 3)), np.empty(points)
    last, total = np.zeros((tendons, 3)), np.zeros(tendons)
    work.angle[:] = 0.0
    for e in range(elements):
        start, h = e * points, tables.lengths[e]
        for k in range(points):
            width[k], _, _ = _widening(tables.widens, z[start + k, 3])
            _scaled(z[start + k], width[k], strain[k])
        for j in range(tables.active[start]):
            if tensions[start, j] == 0.0 or tables.friction[j] == 0.0:
                continue
            for k in range(points):
                tendon, d_n, d_b = tables.tendons[start + k, j], 0.0, 0.0
                if tables.compliance[j] > 0.0:
                    yielding = tables.compliance[j] * tensions[start + k, j]
                    lever = tables.body[start + k, LEVER]
                    d_n, d_b = _offset(tendon, strain[k], width[k], yielding, lever)
                    work.offsets[start + k, j, 0], work.offsets[start + k, j, 1] = d_n, d_b
                u_t, u_n, u_b = _along(tendon, strain[k], width[k], d_n, d_b)
                over = 1.0 / np.sqrt(u_t * u_t + u_n * u_n + u_b * u_b)
                unit[k, 0], unit[k, 1], unit[k, 2] = over * u_t, over * u_n, over * u_b
            square = 0.0
            for c in range(3):
                first = end = 0.0
                for k in range(points):
                    first += tables.ends[0, k] * unit[k, c]
                    end += tables.ends[1, k] * unit[k, c]
                square += (first - last[j, c]) ** 2
                last[j, c] = end
            if tables.sharp[e]:
                total[j] += 2.0 * np.arcsin(min(0.5 * np.sqrt(square), 1.0))
            for k in range(points):
                p = q = r = 0.0
                for n in range(points):
                    slope = tables.differentiation[k, n]
                    p += slope * unit[n, 0]
                    q += slope * unit[n, 1]
                    r += slope * unit[n, 2]
                _cross(z[start + k], unit[k], bend[k])
                bend[k, 0] += p / h
                bend[k, 1] += q / h
                bend[k, 2] += r / h
                rate[k] = np.sqrt(bend[k, 0] ** 2 + bend[k, 1] ** 2 + bend[k, 2] ** 2)
            along = 0.0
            for c in range(3):
                along += bend[0, c] * bend[points - 1, c]
            if along < _ROUGH * rate[0] * rate[points - 1]:
                _turn_finely(tables, e, bend, total, work.angle[:, j], j)
                continue
            for i in range(points):
                angle = 0.0
                for k in range(points):
                    angle += tables.to_point[i, k] * rate[k]
                work.angle[start + i, j] = total[j] + h * angle
            for k in range(points):
                total[j] += tables.weights[start + k] * rate[k]


@_compiled
def _turn_finely(
    tables: Tables, e: int, bend: FloatArray, total: FloatArray, angle: FloatArray, j: int
) -> None:
    """Angles of a tendon in an element of which ``bend`` (p, 3) is the bend, at fine points."""
    points = bend.shape[0]
    first = total[j]
    for i in range(points):
        angle[e * points + i] = first
    for f in range(tables.to_fine.shape[0]):
        p = q = r = 0.0
        for k in range(points):
            p += tables.to_fine[f, k] * bend[k, 0]
            q += tables.to_fine[f, k] * bend[k, 1]
            r += tables.to_fine[f, k] * bend[k, 2]
        size = tables.lengths[e] * np.sqrt(p * p + q * q + r * r)
        for i in range(points):
            angle[e * points + i] += tables.fine_weights[i, f] * size
        total[j] += tables.fine_weights[points, f] * size


# The whole arm ---------------------------------------------------------------------------------


@_compiled
def residual(
    tables: Tables, z: FloatArray, tensions: FloatArray, force: FloatArray, couple: FloatArray,
    work: Work,
) -> float:  # fmt: skip
    """Imbalance of every cross section; fills in all but Hessian and Jacobian.

    ``work.scale`` is given, see `tables.force_scale`.

    Returns:
        Largest residual over its scale [-]; NaN where a strain is impossible.
    """
    orientations(tables, z, work)
    _moments(tables, force, couple, work)
    wrench, g, h, room = np.empty(z.shape), np.empty(6), np.empty((6, 6)), np.zeros((7, 6))
    for i in range(z.shape[0]):
        _section(tables, i, z[i], tensions[i], False, g, h, room, work)
        r = work.rotation[i]
        for c in range(3):
            wrench[i, c] = (
                r[0, c] * work.moment[i, 0] + r[1, c] * work.moment[i, 1]
                + r[2, c] * work.moment[i, 2]
            )  # fmt: skip
        for c in range(z.shape[1] - 3):
            wrench[i, 3 + c] = (
                r[0, c] * force[i, 0] + r[1, c] * force[i, 1] + r[2, c] * force[i, 2]
            )
        for c in range(z.shape[1]):
            work.gradient[i, c] = g[c]
            work.residual[i, c] = g[c] - wrench[i, c]
    return _relative(wrench, work)


@_compiled
def _moments(tables: Tables, force: FloatArray, couple: FloatArray, work: Work) -> None:
    """M = M_free + integral to the tip of r' x F."""
    elements, points = tables.lengths.size, tables.to_end.shape[0]
    beyond, rate = np.zeros(3), np.empty((points, 3))
    for e in range(elements - 1, -1, -1):
        start, h = e * points, tables.lengths[e]
        for k in range(points):
            _cross(work.slope[start + k], force[start + k], rate[k])
        for i in range(points):
            for c in range(3):
                value = 0.0
                for k in range(points):
                    value += tables.to_end[i, k] * rate[k, c]
                work.moment[start + i, c] = couple[start + i, c] + beyond[c] + h * value
        for k in range(points):
            for c in range(3):
                beyond[c] += tables.weights[start + k] * rate[k, c]


@_compiled
def _cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@_compiled
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
    count, strains = z.shape
    elements, points = tables.lengths.size, tables.to_end.shape[0]
    lever = np.empty((count, 3, 3))
    for i in range(count):
        r, f = work.slope[i], force[i]
        product = r[0] * f[0] + r[1] * f[1] + r[2] * f[2]
        for a in range(3):
            for c in range(3):
                lever[i, a, c] = r[a] * f[c]
            lever[i, a, a] -= product
    # Rows of node i times 1 and k before; columns of node k times R^T and i before.
    left, base_side = np.zeros((count, strains, 3)), np.zeros((3, count * strains))
    tip_side = np.zeros((3, count * strains))
    beyond, own = np.zeros((3, 3)), np.empty((3, 3))
    for e in range(elements - 1, -1, -1):
        start = e * points
        for i in range(start, start + points):
            own[:] = beyond
            for k in range(points):
                weight = tables.lengths[e] * tables.to_end[i - start, k]
                for a in range(3):
                    for c in range(3):
                        own[a, c] += weight * lever[start + k, a, c]
            _sides(tables.weights[i], own, force[i], i, work, left[i], base_side, tip_side)
        _own_element(tables, e, beyond, lever, force, work)
        for k in range(start, start + points):
            for a in range(3):
                for c in range(3):
                    beyond[a, c] += tables.weights[k] * lever[k, a, c]
    for i in range(count):
        first = i // points * points * strains
        last = first + points * strains
        for a in range(strains):
            row = work.jacobian[i * strains + a]
            p, q, r = left[i, a, 0], left[i, a, 1], left[i, a, 2]
            for k in range(first):
                row[k] = -(p * base_side[0, k] + q * base_side[1, k] + r * base_side[2, k])
            if a < 3:
                turn = work.rotation[i]
                p, q, r = turn[0, a], turn[1, a], turn[2, a]
                for k in range(last, row.size):
                    row[k] = -(p * tip_side[0, k] + q * tip_side[1, k] + r * tip_side[2, k])
            else:
                for k in range(last, row.size):
                    row[k] = 0.0


@_compiled
def _sides(
    weight: float, tail: FloatArray, force: FloatArray, i: int, work: Work,
    left: FloatArray, base_side: FloatArray, tip_side: FloatArray,
) -> None:  # fmt: skip
    """Factors of the blocks of node ``i`` with other elements; ``tail`` is S."""
    turn, strains = work.rotation[i], left.shape[0]
    for a in range(3):
        # S + M x, without forming the matrix of M x.
        m = work.moment[i]
        column = turn[0, a], turn[1, a], turn[2, a]
        for c in range(3):
            left[a, c] = column[0] * tail[0, c] + column[1] * tail[1, c] + column[2] * tail[2, c]
        left[a, 0] += column[1] * m[2] - column[2] * m[1]
        left[a, 1] += column[2] * m[0] - column[0] * m[2]
        left[a, 2] += column[0] * m[1] - column[1] * m[0]
        for c in range(3):
            base_side[c, i * strains + a] = weight * column[c]
            tip_side[c, i * strains + a] = weight * (
                tail[c, 0] * column[0] + tail[c, 1] * column[1] + tail[c, 2] * column[2]
            )
    for a in range(strains - 3):
        _cross(turn[:, a], force, left[3 + a])
        for c in range(3):
            tip_side[c, i * strains + 3 + a] = weight * left[3 + a, c]


@_compiled
def _own_element(
    tables: Tables, e: int, beyond: FloatArray, lever: FloatArray, force: FloatArray, work: Work
) -> None:
    """Blocks of nodes of one element; ``beyond`` is the integral of X beyond it."""
    points, strains = tables.to_end.shape[0], work.hessian.shape[1]
    start, h = e * points, tables.lengths[e]
    inner, right = np.empty((3, 3)), np.empty((3, 3))
    across = np.empty((points, 3, 3))
    for k in range(points):
        for a in range(strains - 3):
            _cross(work.rotation[start + k][:, a], force[start + k], across[k, a])
    for i in range(points):
        turn, m = work.rotation[start + i], work.moment[start + i]
        for k in range(points):
            for a in range(3):
                for c in range(3):
                    value = 0.0
                    for n in range(points):
                        value += tables.twice[i, k, n] * lever[start + n, a, c]
                    inner[a, c] = h * h * value + tables.weights[start + k] * beyond[a, c]
            reach = h * tables.to_point[i, k]
            inner[0, 1] -= reach * m[2]
            inner[0, 2] += reach * m[1]
            inner[1, 0] += reach * m[2]
            inner[1, 2] -= reach * m[0]
            inner[2, 0] -= reach * m[1]
            inner[2, 1] += reach * m[0]
            other = work.rotation[start + k]
            for a in range(3):
                for c in range(3):
                    right[a, c] = (
                        inner[a, 0] * other[0, c] + inner[a, 1] * other[1, c]
                        + inner[a, 2] * other[2, c]
                    )  # fmt: skip
            further = h * tables.to_end[i, k]
            row, column = (start + i) * strains, (start + k) * strains
            for a in range(3):
                for c in range(3):
                    work.jacobian[row + a, column + c] = -(
                        turn[0, a] * right[0, c] + turn[1, a] * right[1, c]
                        + turn[2, a] * right[2, c]
                    )  # fmt: skip
                for c in range(strains - 3):
                    work.jacobian[row + a, column + 3 + c] = -further * (
                        turn[0, a] * across[k, c, 0] + turn[1, a] * across[k, c, 1]
                        + turn[2, a] * across[k, c, 2]
                    )  # fmt: skip
            for a in range(strains - 3):
                for c in range(3):
                    work.jacobian[row + 3 + a, column + c] = -reach * (
                        across[i, a, 0] * other[0, c] + across[i, a, 1] * other[1, c]
                        + across[i, a, 2] * other[2, c]
                    )  # fmt: skip
                for c in range(strains - 3):
                    work.jacobian[row + 3 + a, column + 3 + c] = 0.0
        for a in range(strains):
            for c in range(strains):
                work.jacobian[(start + i) * strains + a, (start + i) * strains + c] += (
                    work.hessian[start + i, a, c]
                )


# The paper's models ----------------------------------------------------------------------------


@_compiled
def paper_twists(
    tables: PaperTables, sums: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Twists of cross sections that balance their tendons as in the paper, see `paper_equations`.

    From ``sums`` (A, 7, P) over the tendons of A arms at P places. Where moments are not in
    balance, equation (10) is swept until its solution changes by less than ``tolerance`` times
    the largest moment in the arm.

    Returns:
        Twists (A, P, 4), and of each arm that change, the most sweeps in an element, and the
        element that did not converge, or -1, (A, 3).
    """
    arms, places = sums.shape[0], sums.shape[2]
    twist, outcome, p = np.empty((arms, places, 4)), np.zeros((arms, 3)), np.zeros((3, places))
    stiffness = tables.stiffness
    for arm in range(arms):
        outcome[arm, 2] = -1.0
        own = sums[arm]
        if tables.swept:
            _imbalances(tables, own, tolerance, p, outcome[arm])
        for i in range(places):
            n, b, nn, bb, mixed = own[1, i], own[2, i], own[3, i], own[4, i], own[5, i]
            about_n, about_b = stiffness[2, i] + bb, stiffness[2, i] + nn
            moment_n, moment_b = p[1, i] - b, p[2, i] + n
            over = 1.0 / (about_n * about_b - mixed * mixed)
            xi = (about_b * moment_n + mixed * moment_b) * over
            k = (about_n * moment_b + mixed * moment_n) * over
            stretch = (k * n - xi * b - own[0, i]) / stiffness[0, i] + 1.0
            tau = (p[0, i] - own[6, i]) / (stiffness[1, i] + (nn + bb))
            twist[arm, i, 0], twist[arm, i, 1] = tau * stretch, xi * stretch
            twist[arm, i, 2], twist[arm, i, 3] = k * stretch, stretch
    return twist, outcome


@_compiled
def _imbalances(
    tables: PaperTables, sums: FloatArray, tolerance: float, p: FloatArray, outcome: FloatArray
) -> None:
    """Fill in the imbalance p (3, P) [N m] of one arm at nodes and stations."""
    points, stations = tables.backwards.shape[1], tables.stations
    largest = 1e-300
    for i in range(stations.between.shape[1]):
        largest = max(largest, abs(sums[1, i]), abs(sums[2, i]))
    end, room, slopes = np.zeros(3), np.empty((3, points + 1)), np.empty((7, points))
    for e in range(tables.swept - 1, -1, -1):
        at, first = tables.anchorage[e], e * points
        if at >= 0:
            _jump(tables.stiffness[:, at], sums[:, at], sums[:, at + 1], end)
        _slope_coefficients(tables.stiffness, sums, first, slopes)
        change, count = _sweep(tables, e, slopes, tolerance * largest, end, room)
        if outcome[2] < 0.0 and not change <= tolerance * largest:
            outcome[2] = e
        if not change / largest <= outcome[0]:
            outcome[0] = change / largest
        outcome[1] = max(outcome[1], count)
        for c in range(3):
            for i in range(points):
                p[c, first + i] = room[c, i]
            end[c] = room[c, points]
    nodes = stations.between.shape[1]
    for at in range(stations.element.size):
        first = stations.element[at] * points
        for c in range(3):
            value = 0.0
            if first < tables.swept * points:
                for i in range(first, first + points):
                    value += stations.between[at, i] * p[c, i]
            p[c, nodes + at] = value


@_inlined
def _jump(stiffness: FloatArray, base: FloatArray, tip: FloatArray, p: FloatArray) -> None:
    """Imbalance at the side of an anchorage to the base by (11), from that at the other."""
    for c in range(3):
        k = stiffness[1] if c == 0 else stiffness[2]
        f, d = _moment(base, c)
        f_tip, d_tip = _moment(tip, c)
        omega = (f_tip + p[c]) / (k + d_tip) + (f - f_tip) / (k + (d - d_tip))
        p[c] = omega * (k + d) - f


@_inlined
def _moment(sums: FloatArray, c: int) -> tuple[float, float]:
    """Component ``c`` of F and of the diagonal of D, see `paper_equations`."""
    if c == 0:
        return 0.0, sums[3] + sums[4]
    return (-sums[2], sums[4]) if c == 1 else (sums[1], sums[3])


@_compiled
def _slope_coefficients(
    stiffness: FloatArray, sums: FloatArray, first: int, out: FloatArray
) -> None:
    """Coefficients (7, p) of p' in the element of nodes from ``first`` on."""
    for i in range(out.shape[1]):
        torsion, bending = stiffness[1, first + i], stiffness[2, first + i]
        n, b = sums[1, first + i], sums[2, first + i]
        nn, bb = sums[3, first + i], sums[4, first + i]
        c_t, c_n, c_b = 1.0 / (torsion + (nn + bb)), 1.0 / (bending + bb), 1.0 / (bending + nn)
        xi, k, c = -c_n * b, c_b * n, (bending + (nn + bb)) * c_t
        out[0, i], out[1, i], out[2, i] = xi, k, (bb - nn) * c_n * c_b
        out[3, i], out[4, i] = -c * k, c * xi
        out[5, i], out[6, i] = -bb * c_t * c_b, nn * c_t * c_n


@_compiled
def _sweep(
    tables: PaperTables, e: int, slopes: FloatArray, allowed: float, end: FloatArray,
    p: FloatArray,
) -> tuple[float, int]:  # fmt: skip
    """Imbalance p (3, p + 1) at the points and the start of an element, from that at its end.

    Returns:
        Its last change [N m] and the number of sweeps.
    """
    points = slopes.shape[1]
    rate, aside = np.empty(points), np.empty((2, points))
    for c in range(3):
        p[c] = end[c]
    change, count = np.inf, 0
    while not (change <= allowed and count % SWEEPS_A_CHECK == 0) and count < MOST_PAPER_SWEEPS:
        count += 1
        for i in range(points):
            n, b = p[1, i], p[2, i]
            rate[i] = (slopes[2, i] * b + slopes[1, i]) * n - slopes[0, i] * b
        change = _integrate_back(tables, e, rate, end[0], p[0])
        for i in range(points):
            aside[0, i] = (slopes[5, i] * p[2, i] + slopes[3, i]) * p[0, i]
            aside[1, i] = (slopes[6, i] * p[1, i] + slopes[4, i]) * p[0, i]
        for c in range(2):
            moved = _integrate_back(tables, e, aside[c], end[1 + c], p[1 + c])
            if not moved <= change:
                change = moved
    return change, count


@_inlined
def _integrate_back(
    tables: PaperTables, e: int, rate: FloatArray, end: float, p: FloatArray
) -> float:
    """``p`` (p + 1,) from its ``rate`` at the points of an element and its ``end``; the change."""
    change = 0.0
    for i in range(p.size):
        value = 0.0
        for k in range(rate.size):
            value += tables.backwards[i, k] * rate[k]
        value = end - tables.lengths[e] * value
        moved = abs(value - p[i])
        if not moved <= change:
            change = moved
        p[i] = value
    return change
