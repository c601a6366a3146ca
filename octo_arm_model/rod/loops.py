"""The node functions as loops, compiled by numba; `arrays` has the same functions for NumPy.

They take `Tables` and `Work`, the twists z (N, m), ``tensions`` (N, J) [N], and the ``force`` and
the free moment ``couple`` of all loads beyond each node, (N, 3) in base_frame. Those of cross
sections, with their equations, are in `section_loops`. Compiled functions get only the arrays that
they need, because numba takes up to a microsecond for every field of a named tuple.
"""

import numpy as np

from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.rod.angle_loops import angles
from octo_arm_model.rod.compiled import compiled, helper, inlined
from octo_arm_model.rod.inertia_loops import moving_loads
from octo_arm_model.rod.paper_loops import paper_twists
from octo_arm_model.rod.section_loops import add_gradients, balance, cross, sections
from octo_arm_model.rod.tables import OF_BENDS, OF_DIRECTIONS, Places, Tables, Work

# The node functions of `forms.Form`.
__all__ = [
    'add_gradients',
    'angles',
    'balance',
    'jacobian',
    'moving_loads',
    'orientations',
    'paper_twists',
    'poses',
    'sections',
    'wrenches',
]

_MOST_SWEEPS = 80  # over the orientations of an element
_ROUNDING = 2e-13  # change in the last sweep; the error that is left is a thirtieth of it


# Orientations ----------------------------------------------------------------------------------


def orientations(tables: Tables, z: FloatArray, work: Work) -> None:
    """Compute orientation and r' of every node: q' = q (0, kappa) / 2, collocated by element.

    Several times as many nodes as in the tables are several arms, one after the other.
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
        units = quaternion[start : start + points]
        _collocate(first, z[start : start + points], 0.5 * lengths[e], to_point, rate, units)
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
    unit: FloatArray,
) -> None:
    """Compute the quaternions ``unit`` (p, 4) of an element, from its ``first``, and their rates.

    Gauss-Seidel sweeps from the start to the end, until they converge: each point takes the rates
    of earlier points from this sweep and of later ones from the last, and solves for its own.
    """
    points = z.shape[0]
    rate[:] = 0.0
    unit[:] = 0.0
    for _ in range(_MOST_SWEEPS):
        change = 0.0
        for i in range(points):
            w, x, y, b = first[0], first[1], first[2], first[3]
            # The point before comes last, so that the other sums need not wait for it.
            for k in range(i + 1, points):
                weight = to_point[i, k]
                w += weight * rate[k, 0]
                x += weight * rate[k, 1]
                y += weight * rate[k, 2]
                b += weight * rate[k, 3]
            for k in range(i):
                weight = to_point[i, k]
                w += weight * rate[k, 0]
                x += weight * rate[k, 1]
                y += weight * rate[k, 2]
                b += weight * rate[k, 3]
            p, q, r, diagonal = half * z[i, 0], half * z[i, 1], half * z[i, 2], to_point[i, i]
            square = p * p + q * q + r * r
            inverse = 1.0 / (1.0 + diagonal * diagonal * square)
            turn_w, turn_x = -(x * p + y * q + b * r), w * p + y * r - b * q
            turn_y, turn_b = w * q + b * p - x * r, w * r + x * q - y * p
            back = diagonal * square
            rate[i, 0], rate[i, 1] = (turn_w - back * w) * inverse, (turn_x - back * x) * inverse
            rate[i, 2], rate[i, 3] = (turn_y - back * y) * inverse, (turn_b - back * b) * inverse
            w, x = (w + diagonal * turn_w) * inverse, (x + diagonal * turn_x) * inverse
            y, b = (y + diagonal * turn_y) * inverse, (b + diagonal * turn_b) * inverse
            difference = abs(w - unit[i, 0]) + abs(x - unit[i, 1]) + abs(y - unit[i, 2])
            change = max(change, difference + abs(b - unit[i, 3]))
            unit[i, 0], unit[i, 1], unit[i, 2], unit[i, 3] = w, x, y, b
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
    """Normalise the quaternions of nodes, and compute their rotation matrices and r'."""
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
    """Compute the poses of places by integrals of r' and q' from the base.

    `orientations` of the same z must come before.

    Returns:
        Of A arms, positions from the base (A, S, 3) [m], orientations x, y, z, w (A, S, 4), and
        the estimated error of positions over the length of the arm (A,).
    """
    arms = z.shape[0] // places.integration.shape[1]
    position, quaternion = np.empty((2, arms, places.element.size, 4))
    error = np.empty(arms)
    rule = tables.lengths, tables.weights
    of_places = places.element, places.integration, places.tail
    nodes = z, work.slope, work.quaternion
    _fill_poses(rule, tables.base, of_places, nodes, position, quaternion, error)
    return position[..., :3], quaternion, error


