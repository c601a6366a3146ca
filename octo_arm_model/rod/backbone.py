"""The shape of the arm, the result of every solve, and its evaluation at the stations.

Integrals of a collocated solution are far more exact at the ends of elements than inside them. One
more step makes them as exact everywhere (iterated collocation): it integrates moments at more
points of each element, and finds the twists that balance them. Stations follow from these by
integration and interpolation. If tendons with friction slip, tensions and strains have kinks
between the points, but wrenches do not: they are interpolated, and balanced at the stations.
"""

import functools
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.rod.equilibrium import Equilibrium, NodeCondition, Problem, State
from octo_arm_model.rod.factors import Linear
from octo_arm_model.rod.friction import Band
from octo_arm_model.rod.loads import pose_rates
from octo_arm_model.rod.section_arrays import Bends, tendons_at
from octo_arm_model.rod.tables import errors_between, places_at, tabulate, work_arrays


@dataclass(frozen=True, eq=False)
class Backbone:
    """The shape of the arm at every station, from base to tip. Its arrays are read-only.

    The leading axes are those of the tensions; ``s`` and ``section`` are common to a batch.

    Attributes:
        model: name of the model.
        s: arc coordinate along the reference configuration [m], (stations,).
        section: section a station belongs to, numbered from the tip; 0 beyond the last
            anchorage, (stations,). Values at an anchorage are those on the side of the base.
        position: position of the cross section [m], (..., stations, 3).
        quaternion: orientation x, y, z, w of the cross section, (..., stations, 4); the local x
            axis is the tangent t, y is n and z is b.
        tau: torsion about t [1/m], (..., stations).
        xi: curvature about n [1/m], (..., stations).
        k: curvature about b [1/m], (..., stations).
        q: longitudinal strain [-], (..., stations).
        tensions: tensions of the tendons [N], ``(..., *Arm.tension_shape)``.
        tip_wrench: force and moment on the tip, with the loads, in base_frame [N, N m], (..., 6).
        residual: relative residual of the model's equations [-], (...).
        iterations: iterations of the solver, (...).
        equilibrium: equilibrium of a single arm, from which `Solver.solve` continues as ``start``;
            None for a batch.
        reach: local tension over that at the base of each tendon, without friction: 1 up to its
            anchorage and 0 beyond, (stations, tendons).
        slid_tensions: tensions of tendons with friction at the stations [N], (..., stations,
            tendons); None without friction.
        point_tensions: tensions at the points of the model [N], (tendons, points): the history
            from which `Solver.follow` continues; only for a single arm with friction.
    """

    model: str
    s: FloatArray
    section: IntArray
    position: FloatArray
    quaternion: FloatArray
    tau: FloatArray
    xi: FloatArray
    k: FloatArray
    q: FloatArray
    tensions: FloatArray
    tip_wrench: FloatArray
    residual: FloatArray
    iterations: IntArray
    equilibrium: Equilibrium | None = None
    reach: FloatArray | None = None
    slid_tensions: FloatArray | None = None
    point_tensions: FloatArray | None = None

    @property
    def tendon_tensions(self) -> FloatArray:
        """Tension of every tendon at every station [N], (..., stations, tendons).

        The tension at the base less the loss by friction, and 0 beyond the anchorage.
        """
        if self.slid_tensions is not None:
            return self.slid_tensions
        assert self.reach is not None
        batch = self.position.shape[:-2]
        return self.tensions.reshape(*batch, 1, self.reach.shape[-1]) * self.reach

    @property
    def twist(self) -> FloatArray | None:
        """Motion of the frame per reference length at the nodes of the model, (4 or 6, nodes).

        It is in the axes of the frame: angular (1 + q) (tau, xi, k) [1/m], then linear 1 + q [-]
        along t, and shear along n and b, if any. None for a batch.
        """
        return None if self.equilibrium is None else self.equilibrium.state.z.T

    @property
    def tip(self) -> FloatArray:
        """Position of the tip [m], (..., 3)."""
        return self.position[..., -1, :]


