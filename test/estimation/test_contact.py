"""The external wrench of an estimate: the same whichever way the state holds it."""

import math

import numpy as np
import pytest
from estimation_arms import LIKELY, RUBBER, TENSIONS, rubber

from octo_arm_model import Loads, Solver
from octo_arm_model.arm.loads import DistributedLoad, PointLoad
from octo_arm_model.estimation.estimate import contact_of
from octo_arm_model.estimation.estimator import Filter
from octo_arm_model.estimation.measurements import Markers, Tensions
from octo_arm_model.estimation.unknowns import PointForce, Unknowns, Walk

TENSION = Walk(5.0, 1.0)
LENGTH = RUBBER.length
AREA = 0.5 * (0.015 + 0.006) * LENGTH  # of a cone, from the side [m^2]
CURRENT = Walk.stationary(5.0, 1.0)  # [Pa]
KINDS = {
    'tip': Unknowns(TENSION, tip_force=LIKELY),
    'point': Unknowns(TENSION, point_forces=(PointForce(0.12, LIKELY),)),
    'current': Unknowns(TENSION, current=CURRENT),
    'none': Unknowns(TENSION),
}


def estimated(kind, measurements=()):
    return Filter(rubber(KINDS[kind])).add(0.0, [Tensions(TENSIONS, 0.01), *measurements])


def test_nothing_is_estimated_where_no_force_is_unknown():
    assert contact_of(estimated('none'), RUBBER) is None


@pytest.mark.parametrize('kind', ['tip', 'point', 'current'])
def test_without_more_than_tensions_the_force_keeps_its_prior(kind):
    contact = contact_of(estimated(kind), RUBBER)
    np.testing.assert_allclose(contact.wrench, 0.0, atol=1e-12)
    scale = CURRENT.stddev * AREA if kind == 'current' else LIKELY.stddev
    deviation = np.sqrt(contact.covariance.diagonal())
    np.testing.assert_allclose(deviation, [scale] * 3 + [0.0] * 3, rtol=1e-9)
    assert contact.is_at_tip == (kind == 'tip')
    expected = {'tip': LENGTH, 'point': 0.12, 'current': math.nan}[kind]
    np.testing.assert_equal(contact.s, expected)


FORCE = np.array([1e-3, -4e-3, 8e-3])  # in all [N]
LOADS = {
    'tip': Loads(tip_force=tuple(FORCE)),
    'point': Loads(points=(PointLoad(0.12, tuple(FORCE)),)),
    # Per length in proportion to the diameter, which falls linearly.
    'current': Loads(
        distributed=(
            DistributedLoad((0.0, LENGTH), tuple(tuple(FORCE * d / AREA) for d in (0.015, 0.006))),
        )
    ),
}


@pytest.mark.parametrize('kind', ['tip', 'point', 'current'])
def test_what_pushes_the_arm_is_found_in_newtons(kind):
    shape = Solver(RUBBER, 'exact', 31, loads=LOADS[kind]).solve([TENSIONS])
    seen = [10, 20, 30]
    markers = Markers(shape.s[seen], shape.position[seen], 1e-5)
    contact = contact_of(estimated(kind, [markers]), RUBBER)
    deviation = np.sqrt(contact.covariance.diagonal()[:3])
    # What is learnt of the force along the arm is little.
    assert (np.abs(contact.wrench[:3] - FORCE) < 3.0 * deviation + 1e-4).all()
    assert deviation.min() < 0.1 * LIKELY.stddev