@compiled
def _fill_poses(
    rule: tuple[FloatArray, FloatArray],
    base: FloatArray,
    places: tuple[IntArray, FloatArray, FloatArray],
    node_arrays: tuple[FloatArray, FloatArray, FloatArray],
    position: FloatArray,
    quaternion: FloatArray,
    error: FloatArray,
) -> None:
    (lengths, weights), (element, integration, tail) = rule, places
    z, slopes, quaternions = node_arrays
    nodes, elements, points = integration.shape[1], lengths.size, tail.shape[1]
    # Position and quaternion: their rates, and their values at starts of elements and at a place.
    rate, at_starts, at_place = np.empty((nodes, 7)), np.zeros((elements + 1, 7)), np.empty(7)
    for c in range(4):
        at_starts[0, 3 + c] = base[c]
    for arm in range(error.size):
        start = arm * nodes
        slope, twists = slopes[start : start + nodes], z[start : start + nodes]
        _rates(slope, quaternions[start : start + nodes], twists, rate)
        for e in range(elements):
            _advance(at_starts[e], weights, rate, e * points, points, at_starts[e + 1])
        for place in range(element.size):
            e = element[place]
            _advance(at_starts[e], integration[place], rate, e * points, points, at_place)
            _normalise(at_place[3:])
            for c in range(3):
                position[arm, place, c], quaternion[arm, place, c] = at_place[c], at_place[4 + c]
            quaternion[arm, place, 3] = at_place[3]
        error[arm] = _position_error(lengths, tail, twists, slope)


@helper
def _rates(slope: FloatArray, quaternion: FloatArray, z: FloatArray, rate: FloatArray) -> None:
    """Compute r' and q' of nodes, (N, 7)."""
    for i in range(z.shape[0]):
        q, row = quaternion[i], rate[i]
        w, x, y, b = 0.5 * q[0], 0.5 * q[1], 0.5 * q[2], 0.5 * q[3]
        p, q, r = z[i, 0], z[i, 1], z[i, 2]
        for c in range(3):
            row[c] = slope[i, c]
        row[3], row[4] = -(x * p + y * q + b * r), w * p + y * r - b * q
        row[5], row[6] = w * q + b * p - x * r, w * r + x * q - y * p


@inlined
def _advance(
    start: FloatArray,
    weights: FloatArray,
    rate: FloatArray,
    first: int,
    count: int,
    out: FloatArray,
) -> None:
    """Compute ``start`` plus the integral over ``count`` nodes from the ``first`` on."""
    for c in range(7):
        out[c] = start[c]
    for i in range(first, first + count):
        for c in range(7):
            out[c] += weights[i] * rate[i, c]


@helper
def _position_error(
    lengths: FloatArray, tail: FloatArray, z: FloatArray, slope: FloatArray
) -> float:
    """Return the estimate of `tables.position_errors` for one arm."""
    points, error, total = tail.shape[1], 0.0, 0.0
    for length in lengths:
        total += length
    for e in range(lengths.size):
        bend = direction = 0.0
        for row in range(2):
            for c in range(3):
                bend_term = direction_term = 0.0
                for k in range(points):
                    bend_term += tail[row, k] * z[e * points + k, c]
                    direction_term += tail[row, k] * slope[e * points + k, c]
                # These comparisons keep NaN, which `max` would drop.
                if not (bend_term * bend_term <= bend or bend != bend):
                    bend = bend_term * bend_term
                if not (direction_term * direction_term <= direction or direction != direction):
                    direction = direction_term * direction_term
        error += OF_BENDS * lengths[e] ** 2 * bend
        error += OF_DIRECTIONS * lengths[e] / total * direction
    return error


# The whole arm ---------------------------------------------------------------------------------


