"""A solution as JSON and as a table."""

from __future__ import annotations

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.displacements import displacements_of
from octo_arm_model.rod.solver import Solver


def as_dict(backbone: Backbone, solver: Solver) -> dict[str, object]:
    """Shape as plain lists in SI units, ready for JSON."""
    wound = displacements_of(solver, backbone)
    arrays = ('s', 'section', 'position', 'quaternion', 'tau', 'xi', 'k', 'q')
    return {
        'model': backbone.model,
        **{name: getattr(backbone, name).tolist() for name in arrays},
        'tension': backbone.tensions.tolist(),
        'tendon_length': solver.tendon_lengths(backbone).tolist(),
        'displacement': wound.tolist(),
        'residual': float(backbone.residual),
        'iterations': int(backbone.iterations),
    }


def summary(backbone: Backbone, solver: Solver) -> str:
    """Shape at the base, the anchorages and the tip: millimetres and degrees."""
    distance = float(np.linalg.norm(backbone.tip - backbone.position[0]))
    is_end = np.append(np.diff(backbone.section) != 0, True)
    rows = np.flatnonzero(is_end | (np.arange(is_end.size) == 0))
    reeled_in = displacements_of(solver, backbone).ravel().tolist()
    lines = [
        f'model     {backbone.model}, {backbone.s.size} stations, residual '
        f'{float(backbone.residual):.1e} after {int(backbone.iterations)} iterations',
        f'tip       {millimetres(backbone.tip)} mm, {distance * 1e3:.2f} mm from the base',
        'tensions  ' + ' '.join(f'{tension:.4g}' for tension in backbone.tensions.ravel()) + ' N',
        'wound in  ' + ' '.join(f'{1e3 * length:.2f}' for length in reeled_in) + ' mm',
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
    """A point [m] in millimetres."""
    return '(' + ', '.join(f'{value * 1e3:.2f}' for value in position) + ')'
