"""What an equilibrium is at the stations.

At the ends of elements integrals of a collocated solution are far more exact than within. They
are as exact everywhere after one more step (iterated collocation): moments at more points of each
element, which are integrals, and the twists there that balance them.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.arrays import Bends
from octo_arm_model.rod.equilibrium import Acting, Problem, State
from octo_arm_model.rod.friction import clipped
from octo_arm_model.rod.quaternion import quaternion_rates, rotation_matrices
from octo_arm_model.rod.tables import Work, force_scale, tabulate, work_arrays
from octo_arm_model.rod.unloaded import straight_twists

ADDED_POINTS = 5  # in each element
# Steps of Newton's method of the sections at the stations, and the residual before the last one.
_MOST_STEPS, _LAST_STEP = 10, 1e-7


class Reading(NamedTuple):
    """Poses of the cross sections at the stations.

    Attributes:
        position: (S, 3) [m], from the base.
        quaternion: w, x, y, z, (S, 4).
        slope: r' at the nodes of the finer problem until it reads again, (n, 3).
        z: twists at the nodes of the finer problem, (n, m).
        acting: what acts at these.
        tensions: of tendons with friction at the stations [N], (S, J).
    """

    position: FloatArray
    quaternion: FloatArray
    slope: FloatArray
    z: FloatArray
    acting: Acting
    tensions: FloatArray


class Finer:
    """More points of each element, where sections balance what acts at the nodes.

    Attributes:
        problem: the nodes.
        own: the equations at the points.
    """

    def __init__(self, problem: Problem, own: Problem) -> None:
        """``own`` has the elements of ``problem`` with `ADDED_POINTS` in each."""
        self.problem, self.own = problem, own
        self._between = problem.elements.interpolation(own.elements.s)
        self._of_fine: FloatArray | None = None
        if problem.friction is not None:
            self._of_fine = problem.friction.projection(own.elements)
        self.to_nodes = own.elements.interpolation(problem.elements.s)
        self._scale = np.ones((own.elements.s.size, 2))  # as no residual is looked at

    def balance(self, state: State) -> tuple[Acting, FloatArray]:
        """What acts there in ``state``, and the twists (n, m) that balance it."""
        own, condition = self.own, state.acting.condition
        if condition.tensions.ndim > 1:
            # Given at the nodes.
            condition = condition._replace(tensions=self._between @ condition.tensions)
        elif self.problem.friction is not None:
            condition = condition._replace(tensions=self._slid(state))
        work, z, tensions = own.work, self._between @ state.z, condition.tensions
        if tensions.ndim == 1:
            tensions = np.empty((len(z), tensions.size))
            tensions[:] = condition.tensions
        force, couple = own.loads.at(condition.factor, condition.tip_wrench)
        acting = own.evaluate(Acting(condition, tensions, force, couple, self._scale), z).acting
        wrench = work.gradient - work.residual
        own.form.section_steps(own.tables, z, acting.tensions, wrench, work)
        return acting, z + work.step

    def _slid(self, state: State) -> FloatArray:
        friction, sliding = self.problem.friction, self.problem.sliding(state)
        assert friction is not None
        if sliding.along is not None:
            assert self._of_fine is not None
            return friction.spread(self._of_fine, sliding.along)
        loss = self.problem.tables.friction * (self._between @ sliding.angle)
        base = state.acting.condition.tensions * self.own.tables.reach
        return np.asarray(base * np.exp(-loss))

    def friction_error(self, state: State) -> float:
        """Estimated error of tensions with friction, in parts of them."""
        (acting, z), own = self.balance(state), self.own
        own.form.angles(own.tables, z, acting.tensions, own.work)
        means = []
        for one, angle in (
            (self.problem, self.problem.sliding(state).angle), (own, own.work.angle),
        ):  # fmt: skip
            parts = one.elements.weights[:, np.newaxis] * angle
            means.append(parts.reshape(own.elements.lengths.size, one.elements.points, -1).sum(1))
        change = (means[0] - means[1]) / own.elements.lengths[:, np.newaxis]
        return float(np.abs(change * own.tables.friction).max())


class Readout:
    """Reads equilibria of a `Problem` at stations.

    Attributes:
        integration: from values at the finer points to integrals up to the stations, (S, n).
        interpolation: from values at the finer points to those at the stations, (S, n).
    """

    def __init__(self, finer: Finer, arm: Arm, s: FloatArray) -> None:
        """At arc coordinates ``s`` (S,) [m] of ``arm``."""
        self._problem, self._finer, self._s = finer.problem, finer, s
        elements, own = finer.own.elements, finer.own.tables
        self.integration, self.interpolation = elements.integration(s), elements.interpolation(s)
        self._fine = elements.fine.integration(s)
        self._tables = tabulate(arm, elements, own.base, widens=own.widens, s=s)
        self._work = work_arrays(self._tables, finer.problem.strains, has_jacobian=False)

    def read(self, state: State) -> Reading:
        """Poses at the stations, by integrals from the base."""
        (acting, z), finer = self._finer.balance(state), self._finer.own
        work, given = finer.work, state.acting.condition.tensions
        if given.ndim > 1:
            between = self.interpolation @ acting.tensions
        elif self._problem.friction is not None:
            between = self._slid(state, self._angle(acting, z))
        else:
            between = np.empty((self._s.size, given.size))
            between[:] = given
        finer.form.orientations(finer.tables, z, work)
        position, turn = integrate_poses(work, finer.tables.base, z, self.integration)
        return Reading(position[0], turn[0], work.slope, z, acting, between)

    def read_unloaded(self, fine: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, quaternions w, x, y, z and twists at the stations, of an arm without loads.

        From its twists (n, m) at the finer points.
        """
        finer = self._finer.own
        finer.orient(fine)
        position, turn = integrate_poses(finer.work, finer.tables.base, fine, self.integration)
        # So that there is exactly no strain where there is none.
        z = self.interpolation @ (fine - straight_twists(fine.shape[1]))
        return position[0], turn[0], z + straight_twists(fine.shape[1])

    def _angle(self, acting: Acting, z: FloatArray) -> FloatArray:
        """Angle by which tendons have turned up to the stations [rad], (S, J)."""
        tables, elements = self._finer.own.tables, self._finer.own.elements
        bends = Bends(tables, z, acting.tensions, self._finer.own.work)
        fine = tables.to_fine @ bends.bend.reshape(3, elements.lengths.size, elements.points, -1)
        rate = np.sqrt((fine * fine).sum(axis=0)).reshape(-1, fine.shape[3])
        found = np.zeros(self._tables.reach.shape)
        kinks = bends.kink_angles.cumsum(axis=0)[elements.element_at(self._s)]
        found[:, bends.tendons.pulled] = self._fine @ rate + kinks
        return found

    def _slid(self, state: State, angle: FloatArray) -> FloatArray:
        """Tensions with friction at the stations (S, J), for an ``angle`` (S, J) [rad]."""
        condition = state.acting.condition
        base, loss = condition.tensions * self._tables.reach, self._tables.friction * angle
        if condition.before is None:
            return np.asarray(base * np.exp(-loss))
        return clipped(base, self._of_history @ condition.before, loss)

    @functools.cached_property
    def _of_history(self) -> FloatArray:
        """From a history of friction to the stations, (S, M)."""
        return self._problem.elements.fine.interpolation(self._s)

    def twists(self, reading: Reading) -> FloatArray:
        """Twists (S, m) at the stations, each in balance with the wrench of the loads there."""
        acting, work, strains = reading.acting, self._work, reading.z.shape[1]
        between = self.interpolation @ np.concatenate(
            [reading.z, acting.force, acting.couple], axis=1
        )
        z = np.ascontiguousarray(between[:, :strains])
        tensions = reading.tensions
        work.scale[:] = force_scale(self._tables, tensions)
        # What acts beyond a station: the moment at the base less what is carried up to there.
        carried = np.cross(reading.slope, acting.force)
        moment = self._finer.own.elements.weights @ carried - self.integration @ carried
        moment += between[:, strains + 3 : strains + 6]
        inverse = rotation_matrices(np.ascontiguousarray(reading.quaternion.T)).transpose(2, 1, 0)
        wrench = np.empty_like(z)
        wrench[:, :3] = (inverse @ moment[..., np.newaxis])[..., 0]
        force = inverse @ between[:, strains : strains + 3, np.newaxis]
        wrench[:, 3:] = force[:, : strains - 3, 0]
        return self._settled(z, tensions, wrench)

    def settled(self, z: FloatArray, tensions: FloatArray) -> FloatArray:
        """Twists (S, m) near ``z`` in balance with ``tensions`` (J,) [N] without loads."""
        local = tensions * self._tables.reach
        self._work.scale[:] = force_scale(self._tables, local)
        return self._settled(np.ascontiguousarray(z), local, np.zeros_like(z))

    def _settled(self, z: FloatArray, tensions: FloatArray, wrench: FloatArray) -> FloatArray:
        for _ in range(_MOST_STEPS):
            left = self._problem.form.section_steps(self._tables, z, tensions, wrench, self._work)
            z = z + self._work.step
            if not left > _LAST_STEP:
                break
        return z


def integrate_poses(
    work: Work, base: FloatArray, z: FloatArray, integration: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions (A, S, 3) [m] from the base and quaternions w, x, y, z (A, S, 4) at stations.

    Of A arms from twists ``z`` (A N, m) whose orientations are in ``work``, by the matrix
    ``integration`` (S, N) from values at the nodes to integrals up to the stations. ``base`` is
    the orientation of the base.
    """
    rates = np.empty((7, len(z)))
    rates[:3] = work.slope.T
    quaternion_rates(work.quaternion, z[:, :3], rates[3:].T)
    found = rates.reshape(-1, integration.shape[1]) @ integration.T
    found = found.reshape(7, -1, len(integration))
    turn = found[3:]
    turn += base[:, np.newaxis, np.newaxis]
    turn /= np.sqrt((turn * turn).sum(axis=0))
    return np.ascontiguousarray(found[:3].transpose(1, 2, 0)), turn.transpose(1, 2, 0)
