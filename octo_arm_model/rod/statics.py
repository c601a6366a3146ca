"""The interface of all models of the statics, and the model exact.

A model gives shapes at stations, lengths of tendons and derivatives. The model exact does not
assume a small stretch, and has loads, friction and a choice of elastic laws.
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
from octo_arm_model.rod.equilibrium import ArmBatch, Condition, Equilibrium, Problem
from octo_arm_model.rod.factors import RecentFactors
from octo_arm_model.rod.rod import Rod, Setting
from octo_arm_model.rod.sensitivity import Change, Derivatives, Sensitivity, Uncertainty
from octo_arm_model.rod.tables import Places, errors_between
from octo_arm_model.rod.winches import Winches

AT_ONCE = 24  # arms in a batch, whose tables fit into the processor's cache
_LEVELS_AT_ONCE = 3


class Setup(NamedTuple):
    """The arm, stations and options that a model is prepared for."""

    arm: Arm
    s: FloatArray  #: arc coordinates of the stations [m], (S,)
    section: IntArray  #: section of each station, numbered from the tip, 0 beyond the last, (S,)
    #: position [m], (3,), and orientation, a quaternion w, x, y, z, (4,), of the base
    base: tuple[FloatArray, FloatArray]
    law: str  #: name of the elastic law; the paper's models ignore it and are linear
    shear: bool  #: whether cross sections shear
    loads: Loads  #: all loads but the tendons and the wrench on the tip
    allowance: Allowance  #: budget of solves that follow equilibria
    #: whether numba compiles the node functions; None if it is installed and works
    compiled: bool | None
    accuracy: float = 1e-8  #: allowed error of positions over the length [-]


class Shape(NamedTuple):
    """The shape of one arm at S stations."""

    position: FloatArray  #: positions, (S, 3) [m]
    quaternion: FloatArray  #: orientations x, y, z, w, (S, 4)
    strains: FloatArray  #: tau, xi, k [1/m] and q [-], (4, S)
    #: tensions of J tendons with friction, (S, J) [N]; None without friction
    tensions: FloatArray | None
    equilibrium: Equilibrium  #: the equilibrium at the nodes


class Shapes(NamedTuple):
    """The shapes of A arms at S stations."""

    position: FloatArray  #: positions, (A, S, 3) [m]
    quaternion: FloatArray  #: orientations x, y, z, w, (A, S, 4)
    strains: FloatArray  #: tau, xi, k [1/m] and q [-], (4, A, S)
    #: tensions of J tendons with friction, (A, S, J) [N]; None without friction
    tensions: FloatArray | None
    residual: FloatArray  #: residuals of the equilibria [-], (A,)
    iterations: IntArray  #: numbers of iterations, (A,)


class Statics(abc.ABC):
    """A model of the arm's statics, prepared for a `Setup`.

    Attributes:
        takes_loads: whether the model has loads besides the tendons.
        law: name of the elastic law of the cross sections.
        strains: number of strains of a cross section: 4, or 6 with shear.
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
        """Return the equations on the nodes of a ``level``, always the same object."""

    @abc.abstractmethod
    def solve(self, target: Condition, start: Equilibrium | None, spending: Spending) -> Shape:
        """Find the shape in the condition ``target``, with tensions (J,) at the base.

        The arm is followed from the equilibrium ``start``, if the model follows equilibria.

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
        """Find the shapes under ``tensions`` (A, J) [N] and ``tip_wrenches`` (A, 6) [N, N m].

        Arms are followed from ``start``; tendons slide from tensions ``before`` (M, J) [N].

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
            rest = np.arange(first, min(first + AT_ONCE, arms))
            for level in range(_LEVELS_AT_ONCE if is_simple else 0):
                if rest.size and not self._loaded(tip_wrenches[rest]):
                    rest = rest[~self._solve_at_once(level, tensions[rest], rest, shapes)]
            for number in rest.tolist():
                spending = self._setup.allowance.spending()
                target = Condition(tensions[number], tip_wrenches[number], before=before)
                try:
                    shape = self.solve(target, start, spending)
                except SolveError as error:
                    if arms > 1:
                        error.in_set(number)
                    raise
                shapes.position[number], shapes.quaternion[number] = shape[:2]
                shapes.strains[:, number] = shape.strains
                if shapes.tensions is not None:
                    shapes.tensions[number] = shape.tensions
                shapes.residual[number] = shape.equilibrium.state.residual
                shapes.iterations[number] = shape.equilibrium.iterations
        return shapes

    def _loaded(self, tip_wrenches: FloatArray) -> bool:
        """Whether loads besides tendons act on arms with these ``tip_wrenches`` (A, 6)."""
        return False

    @abc.abstractmethod
    def _solve_at_once(
        self, level: int, tensions: FloatArray, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """Solve arms under ``tensions`` (A, J) [N] alone, together, on a ``level``.

        Write them to the ``numbers`` (A,) of ``shapes``, and return which are resolved, (A,).
        """

    def _write(
        self, batch: ArmBatch, z: FloatArray, places: Places, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """Write the poses by twists ``z`` (A n, m) to ``shapes``; return which are resolved."""
        position, quaternion, error = batch.poses(z, places)
        position += self._setup.base[0]
        shapes.position[numbers], shapes.quaternion[numbers] = position, quaternion
        return errors_between(error) <= self._setup.accuracy

    @abc.abstractmethod
    def wind(
        self, target: Condition, start: Equilibrium | None, spending: Spending
    ) -> tuple[Shape, FloatArray]:
        """Find the shape in which winches hold the lengths of ``target``, and lengths reeled in.

        These are (J,) [m]. A SolveError is raised if no tensions hold the lengths of ``target``.
        """

    @abc.abstractmethod
    def sensitivity(self, equilibrium: Equilibrium) -> Sensitivity:
        """Return the first derivatives of a solution."""

    def tip_covariance(self, equilibrium: Equilibrium, uncertainty: Uncertainty) -> FloatArray:
        """Return the covariance (6, 6) of position and rotation vector of the tip."""
        return self.sensitivity(equilibrium).tip_covariance(uncertainty)

    def by_loads(self, equilibrium: Equilibrium, loads: Sequence[Loads]) -> Change:
        """Return the change of a solution per unit of each of ``loads``, if there may be loads."""
        raise NotImplementedError

    def displacements(self, equilibrium: Equilibrium) -> FloatArray:
        """Return the lengths that winches have reeled in in a solution [m], (J,)."""
        return self._winches.displacements(equilibrium)


def strains_of(z: FloatArray) -> FloatArray:
    """Return strains tau, xi, k and q, (4, ..., n), of twists ``z`` (..., n, m)."""
    columns = z.transpose(-1, *range(z.ndim - 1))
    strains = np.empty((4, *z.shape[:-1]))
    np.divide(columns[:3], columns[3], out=strains[:3])
    np.subtract(columns[3], 1.0, out=strains[3])
    return strains


# The model exact ---------------------------------------------------------------------------------

# The most shapes whose factors are kept, and the most numbers in these: 128 MB.
_SHAPES_WITH_FACTORS, _NUMBERS = 32, 2**24


class Exact(Statics):
    """The model exact: equilibria of the rod without further approximation.

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
        self.rod.problem(0)  # An arm that needs too many nodes is refused here.
        self._winches = Winches(self.rod)
        self._recent = RecentFactors(_SHAPES_WITH_FACTORS, _NUMBERS)
        self._readout = functools.cache(lambda level: self.rod.readout(level, setup.s))
        self._batches = functools.lru_cache(8)(
            lambda level, arms: ArmBatch(self.rod.finer(level).own, arms)
        )
        self._derivatives = functools.cache(lambda level: Derivatives(self.rod, level, setup.s))

    def problem(self, level: int) -> Problem:
        """Return the equations of the rod on the nodes of a ``level``."""
        return self.rod.problem(level)

    def solve(self, target: Condition, start: Equilibrium | None, spending: Spending) -> Shape:
        """Find a stable equilibrium of the rod, starting with the factors of ``start``."""
        restart = None if start is None else self._with_factors(start)
        equilibrium = self.rod.solve(target, restart, spending)
        if restart is not None and restart.key and restart.factors is None:
            if restart.level == equilibrium.level:
                # The next solve that starts from this shape begins with these factors.
                self._keep(restart.key, equilibrium)
        return self.shape(equilibrium)

    def _loaded(self, tip_wrenches: FloatArray) -> bool:
        """Whether loads act on the rod, or one of ``tip_wrenches`` (A, 6) is not zero."""
        return self.rod.is_loaded or bool(tip_wrenches.any())

    @np.errstate(over='ignore', invalid='ignore', divide='ignore')
    def _solve_at_once(
        self, level: int, tensions: FloatArray, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """Balance every cross section by itself, and return which arms are resolved, (A,)."""
        batch, readout = self._batches(level, len(tensions)), self._readout(level)
        try:
            z, residual, steps = batch.balance(tensions)
        except ConvergenceError:
            return np.zeros(len(tensions), np.bool_)
        is_resolved = self._write(batch, z, readout.places, numbers, shapes)
        is_resolved &= are_stretched(batch.tables, z, len(tensions))
        z = readout.twists(z.reshape(len(tensions), -1, self.strains))
        shapes.strains[:, numbers] = strains_of(z)
        shapes.residual[numbers], shapes.iterations[numbers] = residual, steps
        return is_resolved

    def wind(
        self, target: Condition, start: Equilibrium | None, spending: Spending
    ) -> tuple[Shape, FloatArray]:
        """Find the shape in which winches hold lengths, and the lengths (J,) [m] reeled in."""
        restart = None if start is None else self._with_factors(start)
        equilibrium = self._winches.solve(target, restart, spending)
        return self.shape(equilibrium), equilibrium.state.reeled

    def shape(self, equilibrium: Equilibrium) -> Shape:
        """Return the shape at the stations, and keep the factors of ``equilibrium``."""
        reading = self._readout(equilibrium.level).read(equilibrium.state, equilibrium.fine)
        position, quaternion, twist, tensions = reading
        position = position + self._setup.base[0]
        if equilibrium.factors is not None:
            key = object()
            self._keep(key, equilibrium)
            equilibrium = equilibrium._replace(factors=None, key=key)
        return Shape(position, quaternion, strains_of(twist), tensions, equilibrium)

    def _keep(self, key: object, equilibrium: Equilibrium) -> None:
        """Keep the factors of ``equilibrium`` for the shape with this ``key``."""
        if equilibrium.factors is not None:
            self._recent.add(key, equilibrium.factors, equilibrium.state.z.size)

    def _with_factors(self, equilibrium: Equilibrium) -> Equilibrium:
        """Return ``equilibrium`` with its factors, if these are among the recent ones."""
        return (
            equilibrium
            if equilibrium.key is None
            else equilibrium._replace(factors=self._recent.find(equilibrium.key))
        )

    def _linearisation(self, equilibrium: Equilibrium) -> Derivatives:
        """Linearise about ``equilibrium``, and keep the factors for the next solve."""
        derivatives = self._derivatives(equilibrium.level)
        factors = derivatives.linearisation(self._with_factors(equilibrium)).factors
        if equilibrium.key is not None:
            self._recent.add(equilibrium.key, factors, equilibrium.state.z.size)
        return derivatives

    def sensitivity(self, equilibrium: Equilibrium) -> Sensitivity:
        """Return first derivatives by the linearised equations of the rod."""
        return self._linearisation(equilibrium).sensitivity(equilibrium)

    def tip_covariance(self, equilibrium: Equilibrium, uncertainty: Uncertainty) -> FloatArray:
        """Return the tip's covariance (6, 6), by the derivatives that are uncertain alone."""
        return self._linearisation(equilibrium).tip_covariance(equilibrium, uncertainty)

    def by_loads(self, equilibrium: Equilibrium, loads: Sequence[Loads]) -> Change:
        """Return the change of the shape per unit of each of dead ``loads``."""
        return self._linearisation(equilibrium).by_loads(equilibrium, loads)
