"""Load cells: gain, noise, resolution, losses and seeds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octo_arm_model.simulation.load_cells import LoadCells, SimulatedLoadCells


def readings(load_cells: LoadCells, tension: float, count: int) -> np.ndarray:
    cells = SimulatedLoadCells(load_cells, 4)
    read = [cells.read(np.full(4, tension)) for _ in range(count)]
    return np.array([np.full(4, np.nan) if one is None else one for one in read])


def test_noise_has_its_standard_deviation_and_no_bias() -> None:
    noise = readings(LoadCells(noise_stddev=0.1), 5.0, 5000) - 5.0
    # Four standard errors of 20000 values.
    assert abs(noise.mean()) < 4.0 * 0.1 / np.sqrt(noise.size)
    assert abs(noise.std() - 0.1) < 4.0 * 0.1 / np.sqrt(2 * noise.size)


def test_slack_tendons_read_what_noise_makes_of_them_negative_ones_included() -> None:
    slack = readings(LoadCells(noise_stddev=0.1), 0.0, 1000)
    assert 0.4 < (slack > 0.0).mean() < 0.6
    assert 0.4 < (slack < 0.0).mean() < 0.6
    assert slack.std() == pytest.approx(0.1, rel=0.05)


def test_a_gain_stays_what_it_was_drawn_and_is_in_proportion() -> None:
    cells = LoadCells(gain_stddev=0.1)
    low, high = readings(cells, 1.0, 5), readings(cells, 10.0, 5)
    assert (low == low[0]).all()
    assert len(set(low[0])) == 4
    np.testing.assert_allclose(high, 10.0 * low, rtol=1e-12)


@given(st.floats(0.0, 50.0), st.floats(1e-3, 5.0))
def test_readings_are_the_nearest_multiples_of_the_resolution(tension, resolution) -> None:
    reading = readings(LoadCells(resolution=resolution), tension, 1)[0, 0]
    assert abs(reading - tension) <= 0.5 * resolution * (1.0 + 1e-9)
    assert reading / resolution == pytest.approx(round(reading / resolution), abs=1e-9)


def test_noise_is_quantised_not_quantisation_noisy() -> None:
    read = readings(LoadCells(noise_stddev=0.3, resolution=0.5), 5.0, 50)
    np.testing.assert_array_equal(read, 0.5 * np.round(read / 0.5))
    assert len(np.unique(read)) > 2


def test_as_many_readings_are_lost_as_the_probability_says() -> None:
    lost = np.isnan(readings(LoadCells(drop_probability=0.3), 1.0, 5000)[:, 0])
    assert abs(lost.mean() - 0.3) < 4.0 * np.sqrt(0.3 * 0.7 / lost.size)
    assert np.isnan(readings(LoadCells(drop_probability=1.0), 1.0, 20)).all()


def test_a_seed_draws_the_same_again_and_another_something_else() -> None:
    cells = LoadCells(gain_stddev=0.1, noise_stddev=0.1, drop_probability=0.3, seed=7)
    first = readings(cells, 1.0, 100)
    np.testing.assert_array_equal(first, readings(cells, 1.0, 100))
    again = SimulatedLoadCells(LoadCells(seed=3), 4)
    again.read(np.ones(4))
    again.change(cells)
    assert [again.read(np.ones(4)) is None for _ in range(100)] == np.isnan(first[:, 0]).tolist()
    other = readings(LoadCells(gain_stddev=0.1, noise_stddev=0.1, seed=8), 1.0, 100)
    assert not np.isin(other, first).any()


def test_switching_losses_on_leaves_the_noise_as_it_was() -> None:
    all_of_them = readings(LoadCells(noise_stddev=0.1), 1.0, 200)
    some = readings(LoadCells(noise_stddev=0.1, drop_probability=0.5), 1.0, 200)
    kept = ~np.isnan(some[:, 0])
    assert 50 < kept.sum() < 150
    np.testing.assert_array_equal(some[kept], all_of_them[kept])
