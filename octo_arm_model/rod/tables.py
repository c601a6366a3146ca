"""Tables of an arm at its nodes, and the arrays that the node functions compute.

Each is one tuple of plain arrays, as numba takes time for every argument of a call.
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
_LEAST_SCALE = 1e-4  # part of E A in the scale of residuals, as forces far below are rounding


class Tables(NamedTuple):
    """The tables of an arm with J tendons at N nodes, in E elements of p points."""

    law: int  #: number of the elastic law, see `arm.material.LAWS`
    lengths: FloatArray  #: reference lengths of the elements [m], (E,)
    weights: FloatArray  #: weights of the integral along the arm [m], (N,)
    #: weights of the integral over an element of length one from its start to a point, (p, p), a
    #: row for each point
    to_point: FloatArray
    to_end: FloatArray  #: weights of the integral from a point to the end, (p, p)
    twice: FloatArray  #: to_end[i, m] to_point[m, k], (p, p, p) with indices i, k, m
    base: FloatArray  #: orientation of the base, quaternion w, x, y, z, (4,)
    #: E A [N], G I [N m^2], 4 E J / (E A) of bending about n and about b, R^2 of a circle [m^2], G
    #: A [N], the larger of R and the offset of the outermost tendon [m], R, and torsion and
    #: curvatures at rest [1/m], (N, 10)
    body: FloatArray
    #: offsets along n and b [m] and their slopes [-], zero beyond the anchorage, (N, J, 4)
    tendons: FloatArray
    #: how many tendons reach each node, (N,): the first ones, as sections are numbered from the
    #: tip
    active: IntArray
    reach: FloatArray  #: 1 where a tendon acts and 0 beyond its anchorage, (N, J)
    least_scale: FloatArray  #: least force that residuals are divided by, (N,) [N]
    compliance: FloatArray  #: 1 / k of the sheath of each tendon [1/Pa], 0 for a rigid one, (J,)
    friction: FloatArray  #: coefficient mu of each tendon [-], (J,)
    differentiation: FloatArray  #: derivative at the points of an element of length one, (p, p)
    ends: FloatArray  #: weights of the values at its start and end, (2, p)
    sharp: BoolArray  #: whether strains may jump at the start of each element, (E,)
    #: values at the M / E fine points of an element of length one, see `elements.fine`, from those
    #: at its points, (M / E, p)
    to_fine: FloatArray
    #: weights of integrals from start to each point and to end, (p + 1, M / E)
    fine_weights: FloatArray


class Work(NamedTuple):
    """The results of node functions, overwritten by each call; m strains at N nodes."""

    quaternion: FloatArray  #: orientation of the nodes, w, x, y, z, (N, 4)
    rotation: FloatArray  #: rotation matrix of the nodes, columns t, n, b, (N, 3, 3)
    slope: FloatArray  #: r', the derivative of the position by s [-], (N, 3)
    moment: FloatArray  #: moment on the cross section from beyond it, in base_frame, (N, 3) [N m]
    gradient: FloatArray  #: gradient of the energy by the twist, (N, m) [N m and N]
    hessian: FloatArray  #: second derivatives of the energy by the twist, (N, m, m)
    #: gradient less the wrench of the loads in the axes of the section, (N, m)
    residual: FloatArray
    scale: FloatArray  #: moments and forces that a residual is divided by, (N, 2) [N m, N]
    offsets: FloatArray  #: offsets of tendons in sheaths, (N, J, 2) [m]
    #: angle by which tendons with friction have turned from the base [rad], (N, J)
    angle: FloatArray
    jacobian: FloatArray  #: d residual / d z, (N m, N m), rows and columns node by node


class Places(NamedTuple):
    """S places of an arm, such as stations, and matrices from values at the N nodes."""

    element: IntArray  #: element of each place, at an edge the one towards the base, (S,)
    #: matrix from values at the nodes to integrals from the base, (S, N) [m]
    integration: FloatArray
    between: FloatArray  #: matrix from values at the nodes to those at the places, (S, N)
    #: matrix from values at the points of an element to their last two Legendre coefficients, (2,
    #: p)
    tail: FloatArray


class PaperTables(NamedTuple):
    """The tables of the paper's models at P places: nodes, stations, both sides of anchorages."""

    #: matrix from tensions to the seven sums over the tendons, see `papers`, (J, 7, P)
    moments: FloatArray
    #: E A [N], G I and E J about n and about b [N m^2] of the sections, (4, P)
    stiffness: FloatArray
    rest: FloatArray  #: moments that would straighten the sections, about t, n and b, (3, P) [N m]
    lengths: FloatArray  #: lengths of the elements [m], (E,)
    #: weights of the integrals over an element of length one, from each point to the end of the
    #: element, and from its start, (p + 1, p)
    backwards: FloatArray
    #: number of elements, counted from the base, with equation (10): none in the closed form
    swept: int
    #: place on the base side of the anchorage at which an element ends, before that on its other
    #: side; -1 if it ends at none, (E,)
    anchorage: IntArray
    stations: Places  #: the S stations


def places_at(elements: Elements, s: FloatArray) -> Places:
    """Return the places at arc coordinates ``s`` (S,) [m], by the nodes of ``elements``."""
    integration, between = elements.integration(s), elements.interpolation(s)
    return Places(elements.element_at(s), integration, between, elements.rule.coefficients[-2:])


