"""Compare `exact` with sheaths of constant stiffness with finite elements.

    python validation/sheaths.py          writes sheaths.json and sheaths.png: 15 minutes or more
    python validation/sheaths.py --draw   draws sheaths.json again, in seconds

The arm is the prototype of the paper's section 5.2 at the tensions of Table 1, with a tendon in
sheaths of three radii. Errors are distances between tips in % of the length. The error of the mesh
is the distance between the tips on two meshes, one of which is twice as fine across the arm.
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
_CANDIDATES = np.arange(3.0, 16.0, 0.25)  # stiffnesses over the shear modulus
_COLOURS = {'rigid': 'tab:red', 'estimated': 'tab:blue', 'best': 'tab:green'}
_ARM = PROTOTYPE.arm
_MODULUS = _ARM.material.shear_modulus
_TENSIONS = [load[0] for load in PROTOTYPE.tensions]


def solve_elements(radius: float) -> dict[str, Any]:
    """Solve with finite elements and a sheath of ``radius`` [m] on two meshes; return the tips."""
    contact = dataclasses.replace(PROTOTYPE.contact, sheath=radius)
    coarse, fine = (
        ElasticArm(_ARM, mesh, PROTOTYPE.pulled, contact)
        for mesh in (PROTOTYPE.basis, PROTOTYPE.result)
    )
    coarse_shapes = list(coarse.follow(PROTOTYPE.tensions))
    guesses = [fine.guess(coarse, shape.state) for shape in coarse_shapes]
    fine_shapes = list(fine.follow(PROTOTYPE.tensions, guesses=guesses))
    return {
        'radius_mm': 1e3 * radius,
        'tips_mm': [np.round(1e3 * shape.tip, 4).tolist() for shape in fine_shapes],
        'coarse_tips_mm': [np.round(1e3 * shape.tip, 4).tolist() for shape in coarse_shapes],
    }


def errors(stiffness: float, tips: FloatArray) -> FloatArray:
    """Return the distances of the tips of `exact` from ``tips`` (loads, 3) [m], in % of L."""
    arm = dataclasses.replace(_ARM, sheath_stiffness=(stiffness,))
    solver = Solver(arm, 'exact', _STATIONS)
    distances = [
        np.linalg.norm(solver.solve([[tension, 0.0, 0.0, 0.0]]).tip - tip)
        for tension, tip in zip(_TENSIONS, tips, strict=True)
    ]
    return 100.0 / _ARM.length * np.array(distances)


def compare(result: dict[str, Any]) -> dict[str, Any]:
    """Add the errors of `exact` to the results of `solve_elements`.

    The sheath is rigid, has the stiffness estimated from the radii of sheath and body, or has the
    stiffness with the smallest error over all tensions.
    """
    tips = 1e-3 * np.array(result['tips_mm'])
    mesh_distances = np.linalg.norm(tips - 1e-3 * np.array(result['coarse_tips_mm']), axis=1)
    radius = float(_ARM.body.radius(0.5 * _ARM.length))
    estimate = estimate_sheath_stiffness(1e-3 * result['radius_mm'], radius, _MODULUS)
    best = min(_CANDIDATES, key=lambda k: float(errors(k * _MODULUS, tips).max()))
    return result | {
        'tensions_N': _TENSIONS,
        'stiffness_over_shear_modulus': {
            'estimated': round(estimate / _MODULUS, 2),
            'best': float(best),
        },
        'mesh_error_percent': np.round(100.0 / _ARM.length * mesh_distances, 2).tolist(),
        'tip_error_percent': {
            name: np.round(errors(k, tips), 2).tolist()
            for name, k in (('rigid', 0.0), ('estimated', estimate), ('best', best * _MODULUS))
        },
    }


def draw(results: list[dict[str, Any]], path: Path) -> None:
    """Draw the errors over the tension for each sheath."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.6), layout='constrained')
    panels = figure.subplots(1, len(results), sharey=True)
    for axes, result in zip(panels, results, strict=True):
        stiffnesses = result['stiffness_over_shear_modulus']
        for name, colour in _COLOURS.items():
            label = name if name == 'rigid' else f'{name}, k = {stiffnesses[name]:.3g} G'
            percent = result['tip_error_percent'][name]
            axes.plot(_TENSIONS, percent, 'o-', color=colour, label=label)
            axes.plot(_TENSIONS, result['mesh_error_percent'], ':', color='0.4', label='mesh')
        axes.set(title=f'sheath of {result["radius_mm"]:g} mm radius', xlabel='tension [N]')
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    panels[0].set_ylabel('distance of the tips [% of L]')
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Solve or load the elements, compare, write the results and print the table."""
    path = HERE / 'sheaths.json'
    if '--draw' in sys.argv[1:]:
        solutions = json.loads(path.read_text(encoding='utf-8'))
    else:
        solutions = [solve_elements(radius) for radius in RADII]
    results = [compare(solution) for solution in solutions]
    path.write_text(json.dumps(results, indent=1) + '\n', encoding='utf-8')
    draw(results, path.with_suffix('.png'))
    print('\n'.join(rows(results)))


def rows(results: list[dict[str, Any]]) -> list[str]:
    """Return the rows of the manual's table: stiffnesses over G, errors at 2 N and at 3.95 N."""
    lines = []
    for result in results:
        stiffnesses = result['stiffness_over_shear_modulus']
        numbers = [result['tensions_N'].index(tension) for tension in (2.0, 3.95)]
        columns = [*result['tip_error_percent'].values(), result['mesh_error_percent']]
        cells = [
            f'{result["radius_mm"]:g}',
            f'{stiffnesses["estimated"]:g}',
            f'{stiffnesses["best"]:g}',
        ]
        cells += ['; '.join(f'{values[load]:.2f}' for load in numbers) for values in columns]
        lines.append(f'| {" | ".join(cells)} |')
    return lines


if __name__ == '__main__':
    main()
