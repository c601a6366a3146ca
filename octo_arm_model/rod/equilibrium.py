"""The equations of one arm at its nodes, and a state of it, in equilibrium or not."""

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
from octo_arm_model.rod.section_arrays import relative_residual
from octo_arm_model.rod.tables import (
    LEVER,
    Places,
    Tables,
    Work,
    force_scale,
    places_at,
    work_arrays,
)
from octo_arm_model.rod.tendons import Tendons, unloaded_tendons, unloaded_twists


class Condition(NamedTuple):
    """What acts on the arm.

    Attributes:
        tensions: of the tendons at the base, (J,), or at every node, (N, J) [N].
        tip_wrench: force and moment on the tip in base_frame, (6,) [N, N m].
        factor: on all other loads [-], from 0 to 1.
        before: tensions (M, J) [N] at the points of `Friction.fine` from which tendons slide;
            None for slack ones.
        lengths: reeled in by winches [m], (J,); they count where a tendon is driven.
        driven: whether winches hold the length of a tendon, else its tension, (J,); empty where
            there are none.
    """

    tensions: FloatArray
    tip_wrench: FloatArray
    factor: float = 1.0
    before: FloatArray | None = None
    lengths: FloatArray = np.zeros(0)
    driven: NDArray[np.bool_] = np.zeros(0, np.bool_)

    def towards(self, other: Condition, part: float) -> Condition:
        """This one, moved by ``part`` of the way to ``other``."""
        if part == 1.0:
            return other
        lengths = self.lengths if other.driven.size else other.lengths
        return other._replace(
            tensions=self.tensions + part * (other.tensions - self.tensions),
            tip_wrench=self.tip_wrench + part * (other.tip_wrench - self.tip_wrench),
            factor=self.factor + part * (other.factor - self.factor),
            lengths=lengths + part * (other.lengths - lengths),
        )


class NodeCondition(NamedTuple):
    """A condition at the nodes.

    Attributes:
        condition: the condition.
        tensions: of every tendon at every node [N], (N, J).
        force: of all loads beyond each node, in base_frame, (N, 3) [N].
        couple: their free moment, without what forces have of it, (N, 3) [N m].
        dead: force and couple of those loads that do not follow the shape, (2, N, 3).
    """

    condition: Condition
    tensions: FloatArray
    force: FloatArray
    couple: FloatArray
    dead: FloatArray


class State(NamedTuple):
    """Twists under a condition, in equilibrium or not.

    Attributes:
        at_nodes: what acts on the arm.
        z: twists, (N, m) [1/m and -].
        imbalance: gradient of the energy less the wrench of the loads, (N, m) [N m and N].
        residual: the largest, over its scale [-]; NaN where a strain is impossible.
        reeled: what winches have reeled in [m], (J,); of slack tendons what would make them taut.
        wrong: what that lacks [m], (J,), zero of tendons that are not driven.
    """

    at_nodes: NodeCondition
    z: FloatArray
    imbalance: FloatArray
    residual: float
    reeled: FloatArray = np.zeros(0)
    wrong: FloatArray = np.zeros(0)

    @property
    def condition(self) -> Condition:
        """What acts on the arm."""
        return self.at_nodes.condition


class Equilibrium(NamedTuple):
    """A stable equilibrium of a `Rod`.

    Attributes:
        state: twists at the nodes and what acts on them.
        level: of `elements.LEVELS`.
        factors: of the Jacobian at an equilibrium nearby; None of an arm without loads.
        firm_state: that one, where it was seen to be stable by a margin; else None.
        iterations: made in all.
        fine: twists at the finer points, of an arm without loads.
        key: by which `RecentFactors` has the factors of the equilibrium of a shape.
        guess: of the twists of the next equilibrium, (N, m), from which it is not followed where
            they lead to none. None for those of this one.
    """

    state: State
    level: int
    factors: Linear | None
    firm_state: State | None
    iterations: int
    fine: FloatArray | None = None
    key: object | None = None
    guess: FloatArray | None = None


