"""Draw the comparison: shapes, errors over tension and convergence of the meshes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from cases import CASES
from compare import MODELS, solve_models
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

_COLOURS = dict(zip(MODELS, ('tab:red', 'tab:orange', 'tab:blue', 'tab:green')))
_APART = 0.11  # least distance of labelled tips, over the length
_DASHES = dict(zip(MODELS, ('-', '--', '-', ':')))


def draw(results: dict[str, Any], folder: Path) -> Iterator[Path]:
    """Draw ``results`` into ``folder`` and yield the path of each picture."""
    for name, figure in (
        ('shapes', _shapes(results['cases'])),
        ('errors', _errors(results['cases'])),
        ('meshes', _meshes(results['cases'])),
    ):
        FigureCanvasAgg(figure)
        path = folder / f'{name}.png'
        figure.savefig(path, dpi=110)
        yield path


def _panels(cases: dict[str, Any], title: str, height: float = 5.2) -> tuple[Figure, Any]:
    figure = Figure(figsize=(1.0 + 4.6 * len(cases), height), layout='constrained')
    figure.suptitle(title)
    return figure, figure.subplots(1, len(cases), squeeze=False)[0]


def _shapes(cases: dict[str, Any]) -> Figure:
    figure, panels = _panels(cases, 'Midlines: elements (grey, thick) and models', 3.9)
    case_of_name = {case.name: case for case in CASES}
    for axes, (name, case) in zip(panels, cases.items()):
        models = solve_models(case_of_name[name], case['tensions_N'])
        # Horizontal axis t of the base, vertical axis in the plane of bending.
        ends = np.array(case['midlines_mm'])[:, -1, 1:]
        direction = ends[-1] / np.linalg.norm(ends[-1])
        labelled = np.full(2, np.inf)
        for number, midline in enumerate(np.array(case['midlines_mm'])):
            axes.plot(
                midline[:, 0],
                midline[:, 1:] @ direction,
                color='0.1',
                lw=4.5,
                alpha=0.45,
                label=None if number else 'elements',
            )
            for model, backbones in models.items():
                path = 1e3 * backbones[number].position
                axes.plot(
                    path[:, 0],
                    path[:, 1:] @ direction,
                    _DASHES[model],
                    color=_COLOURS[model],
                    lw=1.2,
                    label=None if number else model,
                )
            tip = np.array([midline[-1, 0], midline[-1, 1:] @ direction])
            if np.linalg.norm(tip - labelled) > _APART * np.abs(case['midlines_mm']).max():
                labelled = tip
                load = ', '.join(f'{t:.3g}' for t in case['tensions_N'][number])
                axes.annotate(
                    f'{load} N', tip, textcoords='offset points', xytext=(5, 2), fontsize=8
                )
        axes.set(title=name, xlabel='along t of the base [mm]', aspect='equal')
        axes.grid(alpha=0.3)
        axes.margins(x=0.05, y=0.12)
        axes.set_xlim(right=1.25 * axes.get_xlim()[1])
    panels[0].set_ylabel('across [mm]')
    figure.legend(*panels[0].get_legend_handles_labels(), loc='outside lower center', ncols=5)
    return figure


def _errors(cases: dict[str, Any]) -> Figure:
    figure, panels = _panels(cases, 'Distance of the tip of models from that of elements')
    for axes, (name, case) in zip(panels, cases.items()):
        loads = _norms(case['tensions_N'])
        for model, errors in case['tip_error_percent'].items():
            axes.plot(
                loads, errors, _DASHES[model], marker='o', ms=4, color=_COLOURS[model], label=model
            )
        variant = case['variants'].get('tendon kept in its section')
        if variant:
            for model in ('renda2012', 'exact'):
                axes.plot(
                    _norms(variant['loads']),
                    variant['tip_error_percent'][model],
                    marker='x',
                    ls='none',
                    color=_COLOURS[model],
                    ms=8,
                    label=f'{model}, tendon kept in its section',
                )
        axes.fill_between(
            loads,
            0.0,
            case['mesh_error_percent'],
            color='0.5',
            alpha=0.5,
            label='error of the mesh',
        )
        axes.set(title=name, xlabel='tension [N]', ylabel='% of the length')
        axes.set_xlim(left=0.0)
        axes.set_ylim(bottom=0.0)
        axes.grid(alpha=0.3)
    figure.legend(*panels[0].get_legend_handles_labels(), loc='outside lower center', ncols=4)
    return figure


def _meshes(cases: dict[str, Any]) -> Figure:
    figure, panels = _panels(cases, 'Distance of the tip from that of the mesh with most unknowns')
    case_of_name = {case.name: case for case in CASES}
    for axes, (name, case) in zip(panels, cases.items()):
        length = 1e3 * case_of_name[name].arm.length
        order = sorted(case['meshes'], key=lambda mesh: case['meshes'][mesh]['unknowns'])
        tips = np.array([case['meshes'][mesh]['tips_mm'] for mesh in order])
        unknowns = [case['meshes'][mesh]['unknowns'] for mesh in order]
        distances = 100.0 * np.linalg.norm(tips - tips[-1], axis=-1) / length
        for number, load in enumerate(case['tensions_N']):
            label = ', '.join(f'{t:.3g}' for t in load)
            axes.loglog(unknowns[:-1], distances[:-1, number], 'o-', label=f'{label} N')
        for mesh, count, height in zip(order[:-1], unknowns, distances.max(axis=1)):
            axes.annotate(
                mesh,
                (count, height),
                textcoords='offset points',
                xytext=(0, 7),
                ha='center',
                fontsize=8,
            )
        axes.set(
            title=f'{name}: to mesh {order[-1]} ({unknowns[-1]} unknowns)',
            xlabel='unknowns',
            ylabel='% of the length',
        )
        axes.grid(alpha=0.3, which='both')
        axes.margins(0.15)
        axes.legend(fontsize=8)
    return figure


def _norms(tensions: list[list[float]]) -> list[float]:
    return [float(np.linalg.norm(load)) for load in tensions]
