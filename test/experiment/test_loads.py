"""Steps of one load."""

from __future__ import annotations

import itertools

import numpy as np
from experiments import one_tendon

from octo_arm_model.experiment.uncertainty import MOST_FOLDS, folds_of, loaded, steps_by_load


def test_repeats_are_one_load_up_to_two_per_cent_of_the_highest_tension() -> None:
    tensions = np.array([one_tendon(tension) for tension in (0.0, 1.0, 2.0, 1.03, 4.0, 0.05)])
    loads = steps_by_load(tensions)
    assert loads == [[0, 5], [1, 3], [2], [4]]
    assert [loaded(tensions, load) for load in loads] == [False, True, True, True]
    other = np.array([[2.0, 0.0], [0.0, 2.0]])
    assert steps_by_load(other) == [[0], [1]]


def test_many_loads_are_left_out_in_groups_and_repeats_stay_together() -> None:
    loads = [[number, number + 30] for number in range(30)]
    folds = folds_of(loads)
    assert len(folds) == MOST_FOLDS
    assert sorted(itertools.chain.from_iterable(folds)) == list(range(60))
    assert folds[0] == [0, 20, 30, 50]
