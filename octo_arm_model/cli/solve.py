"""``octo-arm solve``: the shape of an arm for one set of tensions or displacements."""

from __future__ import annotations

import argparse
import json

from octo_arm_model.arm.errors import TensionError, shown
from octo_arm_model.cli.options.shared import (
    add_config,
    add_json,
    add_value,
    read_config,
    read_json,
)
from octo_arm_model.cli.output.solution import as_dict, summary
from octo_arm_model.rod.displacements import solve_displacements

SUMMARY = 'solve an arm for one set of tensions or displacements'
DESCRIPTION = """\
Solve an arm for one set of tensions, or of lengths that winches reel in, and print its shape.
"""
EPILOG = ''
_EXAMPLE = "'[[0,0,0.5,0]]'"
_NAMED = '\'{"tendon_1_1": 0.02}\''


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add its options."""
    add_config(parser)
    text = (
        'tensions [N]: one row for each section, from the tip to the base, '
        "e.g. '[[0,0,0.5,0],[4,0,0,0],[0,0,13,0]]'; with --displacements by name, of tendons "
        'that are held by tension, others are slack'
    )
    add_value(parser, '--tensions', 'JSON', text)
    text = f'lengths that winches have reeled in [m], by name of the tendon, e.g. {_NAMED}'
    add_value(parser, '--displacements', 'JSON', text)
    add_json(parser)


def run(options: argparse.Namespace) -> None:
    """Solve once and print the shape."""
    # For one shape machine code takes longer to load than it saves.
    solver = read_config(options).solver(compiled=False)
    slack: tuple[str, ...] = ()
    if options.displacements is not None:
        displacements = _by_name(options.displacements, '--displacements', _NAMED)
        tensions = {}
        if options.tensions is not None:
            tensions = _by_name(options.tensions, '--tensions', '\'{"tendon_1_2": 1.5}\'')
        wound = solve_displacements(solver, displacements, tensions)
        backbone, slack = wound.backbone, wound.slack
    elif options.tensions is not None:
        rows = read_json(options.tensions, '--tensions', _EXAMPLE)
        if _depth(rows) > 2:
            raise TensionError('--tensions holds several sets, expected one row for each section')
        backbone = solver.solve(rows)
    else:
        raise TensionError('neither --tensions nor --displacements is given')
    if options.json:
        print(json.dumps(as_dict(backbone, solver) | {'slack': list(slack)}))
        return
    print(summary(backbone, solver))
    if slack:
        print(f'\nslack: {", ".join(slack)}')


def _by_name(text: str, option: str, example: str) -> dict[str, float]:
    """Numbers by tendon of a JSON ``option``; TensionError if it holds none."""
    values = read_json(text, option, example)
    if not isinstance(values, dict) or any(
        isinstance(value, bool) or not isinstance(value, (int, float)) for value in values.values()
    ):
        raise TensionError(f'{option} is {shown(values)}, expected numbers by name as {example}')
    return values


def _depth(rows: object) -> int:
    """How deep lists are nested in the first entries."""
    depth = 0
    while isinstance(rows, list):
        depth += 1
        rows = rows[0] if rows else None
    return depth