def wrenches(tables: Tables, force: FloatArray, couple: FloatArray, work: Work) -> None:
    """Compute minus the wrench of all loads beyond each section: the residual without gradient.

    Moment and force are in the axes of the section. `orientations` must come before.
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
    points = to_end.shape[0]
    beyond, rate = np.zeros(3), np.empty((points, 3))
    # M = M_free + the integral of r' x F from the node to the tip.
    for e in range(lengths.size - 1, -1, -1):
        start, h = e * points, lengths[e]
        for k in range(points):
            cross(slope[start + k], force[start + k], rate[k])
        for i in range(points):
            for c in range(3):
                integral = 0.0
                for k in range(points):
                    integral += to_end[i, k] * rate[k, c]
                moment[start + i, c] = couple[start + i, c] + beyond[c] + h * integral
        for k in range(points):
            for c in range(3):
                beyond[c] += weights[start + k] * rate[k, c]
    for i in range(moment.shape[0]):
        _minus_components(rotation[i], moment[i], residual[i, :3])
        _minus_components(rotation[i], force[i], residual[i, 3:])


@inlined
def _minus_components(axes: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """Compute minus the components of a ``vector`` along the first columns of a rotation."""
    for c in range(out.size):
        out[c] = -(axes[0, c] * vector[0] + axes[1, c] * vector[1] + axes[2, c] * vector[2])


def jacobian(
    tables: Tables, z: FloatArray, tensions: FloatArray, force: FloatArray, work: Work
) -> None:
    """Compute the derivative of the residual by z for a fixed ``force``, after `add_gradients`.

    With X = r' F^T - (F . r') 1 and S its integral from a node to the tip, the block of nodes i
    and k is -R_i^T (S_i + M_i x) w_k R_k if the element of k is before that of i, and
    -R_i^T w_k S_k R_k if it is beyond. Within an element C_ik = sum over m of B_im X_m G_mk takes
    the place of S. The column of the stretch of k is R_i^T (F_k x t_k) B_ik.
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
    # X; and the rows of R^T, followed by t x F and the same for shear.
    lever, axes = np.empty((count, 9)), np.empty((count, strains, 3))
    _levers(slope, rotation, force, lever, axes)
    # Factors of the blocks of nodes i and k in different elements: of the row i where k is before
    # it, of the column k for rows of elements beyond it, and for rows of those before it.
    row_side, base_side = np.zeros((count, strains, 3)), np.zeros((3, count * strains))
    tip_side = np.zeros((3, count * strains))
    beyond, tail, changes = np.zeros(9), np.empty(9), np.zeros((2, 3))
    for e in range(lengths.size - 1, -1, -1):
        start, h = e * points, lengths[e]
        for i in range(start, start + points):
            for c in range(9):
                tail[c] = beyond[c]
            for k in range(points):
                for c in range(9):
                    tail[c] += h * to_end[i - start, k] * lever[start + k, c]
            _sides(weights[i], tail, moment[i], axes[i], row_side[i], i, base_side, tip_side)
        _element_blocks(
            (h, weights[start : start + points]),
            rule,
            beyond,
            lever[start : start + points],
            moment[start : start + points],
            axes[start : start + points],
            start * strains,
            tail,
            changes,
            jacobian,
        )
        for k in range(start, start + points):
            for c in range(9):
                beyond[c] += weights[k] * lever[k, c]
    _coupling_blocks(points * strains, row_side, axes, base_side, tip_side, jacobian)
    for i in range(count):
        for a in range(strains):
            for c in range(strains):
                jacobian[i * strains + a, i * strains + c] += hessian[i, a, c]


@helper
def _levers(
    slope: FloatArray, rotation: FloatArray, force: FloatArray, lever: FloatArray, axes: FloatArray
) -> None:
    for i in range(slope.shape[0]):
        r, f, matrix, rows = slope[i], force[i], rotation[i], axes[i]
        product = r[0] * f[0] + r[1] * f[1] + r[2] * f[2]
        for a in range(3):
            for c in range(3):
                lever[i, 3 * a + c] = r[a] * f[c]
                rows[a, c] = matrix[c, a]
            lever[i, 4 * a] -= product
        for a in range(3, rows.shape[0]):
            cross(rows[a - 3], f, rows[a])


