"""Pictures of fits: intervals of all models side by side, and residuals along the arm.

Needs matplotlib.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from octo_arm_model.arm.pose import Pose
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.compare import StepComparison, compare
from octo_arm_model.experiment.figure_files import TensionColours, new_figure
from octo_arm_model.experiment.fitting.identification import Identification
from octo_arm_model.experiment.fitting.least_squares.pairing import shape_residuals
from octo_arm_model.experiment.fitting.unknowns.unknown import is_of_arm
from octo_arm_model.experiment.shapes.mean_midlines import MeasuredShape
from octo_arm_model.reproduce.figures import LINES

_FEW = 2  # points: tips have no residuals along the arm


def pictures_of(
    fitted: Sequence[Identification], shapes: Sequence[MeasuredShape]
) -> dict[str, Callable[[], Any]]:
    """Functions that draw the pictures of the ``fitted`` models, by name; see `save_all`."""
    pictures: dict[str, Callable[[], Any]] = {}
    names = _shown(fitted)
    if names:
        pictures['intervals'] = lambda: _draw_intervals(fitted, names)
    known = [one for one in fitted if one.after is not None]
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
    figure = new_figure(1.6 + 4.6 * len(names), 1.7 + 0.6 * len(fitted))
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
                panel.plot((low, high), (row, row), '-|', color=colour, linewidth=2.5,
                           markersize=14.0, markeredgewidth=1.5)  # fmt: skip
                text = f'{low:.6g} to {high:.6g}'
            panel.annotate(
                text, (estimate.value, row), xytext=(0, 9), textcoords='offset points',
                ha='center', fontsize='small', annotation_clip=False,
            )  # fmt: skip
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
    figure = new_figure(4.4 * len(fitted) + 1.0, 6.6)
    panels = figure.subplots(3, len(fitted), squeeze=False, sharex=True, sharey=True)
    colours = TensionColours(shapes)
    for column, one in enumerate(fitted):
        base = Config.from_parameters(one.parameters).base
        comparison = compare(one.with_tensions(shapes), one.parameters, one.model, one.alignment)
        for step in comparison.steps:
            away = _in_base(step, base)
            style = '-' if step.shape.s is None else 'o:'
            colour = colours.of(step.shape)
            for row in range(3):
                panels[row, column].plot(1e3 * step.s, 1e3 * away[:, row], style, color=colour)
        for row, axis in enumerate(('t, along the base', 'n', 'b')):
            panels[row, column].axhline(0.0, color='0.6', linewidth=0.8, zorder=0)
            panels[row, column].grid(alpha=0.3)
            if not column:
                panels[row, column].set_ylabel(f'{axis} [mm]')
        panels[0, column].set_title(one.model, fontsize='medium')
        panels[-1, column].set_xlabel('s [mm]')
    colours.add_bar(figure, panels)
    figure.suptitle('Measured less fitted midline, in the frame of the base')
    return figure


def _in_base(step: StepComparison, base: Pose) -> Any:
    """Residuals of a step (m, 3) [m] in the axes t, n and b of the base."""
    from scipy.spatial.transform import Rotation

    away = shape_residuals(step.shape, step.measured, step.backbone)
    return Rotation.from_quat(base.quaternion).inv().apply(away)
