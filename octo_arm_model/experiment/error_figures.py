"""Picture of errors over tensions by branch. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from octo_arm_model.experiment.compare import ModelComparison
from octo_arm_model.experiment.figure_files import new_figure
from octo_arm_model.experiment.shapes.branches import LOADING, REST, UNLOADING
from octo_arm_model.reproduce.plotting import LINES

_MARKERS = {LOADING: ('^', True, 'loading'), UNLOADING: ('v', False, 'unloading')}


def draw_errors(comparisons: Sequence[ModelComparison]) -> Any:
    """Errors of each step over its tensions: signed, in order of time, and unsigned."""
    figure = new_figure(11.4, 4.8)
    signed, plain = figure.subplots(1, 2)
    for comparison in comparisons:
        tension = np.array([step.shape.tension for step in comparison.steps])
        colour = LINES[comparison.model]['color']
        # The paper's two models agree for one section: the first is drawn wider.
        width = 1.6 if comparison.model != 'renda2012' else 4.0
        bend = comparison.bend_percent
        signed.plot(tension, bend, '-', color=colour, linewidth=width, alpha=0.6)
        ways = np.array([step.direction for step in comparison.steps])
        for way in dict.fromkeys(ways[np.isfinite(bend)]):
            marker, is_full, label = _MARKERS.get(way, ('o', True, str(way)))
            at = ways == way
            signed.plot(
                tension[at], bend[at], marker, color=colour, markersize=5.0 + width,
                markerfacecolor=colour if is_full else 'white',
                label=f'{comparison.model}, {label}',
            )  # fmt: skip
        for name, style, label in (('tip', 'o-', 'tip'), ('mean', 'x--', 'mean of midline')):
            percent = comparison.percent(name)
            if not np.isfinite(percent).any():
                continue
            for number, way in enumerate(dict.fromkeys(np.where(ways == REST, LOADING, ways))):
                at = np.flatnonzero((ways == way) | ((ways == REST) & (way == LOADING)))
                at = at[np.argsort(tension[at], kind='stable')]
                plain.plot(
                    tension[at], percent[at], style, color=colour, linewidth=width,
                    markersize=5.0 + width,
                    markerfacecolor='white' if way == UNLOADING else colour,
                    label='' if number else f'{comparison.model}, {label}',
                )  # fmt: skip
    signed.axhline(0.0, color='0.5', linewidth=0.8, zorder=0)
    signed.set(
        xlabel='sum of tensions [N]', ylabel='signed error of the tip [% of L]',
        title='> 0: the arm bends farther than the model',
    )  # fmt: skip
    plain.set(
        xlabel='sum of tensions [N]', ylabel='error [% of L]',
        title='Model against measurement, by steady step',
    )  # fmt: skip
    plain.set_ylim(bottom=0.0)
    for panel in (signed, plain):
        panel.grid(alpha=0.3)
        panel.legend(frameon=False, fontsize='small')
    return figure
