"""An arm that moves: its shapes along the tensions, and damping, drag and added mass from them.

The moving model is fitted to every frame by least squares as in `fit`. **Intervals** come from
leaving out one of a few stretches of time after the other, to first order: errors of neighbouring
frames may be alike, but those of different stretches are taken to be independent.
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
from octo_arm_model.experiment.shape_changes import ShapeChange
from octo_arm_model.experiment.unknowns import FINE_STATIONS, OF_WATER, Readings, Unknowns
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.motion import Dynamics
from octo_arm_model.rod.stations import interpolated
from octo_arm_model.simulation.moving_arm import DrivenMotion

_SWINGS = 1e-3  # least distance of a swing from the equilibria, over the length
_STRETCHES = 10  # largest number of stretches of time
_FEWEST = 4  # frames of a stretch
_ALIKE = 0.7  # correlation of neighbouring residuals above which the model is wrong


class TensionTrajectory(NamedTuple):
    """Tensions over time, along which an arm moves.

    Attributes:
        time: ascending times (n,) [s].
        tensions: tensions at these times (n, tendons) [N].
        step: step of the integration [s].
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
    """Solve the motion along a ``trajectory`` up to the time of each of ``shapes``, in order.

    Returns:
        The shapes until the motion fails, and the reason of the failure; '' if it does not fail.
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
    """The residuals of an arm that moves along a ``trajectory``; each step is a moment."""

    def __init__(
        self, shapes: Sequence[MeasuredShape], unknowns: Unknowns, trajectory: TensionTrajectory
    ) -> None:
        """Set up the fit of ``unknowns`` to ``shapes`` of the motion along ``trajectory``."""
        super().__init__(shapes, unknowns)
        self._trajectory = trajectory

    def solve_steps(self, x: FloatArray) -> SolvedSteps:
        """Solve the motion, and return its shapes at the times of the measured ones."""
        config = Config.from_parameters(self.unknowns.parameters(x))
        dynamics = config.dynamics(max(config.stations, FINE_STATIONS))
        found, reason = moving_shapes(dynamics, self._trajectory, self.shapes)
        if reason:
            raise SolveError(reason)
        curves = tuple(Curve(one.position) for one in found)
        return SolvedSteps(dynamics.solver, tuple(found), curves)

    def changes(self, x: FloatArray) -> dict[str, list[ShapeChange]]:
        """Return nothing: a motion has no derivatives but differences."""
        return {}


def identify_motion(
    shapes: Sequence[MeasuredShape],
    parameters: Mapping[str, Any],
    fits: Sequence[str],
    alignment: Alignment,
    trajectory: TensionTrajectory,
    progress: Callable[[int, int], None] = lambda done, total: None,
    loss: str = uncertainty.AUTO,
) -> Identification:
    """Fit the parameters ``fits`` to ``shapes`` of an arm that moves along a ``trajectory``.

    A parameter keeps its value if the data leave it open, or determine it less than its `scale`.

    Raises:
        ConfigError: if this motion does not depend on one of ``fits``.
        SolveError: if the arm does not swing, or the model has no solution.
    """
    readings, loss = Readings.of(shapes), SOFT_L1 if loss == uncertainty.AUTO else loss
    wet = [name for name in fits if name in OF_WATER]
    if wet and not Config.from_parameters(parameters).loads.fluid_density:
        raise ConfigError(f'{wet[0]} is of the water, and loads.fluid_density is 0')

    def without(left_out: Collection[str]) -> MotionProblem:
        unknowns = Unknowns(parameters, 'exact', fits, readings, alignment, left_out, moves=True)
        progress(len(left_out), len(unknowns.unknowns) + len(left_out))
        return MotionProblem(shapes, unknowns, trajectory)

    problem = without(())
    least = _SWINGS * problem.length
    start = problem.unknowns.start
    still = followed(problem.unknowns.solver(start), readings.tensions)
    pairs = zip(problem.backbones(start), still, strict=True)
    swing = max(float(np.linalg.norm(moving.tip - one.tip)) for moving, one in pairs)
    if swing < least:
        raise SolveError(
            f'the arm does not swing: it is within {1e3 * swing:.2g} mm of its equilibria all the '
            f'time, expected {1e3 * least:.2g} mm or more somewhere'
        )
    result = unfitted(problem, loss, parameters, alignment)
    # The folds are stretches of time, as numbers of frames; none has too few frames.
    number = min(_STRETCHES, len(shapes) // _FEWEST)
    frames = np.arange(len(shapes))
    folds = [part.tolist() for part in np.array_split(frames, number)] if number else []
    found, left_out = uncertainty.determined(without, lambda one: _fit(one, loss, folds))
    if found is not None:
        fitted, x, held_back = found
        away = fitted.residuals(x)
        estimates = uncertainty.estimates_of(fitted, x, held_back, folds)
        correlations = uncertainty.correlations_of(fitted, x)
        notes = [*at_ends(fitted.unknowns, x), *strong_pairs(correlations, fitted.unknowns)]
        notes.append(f'intervals come from leaving out one of {len(folds)} stretches of time')
        tips = np.array([part[-1] for part in away])
        if (tips[1:] * tips[:-1]).sum() > _ALIKE * max((tips * tips).sum(), 1e-300):
            notes.append(
                'residuals go on from frame to frame, as noise does not: the model does not '
                'explain all of the motion, which biases the estimates beyond their intervals'
            )
        result = replace(
            result,
            parameters=fitted.unknowns.parameters(x),
            correlations=correlations,
            notes=tuple(notes),
            estimates={**result.estimates, **estimates},
            after=uncertainty.misfit_of(away, fitted.length),
        )
    progress(len(result.estimates), len(result.estimates))
    return replace(result, undetermined=left_out)


def _fit(
    problem: MotionProblem, loss: str, folds: Sequence[Sequence[int]]
) -> tuple[MotionProblem, FloatArray, FloatArray] | uncertainty.OpenDirection:
    """Return the problem, its fit (n,), and those without each of ``folds`` (folds, n).

    Or return the unknown to leave out, if the motion hardly determines it.
    """
    unknowns = problem.unknowns.unknowns
    x, scale = problem.solve(loss)
    without, _ = problem.without(x, scale, folds)
    scales = np.array([unknown.scale for unknown in unknowns])
    deviation = np.sqrt(((without - x) ** 2).sum(axis=0))  # of the jackknife, but for (n - 1) / n
    worst = int((deviation / scales).argmax())
    if deviation[worst] <= scales[worst]:
        return problem, x, without
    one = unknowns[worst]
    to = one.stddev(float(x[worst]), float(deviation[worst]))
    return uncertainty.OpenDirection(one.name, f'the motion tells it only to {to:.2g} {one.unit}')
