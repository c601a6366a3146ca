"""The paper's figures with all three models. This needs matplotlib.

Axes are those of the paper's fixed frame: the base is at the origin with t = (1, 0, 0),
n = (0, -1, 0) and b = (0, 0, -1).
"""

import io
from collections.abc import Callable
from functools import partial
from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

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

# The width of lines decreases, so that the lower ones stay visible where models agree.
LINES: dict[str, dict[str, Any]] = {
    'renda2012': {'color': 'black', 'linewidth': 1.6},
    'closed_form': {'color': '#e69f00', 'linewidth': 1.1, 'dashes': (3.0, 2.0)},
    'exact': {'color': '#0072b2', 'linewidth': 1.2},
}
_BODY = '0.88'
_WIDTH = 6.7  # width of the text of the page [in], which is A4 less its margins
_LEGEND = 0.33  # height of the legend above the axes [in]
_STYLE: Any = {
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
    # Identifiers in SVG files are derived from this salt, so that equal figures give equal files.
    'svg.hashsalt': 'octo_arm_model',
}


# Caption of each figure, and what returns it as SVG, by name in the order of the paper.
FIGURES: dict[str, tuple[str, Callable[[], bytes]]] = {}
_Draw = Callable[[Figure], None]


def _figure(height: float, caption: str) -> Callable[[_Draw], _Draw]:
    """Return a decorator that adds a figure [in], which the decorated function draws."""

    def as_svg(draw: _Draw) -> bytes:
        with matplotlib.rc_context(_STYLE):
            figure, file = Figure(figsize=(_WIDTH, height)), io.BytesIO()
            draw(figure)
            _add_legend(figure)
            # The date is left out, so that the same figure gives the same file.
            figure.savefig(file, format='svg', metadata={'Date': None})
        return file.getvalue()

    def add(draw: _Draw) -> _Draw:
        name = draw.__name__.replace('figure_', 'Figure ')
        FIGURES[name] = caption, partial(as_svg, draw)
        return draw

    return add


def _draw(
    axes: Any,
    preset: str,
    tensions: Tensions,
    view: Callable[[Backbone], FloatArray],
    anchorages: bool = False,
) -> None:
    """Draw a shape by every model, with its points [mm] by a ``view`` and a square at the base."""
    for model in MODELS:
        shape = tables.solve(preset, model, tensions)
        points = view(shape)
        axes.plot(*points.T, **LINES[model], label=model)
        if anchorages:
            dots: dict[str, Any] = {'color': LINES[model]['color'], 'markersize': 2.6}
            ends = points[tables.anchorages(shape)]
            axes.plot(*ends.T, 'o', **dots, label='anchorages and tip')
    axes.plot(*points[[0]].T, 's', color='black', markersize=3)


def _from_tip(shape: Backbone) -> FloatArray:
    return 1e3 * tables.seen_from_tip(shape)


def _in_plane(shape: Backbone) -> FloatArray:
    return 1e3 * shape.position[:, :2]


