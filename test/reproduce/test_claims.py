"""Claims of the paper, and the quantities of shapes that they are judged by."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from octo_arm_model import MODELS, Pose, Solver
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE
from octo_arm_model.reproduce import tables
from octo_arm_model.reproduce.claims import CLAIMS


@pytest.mark.parametrize('claim', CLAIMS, ids=lambda claim: claim.where)
def test_every_claim_of_the_paper_holds_for_its_own_model(claim):
    assert tuple(claim.findings) == MODELS
    assert not claim.fails, claim.findings['renda2012']


def test_the_law_gives_the_captions_of_figure_11():
    planes = [tables.law(tensions) for tensions in BENDING.values()]
    assert_allclose(planes, [135.0, -30.0, 60.0])


def test_a_plane_is_measured_about_the_base_wherever_that_is(table2):
    turned = Pose((1.0, 2.0, 3.0), (0.5, -0.5, 0.5, 0.5))
    shapes = [
        Solver(table2.arm, 'exact', base=base).solve(BENDING['C']) for base in (Pose(), turned)
    ]
    for shape in shapes:
        assert tables.bending_plane(shape) == pytest.approx(60.0, abs=1e-3)
        assert tables.out_of_plane(shape) < 1e-6
    distances = [tables.tip_distance(shape) for shape in shapes]
    assert distances[0] == pytest.approx(distances[1])


def test_turns_of_sections_are_integrals_of_the_curvature(model):
    shape = tables.solve('table4', model, FETCHING_IN_PLANE)
    turns = tables.turns(shape)
    assert tuple(turns) == (3, 2, 1)
    rate = np.rad2deg(shape.k * (1.0 + shape.q))
    for section, turn in turns.items():
        at = shape.section == section
        # Without the interval after the anchorage, where the curvature jumps.
        assert turn == pytest.approx(np.sum(rate[at]) * shape.s[1], rel=0.03)
