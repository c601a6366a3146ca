"""The search for tensions of a target."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')


from octo_arm_model import Inverse, TipPosition, find_tensions, load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.simulation.profiles.limits import highest_tensions
from octo_arm_model.viewer import numbers
from octo_arm_model.viewer.commander import TargetSearch

DEADLINE = 30.0  # [s]
CONFIG = load_config(preset_path('renda2012_table4'))
SOLVER = CONFIG.solver()


def test_of_many_targets_the_newest_is_found():
    answers = []
    search = TargetSearch(SOLVER, highest_tensions(CONFIG.arm), answers.append)
    try:
        for x in (0.44, 0.3, 0.2):
            search.request([x, 0.1, -0.1], np.zeros(12))
        last = SOLVER.solve(0.5 * np.array(FETCHING_IN_SPACE)).tip
        search.request(last, np.zeros(12))
        search.close()
        wait_for_end(search)
    finally:
        search.close()
    # Nothing of those left behind.
    assert len(answers) == 1
    assert answers[-1].reached
    np.testing.assert_allclose(answers[-1].backbone.tip, last, atol=1e-6)
    assert 'reached' in numbers.found(answers[-1])
    assert 'out of reach' not in numbers.found(answers[-1])


def test_what_cannot_be_reached_is_not_called_reached():
    answers = []
    search = TargetSearch(SOLVER, highest_tensions(CONFIG.arm), answers.append)
    search.request([0.5, 0.0, 0.0], np.zeros(12))
    search.close()
    wait_for_end(search)
    (answer,) = answers
    assert not answer.reached
    assert answer.error == pytest.approx(0.05, rel=1e-3)
    assert 'out of reach: the nearest found leaves 50.0 mm' in numbers.found(answer)


def test_nonsense_is_told_and_the_search_goes_on():
    answers = []
    search = TargetSearch(SOLVER, highest_tensions(CONFIG.arm), answers.append)
    search.request([np.nan, 0.0, 0.0], np.zeros(12))
    search.close()
    wait_for_end(search)
    assert 'finite' in numbers.failed(answers[0])


def wait_for_end(search):
    search.thread.join(DEADLINE)
    assert not search.thread.is_alive()


def test_a_search_says_nothing_better_than_it_found():
    found = find_tensions(SOLVER, TipPosition([0.3, 0.2, 0.0]), highest_tensions(CONFIG.arm)[0])
    assert isinstance(found, Inverse)
    assert ('out of reach' in numbers.found(found)) == (not found.reached)