class Problem:
    """The residual and Jacobian of one arm under its loads.

    Attributes:
        elements: where the nodes are.
        tables: of the arm at the nodes.
        form: the node functions.
        work: what they computed last.
        loads: dead ones, all but the wrench on the tip.
        others: loads of other kinds.
        contact: with obstacles; None where there are none.
        touching: force and moment per length by these, where they are known from other nodes,
            (2, N, 3) [N/m, N].
        strains: 4, or 6 with shear.
        friction: of the tendons; None where they have none.
        discs: that hold the tendons; None where the body does.
    """

    remembered = 1  # residual, see `continuation.newton`

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
        """Of ``arm`` under ``loads``, and its ``tables`` at the nodes of ``elements``."""
        self.elements, self.form, self.strains = elements, form, strains
        self.discs = ChordModel(arm, elements, tables, form) if arm.discs.s else None
        self.loads, self._slack = DeadLoads(arm, elements, loads), np.zeros_like(tables.reach)
        self.others = OtherLoads(loads.others, elements, tables.base)
        self.others.has_obstacles = bool(loads.obstacles)
        self.tables, self.contact = tables, None
        if loads.obstacles:
            self.contact = Contact(arm, elements, loads.obstacles)
            least = tables.least_scale + self.contact.rounding
            self.tables = tables = tables._replace(least_scale=least)
        self.touching: FloatArray | None = None
        self._follows = bool(loads.others or loads.obstacles)  # whether loads follow the shape
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
        # Squares of twists times this are those of strains, integrated over the arm.
        unit *= unit * (elements.weights / elements.edges[-1])[:, np.newaxis]
        self.measure = unit.ravel()

    def at_nodes(self, condition: Condition) -> NodeCondition:
        """The ``condition`` at the nodes."""
        tensions = condition.tensions
        if tensions.ndim == 1:
            tensions = np.empty((self.elements.s.size, tensions.size))
            tensions[:] = condition.tensions
        dead = self.loads.at(condition.factor, condition.tip_wrench)
        return NodeCondition(condition, tensions, dead[0], dead[1], dead)

    def straight_resultants(self) -> FloatArray:
        """Force and free moment of all loads but the tip's on the straight rod, (2, N, 3)."""
        dead = self.loads.at(1.0, np.zeros(6))
        return dead + self.others.resultants(self.others.straight())

    def evaluate(self, at_nodes: NodeCondition, z: FloatArray) -> State:
        """The state of twists ``z`` (N, m), which is kept and not to be changed any more."""
        work, given = self.work, at_nodes.condition.tensions
        if self._scaled is not given:
            self._scaled = given
            work.scale[:] = force_scale(self.tables, given)
        self.form.orientations(self.tables, z, work)
        at_nodes = self._following(at_nodes, z)
        left = self._fill_residual(at_nodes, z)
        self._current = self._oriented = z
        return State(at_nodes, z, work.residual.copy(), left)

    def _fill_residual(self, at_nodes: NodeCondition, z: FloatArray) -> float:
        """Fill in the residual under ``at_nodes``, see `forms.Form.residual`."""
        work, inside = self.work, self.in_sections(at_nodes.tensions)
        left = self.form.residual(self.tables, z, inside, at_nodes.force, at_nodes.couple, work)
        if self.discs is not None:
            self.discs.add_pull(self.tables, z, at_nodes.tensions, work)
            left = relative_residual(work.gradient - work.residual, work.scale, work)
        return left

    def wrenches(self, at_nodes: NodeCondition, z: FloatArray) -> tuple[NodeCondition, FloatArray]:
        """The condition ``at_nodes`` at twists ``z`` (N, m), and wrenches on the sections, (N, m).

        Moment and force of all beyond it.
        """
        work = self.work
        self.form.orientations(self.tables, z, work)
        at_nodes = self._following(at_nodes, z)
        self.form.wrenches(self.tables, at_nodes.force, at_nodes.couple, work)
        if self.discs is not None:
            self.discs.add_pull(self.tables, z, at_nodes.tensions, work)
        self._current, self._oriented = None, z
        return at_nodes, -work.residual

    def _following(self, at_nodes: NodeCondition, z: FloatArray) -> NodeCondition:
        """The condition ``at_nodes`` at twists ``z`` (N, m), some of which follows their shape."""
        at_nodes = self._with_friction(at_nodes, z)
        if not self._follows:
            return at_nodes
        force, couple = at_nodes.dead + self._following_loads(at_nodes.condition.factor, z)
        return at_nodes._replace(force=force, couple=couple)

    def _following_loads(self, factor: float, z: FloatArray) -> FloatArray:
        """Force and free moment of loads that follow the shape, (2, N, 3)."""
        total = np.zeros((2, len(z), 3))
        if self.others.loads:
            total += factor * self.others.resultants(NodeRod(self.others, self.work.quaternion, z))
        if self.contact is not None:
            # Whole from the first: an obstacle is there before other loads act.
            known = self.touching
            density = self.contact.densities(*self._touched()) if known is None else known
            total += self.elements.to_tip @ density
        return total

    def in_sections(self, tensions: FloatArray) -> FloatArray:
        """Those of the local ``tensions`` (N, J) that are in the energy of the cross sections."""
        return tensions if self.discs is None else self._slack

    def _with_friction(self, at_nodes: NodeCondition, z: FloatArray) -> NodeCondition:
        """The condition ``at_nodes`` at twists ``z`` (N, m), with friction of the tendons."""
        condition = at_nodes.condition
        if self.friction is None or condition.tensions.ndim > 1:
            return at_nodes
        given = condition.tensions, condition.before
        self._local = self.friction.hold_along(z, *given, self.work)
        return at_nodes._replace(tensions=self._local.tensions)

    def step(self, state: State, factors: Linear) -> tuple[FloatArray, Linear]:
        """Newton's step of the twists by ``factors``, (N m,), and these."""
        return factors.solve(-state.imbalance.ravel()), factors

    def moved(self, state: State, step: FloatArray, _: Linear) -> State:
        """The ``state`` after a `step`."""
        return self.evaluate(state.at_nodes, state.z + step.reshape(state.z.shape))

    def local_tensions(self, state: State) -> LocalTensions:
        """The tensions that friction leaves in ``state``."""
        self.load_work(state)
        assert self._local is not None
        return self._local

    def tendons(self, state: State) -> Tendons:
        """The tendons in ``state``; those of the last one are kept."""
        if self._tendons is None or not _are_same(self._tendons[0], state):
            if self.tables.compliance.any() or self.discs is not None:
                self.load_work(state)  # their offsets in sheaths, orientations
            tendons = self._make_tendons(state.z, state.at_nodes.tensions)
            self._tendons = state, tendons
        return self._tendons[1]

    def _make_tendons(self, z: FloatArray, tensions: FloatArray) -> Tendons:
        if self.discs is not None:
            return ChordTendons(self.discs, self.tables, z, tensions, self.work)
        return Tendons(self.tables, z, tensions, self.work.offsets)

    @functools.cached_property
    def unloaded_tendons(self) -> Tendons:
        """The tendons of the unloaded arm."""
        if self.discs is None:
            return unloaded_tendons(self.tables)
        z = unloaded_twists(self.tables)
        self.orient(z)
        return self._make_tendons(z, np.zeros_like(self.tables.reach))

    def history(self, state: State) -> FloatArray:
        """Tensions (M, J) [N] at the points of `Friction.fine`, from which tendons slide on."""
        assert self.friction is not None
        return self.friction.history(self.local_tensions(state), state.condition.tensions)

    def first_tensions(self, condition: Condition, z: FloatArray) -> FloatArray:
        """Tensions (N, J) [N] that bend an arm less than ``z`` (N, m), which full ones bend."""
        local = self.local_tensions(self.evaluate(self.at_nodes(condition), z))
        assert self.friction is not None
        # Exact for a curvature in proportion to the tension of a tendon that is drawn in.
        mu = np.maximum(self.tables.friction, 1e-30)
        angle = np.log1p(mu * local.angle) / mu
        return self.friction.hold(condition.tensions, condition.before, angle).tensions

    def _touched(self) -> tuple[FloatArray, NodeMotion | None]:
        """Where the nodes are, (N, 3) [m], and how they slide on obstacles."""
        return self.places(), None

    def places(self) -> FloatArray:
        """Where the nodes are whose orientations are in `work`, from the base, (N, 3) [m]."""
        return np.asarray(self.elements.from_base @ self.work.slope)

    def passes(self, before: FloatArray, after: FloatArray) -> bool:
        """Whether an arm goes through an obstacle from twists ``before`` to ``after``, (N, m)."""
        if self.contact is None:
            return False
        self.orient(before)
        start = self.places()
        self.orient(after)
        return self.contact.has_passed(start, self.places())

    def orient(self, z: FloatArray) -> None:
        """Have the orientations and r' of twists ``z`` (N, m) in `work`."""
        if self._oriented is not z:
            self.form.orientations(self.tables, z, self.work)
            self._current, self._oriented = None, z

    def position_error(self, z: FloatArray) -> float:
        """Estimated error of positions over the length of the arm [-], of twists ``z`` (N, m)."""
        self.orient(z)
        return float(self.form.poses(self.tables, z, self._tip, self.work)[2][0])

    def load_work(self, state: State) -> None:
        """Have in `work` what belongs to ``state``."""
        if self._current is not state.z:
            self.evaluate(state.at_nodes, state.z)

    def linearise(self, state: State, damping: float = 0.0) -> Factors:
        """Factors of the Jacobian at ``state``, with sections stiffer by ``damping``.

        Raises:
            ConvergenceError: if it is singular.
        """
        self.fill_jacobian(state, damping)
        return factorise(self.work.jacobian.copy())

    def variation(self) -> Variation:
        """The second variation of the energy, of the Jacobian that was filled in last."""
        held = self.work.jacobian if self._held is None else self._held
        return Variation(held, self.work.hessian, self.elements.weights)

    def fill_jacobian(self, state: State, damping: float = 0.0) -> None:
        """The Jacobian at ``state``, with sections stiffer by ``damping``, into `work`."""
        self.load_work(state)
        at_nodes = state.at_nodes
        inside = self.in_sections(at_nodes.tensions)
        self.form.jacobian(self.tables, state.z, inside, at_nodes.force, self.work)
        if self.discs is not None:
            self.discs.add_tangent(self.tables, state.z, at_nodes.tensions, self.work)
        if self.others.loads:
            self.others.add_tangents(at_nodes.condition.factor, state.z, self.work)
        self._add_contact()
        if damping:
            nodes, strains = state.z.shape
            blocks = self.work.jacobian.reshape(nodes, strains, nodes, strains)
            np.einsum('iaic->iac', blocks)[...] += damping * self.work.hessian
        if self.friction is not None:
            self._held = self.work.jacobian.copy()
            derivatives = self.tension_derivatives(state)
            if derivatives is not None:
                derivatives.add_to(self.work.jacobian)

    def _add_contact(self) -> None:
        """Add to the Jacobian what obstacles do."""
        if self.contact is not None and (tangents := self.contact.tangents(*self._touched())):
            add_tangents(self.elements, self.work, self.strains, tangents)

    def tension_derivatives(self, state: State) -> TensionDerivatives | None:
        """Derivatives of local tensions at ``state``; None without friction, or of given ones."""
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
        """Derivative of local tensions by those at the base at fixed twists, (N, J) [-]."""
        derivatives = self.tension_derivatives(state)
        return self.tables.reach if derivatives is None else derivatives.by_base_tension

    def has_energy(self, condition: Condition) -> bool:
        """Whether all loads derive from an energy: a moment fixed in base_frame does not."""
        return not (self.loads.has_moments or self.others.loads or condition.tip_wrench[3:].any())

    def turn(self, change: FloatArray) -> float:
        """How far a ``change`` (N, m) of the twists turns the arm, all its bends added [rad]."""
        bends = change[:, :3]
        return float(np.sqrt(np.einsum('ic,ic->i', bends, bends)) @ self.elements.weights)

    def power(self, state: State, change: FloatArray) -> float:
        """What the imbalance of ``state`` does on a ``change`` (N, m), as a loss of energy [J]."""
        return -float((state.imbalance * change).sum(axis=1) @ self.elements.weights)


