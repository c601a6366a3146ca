"""Pictures of comparisons, fits and estimates, drawn by matplotlib without a display."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from octo_arm_model.analysis.drawing import in_millimetres
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.camera import CameraErrors
from octo_arm_model.experiment.compare import ModelComparison, StepComparison
from octo_arm_model.experiment.identification import Identification, rank
from octo_arm_model.experiment.observations import MeasuredShape
from octo_arm_model.experiment.steady_windows import LOADING, REST, UNLOADING
from octo_arm_model.experiment.unknowns import is_of_arm
from octo_arm_model.reproduce.figures import LINES
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.rod.stations import interpolated

if TYPE_CHECKING:
    from octo_arm_model.experiment.estimates import Moment, Touch


def save_all(
    pictures: Mapping[str, Callable[[], Any]], folder: Path, progress: Callable[[int, int], None]
) -> None:
    """Call ``pictures``, each of which makes a figure, and write them to ``folder`` by name.

    ``progress`` is called with the numbers of pictures done and of all.

    Raises:
        OSError: if a file cannot be written.
    """
    for done, (name, picture) in enumerate(pictures.items()):
        progress(done, len(pictures))
        save(picture(), folder / f'{name}.png')


def save(figure: Any, path: Path) -> None:
    """Write a ``figure`` to ``path``, a PNG whatever its ending.

    Raises:
        OSError: if it cannot be written.
    """
    figure.savefig(path, format='png', dpi=120, bbox_inches='tight', pad_inches=0.1)


def tension_colours(shapes: Sequence[MeasuredShape]) -> Any:
    """Return the colours of steps by the sum of tensions, from zero to that of ``shapes``."""
    highest = max(shape.tension for shape in shapes)
    return ScalarMappable(Normalize(0.0, max(highest, 1e-9)), 'viridis')


_MEASURED = '0.15'
_FRAME_COLOUR = '0.78'
# An arm farther out of the main plane than this part of the length has a second view.
_FLAT = 0.05
_MOST_FRAMES = 30
_MANY, _BINS = 40, 10  # steps from which on errors have medians, and bins of tension for these
_MOMENTS = 12  # moments of a motion in one picture
_MARKERS = {LOADING: ('^', True, 'loading'), UNLOADING: ('v', False, 'unloading')}


def pictures_of_comparison(comparisons: Sequence[ModelComparison]) -> dict[str, Callable[[], Any]]:
    """Return functions that draw the pictures of ``comparisons``, by name, for `save_all`.

    A motion has one picture with a few shapes, and one of the tip over time.
    """
    views, moving = _Views(comparisons), comparisons[0]
    if moving.moves:
        few = moving.steps[:: -(-len(moving.steps) // _MOMENTS)]
        return {
            'moments': lambda: _draw_all([replace(moving, steps=few)], views),
            'tip_over_time': lambda: _draw_tip(moving),
        }
    steps: dict[int, list[tuple[ModelComparison, StepComparison]]] = {}
    for comparison in comparisons:
        for step in comparison.steps:
            steps.setdefault(step.number, []).append((comparison, step))
    pictures: dict[str, Callable[[], Any]] = {
        f'step_{number:02}': functools.partial(_draw_step, shown, views)
        for number, shown in sorted(steps.items())
    }
    pictures['all_steps'] = lambda: _draw_all(comparisons, views)
    pictures['error_over_tension'] = lambda: _draw_errors(comparisons)
    return pictures


class _Views:
    """Orthographic views of all steps, to one scale: from the side, and from above if not flat."""

    def __init__(self, comparisons: Sequence[ModelComparison]) -> None:
        """Choose views that show all points of solutions and measurements."""
        steps = [step for one in comparisons for step in one.steps]
        parts = [part for step in steps for part in (step.measured, step.backbone.position)]
        self._origin = steps[0].backbone.position[0]
        away = np.concatenate(parts) - self._origin
        # Axes are the base's tangent and the main direction of bending, upwards as in the paper.
        tangent = axes_of(steps[0].backbone.quaternion[0])[:, 0]
        across = away - np.outer(away @ tangent, tangent)
        first = np.linalg.svd(across, full_matrices=False)[2][0]
        first = first if (across @ first).sum() > 0.0 else -first
        second = np.cross(tangent, first)
        is_flat = np.abs(across @ second).max() < _FLAT * comparisons[0].length
        self._axes = np.array([tangent, first] if is_flat else [tangent, first, second])
        shown = 1e3 * away @ self._axes.T
        margin = 0.06 * np.ptp(shown, axis=0).max()
        self._ends = np.stack([shown.min(axis=0) - margin, shown.max(axis=0) + margin], axis=1)

    def flat(self, points: FloatArray, view: int) -> FloatArray:
        """Project ``points`` (n, 3) [m] to a ``view``, (2, n) [mm]."""
        return 1e3 * self._axes[[0, view + 1]] @ (points - self._origin).T

    def panels(self, columns: int, width: float) -> tuple[Any, Any]:
        """Return a figure with equal axes: a row for each view, ``columns`` of ``width`` [in]."""
        size = np.ptp(self._ends, axis=1)
        # Labels and margins take a part of the width, and have a height.
        inside = width - 0.15 - 0.65 / columns
        height = inside * float(size[1:].sum() / size[0]) + 1.0 + 0.15 * len(size)
        figure = Figure(figsize=(width * columns, height), layout='compressed')
        like: dict[str, Any] = {'squeeze': False, 'sharex': True, 'sharey': 'row'}
        panels = figure.subplots(len(size) - 1, columns, height_ratios=size[1:], **like)
        names = ('bending direction [mm]', 'across both [mm]')
        for (view, _), panel in np.ndenumerate(panels):
            panel.set(xlim=self._ends[0], ylim=self._ends[view + 1], aspect='equal')
            panel.set(xlabel='along the base [mm]', ylabel=names[view])
            panel.label_outer()
            panel.grid(alpha=0.3)
            panel.set_axisbelow(True)
        return figure, panels


def _draw_step(shown: Sequence[tuple[ModelComparison, StepComparison]], views: _Views) -> Any:
    """Draw the midlines of one step: a column for each model, a row for each view."""
    figure, panels = views.panels(len(shown), 7.0 if len(shown) == 1 else 5.2)
    shape = shown[0][1].shape
    left_out = f', {shape.outliers} left out' if shape.outliers else ''
    figure.suptitle(
        f'Step {shown[0][1].number}: {shape.tension:.2f} N, {shape.frames} frames{left_out}'
    )
    for column, (comparison, step) in enumerate(shown):
        for view, panel in enumerate(panels[:, column]):
            _draw_view(panel, comparison, step, functools.partial(views.flat, view=view))
        name = 'mean' if np.isnan(step.errors.tip) else 'tip'
        percent = 100.0 * getattr(step.errors, name) / comparison.length
        panels[0, column].set_title(
            f'{comparison.model}, {name} error {percent:.1f} % of L', fontsize='medium'
        )
        panels[0, column].legend(loc='best', frameon=False)
    return figure


def _draw_view(
    panel: Any,
    comparison: ModelComparison,
    step: StepComparison,
    flat: Callable[[FloatArray], FloatArray],
) -> None:
    """Draw one model and the measurement; ``flat`` projects their points."""
    lines, s = step.shape.lines, step.shape.s
    label: str | None = 'frames'
    for line in lines[:: max(1, len(lines) // _MOST_FRAMES)]:
        style = '.' if len(line) == 1 or s is not None else '-'
        shown = flat(comparison.alignment.to_base(line))
        panel.plot(*shown, style, color=_FRAME_COLOUR, linewidth=0.6, zorder=1, label=label)
        label = None
    position, colour = step.backbone.position, LINES[comparison.model]['color']
    # Dotted lines connect the tips, or the markers and the points of the model there.
    there = position[-1:] if s is None else interpolated(s, step.backbone.s, position)
    seen = step.measured[-1:] if s is None else step.measured
    for pair in zip(flat(there).T, flat(seen).T, strict=True):
        panel.plot(*np.stack(pair).T, ':', color=colour, zorder=2)
    model: dict[str, Any] = {'color': colour, 'linewidth': 2.2, 'marker': 'o', 'zorder': 3}
    panel.plot(*flat(position), **model, markevery=[-1], label='model')
    measured: dict[str, Any] = {'color': _MEASURED, 'linewidth': 1.6, 'marker': 's', 'zorder': 5}
    measured |= {'linestyle': ''} if s is not None else {'dashes': (4, 2), 'markevery': [-1]}
    panel.plot(*flat(step.measured), **measured, markersize=5, label='measured')


def _draw_all(comparisons: Sequence[ModelComparison], views: _Views) -> Any:
    """Draw all measured and modelled midlines: a column for each model, a row for each view."""
    figure, panels = views.panels(len(comparisons), 5.2)
    colours = tension_colours([step.shape for one in comparisons for step in one.steps])
    for column, comparison in enumerate(comparisons):
        for step in comparison.steps:
            is_line = step.shape.s is None and len(step.measured) > 1
            style: dict[str, Any] = {'color': _MEASURED, 'linewidth': 1.1, 'markersize': 4.0}
            for view, panel in enumerate(panels[:, column]):
                model = views.flat(step.backbone.position, view)
                panel.plot(*model, color=colours.to_rgba(step.shape.tension))
                panel.plot(*views.flat(step.measured, view), '--' if is_line else 's', **style)
        what = 'dashes' if is_line else 'squares'
        title = f'{comparison.model} (colour) and measured ({what})'
        panels[0, column].set_title(title, fontsize='medium')
    figure.colorbar(colours, ax=panels, label='sum of tensions [N]', pad=0.01)
    return figure


def _draw_tip(moving: ModelComparison) -> Any:
    """Draw the measured and the modelled tip over time, and the distance between them."""
    figure = Figure(figsize=(9.0, 6.4), layout='constrained')
    tips, errors = figure.subplots(2, 1, sharex=True)
    steps = [step for step in moving.steps if np.isfinite(step.errors.tip)]
    time = [step.shape.window.start for step in steps]
    for axis, name in enumerate('xyz'):
        (line,) = tips.plot(time, [step.backbone.tip[axis] for step in steps], label=name)
        measured = [step.measured[-1, axis] for step in steps]
        tips.plot(time, measured, '.', color=line.get_color(), markersize=3.0)
    errors.plot(time, [1e3 * step.errors.tip for step in steps])
    tips.set(title='The model (lines) and measured (dots)')
    in_millimetres(tips.yaxis, 'tip')
    errors.set(xlabel='time [s]', ylabel='error of the tip [mm]')
    errors.set_ylim(bottom=0.0)
    for panel in (tips, errors):
        panel.grid(alpha=0.3)
    tips.legend(frameon=False)
    return figure


def _draw_errors(comparisons: Sequence[ModelComparison]) -> Any:
    """Draw the errors of the steps over their tensions, signed and unsigned."""
    errors = {
        'signed error of the tip [% of L]': [one.bend_percent for one in comparisons],
        'error of the tip [% of L]': [one.percent('tip') for one in comparisons],
        'mean error of the midline [% of L]': [one.percent('mean') for one in comparisons],
    }
    drawn = {name: rows for name, rows in errors.items() if np.isfinite(rows[0]).any()}
    figure = Figure(figsize=(5.7 * len(drawn), 4.8), layout='constrained')
    panels = figure.subplots(1, len(drawn), squeeze=False)[0]
    for panel, (name, rows) in zip(panels, drawn.items(), strict=True):
        for comparison, percent in zip(comparisons, rows, strict=True):
            _draw_points(panel, comparison, percent)
        panel.set(xlabel='sum of tensions [N]', ylabel=name)
        panel.grid(alpha=0.3)
        panel.legend(frameon=False, fontsize='small')
        if name.startswith('signed'):
            panel.axhline(0.0, color='0.5', linewidth=0.8, zorder=0)
            panel.set_title('> 0: the arm bends farther than the model', fontsize='medium')
        else:
            panel.set_ylim(bottom=0.0)
    return figure


def _draw_points(panel: Any, comparison: ModelComparison, percent: FloatArray) -> None:
    """Draw the errors of one model, with a line for each direction in which steps were reached.

    Of many steps the line goes through the medians of bins of tension, whatever the direction.
    """
    colour = LINES[comparison.model]['color']
    # The paper's two models agree for one section: the first is drawn wider.
    width = 1.6 if comparison.model != 'renda2012' else 4.0
    known = np.isfinite(percent)
    tension = np.array([step.shape.tension for step in comparison.steps])[known]
    directions = np.array([step.direction for step in comparison.steps])[known]
    percent, directions = percent[known], np.where(directions == REST, LOADING, directions)
    is_many = len(percent) > _MANY
    for direction in dict.fromkeys(directions):
        marker, is_full, label = _MARKERS.get(direction, ('o', True, str(direction)))
        at = np.flatnonzero(directions == direction)
        at = at[np.argsort(tension[at], kind='stable')]
        style = {'color': colour, 'markerfacecolor': colour if is_full else 'white'}
        if is_many:
            style |= {'linestyle': '', 'alpha': 0.4, 'markersize': 3.0}
        else:
            style |= {'linewidth': width, 'markersize': 5.0 + width}
            style |= {'label': f'{comparison.model}, {label}'}
        panel.plot(tension[at], percent[at], marker=marker, **style)
    if is_many:
        bins = np.array_split(np.argsort(tension, kind='stable'), _BINS)
        medians = [[np.median(values[part]) for part in bins] for values in (tension, percent)]
        text = f'{comparison.model}, medians of {len(bins[0])} steps'
        panel.plot(*medians, 's-', color=colour, linewidth=width, label=text)


_FEW = 2  # points of a shape that has no residuals along the arm, such as a tip


def pictures_of_fit(fitted: Sequence[Identification]) -> dict[str, Callable[[], Any]]:
    """Return functions that draw the pictures of the ``fitted`` models, by name."""
    pictures: dict[str, Callable[[], Any]] = {}
    # Units of the parameters that any model has a value for, without poses and zeros.
    units = {
        name: estimate.unit
        for one in fitted
        for name, estimate in one.estimates.items()
        if is_of_arm(name) and estimate.value is not None
    }
    if units:
        pictures['intervals'] = lambda: _draw_intervals(fitted, units)
    known = [one for one in fitted if one.after is not None]
    if known and known[0].trajectory is not None:
        return pictures | pictures_of_comparison([one.comparison for one in known])
    if known and all(len(shape.points) > _FEW for shape in known[0].shapes):
        pictures['residuals_along_s'] = lambda: _draw_residuals(known)
    return pictures


def _draw_intervals(fitted: Sequence[Identification], units: Mapping[str, str]) -> Any:
    """Draw a panel for each parameter: estimates of all models with their intervals."""
    size = 1.6 + 4.6 * len(units), 1.7 + 0.6 * len(fitted)
    figure = Figure(figsize=size, layout='constrained')
    panels = figure.subplots(1, len(units), squeeze=False, sharey=True)[0]
    for panel, (name, unit) in zip(panels, units.items(), strict=True):
        for row, one in enumerate(fitted):
            estimate = one.estimates.get(name)
            if estimate is None or estimate.value is None:
                continue
            low, high = estimate.interval95 or (estimate.value, estimate.value)
            text = f'{low:.6g}' if low == high else f'{low:.6g} to {high:.6g}'
            colour = LINES[one.model]['color']
            panel.plot(estimate.value, row, 'o', color=colour, markersize=6.0)
            ends: dict[str, Any] = {'linewidth': 2.5, 'markersize': 14.0, 'markeredgewidth': 1.5}
            if low < high:
                panel.plot((low, high), (row, row), '-|', color=colour, **ends)
            place: dict[str, Any] = {'xytext': (0, 9), 'textcoords': 'offset points'}
            place |= {'ha': 'center', 'fontsize': 'small', 'annotation_clip': False}
            panel.annotate(text, (estimate.value, row), **place)
        panel.set(xlabel=f'{name} [{unit}]')
        panel.locator_params(axis='x', nbins=5)
        panel.grid(alpha=0.3)
        panel.margins(x=0.2, y=0.3)
    misfits = ['' if one.after is None else f'\n{rank(one) * 1e3:.3f} mm' for one in fitted]
    rows = [one.model + misfit for one, misfit in zip(fitted, misfits, strict=True)]
    panels[0].set_yticks(range(len(fitted)), rows)
    panels[0].invert_yaxis()
    figure.suptitle('95 % intervals by model, with its left-out misfit')
    return figure


def _draw_residuals(fitted: Sequence[Identification]) -> Any:
    """Draw residuals over s by tension: a column for each model, a row for each base axis."""
    figure = Figure(figsize=(4.4 * len(fitted) + 1.0, 6.6), layout='constrained')
    panels = figure.subplots(3, len(fitted), squeeze=False, sharex=True, sharey=True)
    colours = tension_colours(fitted[0].shapes)
    for column, one in enumerate(fitted):
        base = Config.from_parameters(one.parameters).base.rotation
        for step in one.comparison.steps:
            away = base.inv().apply(step.away)
            style = '-' if step.shape.s is None else 'o:'
            colour = colours.to_rgba(step.shape.tension)
            for row in range(3):
                panels[row, column].plot(1e3 * step.s, 1e3 * away[:, row], style, color=colour)
        for panel, axis in zip(panels[:, column], ('t, along the base', 'n', 'b'), strict=True):
            panel.axhline(0.0, color='0.6', linewidth=0.8, zorder=0)
            panel.grid(alpha=0.3)
            panel.set(xlabel='s [mm]', ylabel=f'{axis} [mm]')
            panel.label_outer()
        panels[0, column].set_title(one.model, fontsize='medium')
    figure.colorbar(colours, ax=panels, label='sum of tensions [N]', pad=0.01)
    figure.suptitle('Measured less fitted midline, in the frame of the base')
    return figure


_BAND = 1.96  # standard deviations on either side that hold 95 %
_COLOURS = ('tab:red', 'tab:green', 'tab:blue')
_MOST = 4000  # number of times drawn


def draw_estimate(
    moments: Sequence[Moment], touches: Sequence[Touch], camera: CameraErrors | None
) -> Any:
    """Draw contact force and tip position over time, and errors against a ``camera``, if any."""
    moments = moments[:: max(1, len(moments) // _MOST)]
    time = np.array([one.time for one in moments])
    has_force = any(np.isfinite(one.wrench[0]) for one in moments)
    rows = 1 + has_force + (camera is not None)
    figure = Figure(figsize=(9.0, 0.6 + 2.4 * rows), layout='constrained')
    panels = list(np.atleast_1d(figure.subplots(rows, 1, sharex=True)))
    if has_force:
        panel = panels[0]
        values = 1e3 * np.array([one.wrench[:3] for one in moments])
        _draw_bands(panel, time, values, 1e3 * np.array([m.wrench_stddev[:3] for m in moments]))
        panel.set_ylabel('force of the contact [mN]')
        panel.set_title('Estimate and 95 % bands; shaded: touched', fontsize='medium')
        for touch in touches:
            panel.axvspan(touch.start, touch.stop, color='0.9', zorder=0)
    tip = np.array([one.tip for one in moments])
    panel = panels[has_force]
    deviations = 1e3 * np.array([one.tip_stddev for one in moments])
    _draw_bands(panel, time, 1e3 * (tip - tip[0]), deviations)
    panel.set_ylabel('tip, from its first place [mm]')
    if camera is not None:
        panel = panels[-1]
        for values, label, colour in zip(
            camera.tip, ('estimated', 'from the tensions alone'), ('tab:blue', '0.6'), strict=True
        ):
            panel.plot(camera.time, 1e3 * values, '.', markersize=3, color=colour, label=label)
        panel.set_ylabel('error of the tip\nagainst the camera [mm]')
        panel.set_yscale('log')
        panel.legend(frameon=False, fontsize='small')
    panels[-1].set_xlabel('time [s]')
    for panel in panels:
        panel.grid(alpha=0.3)
    return figure


def _draw_bands(panel: Any, time: Any, values: Any, stddev: Any) -> None:
    """Draw three components with their 95 % bands."""
    for axis, colour, value, width in zip('xyz', _COLOURS, values.T, _BAND * stddev.T):
        panel.plot(time, value, color=colour, linewidth=1.0, label=axis)
        panel.fill_between(time, value - width, value + width, color=colour, alpha=0.2, lw=0)
    panel.legend(frameon=False, fontsize='small', ncols=3)
