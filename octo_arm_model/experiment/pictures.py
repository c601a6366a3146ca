"""Pictures of comparisons, fits and estimates, without a display. Needs matplotlib."""

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
from scipy.spatial.transform import Rotation

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.camera import CameraErrors
from octo_arm_model.experiment.compare import ModelComparison, StepComparison, compare
from octo_arm_model.experiment.fit import shape_residuals
from octo_arm_model.experiment.identification import Identification
from octo_arm_model.experiment.motion import TensionTrajectory
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
    """Draw ``pictures`` that each make a figure; write them to ``folder`` by name.

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
    """Colours of steps by the sum of their tensions, from zero to the largest of ``shapes``."""
    highest = max(shape.tension for shape in shapes)
    return ScalarMappable(Normalize(0.0, max(highest, 1e-9)), 'viridis')


_MEASURED = '0.15'
_FRAME_COLOUR = '0.78'
# Of the length: arms farther out of the main plane have a second view.
_FLAT = 0.05
_MOST_FRAMES = 30
_MOMENTS = 12  # of a motion in one picture
_MARKERS = {LOADING: ('^', True, 'loading'), UNLOADING: ('v', False, 'unloading')}


def pictures_of_comparison(comparisons: Sequence[ModelComparison]) -> dict[str, Callable[[], Any]]:
    """Functions that draw the pictures of ``comparisons``, by name; see `save_all`.

    Of a motion there are few shapes in one picture, and the tip over time.
    """
    axes, moving = _axes(comparisons), comparisons[0]
    if moving.moves:
        limits = _limits(comparisons, axes)
        few = moving.steps[:: -(-len(moving.steps) // _MOMENTS)]
        return {
            'moments': lambda: _draw_all([replace(moving, steps=few)], axes, limits),
            'tip_over_time': lambda: _draw_tip(moving),
        }
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
    parts = [
        part
        for one in comparisons
        for step in one.steps
        for part in (step.measured, step.backbone.position)
    ]
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
    figure = Figure(figsize=(width * columns, height), layout='compressed')
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
        panel.plot(*flat.T, '.' if is_dots else '-', color=_FRAME_COLOUR, linewidth=0.6, zorder=1)
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
        *measured.T,
        color=_MEASURED,
        linewidth=1.6,
        marker='s',
        markersize=5,
        linestyle=(0, (4, 2)) if step.shape.s is None else '',
        markevery=[-1] if step.shape.s is None else None,
        label='measured',
        zorder=5,
    )


def _flatten(points: FloatArray, plane: FloatArray, origin: FloatArray) -> FloatArray:
    """Points (n, 3) [m] from ``origin`` as seen in a ``plane`` (2, 3) [mm], (n, 2)."""
    return 1e3 * (points - origin) @ plane.T


def _draw_all(comparisons: Sequence[ModelComparison], axes: FloatArray, limits: FloatArray) -> Any:
    """Measured midlines over the model's in the arm's own frame: a column for each model."""
    figure, panels = _panels(len(comparisons), limits, 5.2)
    steps = [step for one in comparisons for step in one.steps]
    colours = tension_colours([step.shape for step in steps])
    for column, comparison in enumerate(comparisons):
        is_line = True
        for view, panel in enumerate(panels[:, column]):
            for step in comparison.steps:
                origin, plane = step.backbone.position[0], axes[[0, view + 1]]
                model = _flatten(step.backbone.position, plane, origin)
                panel.plot(*model.T, color=colours.to_rgba(step.shape.tension))
                measured = _flatten(step.measured, plane, origin)
                is_line = step.shape.s is None and len(measured) > 1
                style = '--' if is_line else 's'
                panel.plot(*measured.T, style, color=_MEASURED, linewidth=1.1, markersize=4.0)
        what = 'dashes' if is_line else 'squares'
        title = f'{comparison.model} (colour) and measured ({what})'
        panels[0, column].set_title(title, fontsize='medium')
    figure.colorbar(colours, ax=panels, label='sum of tensions [N]', pad=0.01)
    return figure


def _draw_tip(moving: ModelComparison) -> Any:
    """The tip as measured and of the model over time, and the distance between them."""
    figure = Figure(figsize=(9.0, 6.4), layout='constrained')
    tips, errors = figure.subplots(2, 1, sharex=True)
    steps = [step for step in moving.steps if step.errors.tip is not None]
    time = [step.shape.window.start for step in steps]
    for axis, name in enumerate('xyz'):
        (line,) = tips.plot(time, [step.backbone.tip[axis] for step in steps], label=name)
        measured = [step.measured[-1, axis] for step in steps]
        tips.plot(time, measured, '.', color=line.get_color(), markersize=3.0)
    errors.plot(time, [1e3 * (step.errors.tip or 0.0) for step in steps])
    tips.set(ylabel='tip [m]', title='The model (lines) and measured (dots)')
    errors.set(xlabel='time [s]', ylabel='error of the tip [mm]')
    errors.set_ylim(bottom=0.0)
    for panel in (tips, errors):
        panel.grid(alpha=0.3)
    tips.legend(frameon=False)
    return figure


def _draw_errors(comparisons: Sequence[ModelComparison]) -> Any:
    """Errors of each step over its tensions: signed, in order of time, and unsigned."""
    figure = Figure(figsize=(11.4, 4.8), layout='constrained')
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
                tension[at],
                bend[at],
                marker,
                color=colour,
                markersize=5.0 + width,
                markerfacecolor=colour if is_full else 'white',
                label=f'{comparison.model}, {label}',
            )
        for name, style, label in (('tip', 'o-', 'tip'), ('mean', 'x--', 'mean of midline')):
            percent = comparison.percent(name)
            if not np.isfinite(percent).any():
                continue
            for number, way in enumerate(dict.fromkeys(np.where(ways == REST, LOADING, ways))):
                at = np.flatnonzero((ways == way) | ((ways == REST) & (way == LOADING)))
                at = at[np.argsort(tension[at], kind='stable')]
                plain.plot(
                    tension[at],
                    percent[at],
                    style,
                    color=colour,
                    linewidth=width,
                    markersize=5.0 + width,
                    markerfacecolor='white' if way == UNLOADING else colour,
                    label='' if number else f'{comparison.model}, {label}',
                )
    signed.axhline(0.0, color='0.5', linewidth=0.8, zorder=0)
    signed.set(
        xlabel='sum of tensions [N]',
        ylabel='signed error of the tip [% of L]',
        title='> 0: the arm bends farther than the model',
    )
    plain.set(
        xlabel='sum of tensions [N]',
        ylabel='error [% of L]',
        title='Model against measurement, by steady step',
    )
    plain.set_ylim(bottom=0.0)
    for panel in (signed, plain):
        panel.grid(alpha=0.3)
        panel.legend(frameon=False, fontsize='small')
    return figure


_FEW = 2  # points: tips have no residuals along the arm


def pictures_of_fit(
    fitted: Sequence[Identification],
    shapes: Sequence[MeasuredShape],
    trajectory: TensionTrajectory | None = None,
) -> dict[str, Callable[[], Any]]:
    """Functions that draw the pictures of the ``fitted`` models, by name; see `save_all`."""
    pictures: dict[str, Callable[[], Any]] = {}
    names = _shown(fitted)
    if names:
        pictures['intervals'] = lambda: _draw_intervals(fitted, names)
    known = [one for one in fitted if one.after is not None]
    if trajectory is not None:
        of_motion = [
            compare(shapes, one.parameters, one.model, one.alignment, trajectory=trajectory)
            for one in known
        ]
        return pictures | (pictures_of_comparison(of_motion) if known else {})
    if known and all(len(shape.points) > _FEW for shape in shapes):
        pictures['residuals_along_s'] = lambda: _draw_residuals(known, shapes)
    return pictures


def _shown(fitted: Sequence[Identification]) -> list[str]:
    """Parameters with a value by any model, without poses and zeros."""
    names = dict.fromkeys(name for one in fitted for name in one.estimates)
    return [
        name
        for name in names
        if is_of_arm(name)
        and any(name in one.estimates and one.estimates[name].value is not None for one in fitted)
    ]


def _draw_intervals(fitted: Sequence[Identification], names: Sequence[str]) -> Any:
    """A panel for each parameter: estimates of all models with their intervals."""
    figure = Figure(
        figsize=(1.6 + 4.6 * len(names), 1.7 + 0.6 * len(fitted)), layout='constrained'
    )
    panels = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    for panel, name in zip(panels, names, strict=True):
        for row, one in enumerate(fitted):
            estimate = one.estimates.get(name)
            if estimate is None or estimate.value is None:
                continue
            colour = LINES[one.model]['color']
            panel.plot(estimate.value, row, 'o', color=colour, markersize=6.0)
            text = f'{estimate.value:.6g}'
            if estimate.interval95 is not None:
                low, high = estimate.interval95
                panel.plot(
                    (low, high),
                    (row, row),
                    '-|',
                    color=colour,
                    linewidth=2.5,
                    markersize=14.0,
                    markeredgewidth=1.5,
                )
                text = f'{low:.6g} to {high:.6g}'
            panel.annotate(
                text,
                (estimate.value, row),
                xytext=(0, 9),
                textcoords='offset points',
                ha='center',
                fontsize='small',
                annotation_clip=False,
            )
        panel.set(xlabel=f'{name} [{_unit(fitted, name)}]')
        panel.grid(alpha=0.3)
        panel.margins(x=0.2, y=0.3)
    rows = [_row(one) for one in fitted]
    panels[0].set_yticks(range(len(fitted)), rows)
    panels[0].invert_yaxis()
    figure.suptitle('95 % intervals by model, with its held-back misfit')
    return figure


def _row(one: Identification) -> str:
    misfit = one.cross_validation or one.after
    return one.model if misfit is None else f'{one.model}\n{misfit.rms * 1e3:.3f} mm'


def _unit(fitted: Sequence[Identification], name: str) -> str:
    return next(one.estimates[name].unit for one in fitted if name in one.estimates)


def _draw_residuals(fitted: Sequence[Identification], shapes: Sequence[MeasuredShape]) -> Any:
    """A column for each model, a row for each axis of the base: residuals over s by tension."""
    figure = Figure(figsize=(4.4 * len(fitted) + 1.0, 6.6), layout='constrained')
    panels = figure.subplots(3, len(fitted), squeeze=False, sharex=True, sharey=True)
    colours = tension_colours(shapes)
    for column, one in enumerate(fitted):
        base = Config.from_parameters(one.parameters).base
        comparison = compare(one.with_tensions(shapes), one.parameters, one.model, one.alignment)
        for step in comparison.steps:
            away = _in_base(step, base)
            style = '-' if step.shape.s is None else 'o:'
            colour = colours.to_rgba(step.shape.tension)
            for row in range(3):
                panels[row, column].plot(1e3 * step.s, 1e3 * away[:, row], style, color=colour)
        for row, axis in enumerate(('t, along the base', 'n', 'b')):
            panels[row, column].axhline(0.0, color='0.6', linewidth=0.8, zorder=0)
            panels[row, column].grid(alpha=0.3)
            if not column:
                panels[row, column].set_ylabel(f'{axis} [mm]')
        panels[0, column].set_title(one.model, fontsize='medium')
        panels[-1, column].set_xlabel('s [mm]')
    figure.colorbar(colours, ax=panels, label='sum of tensions [N]', pad=0.01)
    figure.suptitle('Measured less fitted midline, in the frame of the base')
    return figure


def _in_base(step: StepComparison, base: Pose) -> Any:
    """Residuals of a step (m, 3) [m] in the axes t, n and b of the base."""
    away = shape_residuals(step.shape, step.measured, step.backbone)
    return Rotation.from_quat(base.quaternion).inv().apply(away)


_BAND = 1.96  # standard deviations on either side that hold 95 %
_COLOURS = ('tab:red', 'tab:green', 'tab:blue')
_MOST = 4000  # times drawn


def draw_estimate(
    moments: Sequence[Moment], touches: Sequence[Touch], camera: CameraErrors | None
) -> Any:
    """Force of the contact and position of the tip, and errors against a ``camera``, if any."""
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
    """Three components with their bands."""
    for axis, colour, value, width in zip('xyz', _COLOURS, values.T, _BAND * stddev.T):
        panel.plot(time, value, color=colour, linewidth=1.0, label=axis)
        panel.fill_between(time, value - width, value + width, color=colour, alpha=0.2, lw=0)
    panel.legend(frameon=False, fontsize='small', ncols=3)
