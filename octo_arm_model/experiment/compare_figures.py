"""Pictures of a comparison: each step like the paper's Figure 9, all steps, errors over tensions.

Needs matplotlib.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.experiment.compare import ModelComparison, StepComparison
from octo_arm_model.experiment.figure_files import TensionColours, new_figure
from octo_arm_model.experiment.shapes.branches import LOADING, REST, UNLOADING
from octo_arm_model.reproduce.figures import LINES
from octo_arm_model.rod.interpolation import interpolated
from octo_arm_model.rod.rotations import axes_of

_MEASURED = '0.15'
_FRAME = '0.78'
# Of the length: arms farther out of the main plane have a second view.
_FLAT = 0.05
_MOST_FRAMES = 30
_MARKERS = {LOADING: ('^', True, 'loading'), UNLOADING: ('v', False, 'unloading')}


def pictures_of(comparisons: Sequence[ModelComparison]) -> dict[str, Callable[[], Any]]:
    """Functions that draw the pictures of ``comparisons``, by name; see `save_all`."""
    axes = _axes(comparisons)
    steps: dict[int, list[tuple[ModelComparison, StepComparison]]] = {}
    for comparison in comparisons:
        for step in comparison.steps:
            steps.setdefault(step.number, []).append((comparison, step))
    limits = _limits(comparisons, axes)
    pictures: dict[str, Callable[[], Any]] = {
        f'step_{number:02}': functools.partial(_draw_step, shown, axes, limits)
        for number, shown in sorted(steps.items())
    }
    pictures['all_steps'] = lambda: _draw_all(comparisons, axes, limits)
    pictures['error_over_tension'] = lambda: _draw_errors(comparisons)
    return pictures


def _points(comparisons: Sequence[ModelComparison]) -> FloatArray:
    """All points of solutions and measurements, (n, 3) [m]."""
    parts = [part for one in comparisons for step in one.steps
             for part in (step.measured, step.backbone.position)]  # fmt: skip
    return np.concatenate(parts)


def _axes(comparisons: Sequence[ModelComparison]) -> FloatArray:
    """Axes of the views (2 or 3, 3): the base's tangent, and the principal bending direction."""
    backbone = comparisons[0].steps[0].backbone
    tangent = axes_of(backbone.quaternion[0])[:, 0]
    away = _points(comparisons) - backbone.position[0]
    across = away - np.outer(away @ tangent, tangent)
    *_, directions = np.linalg.svd(across, full_matrices=False)
    first = directions[0]
    # Bending upwards, as in the paper.
    first = first if (across @ first).sum() > 0.0 else -first
    second = np.cross(tangent, first)
    flat = np.abs(across @ second).max() < _FLAT * comparisons[0].length
    return np.array([tangent, first] if flat else [tangent, first, second])


def _limits(comparisons: Sequence[ModelComparison], axes: FloatArray) -> FloatArray:
    """Limits of each of the axes [mm], (2 or 3, 2), the same for all steps."""
    shown = 1e3 * (_points(comparisons) - comparisons[0].steps[0].backbone.position[0]) @ axes.T
    margin = 0.06 * np.ptp(shown, axis=0).max()
    return np.stack([shown.min(axis=0) - margin, shown.max(axis=0) + margin], axis=1)


def _draw_step(
    shown: Sequence[tuple[ModelComparison, StepComparison]], axes: FloatArray, limits: FloatArray
) -> Any:
    """Measured and modelled midlines of one step: a column for each model, a row for each view."""
    width = 7.0 if len(shown) == 1 else 5.2
    figure, panels = _panels(len(shown), limits, width)
    shape = shown[0][1].shape
    left_out = f', {shape.outliers} left out' if shape.outliers else ''
    figure.suptitle(
        f'Step {shown[0][1].number}: {shape.tension:.2f} N, {shape.frames} frames{left_out}'
    )
    for column, (comparison, step) in enumerate(shown):
        for view, panel in enumerate(panels[:, column]):
            _draw_view(panel, comparison, step, axes[[0, view + 1]])
        name = 'tip' if step.errors.tip is not None else 'mean'
        percent = 100.0 * (getattr(step.errors, name) or 0.0) / comparison.length
        panels[0, column].set_title(
            f'{comparison.model}, {name} error {percent:.1f} % of L', fontsize='medium'
        )
        panels[0, column].legend(loc='best', frameon=False)
    return figure


