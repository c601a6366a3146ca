"""The paper's figures as pictures."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from octo_arm_model import Config
from octo_arm_model.cli import main
from octo_arm_model.paper import BENDING, FETCHING_IN_PLANE

image = pytest.importorskip('matplotlib.image')
NAMES = [f'figure_{number}.png' for number in (10, 11, 12, 14, 15)]


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('figures') / 'new' / 'folder'
    assert main(['figures', str(folder)]) == 0
    return folder


def test_the_five_figures_are_written(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == NAMES


@pytest.mark.parametrize('name', NAMES)
def test_a_figure_is_a_picture_of_some_size_with_something_on_it(folder: Path, name: str) -> None:
    picture = image.imread(folder / name)[..., :3]
    height, width, _ = picture.shape
    assert min(height, width) > 500
    ink = (picture.min(axis=-1) < 0.9).mean()
    assert 0.005 < ink < 0.6
    # Drawn all over, not in one corner, and in colour.
    rows, columns = np.nonzero(picture.min(axis=-1) < 0.9)
    assert np.ptp(rows) > 0.5 * height
    assert np.ptp(columns) > 0.5 * width
    assert (np.ptp(picture, axis=-1) > 0.3).any()


def test_no_two_figures_are_the_same(folder: Path) -> None:
    assert len({(folder / name).read_bytes() for name in NAMES}) == len(NAMES)


def test_figures_can_be_drawn_from_the_other_model(folder: Path, tmp_path: Path) -> None:
    assert main(['figures', str(tmp_path), '--model', 'closed_form']) == 0
    # One loaded section: the models agree; three: they do not.
    same = {name: (tmp_path / name).read_bytes() == (folder / name).read_bytes() for name in NAMES}
    assert same['figure_10.png']
    assert not same['figure_15.png']


def test_the_bending_angles_are_those_of_the_captions_of_figure_11() -> None:
    from octo_arm_model.figures import bending_angle

    degrees = [math.degrees(bending_angle(tensions)) for tensions in BENDING.values()]
    np.testing.assert_allclose(degrees, [135.0, -30.0, 60.0])


@pytest.mark.parametrize('degrees', range(-150, 181, 30))
def test_the_pair_of_tensions_of_a_plane_is_two_neighbours_of_amplitude_one(degrees: int) -> None:
    from octo_arm_model.figures import _pair, bending_angle

    pair = _pair(math.radians(degrees))
    assert math.degrees(bending_angle((pair,))) == pytest.approx(degrees)
    assert min(pair) == 0.0
    assert math.hypot(*pair) == pytest.approx(1.0)


def test_the_curves_of_a_figure_are_the_sections_of_the_arm_joined(table4: Config) -> None:
    from octo_arm_model.figures import _by_section

    backbone = table4.solver().solve(FETCHING_IN_PLANE)
    sections, curves = zip(*_by_section(backbone))
    assert sections == (3, 2, 1)
    for before, after in itertools.pairwise(curves):
        np.testing.assert_array_equal(before[-1], after[0])
    drawn = np.concatenate([curves[0], *(points[1:] for points in curves[1:])])
    np.testing.assert_array_equal(drawn, backbone.position * 1e3)
