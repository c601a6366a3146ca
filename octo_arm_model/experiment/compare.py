"""Errors of the model against measured midlines, step by step, as in the paper's Table 1."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.config import Config
from octo_arm_model.config.files import STATION_COLUMNS, CsvFiles, station_rows, tension_columns
from octo_arm_model.experiment.camera import undetermined
from octo_arm_model.experiment.fit import fit_alignment, shape_residuals
from octo_arm_model.experiment.midlines import Curve, MidlineErrors, midline_errors
from octo_arm_model.experiment.motion import TensionTrajectory, moving_shapes
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.experiment.steady_windows import CHANGE, LOADING, UNLOADING, directions
from octo_arm_model.experiment.uncertainty import misfit_of, noise_of
from octo_arm_model.experiment.unknowns import FINE_STATIONS
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import Solver

# A tip is at rest if it moves by less than this part of the length per relative change of E.
_STILL = 0.01
_TIP = 1e-3  # distance over the length within which a marker counts as at the tip


@dataclass(frozen=True)
class StepComparison:
    """One step: the measurement, the solution and their distance."""

    number: int  #: number of the step, from 1
    shape: MeasuredShape
    measured: FloatArray  #: measured midline in base_frame (m, 3) [m]
    backbone: Backbone  #: the solution of the model
    errors: MidlineErrors  #: distances between the two
    #: measured points minus those of the model that they are paired with, (m, 3) [m]
    away: FloatArray
    direction: str  #: side from which its tensions were reached, of `steady_windows.directions`
    #: signed error of the tip along its path as tensions rise, > 0 if the arm bends farther than
    #: the model [m]; NaN if no tendon is pulled, the tip was not measured, friction leaves the
    #: direction open, or the arm moves
    bend: float

    @property
    def s(self) -> FloatArray:
        """Arc coordinates of the model's points that the measured ones are paired with [m]."""
        if self.shape.s is not None:
            return self.shape.s
        model = Curve(self.backbone.position)
        at = model.fractions(self.measured) * model.lengths[-1]
        return np.interp(at, model.lengths, self.backbone.s)


@dataclass(frozen=True)
class ModelComparison:
    """All steps of one model."""

    model: str  #: name of the model
    length: float  #: length of the arm [m]
    alignment: Pose  #: transform camera to base
    steps: tuple[StepComparison, ...]  #: the steps with a solution
    refused: tuple[str, ...]  #: errors of the steps without one
    notes: tuple[str, ...]  #: remarks on a fitted alignment, and on loading and unloading
    moves: bool = False  #: whether steps are moments of a motion

    def percent(self, name: str) -> FloatArray:
        """Return the errors ``name`` of all steps in per cent of the length; NaN if unknown."""
        values = (getattr(step.errors, name) for step in self.steps)
        return np.array([100.0 * value / self.length for value in values])

    @property
    def bend_percent(self) -> FloatArray:
        """The signed errors `StepComparison.bend` in per cent of the length."""
        return np.array([100.0 * step.bend / self.length for step in self.steps])


def compare(
    shapes: Sequence[MeasuredShape],
    parameters: Mapping[str, Any],
    model: str,
    alignment: Pose | None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    trajectory: TensionTrajectory | None = None,
) -> ModelComparison:
    """Compare ``model`` of the arm of ``parameters`` with measured ``shapes``.

    Without ``alignment`` one is fitted for all steps together: it removes the part of the model's
    error that a rigid motion of the camera explains. With a ``trajectory`` of tensions the arm
    moves, and steps are moments of the motion.

    Raises:
        SolveError: if the model has no solution for any step.
        MeasurementError: if an alignment cannot be fitted, or midlines do not begin near the
            base.
    """
    config = Config.from_parameters(parameters)
    solver = config.solver(model, max(config.stations, FINE_STATIONS))
    if trajectory is None:
        answered, refused = _equilibria(solver, shapes, progress)
    else:
        dynamics = config.dynamics(max(config.stations, FINE_STATIONS))
        moving_backbones, reason = moving_shapes(dynamics, trajectory, shapes, progress)
        answered = list(zip(itertools.count(1), shapes, moving_backbones))
        refused = [f'step {len(answered) + 1} and later: {reason}'] if reason else []
    if not answered:
        raise SolveError(f'{model} has no answer for any step; {refused[0]}')
    is_fitted, length, steps = alignment is None, solver.arm.length, []
    if alignment is None:
        alignment = fit_alignment([shape for _, shape, _ in answered], parameters, model)
    branches = directions(np.array([shape.window.tensions for shape in shapes]))
    for number, shape, backbone in answered:
        measured, curve = alignment.to_base(shape.points), Curve(backbone.position)
        away = shape_residuals(shape, measured, backbone, curve)
        if shape.s is None:
            curve.fractions(measured, check=True)
            errors = midline_errors(measured, curve)
        else:
            distance = np.linalg.norm(away, axis=1)
            tip = float(distance[-1]) if shape.s[-1] >= (1.0 - _TIP) * length else math.nan
            errors = MidlineErrors(tip, float(distance.mean()), float(distance.max()))
        bend = math.nan
        if math.isfinite(errors.tip) and trajectory is None:
            bend = _bend(solver, backbone, measured[-1])
        of_both = measured, backbone, errors, away
        steps.append(StepComparison(number, shape, *of_both, branches[number - 1], bend))
    notes: list[str] = []
    if is_fitted:
        notes.append(
            'the alignment is fitted: it removes the error that a motion of the camera explains'
        )
        points = np.concatenate([step.shape.points for step in steps])
        notes += undetermined(points, misfit_of([step.away for step in steps], length).rms)
    if trajectory is None:
        notes += _branch_remarks(steps, length)
    ends = tuple(steps), tuple(refused), tuple(notes)
    return ModelComparison(solver.model, length, alignment, *ends, trajectory is not None)