def work_arrays(tables: Tables, strains: int, *, has_jacobian: bool = True) -> Work:
    """Return new arrays for ``tables`` and 4 or 6 ``strains``; stations need no Jacobian."""
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
    """Return the tables of ``arm`` at the nodes of ``elements``, or ``at`` places [m] in sections.

    Both are (S,). ``base`` is the orientation of the base, a quaternion w, x, y, z.
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
    """Return the moments and forces that a residual is divided by, (N, 2) [N m, N].

    The force is the sum of ``tensions`` (N, J) or (J,) [N], and a small part of the stiffness of
    the section, so that rounding has no effect. The moment is the force times the lever arm.
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
    """Return the arrays of `Tables` that depend on the number of ``points`` alone.

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
    """Return the smaller of both E J of the sections, (N,) [N m^2]."""
    squares = tables.body[:, SQUARED_N : SQUARED_B + 1]
    return np.asarray(0.25 * tables.body[:, AXIAL] * squares.min(axis=1))


def _body(arm: Arm, s: FloatArray, tendons: FloatArray) -> FloatArray:
    radius, section = arm.body.radius(s), SectionStiffness.at(arm, s)
    lever = np.hypot(tendons[..., ALONG_N], tendons[..., ALONG_B]).max(axis=1, initial=0.0)
    bending = section.bending_n, section.bending_b
    squares = [4.0 * value / section.axial for value in bending]
    return np.stack(
        [
            section.axial,
            section.torsion,
            *squares,
            section.shear,
            np.maximum(radius, lever),
            radius,
            *arm.rest.at(s),
        ],
        axis=1,
    )


# Motion ------------------------------------------------------------------------------------------

# Columns of `MotionTables.section`.
MASS, ROTARY_N, ROTARY_B, DISPLACED, ADDED, ACROSS, ALONG = range(7)
# Columns of the place of a node: its position and the axes t, n and b of its section.
POSITION, TANGENT, COLUMNS = slice(0, 3), slice(3, 6), 12


class MotionTables(NamedTuple):
    """The constants of a moving arm."""

    from_base: FloatArray  #: matrix of integrals from the base to each node, (N, N) in columns [m]
    to_tip: FloatArray  #: matrix of integrals from each node to the tip, (N, N) [m]
    #: per reference length, rho A [kg/m], rho times the second moments of area across which n and
    #: b point [kg m], the mass of the displaced water and the added one [kg/m], and factors of the
    #: drag, see `inertia` (1): rho_w R C_n and rho_w R (pi C_t / 2 - C_n) [kg/m^2], (N, 7)
    section: FloatArray
    in_water: bool  #: whether any of the last four is not zero
    viscous: FloatArray  #: viscous stiffness D of the sections, (N, m)


class TimeRule(NamedTuple):
    """Velocities and accelerations as linear functions of the places x of nodes.

    They are by_velocity x - velocity and by_acceleration x - acceleration.
    """

    by_velocity: float  #: coefficient of velocities [1/s]
    by_acceleration: float  #: coefficient of accelerations [1/s^2]
    velocity: FloatArray  #: constant part of velocities of places, (N, 12)
    acceleration: FloatArray  #: constant part of accelerations of places, (N, 12)
    twist_rate: FloatArray  #: constant part of the rates of twists, (N, m)
    water: FloatArray  #: velocity of the water [m/s] and its acceleration [m/s^2], (2, 3)


class Motion(NamedTuple):
    """The motion of the nodes, (N, 12) each, and its loads."""

    place: FloatArray  #: positions in base_frame [m] and axes of the sections [-]
    velocity: FloatArray  #: velocities of the places
    acceleration: FloatArray  #: accelerations of the places
    load: FloatArray  #: force and moment of inertia and water beyond each node, (2, N, 3) [N, N m]


# Errors ------------------------------------------------------------------------------------------

# Largest ratio of the error of positions to the sums of squares, for errors above 1e-10; measured
# for the arm of Table 4 under random tensions in water and air, and for the metal rod.
OF_BENDS, OF_DIRECTIONS = 2e-3, 1e-4
_BETWEEN = 30.0
_ADDED, _ADDED_FINE, _FINE = 4, 5, 1e-8  # added points, more of them below this accuracy


def added_points(accuracy: float, has_friction: bool) -> int:
    """Return the number of points to add to each element for results between the nodes."""
    return _ADDED if accuracy >= _FINE and not has_friction else _ADDED_FINE


def errors_between(errors: FloatArray | float) -> FloatArray:
    """Return errors of positions anywhere, where `position_errors` has those at ends of elements.

    These are of second order, those between the points of first order.
    """
    return np.maximum(errors, np.sqrt(errors) / _BETWEEN)


def position_errors(
    tail: FloatArray, lengths: FloatArray, z: FloatArray, slope: FloatArray
) -> FloatArray:
    """Return estimated errors of positions over the length of A arms [-], (A,).

    They follow from the last Legendre coefficients of twists ``z`` (A N, m) and of r' ``slope``
    (A N, 3) in each element, see `Places.tail`, and from ``lengths`` (E,) [m].
    """
    # Largest of the last two Legendre coefficients of bends and directions in each element.
    values = np.concatenate([z[:, :3], slope], axis=1).reshape(-1, tail.shape[1], 6)
    tails = np.abs(tail @ values).reshape(-1, 2, 2, 3).max(axis=(1, 3))
    tails *= tails
    tails = tails.reshape(-1, lengths.size, 2)
    of_bends = OF_BENDS * (tails[..., 0] @ (lengths * lengths))
    return np.asarray(of_bends + OF_DIRECTIONS / lengths.sum() * (tails[..., 1] @ lengths))
