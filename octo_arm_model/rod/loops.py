"""The node functions as loops, compiled by numba; `arrays` has the same for NumPy.

All take `Tables` and `Work`; z is (N, m), ``tensions`` (N, J) [N], ``force`` and ``couple`` the
force and the free moment of all that acts beyond each node, (N, 3) in base_frame. Those of cross
sections, with their equations, are in `section_loops`. Each gives what is compiled the arrays that
this needs alone, as numba takes up to a microsecond for every field of a tuple with names.
"""

import numpy as np

from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.rod.angle_loops import angles
from octo_arm_model.rod.compiled import compiled, helper, inlined
from octo_arm_model.rod.inertia_loops import imbalance, moving_loads
from octo_arm_model.rod.paper_loops import paper_twists
from octo_arm_model.rod.section_loops import add_gradients, balance, cross, sections
from octo_arm_model.rod.tables import OF_BENDS, OF_DIRECTIONS, Places, Tables, Work

# The node functions, see `forms.Form`.
__all__ = [
    'angles',
    'balance',
    'imbalance',
    'jacobian',
    'moving_loads',
    'orientations',
    'paper_twists',
    'poses',
    'residual',
    'sections',
    'wrenches',
]

_MOST_SWEEPS = 80  # of orientations
_ROUNDING = 2e-13  # change by a sweep, which leaves a thirtieth of it


# Orientations ----------------------------------------------------------------------------------


def orientations(tables: Tables, z: FloatArray, work: Work) -> None:
    """Orientation and r' of every node: q' = q (0, kappa) / 2 collocated in each element.

    Of several arms where there are several times as many nodes.
    """
    rule = tables.lengths, tables.weights, tables.to_point
    _fill_orientations(rule, tables.base, z, work.quaternion, work.rotation, work.slope)


