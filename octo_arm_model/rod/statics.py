"""What every model of the statics gives: shapes at stations, lengths of tendons, derivatives."""

from __future__ import annotations

import abc
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from octo_arm_model.arm.arm import Arm
from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray, IntArray
from octo_arm_model.arm.limits import Allowance, Spending
from octo_arm_model.arm.loads import Loads
from octo_arm_model.rod.contact import NONE, Contacts
from octo_arm_model.rod.elements import LEVELS
from octo_arm_model.rod.equilibrium import Condition, Equilibrium, Problem, Several
from octo_arm_model.rod.sensitivity import Change, Sensitivity, Uncertainty
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
    def solve(
        self, tensions: FloatArray, tip_wrench: FloatArray, start: Equilibrium | None,
        before: FloatArray | None, spending: Spending,
    ) -> Shape:  # fmt: skip
        """Under ``tensions`` (J,) [N] and a ``tip_wrench`` (6,) [N, N m].

        ``start`` is an equilibrium to follow the arm from, if the model does, and ``before`` the
        tensions (N, J) [N] that tendons with friction slide from; None for slack ones.

        Raises:
            SolveError: if there is no trustworthy answer.
        """

    def solve_many(
        self, tensions: FloatArray, tip_wrenches: FloatArray, start: Equilibrium | None,
        before: FloatArray | None,
    ) -> Shapes:  # fmt: skip
        """As `solve`, of several ``tensions`` (A, J) and ``tip_wrenches`` (A, 6).

        Raises:
            SolveError: if one has no trustworthy answer; the message says which.
        """
        arms, stations = len(tensions), self._setup.s.size
        shapes = Shapes(
            np.empty((arms, stations, 3)), np.empty((arms, stations, 4)),
            np.empty((4, arms, stations)),
            np.empty((arms, stations, tensions.shape[1])) if self._setup.arm.friction else None,
            np.empty(arms), np.empty(arms, np.int64),
        )  # fmt: skip
        arm = self._setup.arm
        is_simple = not (arm.friction or arm.sheath_stiffness or arm.discs.s)
        for first in range(0, arms, AT_ONCE):
            left = np.arange(first, min(first + AT_ONCE, arms))
            for level in range(_LEVELS_AT_ONCE if is_simple else 0):
                if left.size and not self._loaded(tip_wrenches[left]):
                    left = left[~self._solve_at_once(level, tensions[left], left, shapes)]
            for number in left.tolist():
                spending = self._setup.allowance.spending()
                try:
                    one = self.solve(
                        tensions[number], tip_wrenches[number], start, before, spending
                    )
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
        self, several: Several, z: FloatArray, places: Places, numbers: IntArray, shapes: Shapes
    ) -> NDArray[np.bool_]:
        """Poses of arms of twists ``z`` (A n, m) into ``shapes``; which are resolved, (A,)."""
        position, quaternion, error = several.poses(z, places)
        position += self._setup.base[0]
        shapes.position[numbers], shapes.quaternion[numbers] = position, quaternion
        return error <= allowed_between(self._setup.accuracy)

    @abc.abstractmethod
    def wind(
        self, displacements: FloatArray, driven: NDArray[np.bool_], condition: Condition,
        start: Equilibrium | None, spending: Spending,
    ) -> tuple[Shape, FloatArray]:  # fmt: skip
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
        return found.state.acting.tensions * self.problem(found.level).tables.reach

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
        """What winches have reeled in in a solution [m], see `Reeling.displacement`, (J,)."""
        return self._winches.displacements(found)

    def displacements_by_offset(self, found: Equilibrium) -> FloatArray:
        """See `Solver.displacements_by_offset`."""
        problem = self.problem(found.level)
        tables, weights = problem.tables, problem.elements.weights
        outwards = outward_paths(self._setup.arm, tables, problem.elements.s)
        rates = problem.unloaded_tendons.by_path(outwards).stretch
        integrals = weights @ (rates * found.state.acting.tensions)
        return np.asarray(weights @ rates + self._setup.arm.stretched(integrals))


def strains_of(z: FloatArray) -> FloatArray:
    """Strains tau, xi, k and q, (4, ..., n), of twists ``z`` (..., n, m)."""
    columns = z.transpose(-1, *range(z.ndim - 1))
    strains = np.empty((4, *z.shape[:-1]))
    np.divide(columns[:3], columns[3], out=strains[:3])
    np.subtract(columns[3], 1.0, out=strains[3])
    return strains
