"""A picture of a workspace: the tips in space and projected along each axis. Needs matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model.analysis.geometry.arm_mesh import Drawing
from octo_arm_model.analysis.workspace import Workspace
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod.solver import Solver

# Orthographic views: neighbours share an axis.
_VIEWS = ((1, 0, 2), (2, 1, 2), (3, 0, 1))  # place, axis across, axis up
_ARM_COLOUR = '0.65'
_SIDES = 24  # of the polygons drawn for cross sections


def draw_workspace(workspace: Workspace, solver: Solver, path: Path | str) -> None:
    """Draw ``workspace`` of the arm of ``solver`` into the PNG file ``path``.

    Each tip has the colour of the sum of its tensions; the arm without tensions is drawn to scale.

    Raises:
        SolveError: if there is no solution without tensions, under the loads of ``solver``.
        OSError: if the file cannot be written.
    """
    # Imported here: matplotlib is optional.
    from matplotlib.figure import Figure

    arm = solver.solve(np.zeros(solver.arm.tension_shape))
    body = Drawing(solver.arm, arm.s, sides=_SIDES)
    skin = 1e3 * body.draw(arm.position, arm.quaternion, arm.q).vertices[body.triangles]
    limits = _limits(workspace, skin)
    figure = Figure(figsize=(11.0, 10.0), layout='constrained')
    reached, refused = len(workspace.tip), workspace.refused
    figure.suptitle(
        f'Tips for {reached} of {reached + refused} sets of tensions, {refused} refused '
        f'(model {arm.model})'
    )
    views = []
    for place, across, up in _VIEWS:
        axes = figure.add_subplot(2, 2, place)
        _draw_view(axes, workspace, skin, [across, up], limits)
        views.append(axes)
    in_space = figure.add_subplot(2, 2, 4, projection='3d')
    cloud = _draw_in_space(in_space, workspace, skin, limits)
    bar = figure.colorbar(cloud, ax=[*views, in_space], shrink=0.6, aspect=40, pad=0.02)
    bar.set_label('sum of tensions [N]')
    # A PNG for any suffix.
    figure.savefig(path, dpi=120, format='png')


def _limits(workspace: Workspace, skin: FloatArray) -> FloatArray:
    """Ends of the x, y and z axis [mm], (3, 2), all of one length."""
    points = np.concatenate([workspace.tip * 1e3, skin.reshape(-1, 3)])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, reach = (low + high) / 2.0, 0.53 * (high - low).max()
    return np.stack([middle - reach, middle + reach], axis=1)


def _style(workspace: Workspace) -> dict[str, Any]:
    """Colours and sizes of the dots: smaller where there are more."""
    total = workspace.tensions.sum(axis=tuple(range(1, workspace.tensions.ndim)))
    # The limits of a colour bar must differ, also for one tip or none.
    low, high = (total.min(), total.max()) if total.size else (0.0, workspace.highest.sum())
    return {
        'c': total,
        's': float(np.clip(2e4 / max(len(total), 1), 1.0, 16.0)),
        'cmap': 'viridis',
        'linewidths': 0.0,
        'vmin': low,
        'vmax': high if high > low else low + 1.0,
    }


def _draw_view(
    axes: Any, workspace: Workspace, skin: FloatArray, pair: list[int], limits: FloatArray
) -> None:
    """Tips and the arm's ``skin`` [mm], (triangles, 3, 3), in the plane of a ``pair`` of axes."""
    from matplotlib.collections import PolyCollection

    faces = list(skin[:, :, pair])
    axes.add_collection(PolyCollection(faces, color=_ARM_COLOUR, linewidth=0.4, zorder=1))
    axes.scatter(*(workspace.tip[:, pair] * 1e3).T, zorder=2, **_style(workspace))
    names = ['xyz'[i] for i in pair]
    axes.set(
        xlabel=f'{names[0]} [mm]', ylabel=f'{names[1]} [mm]', xlim=limits[pair[0]],
        ylim=limits[pair[1]], aspect='equal',
    )  # fmt: skip
    axes.grid(alpha=0.3)
    axes.set_axisbelow(True)


def _draw_in_space(axes: Any, workspace: Workspace, skin: FloatArray, limits: FloatArray) -> Any:
    """Tips and the arm's ``skin`` in space; returns the tips as drawn."""
    triangles = np.arange(3 * len(skin)).reshape(-1, 3)
    axes.plot_trisurf(*skin.reshape(-1, 3).T, triangles=triangles, color=_ARM_COLOUR, shade=True)
    cloud = axes.scatter(*(workspace.tip * 1e3).T, depthshade=False, **_style(workspace))
    for name, ends in zip('xyz', limits):
        axes.set(**{f'{name}lim': ends, f'{name}label': f'{name} [mm]'})
    axes.set_box_aspect((1, 1, 1), zoom=1.0)
    axes.view_init(24.0, -60.0)
    axes.locator_params(nbins=5)
    return cloud
