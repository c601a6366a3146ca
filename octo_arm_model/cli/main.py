"""The command line, ``octo-arm``."""

import argparse
import re
import sys
from collections.abc import Sequence
from types import ModuleType

from octo_arm_model.arm.errors import OctoArmError, SolveError
from octo_arm_model.cli import (
    arguments,
    compare,
    estimate,
    identify,
    inverse,
    load,
    modes,
    play,
    record_demo,
    replay,
    reproduce,
    simulate,
    solve,
    workspace,
)
from octo_arm_model.cli.files import folders_made, refuse_overwriting
from octo_arm_model.terminal import fail, make_parser, missing, on_signals, pipe_closed, show_logs

_SMALL = re.compile(r'-[0-9.]+[eE]')
# Each module has the name of its command, SUMMARY for the list of commands, DESCRIPTION and EPILOG
# for its help, OPTIONS for `add`, and run(options), which returns the exit status or None for 0.
_COMMANDS: tuple[ModuleType, ...] = (
    solve,
    compare,
    estimate,
    record_demo,
    identify,
    inverse,
    load,
    play,
    simulate,
    modes,
    replay,
    reproduce,
    workspace,
)
_OF_RECORDINGS = ('compare', 'estimate', 'identify')  # commands that read bags and draw pictures
_PROG = 'octo-arm'
_SAME_SIGNAL = 1.0  # [s] within which signals count as one
_EPILOG = """\
examples:
  octo-arm solve renda2012_table4 --tensions '[[0,0,0.5,0],[4,0,0,0],[0,0,13,0]]'
  octo-arm solve config/renda2012_prototype.yaml --tensions tendon_1_1=3 --json
  octo-arm solve renda2012_prototype --tensions '[[2,0,0,0]]' --model exact \\
      --gravity 0 0 -9.81 --density 1080 --fluid-density 1000
  octo-arm inverse renda2012_table4 --tip 0.2 0.1 -0.1
  octo-arm workspace renda2012_table4 --out cloud.png
  octo-arm play --list
  octo-arm simulate my_arm.yaml steps --plot steps.png
  octo-arm modes my_arm.yaml
  octo-arm load renda2012_table2 --node /octo_arm
  octo-arm record-demo experiment
  octo-arm compare experiment --out compared
  octo-arm identify experiment --model all --out fitted.yaml
  octo-arm replay experiment experiment_shapes
  octo-arm estimate experiment --plot touch.png
  octo-arm reproduce reproduced

exit status: 0 done, 1 the model has no trustworthy answer, 2 the input is wrong, 130 interrupted
(143 by SIGTERM, 129 by SIGHUP)
"""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = make_parser(
        _PROG, 'Shape of a tendon-driven soft arm from the tensions of its tendons.', _EPILOG
    )
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for command in _COMMANDS:
        command_parser = commands.add_parser(
            command.__name__.rpartition('.')[2].replace('_', '-'),
            help=command.SUMMARY,
            description=command.DESCRIPTION,
            epilog=command.EPILOG,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command_parser.set_defaults(run=command.run, default_of=command_parser.get_default)
        arguments.add(command_parser, command.OPTIONS)
    return parser


def main(words: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    received: list[int] = []

    def interrupt(number: int) -> None:
        received.append(number)
        raise KeyboardInterrupt

    # Every signal that ends the program interrupts it, so that it removes unfinished output.
    with on_signals(interrupt, _SAME_SIGNAL):
        status = _run(words)
    return 128 + received[0] if received else status


def _run(words: Sequence[str] | None) -> int:
    try:
        words = sys.argv[1:] if words is None else words
        # For argparse -1e-5 is an option, but not after a blank.
        words = [f' {word}' if _SMALL.match(word) else word for word in words]
        options = build_parser().parse_args(words)
        refuse_overwriting(options)
        show_logs(lambda text, is_warning: print(f'octo-arm: {text}', file=sys.stderr))
        with folders_made() as options.made:
            status = options.run(options) or 0
        return status if sys.stdout else fail(_PROG, 'standard output is closed, output is lost')
    except KeyboardInterrupt as interrupt:
        # Shells report SIGINT by this status; the command may say what is not written.
        print(
            'octo-arm: ' + ', '.join(['interrupted', *map(str, interrupt.args)]), file=sys.stderr
        )
        return 130
    except SolveError as error:
        return fail(_PROG, error, 1)
    except BrokenPipeError:
        return pipe_closed()
    except (OctoArmError, OSError) as error:
        return fail(_PROG, error)
    except ModuleNotFoundError as error:
        extras = ('bags', 'figures') if options.command in _OF_RECORDINGS else ()
        return fail(_PROG, missing(error, *extras))
    except MemoryError:
        return fail(_PROG, 'out of memory')


if __name__ == '__main__':
    sys.exit(main())