def _draw_body(axes: Any, preset: str, tensions: Tensions) -> None:
    """Draw shapes in the x-y plane, and the body of the paper's model to scale."""
    shape = tables.solve(preset, 'renda2012', tensions)
    radius = tables.solver(preset, 'renda2012').arm.body.radius(shape.s)
    along = np.gradient(shape.position[:, :2], axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    across *= (radius / np.linalg.norm(across, axis=1))[:, np.newaxis]
    left, right = (1e3 * (shape.position[:, :2] + side * across) for side in (1.0, -1.0))
    faces = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
    look: dict[str, Any] = {'facecolor': _BODY, 'edgecolor': _BODY, 'linewidth': 0.3}
    axes.add_collection(PolyCollection(list(faces), **look, label='body (renda2012)'))
    _draw(axes, preset, tensions, _in_plane, anchorages=True)
    axes.set_aspect('equal')


def _draw_space(
    axes: Any, preset: str, tensions: Tensions, elevation: float, azimuth: float
) -> FloatArray:
    """Draw a shape in space with axes of one scale, and return their limits (3, 2) [mm]."""
    _draw(axes, preset, tensions, lambda shape: 1e3 * shape.position, anchorages=True)
    points = [tables.solve(preset, model, tensions).position for model in MODELS]
    limits = 1e3 * equal_axes(np.array(points), 0.54)
    for name, ends in zip('xyz', limits):
        axes.set(**{f'{name}lim': ends})
        getattr(axes, f'set_{name}label')(f'{name} [mm]', labelpad=-7)
        getattr(axes, f'{name}axis').set_tick_params(pad=-3, labelsize=6.5)
        getattr(axes, f'{name}axis').pane.set_facecolor('white')
    axes.zaxis.set_rotate_label(False)
    axes.zaxis.label.set_rotation(90.0)
    axes.set_box_aspect((1, 1, 1), zoom=0.92)
    axes.view_init(elevation, azimuth)
    axes.locator_params(nbins=4)
    return limits


def _add_legend(figure: Figure) -> None:
    """Add a legend in one row above the axes, with each label once."""
    if figure.axes[0].get_subplotspec() is not None:
        top = 1.0 - _LEGEND / figure.get_figheight()
        figure.set_layout_engine('compressed', rect=(0, 0, 1, top))
    handles: dict[str, Any] = dict.fromkeys(MODELS)
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles[label] = handle
    look: dict[str, Any] = {'borderaxespad': 0.1, 'handlelength': 2.2, 'columnspacing': 1.8}
    figure.legend(handles.values(), handles.keys(), loc='upper center', ncols=len(handles), **look)


@_figure(
    2.9,
    'Arm of section 5.1, one cable; the body is true to scale, the tensions above the panels are '
    'ours.',
)
def figure_8(figure: Figure) -> None:
    """Draw the arm of section 5.1 at tensions of our choice."""
    grid = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, tension in zip(grid.flat, UNKNOWN_TENSIONS, strict=True):
        _draw_body(axes, 'fem', tables.one_cable(tension))
        axes.set(title=f'$T_{{11}}$ = {tension:g} N', xlabel='x [mm]', ylabel='y [mm]')
        axes.label_outer()


@_figure(2.75, 'Left, the prototype at 3 N. Right, at each tension of Table 1.')
def figure_9(figure: Figure) -> None:
    """Draw the prototype of section 5.2 at 3 N and at the tensions of Table 1."""
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    _draw_body(left, 'prototype', tables.one_cable(PROTOTYPE_IN_FIGURE_9))
    left.set(title=f'Figure 9: $T_{{11}}$ = {PROTOTYPE_IN_FIGURE_9:g} N', ylabel='y [mm]')
    for tension in PROTOTYPE_ERRORS:
        tensions = tables.one_cable(tension)
        _draw(right, 'prototype', tensions, _in_plane)
        tips = np.array([tables.solve('prototype', model, tensions).tip[:2] for model in MODELS])
        position = 1e3 * tips[:, 0].mean(), 1e3 * tips[:, 1].min() - 4.0
        look: dict[str, Any] = {'ha': 'center', 'va': 'top', 'rotation': 90, 'fontsize': 7}
        right.text(position[0], position[1], f'{tension:.2f}', **look)
    right.set(title='Table 1: $T_{11}$ [N] at the tip', aspect='equal')
    for axes in (left, right):
        axes.set(xlabel='x [mm]', xlim=(-12.0, 292.0), ylim=(-178.0, 25.0))


@_figure(
    4.75,
    'Bending planes and the ratios of the cables’ tensions, seen from the tip: the arm of '
    'Table 2, amplitude 1 N, section 1.',
)
def figure_10(figure: Figure) -> None:
    """Draw bending planes, with the ratio of the tensions of each."""
    axes, reach = figure.subplots(), 0.0
    for plane in PLANES:
        tensions = tables.pull(1, tables.pair(plane), 3)
        _draw(axes, 'table2', tensions, _from_tip)
        shapes = (tables.solve('table2', model, tensions) for model in MODELS)
        reach = max(reach, *(float(np.hypot(*_from_tip(shape).T).max()) for shape in shapes))
    for plane in PLANES:
        angle = np.deg2rad(plane)
        position = np.array([1.4, 1.33]) * reach * (np.cos(angle), np.sin(angle))
        look: dict[str, Any] = {'ha': 'center', 'va': 'center', 'fontsize': 7, 'linespacing': 1.2}
        axes.text(position[0], position[1], f'${plane}$°\n{_ratio_of(plane)}', **look)
    ticks = range(-100, 101, 50)
    axes.set(xlabel='along $b$ [mm]', xlim=(-1.68 * reach, 1.68 * reach), xticks=ticks)
    axes.set(ylabel='along $-n$ [mm]', ylim=(-1.5 * reach, 1.5 * reach), yticks=ticks)
    axes.set_aspect('equal')


def _ratio_of(plane: int) -> str:
    """Return the pulled cables of section 1 and the ratio of their tensions as mathtext."""
    tensions = tables.pair(plane)
    names = {j: f'T_{{1{j}}}' for j in (1, 3, 2, 4) if tensions[j - 1] > 0.0}
    if len(names) == 1:
        return f'${"".join(names.values())}$ alone'
    steep = round(float(np.rad2deg(np.arcsin(tensions[0] + tensions[2]))))
    ratio = {30: r'1:\sqrt{3}', 45: '1:1', 60: r'\sqrt{3}:1'}[steep]
    return f'${":".join(names.values())}={ratio}$'


@_figure(4.4, 'Three planes of bending, tensions of Table 3: in space, and seen from the tip.')
def figure_11(figure: Figure) -> None:
    """Draw three planes of bending, in space and seen from the tip."""
    for column, (panel, tensions) in enumerate(BENDING.items()):
        plane = tables.law(tensions)
        in_space = figure.add_axes(
            (0.005 + 0.333 * column, 0.475, 0.32, 0.47), projection='3d', computed_zorder=False
        )
        _draw_space(in_space, 'table2', tensions, 20.0, -60.0)
        in_space.set_title(f'({panel}) ${plane:.0f}$°', pad=-2, y=0.97)
        axes = figure.add_axes((0.085 + 0.312 * column, 0.095, 0.275, 0.355))
        ray = np.array([[0.0, 0.0], [np.cos(np.deg2rad(plane)), np.sin(np.deg2rad(plane))]])
        axes.plot(*(210.0 * ray).T, ':', color='0.5', linewidth=0.9, label='the paper’s law')
        _draw(axes, 'table2', tensions, _from_tip)
        axes.set(xlabel='along $b$ [mm]', aspect='equal', xlim=(-200, 200), ylim=(-200, 200))
        axes.locator_params(nbins=5)
        if column == 0:
            axes.set_ylabel('along $-n$ [mm]', labelpad=0)
        else:
            axes.tick_params(labelleft=False)


@_figure(3.3, 'Degrees of freedom along the arm of Figure 11(A). By all models the torsion is 0.')
def figure_12(figure: Figure) -> None:
    """Draw the degrees of freedom along the arm of Figure 11(A)."""
    grid = figure.subplots(2, 2, sharex=True)
    labels = {
        'tau': 'torsion $\\tau$ [1/m]',
        'xi': 'curvature $\\xi$ about $n$ [1/m]',
        'k': 'curvature $k$ about $b$ [1/m]',
        'q': 'longitudinal strain $q$ [–]',
    }
    for axes, (name, label) in zip(grid.flat, labels.items(), strict=True):
        for model in MODELS:
            shape = tables.solve('table2', model, BENDING['A'])
            axes.plot(shape.s * 1e3, getattr(shape, name), **LINES[model], label=model)
        axes.set(xlabel='s [mm]', ylabel=label, xlim=(0.0, shape.s[-1] * 1e3))
    grid[0, 0].set(xlabel='', ylim=(-1.0, 1.0))
    grid[0, 1].set(xlabel='')


@_figure(
    4.6,
    'Fetching in one plane: the arm of Table 4, tensions of Table 5; the body is true to scale.',
)
def figure_14(figure: Figure) -> None:
    """Draw fetching in one plane."""
    axes = figure.subplots()
    _draw_body(axes, 'table4', FETCHING_IN_PLANE)
    axes.set(xlabel='x [mm]', ylabel='y [mm]')


@_figure(5.3, 'Views of fetching in three dimensions: the arm of Table 4, tensions of Table 5.')
def figure_15(figure: Figure) -> None:
    """Draw views of fetching in three dimensions."""
    in_space = figure.add_axes((0.53, 0.5, 0.44, 0.45), projection='3d', computed_zorder=False)
    limits = _draw_space(in_space, 'table4', FETCHING_IN_SPACE, 30.0, 35.0)
    # These are orthographic views; neighbours share an axis.
    for corner, pair in (((0.085, 0.56), [0, 2]), ((0.085, 0.08), [0, 1]), ((0.57, 0.08), [2, 1])):
        axes = figure.add_axes((*corner, 0.4, 0.375))

        def view(shape: Backbone, pair: list[int] = pair) -> FloatArray:
            return 1e3 * shape.position[:, pair]

        _draw(axes, 'table4', FETCHING_IN_SPACE, view, anchorages=True)
        across, up = (f'{"xyz"[axis]} [mm]' for axis in pair)
        xlim, ylim = limits[pair]
        axes.set(xlabel=across, ylabel=up, aspect='equal', xlim=xlim, ylim=ylim)
