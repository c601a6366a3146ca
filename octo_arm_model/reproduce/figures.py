"""The paper's figures with all three models. Needs matplotlib.

Each function draws on a figure, or on a part of one, as wide as the text of the page. Axes are
those of the paper's fixed frame: the base at the origin with t = (1, 0, 0), n = (0, -1, 0) and
b = (0, 0, -1).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D

from octo_arm_model.analysis.drawing import equal_axes
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.paper_data import (
    BENDING,
    FETCHING_IN_PLANE,
    FETCHING_IN_SPACE,
    PROTOTYPE_ERRORS,
    PROTOTYPE_IN_FIGURE_9,
    Tensions,
)
from octo_arm_model.reproduce import tables
from octo_arm_model.reproduce.claims import PLANES
from octo_arm_model.reproduce.tables import UNKNOWN_TENSIONS
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


def draw_plane(axes: Any, preset: str, tensions: Tensions, body: bool = True) -> None:
    """A shape in the x-y plane by every model, with the body of the paper's."""
    if body:
        shape = tables.solve(preset, 'renda2012', tensions)
        radius = tables.solver(preset, 'renda2012').arm.body.radius(shape.s)
        axes.add_collection(_silhouette(shape, radius))
    for model in MODELS:
        shape = tables.solve(preset, model, tensions)
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
    shapes = [tables.solve(preset, model, tensions) for model in MODELS]
    for model, shape in zip(MODELS, shapes, strict=True):
        axes.plot(*(shape.position * 1e3).T, **LINES[model])
        mark(axes, shape, shape.position * 1e3, model)
    for name, ends in zip('xyz', _limits(shapes)):
        axes.set(**{f'{name}lim': ends})
        getattr(axes, f'set_{name}label')(f'{name} [mm]', labelpad=-7)
        getattr(axes, f'{name}axis').set_tick_params(pad=-3, labelsize=6.5)
        getattr(axes, f'{name}axis').pane.set_facecolor('white')
    axes.zaxis.set_rotate_label(False)
    axes.zaxis.label.set_rotation(90.0)
    axes.set_box_aspect((1, 1, 1), zoom=0.92)
    axes.view_init(*view)
    axes.locator_params(nbins=4)


def _limits(shapes: Sequence[Backbone]) -> FloatArray:
    """Ends of the x, y and z axis [mm], (3, 2)."""
    return 1e3 * equal_axes(np.array([shape.position for shape in shapes]), 0.54)


def mark(axes: Any, shape: Backbone, points: FloatArray, model: str) -> None:
    """A square at the base, dots at the anchorages, the tip among them."""
    colour = LINES[model]['color']
    axes.plot(*points[[0]].T, 's', color='black', markersize=3)
    axes.plot(*points[tables.anchorages(shape)].T, 'o', color=colour, markersize=2.6)


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
            Line2D(
                [],
                [],
                color='0.3',
                marker='o',
                markersize=2.6,
                linestyle='',
                label='anchorages and tip',
            )
        )
    if law:
        handles.append(Line2D([], [], color='0.5', linestyle=':', label='the paper’s law'))
    figure.legend(
        handles=handles,
        loc='upper center',
        ncols=len(handles),
        borderaxespad=0.1,
        handlelength=2.2,
        columnspacing=1.8,
    )


def figure_8(figure: FigureBase) -> None:
    """The arm of section 5.1, at tensions of our choice."""
    grid = figure.subplots(
        2,
        2,
        sharex=True,
        sharey=True,
        gridspec_kw={
            'left': 0.075,
            'right': 0.985,
            'bottom': 0.12,
            'top': 0.85,
            'wspace': 0.06,
            'hspace': 0.3,
        },
    )
    for axes, tension in zip(grid.flat, UNKNOWN_TENSIONS, strict=True):
        draw_plane(axes, 'fem', tables.pull(1, (tension, 0.0, 0.0, 0.0), 1))
        axes.set_title(f'$T_{{11}}$ = {tension:g} N', pad=3)
    label_axes(grid)
    add_legend(figure, body=True)


