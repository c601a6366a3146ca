"""Style of the figures, and functions that draw shapes. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.paper_data import Tensions
from octo_arm_model.reproduce import cases
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import MODELS

# Of decreasing width, so that the lower lines stay visible where models agree.
LINES: dict[str, dict[str, Any]] = {
    'renda2012': {'color': 'black', 'linewidth': 1.6},
    'closed_form': {'color': '#e69f00', 'linewidth': 1.1, 'dashes': (3.0, 2.0)},
    'exact': {'color': '#0072b2', 'linewidth': 1.2},
}
_BODY = '0.88'
STYLE: Any = {
    'font.family': 'STIXGeneral',
    'mathtext.fontset': 'stix',
    'font.size': 8.5,
    'axes.labelsize': 8.5,
    'axes.titlesize': 8.5,
    'xtick.labelsize': 7.5,
    'ytick.labelsize': 7.5,
    'legend.fontsize': 8.5,
    'legend.frameon': False,
    'axes.linewidth': 0.6,
    'axes.grid': True,
    'axes.axisbelow': True,
    'grid.color': '0.9',
    'grid.linewidth': 0.5,
    'xtick.major.width': 0.6,
    'ytick.major.width': 0.6,
    # Identifiers in SVG files are derived from this, so that equal figures give equal files.
    'svg.hashsalt': 'octo_arm_model',
}


def limits(shapes: Iterable[Backbone]) -> tuple[FloatArray, FloatArray]:
    """Limits of x, y and z [mm] that contain all shapes, of one length."""
    points = np.concatenate([shape.position for shape in shapes]) * 1e3
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = (low + high) / 2.0, 0.54 * float((high - low).max())
    return middle - half, middle + half


def draw_plane(axes: Any, preset: str, tensions: Tensions, body: bool = True) -> None:
    """A shape in the x-y plane by every model, with the body of the paper's."""
    if body:
        shape = cases.solve(preset, 'renda2012', tensions)
        radius = cases.solver(preset, 'renda2012').arm.body.radius(shape.s)
        axes.add_collection(_silhouette(shape, radius))
    for model in MODELS:
        shape = cases.solve(preset, model, tensions)
        points = shape.position[:, :2] * 1e3
        axes.plot(*points.T, **LINES[model])
        if body:
            mark(axes, shape, points, model)
    axes.set_aspect('equal')


def _silhouette(shape: Backbone, radius: FloatArray) -> PolyCollection:
    """Body of a shape in the x-y plane [mm], its thickness to scale."""
    along = np.gradient(shape.position[:, :2], axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    across *= (radius / np.linalg.norm(across, axis=1))[:, np.newaxis]
    one, other = (1e3 * (shape.position[:, :2] + side * across) for side in (1.0, -1.0))
    faces = np.stack([one[:-1], one[1:], other[1:], other[:-1]], axis=1)
    return PolyCollection(list(faces), facecolor=_BODY, edgecolor=_BODY, linewidth=0.3)


def draw_space(axes: Any, preset: str, tensions: Tensions, view: tuple[float, float]) -> None:
    """A shape in space by every model, its axes to one scale, from elevation and azimuth."""
    shapes = [cases.solve(preset, model, tensions) for model in MODELS]
    for model, shape in zip(MODELS, shapes, strict=True):
        axes.plot(*(shape.position * 1e3).T, **LINES[model])
        mark(axes, shape, shape.position * 1e3, model)
    for name, low, high in zip('xyz', *limits(shapes)):
        axes.set(**{f'{name}lim': (low, high)})
        getattr(axes, f'set_{name}label')(f'{name} [mm]', labelpad=-7)
        getattr(axes, f'{name}axis').set_tick_params(pad=-3, labelsize=6.5)
        getattr(axes, f'{name}axis').pane.set_facecolor('white')
    axes.zaxis.set_rotate_label(False)
    axes.zaxis.label.set_rotation(90.0)
    axes.set_box_aspect((1, 1, 1), zoom=0.92)
    axes.view_init(*view)
    axes.locator_params(nbins=4)


def mark(axes: Any, shape: Backbone, points: FloatArray, model: str) -> None:
    """A square at the base, dots at the anchorages, the tip among them."""
    colour = LINES[model]['color']
    axes.plot(*points[[0]].T, 's', color='black', markersize=3)
    axes.plot(*points[cases.anchorages(shape)].T, 'o', color=colour, markersize=2.6)


def label_axes(grid: Any) -> None:
    """Labels x and y [mm] along the outside of a ``grid`` (rows, columns) of axes."""
    for axes in grid[-1]:
        axes.set_xlabel('x [mm]')
    for axes in grid[:, 0]:
        axes.set_ylabel('y [mm]')


def add_legend(
    figure: FigureBase, *, body: bool = False, anchorages: bool = False, law: bool = False
) -> None:
    """Add a legend of one row above the axes."""
    handles: list[Any] = [Line2D([], [], label=model, **LINES[model]) for model in MODELS]
    if body:
        handles.append(Line2D([], [], color=_BODY, linewidth=6.0, label='body (renda2012)'))
    if anchorages:
        handles.append(
            Line2D([], [], color='0.3', marker='o', markersize=2.6, linestyle='',
                   label='anchorages and tip')
        )  # fmt: skip
    if law:
        handles.append(Line2D([], [], color='0.5', linestyle=':', label='the paper’s law'))
    figure.legend(
        handles=handles, loc='upper center', ncols=len(handles), borderaxespad=0.1,
        handlelength=2.2, columnspacing=1.8,
    )  # fmt: skip
