"""The node functions over whole arrays for NumPy; `loops` has them for numba, with equations.

Names, arguments and tables are those of `loops`. Indices: i, k, m nodes, a, c components, j
tendons, e elements. The functions of cross sections are in `section_arrays`.
"""

import numpy as np

from octo_arm_model.arm.hints import ComplexArray, FloatArray, Numbers
from octo_arm_model.rod.rotations import dot, quaternion_rates, rotation_matrices
from octo_arm_model.rod.section_arrays import (
    LAST,
    NEXT,
    angles,
    balance,
    cross,
    gradients,
    relative_residual,
    sections,
)
from octo_arm_model.rod.section_formulas import paper_jump, paper_moments, paper_slope, paper_twist
from octo_arm_model.rod.tables import (
    POSITION,
    ROTARY_B,
    ROTARY_N,
    TANGENT,
    Motion,
    MotionTables,
    PaperTables,
    Places,
    Tables,
    TimeRule,
    Work,
    position_errors,
)

# The node functions, see `forms.Form`.
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

XYZW = np.array([1, 2, 3, 0])  # of a quaternion w, x, y, z


# Orientations ----------------------------------------------------------------------------------


def orientations(tables: Tables, z: FloatArray, work: Work) -> None:
    """Compute orientation and r' of every node: q' = q (0, kappa) / 2, collocated in elements.

    A quaternion is a + b j; the equations are linear in (a, b).
    """
    points, elements = tables.to_point.shape[0], tables.lengths.size
    half = z[:, :3].reshape(-1, elements, points, 3) * (0.5 * tables.lengths)[:, None, None]
    arms = len(half)
    half = half.reshape(-1, points, 3)
    # Rate of (a, b) of an element of length one by its row of [[i t, -c*], [c, -i t]], where c is
    # n + i b: real and imaginary parts.
    rate = np.zeros((len(half), 2, 2, points, 2))
    rate[:, 0, 0, :, 1] = half[..., 0]
    rate[:, 1, 1, :, 1] = -half[..., 0]
    rate[:, 1, 0] = rate[:, 0, 1] = half[..., 1:]
    rate[:, 0, 1, :, 0] *= -1.0
    factors = rate.view(np.complex128)[..., 0]
    inside = _inside(tables, factors)
    weights = tables.weights[:points] / tables.lengths[0]
    last = (factors * inside[:, np.newaxis]).sum(axis=2) @ weights
    last[:, 0] += 1.0
    last /= np.sqrt((last.real**2 + last.imag**2).sum(axis=1, keepdims=True))
    first = np.empty((elements, 2, arms), np.complex128)
    a, b = complex(*tables.base[:2]), complex(*tables.base[2:])
    turns = last.reshape(arms, elements, 2).transpose(1, 2, 0)
    for e, (c_e, d_e) in enumerate(turns[..., 0].tolist() if arms == 1 else turns):
        first[e, 0], first[e, 1] = a, b
        a, b = a * c_e - b * d_e.conjugate(), a * d_e + b * c_e.conjugate()
    _orient(first.transpose(2, 0, 1).reshape(-1, 2), inside, z, work)


def _inside(tables: Tables, rate: ComplexArray) -> ComplexArray:
    """Return (a, b) at the points of elements relative to their starts, (e, 2, p)."""
    points = len(tables.to_point)
    system = np.multiply(-tables.to_point[:, np.newaxis], rate[:, :, np.newaxis], order='C')
    system.reshape(len(rate), -1)[:, :: 2 * points + 1] += 1.0
    right = np.zeros((len(rate), 2 * points, 1), np.complex128)
    right[:, :points] = 1.0
    solution = np.linalg.solve(system.reshape(-1, 2 * points, 2 * points), right)
    return np.asarray(solution).reshape(-1, 2, points)


