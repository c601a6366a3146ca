"""``octo-arm solve``: the shape of an arm for one set of tensions."""

from __future__ import annotations

import argparse
import json
from typing import Any

from octo_arm_model.cli.options import add_config, add_json, new_command, read_config, read_json
from octo_arm_model.cli.report import as_dict, summary
from octo_arm_model.core.errors import TensionError

_EXAMPLE = "'[[0,0,0.5,0]]'"


def add_command(commands: Any) -> None:
    """Add the command to the subparsers ``commands``."""
    parser = new_command(
        commands,
        'solve',
        _run,
        'solve an arm for one set of tensions',
        'Solve an arm for one set of tensions and print its shape.',
    )
    add_config(parser)
    parser.add_argument(
        '--tensions',
        required=True,
        metavar='JSON',
        help='tensions [N]: one row for each section, from the tip to the base, '
        "e.g. '[[0,0,0.5,0],[4,0,0,0],[0,0,13,0]]'",
    )
    add_json(parser)


def _run(options: argparse.Namespace) -> None:
    solver = read_config(options).solver()
    tensions = read_json(options.tensions, '--tensions', _EXAMPLE)
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
