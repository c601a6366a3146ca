"""The equations of one arm at its nodes, and its states, in equilibrium or not."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConvergenceError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.loads import Loads
from octo_arm_model.rod.contact import Contact, NodeMotion
from octo_arm_model.rod.discs import ChordModel, ChordTendons, ChordTensionDerivatives
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.factors import Factors, Linear, Variation, factorise
from octo_arm_model.rod.forms import Form
from octo_arm_model.rod.friction import Friction, LocalTensions, TensionDerivatives
from octo_arm_model.rod.loads import DeadLoads, NodeRod, OtherLoads, add_tangents
from octo_arm_model.rod.tables import (
    LEVER,
    Places,
    Tables,
    Work,
    force_scale,
    places_at,
    work_arrays,
)
from octo_arm_model.rod.tendons import Tendons, unloaded_twists


class Condition(NamedTuple):
    """The condition of an arm: tensions, loads, and lengths that winches hold."""

    #: tensions of the tendons at the base, (J,), or at every node, (N, J) [N]
    tensions: FloatArray
    tip_wrench: FloatArray  #: force and moment on the tip in base_frame, (6,) [N, N m]
    factor: float = 1.0  #: factor on all other loads [-], from 0 to 1
    #: tensions at the points `Friction.fine` from which tendons with friction slide, (M, J) [N];
    #: None if they were slack
    before: FloatArray | None = None
    #: lengths that winches have reeled in [m], (J,), used where ``driven``
    lengths: FloatArray = np.zeros(0)
    #: whether a winch holds the length of a tendon, not its tension, (J,); empty if there are no
    #: winches
    driven: NDArray[np.bool_] = np.zeros(0, np.bool_)
    #: factor on the stiffness of obstacles [-], less than 1 on the way to a shape
    rigidity: float = 1.0

    def towards(self, other: Condition, part: float) -> Condition:
        """Return the condition at the fraction ``part`` of the way to an ``other`` one."""
        if part == 1.0:
            return other
        lengths = self.lengths if other.driven.size else other.lengths
        return other._replace(
            tensions=self.tensions + part * (other.tensions - self.tensions),
            tip_wrench=self.tip_wrench + part * (other.tip_wrench - self.tip_wrench),
            factor=self.factor + part * (other.factor - self.factor),
            rigidity=self.rigidity ** (1.0 - part) * other.rigidity**part,
            lengths=lengths + part * (other.lengths - lengths),
        )


class NodeCondition(NamedTuple):
    """Tensions and loads of a condition at the nodes."""

    condition: Condition
    tensions: FloatArray  #: tension of every tendon at every node [N], (N, J)
    force: FloatArray  #: force of all loads beyond each node, in base_frame, (N, 3) [N]
    #: free moment of these loads, without the moment of the forces, (N, 3) [N m]
    couple: FloatArray
    dead: FloatArray  #: force and couple of the loads that do not depend on the shape, (2, N, 3)

    @property
    def is_touching(self) -> bool:
        """Whether other loads than dead ones act, such as those of obstacles that are touched."""
        return bool((self.force != self.dead[0]).any())


class State(NamedTuple):
    """Twists of an arm in a condition, in equilibrium or not."""

    at_nodes: NodeCondition  #: tensions and loads at the nodes
    z: FloatArray  #: twists, (N, m) [1/m and -]
    #: gradient of the energy less the wrench of the loads, (N, m) [N m and N]
    imbalance: FloatArray
    residual: float  #: largest imbalance over its scale [-]; NaN where a strain is impossible
    #: lengths that winches have reeled in, or that would make slack tendons taut [m], (J,)
    reeled: FloatArray = np.zeros(0)
    #: target less ``reeled`` [m], (J,); zero for tendons that are not driven
    wrong: FloatArray = np.zeros(0)

    @property
    def condition(self) -> Condition:
        """The condition of the arm."""
        return self.at_nodes.condition


class Equilibrium(NamedTuple):
    """A stable equilibrium of a `Rod`."""

    state: State  #: twists at the nodes, and the condition
    level: int  #: index in `elements.LEVELS` of the level of its nodes
    #: factors of the Jacobian at an equilibrium nearby; None for an arm without loads
    factors: Linear | None
    #: the equilibrium of these factors, if it is stable by a margin; else None
    firm_state: State | None
    iterations: int  #: number of all iterations
    fine: FloatArray | None = None  #: twists at the finer points, for an arm without loads
    key: object | None = None  #: key of the factors of this equilibrium in `RecentFactors`
    #: twists from which the next search starts, (N, m), without continuation if it fails; None to
    #: start from these twists
    guess: FloatArray | None = None


class Problem:
    """The residual and Jacobian of one arm under its loads.

    Attributes:
        elements: the elements and their nodes.
        tables: the arm at the nodes.
        form: the node functions.
        work: arrays with the results of the last node functions.
        loads: dead loads, all but the wrench on the tip.
        others: loads of other kinds.
        contact: contact with obstacles; None if there are no obstacles.
        follows: whether there are loads that depend on the shape.
        touching: force and moment per length by obstacles, if they are known from other nodes,
            (2, N, 3) [N/m, N].
        strains: number of strains of a section: 4, or 6 with shear.
        friction: friction of the tendons; None if they have none.
        discs: discs that guide the tendons; None if the body does.
        measure: weights of squared twists whose sum is the mean square strain, (N m,).
    """

    remembered = 1  # last residuals that `continuation.newton` compares with

    def __init__(
        self,
        arm: Arm,
        elements: Elements,
        tables: Tables,
        loads: Loads,
        form: Form,
        strains: int,
        has_jacobian: bool = True,
    ) -> None:
        """Set up ``arm`` under ``loads``, with its ``tables`` at the nodes of ``elements``."""
        self.elements, self.form, self.strains = elements, form, strains
        self.discs = ChordModel(arm, elements, tables, form) if arm.discs.s else None
        self.loads, self._slack = DeadLoads(arm, elements, loads), np.zeros_like(tables.reach)
        self.others = OtherLoads(loads.others, elements, tables.base)
        self.others.has_obstacles = bool(loads.obstacles)
        self.tables, self.contact = tables, None
        if loads.obstacles:
            self.contact = Contact(arm, elements, loads.obstacles)
            least_scale = tables.least_scale + self.contact.rounding
            self.tables = tables = tables._replace(least_scale=least_scale)
        self.touching: FloatArray | None = None
        self.follows = bool(loads.others or loads.obstacles)
        self.work = work_arrays(tables, strains, has_jacobian=has_jacobian)
        self._tip = places_at(elements, elements.edges[-1:])
        self._current: FloatArray | None = None
        self._oriented: FloatArray | None = None
        self._scaled: FloatArray | None = None
        self.friction: Friction | None = None
        if tables.friction.any():
            angles = form.angles if self.discs is None else self.discs.angles
            self.friction = Friction(tables, angles, elements)
        self._local: LocalTensions | None = None
        self._tendons: tuple[State, Tendons] | None = None
        self._derivatives: tuple[State, TensionDerivatives] | None = None
        self._held: FloatArray | None = None
        unit = np.ones((elements.s.size, strains))
        unit[:, :3] = tables.body[:, LEVER, np.newaxis]
        # Twists become strains by the lever of the section; squares are averaged over the arm.
        unit *= unit * (elements.weights / elements.edges[-1])[:, np.newaxis]
        self.measure = unit.ravel()

    def at_nodes(self, condition: Condition) -> NodeCondition:
        """Return tensions and dead loads of a ``condition`` at the nodes."""
        tensions = condition.tensions
        if tensions.ndim == 1:
            tensions = np.empty((self.elements.s.size, tensions.size))
            tensions[:] = condition.tensions
        dead = self.loads.at(condition.factor, condition.tip_wrench)
        return NodeCondition(condition, tensions, dead[0], dead[1], dead)

    def straight_resultants(self) -> FloatArray:
        """Return force and free moment of the ``loads`` on the straight rod, (2, N, 3)."""
        dead = self.loads.at(1.0, np.zeros(6))
        return dead + self.others.resultants(self.others.straight())

    def evaluate(self, at_nodes: NodeCondition, z: FloatArray) -> State:
        """Return the state of twists ``z`` (N, m), an array that must not change any more."""
        work, tensions = self.work, at_nodes.condition.tensions
        if self._scaled is not tensions:
            self._scaled = tensions
            work.scale[:] = force_scale(self.tables, tensions)
        self.form.orientations(self.tables, z, work)
        at_nodes = self._following(at_nodes, z)
        self._fill_wrenches(at_nodes, z)
        residual = self._add_gradients(at_nodes, z)
        self._current = self._oriented = z
        return State(at_nodes, z, work.residual.copy(), residual)

    def _fill_wrenches(self, at_nodes: NodeCondition, z: FloatArray) -> None:
        """Compute minus the wrench that all beyond exerts on every cross section."""
        self.form.wrenches(self.tables, at_nodes.force, at_nodes.couple, self.work)
        if self.discs is not None:
            self.discs.add_pull(self.tables, z, at_nodes.tensions, self.work)

    def _add_gradients(self, at_nodes: NodeCondition, z: FloatArray) -> float:
        """Complete the imbalance under ``at_nodes``, and return the largest relative residual."""
        tensions = self.in_sections(at_nodes.tensions)
        return self.form.add_gradients(self.tables, z, tensions, self.work)

    def wrenches(self, at_nodes: NodeCondition, z: FloatArray) -> tuple[NodeCondition, FloatArray]:
        """Return ``at_nodes`` at twists ``z`` (N, m), and the wrenches on the sections, (N, m).

        A wrench is the moment and the force of all loads beyond the section.
        """
        work = self.work
        self.form.orientations(self.tables, z, work)
        at_nodes = self._following(at_nodes, z)
        self._fill_wrenches(at_nodes, z)
        self._current, self._oriented = None, z
        return at_nodes, -work.residual

    def _following(self, at_nodes: NodeCondition, z: FloatArray) -> NodeCondition:
        """Return ``at_nodes`` with tensions and loads updated to the twists ``z`` (N, m)."""
        at_nodes = self._with_friction(at_nodes, z)
        if not self.follows:
            return at_nodes
        force, couple = at_nodes.dead + self._following_loads(at_nodes.condition, z)
        return at_nodes._replace(force=force, couple=couple)

    def _following_loads(self, condition: Condition, z: FloatArray) -> FloatArray:
        """Return force and free moment of the loads that depend on the shape, (2, N, 3)."""
        total = np.zeros((2, len(z), 3))
        if self.others.loads:
            rod = NodeRod(self.others, self.work.quaternion, z)
            total += condition.factor * self.others.resultants(rod)
        if self.contact is not None:
            # The factor does not apply: an obstacle is there before other loads act.
            touching = self.touching
            density = self.contact.densities(*self._touched()) if touching is None else touching
            total += self.elements.to_tip @ (condition.rigidity * density)
        return total

    def in_sections(self, tensions: FloatArray) -> FloatArray:
        """Return the local ``tensions`` (N, J) in the energy of sections: zero with discs."""
        return tensions if self.discs is None else self._slack

    def _with_friction(self, at_nodes: NodeCondition, z: FloatArray) -> NodeCondition:
        """Return ``at_nodes`` with the tensions that friction leaves at twists ``z`` (N, m)."""
        condition = at_nodes.condition
        if self.friction is None or condition.tensions.ndim > 1:
            return at_nodes
        pull = condition.tensions, condition.before
        self._local = self.friction.hold_along(z, *pull, self.work)
        return at_nodes._replace(tensions=self._local.tensions)

    def step(self, state: State, factors: Linear) -> tuple[FloatArray, Linear]:
        """Return Newton's step of the twists by ``factors``, (N m,), and the ``factors``."""
        return factors.solve(-state.imbalance.ravel()), factors

    def moved(self, state: State, step: FloatArray, _: Linear) -> State:
        """Return the ``state`` after a ``step`` (N m,) of the twists."""
        return self.evaluate(state.at_nodes, state.z + step.reshape(state.z.shape))

    def local_tensions(self, state: State) -> LocalTensions:
        """Return the tensions that friction leaves in ``state``."""
        self.load_work(state)
        assert self._local is not None
        return self._local

    def tendons(self, state: State) -> Tendons:
        """Return the tendons in ``state``; those of the last state are cached."""
        if self._tendons is None or not _are_same(self._tendons[0], state):
            if self.tables.compliance.any() or self.discs is not None:
                self.load_work(state)  # for offsets in sheaths, and orientations
            tendons = self._make_tendons(state.z, state.at_nodes.tensions, self.work.offsets)
            self._tendons = state, tendons
        return self._tendons[1]

    def _make_tendons(self, z: FloatArray, tensions: FloatArray, offsets: FloatArray) -> Tendons:
        if self.discs is not None:
            return ChordTendons(self.discs, self.tables, z, tensions, self.work)
        return Tendons(self.tables, z, tensions, offsets)

    @functools.cached_property
    def unloaded_tendons(self) -> Tendons:
        """The tendons of the unloaded arm."""
        z, none = unloaded_twists(self.tables), np.zeros_like(self.work.offsets)
        if self.discs is not None:
            self.orient(z)
        return self._make_tendons(z, none[..., 0], none)

    @functools.cached_property
    def tendon_weights(self) -> FloatArray:
        """Weights of integrals along the tendons of the unloaded arm [m], (N, J)."""
        return np.asarray(self.elements.weights[:, np.newaxis] * self.unloaded_tendons.stretch)

    @functools.cached_property
    def rest_lengths(self) -> FloatArray:
        """Lengths of the tendons of the unloaded arm from base to anchorage [m], (J,)."""
        return np.asarray(self.tendon_weights.sum(axis=0))

    def mean_along_tendons(self, values: FloatArray) -> FloatArray:
        """Return means of ``values`` (N, J, k) along the tendons of the unloaded arm, (J, k)."""
        integrals = np.einsum('ij,ijk->jk', self.tendon_weights, values)
        return np.asarray(integrals / self.rest_lengths[:, np.newaxis])

    def tendon_lengths(self, state: State) -> FloatArray:
        """Return the lengths of the tendons in ``state`` from base to anchorage [m], (J,)."""
        return np.asarray(self.elements.weights @ self.tendons(state).stretch)

    def history(self, state: State) -> FloatArray:
        """Return tensions (M, J) [N] at `Friction.fine`, from which tendons slide next."""
        assert self.friction is not None
        return self.friction.history(self.local_tensions(state), state.condition.tensions)

    def first_tensions(self, condition: Condition, z: FloatArray) -> FloatArray:
        """Return a guess of local tensions (N, J) [N] by ``z``, the twists without friction."""
        local = self.local_tensions(self.evaluate(self.at_nodes(condition), z))
        assert self.friction is not None
        # This is exact if the curvature is proportional to the tension of a tendon drawn in.
        mu = np.maximum(self.tables.friction, 1e-30)
        angle = np.log1p(mu * local.angle) / mu
        return self.friction.hold(condition.tensions, condition.before, angle).tensions

    def _touched(self) -> tuple[FloatArray, NodeMotion | None]:
        """Return positions (N, 3) [m] of the nodes, and their motion; None at rest."""
        return self.places(), None

    def places(self) -> FloatArray:
        """Return the positions (N, 3) [m] of the nodes from the base, by the arrays in `work`."""
        return np.asarray(self.elements.from_base @ self.work.slope)

    def passes(self, before: FloatArray, after: FloatArray) -> bool:
        """Whether the arm passes through an obstacle from twists ``before`` to ``after``."""
        if self.contact is None:
            return False
        self.orient(before)
        start = self.places()
        self.orient(after)
        return self.contact.has_passed(start, self.places())

    def orient(self, z: FloatArray) -> None:
        """Fill `work` with the orientations and r' of twists ``z`` (N, m)."""
        if self._oriented is not z:
            self.form.orientations(self.tables, z, self.work)
            self._current, self._oriented = None, z

    def position_error(self, z: FloatArray) -> float:
        """Return the estimated error of positions over the length [-] for twists ``z`` (N, m)."""
        self.orient(z)
        return float(self.form.poses(self.tables, z, self._tip, self.work)[2][0])

    def compute_sections(self, state: State) -> None:
        """Fill `work` with gradient and Hessian of the energy of the sections in ``state``."""
        if self._current is not state.z:
            self._current = None
        self.form.sections(self.tables, state.z, state.at_nodes.tensions, self.work)

    def balance_sections(self, tensions: FloatArray, z: FloatArray) -> tuple[float, int]:
        """Find the twists ``z`` (N, m) that balance ``tensions`` (N, J) [N] and nothing else."""
        self._current = None
        return balance_sections(self.form, self.tables, self.work, tensions, z)

    def load_work(self, state: State) -> None:
        """Fill `work` with the arrays of ``state``, unless it has them."""
        if self._current is not state.z:
            self.evaluate(state.at_nodes, state.z)

    def linearise(self, state: State, damping: float = 0.0) -> Factors:
        """Return factors of the Jacobian at ``state``, with sections stiffer by ``damping``.

        Raises:
            ConvergenceError: if it is singular.
        """
        self.fill_jacobian(state, damping)
        return factorise(self.work.jacobian.copy())

    def variation(self) -> Variation:
        """Return the second variation of the energy, by the Jacobian that was computed last."""
        jacobian = self.work.jacobian if self._held is None else self._held
        return Variation(jacobian, self.work.hessian, self.elements.weights)

    def fill_jacobian(self, state: State, damping: float = 0.0) -> None:
        """Compute the Jacobian at ``state``, with sections stiffer by ``damping``, in `work`."""
        self.load_work(state)
        at_nodes = state.at_nodes
        tensions = self.in_sections(at_nodes.tensions)
        self.form.jacobian(self.tables, state.z, tensions, at_nodes.force, self.work)
        if self.discs is not None:
            self.discs.add_tangent(self.tables, state.z, at_nodes.tensions, self.work)
        if self.others.loads:
            self.others.add_tangents(at_nodes.condition.factor, state.z, self.work)
        self._add_contact(at_nodes.condition.rigidity)
        if damping:
            nodes, strains = state.z.shape
            blocks = self.work.jacobian.reshape(nodes, strains, nodes, strains)
            np.einsum('iaic->iac', blocks)[...] += damping * self.work.hessian
        if self.friction is not None:
            self._held = self.work.jacobian.copy()
            derivatives = self.tension_derivatives(state)
            if derivatives is not None:
                derivatives.add_to(self.work.jacobian)

    def _add_contact(self, rigidity: float) -> None:
        """Add the stiffness of contact, times the ``rigidity`` of obstacles, to the Jacobian."""
        if self.contact is None:
            return
        if (tangents := self.contact.tangents(*self._touched())) is not None:
            add_tangents(self.elements, self.work, self.strains, rigidity * tangents)

    def tension_derivatives(self, state: State) -> TensionDerivatives | None:
        """Return derivatives of local tensions; None without friction or if these are given."""
        if self.friction is None or state.condition.tensions.ndim > 1:
            return None
        if self._derivatives is None or not _are_same(self._derivatives[0], state):
            local, tendons = self.local_tensions(state), self.tendons(state)
            derivatives: TensionDerivatives
            if isinstance(tendons, ChordTendons):
                weights = self.elements.weights
                derivatives = ChordTensionDerivatives(self.friction, local, tendons, weights)
            else:
                derivatives = TensionDerivatives(self.friction, state.z, local, tendons, self.work)
            self._derivatives = state, derivatives
        return self._derivatives[1]

    def tension_rates(self, state: State) -> FloatArray:
        """Return the derivative of local tensions by those at the base, twists fixed, (N, J)."""
        derivatives = self.tension_derivatives(state)
        return self.tables.reach if derivatives is None else derivatives.by_base_tension

    def has_energy(self, condition: Condition) -> bool:
        """Whether all loads derive from an energy; a moment fixed in base_frame does not."""
        return not (self.loads.has_moments or self.others.loads or condition.tip_wrench[3:].any())

    def turn(self, change: FloatArray) -> float:
        """Return the integral of the bends of a ``change`` (N, m) of the twists [rad]."""
        bends = change[:, :3]
        return float(np.sqrt(np.einsum('ic,ic->i', bends, bends)) @ self.elements.weights)

    def power(self, state: State, change: FloatArray) -> float:
        """Return the loss of energy [J], to first order, by a ``change`` (N, m) of the twists."""
        return -float((state.imbalance * change).sum(axis=1) @ self.elements.weights)