def _orient(first: ComplexArray, inside: ComplexArray, z: FloatArray, work: Work) -> None:
    """Write the orientations, from those of the starts of elements and those inside them."""
    a, b = first[:, np.newaxis, 0], first[:, np.newaxis, 1]
    c, d = inside[:, 0], inside[:, 1]
    products = np.stack([a * c - b * d.conj(), a * d + b * c.conj()], axis=-1).reshape(len(z), 2)
    components = products.view(np.float64)
    components /= np.sqrt((components * components).sum(axis=1, keepdims=True))
    work.quaternion[:] = components
    work.rotation[:] = rotation_matrices(np.ascontiguousarray(components.T)).transpose(2, 0, 1)
    work.slope[:] = work.rotation[:, :, 0] * z[:, 3, np.newaxis]
    if z.shape[1] == 6:
        work.slope[:] += (work.rotation[:, :, 1:] @ z[:, 4:, np.newaxis])[..., 0]


# Poses -----------------------------------------------------------------------------------------


def poses(
    tables: Tables, z: FloatArray, places: Places, work: Work
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions and orientations at ``places``, and estimated errors of positions."""
    rates = np.empty((7, len(z)))
    rates[:3] = work.slope.T
    quaternion_rates(work.quaternion, z[:, :3], rates[3:].T)
    integrals = rates.reshape(-1, places.integration.shape[1]) @ places.integration.T
    integrals = integrals.reshape(7, -1, len(places.integration))
    quaternion = integrals[3:]
    quaternion += tables.base[:, np.newaxis, np.newaxis]
    quaternion /= np.sqrt((quaternion * quaternion).sum(axis=0))
    position = np.ascontiguousarray(integrals[:3].transpose(1, 2, 0))
    error = position_errors(places.tail, tables.lengths, z, work.slope)
    return position, quaternion.transpose(1, 2, 0).take(XYZW, axis=2), error


# The whole arm ---------------------------------------------------------------------------------


def wrenches(tables: Tables, force: FloatArray, couple: FloatArray, work: Work) -> None:
    """Compute minus the wrench from beyond every cross section, as residual."""
    elements, points = tables.lengths.size, tables.to_end.shape[0]
    rate = cross(work.slope, force)
    by_element = (tables.weights[:, np.newaxis] * rate).reshape(elements, points, 3).sum(axis=1)
    beyond = by_element[::-1].cumsum(axis=0)[::-1] - by_element
    inside = tables.to_end @ rate.reshape(elements, points, 3)
    inside *= tables.lengths[:, np.newaxis, np.newaxis]
    inside += beyond[:, np.newaxis]
    np.add(couple, inside.reshape(-1, 3), out=work.moment)
    axes_wrench = np.stack([work.moment, force], axis=1) @ work.rotation
    np.negative(axes_wrench.reshape(-1, 6)[:, : work.residual.shape[1]], out=work.residual)


def add_gradients(tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> float:
    """Add the gradients of the sections to the residual, and return its relative size."""
    wrench = work.residual.copy()
    gradients(tables, z, tensions, work)
    np.add(work.residual, work.gradient, out=work.residual)
    return relative_residual(wrench, work.scale, work)


def jacobian(
    tables: Tables, z: FloatArray, tensions: FloatArray, force: FloatArray, work: Work
) -> None:
    """Compute the derivative of the residual by z for a constant ``force`` (N, 3) [N]."""
    sections(tables, z, tensions, work)
    count, strains = z.shape
    elements, points = tables.lengths.size, tables.to_end.shape[0]
    lengths, weights = tables.lengths[:, np.newaxis, np.newaxis, np.newaxis], tables.weights
    lever = work.slope[:, :, np.newaxis] * force[:, np.newaxis]
    lever -= (work.slope * force).sum(axis=1)[:, np.newaxis, np.newaxis] * np.eye(3)
    by_element = lever.reshape(elements, points, 9)
    whole = (weights.reshape(elements, 1, points) @ by_element)[:, 0]
    beyond = (whole[::-1].cumsum(axis=0)[::-1] - whole).reshape(elements, 1, 3, 3)
    tail = (tables.to_end @ by_element).reshape(elements, points, 3, 3) * lengths + beyond
    tail = tail.reshape(count, 3, 3)
    moment = np.zeros((count, 3, 3))
    moment[:, LAST, NEXT], moment[:, NEXT, LAST] = work.moment, -work.moment
    # Factors of the blocks of nodes of different elements, where `axes` has R^T and t x F.
    turn, axes = work.rotation, np.empty((count, strains, 3))
    axes[:, :3] = turn.swapaxes(1, 2)
    axes[:, 3:] = cross(axes[:, : strains - 3], force[:, np.newaxis])
    left, right, base_side, tip_side = (axes.copy() for _ in range(4))
    left[:, :3] = axes[:, :3] @ (tail + moment)
    right[:, 3:] = base_side[:, 3:] = 0.0
    tip_side[:, :3] = (tail @ turn).swapaxes(1, 2)
    weight = -weights[:, np.newaxis, np.newaxis]
    before = left.reshape(-1, 3) @ (base_side * weight).reshape(-1, 3).T
    after = right.reshape(-1, 3) @ (tip_side * weight).reshape(-1, 3).T
    element = np.repeat(np.arange(elements), points * strains)
    np.copyto(work.jacobian, after)
    np.copyto(work.jacobian, before, where=element < element[:, np.newaxis])
    # The blocks of nodes of one element.
    inner = (tables.twice.reshape(-1, points) @ by_element).reshape(elements, points, points, 3, 3)
    inner *= (lengths * lengths)[..., np.newaxis]
    inner += weights.reshape(elements, 1, points, 1, 1) * beyond[:, :, np.newaxis]
    reach = lengths[..., np.newaxis] * tables.to_point[..., np.newaxis, np.newaxis]
    further = lengths[..., np.newaxis] * tables.to_end[..., np.newaxis, np.newaxis]
    inner += reach * moment.reshape(elements, points, 1, 3, 3)
    rows = axes.reshape(elements, points, 1, strains, 3)
    columns = axes.reshape(elements, 1, points, strains, 3).swapaxes(3, 4)
    own = np.zeros((elements, points, points, strains, strains))
    own[..., :3, :3] = -(rows[..., :3, :] @ inner @ columns[..., :3])
    own[..., :3, 3:] = -further * (rows[..., :3, :] @ columns[..., 3:])
    own[..., 3:, :3] = -reach * (rows[..., 3:, :] @ columns[..., :3])
    diagonal, number = np.arange(points), np.arange(elements)
    own[:, diagonal, diagonal] += work.hessian.reshape(elements, points, strains, strains)
    size = points * strains
    blocks = work.jacobian.reshape(elements, size, elements, size)
    blocks[number, :, number] = own.swapaxes(2, 3).reshape(elements, size, size)


# The paper's models ------------------------------------------------------------------------------

MOST_PAPER_SWEEPS = 60  # largest number of sweeps of an element in equation (10)
SWEEPS_A_CHECK = 2  # sweeps between checks, as a check takes as long as a sweep


def paper_twists(
    tables: PaperTables, sums: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Return twists (A, P, 4) by one of the paper's models, and the outcome of (10), (A, 3).

    ``sums`` (A, 7, P) may be complex; the outcome is that of `paper_loops`.
    """
    outcome, rest = np.full((len(sums), 3), (0.0, 0.0, -1.0)), tables.rest[:, np.newaxis]
    if tables.swept:
        rest, outcome = _imbalances(tables, sums, tolerance)
    twists = paper_twist(tuple(sums.swapaxes(0, 1)), tuple(tables.stiffness), tuple(rest))
    return np.stack(twists, axis=-1), outcome


def _imbalances(
    tables: PaperTables, sums: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Return the imbalance p (3, A, P) [N m] at nodes and stations, and the outcome, (A, 3)."""
    (stations, nodes), points = tables.stations.between.shape, tables.backwards.shape[1]
    p = np.zeros((3, len(sums), sums.shape[2]), sums.dtype)
    residual, sweeps, stuck = outcome = np.zeros((3, len(sums)))
    stuck[:] = -1.0
    largest = np.abs(sums[:, 1:3, :nodes]).max(axis=(1, 2), initial=1e-300)
    end = np.zeros((3, len(sums)), sums.dtype)
    for e in range(tables.swept - 1, -1, -1):
        columns, place = slice(e * points, (e + 1) * points), tables.anchorage[e]
        if place >= 0:
            sides = _moments(sums[..., place]), _moments(sums[..., place + 1])
            end = paper_jump(tables.stiffness[[1, 2, 2], place, np.newaxis], *sides, end)
        coefficients = paper_slope(
            tuple(tables.stiffness[:, columns]), tuple(sums[..., columns].swapaxes(0, 1))
        )
        backwards = -tables.lengths[e] * tables.backwards.T
        solution, change, count = _sweep(coefficients, backwards, end, tolerance * largest)
        stuck[(stuck < 0.0) & ~(change <= tolerance * largest)] = e
        np.maximum(residual, change / largest, out=residual)
        np.maximum(sweeps, count, out=sweeps)
        p[..., columns], end = solution[..., :points], solution[..., points]
    p[..., nodes : nodes + stations] = p[..., :nodes] @ tables.stations.between.T
    return p, outcome.T


def _moments(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return F and the diagonal of D by ``sums`` (A, 7), (3, A)."""
    f, d = paper_moments(tuple(sums.T))
    return np.stack(f), np.stack(d)


def _sweep(
    coefficients: Numbers, backwards: FloatArray, end: FloatArray, allowed: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the imbalance (3, A, p + 1) from its ``end``, its last change and sweeps, (A,)."""
    xi, k, product = coefficients[:3]
    linear, aside = np.stack(coefficients[3:5]), np.stack(coefficients[5:])
    end = end[..., np.newaxis]
    p = np.repeat(end, len(backwards) + 1, axis=2)
    n, b, others = p[1, :, :-1], p[2, :, :-1], p[:0:-1, :, :-1]
    settled: tuple[FloatArray, FloatArray, FloatArray] | None = None
    for count in range(1, MOST_PAPER_SWEEPS + 1):
        last = p.copy() if count % SWEEPS_A_CHECK == 0 else None
        np.add(((product * b + k) * n - xi * b) @ backwards, end[0], out=p[0])
        np.add(((aside * others + linear) * p[0, :, :-1]) @ backwards, end[1:], out=p[1:])
        if last is None:
            continue
        change = np.abs(last - p).max(axis=(0, 2))
        if settled is None:
            settled = p.copy(), change, np.full(len(change), float(count))
        else:
            # A converged arm is swept no further, so that it does not depend on the others.
            unsettled = ~(settled[1] <= allowed)
            np.copyto(settled[0], p, where=unsettled[:, np.newaxis])
            np.copyto(settled[1], change, where=unsettled)
            settled[2][unsettled] = count
        if (settled[1] <= allowed).all():
            break
    assert settled is not None
    return settled


# What moves --------------------------------------------------------------------------------------


def moving_loads(
    tables: MotionTables,
    rule: TimeRule,
    base: FloatArray,
    slope: FloatArray,
    rotation: FloatArray,
    motion: Motion,
) -> None:
    """Compute the ``motion`` of nodes, and its loads, from r' ``slope`` and the ``rotation``.

    ``base`` (3,) is the position of the base [m].
    """
    place, velocity, acceleration, load = motion
    place[:, POSITION] = tables.from_base @ slope + base
    place[:, 3:].reshape(-1, 3, 3)[...] = rotation.swapaxes(1, 2)
    np.subtract(rule.by_velocity * place, rule.velocity, out=velocity)
    np.subtract(rule.by_acceleration * place, rule.acceleration, out=acceleration)
    mass, _, _, displaced, added, across, along = tables.section.T[..., np.newaxis]
    # The cross products n x n'' + b x b'' are the antisymmetric part of n n''^T + b b''^T.
    axes, turned = (one[:, 6:].reshape(-1, 2, 3) for one in (place, acceleration))
    axes = axes * tables.section[:, ROTARY_N : ROTARY_B + 1, np.newaxis]
    turn = axes.swapaxes(1, 2) @ turned
    moment = turn[:, LAST, NEXT] - turn[:, NEXT, LAST]
    force = -mass * acceleration[:, POSITION]
    if tables.in_water:
        (u, rate), t, dt = rule.water, place[:, TANGENT], velocity[:, TANGENT]
        w, a = velocity[:, POSITION] - u, acceleration[:, POSITION] - rate
        tw, pull = dot(t, w), dot(t, a) + dot(dt, w)
        force -= added * (a - tw * dt - pull * t)
        force -= np.sqrt(dot(w, w)) * (across * w + along * tw * t)
        force += displaced * rate
        moment -= added * tw * cross(t, w)
    load[0], load[1] = tables.to_tip @ force, tables.to_tip @ moment
