"""Loads whose resultants change with the shape: the rod they act on, and their stiffness."""

from __future__ import annotations

import numpy as np

from octo_arm_model.core.arm.loads import Tangent
from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.loaded.collocation import Collocation, Readout
from octo_arm_model.core.loaded.kinematics import unit
from octo_arm_model.core.loaded.linearised import Linearised, Response
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.numerics.vectors import cross


class RodPoints:
    """The points of a `Collocation` and their orientations, a `DeformedRod`.

    Attributes:
        s: arc coordinate of the points [m], (points,).
    """

    def __init__(self, collocation: Collocation, orientation: Quaternions) -> None:
        """Take the ``orientation`` (points,) of the cross sections at the points."""
        self._collocation, self._orientation = collocation, orientation
        self.s = collocation.s

    def rotation_at(self, s: float) -> FloatArray:
        """Orientation (3, 3) of the cross section at ``s`` [m], columns t, n and b."""
        readout = read_at(self._collocation, s)
        a, b = self._orientation.part(slice(0, self.s.size))
        parts = readout.interpolate(np.stack([a.real, a.imag, b.real, b.imag]))
        found = unit(Quaternions(parts[0] + 1j * parts[1], parts[2] + 1j * parts[3]))
        return np.asarray(found.matrix()[..., 0])

    def integrate_from_tip(self, values: FloatArray) -> FloatArray:
        """Integral along s of ``values`` (..., points) from each point to the tip."""
        return self._collocation.integrate_from_tip(values)


def read_at(collocation: Collocation, s: float) -> Readout:
    """Interpolation from the points to ``s`` [m], in the element that contains or ends at it."""
    place = np.array([s])
    return collocation.readout(place, place)


class WithTangents:
    """The linearised equilibrium with loads that change with the shape.

    Each `Tangent` adds three columns to the system, the rotation of its cross section: the
    response of the rod without them to unit rotations is found once, and the rotations follow from
    a small system.
    """

    def __init__(
        self,
        linearised: Linearised,
        collocation: Collocation,
        rotation: FloatArray,
        tangent: FloatArray,
        tangents: tuple[Tangent, ...],
        count: int,
    ) -> None:
        """Add ``tangents`` to the system ``linearised`` about a state.

        ``rotation`` (3, 3, points) and ``tangent`` u' (3, points) are those of the state, and
        ``count`` is the number of strains, 4 or 6.

        Raises:
            ConvergenceError: if the system is singular.
        """
        self._linearised = linearised
        self._readouts = [read_at(collocation, one.s) for one in tangents]
        columns = []
        for one in tangents:
            force, moment = np.asarray(one.force), np.asarray(one.moment)
            lever = np.broadcast_to(tangent[:, np.newaxis], force.shape)
            moment = moment + collocation.integrate_from_tip(cross(lever, force))
            wrench = np.stack([moment, force])
            columns.append(np.einsum('jin,kjcn->kicn', rotation, wrench))
        wrenches = np.concatenate(columns, axis=2).reshape(6, -1, rotation.shape[-1])
        self._by_turn = linearised.solve(wrenches[:count])
        turns = self._turns(self._by_turn)
        self._system = np.eye(len(turns)) - turns
        sign, _ = np.linalg.slogdet(self._system)
        if not sign:
            raise ConvergenceError('the balance under load', np.inf, 0)
        self._sign = int(sign)

    def _turns(self, response: Response) -> FloatArray:
        """Rotation vectors, in a ``response``, of the cross sections of all tangents.

        Returns:
            (3 x number of tangents, columns) [rad].
        """
        return np.concatenate(
            [readout.interpolate(response.turn)[..., 0] for readout in self._readouts]
        )

    @property
    def sign(self) -> int:
        """Sign of the determinant of the whole system, 1 or -1."""
        return self._linearised.sign * self._sign

    def solve(self, imbalance: FloatArray) -> Response:
        """Response to small ``imbalance`` (n, columns, points), in axes of the cross sections."""
        direct = self._linearised.solve(imbalance)
        turns = np.linalg.solve(self._system, self._turns(direct))
        return Response(
            *(
                part + np.einsum('ikn,kc->icn', by_turn, turns)
                for part, by_turn in zip(direct, self._by_turn)
            )
        )