def figure_9(figure: FigureBase) -> None:
    """The prototype of section 5.2, at 3 N and at the tensions of Table 1."""
    left, right = figure.subplots(
        1,
        2,
        sharex=True,
        sharey=True,
        gridspec_kw={'left': 0.075, 'right': 0.985, 'bottom': 0.15, 'top': 0.82, 'wspace': 0.06},
    )
    draw_plane(left, 'prototype', tables.pull(1, (PROTOTYPE_IN_FIGURE_9, 0.0, 0.0, 0.0), 1))
    left.set_title(f'Figure 9: $T_{{11}}$ = {PROTOTYPE_IN_FIGURE_9:g} N', pad=3)
    for tension in PROTOTYPE_ERRORS:
        pulled = tables.pull(1, (tension, 0.0, 0.0, 0.0), 1)
        draw_plane(right, 'prototype', pulled, body=False)
        tips = np.array([tables.solve('prototype', model, pulled).tip[:2] for model in MODELS])
        right.annotate(
            f'{tension:.2f}',
            (tips[:, 0].mean() * 1e3, tips[:, 1].min() * 1e3),
            xytext=(0, -4),
            textcoords='offset points',
            ha='center',
            va='top',
            rotation=90,
            fontsize=7,
        )
    right.set_title('Table 1: $T_{11}$ [N] at the tip', pad=3)
    left.set(xlim=(-12.0, 292.0), ylim=(-178.0, 25.0))
    label_axes(np.array([[left, right]]))
    add_legend(figure, body=True)


def figure_10(figure: FigureBase) -> None:
    """Bending planes and the ratio of the tensions that make them."""
    axes = figure.add_axes((0.15, 0.09, 0.7, 0.84))
    reach = 0.0
    for plane in PLANES:
        pulled = tables.pull(1, tables.pair(plane), 3)
        for model in MODELS:
            points = tables.seen_from_tip(tables.solve('table2', model, pulled)) * 1e3
            axes.plot(*points.T, **LINES[model])
            reach = max(reach, float(np.hypot(*points.T).max()))
    for plane in PLANES:
        angle = np.deg2rad(plane)
        place = np.array([1.4, 1.33]) * reach * (np.cos(angle), np.sin(angle))
        axes.annotate(
            f'${plane}$°\n{ratio_of(plane)}',
            place,
            ha='center',
            va='center',
            fontsize=7,
            linespacing=1.2,
        )
    axes.set(
        xlabel='along $b$ [mm]',
        ylabel='along $-n$ [mm]',
        aspect='equal',
        xlim=(-1.68 * reach, 1.68 * reach),
        ylim=(-1.5 * reach, 1.5 * reach),
        xticks=range(-100, 101, 50),
        yticks=range(-100, 101, 50),
    )
    add_legend(figure)


def ratio_of(plane: int) -> str:
    """The pulled cables of section 1 and the ratio of their tensions, as mathtext."""
    tensions = tables.pair(plane)
    names = {j: f'T_{{1{j}}}' for j in (1, 3, 2, 4) if tensions[j - 1] > 0.0}
    if len(names) == 1:
        return f'${"".join(names.values())}$ alone'
    steep = round(float(np.rad2deg(np.arcsin(tensions[0] + tensions[2]))))
    ratio = {30: r'1:\sqrt{3}', 45: '1:1', 60: r'\sqrt{3}:1'}[steep]
    return f'${":".join(names.values())}={ratio}$'


