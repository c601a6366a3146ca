"""``octo-arm solve``: solve an arm for one set of tensions or displacements."""

import argparse
import json

import numpy as np

from octo_arm_model.arm.errors import TensionError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.cli import arguments
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import displacements_of, solve_displacements
from octo_arm_model.rod.solver import Solver


def as_dict(backbone: Backbone, solver: Solver) -> dict[str, object]:
    """Return the shape as plain lists in SI units, for JSON."""
    displacements = displacements_of(solver, backbone)
    arrays = ('s', 'section', 'position', 'quaternion', 'tau', 'xi', 'k', 'q')
    return {
        'model': backbone.model,
        **{name: getattr(backbone, name).tolist() for name in arrays},
        'tension': backbone.tensions.tolist(),
        'tendon_length': solver.tendon_lengths(backbone).tolist(),
        'displacement': displacements.tolist(),
        'residual': float(backbone.residual),
        'iterations': int(backbone.iterations),
    }


def summary(backbone: Backbone, solver: Solver) -> str:
    """Return the shape at the base, the anchorages and the tip as text, in millimetres."""
    distance = float(np.linalg.norm(backbone.tip - backbone.position[0]))
    is_end = np.append(np.diff(backbone.section) != 0, True)
    rows = np.flatnonzero(is_end | (np.arange(is_end.size) == 0))
    reeled_in = displacements_of(solver, backbone).ravel().tolist()
    lines = [
        f'model     {backbone.model}, {backbone.s.size} stations, residual '
        f'{float(backbone.residual):.1e} after {int(backbone.iterations)} iterations',
        f'tip       {millimetres(backbone.tip)} mm, {distance * 1e3:.2f} mm from the base',
        'tensions  ' + ' '.join(f'{tension:.4g}' for tension in backbone.tensions.ravel()) + ' N',
        'reeled in ' + ' '.join(f'{1e3 * length:.2f}' for length in reeled_in) + ' mm',
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


def millimetres(position: FloatArray) -> str:
    """Return a ``position`` [m] as text in millimetres."""
    return '(' + ', '.join(f'{value * 1e3:.2f}' for value in position) + ')'


SUMMARY = 'solve an arm for one set of tensions or displacements'
DESCRIPTION = """\
Solve an arm for one set of tensions, or of lengths reeled in by winches, and print its shape.
"""
EPILOG = ''
_NAMED = 'tendon_1_1=0.02'


OPTIONS = f"""\
{arguments.ARM}
{arguments.tensions_option('all others are slack')}
--displacements LENGTHS: lengths that winches have reeled in [m], by name of the tendon, e.g.
    {_NAMED}, or as JSON; --tensions then has those of the other tendons, by name
{arguments.JSON}
"""


def run(options: argparse.Namespace) -> None:
    """Solve the arm once and print the shape."""
    # For a single shape, compiled code takes longer to load than it saves.
    solver = arguments.read_config(options).solver(compiled=False)
    slack: tuple[str, ...] = ()
    if options.displacements is not None:
        displacements = arguments.read_by_name(options.displacements, '--displacements', _NAMED)
        tensions = {}
        if options.tensions is not None:
            tensions = arguments.read_by_name(options.tensions, '--tensions', 'tendon_1_2=1.5')
        wound = solve_displacements(solver, displacements, tensions)
        backbone, slack = wound.backbone, wound.slack
    elif options.tensions is not None:
        backbone = solver.solve(arguments.read_tensions(options.tensions, solver.arm))
    else:
        raise TensionError('neither --tensions nor --displacements is given')
    if options.json:
        print(json.dumps(as_dict(backbone, solver) | {'slack': list(slack)}))
        return
    print(summary(backbone, solver))
    if slack:
        print(f'\nslack: {", ".join(slack)}')
