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


class AlongArm(NamedTuple):
    """Integrals between the nodes of an arm.

    Attributes:
        from_base: matrix of integrals from the base to each node, (N, N) in columns [m].
        to_tip: the same from each node to the tip.
    """

    from_base: FloatArray
    to_tip: FloatArray

    def kinematics(self, work: Work, strains: int) -> tuple[FloatArray, FloatArray]:
        """Derivatives of turns of sections and of r' by the twists in ``work``, (N, 3, N m)."""
        nodes = len(work.slope)
        columns = np.zeros((nodes, 3, nodes, strains))
        part, axes = self.from_base[:, np.newaxis, :, np.newaxis], work.rotation
        np.multiply(part, axes.transpose(1, 0, 2), out=columns[..., :3])
        turn = columns.reshape(nodes, 3, -1)
        slope, number = -(skew(work.slope) @ turn), np.arange(nodes)
        own = slope.reshape(nodes, 3, nodes, strains)
        own[number, :, number, 3:] += work.rotation[:, :, : strains - 3]
        return turn, slope

    def add_tangents(self, work: Work, strains: int, tangents: Sequence[LocalTangents]) -> None:
        """Add what loads of such ``tangents`` do to the Jacobian in ``work``."""
        turn, slope = self.kinematics(work, strains)
        move = _product(self.from_base, slope)
        force, moment = np.zeros_like(move), np.zeros_like(move)
        for one in tangents:
            moved, turned = move, turn
            if one.between is not None:
                moved = _product(one.between, move)
                if one.force_by_turn is not None or one.moment_by_turn is not None:
                    turned = _product(one.between, turn)
            force += _density(one.force_by_place, one.force_by_turn, moved, turned, one.back)
            if one.moment_by_place is not None or one.moment_by_turn is not None:
                parts = one.moment_by_place, one.moment_by_turn
                moment += _density(*parts, moved, turned, one.back)
        force = _product(self.to_tip, force)
        moment += skew(work.slope) @ force
        moment = _product(self.to_tip, moment)
        axes = work.rotation.swapaxes(1, 2)
        rows = work.jacobian.reshape(len(axes), strains, -1)
        rows[:, :3] -= axes @ moment
        rows[:, 3:] -= axes[:, : strains - 3] @ force


def _density(
    by_place: FloatArray | None, by_turn: FloatArray | None, moved: FloatArray,
    turned: FloatArray, back: FloatArray | None,
) -> FloatArray:  # fmt: skip
    """Change of a density at the nodes, (N, 3, n)."""
    parts = [by @ to for by, to in ((by_place, moved), (by_turn, turned)) if by is not None]
    total = parts[0] if len(parts) == 1 else parts[0] + parts[1]
    return total if back is None else _product(back, total)


def _product(matrix: FloatArray, values: FloatArray) -> FloatArray:
    """A ``matrix`` (n, P) times ``values`` (P, 3, k)."""
    return (matrix @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])