# At the stations ---------------------------------------------------------------------------------

# Loads at points of an arm, twists (n, m) that balance wrenches, and the wrenches (n, m): moment
# and force from beyond each point, in the axes of its section.
Balance: TypeAlias = tuple[NodeCondition, FloatArray, FloatArray]
ONE_STEP = 1e300  # residual before the last step to the balance of sections


class FinePoints:
    """More points of each element, whose sections balance the wrenches of an equilibrium.

    Attributes:
        problem: the equations at the nodes.
        own: the equations at the points.
    """

    def __init__(self, problem: Problem, own: Problem) -> None:
        """Prepare the points of ``own``, which has the elements of ``problem``."""
        self.problem, self.own = problem, own
        self._between = problem.elements.interpolation(own.elements.s)
        self._of_fine: FloatArray | None = None
        if problem.friction is not None:
            self._of_fine = problem.friction.projection(own.elements)
        self.to_nodes = own.elements.interpolation(problem.elements.s)
        self._balance: tuple[State, Balance] | None = None

    def balance(self, state: State) -> Balance:
        """Return the `Balance` at the points in ``state``; that of the last state is kept."""
        if self._balance is None or self._balance[0] is not state:
            self._balance = state, self._find_balance(state)
        return self._balance[1]

    def _find_balance(self, state: State) -> Balance:
        own, condition, z = self.own, state.condition, self._between @ state.z
        if self.problem.friction is not None:
            condition = condition._replace(tensions=self._slid(state))
        if (contact := self.problem.contact) is not None:
            # For stiff obstacles the depths at the points differ too much from those at the nodes.
            self.problem.orient(state.z)
            own.touching = contact.densities(self.problem.places(), to=own.contact)
        at_nodes, wrench = own.wrenches(own.at_nodes(condition), z)
        z = z.copy()  # The orientations of the other array stay known.
        inside = own.in_sections(at_nodes.tensions)
        own.form.balance(own.tables, z, inside, wrench, ONE_STEP, own.work)
        return at_nodes, z, wrench

    def error_between(self, fine: FloatArray) -> float:
        """Return the estimated error of positions by ``fine`` twists, over the length [-]."""
        return float(errors_between(self.own.position_error(fine)))

    def error_at_nodes(self, state: State, factors: Linear) -> float:
        """Return the estimated error of positions at nodes and tip, over the length [-].

        The balance at the points has an imbalance that the nodes do not show. ``factors`` of the
        Jacobian give the change of the twists that removes it, which is large for a soft arm.
        """
        (at_nodes, fine, _), problem = self.balance(state), self.problem
        imbalance = self.to_nodes @ self.own.evaluate(at_nodes, fine).imbalance - state.imbalance
        change = factors.solve(imbalance.ravel()).reshape(*state.z.shape, 1)
        problem.orient(state.z)
        work, from_base = problem.work, problem.elements.from_base
        rates = pose_rates(from_base, work.rotation, work.slope, change)[:, :3, 0]
        places = np.concatenate([from_base @ rates, [problem.elements.weights @ rates]])
        return float(np.linalg.norm(places, axis=1).max() / problem.elements.edges[-1])

    def _slid(self, state: State) -> FloatArray:
        friction, local = self.problem.friction, self.problem.local_tensions(state)
        assert friction is not None
        if local.band is not None:
            assert self._of_fine is not None
            return friction.spread(self._of_fine, local.band.tensions)
        loss = self.problem.tables.friction * (self._between @ local.angle)
        base = state.condition.tensions * self.own.tables.reach
        return np.asarray(base * np.exp(-loss))

    def friction_error(self, state: State) -> float:
        """Return the estimated relative error of tensions with friction."""
        (at_nodes, z, _), own = self.balance(state), self.own
        own.form.angles(own.tables, z, at_nodes.tensions, own.work)
        means = []
        for each, angle in (
            (self.problem, self.problem.local_tensions(state).angle),
            (own, own.work.angle),
        ):
            parts = each.elements.weights[:, np.newaxis] * angle
            means.append(parts.reshape(own.elements.lengths.size, each.elements.points, -1).sum(1))
        change = (means[0] - means[1]) / own.elements.lengths[:, np.newaxis]
        return float(np.abs(change * own.tables.friction).max())


