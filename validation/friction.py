"""What friction of its tendon does to the prototype: shapes and loops, drawn to friction.png.

    python validation/friction.py

The tendon of the paper's section 5.2 is pulled to the highest tension of Table 1 and let out
again, by the model exact with several coefficients of friction.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from octo_arm_model import Solver
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import load_config
from octo_arm_model.rod.backbone import Backbone

HERE = Path(__file__).parent
COEFFICIENTS = (0.0, 0.05, 0.1, 0.2)
HIGHEST = 3.95  # [N], of Table 1
_STEPS = 20  # up, and as many down
_SHOWN = 2.0  # [N], of the shapes
_ARM = load_config('renda2012_prototype').arm


def loop(friction: float) -> list[Backbone]:
    """Shapes on the way up from slack and down again, one after the other."""
    solver = Solver(dataclasses.replace(_ARM, friction=(friction,)), 'exact')
    up = np.linspace(0.0, HIGHEST, _STEPS + 1)
    last: Backbone | None = None
    found = []
    for tension in np.concatenate([up, up[-2::-1]]):
        last = solver.follow([[tension, 0.0, 0.0, 0.0]], last)
        found.append(last)
    return found


def width(shapes: list[Backbone]) -> FloatArray:
    """Distance of the tips of a `loop` at the tensions of both ways, in % of the length."""
    tips = np.array([shape.tip for shape in shapes])
    apart = np.linalg.norm(tips[: _STEPS + 1] - tips[: _STEPS - 1 : -1], axis=1)
    return np.asarray(100.0 / _ARM.length * apart)


def draw(path: Path) -> None:
    """Shapes at one tension, tips over tension, and the tension that is left at the tip."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.8), layout='constrained')
    shape, tip, tension = figure.subplots(1, 3)
    at = round(_SHOWN / HIGHEST * _STEPS)
    for friction, colour in zip(COEFFICIENTS, ('0.4', 'tab:green', 'tab:blue', 'tab:red')):
        shapes = loop(friction)
        pulls = np.array([one.tensions[0, 0] for one in shapes])
        for one, dashes in ((shapes[at], '-'), (shapes[-1 - at], '--')):
            shape.plot(1e3 * one.position[:, 0], 1e3 * one.position[:, 1], dashes, color=colour)
        turned = [Rotation.from_quat(one.quaternion[-1]).magnitude() for one in shapes]
        tip.plot(pulls, np.degrees(turned), color=colour, label=f'mu = {friction:g}')
        left = [one.tendon_tensions[-1, 0] for one in shapes]
        tension.plot(pulls, left, color=colour)
    shape.set(
        title=f'{pulls[at]:.2g} N, up (solid) and down (dashed)',
        xlabel='x [mm]',
        ylabel='y [mm]',
        aspect='equal',
    )
    tip.set(title='the tip', xlabel='tension at the base [N]', ylabel='turned by [degrees]')
    tension.set(
        title='the tendon', xlabel='tension at the base [N]', ylabel='tension at the tip [N]'
    )
    tip.legend(fontsize=8)
    for axes in (shape, tip, tension):
        axes.grid(alpha=0.3)
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=110)


def rows() -> list[str]:
    """Rows of the manual's table."""
    at = [round(part * _STEPS) for part in (0.25, 0.5, 0.75)]
    lines = []
    for friction in COEFFICIENTS[1:]:
        shapes = loop(friction)
        left = shapes[_STEPS].tendon_tensions[-1, 0] / HIGHEST
        cells = ' | '.join(f'{value:.1f}' for value in width(shapes)[at])
        lines.append(f'| {friction:g} | {100.0 * left:.0f} % | {cells} |')
    return lines


if __name__ == '__main__':
    draw(HERE / 'friction.png')
    print('\n'.join(rows()))
