"""The command line, ``octo-arm``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from octo_arm_model.cli import (
    compare,
    identify,
    inverse,
    play,
    record_demo,
    replay,
    reproduce,
    solve,
    workspace,
)
from octo_arm_model.core.errors import OctoArmError, SolveError
from octo_arm_model.logs import show_logs
from octo_arm_model.terminal import make_parser

_COMMANDS = (
    solve, compare, record_demo, identify, inverse, play, replay, reproduce, workspace,
)  # fmt: skip
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
    parser = make_parser(
        'octo-arm',
        'Shape of a tendon-driven soft arm from the tensions of its tendons.',
        _EPILOG,
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for command in _COMMANDS:
        command.add_command(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = build_parser().parse_args(arguments)
    show_logs(lambda text, is_warning: print(f'octo-arm: {text}', file=sys.stderr))
    try:
        return options.run(options) or 0
    except KeyboardInterrupt as interrupt:
        # The status by which shells report SIGINT; the command may say what is not written.
        print(
            'octo-arm: ' + ', '.join(['interrupted', *map(str, interrupt.args)]), file=sys.stderr
        )
        return 130
    except SolveError as error:
        return _fail(error, 1)
    except BrokenPipeError:
        # The reader has closed the pipe, as `head` does; Python would report it again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (OctoArmError, OSError) as error:
        return _fail(error, 2)
    except ModuleNotFoundError as error:
        return _fail(f'needs {error.name}; install it with: pip install {error.name}', 2)


def _fail(problem: object, status: int) -> int:
    print(f'octo-arm: error: {problem}', file=sys.stderr)
    return status


if __name__ == '__main__':
    sys.exit(main())
