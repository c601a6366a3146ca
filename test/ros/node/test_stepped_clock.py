"""The clock that stamps are compared with, by the node and by the estimator alike."""

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.ros.estimator.stamps import Stamps
from octo_arm_model.ros.node.diagnostics import SteppedClock
from octo_arm_model.wire.stamp import Stamp

MILLISECOND = 10**6  # [ns]
START = 5000 * 10**9  # [ns]


@pytest.fixture
def node(make_node):
    simulated = [Parameter('use_sim_time', value=True)]
    return make_node('clocked', parameter_overrides=simulated)


@pytest.fixture
def advance(node):
    """Lets the clock of the node be another time [ns]."""
    publisher = node.create_publisher(Clock, '/clock', 10)

    def advance(nanoseconds):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(nanoseconds, 10**9)
        while node.get_clock().now().nanoseconds != nanoseconds:
            publisher.publish(message)
            node.executor.spin_once(timeout_sec=0.1)

    return advance


@pytest.mark.parametrize(('step', 'is_ahead'), [(80, False), (10, True)])
def test_the_estimator_takes_what_the_steps_of_a_coarse_clock_explain(
    node, advance, step, is_ahead
):
    clock = SteppedClock(node)
    stamps = Stamps(clock)
    stamps.ahead = 0.1
    for number in range(3):
        advance(START + number * step * MILLISECOND)
    ahead = Stamp.from_ns(START + (2 * step + 150) * MILLISECOND)
    if is_ahead:
        with pytest.raises(MeasurementError, match='ahead of the clock'):
            stamps.resolve(ahead)
    else:
        assert stamps.resolve(ahead) == ahead
    assert clock.ahead(ahead, clock.now_ns) == pytest.approx(0.15 - 2e-3 * step)


def test_nothing_is_ahead_of_a_time_that_is_not_known_nor_of_the_first_step(node, advance):
    clock = SteppedClock(node)
    stamp = Stamp.from_ns(START + 150 * MILLISECOND)
    assert clock.ahead(stamp, clock.now_ns) == 0.0 and not any(clock.now)
    assert clock.time_of(Stamp(0, 0)) == Stamp(0, 0)
    advance(START)
    assert clock.ahead(stamp, clock.now_ns) == pytest.approx(0.15)
    assert clock.time_of(None) == Stamp.from_ns(START)
