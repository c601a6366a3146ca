"""Loads per length that depend on where the arm is: what they add to the Jacobian.

With the turn phi = int R d kappa of a section and its displacement dr = int (phi x r' + R d v),
where int is the integral from the base, a density of force f and of moment m changes the wrench
beyond each node by

    dF = int' df,    dM = int' (r' x dF + dm),

where int' is the integral to the tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.rotations import skew
from octo_arm_model.rod.tables import Work


class LocalTangents(NamedTuple):
    """Derivatives of densities of force and moment by displacement and turn there, (P, 3, 3) each.

    Attributes:
        force_by_place: [N/m^2]; those after it are None where they are zero.
        force_by_turn: [N/m].
        moment_by_place: [N/m].
        moment_by_turn: [N].
        between: matrix (P, N) from values at the nodes to those at P points; None where these are
            the nodes.
        back: matrix (N, P) from densities at the points to those at the nodes that do the same
            work.
    """

    force_by_place: FloatArray
    force_by_turn: FloatArray | None = None
    moment_by_place: FloatArray | None = None
    moment_by_turn: FloatArray | None = None
    between: FloatArray | None = None
    back: FloatArray | None = None


def kinematics(from_base: FloatArray, work: Work, strains: int) -> tuple[FloatArray, FloatArray]:
    """Derivatives of turns of sections and of r' by the twists in ``work``, (N, 3, N m).

    With the integrals ``from_base`` (N, N) to each node.
    """
    nodes = len(work.slope)
    columns = np.zeros((nodes, 3, nodes, strains))
    part, axes = from_base[:, np.newaxis, :, np.newaxis], work.rotation
    np.multiply(part, axes.transpose(1, 0, 2), out=columns[..., :3])
    turn = columns.reshape(nodes, 3, -1)
    slope, number = -(skew(work.slope) @ turn), np.arange(nodes)
    own = slope.reshape(nodes, 3, nodes, strains)
    own[number, :, number, 3:] += work.rotation[:, :, : strains - 3]
    return turn, slope


def add_tangents(
    elements: Elements, work: Work, strains: int, tangents: Sequence[LocalTangents]
) -> None:
    """Add what loads of such ``tangents`` do to the Jacobian in ``work``."""
    turn, slope = kinematics(elements.from_base, work, strains)
    move = along(elements.from_base, slope)
    force, moment = np.zeros_like(move), np.zeros_like(move)
    for one in tangents:
        moved, turned = move, turn
        if one.between is not None:
            moved = along(one.between, move)
            if one.force_by_turn is not None or one.moment_by_turn is not None:
                turned = along(one.between, turn)
        force += _density(one.force_by_place, one.force_by_turn, moved, turned, one.back)
        if one.moment_by_place is not None or one.moment_by_turn is not None:
            parts = one.moment_by_place, one.moment_by_turn
            moment += _density(*parts, moved, turned, one.back)
    force = along(elements.to_tip, force)
    moment = along(elements.to_tip, moment + skew(work.slope) @ force)
    rows = in_sections(work.rotation, force, moment, strains)
    work.jacobian[:] -= rows.reshape(work.jacobian.shape)


def in_sections(
    rotation: FloatArray, force: FloatArray, moment: FloatArray, strains: int
) -> FloatArray:
    """A ``force`` and a ``moment`` (N, 3, k) in the axes of sections as a residual, (N, m, k)."""
    inverse = rotation.swapaxes(1, 2)
    return np.concatenate([inverse @ moment, inverse[:, : strains - 3] @ force], axis=1)


def _density(
    by_place: FloatArray | None, by_turn: FloatArray | None, moved: FloatArray,
    turned: FloatArray, back: FloatArray | None,
) -> FloatArray:  # fmt: skip
    """Change of a density at the nodes, (N, 3, n)."""
    parts = [by @ to for by, to in ((by_place, moved), (by_turn, turned)) if by is not None]
    total = parts[0] if len(parts) == 1 else parts[0] + parts[1]
    return total if back is None else along(back, total)


def along(matrix: FloatArray, values: FloatArray) -> FloatArray:
    """``matrix`` (n, P) times ``values`` (P, c, k)."""
    return (matrix @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])