def _panels(columns: int, limits: FloatArray, width: float) -> tuple[Any, Any]:
    """A figure with a row for each view, and ``columns`` of a ``width`` [in] with equal axes."""
    size = np.ptp(limits, axis=1)
    views = len(size) - 1
    # What labels and margins leave of the width, and their height.
    inside = width - 0.15 - 0.65 / columns
    height = inside * float(size[1:].sum() / size[0]) + 1.15 + 0.15 * views
    figure = new_figure(width * columns, height, 'compressed')
    panels = figure.subplots(
        views, columns, squeeze=False, sharex=True, sharey='row', height_ratios=size[1:]
    )
    names = ('bending direction [mm]', 'across both [mm]')
    for (view, column), panel in np.ndenumerate(panels):
        panel.set(xlim=limits[0], ylim=limits[view + 1], aspect='equal')
        panel.grid(alpha=0.3)
        panel.set_axisbelow(True)
        if not column:
            panel.set_ylabel(names[view])
        if view == views - 1:
            panel.set_xlabel('along the base [mm]')
    return figure, panels


def _draw_view(
    panel: Any, comparison: ModelComparison, step: StepComparison, plane: FloatArray
) -> None:
    """One model and the measurement, seen in a ``plane`` (2, 3)."""
    origin = step.backbone.position[0]
    lines = step.shape.lines
    for line in lines[:: max(1, len(lines) // _MOST_FRAMES)]:
        flat = _flatten(comparison.alignment.to_base(line), plane, origin)
        is_dots = len(flat) == 1 or step.shape.s is not None
        panel.plot(*flat.T, '.' if is_dots else '-', color=_FRAME, linewidth=0.6, zorder=1)
    model = _flatten(step.backbone.position, plane, origin)
    measured = _flatten(step.measured, plane, origin)
    colour = LINES[comparison.model]['color']
    if step.shape.s is None:
        panel.plot(*np.stack([model[-1], measured[-1]]).T, ':', color=colour, zorder=2)
    else:
        for pair in zip(interpolated(step.shape.s, step.backbone.s, model), measured):
            panel.plot(*np.stack(pair).T, ':', color=colour, zorder=2)
    panel.plot(
        *model.T, color=colour, linewidth=2.2, marker='o', markevery=[-1], label='model', zorder=3
    )
    panel.plot(
        *measured.T, color=_MEASURED, linewidth=1.6, marker='s', markersize=5,
        linestyle=(0, (4, 2)) if step.shape.s is None else '',
        markevery=[-1] if step.shape.s is None else None, label='measured', zorder=5,
    )  # fmt: skip


def _flatten(points: FloatArray, plane: FloatArray, origin: FloatArray) -> FloatArray:
    """Points (n, 3) [m] from ``origin`` as seen in a ``plane`` (2, 3) [mm], (n, 2)."""
    return 1e3 * (points - origin) @ plane.T


def _draw_all(comparisons: Sequence[ModelComparison], axes: FloatArray, limits: FloatArray) -> Any:
    """Measured midlines over the model's in the arm's own frame: a column for each model."""
    figure, panels = _panels(len(comparisons), limits, 5.2)
    steps = [step for one in comparisons for step in one.steps]
    colours = TensionColours([step.shape for step in steps])
    for column, comparison in enumerate(comparisons):
        is_line = True
        for view, panel in enumerate(panels[:, column]):
            for step in comparison.steps:
                origin, plane = step.backbone.position[0], axes[[0, view + 1]]
                model = _flatten(step.backbone.position, plane, origin)
                panel.plot(*model.T, color=colours.of(step.shape))
                measured = _flatten(step.measured, plane, origin)
                is_line = step.shape.s is None and len(measured) > 1
                style = '--' if is_line else 's'
                panel.plot(*measured.T, style, color=_MEASURED, linewidth=1.1, markersize=4.0)
        what = 'dashes' if is_line else 'squares'
        title = f'{comparison.model} (colour) and measured ({what})'
        panels[0, column].set_title(title, fontsize='medium')
    colours.add_bar(figure, panels)
    return figure


def _draw_errors(comparisons: Sequence[ModelComparison]) -> Any:
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
