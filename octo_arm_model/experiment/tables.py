"""Comparisons as tidy CSV files, units in their headers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.config.files import STATION_COLUMNS, CsvFiles, tension_columns
from octo_arm_model.experiment.compare import ModelComparison
from octo_arm_model.experiment.fit import shape_residuals

MIDLINES = (
    'model', 'step', 's [m]',
    *(f'{name}_{axis} [m]' for name in ('measured', 'model', 'residual') for axis in 'xyz'),
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
        for time in dict.fromkeys((window.start, window.stop)):
            yield [round(time - origin, 9), *window.tensions.tolist()]