def _are_same(one: State, other: State) -> bool:
    return one.z is other.z and one.at_nodes is other.at_nodes


# Sections by themselves --------------------------------------------------------------------------

OF_SECTIONS = 5e-11  # residual that may be left
_BY_NODE = ('body', 'tendons', 'active', 'reach', 'least_scale')


def balance_sections(
    form: Form, tables: Tables, work: Work, tensions: FloatArray, z: FloatArray
) -> tuple[float, int]:
    """Bring the twists ``z`` (n, m) to balance under ``tensions`` (n, J) [N] alone.

    From where they are, or from those of parallel tendons where they are zero.

    Returns:
        Residual and number of steps.

    Raises:
        ConvergenceError: if it does not converge.
    """
    left, steps = form.balance(tables, z, tensions, np.zeros_like(z), OF_SECTIONS, work)
    if not left <= OF_SECTIONS:
        raise ConvergenceError('the balance of the cross sections', left, steps)
    return left, steps


class ArmBatch:
    """Arms without loads at the nodes of a `Problem`, one after the other.

    Attributes:
        tables: of all nodes of all arms; elements and weights are those of one.
        work: for these.
    """

    def __init__(self, problem: Problem, arms: int) -> None:
        """Of so many ``arms``."""
        self._problem, own = problem, problem.tables
        tiled: dict[str, Any] = {
            name: np.concatenate([getattr(own, name)] * arms) for name in _BY_NODE
        }
        self.tables = own._replace(**tiled)
        self.work = work_arrays(self.tables, problem.strains, has_jacobian=False)

    def balance(self, tensions: FloatArray) -> tuple[FloatArray, float, int]:
        """See `balance_sections`, of arms under ``tensions`` (A, J) [N]."""
        local = np.repeat(tensions, self._problem.elements.s.size, axis=0)
        z = np.zeros((len(local), self._problem.strains))
        return z, *balance_sections(self._problem.form, self.tables, self.work, local, z)

    def poses(self, z: FloatArray, places: Places) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See `loops.poses`."""
        self._problem.form.orientations(self.tables, z, self.work)
        return self._problem.form.poses(self.tables, z, places, self.work)
