"""The services solve and find_tensions, over DDS."""

import math

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from octo_arm_msgs.srv import FindTensions, Solve


def test_the_service_solve_answers_like_the_core_and_explains_refusals(loaded):
    request = Solve.Request()
    request.tensions.name = loaded.names
    request.tensions.tension = [0.5, 0.0, 0.0, 0.2]
    request.tip_wrench.force.y = 0.01
    answer = loaded.call(Solve, 'solve', request)
    solver = loaded.config.solver(compiled=None)
    expected = solver.solve([[0.5, 0.0, 0.0, 0.2]], [0, 0.01, 0, 0, 0, 0])
    assert answer.success, answer.message
    np.testing.assert_array_equal(answer.strains.k, expected.k)
    lengths = solver.tendon_lengths(expected).ravel()
    np.testing.assert_allclose(answer.tendon_length, lengths, rtol=1e-12)
    assert len(answer.path.poses) == 101
    assert answer.residual < 1e-10
    request.tensions.tension = [0.5, 0.0, -1.0, 0.2]
    refused = loaded.call(Solve, 'solve', request)
    assert not refused.success
    assert 'tension of tendon_1_3 is -1.0 N' in refused.message


def test_the_service_find_tensions_reaches_what_can_be_reached(loaded):
    solver = loaded.config.solver()
    request = FindTensions.Request(target=FindTensions.Request.TIP_POSITION)
    wanted = solver.solve(loaded.pull).tip
    place = request.tip.position
    place.x, place.y, place.z = wanted.tolist()
    answer = loaded.call(FindTensions, 'find_tensions', request)
    assert answer.success, answer.message
    assert answer.reached
    found = solver.solve(np.reshape(answer.tensions.tension, (1, 4)))
    np.testing.assert_allclose(found.tip, wanted, atol=1e-6)
    place.x = 9.0
    far = loaded.call(FindTensions, 'find_tensions', request)
    assert far.success
    assert not far.reached
    assert far.error > 8.0
    request.highest = [1.0, 2.0]
    refused = loaded.call(FindTensions, 'find_tensions', request)
    assert not refused.success
    assert 'highest has 2 values' in refused.message
    # What no optimiser can begin with is refused, and the node goes on.
    request.highest, request.stiffness = [], 5.0
    request.stiffness_direction.x = math.inf
    refused = loaded.call(FindTensions, 'find_tensions', request)
    assert not refused.success
    assert 'expected three finite numbers' in refused.message