def _equilibria(
    solver: Solver, shapes: Sequence[MeasuredShape], progress: Callable[[int, int], None]
) -> tuple[list[tuple[int, MeasuredShape, Backbone]], list[str]]:
    """Solve all steps; return number, measurement and shape of each, and errors of the others."""
    answered: list[tuple[int, MeasuredShape, Backbone]] = []
    refused: list[str] = []
    last: Backbone | None = None  # where tendons with friction continue to slide from
    for number, shape in enumerate(shapes, start=1):
        progress(number - 1, len(shapes))
        tensions = shape.window.tensions.reshape(solver.arm.tension_shape)
        try:
            last = solver.follow(tensions, last if solver.arm.friction else None)
            answered.append((number, shape, last))
        except SolveError as error:
            refused.append(f'step {number}: {error}')
    return answered, refused


def _branch_remarks(steps: Sequence[StepComparison], length: float) -> list[str]:
    """Return remarks on friction: the difference of errors between loading and unloading.

    There are none if these share no tensions, or differ by at most three times the noise of the
    camera, for an arm of this ``length`` [m].
    """
    branch = np.array([step.direction for step in steps])
    if UNLOADING not in branch:
        return [
            'no step was reached by unloading: friction, or load cells of a wrong scale, would '
            'change all tensions by one factor, which these data cannot show and no interval '
            'contains'
        ]
    at, off = (np.array(v) for v in zip(*((step.shape.tension, step.bend) for step in steps)))
    up, down = (np.isfinite(off) & (branch == name) for name in (LOADING, UNLOADING))
    if up.sum() < 2:
        return []
    order = np.argsort(at[up], kind='stable')
    rising = at[up][order]
    shared = down & (at >= rising[0] * (1.0 - CHANGE)) & (at <= rising[-1] * (1.0 + CHANGE))
    if not shared.any():
        return []
    each = np.interp(at[shared], rising, off[up][order]) - off[shared]
    apart = float(each.mean())
    # Friction grows with tension, so that differences scatter more than the noise.
    scatter = each.std(ddof=1) if len(each) > 1 else 0.0
    noise = noise_of([step.shape for step in steps]) / 3.0**0.5  # of a coordinate
    if abs(apart) <= max(3.0 * np.sqrt(2.0) * noise, 2.0 * scatter) / np.sqrt(len(each)):
        return []
    return [
        f'loading and unloading differ by more than the noise: at the same tensions (on average '
        f'{at[shared].mean():.3g} N) the tip is {abs(apart) * 1e3:.2f} mm '
        f'({100.0 * abs(apart) / length:.2f} % of the length) '
        f'{"less" if apart < 0.0 else "farther"} bent while loading, as '
        f'{"friction or creep" if apart < 0.0 else "no friction"} does'
    ]


def _bend(solver: Solver, backbone: Backbone, tip: FloatArray) -> float:
    """Return `StepComparison.bend` for a measured ``tip`` in base_frame (3,) [m]."""
    try:
        # With friction, the direction that a softer arm moves in is that of a pull from slack.
        pulled = solver.solve(backbone.tensions) if solver.arm.friction else backbone
        softer = -solver.sensitivity(pulled).by_youngs_modulus.tip[:3, 0]
    except SolveError:  # there is no derivative between sticking and sliding
        return math.nan
    size = float(np.linalg.norm(softer))
    if size <= _STILL * solver.arm.length:
        return math.nan
    return float((tip - backbone.position[-1]) @ softer) / size


MIDLINES = (
    'model',
    'step',
    's [m]',
    *(f'{name}_{axis} [m]' for name in ('measured', 'model', 'residual') for axis in 'xyz'),
)
STATIONS = ('model', 'step', *STATION_COLUMNS)


def write_tables(
    folder: Path, comparisons: Sequence[ModelComparison], tendons: Sequence[str]
) -> list[str]:
    """Write midlines.csv, stations.csv and tensions.csv into ``folder``; return their names.

    midlines.csv has a row for each measured point of each step: its position, that in the model,
    and the difference, in base_frame. stations.csv has the model's shape and strains.
    tensions.csv has the start and the end of each step, in the format of `octo-arm play`.

    Raises:
        OSError: if a file cannot be written.
    """

    def all_rows(rows_of: Callable[[StepComparison], list[list[float]]]) -> Iterator[list[Any]]:
        for comparison in comparisons:
            for step in comparison.steps:
                yield from ([comparison.model, step.number, *row] for row in rows_of(step))

    def points(step: StepComparison) -> list[list[float]]:
        model = step.measured - step.away
        return np.column_stack([step.s, step.measured, model, step.away]).tolist()

    windows = [step.shape.window for step in comparisons[0].steps]
    tensions = (
        [round(time - windows[0].start, 9), *window.tensions.tolist()]
        for window in windows
        for time in dict.fromkeys((window.start, window.stop))
    )
    tables: dict[str, tuple[Sequence[str], Iterator[list[Any]]]] = {
        'midlines.csv': (MIDLINES, all_rows(points)),
        'stations.csv': (STATIONS, all_rows(lambda step: station_rows(step.backbone))),
        'tensions.csv': (tension_columns(tendons), tensions),
    }
    with CsvFiles() as files:
        for name, (header, rows) in tables.items():
            writer = files.open(folder / name)
            writer.writerow(header)
            writer.writerows(rows)
    return list(tables)