def figure_11(figure: FigureBase) -> None:
    """Three planes of bending, in space and seen from the tip."""
    for column, (panel, tensions) in enumerate(BENDING.items()):
        plane = tables.law(tensions)
        in_space = figure.add_axes(
            (0.005 + 0.333 * column, 0.475, 0.32, 0.47), projection='3d', computed_zorder=False
        )
        draw_space(in_space, 'table2', tensions, (20.0, -60.0))
        in_space.set_title(f'({panel}) ${plane:.0f}$°', pad=-2, y=0.97)
        axes = figure.add_axes((0.085 + 0.312 * column, 0.095, 0.275, 0.355))
        ray = np.array([0.0, 210.0])
        axes.plot(
            ray * np.cos(np.deg2rad(plane)),
            ray * np.sin(np.deg2rad(plane)),
            ':',
            color='0.5',
            linewidth=0.9,
        )
        for model in MODELS:
            shape = tables.solve('table2', model, tensions)
            axes.plot(*(tables.seen_from_tip(shape) * 1e3).T, **LINES[model])
        axes.plot(0.0, 0.0, 's', color='black', markersize=3)
        axes.set(xlabel='along $b$ [mm]', aspect='equal', xlim=(-200, 200), ylim=(-200, 200))
        axes.locator_params(nbins=5)
        if column == 0:
            axes.set_ylabel('along $-n$ [mm]', labelpad=0)
        else:
            axes.tick_params(labelleft=False)
    add_legend(figure, law=True)


def figure_12(figure: FigureBase) -> None:
    """Degrees of freedom along the arm of Figure 11(A)."""
    grid = figure.subplots(
        2,
        2,
        sharex=True,
        gridspec_kw={
            'left': 0.095,
            'right': 0.985,
            'bottom': 0.135,
            'top': 0.91,
            'wspace': 0.26,
            'hspace': 0.12,
        },
    )
    labels = {
        'tau': 'torsion $\\tau$ [1/m]',
        'xi': 'curvature $\\xi$ about $n$ [1/m]',
        'k': 'curvature $k$ about $b$ [1/m]',
        'q': 'longitudinal strain $q$ [–]',
    }
    for axes, (name, label) in zip(grid.flat, labels.items(), strict=True):
        for model in MODELS:
            shape = tables.solve('table2', model, BENDING['A'])
            axes.plot(shape.s * 1e3, getattr(shape, name), **LINES[model])
        axes.set(ylabel=label, xlim=(0.0, shape.s[-1] * 1e3))
    grid[0, 0].set_ylim(-1.0, 1.0)
    for axes in grid[1]:
        axes.set_xlabel('s [mm]')
    add_legend(figure)


def figure_14(figure: FigureBase) -> None:
    """Fetching in one plane."""
    axes = figure.add_axes((0.085, 0.11, 0.9, 0.79))
    draw_plane(axes, 'table4', FETCHING_IN_PLANE)
    axes.set(xlabel='x [mm]', ylabel='y [mm]')
    add_legend(figure, body=True, anchorages=True)


def figure_15(figure: FigureBase) -> None:
    """Views of fetching in three dimensions."""
    in_space = figure.add_axes((0.53, 0.5, 0.44, 0.45), projection='3d', computed_zorder=False)
    draw_space(in_space, 'table4', FETCHING_IN_SPACE, (30.0, 35.0))
    # Orthographic views: neighbours share an axis.
    shapes = [tables.solve('table4', model, FETCHING_IN_SPACE) for model in MODELS]
    low, high = _limits(shapes).T
    for place, (across, up) in {
        (0.085, 0.56): (0, 2),
        (0.085, 0.08): (0, 1),
        (0.57, 0.08): (2, 1),
    }.items():
        axes = figure.add_axes((*place, 0.4, 0.375))
        for model, shape in zip(MODELS, shapes, strict=True):
            points = shape.position[:, [across, up]] * 1e3
            axes.plot(*points.T, **LINES[model])
            mark(axes, shape, points, model)
        axes.set(
            xlabel=f'{"xyz"[across]} [mm]',
            ylabel=f'{"xyz"[up]} [mm]',
            aspect='equal',
            xlim=(low[across], high[across]),
            ylim=(low[up], high[up]),
        )
    add_legend(figure, anchorages=True)
