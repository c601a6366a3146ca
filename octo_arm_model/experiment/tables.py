"""Comparisons and estimates as tidy CSV files, units in their headers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.config.files import STATION_COLUMNS, CsvFiles, tension_columns
from octo_arm_model.estimation.state.prediction import ArmModel
from octo_arm_model.estimation.state.unknowns import State
from octo_arm_model.experiment.compare import ModelComparison
from octo_arm_model.experiment.estimates import Moment, TimedEstimate
from octo_arm_model.experiment.fit import shape_residuals

_AXES = ('x', 'y', 'z')
MIDLINES = (
    'model', 'step', 's [m]',
    *(f'{name}_{axis} [m]' for name in ('measured', 'model', 'residual') for axis in _AXES),
)  # fmt: skip
STATIONS = ('model', 'step', *STATION_COLUMNS)


def write_tables(
    folder: Path, comparisons: Sequence[ModelComparison], tendons: Sequence[str]
) -> list[str]:
    """Write midlines.csv, stations.csv and tensions.csv into ``folder``; returns their names.

    midlines.csv has a row for each measured point of each step: where it was, where the model has
    it, and the difference, in base_frame. stations.csv has the model's shape and strains.
    tensions.csv has the start and the end of each step, as `octo-arm play` reads it.

    Raises:
        OSError: if a file cannot be written.
    """
    tables: dict[str, tuple[Sequence[str], Iterator[list[Any]]]] = {
        'midlines.csv': (MIDLINES, _midlines(comparisons)),
        'stations.csv': (STATIONS, _stations(comparisons)),
        'tensions.csv': (tension_columns(tendons), _tensions(comparisons[0])),
    }
    with CsvFiles() as files:
        for name, (header, rows) in tables.items():
            writer = files.open(folder / name)
            writer.writerow(header)
            writer.writerows(rows)
    return list(tables)


def _midlines(comparisons: Sequence[ModelComparison]) -> Iterator[list[Any]]:
    for comparison in comparisons:
        for step in comparison.steps:
            away = shape_residuals(step.shape, step.measured, step.backbone)
            numbers = np.column_stack([step.s, step.measured, step.measured - away, away])
            for row in numbers.tolist():
                yield [comparison.model, step.number, *row]


def _stations(comparisons: Sequence[ModelComparison]) -> Iterator[list[Any]]:
    for comparison in comparisons:
        for step in comparison.steps:
            one = step.backbone
            columns = [one.s, one.position, one.tau, one.xi, one.k, one.q]
            for row in np.column_stack(columns).tolist():
                yield [comparison.model, step.number, *row]


def _tensions(comparison: ModelComparison) -> Iterator[list[float]]:
    """Start and end of each step, the first at time 0."""
    origin = comparison.steps[0].shape.window.start
    for step in comparison.steps:
        window = step.shape.window
        for time in (window.start, window.stop):
            yield [round(time - origin, 9), *window.tensions.tolist()]


_AXES = ('x', 'y', 'z')
_WRENCH = [*(f'force {axis} [N]' for axis in _AXES), *(f'moment {axis} [N m]' for axis in _AXES)]
_TIP = [f'tip {axis} [m]' for axis in _AXES]
INNOVATIONS = (
    'time [s]', 'measurement', 'component', 'innovation', 'stddev', 'normalised square',
    'accepted',
)  # fmt: skip


class EstimateTables(CsvFiles):
    """Writes estimate.csv, a row for each time, and innovations.csv, a row for each number."""

    def __init__(self, folder: Path, models: Mapping[str, ArmModel]) -> None:
        """Write into ``folder`` what is estimated by ``models``.

        Raises:
            OSError: if a file cannot be written.
        """
        super().__init__()
        self._hypotheses = list(models) if len(models) > 1 else []
        self._estimates = self.open(folder / 'estimate.csv')
        self._innovations = self.open(folder / 'innovations.csv')
        self._innovations.writerow(INNOVATIONS)
        state = next(iter(models.values())).state
        others = [state.names[number] for number in _besides_contact(state)]
        values = [*_TIP, *_WRENCH, *(f'{name}{_unit(name)}' for name in others)]
        deviations = [name.replace(' [', ' stddev [') for name in values]
        self._estimates.writerow([
            'time [s]', 'stamp [ns]', 'contact', 'contact s [m]', *values, *deviations,
            'normalised square', 'numbers', 'refused',
            *(f'probability {name}' for name in self._hypotheses),
        ])  # fmt: skip

    def write(self, moment: Moment, one: TimedEstimate) -> None:
        """Write ``one`` estimate.

        Raises:
            OSError: if it cannot be written.
        """
        time, estimate = round(moment.time, 9), one.estimate
        at = _besides_contact(estimate.state)
        deviations = np.sqrt(np.diag(estimate.covariance))[at]
        self._estimates.writerow([
            time, one.stamp_ns, moment.hypothesis, moment.s,
            *moment.tip.tolist(), *moment.wrench.tolist(), *estimate.mean[at].tolist(),
            *moment.tip_stddev.tolist(), *moment.wrench_stddev.tolist(), *deviations.tolist(),
            *estimate.normalised_square,
            ' and '.join(part.name for part in one.innovations if not part.is_accepted),
            *(one.probabilities[name] for name in self._hypotheses),
        ])  # fmt: skip
        for part in one.innovations:
            stddev = np.sqrt(np.diag(part.covariance))
            for number, (value, size) in enumerate(zip(part.value, stddev, strict=True)):
                self._innovations.writerow([
                    time, part.name, number, float(value), float(size), part.normalised_square,
                    int(part.is_accepted),
                ])  # fmt: skip


def _besides_contact(state: State) -> list[int]:
    """Components of a ``state`` but those of the contact, which has columns of its own."""
    others = slice(state.point_forces.start + 3, state.point_forces.stop)
    parts = state.tension, state.tension_bias, others, state.log_modulus, state.tension_loss
    return [number for part in parts for number in range(state.size)[part]]


def _unit(name: str) -> str:
    return ' [-]' if name.startswith(('log_modulus', 'tension_loss')) else ' [N]'
