"""What an equilibrium is at the stations.

At the ends of elements integrals of a collocated solution are far more exact than within. They
are as exact everywhere after one more step (iterated collocation): moments at more points of each
element, which are integrals, and the twists there that balance them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from octo_arm_model.core.arm.arm import Arm
from octo_arm_model.core.hints import FloatArray
from octo_arm_model.core.numerics.quaternion import quaternion_rates, rotation_matrices
from octo_arm_model.rod.equilibrium import Acting, Problem, State
from octo_arm_model.rod.friction import clipped
from octo_arm_model.rod.tables import force_scale, tabulate, work_arrays

ADDED_POINTS = 5  # in each element
_STEPS = 2  # of Newton's method, of every section at the stations


class Reading(NamedTuple):
    """Poses of the cross sections at the stations.

    Attributes:
        position: (S, 3) [m], from the base.
        quaternion: w, x, y, z, (S, 4).
        moment: of all that acts beyond, in base_frame, without free moments, (S, 3) [N m].
        z: twists at the nodes of the finer problem, (n, m).
        acting: what acts at these.
        tensions: of every tendon at the stations [N], (S, J).
    """

    position: FloatArray
    quaternion: FloatArray
    moment: FloatArray
    z: FloatArray
    acting: Acting
    tensions: FloatArray


class Readout:
    """Reads equilibria of a `Problem` at stations."""

    def __init__(self, problem: Problem, finer: Problem, arm: Arm, s: FloatArray) -> None:
        """At arc coordinates ``s`` (S,) [m] of ``arm``.

        ``finer`` has the elements of ``problem`` with `ADDED_POINTS` in each.
        """
        self._problem, self._finer = problem, finer
        self._to_finer = problem.elements.interpolation(finer.elements.s)
        self._integration = finer.elements.integration(s)
        self._interpolation = finer.elements.interpolation(s)
        self._to_stations, self._s = problem.elements.interpolation(s), s
        own = problem.tables
        self._tables = tabulate(arm, finer.elements, own.base, widens=own.widens, s=s)
        self._work = work_arrays(self._tables, problem.strains, has_jacobian=False)

    def read(self, state: State) -> Reading:
        """Poses at the stations, by integrals from the base."""
        finer, condition = self._finer, state.acting.condition
        between = None
        if condition.tensions.ndim > 1:
            # Given at the nodes.
            condition = condition._replace(tensions=self._to_finer @ condition.tensions)
        elif self._problem.friction is not None:
            local, between = self._slid(state)
            condition = condition._replace(tensions=local)
        work, z = finer.work, self._to_finer @ state.z
        acting = finer.evaluate(finer.acting(condition), z).acting
        wrench = work.gradient - work.residual
        finer.form.section_steps(finer.tables, z, acting.tensions, wrench, work)
        z = z + work.step
        finer.form.orientations(finer.tables, z, work)
        rates = np.empty((len(z), 10))
        rates[:, :3] = work.slope
        quaternion_rates(work.quaternion, z[:, :3], rates[:, 3:7])
        carried = rates[:, 7:]
        x, f = work.slope.T, acting.force.T
        carried[:, 0] = x[1] * f[2] - x[2] * f[1]
        carried[:, 1] = x[2] * f[0] - x[0] * f[2]
        carried[:, 2] = x[0] * f[1] - x[1] * f[0]
        found = self._integration @ rates
        turn = found[:, 3:7]
        turn += finer.tables.base
        turn /= np.sqrt((turn * turn).sum(axis=1, keepdims=True))
        # What acts beyond a station: the moment at the base less what is carried up to there.
        moment = finer.elements.weights @ carried - found[:, 7:]
        if between is None:
            between = self._interpolation @ acting.tensions
        return Reading(found[:, :3], turn, moment, z, acting, between)

    def _slid(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Tensions with friction at the finer nodes and at the stations, (n, J) and (S, J)."""
        friction, before = self._problem.friction, state.acting.condition.before
        assert friction is not None
        sliding, mu = self._problem.sliding(state), self._problem.tables.friction
        base = state.acting.condition.tensions
        at_stations = mu * (self._to_stations @ sliding.angle)
        if before is None:
            finer = (
                base * self._finer.tables.reach * np.exp(-mu * (self._to_finer @ sliding.angle))
            )
            return finer, base * self._tables.reach * np.exp(-at_stations)
        assert sliding.along is not None
        finer = friction.spread(friction.projection(self._finer.elements), sliding.along)
        before = friction.fine.interpolation(self._s) @ before
        return finer, clipped(base * self._tables.reach, before, at_stations)[0]

    def twists(self, reading: Reading) -> FloatArray:
        """Twists (S, m) at the stations, each in balance with the wrench of the loads there."""
        acting, work, strains = reading.acting, self._work, reading.z.shape[1]
        between = self._interpolation @ np.concatenate(
            [reading.z, acting.force, acting.couple], axis=1
        )
        z = np.ascontiguousarray(between[:, :strains])
        tensions = reading.tensions
        work.scale[:] = force_scale(self._tables, tensions)
        moment = reading.moment + between[:, strains + 3 : strains + 6]
        inverse = rotation_matrices(np.ascontiguousarray(reading.quaternion.T)).transpose(2, 1, 0)
        wrench = np.empty_like(z)
        wrench[:, :3] = (inverse @ moment[..., np.newaxis])[..., 0]
        force = inverse @ between[:, strains : strains + 3, np.newaxis]
        wrench[:, 3:] = force[:, : strains - 3, 0]
        for _ in range(_STEPS):
            self._problem.form.section_steps(self._tables, z, tensions, wrench, work)
            z = z + work.step
        return z


def integrate_poses(
    problem: Problem, z: FloatArray, integration: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions (S, 3) [m] from the base and quaternions w, x, y, z (S, 4) at stations.

    From twists ``z`` (N, m) whose orientations are in ``problem.work``, by the matrix
    ``integration`` (S, N) from values at the nodes to integrals up to the stations.
    """
    rates = np.empty((len(z), 7))
    rates[:, :3] = problem.work.slope
    quaternion_rates(problem.work.quaternion, z[:, :3], rates[:, 3:])
    found = integration @ rates
    turn = found[:, 3:] + problem.tables.base
    turn /= np.sqrt((turn * turn).sum(axis=1, keepdims=True))
    return found[:, :3], turn
