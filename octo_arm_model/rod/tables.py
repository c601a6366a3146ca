"""Tables of an arm at its nodes, and the arrays that the node functions fill in.

Both are plain arrays in one tuple each, as numba takes time for every argument of a call.
"""

import functools
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import BoolArray, FloatArray, IntArray
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.rod.elements import Elements, gauss_rule

# Columns of `Tables.body`.
AXIAL, TORSION, SQUARED_N, SQUARED_B, SHEAR, LEVER, RADIUS, REST_T, REST_N, REST_B = range(10)
# Columns of `Tables.tendons`.
ALONG_N, ALONG_B, SLOPE_N, SLOPE_B = range(4)
_RIGID = 1e6  # stiffness of discs over that of the body in them
_LEAST_SCALE = 1e-4  # of E A: forces below a part of it are rounding


class Tables(NamedTuple):
    """An arm at N nodes in E elements of p points, with J tendons.

    Attributes:
        law: number of the elastic law, see `arm.material.LAWS`.
        lengths: reference lengths of the elements [m], (E,).
        weights: of the integral along the arm [m], (N,).
        to_point: weights of the integral over an element of length one from its start to a point,
            (p, p), a row for each point.
        to_end: the same from a point to the end, (p, p).
        twice: to_end[i, m] to_point[m, k], (p, p, p) with indices i, k, m.
        base: orientation of the base, quaternion w, x, y, z, (4,).
        body: E A [N], G I [N m^2], 4 E J / (E A) of bending about n and about b, R^2 of a circle
            [m^2], G A [N], the larger of R and the offset of the outermost tendon [m], R, and
            torsion and curvatures at rest [1/m], (N, 10).
        tendons: offsets along n and b [m] and their slopes [-], zero beyond the anchorage,
            (N, J, 4).
        active: how many tendons reach each node, (N,): the first ones, as sections are numbered
            from the tip.
        reach: 1 where a tendon acts and 0 beyond its anchorage, (N, J).
        least_scale: see `force_scale`, (N,) [N].
        compliance: 1 / k of the sheath of each tendon [1/Pa], 0 for a rigid one, (J,).
        friction: coefficient mu of each tendon [-], (J,).
        differentiation: derivative at the points of an element of length one, (p, p).
        ends: weights of the values at its start and end, (2, p).
        sharp: whether strains may jump at the start of each element, (E,).
        to_fine: values at the M / E fine points of an element of length one, see
            `elements.fine`, from those at its points, (M / E, p).
        fine_weights: of the integrals from its start to each point and to its end, (p + 1, M / E).
    """

    law: int
    lengths: FloatArray
    weights: FloatArray
    to_point: FloatArray
    to_end: FloatArray
    twice: FloatArray
    base: FloatArray
    body: FloatArray
    tendons: FloatArray
    active: IntArray
    reach: FloatArray
    least_scale: FloatArray
    compliance: FloatArray
    friction: FloatArray
    differentiation: FloatArray
    ends: FloatArray
    sharp: BoolArray
    to_fine: FloatArray
    fine_weights: FloatArray


class Work(NamedTuple):
    """What node functions compute, overwritten by each call; m strains at N nodes.

    Attributes:
        quaternion: orientation of the nodes, w, x, y, z, (N, 4).
        rotation: its matrix, columns t, n, b, (N, 3, 3).
        slope: r', the derivative of the position by s [-], (N, 3).
        moment: that everything beyond exerts on the cross section, in base_frame, (N, 3) [N m].
        gradient: of the energy by the twist, (N, m) [N m and N].
        hessian: of the energy by the twist, (N, m, m).
        residual: gradient less the wrench of the loads in the axes of the section, (N, m).
        scale: size of forces and moments by which a residual is measured, (N, 2) [N m, N].
        offsets: of tendons in sheaths, (N, J, 2) [m].
        angle: by which tendons with friction have turned since the base [rad], (N, J).
        jacobian: d residual / d z, (N m, N m), rows and columns node by node.
    """

    quaternion: FloatArray
    rotation: FloatArray
    slope: FloatArray
    moment: FloatArray
    gradient: FloatArray
    hessian: FloatArray
    residual: FloatArray
    scale: FloatArray
    offsets: FloatArray
    angle: FloatArray
    jacobian: FloatArray


class Places(NamedTuple):
    """S places of an arm, such as stations, at which something is known from E p nodes.

    Attributes:
        element: that each is in, at an edge the one towards the base, (S,).
        integration: from values at the nodes to integrals from the base, (S, N) [m].
        between: from values at the nodes to those at the places, (S, N).
        tail: from values at the points of an element to their last two Legendre coefficients,
            (2, p).
    """

    element: IntArray
    integration: FloatArray
    between: FloatArray
    tail: FloatArray


