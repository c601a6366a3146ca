"""Compute the effect of tendon friction on the prototype, and draw friction.png.

    python validation/friction.py

The tension of the arm of the paper's section 5.2 rises to the highest one of Table 1 and falls
again, in the model exact with several coefficients of friction.
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
_STEPS = 79  # of rising tension, 0.05 N each, and as many of falling
_SHOWN = 2.0  # [N], tension of the drawn shapes
_ARM = load_config('renda2012_prototype').arm


def loop(friction: float) -> list[Backbone]:
    """Return the shapes while the tension rises from 0 and falls again."""
    solver = Solver(dataclasses.replace(_ARM, friction=(friction,)), 'exact')
    up = np.linspace(0.0, HIGHEST, _STEPS + 1)
    last: Backbone | None = None
    shapes = []
    for tension in np.concatenate([up, up[-2::-1]]):
        last = solver.follow([[tension, 0.0, 0.0, 0.0]], last)
        shapes.append(last)
    return shapes


def width(shapes: list[Backbone]) -> FloatArray:
    """Return the distance between the tips of rising and of falling tension [% of the length]."""
    tips = np.array([shape.tip for shape in shapes])
    distances = np.linalg.norm(tips[: _STEPS + 1] - tips[: _STEPS - 1 : -1], axis=1)
    return np.asarray(100.0 / _ARM.length * distances)


def draw(path: Path) -> None:
    """Draw shapes at one tension, the tip over tension, and the tension at the tip."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.8), layout='constrained')
    shape_axes, tip_axes, tension_axes = figure.subplots(1, 3)
    shown = round(_SHOWN / HIGHEST * _STEPS)
    for friction, colour in zip(COEFFICIENTS, ('0.4', 'tab:green', 'tab:blue', 'tab:red')):
        shapes = loop(friction)
        pulls = np.array([shape.tensions[0, 0] for shape in shapes])
        for shape, dashes in ((shapes[shown], '-'), (shapes[-1 - shown], '--')):
            x, y, _ = 1e3 * shape.position.T
            shape_axes.plot(x, y, dashes, color=colour)
        rotations = [Rotation.from_quat(shape.quaternion[-1]).magnitude() for shape in shapes]
        tip_axes.plot(pulls, np.degrees(rotations), color=colour, label=f'mu = {friction:g}')
        tip_tensions = [shape.tendon_tensions[-1, 0] for shape in shapes]
        tension_axes.plot(pulls, tip_tensions, color=colour)
    shape_axes.set(
        title=f'{pulls[shown]:.2g} N rising (solid) and falling (dashed)',
        xlabel='x [mm]',
        ylabel='y [mm]',
        aspect='equal',
    )
    tip_axes.set(title='the tip', xlabel='tension at the base [N]', ylabel='rotation [degrees]')
    tension_axes.set(
        title='the tendon', xlabel='tension at the base [N]', ylabel='tension at the tip [N]'
    )
    tip_axes.legend(fontsize=8)
    for each in (shape_axes, tip_axes, tension_axes):
        each.grid(alpha=0.3)
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=110)


def rows() -> list[str]:
    """Return the rows of the manual's table."""
    numbers = [round(tension / HIGHEST * _STEPS) for tension in (1.0, 2.0, 3.0)]
    lines = []
    for friction in COEFFICIENTS[1:]:
        shapes = loop(friction)
        tip_tension = shapes[_STEPS].tendon_tensions[-1, 0] / HIGHEST
        cells = ' | '.join(f'{value:.1f}' for value in width(shapes)[numbers])
        lines.append(f'| {friction:g} | {100.0 * tip_tension:.0f} % | {cells} |')
    return lines


if __name__ == '__main__':
    draw(HERE / 'friction.png')
    print('\n'.join(rows()))