@compiled
def _fill_orientations(
    rule: tuple[FloatArray, FloatArray, FloatArray],
    base: FloatArray,
    z: FloatArray,
    quaternion: FloatArray,
    rotation: FloatArray,
    slope: FloatArray,
) -> None:
    lengths, weights, to_point = rule
    elements, points = lengths.size, to_point.shape[0]
    rate, first = np.empty((points, 4)), np.empty(4)
    for number in range(z.shape[0] // points):
        start, e = number * points, number % elements
        if e == 0:
            for c in range(4):
                first[c] = base[c]
        own = quaternion[start : start + points]
        _collocate(first, z[start : start + points], 0.5 * lengths[e], to_point, rate, own)
        for k in range(points):
            for c in range(4):
                first[c] += weights[k] / lengths[0] * rate[k, c]
        _normalise(first)
    _orient(z, quaternion, rotation, slope)


@helper
def _collocate(
    first: FloatArray,
    z: FloatArray,
    half: float,
    to_point: FloatArray,
    rate: FloatArray,
    now: FloatArray,
) -> None:
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
            inverse = 1.0 / (1.0 + own * own * square)
            turn_w, turn_x = -(x * p + y * q + b * r), w * p + y * r - b * q
            turn_y, turn_b = w * q + b * p - x * r, w * r + x * q - y * p
            back = own * square
            rate[i, 0], rate[i, 1] = (turn_w - back * w) * inverse, (turn_x - back * x) * inverse
            rate[i, 2], rate[i, 3] = (turn_y - back * y) * inverse, (turn_b - back * b) * inverse
            w, x = (w + own * turn_w) * inverse, (x + own * turn_x) * inverse
            y, b = (y + own * turn_y) * inverse, (b + own * turn_b) * inverse
            moved = abs(w - now[i, 0]) + abs(x - now[i, 1]) + abs(y - now[i, 2])
            change = max(change, moved + abs(b - now[i, 3]))
            now[i, 0], now[i, 1], now[i, 2], now[i, 3] = w, x, y, b
        if not change > _ROUNDING:
            break


@inlined
def _normalise(q: FloatArray) -> None:
    inverse = 1.0 / np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for c in range(4):
        q[c] *= inverse


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


def poses(
    tables: Tables, z: FloatArray, places: Places, work: Work
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where places are, by integrals of r' and q' from the base, and how well this is resolved.

    After `orientations` of the same z.

    Returns:
        Positions from the base (A, S, 3) [m], orientations x, y, z, w (A, S, 4) and the estimated
        error of positions over the length of the arm (A,), of A arms.
    """
    arms = z.shape[0] // places.integration.shape[1]
    position, quaternion = np.empty((2, arms, places.element.size, 4))
    error = np.empty(arms)
    rule, at = (tables.lengths, tables.weights), (places.element, places.integration, places.tail)
    nodes = z, work.slope, work.quaternion
    _fill_poses(rule, tables.base, at, nodes, position, quaternion, error)
    return position[..., :3], quaternion, error


@compiled
def _fill_poses(
    rule: tuple[FloatArray, FloatArray],
    base: FloatArray,
    places: tuple[IntArray, FloatArray, FloatArray],
    of_nodes: tuple[FloatArray, FloatArray, FloatArray],
    position: FloatArray,
    quaternion: FloatArray,
    error: FloatArray,
) -> None:
    (lengths, weights), (element, integration, tail) = rule, places
    z, slopes, quaternions = of_nodes
    nodes, elements, points = integration.shape[1], lengths.size, tail.shape[1]
    # Of x, y, z, position and quaternion: rates, at the starts of elements, and at a place.
    rate, reached, now = np.empty((nodes, 7)), np.zeros((elements + 1, 7)), np.empty(7)
    for c in range(4):
        reached[0, 3 + c] = base[c]
    for arm in range(error.size):
        first = arm * nodes
        slope, own = slopes[first : first + nodes], z[first : first + nodes]
        _rates(slope, quaternions[first : first + nodes], own, rate)
        for e in range(elements):
            _advance(reached[e], weights, rate, e * points, points, reached[e + 1])
        for at in range(element.size):
            e = element[at]
            _advance(reached[e], integration[at], rate, e * points, points, now)
            _normalise(now[3:])
            for c in range(3):
                position[arm, at, c], quaternion[arm, at, c] = now[c], now[4 + c]
            quaternion[arm, at, 3] = now[3]
        error[arm] = _position_error(lengths, tail, own, slope)


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
    start: FloatArray,
    weights: FloatArray,
    rate: FloatArray,
    first: int,
    count: int,
    out: FloatArray,
) -> None:
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
    """See `tables.position_errors`, of one arm."""
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
                if not (of_bend * of_bend <= bend or bend != bend):
                    bend = of_bend * of_bend
                if not (of_direction * of_direction <= direction or direction != direction):
                    direction = of_direction * of_direction
        error += OF_BENDS * lengths[e] ** 2 * bend
        error += OF_DIRECTIONS * lengths[e] / whole * direction
    return error


# The whole arm ---------------------------------------------------------------------------------


def residual(
    tables: Tables,
    z: FloatArray,
    tensions: FloatArray,
    force: FloatArray,
    couple: FloatArray,
    work: Work,
) -> float:
    """Imbalance of every cross section, after `orientations` of the same z.

    Fills in all but Hessian and Jacobian; ``work.scale`` is given, see `tables.force_scale`.

    Returns:
        Largest residual over its scale and the largest wrench along the arm [-]; NaN where a
        strain is impossible.
    """
    wrenches(tables, force, couple, work)
    return add_gradients(tables, z, tensions, work)


def wrenches(tables: Tables, force: FloatArray, couple: FloatArray, work: Work) -> None:
    """Minus what all beyond exerts on every cross section, as its residual without its gradient.

    Moment and force in the axes of the section, after `orientations`.
    """
    rule = tables.lengths, tables.weights, tables.to_end
    _fill_wrenches(rule, work.rotation, work.slope, force, couple, work.moment, work.residual)


@compiled
def _fill_wrenches(
    rule: tuple[FloatArray, FloatArray, FloatArray],
    rotation: FloatArray,
    slope: FloatArray,
    force: FloatArray,
    couple: FloatArray,
    moment: FloatArray,
    residual: FloatArray,
) -> None:
    lengths, weights, to_end = rule
    _moments(lengths, weights, to_end, slope, force, couple, moment)
    for i in range(moment.shape[0]):
        _turn_back(rotation[i], moment[i], residual[i, :3])
        _turn_back(rotation[i], force[i], residual[i, 3:])


@inlined
def _turn_back(turn: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """Minus the components of a ``vector`` along the first columns of a rotation."""
    for c in range(out.size):
        out[c] = -(turn[0, c] * vector[0] + turn[1, c] * vector[1] + turn[2, c] * vector[2])


@helper
def _moments(
    lengths: FloatArray,
    weights: FloatArray,
    to_end: FloatArray,
    slope: FloatArray,
    force: FloatArray,
    couple: FloatArray,
    moment: FloatArray,
) -> None:
    """M = M_free + integral to the tip of r' x F."""
    points = to_end.shape[0]
    beyond, rate = np.zeros(3), np.empty((points, 3))
    for e in range(lengths.size - 1, -1, -1):
        start, h = e * points, lengths[e]
        for k in range(points):
            cross(slope[start + k], force[start + k], rate[k])
        for i in range(points):
            for c in range(3):
                value = 0.0
                for k in range(points):
                    value += to_end[i, k] * rate[k, c]
                moment[start + i, c] = couple[start + i, c] + beyond[c] + h * value
        for k in range(points):
            for c in range(3):
                beyond[c] += weights[start + k] * rate[k, c]


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
    rule = tables.to_point, tables.to_end, tables.twice
    of_nodes = work.slope, work.rotation, work.moment
    _fill_jacobian(
        (tables.lengths, tables.weights), rule, force, of_nodes, work.hessian, work.jacobian
    )


@compiled
def _fill_jacobian(
    sizes: tuple[FloatArray, FloatArray],
    rule: tuple[FloatArray, FloatArray, FloatArray],
    force: FloatArray,
    of_nodes: tuple[FloatArray, FloatArray, FloatArray],
    hessian: FloatArray,
    jacobian: FloatArray,
) -> None:
    (lengths, weights), (_, to_end, _), (slope, rotation, moment) = sizes, rule, of_nodes
    count, strains, points = hessian.shape[0], hessian.shape[1], to_end.shape[0]
    # X, and rows of R^T, then t x F and what shear has of it.
    lever, axes = np.empty((count, 9)), np.empty((count, strains, 3))
    _levers(slope, rotation, force, lever, axes)
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
            (h, weights[start : start + points]),
            rule,
            beyond,
            lever[start : start + points],
            moment[start : start + points],
            axes[start : start + points],
            start * strains,
            jacobian,
        )
        for k in range(start, start + points):
            for c in range(9):
                beyond[c] += weights[k] * lever[k, c]
    _other_elements(points * strains, left, axes, base_side, tip_side, jacobian)
    for i in range(count):
        for a in range(strains):
            for c in range(strains):
                jacobian[i * strains + a, i * strains + c] += hessian[i, a, c]


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
            cross(own[a - 3], f, own[a])


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
            matrix[3 * c] * vector[0]
            + matrix[3 * c + 1] * vector[1]
            + matrix[3 * c + 2] * vector[2]
        )


@helper
def _sides(
    weight: float,
    tail: FloatArray,
    moment: FloatArray,
    axes: FloatArray,
    left: FloatArray,
    i: int,
    base_side: FloatArray,
    tip_side: FloatArray,
) -> None:
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
    lengths: tuple[float, FloatArray],
    rule: tuple[FloatArray, FloatArray, FloatArray],
    beyond: FloatArray,
    lever: FloatArray,
    moment: FloatArray,
    axes: FloatArray,
    first: int,
    out: FloatArray,
) -> None:
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
    size: int,
    left: FloatArray,
    axes: FloatArray,
    base_side: FloatArray,
    tip_side: FloatArray,
    out: FloatArray,
) -> None:
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
