"""The paper's figures with all three models. Needs matplotlib.

Each function draws on a figure, or on a part of one, as wide as the text of the page. Axes are
those of the paper's fixed frame: the base at the origin with t = (1, 0, 0), n = (0, -1, 0) and
b = (0, 0, -1).
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import FigureBase

from octo_arm_model.config.paper_data import (
    BENDING,
    FETCHING_IN_PLANE,
    FETCHING_IN_SPACE,
    PROTOTYPE_ERRORS,
    PROTOTYPE_IN_FIGURE_9,
)
from octo_arm_model.reproduce import cases
from octo_arm_model.reproduce.claims.results_claims import PLANES
from octo_arm_model.reproduce.plotting import (
    LINES,
    add_legend,
    draw_plane,
    draw_space,
    label_axes,
    limits,
    mark,
)
from octo_arm_model.reproduce.tables import UNKNOWN_TENSIONS
from octo_arm_model.rod.solver import MODELS


def figure_8(figure: FigureBase) -> None:
    """The arm of section 5.1, at tensions of our choice."""
    grid = figure.subplots(
        2, 2, sharex=True, sharey=True,
        gridspec_kw={'left': 0.075, 'right': 0.985, 'bottom': 0.12, 'top': 0.85,
                     'wspace': 0.06, 'hspace': 0.3},
    )  # fmt: skip
    for axes, tension in zip(grid.flat, UNKNOWN_TENSIONS, strict=True):
        draw_plane(axes, 'fem', cases.pull(1, (tension, 0.0, 0.0, 0.0), 1))
        axes.set_title(f'$T_{{11}}$ = {tension:g} N', pad=3)
    label_axes(grid)
    add_legend(figure, body=True)


def figure_9(figure: FigureBase) -> None:
    """The prototype of section 5.2, at 3 N and at the tensions of Table 1."""
    left, right = figure.subplots(
        1, 2, sharex=True, sharey=True,
        gridspec_kw={'left': 0.075, 'right': 0.985, 'bottom': 0.15, 'top': 0.82,
                     'wspace': 0.06},
    )  # fmt: skip
    draw_plane(left, 'prototype', cases.pull(1, (PROTOTYPE_IN_FIGURE_9, 0.0, 0.0, 0.0), 1))
    left.set_title(f'Figure 9: $T_{{11}}$ = {PROTOTYPE_IN_FIGURE_9:g} N', pad=3)
    for tension in PROTOTYPE_ERRORS:
        pulled = cases.pull(1, (tension, 0.0, 0.0, 0.0), 1)
        draw_plane(right, 'prototype', pulled, body=False)
        tips = np.array([cases.solve('prototype', model, pulled).tip[:2] for model in MODELS])
        right.annotate(
            f'{tension:.2f}', (tips[:, 0].mean() * 1e3, tips[:, 1].min() * 1e3), xytext=(0, -4),
            textcoords='offset points', ha='center', va='top', rotation=90, fontsize=7,
        )  # fmt: skip
    right.set_title('Table 1: $T_{11}$ [N] at the tip', pad=3)
    left.set(xlim=(-12.0, 292.0), ylim=(-178.0, 25.0))
    label_axes(np.array([[left, right]]))
    add_legend(figure, body=True)


def figure_10(figure: FigureBase) -> None:
    """Bending planes and the ratio of the tensions that make them."""
    axes = figure.add_axes((0.15, 0.09, 0.7, 0.84))
    reach = 0.0
    for plane in PLANES:
        pulled = cases.pull(1, cases.pair(plane), 3)
        for model in MODELS:
            points = cases.seen_from_tip(cases.solve('table2', model, pulled)) * 1e3
            axes.plot(*points.T, **LINES[model])
            reach = max(reach, float(np.hypot(*points.T).max()))
    for plane in PLANES:
        angle = np.deg2rad(plane)
        place = np.array([1.4, 1.33]) * reach * (np.cos(angle), np.sin(angle))
        axes.annotate(
            f'${plane}$°\n{_ratio(plane)}', place, ha='center', va='center', fontsize=7,
            linespacing=1.2,
        )  # fmt: skip
    axes.set(
        xlabel='along $b$ [mm]', ylabel='along $-n$ [mm]', aspect='equal',
        xlim=(-1.68 * reach, 1.68 * reach), ylim=(-1.5 * reach, 1.5 * reach),
        xticks=range(-100, 101, 50), yticks=range(-100, 101, 50),
    )  # fmt: skip
    add_legend(figure)


def _ratio(plane: int) -> str:
    """The pulled cables of section 1 and the ratio of their tensions, as mathtext."""
    tensions = cases.pair(plane)
    names = {j: f'T_{{1{j}}}' for j in (1, 3, 2, 4) if tensions[j - 1] > 0.0}
    if len(names) == 1:
        return f'${"".join(names.values())}$ alone'
    steep = round(float(np.rad2deg(np.arcsin(tensions[0] + tensions[2]))))
    ratio = {30: r'1:\sqrt{3}', 45: '1:1', 60: r'\sqrt{3}:1'}[steep]
    return f'${":".join(names.values())}={ratio}$'


def figure_11(figure: FigureBase) -> None:
    """Three planes of bending, in space and seen from the tip."""
    for column, (panel, tensions) in enumerate(BENDING.items()):
        plane = cases.law(tensions)
        in_space = figure.add_axes(
            (0.005 + 0.333 * column, 0.475, 0.32, 0.47), projection='3d', computed_zorder=False
        )
        draw_space(in_space, 'table2', tensions, (20.0, -60.0))
        in_space.set_title(f'({panel}) ${plane:.0f}$°', pad=-2, y=0.97)
        axes = figure.add_axes((0.085 + 0.312 * column, 0.095, 0.275, 0.355))
        ray = np.array([0.0, 210.0])
        axes.plot(ray * np.cos(np.deg2rad(plane)), ray * np.sin(np.deg2rad(plane)), ':',
                  color='0.5', linewidth=0.9)  # fmt: skip
        for model in MODELS:
            shape = cases.solve('table2', model, tensions)
            axes.plot(*(cases.seen_from_tip(shape) * 1e3).T, **LINES[model])
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
        2, 2, sharex=True,
        gridspec_kw={'left': 0.095, 'right': 0.985, 'bottom': 0.135, 'top': 0.91, 'wspace': 0.26,
                     'hspace': 0.12},
    )  # fmt: skip
    labels = {
        'tau': 'torsion $\\tau$ [1/m]',
        'xi': 'curvature $\\xi$ about $n$ [1/m]',
        'k': 'curvature $k$ about $b$ [1/m]',
        'q': 'longitudinal strain $q$ [–]',
    }
    for axes, (name, label) in zip(grid.flat, labels.items(), strict=True):
        for model in MODELS:
            shape = cases.solve('table2', model, BENDING['A'])
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
    shapes = [cases.solve('table4', model, FETCHING_IN_SPACE) for model in MODELS]
    low, high = limits(shapes)
    for place, (across, up) in {
        (0.085, 0.56): (0, 2), (0.085, 0.08): (0, 1), (0.57, 0.08): (2, 1),
    }.items():  # fmt: skip
        axes = figure.add_axes((*place, 0.4, 0.375))
        for model, shape in zip(MODELS, shapes, strict=True):
            points = shape.position[:, [across, up]] * 1e3
            axes.plot(*points.T, **LINES[model])
            mark(axes, shape, points, model)
        axes.set(
            xlabel=f'{"xyz"[across]} [mm]', ylabel=f'{"xyz"[up]} [mm]', aspect='equal',
            xlim=(low[across], high[across]), ylim=(low[up], high[up]),
        )  # fmt: skip
    add_legend(figure, anchorages=True)
