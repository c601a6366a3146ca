"""How the shape of an arm changes with a state, by the chain rule: evaluated where asked for."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.rotations import quaternion_product
from octo_arm_model.rod.sensitivity import Change


class Part(NamedTuple):
    """What some components of a state do to the shape.

    Attributes:
        where: these components.
        change: of the shape, per unit of what they change.
        columns: of that change, one for each component.
        scale: unit of what they change per unit of each component, one for all or for each.
    """

    where: slice
    change: Change
    columns: slice
    scale: FloatArray | float


class StateChange:
    """Change of the shape per unit of each component of a state, the last axis; see `Change`.

    Attributes:
        by_tip_force: change of pose by forces on the tip along all axes of the arm as described,
            (stations, 6, 3); None where the model has no loads.
    """

    def __init__(
        self, size: int, parts: Sequence[Part], by_tip_force: FloatArray | None = None
    ) -> None:
        """Of a state of ``size`` components, of which those in none of ``parts`` do nothing.

        ``by_tip_force`` is the change of pose by forces of 1 N on the tip, whatever the state.
        """
        self._size, self._parts, self.by_tip_force = size, parts, by_tip_force

    @functools.cached_property
    def pose(self) -> FloatArray:
        """Displacement [m] and rotation vector [rad] in base_frame, (stations, 6, state)."""
        return self._chained([one.change.pose for one in self._parts])

    @property
    def tip(self) -> FloatArray:
        """The same of the tip alone, (6, state)."""
        return self.pose[-1]

    @functools.cached_property
    def strain(self) -> FloatArray:
        """Change of tau, xi, k [1/m] and q [-], (stations, 4, state)."""
        return self._chained([one.change.strain for one in self._parts])

    @functools.cached_property
    def tendon_length(self) -> FloatArray:
        """Change of the length of every tendon [m], (tendons, state)."""
        return self._chained([one.change.tendon_length for one in self._parts])

    def moved(
        self, backbone: Backbone, by: FloatArray, acting: tuple[FloatArray, FloatArray]
    ) -> Backbone:
        """The ``backbone`` that this is the change of after a small change ``by`` of the state.

        ``acting`` are the tensions and the wrench on the tip then. Stations alone: what
        `Solver.solve` starts from stays.
        """
        pose, strain = _times(self.pose, by), _times(self.strain, by)
        turn = np.concatenate([0.5 * pose[:, 3:], np.ones((len(pose), 1))], axis=1)
        quaternion = quaternion_product(turn, backbone.quaternion)
        tau, xi, k, q = strain.T
        return dataclasses.replace(
            backbone,
            position=backbone.position + pose[:, :3],
            quaternion=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
            tau=backbone.tau + tau,
            xi=backbone.xi + xi,
            k=backbone.k + k,
            q=backbone.q + q,
            tensions=acting[0],
            tip_wrench=acting[1],
        )

    def _chained(self, changes: Sequence[FloatArray]) -> FloatArray:
        found = np.zeros((*changes[0].shape[:-1], self._size))
        for (where, _, columns, scale), change in zip(self._parts, changes, strict=True):
            if where.stop > where.start:
                np.multiply(change[..., columns], scale, out=found[..., where])
        return found


def _times(change: FloatArray, by: FloatArray) -> FloatArray:
    """Product of a ``change`` (stations, k, n) and ``by`` (n,), as one of matrices."""
    return (change.reshape(-1, by.size) @ by).reshape(change.shape[:2])
