"""``octo-arm workspace``: where the tip can go."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from octo_arm_model.analysis.workspace import Workspace, sample_workspace
from octo_arm_model.cli.inverse import default_highest
from octo_arm_model.cli.options import add_config, read_config, read_json
from octo_arm_model.cli.progress import Bar
from octo_arm_model.config.config import Config
from octo_arm_model.core.errors import ConfigError, TensionError
from octo_arm_model.core.hints import FloatArray

_DESCRIPTION = """\
Find where the tip of the arm can go: solve it for many sets of tensions, spread evenly between 0
and --highest for every tendon at once, and draw the tips. Sets of tensions that the model has no
answer for are counted and left out. The arm can go somewhat further than the tips drawn: of many
tendons, hardly ever all are near an end of their range at once.
"""
_EPILOG = """\
examples:
  octo-arm workspace renda2012_table4 --out cloud.png
  octo-arm workspace renda2012_prototype --highest 3 --samples 16384
  octo-arm workspace renda2012_table2 --highest '[[1,1,1,1],[0,0,0,0],[0,0,0,0]]' --json
  octo-arm workspace renda2012_table4 --samples 256 --model exact \\
      --gravity 0 0 -9.81 --density 1080

A set of tensions takes a fraction of a millisecond, but with gravity, water or other loads ten
to a hundred milliseconds: then begin with few --samples. The same --seed, --samples and --highest
give the same tips whatever --processes or --scheduler are.
"""
_PARTS = 0.1  # of the section at its anchorage that a tendon alone may compress it by
_INTERRUPTED = 130  # exit status, as shells have it


def add_command(commands: argparse._SubParsersAction[Any]) -> None:
    """Add the command to the subparsers ``commands``."""
    parser = commands.add_parser(
        'workspace',
        help='draw where the tip can go',
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_config(parser)
    parser.add_argument(
        '--highest',
        metavar='N',
        help='largest tension [N]: one number for all tendons, or rows as --tensions of solve; '
        'by default, for each tendon, what alone compresses the cross section it is fastened at '
        'by 10 percent, or bends the arm by two turns',
    )
    parser.add_argument(
        '--samples', type=int, default=4096, metavar='N',
        help='sets of tensions, best a power of two (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--seed', type=int, default=0, metavar='N',
        help='other seeds draw other tensions, as evenly (default: %(default)s)',
    )  # fmt: skip
    parser.add_argument(
        '--processes', type=int, metavar='N',
        help='worker processes; by default one for each core where that is quicker',
    )  # fmt: skip
    parser.add_argument(
        '--scheduler', metavar='ADDRESS',
        help='Dask scheduler whose workers solve instead, such as tcp://10.0.0.1:8786; needs '
        "pip install 'octo_arm_model[cluster]'",
    )  # fmt: skip
    parser.add_argument(
        '--out', type=Path, metavar='PNG',
        help='picture to write (default: workspace.png; with --json none)',
    )  # fmt: skip
    parser.add_argument(
        '--json',
        action='store_true',
        help='print one JSON object, in SI units: highest, seed, refused, and of each set with '
        'an answer its tensions, tip and direction',
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    config = read_config(options)
    picture = options.out
    if picture is None and not options.json:
        picture = Path('workspace.png')
    if picture is not None:
        _check_picture(picture)
    bar = Bar(sys.stderr, 'sets of tensions')
    try:
        workspace = sample_workspace(
            config,
            _highest(options.highest, config),
            options.samples,
            options.seed,
            processes=options.processes,
            scheduler=options.scheduler,
            progress=bar,
        )
    except KeyboardInterrupt:
        bar.leave()
        print('octo-arm: interrupted', file=sys.stderr)
        return _INTERRUPTED
    finally:
        bar.leave()
    if picture is not None:
        from octo_arm_model.analysis.workspace_figure import draw_workspace

        draw_workspace(workspace, config.solver(), picture)
    print(
        json.dumps(as_dict(workspace, config.model, options.seed))
        if options.json
        else summary(workspace, config.model, picture)
    )
    return 0


def _check_picture(path: Path) -> None:
    """Before the work and not after it: is there what draws, and somewhere to write?

    Raises:
        ConfigError: if ``path`` cannot be a file.
        ModuleNotFoundError: if matplotlib is missing.
    """
    import matplotlib  # noqa: F401

    if path.is_dir():
        raise ConfigError(f'--out is {str(path)!r}, a folder, expected a picture to write')
    path.parent.mkdir(parents=True, exist_ok=True)


def _highest(text: str | None, config: Config) -> FloatArray | Any:
    if text is None:
        return default_highest(config.arm, _PARTS)
    highest = read_json(text, '--highest', "3 or '[[0.5,0.5,0.5,0.5]]'")
    if highest is None or isinstance(highest, (str, bool, dict)):
        raise TensionError(f'--highest is {text}, expected a number or rows of numbers [N]')
    return highest


def as_dict(workspace: Workspace, model: str, seed: int) -> dict[str, object]:
    """Workspace as plain lists in SI units, ready for JSON."""
    arrays = ('highest', 'tensions', 'tip', 'direction')
    return {
        'model': model,
        'seed': seed,
        'samples': len(workspace.tip) + workspace.refused,
        'refused': workspace.refused,
        **{name: getattr(workspace, name).tolist() for name in arrays},
    }


def summary(workspace: Workspace, model: str, picture: Path | None) -> str:
    """How many tips there are and how far they reach, for people: millimetres."""
    reached, refused = len(workspace.tip), workspace.refused
    lines = [
        f'model     {model}',
        f'tensions  up to {_range(workspace.highest)} N',
        f'tips      {reached} of {reached + refused} sets of tensions, {refused} refused',
    ]
    if not reached:
        lines.append('          none: give a lower --highest, or see what solve says of one set')
    else:
        low, high = workspace.tip.min(axis=0) * 1e3, workspace.tip.max(axis=0) * 1e3
        for name, least, most in zip('xyz', low, high):
            lines.append(
                f'{name}         {least:.2f} to {most:.2f} mm, {most - least:.2f} mm in all'
            )
    if picture is not None:
        lines.append(f'picture   {picture}')
    return '\n'.join(lines)


def _range(tensions: FloatArray) -> str:
    low, high = f'{tensions.min():.4g}', f'{tensions.max():.4g}'
    return low if low == high else f'{low} ... {high}'