class Readout:
    """The evaluation of equilibria of a `Problem` at stations.

    Attributes:
        places: the stations among the finer points.
    """

    def __init__(self, finer: FinePoints, arm: Arm, s: FloatArray) -> None:
        """Prepare stations at the arc coordinates ``s`` (S,) [m] of ``arm``."""
        self._problem, self._finer, self._s = finer.problem, finer, s
        elements, own = finer.own.elements, finer.own
        self.places = places_at(elements, s)
        self._straight = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])[: own.strains]
        if finer.problem.friction is not None:
            at = s, elements.sections[self.places.element]
            self._tables = tabulate(arm, elements, own.tables.base, law=own.tables.law, at=at)
            self._work = work_arrays(self._tables, own.strains, has_jacobian=False)

    def read(
        self, state: State, fine: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
        """Return poses, twists and tensions in ``state``; ``fine`` are known twists at the points.

        Positions (S, 3) [m] from the base, quaternions x, y, z, w (S, 4), twists (S, m), and
        tensions (S, J) [N] of tendons with friction, also beyond their anchorages.
        """
        finer, along = self._finer.own, None
        if fine is not None:
            twist = self.twists(fine)
        else:
            at_nodes, fine, wrench = self._finer.balance(state)
            twist = self.twists(fine)
            if finer.friction is not None and finer.discs is not None:
                along = self.places.between @ at_nodes.tensions
            elif finer.friction is not None:
                along = self._slid(state, self._angle(at_nodes, fine))
                form, wrench = finer.form, self.places.between @ wrench
                form.balance(self._tables, twist, along, wrench, ONE_STEP, self._work)
        finer.orient(fine)
        position, quaternion, _ = finer.form.poses(finer.tables, fine, self.places, finer.work)
        return position[0], quaternion[0], twist, along

    def twists(self, fine: FloatArray) -> FloatArray:
        """Return the twists at the stations, (..., S, m), by ``fine`` ones (..., n, m)."""
        # Strains are interpolated, so that zero strain stays exactly zero.
        strained = self.places.between @ (fine - self._straight)
        return np.asarray(strained + self._straight)

    def _angle(self, at_nodes: NodeCondition, z: FloatArray) -> FloatArray:
        """Return the angle by which tendons have turned up to the stations [rad], (S, J)."""
        tables, elements = self._finer.own.tables, self._finer.own.elements
        tendons = tendons_at(tables, z, at_nodes.tensions, self._finer.own.work)
        bends = Bends(tables, z, tendons.unit.swapaxes(1, 2), tables.reach[:, tendons.pulled])
        fine = tables.to_fine @ bends.bend.reshape(3, elements.lengths.size, elements.points, -1)
        rate = np.sqrt((fine * fine).sum(axis=0)).reshape(-1, fine.shape[3])
        angle = np.zeros((self._s.size, tables.friction.size))
        kinks = bends.kink_angles.cumsum(axis=0)[self.places.element]
        angle[:, tendons.pulled] = self._turned @ rate + kinks
        return angle

    def _slid(self, state: State, angle: FloatArray) -> FloatArray:
        """Return tensions with friction at the stations (S, J) by an ``angle`` (S, J) [rad]."""
        condition = state.condition
        base, loss = condition.tensions, self._problem.tables.friction * angle
        if condition.before is None:
            return np.asarray(base * np.exp(-loss))
        return Band.of(base, loss, self._of_history @ condition.before).tensions

    @functools.cached_property
    def _turned(self) -> FloatArray:
        """Matrix from rates at the fine points to integrals up to the stations, (S, M)."""
        return self._finer.own.elements.fine.integration(self._s)

    @functools.cached_property
    def _of_history(self) -> FloatArray:
        """Matrix from a history of friction to tensions at the stations, (S, M)."""
        return self._problem.elements.fine.interpolation(self._s)
