"""`octo-arm identify` and `compare` on a bag of shapes that no model here made, up and down."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import printed
from experiments import (
    bag_of,
    description,
    nanoseconds,
    path_sample,
    staircase,
    tension_samples,
)
from labs import at_any

HELD = (1.0, 2.5, 3.7, 2.5, 1.0)
FRICTION = 0.04
ALONG = np.linspace(0.0, 0.27, 16)


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sheaths take 4 % of the tension while it rises and add as much while it falls."""
    rng = np.random.default_rng(0)
    time, pulled = staircase(HELD, hold=2.0)
    top = time[pulled >= max(HELD)][-1]
    samples = [description(), *tension_samples(time, pulled)]
    for at in np.arange(0.0, time[-1], 0.5):
        tension = np.interp(at, time, pulled) * (1.0 - FRICTION if at <= top else 1.0 + FRICTION)
        points = at_any(tension, ALONG)
        points = points + 2e-4 * rng.standard_normal(points.shape)
        samples.append(path_sample(points, nanoseconds(at)))
    return bag_of(tmp_path_factory.mktemp('bags') / 'lab', samples)


def test_branches_models_and_pictures(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('matplotlib')
    arguments = ['--model', 'closed_form', 'exact', '--clock-offset', '0']
    out, pictures = tmp_path / 'fitted.yaml', tmp_path / 'pictures'
    given = ['--out', str(out), '--pictures', str(pictures), '--json']
    said = printed(capsys, 'identify', str(bag), *arguments, *given)
    notes = ' '.join(said['notes'])
    assert 'loading and unloading differ by more than the noise' in notes
    assert '5 steps are of 3 loads' in notes
    assert 'less bent while loading, as friction or creep does' in notes
    young = said['estimates']['youngs_modulus']
    low, high = young['interval95']
    assert low < 1.1e5 < high
    assert young['interval95_near_models'][0] <= low
    assert young['model_stddev'] > 0.0
    assert 0.0 < said['model_error_floor']
    assert f'model_error_stddev: {said["model_error_stddev"]}'[:26] in out.read_text()
    assert {path.name for path in pictures.iterdir()} == {'intervals.png', 'residuals_along_s.png'}


def test_steps_of_one_load_are_told_apart_by_their_direction(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ['--clock-offset', '0', '--model', 'exact', '--json']
    said = printed(capsys, 'compare', str(bag), *arguments)
    assert [step['direction'] for step in said['steps']] == 3 * ['loading'] + 2 * ['unloading']
    bend = [step['bend_error_percent'] for step in said['steps']]
    # The same tensions, first while they rise: the arm bends less.
    assert all(one < other - 0.5 for one, other in zip(bend[:2], bend[:2:-1], strict=True))