@inlined
def _add_cross(part: float, m: FloatArray, out: FloatArray) -> None:
    """Add ``part`` times the matrix (9,) of the cross product with ``m``."""
    x, y, b = part * m[0], part * m[1], part * m[2]
    out[1] -= b
    out[2] += y
    out[3] += b
    out[5] -= x
    out[6] -= y
    out[7] += x


@inlined
def _times(matrix: FloatArray, vector: FloatArray, factor: float, out: FloatArray) -> None:
    """Compute a matrix (9,) times a vector, times a ``factor``."""
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
    row_side: FloatArray,
    i: int,
    base_side: FloatArray,
    tip_side: FloatArray,
) -> None:
    """Compute the factors of the blocks of node ``i``; ``tail`` is S, which is overwritten."""
    strains, side = axes.shape[0], row_side  # which is filled in below
    for a in range(strains):
        if a < 3:
            _times(tail, axes[a], weight, side[a])
        for c in range(3):
            if a < 3:
                base_side[c, i * strains + a] = weight * axes[a, c]
            else:
                side[a, c] = weight * axes[a, c]
            tip_side[c, i * strains + a] = side[a, c]
    _add_cross(1.0, moment, tail)
    for a in range(strains):
        for c in range(3):
            row_side[a, c] = axes[a, c]
            if a < 3:
                row_side[a, c] = (
                    axes[a, 0] * tail[c] + axes[a, 1] * tail[3 + c] + axes[a, 2] * tail[6 + c]
                )


@helper
def _element_blocks(
    lengths: tuple[float, FloatArray],
    rule: tuple[FloatArray, FloatArray, FloatArray],
    beyond: FloatArray,
    lever: FloatArray,
    moment: FloatArray,
    axes: FloatArray,
    first: int,
    lever_sum: FloatArray,
    changes: FloatArray,
    out: FloatArray,
) -> None:
    """Compute the blocks of nodes of one element, from row and column ``first`` on.

    They lack the Hessians of sections. ``beyond`` is the integral of X beyond the element;
    ``lever_sum`` (9,) and ``changes`` (2, 3) are buffers.
    """
    h, weights = lengths
    to_point, to_end, twice = rule
    points, strains = axes.shape[0], axes.shape[1]
    # Changes of the moment at i and of the tangent there by a strain of k.
    moment_change, tangent_change = changes[0], changes[1]
    for i in range(points):
        for k in range(points):
            from_start, to_tip = h * to_point[i, k], h * to_end[i, k]
            for c in range(9):
                total = 0.0
                for n in range(points):
                    total += twice[i, k, n] * lever[n, c]
                lever_sum[c] = h * h * total + weights[k] * beyond[c]
            _add_cross(from_start, moment[i], lever_sum)
            for c in range(strains):
                if c < 3:
                    _times(lever_sum, axes[k, c], 1.0, moment_change)
                for n in range(3):
                    if c >= 3:
                        moment_change[n] = to_tip * axes[k, c, n]
                    tangent_change[n] = from_start * axes[k, c, n] if c < 3 else 0.0
                for a in range(strains):
                    d = moment_change if a < 3 else tangent_change
                    out[first + i * strains + a, first + k * strains + c] = -(
                        axes[i, a, 0] * d[0] + axes[i, a, 1] * d[1] + axes[i, a, 2] * d[2]
                    )


@helper
def _coupling_blocks(
    size: int,
    row_side: FloatArray,
    axes: FloatArray,
    base_side: FloatArray,
    tip_side: FloatArray,
    out: FloatArray,
) -> None:
    """Compute the blocks of nodes of different elements, which have ``size`` rows each."""
    strains = axes.shape[1]
    for number in range(out.shape[0]):
        i, a, row, first = number // strains, number % strains, out[number], number // size * size
        p, q, r = row_side[i, a, 0], row_side[i, a, 1], row_side[i, a, 2]
        for k in range(first):
            row[k] = -(p * base_side[0, k] + q * base_side[1, k] + r * base_side[2, k])
        p, q, r = axes[i, a, 0], axes[i, a, 1], axes[i, a, 2]
        if a >= 3:
            p = q = r = 0.0
        for k in range(first + size, row.size):
            row[k] = -(p * tip_side[0, k] + q * tip_side[1, k] + r * tip_side[2, k])
