"""Equilibria of loaded rods and their derivatives by compiled kernels, as in `loaded`."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.core.compiled.kernel_compiler import entry_point
from octo_arm_model.core.compiled.loaded.orientation_kernels import DEFECTS, TURN_ROWS
from octo_arm_model.core.compiled.loaded.readout_kernels import Readings, empty_readings
from octo_arm_model.core.compiled.loaded.rod_kernels import (
    ANY_READINGS,
    BALANCE,
    READ_ONLY,
    READINGS,
    Outcome,
)
from octo_arm_model.core.compiled.loaded.rod_state import RodState, empty_state
from octo_arm_model.core.compiled.loaded.rod_tables import (
    ParameterTables,
    RodTables,
    parameter_tables,
    rod_tables,
)
from octo_arm_model.core.compiled.loaded.system_kernels import System, empty_system
from octo_arm_model.core.compiled.models.arm_tables import own
from octo_arm_model.core.compiled.numba_build import (
    add_tip_covariance,
    balance,
    differentiate,
    find_minima,
    find_turn,
)
from octo_arm_model.core.errors import ConvergenceError
from octo_arm_model.core.hints import ComplexArray, FloatArray
from octo_arm_model.core.loaded.budget import Spending
from octo_arm_model.core.loaded.continuation import MOST_CORRECTED, TOLERANCE
from octo_arm_model.core.loaded.kept_balances import KeptBalances
from octo_arm_model.core.loaded.kinematics import unit
from octo_arm_model.core.loaded.linearised import TipAnswer
from octo_arm_model.core.loaded.newton import Iterate
from octo_arm_model.core.loaded.rod import LoadedRod
from octo_arm_model.core.loaded.stability import SAME, SAME_LOADS
from octo_arm_model.core.loaded.state import Condition, Stability, State
from octo_arm_model.core.numerics.quaternion import Quaternions
from octo_arm_model.core.rod.solution import Shape, Solution, TendonTensions
from octo_arm_model.core.section.strain_measures import to_scaled

_NO_LOADS = np.zeros((0, 3, 0)), np.zeros((0, 3, 0))


class KnownSystem(NamedTuple):
    """A factorised system kept with an equilibrium.

    Attributes:
        system: linearised about a state near that equilibrium.
        turned: sum of all bends of the arm from that state to the equilibrium [rad]; zero if it is
            that very state.
        changed: likewise of all changes of tensions and loads, as residuals.
        firm_under: wrench on the tip (6,) [N, N m] under which that state is stable by a margin,
            see `stability.FIRM`; None where it is not known to be.
        is_shared: whether other balances may be kept with the same system.
    """

    system: System
    turned: float
    changed: float = 0.0
    firm_under: FloatArray | None = None
    is_shared: bool = False


class CompiledRod:
    """`Newton`, `Settle`, `ReadOut` and derivatives of one rod."""

    def __init__(self, rod: LoadedRod) -> None:
        """Tabulate ``rod``.

        Raises:
            Exception: any error of a numba that does not work.
        """
        self._rod, self._tables = rod, own(rod_tables(rod))
        self._nodes, self._stations = rod.nodes.element.size, rod.stations.element.size
        self._kernel, self._loads = entry_point(balance()), rod.equilibrium.loads
        self._kept: KeptBalances[KnownSystem] = KeptBalances()
        # Output arrays of kernels that are not used.
        self._not_asked = np.empty((6, 6)), np.empty((4, rod.points, 6))
        self._spare: System | None = None  # room that the last kernel called has not used
        self._nothing_known = KnownSystem(empty_system(self._tables.elements), np.inf)
        self._no_readings = empty_readings(0, 0)
        # Whether the last equilibrium was differentiated: then the next is expected to be, too.
        self._is_differentiated = False
        # Fields of a state, but its twist, that are not used.
        self._unused_fields = empty_state(rod.points)[1:]
        self._find_turn = find_turn()
        self._minimum = rod.minimum  # by NumPy, which raises the error where there is none

    @functools.cached_property
    def _parameters(self) -> ParameterTables:
        tables: ParameterTables = own(parameter_tables(self._rod))
        return tables

    @property
    def tables(self) -> RodTables:
        """Tables of the rod, with scaled loads of their present magnitudes."""
        if self._loads.scaled is not None:
            dead = self._loads.dead
            self._tables.force[:], self._tables.moment[:] = dead.force, dead.moment
        return self._tables

    def frames(self, angular: FloatArray) -> Quaternions:
        """`Frames` of the rod."""
        turn = np.zeros((4, angular.shape[1]))
        twist = np.zeros_like(turn)
        twist[:3] = angular
        turn[0] = 1.0
        work = np.empty((TURN_ROWS, angular.shape[1]))
        self._find_turn(self._tables.elements, twist, DEFECTS, turn, work)
        return quaternions_of(turn)

    def minimum(self, tensions: FloatArray) -> FloatArray:
        """`Minimum` of the rod.

        Raises:
            SolveError: if there is none.
        """
        sections = self._tables.sections
        twist = np.empty((4, sections.axial.size))
        _, steps = find_minima()(sections, own(tensions), twist)
        return self._minimum(tensions) if steps < 0 else twist

    def read_out(self, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`ReadOut` of the rod."""
        readings = empty_readings(self._nodes, self._stations)
        # Its own, also of rods with friction: tensions along the tendons are given.
        CompiledRod._balance(
            self, state.condition, state.shape, self._nothing_known, np.inf, READ_ONLY, readings,
            *self._not_asked,
        )  # fmt: skip
        return readings.twist, readings.position, readings.quaternion

    def settle(
        self, wanted: Condition, shape: Shape, spending: Spending
    ) -> Solution | Shape | None:
        """`Settle` of the rod.

        Raises:
            SolveError: if a tendon is pressed out of its sheath and the body.
        """
        readings = empty_readings(self._nodes, self._stations)
        kind = ANY_READINGS if self._rod.is_finest else READINGS
        known = self._known_near(shape)
        tolerance = TOLERANCE if known is self._nothing_known else spending.residual
        outcome, _, found = self._balance(
            wanted, shape, known, tolerance, kind, readings, *self._not_asked
        )
        spending.add(outcome.iterations, 0.0, outcome.residual, found.twist)
        if not outcome.is_read:
            is_stable = outcome.is_least and outcome.corrected <= MOST_CORRECTED
            return found if is_stable else None
        energy = self._rod.equilibrium.energy
        if energy.displaces_tendons:
            strain = to_scaled(energy.law, found.twist[:, np.newaxis])
            energy.check_tendons(strain, self._tensions_along(wanted.tensions))
        return Solution(
            readings.twist, outcome.residual, spending.iterations, found,
            (readings.position, readings.quaternion), self._tendon_tensions(), readings.strains,
        )  # fmt: skip

    def _tendon_tensions(self) -> TendonTensions | None:
        """Tensions along tendons with friction in the last equilibrium; None without friction."""
        return None

    def _tensions_along(self, tensions: FloatArray) -> FloatArray:
        """Local tensions in the last equilibrium, (tendons, 1, points) [N]."""
        return self._rod.equilibrium.energy.local_tensions(tensions[np.newaxis])

    def differentiate(
        self, condition: Condition, shape: Shape, dead: tuple[FloatArray, FloatArray] | None,
        by_offsets: bool = True,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
        """`Differentiate` of the rod."""
        tensions = condition.tensions
        columns = len(dead[0]) if dead else (1 + by_offsets) * tensions.size + 8
        pose = np.empty((self._stations, 6, columns))
        strain = np.empty((self._stations, 4, columns))
        length = np.empty((tensions.size, columns))
        force, moment = map(own, dead or _NO_LOADS)
        self._differentiate(differentiate(), condition, shape, force, moment, pose, strain, length)
        return pose, strain, length

    def add_tip_covariance(
        self, condition: Condition, shape: Shape, deviations: FloatArray, covariance: FloatArray
    ) -> None:
        """`AddTipCovariance` of the rod."""
        self._differentiate(add_tip_covariance(), condition, shape, deviations, covariance)

    def _differentiate(
        self, kernel: Any, condition: Condition, shape: Shape, *arrays: FloatArray
    ) -> None:
        """Call a ``kernel`` of derivatives, which fills in some of the ``arrays``.

        The system of a balance that was found by this rod is from then on the one linearised about
        that very ``shape``: derivatives by other things are often asked for next.

        Raises:
            ConvergenceError: if it is singular.
        """
        self._is_differentiated = True
        kept = self.known_about(shape)
        is_known = kept is not None and kept.turned == 0.0
        system = kept.system if kept and is_known else self._room_for_system()
        sign = entry_point(kernel)(
            self.tables, self._parameters, own(condition.tensions), own(condition.tip_wrench),
            state_of(shape, self._unused_fields), is_known, system, *arrays,
        )  # fmt: skip
        if sign == 0:
            raise ConvergenceError('the balance under load', np.inf, 0)
        if kept is None:
            self._spare = system
        elif not is_known:
            # Its stability has not been tested.
            self._kept.keep(shape.twist, KnownSystem(system, 0.0))
            self._spare = self._unless_used(kept)

    def newton(self, condition: Condition, shape: Shape, tolerance: float) -> Iterate:
        """`Newton` of the rod."""
        compliance, change = np.empty((6, 6)), np.empty((*shape.twist.shape, 6))
        outcome, state, found = self._balance(
            condition, shape, self._known_near(shape), tolerance, BALANCE, self._no_readings,
            compliance, change,
        )  # fmt: skip
        answer: Stability | TipAnswer | None = None
        if outcome.is_least:
            answer = Stability(True, outcome.sign, None)
        elif outcome.sign:
            answer = TipAnswer(
                compliance, change.transpose(0, 2, 1), outcome.sign, outcome.is_definite
            )
        rotation = state.rotation
        balanced = State(
            condition, found, rotation, rotation[:, 0] * state.twist[3], state.moment,
            state.force, state.imbalance, outcome.residual, None, state.hessian,
        )  # fmt: skip
        return Iterate(balanced, outcome.iterations, outcome.corrected, answer)

    def _balance(
        self, condition: Condition, shape: Shape, known: KnownSystem, tolerance: float,
        wanted: int, readings: Readings, compliance: FloatArray, change: FloatArray,
    ) -> tuple[Outcome, RodState, Shape]:  # fmt: skip
        """Outcome of `rod_kernels.balance`, its final state, and the shape of that.

        ``known`` is what is kept with the equilibrium of this ``shape``.
        """
        state, orientation = self._start(shape, wanted)
        tip_wrench = condition.tip_wrench.copy()
        has_energy = self._loads.has_energy(tip_wrench)
        reach = self._reach(known, condition) if has_energy and wanted == READINGS else 0.0
        system = self._room_for_system()
        *found, changed = self._kernel(
            self.tables, condition.tensions.copy(), tip_wrench, float(condition.factor),
            tolerance, has_energy, wanted, known is not self._nothing_known, known.system, reach,
            SAME_LOADS - known.changed, self._is_differentiated, orientation, state, system,
            compliance, change, readings,
        )  # fmt: skip
        outcome, self._is_differentiated = Outcome(*found), False
        self._keep(shape, state, outcome, known, system, changed, condition)
        return outcome, state, Shape(state.twist, Quaternions(orientation[0], orientation[1]))

    def _reach(self, known: KnownSystem, condition: Condition) -> float:
        """Angle by which the arm may turn while the ``known`` system stands in for a new one.

        [rad]; zero where the stability of its equilibrium has no margin, or other loads act now.
        """
        if known.firm_under is None:
            return 0.0
        change = self._rod.equilibrium.load_change(
            known.firm_under, condition.tensions, condition.tip_wrench
        )
        return SAME - known.turned if change <= SAME_LOADS else 0.0

    def _start(self, shape: Shape, wanted: int) -> tuple[RodState, ComplexArray]:
        """State and orientations of ``shape``, copied, for a kernel to overwrite.

        Of the other fields of the state only a `BALANCE` is used afterwards.
        """
        # Copied: the arrays of a `Backbone` are read-only.
        orientation = np.empty((2, shape.twist.shape[1]), complex)
        orientation[0], orientation[1] = shape.orientation
        is_used = wanted == BALANCE
        fields = empty_state(shape.twist.shape[1])[1:] if is_used else self._unused_fields
        return RodState(np.array(shape.twist), *fields), orientation

    def _keep(
        self, start: Shape, state: RodState, outcome: Outcome, known: KnownSystem, system: System,
        changed: float, condition: Condition,
    ) -> None:  # fmt: skip
        """Keep the system that an equilibrium ``state``, found from ``start``, is known by.

        ``known`` is the one kept with ``start``, ``system`` has that made by the kernel and
        ``changed`` is its first residual under the ``condition``.
        """
        if outcome.is_reused:
            if not known.is_shared:
                self._kept.keep(start.twist, known._replace(is_shared=True))
            # A constructor takes less time than `_replace`.
            self._kept.keep(state.twist, KnownSystem(
                known.system, known.turned + outcome.turned, known.changed + changed,
                known.firm_under, True,
            ))  # fmt: skip
        elif outcome.sign:
            firm_under = condition.tip_wrench if outcome.is_firm else None
            self._kept.keep(state.twist, KnownSystem(system, outcome.turned, 0.0, firm_under))
        if outcome.is_reused or not outcome.sign:
            self._spare = system

    def _known_near(self, shape: Shape) -> KnownSystem:
        """What is known of the equilibrium of this very ``shape``; `_nothing_known` else."""
        return self.known_about(shape) or self._nothing_known

    def _room_for_system(self) -> System:
        """Uninitialised system, in the arrays of one that is no longer used if there is any."""
        spare, self._spare = self._spare, None
        if spare is None and (unused := self._kept.take_unused()):
            spare = self._unless_used(unused)
        return spare or empty_system(self._tables.elements)

    def _unless_used(self, dropped: KnownSystem) -> System | None:
        """The system of what is no longer kept, unless other balances are kept with it."""
        system = dropped.system
        if dropped.is_shared and any(known.system is system for known in self._kept):
            return None
        return system

    def known_about(self, shape: Shape) -> KnownSystem | None:
        """The system kept with the equilibrium of this very ``shape``, if any."""
        return self._kept.about(shape.twist)


def state_of(shape: Shape, fields: Sequence[FloatArray]) -> RodState:
    """State of the twist and orientations of ``shape``; its other arrays are those of ``fields``.

    ``fields`` are those of a `RodState` after the twist; the orientations are written to them.
    """
    state = RodState(np.array(shape.twist), *fields)
    (a, b), turn = shape.orientation, state.turn
    turn[0], turn[1], turn[2], turn[3] = a.real, a.imag, b.real, b.imag
    return state


def quaternions_of(turn: FloatArray) -> Quaternions:
    """Unit quaternions of components w, x, y, z (4, points) of any norm."""
    return unit(Quaternions(turn[0] + 1j * turn[1], turn[2] + 1j * turn[3]))
