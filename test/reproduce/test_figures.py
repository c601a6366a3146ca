"""The paper's figures with all models."""

from __future__ import annotations

import re

import numpy as np
import pytest

from octo_arm_model import MODELS
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE
from octo_arm_model.reproduce import cases
from octo_arm_model.reproduce.claims import PLANES

FIGURES = [f'Figure {number}' for number in (8, 9, 10, 11, 12, 14, 15)]


@pytest.mark.parametrize('name', FIGURES)
def test_every_figure_shows_all_models_inside_its_axes(name: str) -> None:
    figure_module = pytest.importorskip('matplotlib.figure')
    from octo_arm_model.reproduce import figures
    from octo_arm_model.reproduce import figures as plotting

    figure = figure_module.Figure(figsize=(6.7, 4.0))
    getattr(figures, name.lower().replace(' ', '_'))(figure)
    figure.draw_without_rendering()
    for axes in figure.axes:
        colours = [line.get_color() for line in axes.lines if len(line.get_xdata()) > 100]
        # The same number of curves by each model.
        assert len({colours.count(style['color']) for style in plotting.LINES.values()}) == 1
        assert colours
        for line in axes.lines:
            # Axes in space are projected: their limits contain all points by `limits`.
            if axes.name != '3d':
                points = axes.transData.transform(line.get_xydata())
                box = axes.bbox.padded(1.0)
                assert box.count_contains(points) == len(points)


@pytest.mark.parametrize('plane', PLANES)
def test_ratios_of_figure_10_are_those_of_the_tensions(plane: int) -> None:
    pytest.importorskip('matplotlib')
    from octo_arm_model.reproduce.figures import _ratio

    tensions = cases.pair(plane)
    pulled = [int(j) - 1 for j in re.findall(r'T_\{1(\d)\}', _ratio(plane))]
    assert sorted(pulled) == [j for j, tension in enumerate(tensions) if tension > 0.0]
    if len(pulled) == 2:
        one, other = re.search(r'=(.*):(.*)\$', _ratio(plane)).groups()
        value = {'1': 1.0, r'\sqrt{3}': 3.0**0.5}
        ratio = tensions[pulled[0]] / tensions[pulled[1]]
        assert value[one] / value[other] == pytest.approx(ratio)


def test_figure_12_has_no_torsion(model: str) -> None:
    assert np.abs(cases.solve('table2', model, BENDING['A']).tau).max() < 1e-9


def test_a_figure_draws_the_backbone_of_the_solver() -> None:
    figure_module = pytest.importorskip('matplotlib.figure')
    from octo_arm_model.reproduce import figures

    figure = figure_module.Figure()
    figures.figure_14(figure)
    curves = [line for line in figure.axes[0].lines if len(line.get_xdata()) > 100]
    for curve, model in zip(curves, MODELS, strict=True):
        expected = cases.solve('table4', model, FETCHING_IN_PLANE).position[:, :2] * 1e3
        np.testing.assert_allclose(curve.get_xydata(), expected, atol=1e-12)
