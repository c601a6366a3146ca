"""The command line, ``octo-arm``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from octo_arm_model.backbone import Backbone
from octo_arm_model.config import Config, load_config
from octo_arm_model.errors import OctoArmError, SolveError, TensionError
from octo_arm_model.paper import preset_path
from octo_arm_model.solver import MODELS

_EPILOG = """\
examples:
  octo-arm solve renda2012_table4 --tensions '[[0,0,0.5,0],[4,0,0,0],[0,0,13,0]]'
  octo-arm solve config/renda2012_prototype.yaml --tensions '[[3,0,0,0]]' --json
  octo-arm figures figures/

exit status: 0 done, 1 the model has no trustworthy answer, 2 the input is wrong
"""


def build_parser() -> argparse.ArgumentParser:
    """Parser of all commands."""
    parser = argparse.ArgumentParser(
        prog='octo-arm',
        description='Shape of a tendon-driven soft arm from the tensions of its tendons.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')

    solve = commands.add_parser(
        'solve',
        help='solve an arm for one set of tensions',
        description='Solve an arm for one set of tensions and print its shape.',
    )
    solve.add_argument(
        'config',
        metavar='CONFIG',
        help='ROS parameter file of the arm, or the name of a preset such as renda2012_table4',
    )
    solve.add_argument(
        '--tensions',
        required=True,
        metavar='JSON',
        help='tensions [N]: one row of four for each section, from the tip to the base, '
        "e.g. '[[0,0,0.5,0],[4,0,0,0],[0,0,13,0]]'",
    )
    solve.add_argument('--model', choices=MODELS, help='model, instead of that of the config')
    solve.add_argument(
        '--stations', type=int, metavar='N', help='stations, instead of those of the config'
    )
    solve.add_argument('--json', action='store_true', help='print one JSON object, in SI units')
    solve.set_defaults(run=_solve)

    figures = commands.add_parser(
        'figures',
        help="draw the paper's Figures 10, 11, 12, 14 and 15",
        description="Draw the paper's Figures 10, 11, 12, 14 and 15 as PNG files.",
    )
    figures.add_argument('outdir', metavar='OUTDIR', type=Path, help='folder for the pictures')
    figures.add_argument('--model', choices=MODELS, default='renda2012', help='model to draw')
    figures.set_defaults(run=_figures)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = build_parser().parse_args(arguments)
    try:
        options.run(options)
    except SolveError as error:
        return _fail(error, 1)
    except (OctoArmError, OSError) as error:
        return _fail(error, 2)
    except ModuleNotFoundError as error:
        return _fail(f'needs {error.name}; install it with: pip install {error.name}', 2)
    return 0


def _fail(problem: object, status: int) -> int:
    print(f'octo-arm: error: {problem}', file=sys.stderr)
    return status


def find_config(name: str) -> Config:
    """Configuration from a file, or from a preset where ``name`` is no path.

    Raises:
        ConfigError: if there is neither, or it does not describe an arm.
    """
    is_path = Path(name).suffix or len(Path(name).parts) > 1 or Path(name).exists()
    return load_config(name if is_path else preset_path(name))


def _solve(options: argparse.Namespace) -> None:
    solver = find_config(options.config).solver(options.model, options.stations)
    try:
        tensions = json.loads(options.tensions)
    except (RecursionError, ValueError) as error:
        where = f' at character {error.pos + 1}' if isinstance(error, json.JSONDecodeError) else ''
        raise TensionError(
            f"--tensions is not JSON{where}, expected rows of numbers such as '[[0,0,0.5,0]]'"
        ) from error
    if _depth(tensions) > 2:
        raise TensionError('--tensions holds several sets, expected one row for each section')
    backbone = solver.solve(tensions)
    print(json.dumps(as_dict(backbone)) if options.json else _summary(backbone))


def _depth(rows: object) -> int:
    """How deep lists are nested in the first entries."""
    depth = 0
    while isinstance(rows, list):
        depth += 1
        rows = rows[0] if rows else None
    return depth


def as_dict(backbone: Backbone) -> dict[str, object]:
    """Shape as plain lists in SI units, ready for JSON."""
    arrays = ('s', 'section', 'position', 'quaternion', 'tau', 'xi', 'k', 'q')
    return {'model': backbone.model} | {name: getattr(backbone, name).tolist() for name in arrays}


def _summary(backbone: Backbone) -> str:
    """Shape at the base, the anchorages and the tip, for people: millimetres and degrees."""
    distance = float(np.linalg.norm(backbone.tip - backbone.position[0]))
    is_end = np.append(np.diff(backbone.section) != 0, True)
    rows = np.flatnonzero(is_end | (np.arange(is_end.size) == 0))
    lines = [
        f'model     {backbone.model}, {backbone.s.size} stations',
        f'tip       {_millimetres(backbone.tip)} mm, {distance * 1e3:.2f} mm from the base',
        '',
        'section     s [mm]        x        y        z [mm]'
        '    tau       xi        k [1/m]   q [%]',
    ]
    for i in rows:
        x, y, z = backbone.position[i] * 1e3
        strains = (backbone.tau[i], backbone.xi[i], backbone.k[i], backbone.q[i] * 100.0)
        lines.append(
            f'{backbone.section[i]:>4}   {backbone.s[i] * 1e3:>9.2f} '
            f'{x:>8.2f} {y:>8.2f} {z:>8.2f}  ' + ' '.join(f'{value:>8.3f}' for value in strains)
        )
    return '\n'.join(lines)


def _millimetres(position: np.ndarray) -> str:
    return '(' + ', '.join(f'{value * 1e3:.2f}' for value in position) + ')'


def _figures(options: argparse.Namespace) -> None:
    from octo_arm_model.figures import draw_all

    options.outdir.mkdir(parents=True, exist_ok=True)
    for path in draw_all(options.outdir, options.model):
        print(path)


if __name__ == '__main__':
    sys.exit(main())
