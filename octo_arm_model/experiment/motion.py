"""An arm that moves: its shapes along the tensions, and damping, drag and added mass from them.

Least squares as in `fit`, of the moving model against every frame. **Intervals** come from leaving
out one of a few stretches of time, one after the other, to first order: errors of neighbouring
frames may be alike, those of different stretches are taken to be independent.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from octo_arm_model.arm.errors import ConfigError, SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.experiment import uncertainty
from octo_arm_model.experiment.camera import Alignment
from octo_arm_model.experiment.fit import SOFT_L1, Problem, SolvedSteps, followed
from octo_arm_model.experiment.identification import (
    Identification,
    at_ends,
    strong_pairs,
    unfitted,
)
from octo_arm_model.experiment.midlines import Curve
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.experiment.unknowns import FINE_STATIONS, OF_WATER, Readings, Unknowns
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.motion import Dynamics
from octo_arm_model.rod.stations import interpolated
from octo_arm_model.simulation.moving_arm import DrivenMotion

_SWINGS = 1e-3  # of the length: least distance of a swing from the equilibria
_STRETCHES = 10  # of time, of at least so many frames
_FEWEST = 4
_ALIKE = 0.7  # correlation of neighbouring residuals of a model that is wrong


class TensionTrajectory(NamedTuple):
    """Tensions over time, along which an arm moves.

    Attributes:
        time: ascending (n,) [s].
        tensions: (n, tendons) [N].
        step: of the integration [s].
    """

    time: FloatArray
    tensions: FloatArray
    step: float


def moving_shapes(
    dynamics: Dynamics,
    trajectory: TensionTrajectory,
    shapes: Sequence[MeasuredShape],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[Backbone], str]:
    """The arm along a ``trajectory`` at the time of each of ``shapes``, in order of time.

    Returns:
        The shapes up to where the motion ends, and why it does; '' where it does not.
    """
    motion, by_stamp, reason = DrivenMotion(dynamics, trajectory.step), dict[int, Backbone](), ''
    wanted = [round(1e9 * shape.window.start) for shape in shapes]
    stamps = sorted({*wanted, *np.round(1e9 * trajectory.time).astype(int).tolist()})
    rows = interpolated(1e-9 * np.array(stamps), trajectory.time, trajectory.tensions)
    due = set(wanted)
    try:
        for stamp, row in zip(stamps, rows):
            motion.read(stamp, row.reshape(dynamics.solver.arm.tension_shape))
            if stamp in due:
                by_stamp[stamp] = dynamics.backbone(motion.state)
                progress(len(by_stamp), len(due))
            if len(by_stamp) == len(due):
                break
    except SolveError as error:
        reason = str(error)
    return [by_stamp[stamp] for stamp in wanted if stamp in by_stamp], reason


class MotionProblem(Problem):
    """Residuals of an arm that moves along a ``trajectory``, a step being a moment."""

    def __init__(
        self, shapes: Sequence[MeasuredShape], unknowns: Unknowns, trajectory: TensionTrajectory
    ) -> None:
        """Fit ``unknowns`` to ``shapes``."""
        super().__init__(shapes, unknowns)
        self._trajectory = trajectory

    def solve_steps(self, x: FloatArray) -> SolvedSteps:
        """See `Problem`."""
        config = Config.from_parameters(self.unknowns.parameters(x))
        dynamics = config.dynamics(max(config.stations, FINE_STATIONS))
        found, reason = moving_shapes(dynamics, self._trajectory, self.shapes)
        if reason:
            raise SolveError(reason)
        nothing = np.full(self.unknowns.readings.displacements.shape, np.nan)
        return SolvedSteps(tuple(found), tuple(Curve(one.position) for one in found), nothing)

    def swing(self) -> float:
        """Largest distance of the tip from where it would be in equilibrium [m]."""
        x = self.unknowns.start
        still = followed(self.unknowns.solver(x), self.unknowns.readings.tensions)
        return max(
            float(np.linalg.norm(self.backbone(x, step).tip - one.tip))
            for step, one in enumerate(still)
        )


def identify_motion(
    shapes: Sequence[MeasuredShape],
    parameters: Mapping[str, Any],
    fits: Sequence[str],
    alignment: Alignment,
    trajectory: TensionTrajectory,
    progress: Callable[[int, int], None] = lambda done, total: None,
    loss: str = uncertainty.AUTO,
) -> Identification:
    """Fit ``fits`` to ``shapes`` of an arm that moves along a ``trajectory``.

    What the data leave open, or tell only to more than the `Unknown.scale`, stays as it is.

    Raises:
        ConfigError: if one of ``fits`` does not show in this motion.
        SolveError: if the arm does not swing, or the model has no answer.
    """
    readings, loss = Readings.of(shapes), SOFT_L1 if loss == uncertainty.AUTO else loss
    wet = [name for name in fits if name in OF_WATER]
    if wet and not Config.from_parameters(parameters).loads.fluid_density:
        raise ConfigError(f'{wet[0]} is of the water, and loads.fluid_density is 0')

    def without(left_out: Collection[str]) -> MotionProblem:
        unknowns = Unknowns(parameters, 'exact', fits, readings, alignment, left_out, moves=True)
        progress(len(left_out), len(unknowns.unknowns) + len(left_out))
        return MotionProblem(shapes, unknowns, trajectory)

    problem, left_out = without(()), dict[str, str]()
    least = _SWINGS * problem.length
    if (swing := problem.swing()) < least:
        raise SolveError(
            f'the arm does not swing: it is within {1e3 * swing:.2g} mm of its equilibria all the '
            f'time, expected {1e3 * least:.2g} mm or more somewhere'
        )
    result = unfitted(problem, loss, parameters, alignment)
    found = uncertainty.determined(without, lambda problem: _fit(problem, loss), left_out)
    if found is not None:
        result = _fitted(result, found[0], *found[1])
    progress(len(result.estimates), len(result.estimates))
    return replace(result, undetermined=tuple(left_out.values()))


def _fit(
    problem: MotionProblem, loss: str
) -> tuple[FloatArray, FloatArray] | uncertainty.OpenDirection:
    """The fit (n,), those without a stretch of time (stretches, n), or what is to be left out."""
    unknowns = problem.unknowns
    x, scale = problem.solve(loss)
    without = _without_stretches(problem, x, scale)
    scales = np.array([unknown.scale for unknown in unknowns.unknowns])
    deviation = np.sqrt(((without - x) ** 2).sum(axis=0))  # of the jackknife, but for (n - 1) / n
    worst = int((deviation / scales).argmax())
    if deviation[worst] <= scales[worst]:
        return x, without
    one = unknowns.unknowns[worst]
    to = one.stddev(float(x[worst]), float(deviation[worst]))
    return uncertainty.OpenDirection(one.name, f'the motion tells it only to {to:.2g} {one.unit}')


def _stretches(count: int) -> list[list[int]]:
    """Numbers of ``count`` frames, by stretch of time; none of too few."""
    number = min(_STRETCHES, count // _FEWEST)
    return [part.tolist() for part in np.array_split(np.arange(count), number)] if number else []


def _without_stretches(problem: MotionProblem, x: FloatArray, scale: float | None) -> FloatArray:
    """Fits without one of the stretches of time, to first order from the fit ``x``."""
    normal, score = [], []
    for by, away in zip(problem.jacobian(x), problem.all_residuals(x), strict=True):
        squares = (away**2).sum(axis=1)
        weight = np.ones(len(away)) if scale is None else 1.0 / np.sqrt(1.0 + squares / scale**2)
        normal.append(np.einsum('pci,p,pcj->ij', by, weight, by))
        score.append(np.einsum('pci,p,pc->i', by, weight, away))
    total, found = np.sum(normal, axis=0), []
    for fold in _stretches(len(normal)):
        rest = total - np.sum([normal[frame] for frame in fold], axis=0)
        found.append(x + np.linalg.solve(rest, np.sum([score[frame] for frame in fold], axis=0)))
    return np.array(found).reshape(-1, x.size)


def _fitted(
    result: Identification, problem: MotionProblem, x: FloatArray, without: FloatArray
) -> Identification:
    jacobian, unknowns, folds = (
        problem.jacobian(x),
        problem.unknowns,
        _stretches(len(problem.shapes)),
    )
    freedom = uncertainty.freedom_of(jacobian, folds) if folds else np.ones(x.size)
    correlations = uncertainty.correlations_of(np.concatenate(jacobian))
    away = problem.all_residuals(x)
    notes = [*at_ends(unknowns, x), *strong_pairs(correlations, unknowns)]
    notes.append(f'intervals come from leaving out one of {len(folds)} stretches of time')
    tips = np.array([part[-1] for part in away])
    alike = float((tips[1:] * tips[:-1]).sum() / max((tips * tips).sum(), 1e-300))
    if alike > _ALIKE:
        notes.append(
            'residuals go on from frame to frame, as noise does not: the model does not explain '
            'all of the motion, which biases the estimates beyond their intervals'
        )
    return replace(
        result,
        parameters=unknowns.parameters(x),
        correlations=correlations,
        notes=tuple(notes),
        estimates={
            **result.estimates,
            **uncertainty.estimates_of(unknowns, x, without, freedom, 0.0 * x),
        },
        after=uncertainty.misfit_of(away, problem.length),
    )