def _are_same(a: State, b: State) -> bool:
    return a.z is b.z and a.at_nodes is b.at_nodes


# Sections by themselves --------------------------------------------------------------------------

OF_SECTIONS = 5e-11  # allowed residual
_BY_NODE = ('body', 'tendons', 'active', 'reach', 'least_scale')


def balance_sections(
    form: Form, tables: Tables, work: Work, tensions: FloatArray, z: FloatArray
) -> tuple[float, int]:
    """Find the twists ``z`` (n, m) that balance ``tensions`` (n, J) [N] without other loads.

    The search starts from ``z``, or from the twists of parallel tendons where these are zero.

    Returns:
        Residual and number of steps.

    Raises:
        ConvergenceError: if it does not converge.
    """
    residual, steps = form.balance(tables, z, tensions, np.zeros(z.shape), OF_SECTIONS, work)
    if not residual <= OF_SECTIONS:
        raise ConvergenceError('the balance of the cross sections', residual, steps)
    return residual, steps


class ArmBatch:
    """Several arms without loads, with the nodes of a `Problem` one arm after the other.

    Attributes:
        tables: tables of all nodes of all arms, with the elements and weights of one.
        work: arrays for these nodes.
    """

    def __init__(self, problem: Problem, arms: int) -> None:
        """Repeat the tables of ``problem`` for so many ``arms``."""
        self._problem, tables = problem, problem.tables
        tiled: dict[str, Any] = {
            name: np.concatenate([getattr(tables, name)] * arms) for name in _BY_NODE
        }
        self.tables = tables._replace(**tiled)
        self.work = work_arrays(self.tables, problem.strains, has_jacobian=False)

    def balance(self, tensions: FloatArray) -> tuple[FloatArray, float, int]:
        """Return twists, residual and steps of `balance_sections` for ``tensions`` (A, J) [N]."""
        local = np.repeat(tensions, self._problem.elements.s.size, axis=0)
        z = np.zeros((len(local), self._problem.strains))
        return z, *balance_sections(self._problem.form, self.tables, self.work, local, z)

    def poses(self, z: FloatArray, places: Places) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return positions (A, S, 3), orientations (A, S, 4) and errors (A,) at the ``places``."""
        self._problem.form.orientations(self.tables, z, self.work)
        return self._problem.form.poses(self.tables, z, places, self.work)
