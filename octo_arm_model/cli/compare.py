"""``octo-arm compare``: the model against measured midlines."""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.cli import arguments
from octo_arm_model.cli.files import Bar, check_out, writing
from octo_arm_model.cli.recordings import RECORDINGS, of_each, read_options, recording_options
from octo_arm_model.config.config import Config
from octo_arm_model.config.files import CsvFiles
from octo_arm_model.experiment.compare import ModelComparison, compare, write_tables
from octo_arm_model.experiment.observations import Observations

SUMMARY = 'compare the model with midlines in a bag'
DESCRIPTION = """\
Compare the model with midlines or tips measured in a recorded experiment, for every steady step
of the tensions. Printed are the error of the tip in per cent of the length of the arm, as in
Table 1 of Renda et al. 2012, and the mean, largest and Hausdorff distances between the midlines.
With --dynamic the model moves, and each frame is compared with its shape at that time.
"""
EPILOG = (
    """\
examples:
  octo-arm compare experiment
  octo-arm compare experiment --model all --out compared
  octo-arm compare swings --dynamic --config my_arm.yaml --out compared
  octo-arm compare experiment --config renda2012_prototype --json \\
      --align 0.12 0.05 0.6 0.8 -0.36 0.288 0.384

--out DIR writes compare.csv (a row for each step), midlines.csv (each measured point, the model's
and the difference), stations.csv (the model), tensions.csv (for `octo-arm play`), compare.json, a
picture of every step like the paper's Figure 9, one of all steps, and one of the errors over the
tensions, for loading and unloading. For a motion it writes a picture of a few moments, and one of
the tip over time.

"""
    + RECORDINGS
)
# The column of each error of a `MidlineErrors`.
ERRORS = {
    'tip': 'tip_error_percent',
    'mean': 'mean_error_percent',
    'max': 'max_error_percent',
    'hausdorff': 'hausdorff_percent',
}


OPTIONS = f"""\
{recording_options('that of the config')}
--out DIR path: folder for tables and pictures
{arguments.JSON}
"""


def run(options: argparse.Namespace) -> int:
    """Compare recorded shapes with the models; print and write the errors."""
    out = options.out
    check_out(options, '--out', folder=True, draws=True)
    recording, observations, models, alignment, notes, trajectory = read_options(options)
    config = Config.from_parameters(recording.parameters)

    def compare_with(model: str) -> ModelComparison:
        with Bar(f'steps of {model}') as bar:
            shapes, values = observations.shapes, recording.parameters
            return compare(shapes, values, model, alignment, bar.on_terminal, trajectory)

    comparisons = of_each(models, 'compared', notes, compare_with)
    result = as_dict(comparisons, observations, notes)
    if out is not None:
        from octo_arm_model.experiment.pictures import pictures_of_comparison, save_all

        pictures, whole = pictures_of_comparison(comparisons), json.dumps(result, indent=1)
        with writing(out, folder=True) as place, Bar('pictures') as bar:
            (place / 'compare.json').write_text(whole + '\n', encoding='utf-8')
            write_csv(place / 'compare.csv', rows(comparisons), config.arm.tendon_names)
            save_all(pictures, place, bar.on_terminal)
            tables = write_tables(place, comparisons, config.arm.tendon_names)
        files = ', '.join(['compare.csv', *tables, 'compare.json'])
        notes.append(f'{files} and {len(pictures)} pictures are in {out}')
    print(json.dumps(result) if options.json else summary(comparisons, notes))
    return 0


def rows(comparisons: Sequence[ModelComparison]) -> list[dict[str, Any]]:
    """Return a row for each model and step; errors in per cent of the length, None if unknown."""
    table = []
    for comparison in comparisons:
        columns = {'bend_error_percent': comparison.bend_percent.tolist()}
        noise = [100.0 * step.shape.noise / comparison.length for step in comparison.steps]
        columns['noise_percent'] = noise
        columns |= {key: comparison.percent(name).tolist() for name, key in ERRORS.items()}
        for step, *values in zip(comparison.steps, *columns.values(), strict=True):
            window = step.shape.window
            errors = (None if math.isnan(value) else value for value in values)
            table.append(
                {
                    'model': comparison.model,
                    'step': step.number,
                    'start': window.start,
                    'stop': window.stop,
                    'tension': step.shape.tension,
                    'tensions': window.tensions.tolist(),
                    'tensions_stddev': window.noise.tolist(),
                    'frames': step.shape.frames,
                    'outliers': step.shape.outliers,
                    'direction': step.direction,
                    **dict(zip(columns, errors)),
                }
            )
    return table


