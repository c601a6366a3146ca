"""The command line, ``octo-arm``."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence

from octo_arm_model.cli import compare as compare_cli
from octo_arm_model.cli import identify as identify_cli
from octo_arm_model.cli import inverse as inverse_cli
from octo_arm_model.cli import play as play_cli
from octo_arm_model.cli import record_demo as demo_cli
from octo_arm_model.cli import replay as replay_cli
from octo_arm_model.cli import reproduce as reproduce_cli
from octo_arm_model.cli import workspace as workspace_cli
from octo_arm_model.cli.options import add_config, read_config, read_json
from octo_arm_model.cli.report import as_dict, summary
from octo_arm_model.core.errors import OctoArmError, SolveError, TensionError
from octo_arm_model.logs import show_logs

_EPILOG = """\
examples:
  octo-arm solve renda2012_table4 --tensions '[[0,0,0.5,0],[4,0,0,0],[0,0,13,0]]'
  octo-arm solve config/renda2012_prototype.yaml --tensions '[[3,0,0,0]]' --json
  octo-arm solve renda2012_prototype --tensions '[[2,0,0,0]]' --model exact \\
      --gravity 0 0 -9.81 --density 1080 --fluid-density 1000
  octo-arm inverse renda2012_table4 --tip 0.2 0.1 -0.1
  octo-arm workspace renda2012_table4 --out cloud.png
  octo-arm play --list
  octo-arm record-demo experiment
  octo-arm compare experiment --out compared
  octo-arm identify experiment --model all --out fitted.yaml
  octo-arm replay experiment experiment_shapes
  octo-arm reproduce reproduced

exit status: 0 done, 1 the model has no trustworthy answer, 2 the input is wrong, 130 interrupted
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
    add_config(solve)
    solve.add_argument(
        '--tensions',
        required=True,
        metavar='JSON',
        help='tensions [N]: one row for each section, from the tip to the base, '
        "e.g. '[[0,0,0.5,0],[4,0,0,0],[0,0,13,0]]'",
    )
    solve.add_argument('--json', action='store_true', help='print one JSON object, in SI units')
    solve.set_defaults(run=_solve)

    compare_cli.add_command(commands)
    demo_cli.add_command(commands)
    identify_cli.add_command(commands)
    inverse_cli.add_command(commands)
    play_cli.add_command(commands)
    replay_cli.add_command(commands)
    reproduce_cli.add_command(commands)
    workspace_cli.add_command(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = build_parser().parse_args(arguments)
    show_logs(lambda text, is_warning: print(f'octo-arm: {text}', file=sys.stderr))
    try:
        return options.run(options) or 0
    except KeyboardInterrupt:
        return _fail('interrupted', 130)
    except SolveError as error:
        return _fail(error, 1)
    except BrokenPipeError:
        # Whoever reads has enough, as `head` does. Python would complain once more at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (OctoArmError, OSError) as error:
        return _fail(error, 2)
    except ModuleNotFoundError as error:
        return _fail(f'needs {error.name}; install it with: pip install {error.name}', 2)


def _fail(problem: object, status: int) -> int:
    print(f'octo-arm: error: {problem}', file=sys.stderr)
    return status


def _solve(options: argparse.Namespace) -> None:
    solver = read_config(options).solver()
    tensions = read_json(options.tensions, '--tensions', "'[[0,0,0.5,0]]'")
    if _depth(tensions) > 2:
        raise TensionError('--tensions holds several sets, expected one row for each section')
    backbone = solver.solve(tensions)
    print(json.dumps(as_dict(backbone, solver)) if options.json else summary(backbone, solver))


def _depth(rows: object) -> int:
    """How deep lists are nested in the first entries."""
    depth = 0
    while isinstance(rows, list):
        depth += 1
        rows = rows[0] if rows else None
    return depth


if __name__ == '__main__':
    sys.exit(main())
