"""What every model of the statics gives, and the model exact.

Shapes at stations, lengths of tendons, derivatives; exact has no small-stretch approximation, but
loads, friction, and a choice of laws.
"""

import abc
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import ConvergenceError, SolveError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.limits import Allowance, Spending
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.material import LAWS
from octo_arm_model.rod.checks import are_stretched
from octo_arm_model.rod.contact import NONE, Contacts
from octo_arm_model.rod.elements import LEVELS
from octo_arm_model.rod.equilibrium import ArmBatch, Condition, Equilibrium, Problem
from octo_arm_model.rod.factors import RecentFactors
from octo_arm_model.rod.rod import Rod, Setting
from octo_arm_model.rod.sensitivity import Change, Derivatives, Sensitivity, Uncertainty
from octo_arm_model.rod.tables import Places, allowed_between
from octo_arm_model.rod.tendons import outward_paths
from octo_arm_model.rod.winches import Winches

AT_ONCE = 24  # arms, for which tables have room in the processor's cache
_LEVELS_AT_ONCE = 3


class Setup(NamedTuple):
    """What a model is prepared for.

    Attributes:
        arm: the arm.
        s: arc coordinates of the stations [m], (S,).
        section: section of each station, numbered from the tip, 0 beyond the last, (S,).
        base: position [m], (3,), and orientation, a quaternion w, x, y, z, (4,), of the base.
        law: name of the elastic law; the paper's models are linear whatever it is.
        shear: whether cross sections shear.
        loads: what loads the arm but its tendons and the wrench on its tip.
        allowance: what solves may take, where equilibria are followed.
        compiled: whether numba compiles the node functions; None where it is installed.
        accuracy: of positions, over the length [-].
    """

    arm: Arm
    s: FloatArray
    section: IntArray
    base: tuple[FloatArray, FloatArray]
    law: str
    shear: bool
    loads: Loads
    allowance: Allowance
    compiled: bool | None
    accuracy: float = 1e-8


class Shape(NamedTuple):
    """One arm at S stations.

    Attributes:
        position: (S, 3) [m].
        quaternion: orientation x, y, z, w, (S, 4).
        strains: tau, xi, k [1/m] and q [-], (4, S).
        tensions: of J tendons with friction, (S, J) [N]; None without.
        equilibrium: at the nodes.
    """

    position: FloatArray
    quaternion: FloatArray
    strains: FloatArray
    tensions: FloatArray | None
    equilibrium: Equilibrium


class Shapes(NamedTuple):
    """Several arms at S stations, see `Shape`.

    Attributes:
        position: (A, S, 3) [m].
        quaternion: (A, S, 4).
        strains: (4, A, S).
        tensions: (A, S, J) [N]; None without friction.
        residual: (A,).
        iterations: (A,).
    """

    position: FloatArray
    quaternion: FloatArray
    strains: FloatArray
    tensions: FloatArray | None
    residual: FloatArray
    iterations: IntArray


