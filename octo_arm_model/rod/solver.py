"""The solver of an arm: tensions in, backbone out."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from types import NoneType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import (
    ConfigError,
    ContinuationError,
    ConvergenceError,
    LoadError,
    TensionError,
    shown,
)
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.limits import Allowance, Budget
from octo_arm_model.arm.loads import Loads
from octo_arm_model.arm.material import DEFAULT_LAW, LAWS
from octo_arm_model.arm.pose import Pose
from octo_arm_model.arm.validation import check_class
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.checks import LoadLimits, check_tensions, tip_wrench_of
from octo_arm_model.rod.contact import NONE, Contacts
from octo_arm_model.rod.elements import LEVELS, Elements
from octo_arm_model.rod.equilibrium import Condition, Equilibrium, Problem
from octo_arm_model.rod.papers import Papers
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty
from octo_arm_model.rod.statics import Exact, Setup, Shape, Shapes, Statics
from octo_arm_model.rod.stations import DEFAULT_STATIONS, StationGrid
from octo_arm_model.rod.tendons import outward_paths

STATICS: dict[str, Callable[[Setup], Statics]] = {
    'renda2012': functools.partial(Papers, is_published=True),
    'closed_form': functools.partial(Papers, is_published=False),
    'exact': Exact,
}
MODELS = tuple(STATICS)
DEFAULT_MODEL = 'renda2012'
_FINEST, _COARSEST = 1e-12, 1e-4  # bounds of the accuracy
_PLACES = 513  # places at which the least stiffness of an arm is searched for


class Solver:
    """Solves one arm with one model, many times; `Config.solver` makes the solver of a file.

    Everything that does not depend on the tensions is tabulated once. Results are kept for the
    next solve, so two threads must not share a solver, but each may take a copy. Solutions passed
    to a solver must be its own or those of a copy: those of another model, grid or number of
    points are refused; those of an arm with other parameters only are not detected.

    Attributes:
        arm: the arm.
        model: name of the model.
        law: elastic law of the cross sections; always linear except in the model exact.
        loads: loads besides the tendons.
        base: pose of the base.
        grid: the stations.
    """

    def __init__(  # noqa: PLR0913 - options by keyword
        self,
        arm: Arm,
        model: str = DEFAULT_MODEL,
        stations: int = DEFAULT_STATIONS,
        base: Pose = Pose(),
        *,
        material: str = DEFAULT_LAW,
        shear: bool = False,
        loads: Loads = Loads(),
        compiled: bool | None = None,
        budget: Budget = Budget(),
        accuracy: float = 1e-8,
    ) -> None:
        """Prepare ``arm`` for ``stations`` stations, starting from the pose ``base``.

        ``material`` is the name of an elastic law, ``shear`` lets cross sections shear (linear law
        only) and ``loads`` act in every solve. These three are for the model exact; the others
        ignore the law, and are linear. ``compiled`` chooses whether numba compiles the node
        functions or NumPy computes them; None takes numba if it is installed and works. Results
        are the same. ``budget`` limits the continuation of one loaded arm, or of all solves in
        `together`. The number of nodes is chosen so that the error of positions is at most
        ``accuracy`` times the length; up to 1e-6 on the finest nodes, 1e-5 with contact or a
        history of friction. With such a history a thousand times the accuracy, at most 1e-5, does.

        Raises:
            ConfigError: if there is no such model or material, they exclude each other, the model
                does not cover the arm or the loads, the stations are too few, or the accuracy is
                out of bounds.
            ArmDefinitionError: if an argument is of another class, or a load does not fit the arm
                or is larger than `LoadLimits` allow.
            ModuleNotFoundError: if ``compiled`` but numba is not installed; if it does not work,
                any error of numba.
        """
        _check(arm, model, base)
        if not (isinstance(material, str) and material in LAWS):
            expected = f'one of {", ".join(LAWS)}'
            raise ConfigError(f'material.law is {shown(material)}, expected {expected}')
        check_class('material.shear', shear, bool, np.bool_)
        check_class('loads', loads, Loads)
        check_class('compiled', compiled, bool, np.bool_, NoneType)
        check_class('budget', budget, Budget)
        if not (
            isinstance(accuracy, (float, np.floating)) and _FINEST <= accuracy <= _COARSEST
        ):  # nor NaN
            expected = f'a number from {_FINEST:g} to {_COARSEST:g}'
            raise ConfigError(f'accuracy is {shown(accuracy)}, expected {expected}')
        self.arm, self.model, self.base, self.loads = arm, model, base, loads
        self._remake = functools.partial(
            Solver,
            arm,
            model,
            stations,
            base,
            material=material,
            shear=shear,
            loads=loads,
            compiled=compiled,
            budget=budget,
            accuracy=accuracy,
        )
        loads.check_inside(arm.length)
        loads.check_base(base.position)
        self.grid = StationGrid.build(arm, stations, loads.breaks)
        self._allowance = Allowance(budget)
        x, y, z, w = base.quaternion
        frame = np.array(base.position), np.array([w, x, y, z])
        grid = self.grid.s, self.grid.section
        self._statics = STATICS[model](
            Setup(arm, *grid, frame, material, shear, loads, self._allowance, compiled, accuracy)
        )
        self.law = LAWS[self._statics.law]
        if shear and not (self._statics.strains == 6 and material == 'linear'):
            raise ConfigError(
                f'material.shear goes with model exact and material.law linear, not with {model} '
                f'and {material}'
            )
        if loads.any:
            self._require_loads()
        self._wrench = loads.tip_wrench
        s = np.linspace(0.0, arm.length, _PLACES)
        self._limits = LoadLimits(arm, s)
        self._reach = (arm.tendon_section <= grid[1][:, np.newaxis]).astype(np.float64)
        self._reach.setflags(write=False)

    def __reduce__(self) -> tuple[functools.partial[Solver], tuple[()]]:
        """Pickle and copy a solver by its arguments, from which the copy is prepared anew."""
        return self._remake, ()

    @property
    def is_compiled(self) -> bool:
        """Whether numba has compiled the node functions."""
        return self._statics.is_compiled

    @property
    def strains(self) -> int:
        """Number of strains of a cross section: 6 with shear, else 4."""
        return self._statics.strains

    def elements(self, level: int) -> Elements:
        """Return the elements and nodes of a ``level`` of equilibria."""
        return self._statics.problem(level).elements

    def shaped(
        self,
        position: FloatArray,
        quaternion: FloatArray,
        strains: FloatArray,
        tensions: FloatArray,
        wrench: FloatArray,
        convergence: tuple[float, int],
    ) -> Backbone:
        """Return the backbone of a shape at the stations that this solver has not solved.

        The arrays are (S, 3) [m], (S, 4), (4, S), (J,) [N], and (6,) for the ``wrench`` on the
        tip. ``convergence`` is the residual and the number of iterations.
        """
        residual, iterations = convergence
        numbers = np.array(residual), np.array(iterations)
        shapes = Shapes(position, quaternion, strains, None, *numbers)
        return self._read_only(tensions.reshape(self.arm.tension_shape), wrench, shapes)

    def with_loads(self, loads: Loads) -> Solver:
        """Return a solver with the same arguments but ``loads``; errors are those of `Solver`."""
        return functools.partial(self._remake, loads=loads)()

    def _require_loads(self) -> None:
        if not self._statics.takes_loads:
            raise ConfigError(
                f'model is {self.model!r}, which has no loads but the tendons: choose exact'
            )

    def _require_frictionless(self) -> None:
        if self.loads.has_friction:
            raise ConfigError(
                'loads.obstacles have friction, where an equilibrium depends on how the arm got '
                'there: move it, see Dynamics, or set their friction to 0'
            )

    def solve(
        self,
        tensions: ArrayLike,
        tip_wrench: ArrayLike | None = None,
        start: Backbone | None = None,
    ) -> Backbone:
        """Return the shape under ``tensions`` ``(..., *Arm.tension_shape)`` [N].

        ``tip_wrench`` (..., 6) is a force and a moment on the tip in base_frame [N, N m], besides
        those of ``loads``; its leading axes are broadcast with those of the tensions. A loaded arm
        is followed from ``start``, a single solution of this solver, or from the unloaded shape.
        Tendons with friction are pulled from slack; `follow` pulls them from another solution.

        Raises:
            TensionError: if the tensions do not fit the arm, or are negative or not finite.
            LoadError: if the tip's wrench is not six finite numbers, exceeds `LoadLimits`, or its
                leading axes do not fit those of the tensions.
            ConfigError: if the model has no loads and there are some, or obstacles have friction.
            SolveError: if the model has no trustworthy answer.
            ContinuationError: if a loaded arm would take more than the budget.
        """
        return self._solve(tensions, tip_wrench, start, None)

    def _solve(
        self,
        tensions: ArrayLike,
        tip_wrench: ArrayLike | None,
        start: Backbone | None,
        before: FloatArray | None,
    ) -> Backbone:
        """Check and broadcast the arguments, and solve from tensions ``before`` (J, M) [N]."""
        checked, wrench = self._checked_input(tensions, tip_wrench)
        axes, all_axes = checked.shape[: -len(self.arm.tension_shape)], wrench.shape[:-1]
        if all_axes != axes:
            try:
                all_axes = np.broadcast_shapes(axes, all_axes)
            except ValueError:
                expected = f'those of the tensions, {axes}, or none'
                problem = f'tip_wrench has leading axes {all_axes}, expected {expected}'
                raise LoadError(problem) from None
            checked = np.broadcast_to(checked, (*all_axes, *self.arm.tension_shape))
        if start is not None:
            self._equilibrium_of(start)
        return self._backbone(checked.copy(), wrench, start, before)

    def _checked_input(
        self, tensions: ArrayLike, tip_wrench: ArrayLike | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return checked ``tensions`` [N] and the total wrench on the tip, (..., 6) [N, N m]."""
        self._require_frictionless()
        checked = check_tensions(self.arm, tensions)
        self._limits.check_tensions(checked)
        if tip_wrench is None:
            return checked, self._wrench
        return checked, self._wrench + self.check_tip_wrench(tip_wrench)

    def _backbone(
        self,
        tensions: FloatArray,
        wrench: FloatArray,
        start: Backbone | None,
        before: FloatArray | None,
    ) -> Backbone:
        """Solve for checked ``tensions`` and the total ``wrench`` (..., 6) on the tip."""
        axes = tensions.shape[: -len(self.arm.tension_shape)]
        start_equilibrium = None if start is None else start.equilibrium
        history = None if before is None else before.T
        if not axes:
            target = Condition(tensions.ravel(), wrench, before=history)
            shape = self._statics.solve(target, start_equilibrium, self._allowance.spending())
            return self._single(tensions, wrench, shape)
        count, stations = math.prod(axes), self.grid.s.size
        wrenches = np.broadcast_to(wrench, (*axes, 6))
        rows = tensions.reshape(count, len(self.arm.tendons))
        loads = wrenches.reshape(count, 6)
        solved = self._statics.solve_many(rows, loads, start_equilibrium, history)
        local = solved.tensions
        shapes = Shapes(
            solved.position.reshape(*axes, stations, 3),
            solved.quaternion.reshape(*axes, stations, 4),
            solved.strains.reshape(4, *axes, stations),
            None if local is None else local.reshape(*axes, *self._reach.shape),
            solved.residual.reshape(axes),
            solved.iterations.reshape(axes),
        )
        return self._read_only(tensions, wrenches, shapes)

    def _single(self, tensions: FloatArray, wrench: FloatArray, shape: Shape) -> Backbone:
        equilibrium, history = shape.equilibrium, None
        if self.arm.friction:
            history = self._statics.problem(equilibrium.level).history(equilibrium.state).T
        convergence = np.array(equilibrium.state.residual), np.array(equilibrium.iterations)
        shapes = Shapes(*shape[:4], *convergence)
        return self._read_only(tensions, wrench, shapes, equilibrium, history)

    def _read_only(
        self,
        tensions: FloatArray,
        wrench: FloatArray,
        shapes: Shapes,
        equilibrium: Equilibrium | None = None,
        history: FloatArray | None = None,
    ) -> Backbone:
        """Return a `Backbone` of these arrays, which become read-only."""
        position, quaternion, strains, local, residual, iterations = shapes
        if local is not None:
            local = local * self._reach
            # The tensions at the base are given; interpolated ones would differ by rounding.
            local[..., 0, :] = tensions.reshape(local[..., 0, :].shape) * self._reach[0]
        for array in (tensions, wrench, local, history, *shapes):
            if array is not None:
                array.setflags(write=False)
        return Backbone(
            self.model,
            self.grid.s,
            self.grid.section,
            position,
            quaternion,
            strains[0],
            strains[1],
            strains[2],
            strains[3],
            tensions,
            wrench,
            residual,
            iterations,
            equilibrium,
            self._reach,
            local,
            history,
        )

    def check_tip_wrench(self, tip_wrench: ArrayLike) -> FloatArray:
        """Return ``tip_wrench`` (..., 6) as a float array.

        Raises:
            LoadError: if it is not six finite numbers, or exceeds `LoadLimits`.
            ConfigError: if it is not zero and the model has no loads.
        """
        wrench = tip_wrench_of(tip_wrench)
        if np.count_nonzero(wrench):
            self._require_loads()
        self._limits.check_tip_wrench(wrench)
        return wrench

    def follow(
        self, tensions: ArrayLike, last: Backbone | None, tip_wrench: ArrayLike | None = None
    ) -> Backbone:
        """Return the shape under ``tensions``, followed from the ``last`` solution, if any.

        If that fails, the arm is followed from the unloaded shape. Tendons with friction slide
        from their tensions in the ``last`` solution, so that a sequence of tensions shows the
        hysteresis of the arm. Arguments and errors are those of `solve`.
        """
        check_class('last', last, Backbone, NoneType)
        before = None if last is None else last.point_tensions
        began = time.monotonic()
        try:
            return self._solve(tensions, tip_wrench, last, before)
        except ContinuationError:
            raise  # The budget does not allow a second attempt.
        except ConvergenceError:
            if last is None:
                raise
            with self._allowance.together(began):
                return self._solve(tensions, tip_wrench, None, before)

    def together(self) -> AbstractContextManager[None]:
        """Return a context in which all solves share the time of one budget."""
        return self._allowance.together()

    def sensitivity(self, backbone: Backbone) -> Sensitivity:
        """Return the first derivatives of a single solution of this solver.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
            OctoArmError: if there are none, as where a tendon with friction sticks.
        """
        return self._statics.sensitivity(self._equilibrium_of(backbone))

    def sensitivity_to_loads(self, backbone: Backbone, loads: Sequence[Loads]) -> Change:
        """Return the change of a single solution of this solver per unit of each of ``loads``.

        The derivative is by a factor on each of ``loads``, which need not act on the arm: `Loads`
        with a force of 1 N give the change per newton, `Loads` with gravity and a fluid the change
        per weight. At the s of a point load the solver must have a point load of any magnitude,
        or an anchorage.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver, the model has no
                loads, or one of ``loads`` is not dead.
            OctoArmError: if a load does not fit the arm, and as `sensitivity`.
        """
        equilibrium = self._equilibrium_of(backbone)
        self._require_loads()
        if not (isinstance(loads, Sequence) and loads):
            raise ConfigError(f'loads are {shown(loads)}, expected a list of Loads')
        for load in loads:
            check_class('one of loads', load, Loads)
            load.check_inside(self.arm.length)
            kinds = {'others': load.others, 'scaled': load.scaled, 'obstacles': load.obstacles}
            if kind := next((name for name, value in kinds.items() if value), ''):
                raise ConfigError(f'loads.{kind} have no derivatives by their magnitude')
        return self._statics.by_loads(equilibrium, loads)

    def tip_covariance(self, backbone: Backbone, uncertainty: Uncertainty) -> FloatArray:
        """Return the covariance (6, 6) of the tip's position [m] and rotation vector [rad].

        It is in base_frame and to first order, and zero if nothing is uncertain.

        Raises:
            ConfigError: if the model has no derivative by something that is uncertain.
            OctoArmError: as `sensitivity`.
        """
        check_class('uncertainty', uncertainty, Uncertainty)
        if not uncertainty.is_any:
            return np.zeros((6, 6))
        return self._statics.tip_covariance(self._equilibrium_of(backbone), uncertainty)

    def tendon_lengths(self, backbone: Backbone) -> FloatArray:
        """Return the length of every tendon from base to anchorage [m], of `Arm.tension_shape`.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
        """
        problem, equilibrium = self._solution(backbone)
        return problem.tendon_lengths(equilibrium.state).reshape(self.arm.tension_shape)

    def contacts(self, backbone: Backbone) -> Contacts:
        """Return the contacts of the arm with obstacles in a single solution of this solver.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
        """
        problem, equilibrium = self._solution(backbone)
        if problem.contact is None:
            return NONE
        problem.orient(equilibrium.state.z)
        return problem.contact.report(problem.places())

    def local_tensions(self, backbone: Backbone) -> FloatArray:
        """Return the tension of every tendon at every node of the model [N], (tendons, nodes).

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
        """
        problem, equilibrium = self._solution(backbone)
        return (equilibrium.state.at_nodes.tensions * problem.tables.reach).T

    def displacements(self, backbone: Backbone) -> FloatArray:
        """Return the length that the winch of each tendon has reeled in [m].

        The shape is `Arm.tension_shape`. For a slack tendon it is the least that makes it taut.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
        """
        reeled = self._statics.displacements(self._equilibrium_of(backbone))
        return reeled.reshape(self.arm.tension_shape)

    @property
    def rest_lengths(self) -> FloatArray:
        """Length of every tendon of the unloaded arm [m], of `Arm.tension_shape`."""
        return self._statics.problem(0).rest_lengths.reshape(self.arm.tension_shape)

    @functools.cached_property
    def largest_displacements(self) -> FloatArray:
        """Upper bounds of the lengths that winches can reel in [m], (tendons,).

        Each is the length in the unloaded arm plus the stretch under `LoadLimits.force`.
        """
        rest = self.rest_lengths.ravel()
        return rest + self._limits.force * self.arm.tendon_compliance(rest)

    def check_displacements(self, displacements: FloatArray, tendons: Sequence[int]) -> None:
        """Check ``displacements`` [m], one for each of the ``tendons``, given by number.

        Raises:
            TensionError: if one is not below its upper bound, `largest_displacements`.
        """
        largest = self.largest_displacements[list(tendons)]
        beyond = np.flatnonzero(displacements >= largest)
        if beyond.size:
            first = beyond[0]
            number = tendons[first]
            length = self.rest_lengths.ravel()[number]
            stretch = largest[first] - length
            stretched = f' and {stretch:.4g} m that it stretches at most' if stretch else ''
            raise TensionError(
                f'displacement of {self.arm.tendon_names[number]} is {displacements[first]:.6g} '
                f'm, expected less than there is to reel in: {length:.4g} m in the unloaded '
                f'arm{stretched}'
            )

    def displacements_by_offset(self, backbone: Backbone) -> FloatArray:
        """Return derivatives of `displacements` by distances from the midline, (tendons,) [-].

        They are by unloaded lengths and the stretch of these; only winding tendons have any.
        """
        problem, equilibrium = self._solution(backbone)
        weights, tensions = problem.elements.weights, equilibrium.state.at_nodes.tensions
        outwards = outward_paths(self.arm, problem.tables, problem.elements.s)
        rates = problem.unloaded_tendons.by_path(outwards).stretch
        integrals = weights @ (rates * tensions)
        return np.asarray(weights @ rates + self.arm.stretched(integrals))

    def wind(
        self,
        displacements: FloatArray,
        driven: NDArray[np.bool_],
        tensions: FloatArray,
        tip_wrench: ArrayLike | None,
        start: Backbone | None,
    ) -> tuple[Backbone, FloatArray]:
        """Return the shape with ``displacements`` (J,) [m] of the ``driven`` tendons, and all.

        The other tendons have ``tensions`` (J,) [N]. Tendons with friction slide from those in
        ``start``. Other arguments and errors are those of `solve`.
        """
        checked, wrench = self._checked_input(tensions.reshape(self.arm.tension_shape), tip_wrench)
        start_equilibrium = None if start is None else self._equilibrium_of(start)
        history = None if start is None else start.point_tensions
        before = None if history is None else history.T
        target = Condition(checked.ravel(), wrench, 1.0, before, displacements, driven)
        shape, reeled = self._statics.wind(target, start_equilibrium, self._allowance.spending())
        pulled = shape.equilibrium.state.condition.tensions.reshape(self.arm.tension_shape)
        self._limits.check_tensions(pulled)
        return self._single(pulled, wrench, shape), reeled

    def _equilibrium_of(self, backbone: Backbone) -> Equilibrium:
        """Return the equilibrium of a single solution of this solver.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
        """
        check_class('backbone', backbone, Backbone)
        equilibrium = backbone.equilibrium
        if equilibrium is None:
            raise ConfigError('the backbone is that of a batch, expected a single solution')
        is_alike = backbone.model == self.model and backbone.s.size == self.grid.s.size
        if is_alike and 0 <= equilibrium.level < len(LEVELS):
            nodes = self._statics.problem(equilibrium.level).elements.s.size
            if equilibrium.state.z.shape == (nodes, self.strains):
                return equilibrium
        raise ConfigError('the backbone was solved by another solver')

    def _solution(self, backbone: Backbone) -> tuple[Problem, Equilibrium]:
        """Return the equations and the equilibrium of a single solution of this solver."""
        equilibrium = self._equilibrium_of(backbone)
        return self._statics.problem(equilibrium.level), equilibrium


def solve(
    arm: Arm,
    tensions: ArrayLike,
    model: str = DEFAULT_MODEL,
    stations: int = DEFAULT_STATIONS,
    base: Pose = Pose(),
) -> Backbone:
    """Return the shape of ``arm`` under ``tensions`` in one call, by a `Solver` that is cached."""
    _check(arm, model, base)
    check_class('stations', stations, int, np.integer)
    return _cached_solver(arm, model, stations, base).solve(tensions)


def _check(arm: object, model: object, base: object) -> None:
    check_class('arm', arm, Arm)
    check_class('base', base, Pose)
    if not (isinstance(model, str) and model in MODELS):
        raise ConfigError(f'model is {shown(model)}, expected one of {", ".join(MODELS)}')


@functools.lru_cache(maxsize=16)
def _cached_solver(arm: Arm, model: str, stations: int, base: Pose) -> Solver:
    # For a single shape, loading machine code takes longer than it saves.
    return Solver(arm, model, stations, base, compiled=False)
