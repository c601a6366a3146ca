"""An arm that moves: its shapes along the tensions, and the residuals of a fit to them."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.fit import Problem, SolvedSteps, followed
from octo_arm_model.experiment.midlines import Curve
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.experiment.shape_changes import ShapeChange
from octo_arm_model.experiment.unknowns import FINE_STATIONS, Unknowns
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.motion import Dynamics
from octo_arm_model.rod.stations import interpolated
from octo_arm_model.simulation.moving_arm import DrivenMotion

_SWINGS = 1e-3  # least distance of a swing from the equilibria, over the length


class TensionTrajectory(NamedTuple):
    """Tensions over time, along which an arm moves."""

    time: FloatArray  #: ascending times (n,) [s]
    tensions: FloatArray  #: tensions at these times (n, tendons) [N]
    step: float  #: step of the integration [s]


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

    def check_swing(self) -> None:
        """Check that the arm of the start swings; SolveError if it is always in equilibrium."""
        start, least = self.unknowns.start, _SWINGS * self.length
        still = followed(self.unknowns.solver(start), self.unknowns.readings.tensions)
        pairs = zip(self.backbones(start), still, strict=True)
        swing = max(float(np.linalg.norm(moving.tip - one.tip)) for moving, one in pairs)
        if swing < least:
            raise SolveError(
                f'the arm does not swing: it is within {1e3 * swing:.2g} mm of its equilibria all '
                f'the time, expected {1e3 * least:.2g} mm or more somewhere'
            )