class PaperTables(NamedTuple):
    """The paper's models of an arm at P places: N nodes, S stations and both sides of anchorages.

    Attributes:
        moments: from tensions to the seven sums over the tendons, see `papers`,
            (J, 7, P).
        stiffness: E A [N], G I and E J about n and about b [N m^2] of the sections, (4, P).
        rest: moments that would straighten them, about t, n and b, (3, P) [N m].
        lengths: of the elements [m], (E,).
        backwards: weights of the integrals over an element of length one from each point to its
            end, and from its start, (p + 1, p).
        swept: in how many elements, counted from the base, moments are not in balance: none in the
            closed form.
        anchorage: place at the side to the base of the anchorage at which an element ends, before
            that at its other side; -1 where it ends at none, (E,).
        stations: where the S stations are.
    """

    moments: FloatArray
    stiffness: FloatArray
    rest: FloatArray
    lengths: FloatArray
    backwards: FloatArray
    swept: int
    anchorage: IntArray
    stations: Places


def places_at(elements: Elements, s: FloatArray) -> Places:
    """Places at arc coordinates ``s`` (S,) [m] of the nodes of ``elements``."""
    integration, between = elements.integration(s), elements.interpolation(s)
    return Places(elements.element_at(s), integration, between, elements.rule.coefficients[-2:])


def work_arrays(tables: Tables, strains: int, *, has_jacobian: bool = True) -> Work:
    """Arrays for ``tables`` and 4 or 6 ``strains``; stations have no Jacobian."""
    nodes, tendons = tables.tendons.shape[:2]
    size = nodes * strains if has_jacobian else 0
    return Work(
        np.zeros((nodes, 4)),
        np.zeros((nodes, 3, 3)),
        np.zeros((nodes, 3)),
        np.zeros((nodes, 3)),
        np.zeros((nodes, strains)),
        np.zeros((nodes, strains, strains)),
        np.zeros((nodes, strains)),
        np.zeros((nodes, 2)),
        np.zeros((nodes, tendons, 2)),
        np.zeros((nodes, tendons)),
        np.zeros((size, size)),
    )


def tabulate(
    arm: Arm,
    elements: Elements,
    base: FloatArray,
    *,
    law: int,
    at: tuple[FloatArray, IntArray] | None = None,
) -> Tables:
    """Tables of ``arm`` at the nodes of ``elements``, or ``at`` places [m] in sections, both (S,).

    ``base`` is the orientation of the base, a quaternion w, x, y, z.
    """
    rule, (s, section) = elements.rule, at or (elements.s, elements.section)
    twice, differentiation, ends, to_fine, fine_weights = _of_rule(elements.points)
    acts = arm.tendon_section[np.newaxis] <= section[:, np.newaxis]
    tendons = arm.tendon_paths(s).T * acts[..., np.newaxis]
    sheaths = np.array(arm.sheath_stiffness or np.zeros(len(arm.tendons)))
    compliance = np.divide(1.0, sheaths, out=np.zeros_like(sheaths), where=sheaths > 0.0)
    body = _body(arm, s, tendons)
    for column in (AXIAL, TORSION, SHEAR):
        body[arm.discs.cover(s), column] *= _RIGID
    return Tables(
        law,
        elements.lengths,
        elements.weights,
        rule.from_start,
        rule.to_end,
        twice,
        base,
        body,
        np.ascontiguousarray(tendons),
        acts.sum(axis=1).astype(np.int64),
        acts.astype(np.float64),
        _LEAST_SCALE * body[:, AXIAL],
        compliance,
        np.array(arm.friction or np.zeros(len(arm.tendons))),
        differentiation,
        ends,
        elements.sharp,
        to_fine,
        fine_weights,
    )


def force_scale(tables: Tables, tensions: FloatArray) -> FloatArray:
    """Moments and forces that a residual is measured by, (N, 2) [N m, N].

    The sum of ``tensions`` (N, J) or (J,) [N] of the tendons there, alone and times the lever arm,
    and a small part of the stiffness of the section, so that rounding counts for nothing.
    """
    if tensions.ndim == 1:
        force = tables.reach @ tensions
    else:
        force = np.einsum('ij,ij->i', tensions, tables.reach)
    force += tables.least_scale
    scale = np.empty((force.size, 2))
    np.multiply(force, tables.body[:, LEVER], out=scale[:, 0])
    scale[:, 1] = force
    return scale


@functools.cache
def _of_rule(points: int) -> tuple[FloatArray, ...]:
    """Of `Tables` what depends on the rule of so many ``points`` alone.

    These are twice, differentiation, ends, to_fine and fine_weights.
    """
    rule = gauss_rule(points)
    twice = np.ascontiguousarray(np.einsum('im,mk->ikm', rule.to_end, rule.from_start))
    fine = Elements(np.array([0.0, 1.0]), rule, np.zeros(1, np.int64), np.ones(1, np.bool_)).fine
    return (
        twice,
        rule.differentiation,
        rule.interpolate(np.array([0.0, 1.0])),
        rule.interpolate(fine.s),
        fine.integration(np.append(rule.points, 1.0)),
    )


