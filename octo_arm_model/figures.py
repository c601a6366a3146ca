"""The paper's Figures 10, 11, 12, 14 and 15, from its Tables 2 to 5.

The axes are the paper's fixed frame: the base at the origin with t = (1, 0, 0), n = (0, -1, 0)
and b = (0, 0, -1). Needs matplotlib.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from octo_arm_model.backbone import Backbone
from octo_arm_model.config import load_config
from octo_arm_model.hints import FloatArray
from octo_arm_model.paper import (
    BENDING,
    FETCHING_IN_PLANE,
    FETCHING_IN_SPACE,
    Tensions,
    preset_path,
)
from octo_arm_model.solver import Solver

# Enough for the coiled tip to look as smooth as it is.
_STATIONS = 401
_SECTION_COLOURS = {0: '0.5', 1: 'tab:red', 2: 'tab:green', 3: 'tab:blue'}


def draw_all(folder: Path, model: str) -> Iterator[Path]:
    """Draw every figure into ``folder`` and yield the path of each as it is done."""
    bending = load_config(preset_path('renda2012_table2')).solver(model, _STATIONS)
    fetching = load_config(preset_path('renda2012_table4')).solver(model, _STATIONS)
    for name, figure in (
        ('figure_10', _figure_10(bending)),
        ('figure_11', _figure_11(bending)),
        ('figure_12', _figure_12(bending)),
        ('figure_14', _figure_14(fetching)),
        ('figure_15', _figure_15(fetching)),
    ):
        path = folder / f'{name}.png'
        FigureCanvasAgg(figure)
        figure.savefig(path, dpi=120)
        yield path


def bending_angle(tensions: Tensions) -> float:
    """Angle of the bending plane by the paper's law [rad], for one loaded section.

    It is measured in the axes b and -n of the base (section 6.1, Fig. 10).
    """
    t1, t2, t3, t4 = tensions[0]
    return float(np.arctan2(t3 - t1, t2 - t4))


def _figure_10(solver: Solver) -> Figure:
    figure = Figure(figsize=(7.0, 7.0), layout='constrained')
    axes = figure.add_subplot()
    cases = {  # tensions of section 1 [N] at every 30 degrees of the plane
        degrees: _pair(np.deg2rad(degrees)) for degrees in range(-150, 181, 30)
    }
    for degrees, tensions in cases.items():
        tip = solver.solve((tensions, (0.0,) * 4, (0.0,) * 4)).position
        # Along b = (0, 0, -1) and -n = (0, 1, 0) of the base.
        along_b, along_minus_n = -tip[:, 2] * 1e3, tip[:, 1] * 1e3
        axes.plot(along_b, along_minus_n, color='tab:blue')
        angle = np.deg2rad(degrees)
        reach = 1.18 * float(np.hypot(along_b, along_minus_n).max())
        pulled = [f'T1{j + 1} = {t:.2g}' for j, t in enumerate(tensions) if t > 1e-9]
        axes.annotate(
            f'{degrees}\N{DEGREE SIGN}\n' + '\n'.join(pulled),
            (reach * np.cos(angle), reach * np.sin(angle)),
            ha='center', va='center', fontsize=8,
        )  # fmt: skip
    axes.set(
        title='Figure 10: bending planes and tensions [N], seen along the arm',
        xlabel='along b [mm]', ylabel='along -n [mm]', aspect='equal',
    )  # fmt: skip
    axes.margins(0.22)
    axes.grid(alpha=0.3)
    return figure


def _pair(angle: float) -> tuple[float, float, float, float]:
    """Tensions of amplitude 1 N whose bending plane lies at ``angle`` [rad]."""
    along_b, along_minus_n = np.cos(angle), np.sin(angle)
    return (
        max(0.0, -along_minus_n), max(0.0, along_b), max(0.0, along_minus_n), max(0.0, -along_b),
    )  # fmt: skip


def _figure_11(solver: Solver) -> Figure:
    figure = Figure(figsize=(13.0, 8.5), layout='constrained')
    figure.suptitle('Figure 11: three planes of bending, in space and seen along the arm')
    for column, (letter, tensions) in enumerate(BENDING.items(), start=1):
        backbone = solver.solve(tensions)
        angle = bending_angle(tensions)
        in_space = figure.add_subplot(2, 3, column, projection='3d')
        _draw_in_space(in_space, backbone, f'({letter}) {np.rad2deg(angle):.0f}\N{DEGREE SIGN}')
        axes = figure.add_subplot(2, 3, 3 + column)
        ray = np.linspace(0.0, 220.0, 2)
        axes.plot(ray * np.cos(angle), ray * np.sin(angle), '--', color='0.6', label='the law')
        for section, points in _by_section(backbone):
            axes.plot(-points[:, 2], points[:, 1], color=_SECTION_COLOURS[section], lw=2.5,
                      label=f'section {section}')  # fmt: skip
        axes.set(xlabel='along b [mm]', ylabel='along -n [mm]', aspect='equal',
                 xlim=(-180.0, 180.0), ylim=(-180.0, 180.0))  # fmt: skip
        axes.grid(alpha=0.3)
    axes.legend(loc='lower left')
    return figure


def _figure_12(solver: Solver) -> Figure:
    backbone = solver.solve(BENDING['A'])
    figure = Figure(figsize=(10.0, 6.5), layout='constrained')
    figure.suptitle('Figure 12: degrees of freedom along the arm of Figure 11(A)')
    for axes, (label, values) in zip(
        figure.subplots(2, 2, sharex=True).flat,
        (
            ('torsion $\\tau$ [1/m]', backbone.tau),
            ('curvature $\\xi$ about n [1/m]', backbone.xi),
            ('curvature $k$ about b [1/m]', backbone.k),
            ('longitudinal strain $q$ [-]', backbone.q),
        ),
    ):
        axes.plot(backbone.s * 1e3, values, color='tab:blue')
        axes.set(xlabel='s [mm]', ylabel=label)
        axes.grid(alpha=0.3)
    return figure


def _figure_14(solver: Solver) -> Figure:
    backbone = solver.solve(FETCHING_IN_PLANE)
    figure = Figure(figsize=(8.0, 5.0), layout='constrained')
    axes = figure.add_subplot()
    for section, points in _by_section(backbone):
        axes.plot(points[:, 0], points[:, 1], color=_SECTION_COLOURS[section], lw=2.5,
                  label=f'section {section}')  # fmt: skip
    _mark_ends(axes, backbone, (0, 1))
    axes.set(title=f'Figure 14: fetching in one plane, {_distance(backbone)}',
             xlabel='x [mm]', ylabel='y [mm]', aspect='equal')  # fmt: skip
    axes.grid(alpha=0.3)
    axes.legend()
    return figure


def _figure_15(solver: Solver) -> Figure:
    backbone = solver.solve(FETCHING_IN_SPACE)
    figure = Figure(figsize=(11.0, 9.0), layout='constrained')
    figure.suptitle(f'Figure 15: fetching in three dimensions, {_distance(backbone)}')
    _draw_in_space(
        figure.add_subplot(2, 2, 1, projection='3d'), backbone, 'in space', (50.0, -40.0)
    )
    names = 'xyz'
    for place, (across, up) in enumerate(((0, 1), (0, 2), (1, 2)), start=2):
        axes = figure.add_subplot(2, 2, place)
        for section, points in _by_section(backbone):
            axes.plot(points[:, across], points[:, up], color=_SECTION_COLOURS[section], lw=2.5,
                      label=f'section {section}')  # fmt: skip
        _mark_ends(axes, backbone, (across, up))
        axes.set(xlabel=f'{names[across]} [mm]', ylabel=f'{names[up]} [mm]', aspect='equal')
        axes.grid(alpha=0.3)
    axes.legend()
    return figure


def _by_section(backbone: Backbone) -> Iterator[tuple[int, FloatArray]]:
    """Points [mm] of each section from the base on, each starting where the last one ended."""
    for section in dict.fromkeys(backbone.section.tolist()):
        stations = np.flatnonzero(backbone.section == section)
        yield section, backbone.position[max(0, stations[0] - 1) : stations[-1] + 1] * 1e3


def _mark_ends(axes: Any, backbone: Backbone, components: tuple[int, ...]) -> None:
    """A square at the base and a dot at the tip."""
    for point, marker in ((backbone.position[0], 's'), (backbone.tip, 'o')):
        axes.plot(*([point[i] * 1e3] for i in components), marker, color='black')


def _draw_in_space(
    axes: Any, backbone: Backbone, title: str, view: tuple[float, float] = (22.0, -75.0)
) -> None:
    """Backbone in space, its axes to one scale, seen from elevation and azimuth [deg]."""
    for section, points in _by_section(backbone):
        axes.plot(*points.T, color=_SECTION_COLOURS[section], lw=2.5)
    _mark_ends(axes, backbone, (0, 1, 2))
    points = backbone.position * 1e3
    centre, reach = (points.max(0) + points.min(0)) / 2, np.ptp(points, axis=0).max() / 2
    for name, middle in zip('xyz', centre):
        axes.set(
            **{f'{name}lim': (middle - reach, middle + reach), f'{name}label': f'{name} [mm]'}
        )
    axes.set_box_aspect((1, 1, 1), zoom=0.85)
    axes.view_init(*view)
    axes.locator_params(nbins=4)
    axes.set_title(title)


def _distance(backbone: Backbone) -> str:
    distance = np.linalg.norm(backbone.tip - backbone.position[0]) * 1e3
    return f'tip {distance:.0f} mm from the base'