def as_dict(
    comparisons: Sequence[ModelComparison], observations: Observations, notes: Sequence[str]
) -> dict[str, Any]:
    """Return all results in SI units; errors are in per cent of the length."""
    return {
        'steps': rows(comparisons),
        'models': {
            comparison.model: {
                'average_tip_error_percent': _average(comparison.percent('tip')),
                'alignment_camera_to_base': asdict(comparison.alignment),
                'refused': list(comparison.refused),
                'notes': list(comparison.notes),
            }
            for comparison in comparisons
        },
        'length': comparisons[0].length,
        'clock_offset': observations.offset,
        'notes': list(notes),
    }


def write_csv(path: Path, table: Sequence[dict[str, Any]], tendons: Sequence[str]) -> None:
    """Write ``table`` with a column of tensions [N] for each of the ``tendons``."""
    with CsvFiles() as files:
        writer = files.open(path)
        plain = [name for name in table[0] if not name.startswith('tensions')]
        units = {'start': ' [s]', 'stop': ' [s]', 'tension': ' [N]'}
        heads = [name + units.get(name, '') for name in plain]
        writer.writerow([*heads, *(f'{name} [N]' for name in tendons)])
        for row in table:
            writer.writerow([*(row[name] for name in plain), *row['tensions']])


def summary(comparisons: Sequence[ModelComparison], notes: Sequence[str]) -> str:
    """Return the ``notes`` and the table of errors of each model as text."""
    lines = [*notes]
    for comparison in comparisons:
        lines += ['', f'model {comparison.model}', *comparison.notes, *comparison.refused]
        if comparison.moves:
            lines += _of_motion(comparison)
            continue
        lines.append(
            'step    T [N]  reached by  frames   tip [% of L]   signed   mean    max   Hausdorff'
            '   noise of a frame'
        )
        for row in rows([comparison]):
            tip, mean, largest, hausdorff = (_cell(row[key]) for key in ERRORS.values())
            left_out = f' ({row["outliers"]} outliers left out)' if row['outliers'] else ''
            lines.append(
                f'{row["step"]:>4} {row["tension"]:>8.3f} {row["direction"]:>11} '
                f'{row["frames"]:>7} {tip:>14} {_cell(row["bend_error_percent"], "+"):>8} '
                f'{mean:>6} {largest:>6} {hausdorff:>11} {row["noise_percent"]:>18.2f}{left_out}'
            )
        averages = (_cell(_average(comparison.percent(name))) for name in ERRORS)
        tip, mean, largest, hausdorff = averages
        lines.append(f'Average{"":26}{tip:>15} {"":8} {mean:>6} {largest:>6} {hausdorff:>11}')
    return '\n'.join(lines)


def _of_motion(comparison: ModelComparison) -> list[str]:
    """Return the errors over all moments of a motion as lines of text."""
    lines = [f'errors [% of L] at {len(comparison.steps)} moments      average     rms    largest']
    for name in ERRORS:
        percent = comparison.percent(name)
        if (known := percent[np.isfinite(percent)]).size:
            rms = float(np.sqrt(np.mean(np.square(known))))
            average, largest = float(known.mean()), float(known.max())
            lines.append(f'  {name:<34}{average:>10.2f}{rms:>8.2f}{largest:>11.2f}')
    return lines


def _average(percent: FloatArray) -> float | None:
    """Return the mean over the steps with a measured value; None if there is no such step."""
    known = percent[np.isfinite(percent)]
    return float(known.mean()) if known.size else None


def _cell(value: float | None, sign: str = '-') -> str:
    return '-' if value is None else f'{value:{sign}.2f}'
