"""The inverse: bounded tensions of least effort for a target shape, and the remaining error.

Optimisers of SciPy have analytic derivatives. Bounded least squares from several starts minimises
the error: a trust region inside the bounds finds a minimum, and one whose sides are the bounds
converges to it where tendons are slack. If the tensions that reach the target are not unique,
sequential quadratic programming then minimises the effort among them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import NoneType

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares, minimize

from octo_arm_model.analysis.targets import Stiffness, Target
from octo_arm_model.arm.errors import SolveError, TensionError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.validation import check_class, real_numbers, whole
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.checks import check_highest
from octo_arm_model.rod.sensitivity import Sensitivity
from octo_arm_model.rod.solver import Solver

# A target is reached if the error over the length of the arm is below this.
REACHED = 1e-6
_MET = 1e-10  # error over the length of the arm at which a search ends
_STARTS = 8
_NO_GRADIENT = np.finfo(float).eps  # the least that SciPy tells from 0
_STEPS = 40  # largest number of steps of each method in a local search
_INDEPENDENT = 1e-6  # singular values below this part of the largest one count as zero
_STIFFNESS_STEP = 1e-4  # step of a tension over its bound for the derivative of the stiffness


@dataclass(frozen=True)
class Inverse:
    """The tensions for a target, the shape under them and its error.

    Attributes:
        backbone: the shape with its ``tensions``.
        error: norm of the error of the `Target` [m].
        reached: whether the error is below a millionth of the length of the arm.
        stiffness: stiffness in the direction of the target stiffness [N/m]; None without one.
        iterations: number of solves.
    """

    backbone: Backbone
    error: float
    reached: bool
    stiffness: float | None
    iterations: int


def find_tensions(
    solver: Solver,
    target: Target,
    highest: ArrayLike,
    *,
    stiffness: Stiffness | None = None,
    start: ArrayLike | None = None,
    seed: int = 0,
    pause: Callable[[], None] | None = None,
) -> Inverse:
    """Return tensions from 0 to ``highest`` [N] that bring the arm to ``target``.

    They have the least effort, the sum of squares of tensions over their bounds. If the target is
    out of reach, the nearest shape is returned and ``reached`` is false. The search is local, from
    ``start`` (if given) and from tensions of half the tendons drawn with ``seed``, until the
    target is reached.

    Args:
        solver: solver of any model; a ``stiffness`` needs the model exact.
        target: the target.
        highest: largest tension [N] of all tendons, or of each as `Arm.tension_shape`.
        stiffness: target stiffness, reached by co-contraction.
        start: tensions at which the search starts [N].
        seed: seed of the random starts.
        pause: function that is called before every solve and every derivative.

    Raises:
        TensionError: if ``highest`` or ``start`` do not fit the arm.
        ArmDefinitionError: if another argument is of a wrong class, or ``seed`` is negative.
        SolveError: if the model has no solution for any of the tensions tried.
    """
    check_class('solver', solver, Solver)
    check_class('target', target, Target)
    check_class('stiffness', stiffness, Stiffness, NoneType)
    arm = solver.arm
    limit = check_highest(arm, highest)
    search = _Search(solver, target, limit, stiffness, pause or (lambda: None))
    generator, size = np.random.default_rng(whole('seed', seed)), (_STARTS, limit.size)
    # Searches from tensions in all tendons miss targets that few of them reach.
    drawn = generator.random(size) * (generator.random(size) < 0.5)
    starts = [0.05 * np.ones(limit.size), *drawn]
    if start is not None:
        given = real_numbers(start)
        if (
            given is None
            or given.size != limit.size
            or not ((given.ravel() >= 0.0) & (given.ravel() <= limit)).all()
        ):
            raise TensionError(
                f'start is {shown(start)}, expected tensions from 0 to {shown(highest)} [N]'
            )
        starts.insert(0, given.ravel() / limit)
    tolerance = REACHED * arm.length
    best: FloatArray | None = None
    for first in starts:
        try:
            minimum = search.approach(first)
        except SolveError:
            continue
        if best is None or search.distance(minimum) < search.distance(best):
            best = minimum
        if search.distance(best) <= tolerance:
            break
    if best is None:
        raise SolveError('the model has no answer for any of the tensions that were tried')
    if search.distance(best) <= tolerance:
        best = search.relax(best, tolerance)
    return search.result(best)


class _Search:
    """The error of a target and its Jacobian as functions of tensions over their bounds."""

    def __init__(
        self,
        solver: Solver,
        target: Target,
        limit: FloatArray,
        stiffness: Stiffness | None,
        pause: Callable[[], None],
    ) -> None:
        self._solver, self._target, self._limit = solver, target, limit
        self._stiffness, self._pause = stiffness, pause
        self._solved: tuple[bytes, Backbone, Sensitivity] | None = None
        # Solutions at local minima, as a loaded arm may not come back to them from elsewhere.
        self._cache: dict[bytes, tuple[Backbone, Sensitivity]] = {}
        self.iterations = 0

    def _evaluate(self, part: FloatArray) -> tuple[Backbone, Sensitivity]:
        key = part.tobytes()
        if key in self._cache:
            return self._cache[key]
        if self._solved is None or self._solved[0] != key:
            self._pause()
            tensions = np.clip(part, 0.0, 1.0) * self._limit
            shape = self._solver.arm.tension_shape
            last = None if self._solved is None else self._solved[1]
            backbone = self._solver.solve(tensions.reshape(shape), start=last)
            self.iterations += 1
            self._pause()  # with friction the derivatives take longer than the solve
            self._solved = key, backbone, self._solver.sensitivity(backbone)
        return self._solved[1:]

    def error(self, part: FloatArray) -> FloatArray:
        backbone, sensitivity = self._evaluate(part)
        error = self._target.error(backbone)
        if self._stiffness is None:
            return error
        # The logarithm of the ratio times the length of the arm is in metres like the rest.
        ratio = np.log(self._stiffness.of(sensitivity)) - np.log(self._stiffness.value)
        return np.append(error, ratio * self._solver.arm.length)

    def jacobian(self, part: FloatArray) -> FloatArray:
        backbone, sensitivity = self._evaluate(part)
        jacobian = self._target.jacobian(backbone, sensitivity.by_tension)
        if self._stiffness is not None:
            # The stiffness is analytic; its derivative is by finite differences.
            solved = self._solved
            logarithm = np.log(self._stiffness.of(sensitivity))
            row = np.empty(part.size)
            for j in range(part.size):
                moved = part.copy()
                moved[j] += _STIFFNESS_STEP if part[j] < 0.5 else -_STIFFNESS_STEP
                changed = np.log(self._stiffness.of(self._evaluate(moved)[1]))
                row[j] = (changed - logarithm) / (moved[j] - part[j]) / self._limit[j]
            jacobian = np.vstack([jacobian, row * self._solver.arm.length])
            self._solved = solved
        return jacobian * self._limit

    def distance(self, part: FloatArray) -> float:
        return float(np.linalg.norm(self.error(part)))

    def approach(self, part: FloatArray) -> FloatArray:
        """Return the local minimum of the error within the bounds that follows from ``part``."""

        def error(part: FloatArray) -> FloatArray:
            residual = self.error(part)
            # A residual of 0 has no gradient, which ends both methods where the target is met.
            return residual * (np.linalg.norm(residual) > _MET * self._solver.arm.length)

        def jacobian(part: FloatArray) -> FloatArray:
            residual = error(part)
            return self.jacobian(part) if residual.any() else np.outer(residual, part)

        minimum = np.clip(part, 0.0, 1.0)
        # The first method is slow near bounds; the second one stays at those it meets early.
        for method, tolerance in (('trf', 1e-3), ('dogbox', 1e-12)):
            minimum = least_squares(
                error,
                minimum,
                jacobian,
                (0.0, 1.0),
                method,
                xtol=tolerance,
                ftol=tolerance,
                gtol=_NO_GRADIENT,
                max_nfev=_STEPS,
            ).x
        if not error(minimum).any():
            minimum = np.where(minimum > 1e-9, minimum, 0.0)  # the first method stays off bounds
        self._cache[minimum.tobytes()] = self._evaluate(minimum)
        return minimum

    def relax(self, part: FloatArray, tolerance: float) -> FloatArray:
        """Return tensions of least effort for the same target, or ``part`` if none have less."""
        scale = 1.0 / self._solver.arm.length
        # SLSQP needs independent constraints, as many as the rank of the Jacobian.
        directions, sizes, _ = np.linalg.svd(self.jacobian(part), full_matrices=False)
        rank = np.count_nonzero(sizes > _INDEPENDENT * sizes.max(initial=0.0))
        if rank >= part.size:
            return part  # The tensions are locally unique.
        basis = scale * directions[:, :rank].T
        try:
            result = minimize(
                lambda x: 0.5 * float(x @ x),
                part,
                jac=lambda x: x,
                method='SLSQP',
                bounds=[(0.0, 1.0)] * part.size,
                constraints={
                    'type': 'eq',
                    'fun': lambda x: basis @ self.error(x),
                    'jac': lambda x: basis @ self.jacobian(x),
                },
                options={'maxiter': 60, 'ftol': 1e-10},
            )
            better = np.clip(result.x, 0.0, 1.0)
            polished = self.approach(better) if self.distance(better) > tolerance else better
            if self.distance(polished) <= tolerance and polished @ polished < part @ part:
                return polished
        except SolveError:
            pass
        return part

    def result(self, part: FloatArray) -> Inverse:
        error = self.distance(part)
        backbone, sensitivity = self._evaluate(part)
        stiffness = None if self._stiffness is None else self._stiffness.of(sensitivity)
        target_error = float(np.linalg.norm(self._target.error(backbone)))
        reached = error <= REACHED * self._solver.arm.length
        return Inverse(backbone, target_error, reached, stiffness, self.iterations)
