"""Tables of an arm at its nodes, and the arrays that the node functions fill in.

Both are plain arrays in one tuple each, as numba takes time for every argument of a call.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import BoolArray, FloatArray, IntArray
from octo_arm_model.arm.stiffness import SectionStiffness
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.gauss import GaussRule

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
        moments: from tensions to the seven sums over the tendons, see `paper_equations`,
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
    return Places(elements.element_at(s), integration, between, elements.rule.tail)


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
    arm: Arm, elements: Elements, base: FloatArray, *, law: int,
    at: tuple[FloatArray, IntArray] | None = None,
) -> Tables:  # fmt: skip
    """Tables of ``arm`` at the nodes of ``elements``, or ``at`` places [m] in sections, both (S,).

    ``base`` is the orientation of the base, a quaternion w, x, y, z.
    """
    rule, (s, section) = elements.rule, at or (elements.s, elements.section)
    acts = arm.tendon_section[np.newaxis] <= section[:, np.newaxis]
    columns = np.stack([*arm.tendon_offsets(s), *arm.tendon_slopes(s)], axis=-1)
    tendons = columns.swapaxes(0, 1) * acts[..., np.newaxis]
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
        _twice(rule),
        base,
        body,
        np.ascontiguousarray(tendons),
        acts.sum(axis=1).astype(np.int64),
        acts.astype(np.float64),
        _LEAST_SCALE * body[:, AXIAL],
        compliance,
        np.array(arm.friction or np.zeros(len(arm.tendons))),
        rule.differentiation,
        rule.interpolate(np.array([0.0, 1.0])),
        elements.sharp,
        *_fine(rule),
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
    scale[:, 0], scale[:, 1] = force * tables.body[:, LEVER], force
    return scale


def _twice(rule: GaussRule) -> FloatArray:
    return np.ascontiguousarray(np.einsum('im,mk->ikm', rule.to_end, rule.from_start))


def _fine(rule: GaussRule) -> tuple[FloatArray, FloatArray]:
    """`Tables.to_fine` and `Tables.fine_weights` of one element of length one."""
    fine = Elements(np.array([0.0, 1.0]), rule, np.zeros(1, np.int64), np.ones(1, np.bool_)).fine
    return rule.interpolate(fine.s), fine.integration(np.append(rule.points, 1.0))


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
            own.axial, own.torsion, *squares, own.shear, np.maximum(radius, lever), radius,
            *arm.rest.at(s),
        ],
        axis=1,
    )  # fmt: skip