class Statics(abc.ABC):
    """A model of the arm's statics, prepared for a `Setup`.

    Attributes:
        takes_loads: whether there may be loads besides the tendons.
        law: name of the elastic law of the cross sections.
        strains: how many strains a cross section has: 4, or 6 with shear.
        is_compiled: whether numba has compiled the node functions.
    """

    takes_loads = False
    law = 'linear'
    strains = 4
    is_compiled = False
    _winches: Winches

    def __init__(self, setup: Setup) -> None:
        """Keep the ``setup``."""
        self._setup = setup

    @abc.abstractmethod
    def problem(self, level: int) -> Problem:
        """The nodes of a ``level``, always the same."""

    @abc.abstractmethod
    def solve(self, wanted: Condition, start: Equilibrium | None, spending: Spending) -> Shape:
        """In a condition that is ``wanted``, of tensions (J,) at the base.

        ``start`` is an equilibrium to follow the arm from, if the model does.

        Raises:
            SolveError: if there is no trustworthy answer.
        """

    def solve_many(
        self,
        tensions: FloatArray,
        tip_wrenches: FloatArray,
        start: Equilibrium | None,
        before: FloatArray | None,
    ) -> Shapes:
        """As `solve`, of several ``tensions`` (A, J) and ``tip_wrenches`` (A, 6).

        Raises:
            SolveError: if one has no trustworthy answer; the message says which.
        """
        arms, stations = len(tensions), self._setup.s.size
        shapes = Shapes(
            np.empty((arms, stations, 3)),
            np.empty((arms, stations, 4)),
            np.empty((4, arms, stations)),
            np.empty((arms, stations, tensions.shape[1])) if self._setup.arm.friction else None,
            np.empty(arms),
            np.empty(arms, np.int64),
        )
        arm = self._setup.arm
        is_simple = not (arm.friction or arm.sheath_stiffness or arm.discs.s)
        for first in range(0, arms, AT_ONCE):
            left = np.arange(first, min(first + AT_ONCE, arms))
            for level in range(_LEVELS_AT_ONCE if is_simple else 0):
                if left.size and not self._loaded(tip_wrenches[left]):
                    left = left[~self._solve_at_once(level, tensions[left], left, shapes)]
            for number in left.tolist():
                spending = self._setup.allowance.spending()
                wanted = Condition(tensions[number], tip_wrenches[number], before=before)
                try:
                    one = self.solve(wanted, start, spending)
                except SolveError as error:
                    if arms > 1:
                        error.in_set(number)
                    raise
                shapes.position[number], shapes.quaternion[number] = one[:2]
                shapes.strains[:, number] = one.strains
                if shapes.tensions is not None:
                    shapes.tensions[number] = one.tensions
                shapes.residual[number] = one.equilibrium.state.residual
                shapes.iterations[number] = one.equilibrium.iterations
        return shapes

    def _loaded(self, tip_wrenches: FloatArray) -> bool:
        """Whether anything but tendons loads arms with these ``tip_wrenches`` (A, 6)."""
        return False

    @abc.abstractmethod
    def _solve_at_once(
        self, level: int, tensions: FloatArray, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """Which arms could be solved at once on a ``level``, (A,), by their tendons alone.

        Under ``tensions`` (A, J); they are those of the ``numbers`` (A,) in ``shapes``. Others are
        left as they are.
        """

    def _write(
        self, batch: ArmBatch, z: FloatArray, places: Places, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """Poses of arms of twists ``z`` (A n, m) into ``shapes``; which are resolved, (A,)."""
        position, quaternion, error = batch.poses(z, places)
        position += self._setup.base[0]
        shapes.position[numbers], shapes.quaternion[numbers] = position, quaternion
        return error <= allowed_between(self._setup.accuracy)

    @abc.abstractmethod
    def wind(
        self, wanted: Condition, start: Equilibrium | None, spending: Spending
    ) -> tuple[Shape, FloatArray]:
        """See `Winches.solve`: a shape, and what is reeled in there, (J,) [m]."""

    @abc.abstractmethod
    def sensitivity(self, found: Equilibrium) -> Sensitivity:
        """First derivatives of a solution, see `Solver.sensitivity`."""

    def tip_covariance(self, found: Equilibrium, uncertainty: Uncertainty) -> FloatArray:
        """Covariance (6, 6) of the tip of a solution, see `Solver.tip_covariance`."""
        return self.sensitivity(found).tip_covariance(uncertainty)

    def by_loads(self, found: Equilibrium, loads: Sequence[Loads]) -> Change:
        """Change of a solution per unit of each of ``loads``, if the model takes loads."""
        raise NotImplementedError

    def has_solved(self, found: Equilibrium) -> bool:
        """Whether ``found`` may be a solution of this model, by its numbers."""
        if not 0 <= found.level < len(LEVELS):
            return False
        return found.state.z.shape == (self.problem(found.level).elements.s.size, self.strains)

    def local_tensions(self, found: Equilibrium) -> FloatArray:
        """Tension of every tendon of a solution at every node [N], (N, J)."""
        return found.state.at_nodes.tensions * self.problem(found.level).tables.reach

    def history(self, found: Equilibrium) -> FloatArray:
        """Tensions (M, J) [N] that tendons with friction slide on from after a solution."""
        return self.problem(found.level).history(found.state)

    def contacts(self, found: Equilibrium) -> Contacts:
        """See `Solver.contacts`."""
        problem = self.problem(found.level)
        if problem.contact is None:
            return NONE
        problem.orient(found.state.z)
        return problem.contact.report(problem.places())

    # Lengths of the tendons, from the base to their anchorages ---------------------------------

    @functools.cached_property
    def rest_lengths(self) -> FloatArray:
        """In the unloaded arm [m], (J,)."""
        problem = self.problem(0)
        return np.asarray(problem.elements.weights @ problem.unloaded_tendons.stretch)

    def tendon_lengths(self, found: Equilibrium) -> FloatArray:
        """In a solution [m], (J,)."""
        problem = self.problem(found.level)
        return np.asarray(problem.elements.weights @ problem.tendons(found.state).stretch)

    def displacements(self, found: Equilibrium) -> FloatArray:
        """What winches have reeled in in a solution [m], (J,)."""
        return self._winches.displacements(found)

    def displacements_by_offset(self, found: Equilibrium) -> FloatArray:
        """See `Solver.displacements_by_offset`."""
        problem = self.problem(found.level)
        tables, weights = problem.tables, problem.elements.weights
        outwards = outward_paths(self._setup.arm, tables, problem.elements.s)
        rates = problem.unloaded_tendons.by_path(outwards).stretch
        integrals = weights @ (rates * found.state.at_nodes.tensions)
        return np.asarray(weights @ rates + self._setup.arm.stretched(integrals))


def strains_of(z: FloatArray) -> FloatArray:
    """Strains tau, xi, k and q, (4, ..., n), of twists ``z`` (..., n, m)."""
    columns = z.transpose(-1, *range(z.ndim - 1))
    strains = np.empty((4, *z.shape[:-1]))
    np.divide(columns[:3], columns[3], out=strains[:3])
    np.subtract(columns[3], 1.0, out=strains[3])
    return strains


# The model exact ---------------------------------------------------------------------------------

# Shapes whose factors are kept, and numbers in all of these: 128 MB.
_SHAPES_WITH_FACTORS, _NUMBERS = 32, 2**24


class Exact(Statics):
    """Equilibria of the rod, see `octo_arm_model.rod`.

    Attributes:
        rod: the rod.
    """

    takes_loads = True

    def __init__(self, setup: Setup) -> None:
        """Tabulate the arm and its loads.

        Raises:
            ArmDefinitionError: if gravity acts on an arm of no density.
            ModuleNotFoundError: if it is to be compiled but numba is not installed.
        """
        super().__init__(setup)
        self.law, self.strains = setup.law, 6 if setup.shear else 4
        setting = Setting(LAWS[setup.law].number, setup.shear, setup.accuracy, setup.compiled)
        # The rod begins at the origin.
        loads = setup.loads.moved(-setup.base[0])
        self.rod = Rod(setup.arm, loads, setup.base[1], setting)
        self.is_compiled = self.rod.is_compiled
        self.rod.problem(0)  # so that an arm that takes too many nodes is refused now
        self._winches = Winches(self.rod)
        self._recent = RecentFactors(_SHAPES_WITH_FACTORS, _NUMBERS)
        self._readout = functools.cache(lambda level: self.rod.readout(level, setup.s))
        self._batches = functools.lru_cache(8)(
            lambda level, arms: ArmBatch(self.rod.finer(level).own, arms)
        )
        self._derivatives = functools.cache(lambda level: Derivatives(self.rod, level, setup.s))

    def problem(self, level: int) -> Problem:
        """See `Statics`."""
        return self.rod.problem(level)

    def solve(self, wanted: Condition, start: Equilibrium | None, spending: Spending) -> Shape:
        """See `Statics`."""
        known = None if start is None else self._with_factors(start)
        found = self.rod.solve(wanted, known, spending)
        if known is not None and known.key and known.factors is None and found.factors is not None:
            # The next set that is solved from this shape begins with these.
            self._keep(known.key, found)
        return self.shape(found)

    def _loaded(self, tip_wrenches: FloatArray) -> bool:
        """See `Statics`."""
        return self.rod.is_loaded or bool(tip_wrenches.any())

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def _solve_at_once(
        self, level: int, tensions: FloatArray, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """See `Statics`."""
        batch, readout = self._batches(level, len(tensions)), self._readout(level)
        try:
            z, left, steps = batch.balance(tensions)
        except ConvergenceError:
            return np.zeros(len(tensions), np.bool_)
        fine = self._write(batch, z, readout.places, numbers, shapes)
        fine &= are_stretched(batch.tables, z, len(tensions))
        z = readout.twists(z.reshape(len(tensions), -1, self.strains))
        shapes.strains[:, numbers] = strains_of(z)
        shapes.residual[numbers], shapes.iterations[numbers] = left, steps
        return fine

    def wind(
        self, wanted: Condition, start: Equilibrium | None, spending: Spending
    ) -> tuple[Shape, FloatArray]:
        """See `Statics`."""
        known = None if start is None else self._with_factors(start)
        found = self._winches.solve(wanted, known, spending)
        return self.shape(found), found.state.reeled

    def shape(self, found: Equilibrium) -> Shape:
        """An equilibrium at the stations."""
        reading = self._readout(found.level).read(found.state, found.fine)
        position, quaternion, twist, along = reading
        position = position + self._setup.base[0]
        if found.factors is not None:
            key = object()
            self._keep(key, found)
            found = found._replace(factors=None, key=key)
        return Shape(position, quaternion, strains_of(twist), along, found)

    def _keep(self, key: object, found: Equilibrium) -> None:
        """Keep the factors of ``found`` for the shape of this ``key``."""
        if found.factors is not None:
            self._recent.add(key, found.factors, found.state.z.size)

    def _with_factors(self, found: Equilibrium) -> Equilibrium:
        """The equilibrium of a shape with its factors, while they are among the recent ones."""
        return found if found.key is None else found._replace(factors=self._recent.find(found.key))

    def _linearisation(self, found: Equilibrium) -> Derivatives:
        """Derivatives about an equilibrium, whose factors the next solve begins with too."""
        derivatives = self._derivatives(found.level)
        factors = derivatives.linearisation(self._with_factors(found)).factors
        if found.key is not None:
            self._recent.add(found.key, factors, found.state.z.size)
        return derivatives

    def sensitivity(self, found: Equilibrium) -> Sensitivity:
        """See `Statics`."""
        return self._linearisation(found).sensitivity(found)

    def tip_covariance(self, found: Equilibrium, uncertainty: Uncertainty) -> FloatArray:
        """See `Statics`."""
        return self._linearisation(found).tip_covariance(found, uncertainty)

    def by_loads(self, found: Equilibrium, loads: Sequence[Loads]) -> Change:
        """See `Statics`."""
        return self._linearisation(found).by_loads(found, loads)
