"""Tendons that dig in: `exact` with one stiffness for each sheath, against finite elements.

    python validation/sheaths.py          a quarter of an hour or more: writes sheaths.json, .png
    python validation/sheaths.py --draw   from sheaths.json, in seconds

The prototype of the paper's section 5.2 at the tensions of Table 1, its tendon in sheaths of three
radii. Errors are distances of the tips in % of the length; what the mesh leaves uncertain is the
distance between two meshes, one twice as fine across the arm.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model import Solver
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import estimate_sheath_stiffness

try:
    from cases import PROTOTYPE
    from elasticity import ElasticArm
except ModuleNotFoundError as error:
    hint = "install it with: pip install '.[validation]'"
    sys.exit(f'sheaths.py: error: needs {error.name}; {hint}')

HERE = Path(__file__).parent
RADII = (0.5e-3, 1e-3, 2e-3)  # [m]
_STATIONS = 201
_TRIED = np.arange(3.0, 16.0, 0.25)  # stiffnesses over the shear modulus
_COLOURS = {'rigid': 'tab:red', 'estimated': 'tab:blue', 'best': 'tab:green'}
_ARM = PROTOTYPE.arm
_MODULUS = _ARM.material.shear_modulus
_TENSIONS = [load[0] for load in PROTOTYPE.tensions]


def elements(radius: float) -> dict[str, Any]:
    """Tips by finite elements with a sheath of ``radius`` [m], on two meshes."""
    contact = dataclasses.replace(PROTOTYPE.contact, sheath=radius)
    coarse, fine = (
        ElasticArm(_ARM, mesh, PROTOTYPE.pulled, contact)
        for mesh in (PROTOTYPE.basis, PROTOTYPE.result)
    )
    first = list(coarse.follow(PROTOTYPE.tensions))
    guesses = [fine.guess(coarse, shape.state) for shape in first]
    second = list(fine.follow(PROTOTYPE.tensions, guesses=guesses))
    return {
        'radius_mm': 1e3 * radius,
        'tips_mm': [np.round(1e3 * shape.tip, 4).tolist() for shape in second],
        'coarse_tips_mm': [np.round(1e3 * shape.tip, 4).tolist() for shape in first],
    }


def errors(stiffness: float, tips: FloatArray) -> FloatArray:
    """Distance of the tips of `exact` from ``tips`` (loads, 3) [m], in % of the length."""
    arm = dataclasses.replace(_ARM, sheath_stiffness=(stiffness,))
    solver = Solver(arm, 'exact', _STATIONS)
    apart = [
        np.linalg.norm(solver.solve([[tension, 0.0, 0.0, 0.0]]).tip - tip)
        for tension, tip in zip(_TENSIONS, tips, strict=True)
    ]
    return 100.0 / _ARM.length * np.array(apart)


def compare(found: dict[str, Any]) -> dict[str, Any]:
    """What is ``found`` by elements, and the errors of `exact` with one stiffness of the sheath.

    Rigid, by the estimate from the radii of sheath and body, and with the stiffness of least error
    over all tensions.
    """
    tips = 1e-3 * np.array(found['tips_mm'])
    mesh = np.linalg.norm(tips - 1e-3 * np.array(found['coarse_tips_mm']), axis=1)
    middle = float(_ARM.body.radius(0.5 * _ARM.length))
    estimate = estimate_sheath_stiffness(1e-3 * found['radius_mm'], middle, _MODULUS)
    best = min(_TRIED, key=lambda k: float(errors(k * _MODULUS, tips).max()))
    return found | {
        'tensions_N': _TENSIONS,
        'stiffness_over_shear_modulus': {
            'estimated': round(estimate / _MODULUS, 2),
            'best': float(best),
        },
        'mesh_error_percent': np.round(100.0 / _ARM.length * mesh, 2).tolist(),
        'tip_error_percent': {
            name: np.round(errors(k, tips), 2).tolist()
            for name, k in (('rigid', 0.0), ('estimated', estimate), ('best', best * _MODULUS))
        },
    }


def draw(results: list[dict[str, Any]], path: Path) -> None:
    """Errors over the tension for every sheath."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.6), layout='constrained')
    panels = figure.subplots(1, len(results), sharey=True)
    for axes, one in zip(panels, results, strict=True):
        known = one['stiffness_over_shear_modulus']
        for name, colour in _COLOURS.items():
            label = name if name == 'rigid' else f'{name}, k = {known[name]:.3g} G'
            axes.plot(
                one['tensions_N'], one['tip_error_percent'][name], 'o-', color=colour, label=label
            )
        axes.plot(one['tensions_N'], one['mesh_error_percent'], ':', color='0.4', label='mesh')
        axes.set(title=f'sheath of {one["radius_mm"]:g} mm radius', xlabel='tension [N]')
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    panels[0].set_ylabel('distance of the tips [% of L]')
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Compute or read, compare, write, print."""
    path = HERE / 'sheaths.json'
    if '--draw' in sys.argv[1:]:
        found = json.loads(path.read_text(encoding='utf-8'))
    else:
        found = [elements(radius) for radius in RADII]
    results = [compare(one) for one in found]
    path.write_text(json.dumps(results, indent=1) + '\n', encoding='utf-8')
    draw(results, path.with_suffix('.png'))
    print('\n'.join(rows(results)))


def rows(results: list[dict[str, Any]]) -> list[str]:
    """Rows of the manual's table: stiffnesses over G, and errors at 2 N and at 3.95 N."""
    lines = []
    for one in results:
        known = one['stiffness_over_shear_modulus']
        at = [one['tensions_N'].index(tension) for tension in (2.0, 3.95)]
        columns = [*one['tip_error_percent'].values(), one['mesh_error_percent']]
        cells = [f'{one["radius_mm"]:g}', f'{known["estimated"]:g}', f'{known["best"]:g}']
        cells += ['; '.join(f'{values[load]:.2f}' for load in at) for values in columns]
        lines.append(f'| {" | ".join(cells)} |')
    return lines


if __name__ == '__main__':
    main()