def least_bending(tables: Tables) -> FloatArray:
    """E J of the sections about the axis that they bend about more easily, (N,) [N m^2]."""
    squares = tables.body[:, SQUARED_N : SQUARED_B + 1]
    return np.asarray(0.25 * tables.body[:, AXIAL] * squares.min(axis=1))


def _body(arm: Arm, s: FloatArray, tendons: FloatArray) -> FloatArray:
    radius, own = arm.body.radius(s), SectionStiffness.at(arm, s)
    lever = np.hypot(tendons[..., ALONG_N], tendons[..., ALONG_B]).max(axis=1, initial=0.0)
    squares = 4.0 * own.bending_n / own.axial, 4.0 * own.bending_b / own.axial
    return np.stack(
        [
            own.axial,
            own.torsion,
            *squares,
            own.shear,
            np.maximum(radius, lever),
            radius,
            *arm.rest.at(s),
        ],
        axis=1,
    )


# What moves --------------------------------------------------------------------------------------

# Columns of `MotionTables.section`.
MASS, ROTARY_N, ROTARY_B, DISPLACED, ADDED, ACROSS, ALONG = range(7)
# Columns of the place of a node: its position and the axes t, n and b of its section.
POSITION, TANGENT, COLUMNS = slice(0, 3), slice(3, 6), 12


class MotionTables(NamedTuple):
    """What does not change while an arm moves.

    Attributes:
        from_base: matrix of integrals from the base to each node, (N, N) in columns [m].
        to_tip: the same from each node to the tip.
        section: per reference length, rho A [kg/m], rho times the second moments of area across
            which n and b point [kg m], the mass of the displaced water and the added one [kg/m],
            and factors of the drag, see `inertia` (1): rho_w R C_n and rho_w R (pi C_t / 2 - C_n)
            [kg/m^2], (N, 7).
        in_water: whether any of the last four is not zero.
        viscous: D of the sections, (N, m).
    """

    from_base: FloatArray
    to_tip: FloatArray
    section: FloatArray
    in_water: bool
    viscous: FloatArray


class TimeRule(NamedTuple):
    """Velocities and accelerations as linear functions of what the rod is, x.

    Those of places are by_velocity x - velocity and by_acceleration x - acceleration.

    Attributes:
        by_velocity: [1/s].
        by_acceleration: [1/s^2].
        velocity: (N, 12).
        acceleration: (N, 12).
        twist_rate: as `velocity`, of twists, (N, m).
        water: velocity of the water [m/s] and its acceleration [m/s^2], (2, 3).
    """

    by_velocity: float
    by_acceleration: float
    velocity: FloatArray
    acceleration: FloatArray
    twist_rate: FloatArray
    water: FloatArray


class Motion(NamedTuple):
    """How the nodes move, (N, 12) each, and what that exerts.

    Attributes:
        place: positions in base_frame [m] and axes of the sections [-].
        velocity: of these.
        acceleration: of these.
        load: force and moment of inertia and water beyond each node, (2, N, 3) [N, N m].
    """

    place: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    load: FloatArray


# Errors ------------------------------------------------------------------------------------------

# Error of positions over the sums of squares, at most, where it is above 1e-10; measured for the
# arm of Table 4 under random tensions in water and air and for the metal rod.
OF_BENDS, OF_DIRECTIONS = 2e-3, 1e-4
_BETWEEN = 30.0
_ADDED, _ADDED_FINE, _FINE = 4, 5, 1e-8  # points, and the accuracy below which it is more


def added_points(accuracy: float, has_friction: bool) -> int:
    """Points more in each element at which sections are balanced, for stations between them."""
    return _ADDED if accuracy >= _FINE and not has_friction else _ADDED_FINE


def allowed_between(accuracy: float) -> float:
    """What `position_errors` may be for positions between the points to be right to ``accuracy``.

    Their error is of the first order of what the points leave, that at the ends of the second.
    """
    return min(accuracy, (_BETWEEN * accuracy) ** 2)


def position_errors(
    tail: FloatArray, lengths: FloatArray, z: FloatArray, slope: FloatArray
) -> FloatArray:
    """Estimated errors of positions over the length of A arms [-], (A,).

    From the twists ``z`` (A N, m) and r' ``slope`` (A N, 3) at the nodes, by the last Legendre
    coefficients of elements, see `Places.tail`, and ``lengths`` (E,) [m].
    """
    # Largest of the last two Legendre coefficients of bends and directions in each element.
    values = np.concatenate([z[:, :3], slope], axis=1).reshape(-1, tail.shape[1], 6)
    tails = np.abs(tail @ values).reshape(-1, 2, 2, 3).max(axis=(1, 3))
    tails *= tails
    tails = tails.reshape(-1, lengths.size, 2)
    of_bends = OF_BENDS * (tails[..., 0] @ (lengths * lengths))
    return np.asarray(of_bends + OF_DIRECTIONS / lengths.sum() * (tails[..., 1] @ lengths))
