"""Tensions in, backbone out: the one way to solve an arm."""

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
from octo_arm_model.rod.contact import Contacts
from octo_arm_model.rod.elements import Elements
from octo_arm_model.rod.equilibrium import Condition, Equilibrium
from octo_arm_model.rod.papers import Papers
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty
from octo_arm_model.rod.statics import Exact, Setup, Shape, Shapes, Statics
from octo_arm_model.rod.stations import DEFAULT_STATIONS, StationGrid

STATICS: dict[str, Callable[[Setup], Statics]] = {
    'renda2012': functools.partial(Papers, is_published=True),
    'closed_form': functools.partial(Papers, is_published=False),
    'exact': Exact,
}
MODELS = tuple(STATICS)
DEFAULT_MODEL = 'renda2012'
_FINEST, _COARSEST = 1e-12, 1e-4  # accuracy that may be asked for
_PLACES = 513  # at which the least stiffness of an arm is looked for


class Solver:
    """Solves one arm with one model, many times; `Config.solver` makes that of a file.

    Everything that does not depend on the tensions is tabulated once. Results are kept for the
    next solve: not for two threads at once, but each may take a copy. Solutions passed to it must
    be its own, or a copy's: those of another model, grid or number of points are refused, those of
    an arm that differs in parameters only are not detected.

    Attributes:
        arm: the arm.
        model: name of the model.
        law: elastic law of the cross sections; always linear but for the model exact.
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
        only) and ``loads`` act in every solve; these three are for the model exact, and the law
        is ignored by the others, which are linear. ``compiled`` chooses the form of the node
        functions: compiled by numba, or arrays of NumPy; None is numba where it is installed and
        works. Results are the same. ``budget`` limits the continuation of one loaded arm; see
        `together`. Nodes are as many as it takes for positions to be right to ``accuracy`` times
        the length.

        Raises:
            ConfigError: if there is no such model or material, they do not go together, the model
                does not cover the arm or the loads, the stations are too few, or there is no such
                accuracy.
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
        self._anew = functools.partial(
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
        own = self.grid.s, self.grid.section
        self._statics = STATICS[model](
            Setup(arm, *own, frame, material, shear, loads, self._allowance, compiled, accuracy)
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
        places = np.linspace(0.0, arm.length, _PLACES)
        self._limits = LoadLimits(arm, places)
        self._reach = (arm.tendon_section <= own[1][:, np.newaxis]).astype(np.float64)
        self._reach.setflags(write=False)

    def __reduce__(self) -> tuple[functools.partial[Solver], tuple[()]]:
        """A copy, one in another process as well, is prepared from the same arguments."""
        return self._anew, ()

    @property
    def is_compiled(self) -> bool:
        """Whether numba has compiled the node functions."""
        return self._statics.is_compiled

    @property
    def strains(self) -> int:
        """Number of strains of a cross section: 6 with shear, else 4."""
        return self._statics.strains

    def elements(self, level: int) -> Elements:
        """Where the nodes of an equilibrium of a ``level`` are."""
        return self._statics.problem(level).elements

    def shaped(
        self,
        position: FloatArray,
        quaternion: FloatArray,
        strains: FloatArray,
        tensions: FloatArray,
        wrench: FloatArray,
        found: tuple[float, int],
    ) -> Backbone:
        """A shape at the stations that was ``found`` elsewhere, with its residual and iterations.

        From positions (S, 3) [m] on, under ``tensions`` (J,) [N] and a ``wrench`` (6,) on the tip.
        """
        residual, iterations = found
        how = np.array(residual), np.array(iterations)
        shapes = Shapes(position, quaternion, strains, None, *how)
        return self._made(tensions.reshape(self.arm.tension_shape), wrench, shapes)

    def with_loads(self, loads: Loads) -> Solver:
        """The same under other ``loads``; errors are those of `Solver`."""
        return functools.partial(self._anew, loads=loads)()

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
        """Shape under ``tensions`` ``(..., *Arm.tension_shape)`` [N].

        ``tip_wrench`` (..., 6) is a force and a moment on the tip in base_frame [N, N m], besides
        those of ``loads``; its leading axes are broadcast with those of the tensions. A loaded arm
        is followed from ``start``, a single solution of this solver, or from the unloaded shape.
        Tendons with friction are pulled from slack, see `follow` for others.

        Raises:
            TensionError: if the tensions do not fit the arm, or are negative or not finite.
            LoadError: if the tip's wrench is not six finite numbers, larger than `LoadLimits`
                allow, or of another number of sets than the tensions.
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
        """As `solve`; tendons with friction slide from tensions ``before`` (tendons, points)."""
        checked, wrench = self._given(tensions, tip_wrench)
        own, lead = checked.shape[: -len(self.arm.tension_shape)], wrench.shape[:-1]
        if lead != own:
            try:
                lead = np.broadcast_shapes(own, lead)
            except ValueError:
                expected = f'those of the tensions, {own}, or none'
                problem = f'tip_wrench has leading axes {lead}, expected {expected}'
                raise LoadError(problem) from None
            checked = np.broadcast_to(checked, (*lead, *self.arm.tension_shape))
        if start is not None:
            self._own(start)
        return self._backbone(checked.copy(), wrench, start, before)

    def _given(
        self, tensions: ArrayLike, tip_wrench: ArrayLike | None
    ) -> tuple[FloatArray, FloatArray]:
        """Checked ``tensions`` [N] and the whole wrench on the tip, (..., 6) [N, N m]."""
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
        """As `_solve`, of checked ``tensions`` and the whole ``wrench`` (..., 6) on the tip."""
        lead = tensions.shape[: -len(self.arm.tension_shape)]
        known = None if start is None else start.equilibrium
        history = None if before is None else before.T
        if not lead:
            wanted = Condition(tensions.ravel(), wrench, before=history)
            shape = self._statics.solve(wanted, known, self._allowance.spending())
            return self._of_one(tensions, wrench, shape)
        count, stations = math.prod(lead), self.grid.s.size
        wrenches = np.broadcast_to(wrench, (*lead, 6))
        rows = tensions.reshape(count, len(self.arm.tendons))
        on_tips = wrenches.reshape(count, 6)
        found = self._statics.solve_many(rows, on_tips, known, history)
        along = found.tensions
        shapes = Shapes(
            found.position.reshape(*lead, stations, 3),
            found.quaternion.reshape(*lead, stations, 4),
            found.strains.reshape(4, *lead, stations),
            None if along is None else along.reshape(*lead, *self._reach.shape),
            found.residual.reshape(lead),
            found.iterations.reshape(lead),
        )
        return self._made(tensions, wrenches, shapes)

    def _of_one(self, tensions: FloatArray, wrench: FloatArray, shape: Shape) -> Backbone:
        found = shape.equilibrium
        history = None
        if self.arm.friction:
            history = self._statics.history(found).T
        how = np.array(found.state.residual), np.array(found.iterations)
        return self._made(tensions, wrench, Shapes(*shape[:4], *how), found, history)

    def _made(
        self,
        tensions: FloatArray,
        wrench: FloatArray,
        shapes: Shapes,
        found: Equilibrium | None = None,
        history: FloatArray | None = None,
    ) -> Backbone:
        """A `Backbone` of these arrays, which are read-only from now on."""
        position, quaternion, strains, along, residual, iterations = shapes
        if along is not None:
            along = along * self._reach
            # At the base they are given, not interpolated from points beyond.
            along[..., 0, :] = tensions.reshape(along[..., 0, :].shape) * self._reach[0]
        for array in (tensions, wrench, along, history, *shapes):
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
            found,
            self._reach,
            along,
            history,
        )

    def check_tip_wrench(self, tip_wrench: ArrayLike) -> FloatArray:
        """Return ``tip_wrench`` (..., 6) as a float array.

        Raises:
            LoadError: if it is not six finite numbers, or larger than `LoadLimits` allow.
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
        """As `solve` from the ``last`` solution, if any; without a start where that fails.

        Tendons with friction slide from their tensions in the ``last`` one, so that a sequence of
        tensions shows the hysteresis of the arm.

        Raises:
            OctoArmError: as `solve`.
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
        """Within it all solves have the time of one budget together, its iterations each."""
        return self._allowance.together()

    def sensitivity(self, backbone: Backbone) -> Sensitivity:
        """First derivatives of a single solution of this solver.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
        """
        return self._statics.sensitivity(self._own(backbone))

    def sensitivity_to_loads(self, backbone: Backbone, loads: Sequence[Loads]) -> Change:
        """Change of a single solution of this solver per unit of each of ``loads``.

        The derivative is by a factor on each of ``loads``, which need not act on the arm: `Loads`
        of a force of 1 N give the change per newton, `Loads` of gravity and a fluid that per part
        of the weight. At the s of a point load the solver must have one too, of any magnitude, or
        an anchorage.

        Raises:
            ConfigError: as `sensitivity`; if the model has no loads, one of ``loads`` is of
                another kind than the dead ones, or tendons have friction.
            ArmDefinitionError: if a load does not fit the arm.
        """
        found = self._own(backbone)
        self._require_loads()
        if not (isinstance(loads, Sequence) and loads):
            raise ConfigError(f'loads are {shown(loads)}, expected a list of Loads')
        for one in loads:
            check_class('one of loads', one, Loads)
            one.check_inside(self.arm.length)
            given = {'others': one.others, 'scaled': one.scaled, 'obstacles': one.obstacles}
            if what := next((name for name, value in given.items() if value), ''):
                raise ConfigError(f'loads.{what} have no derivatives by their magnitude')
        return self._statics.by_loads(found, loads)

    def tip_covariance(self, backbone: Backbone, uncertainty: Uncertainty) -> FloatArray:
        """Covariance (6, 6) of the tip's position [m] and rotation vector [rad] in base_frame.

        To first order; zero where nothing is uncertain.

        Raises:
            ConfigError: if the model has no derivative by something that is uncertain.
        """
        check_class('uncertainty', uncertainty, Uncertainty)
        if not uncertainty.is_any:
            return np.zeros((6, 6))
        return self._statics.tip_covariance(self._own(backbone), uncertainty)

    def tendon_lengths(self, backbone: Backbone) -> FloatArray:
        """Length of every tendon from the base to its anchorage [m], of `Arm.tension_shape`.

        For a single solution of this solver.

        Raises:
            ConfigError: if ``backbone`` is that of a batch.
        """
        found = self._own(backbone)
        return self._statics.tendon_lengths(found).reshape(self.arm.tension_shape)

    def contacts(self, backbone: Backbone) -> Contacts:
        """How obstacles act on the arm in a single solution of this solver.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
        """
        return self._statics.contacts(self._own(backbone))

    def local_tensions(self, backbone: Backbone) -> FloatArray:
        """Tension of every tendon at every node of the model [N], (tendons, nodes).

        For a single solution of this solver.

        Raises:
            ConfigError: if ``backbone`` is that of a batch.
        """
        return self._statics.local_tensions(self._own(backbone)).T

    def displacements(self, backbone: Backbone) -> FloatArray:
        """Length that the winch of each tendon has reeled in [m], of `Arm.tension_shape`.

        For a single solution of this solver; of a slack tendon the least that makes it taut.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
        """
        found = self._statics.displacements(self._own(backbone))
        return found.reshape(self.arm.tension_shape)

    @property
    def rest_lengths(self) -> FloatArray:
        """Length of every tendon of the unloaded arm [m], of `Arm.tension_shape`."""
        return self._statics.rest_lengths.reshape(self.arm.tension_shape)

    @functools.cached_property
    def largest_displacements(self) -> FloatArray:
        """Lengths that no winch can have reeled in [m], (tendons,).

        That of the tendon in the unloaded arm, and what it stretches under `LoadLimits.force`.
        """
        rest = self.rest_lengths.ravel()
        return rest + self._limits.force * self.arm.tendon_compliance(rest)

    def check_displacements(self, displacements: FloatArray, tendons: Sequence[int]) -> None:
        """Check ``displacements`` [m], one for each of the ``tendons`` by their numbers.

        Raises:
            TensionError: if one is longer than what there is to reel in.
        """
        most = self.largest_displacements[list(tendons)]
        beyond = np.flatnonzero(displacements >= most)
        if beyond.size:
            first = beyond[0]
            number = tendons[first]
            length = self.rest_lengths.ravel()[number]
            stretch = most[first] - length
            more = f' and {stretch:.4g} m that it stretches at most' if stretch else ''
            raise TensionError(
                f'displacement of {self.arm.tendon_names[number]} is {displacements[first]:.6g} '
                f'm, expected less than there is to reel in: {length:.4g} m in the unloaded '
                f'arm{more}'
            )

    def displacements_by_offset(self, backbone: Backbone) -> FloatArray:
        """Derivatives of `displacements` by tendons' distances from the midline, (tendons,) [-].

        By the unloaded lengths alone, and what these stretch by at given tensions: only of tendons
        that wind about the midline.
        """
        return self._statics.displacements_by_offset(self._own(backbone))

    def wind(
        self,
        displacements: FloatArray,
        driven: NDArray[np.bool_],
        tensions: FloatArray,
        tip_wrench: ArrayLike | None,
        start: Backbone | None,
    ) -> tuple[Backbone, FloatArray]:
        """Shape with ``displacements`` (J,) [m] of the ``driven`` tendons, and those of all.

        With ``tensions`` (J,) [N] of the others. Tendons with friction slide from those in
        ``start``. Other arguments and errors are those of `solve`.
        """
        checked, wrench = self._given(tensions.reshape(self.arm.tension_shape), tip_wrench)
        known = None if start is None else self._own(start)
        history = None if start is None else start.point_tensions
        before = None if history is None else history.T
        wanted = Condition(checked.ravel(), wrench, 1.0, before, displacements, driven)
        shape, reeled = self._statics.wind(wanted, known, self._allowance.spending())
        pulled = shape.equilibrium.state.condition.tensions.reshape(self.arm.tension_shape)
        self._limits.check_tensions(pulled)
        return self._of_one(pulled, wrench, shape), reeled

    def _own(self, backbone: Backbone) -> Equilibrium:
        """The equilibrium of a single solution of this solver.

        Raises:
            ConfigError: if ``backbone`` is that of a batch or of another solver.
        """
        check_class('backbone', backbone, Backbone)
        found = backbone.equilibrium
        if found is None:
            raise ConfigError('the backbone is that of a batch, expected a single solution')
        is_alike = backbone.model == self.model and backbone.s.size == self.grid.s.size
        if not (is_alike and self._statics.has_solved(found)):
            raise ConfigError('the backbone was solved by another solver')
        return found


def solve(
    arm: Arm,
    tensions: ArrayLike,
    model: str = DEFAULT_MODEL,
    stations: int = DEFAULT_STATIONS,
    base: Pose = Pose(),
) -> Backbone:
    """Shape of ``arm`` under ``tensions`` in one call; see `Solver`. Solvers are cached."""
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
    # For one shape machine code takes longer to load than it saves.
    return Solver(arm, model, stations, base, compiled=False)
