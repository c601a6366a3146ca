"""Messages on /clock and requests for parameters that rclpy itself would fail at."""

import itertools

import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import NODES, hosting
from octo_arm_msgs.msg import TendonTensions
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE


@pytest.mark.parametrize('kind', [SetParameters, SetParametersAtomically])
def test_a_parameter_of_no_known_type_is_refused(client, kind):
    name = 'octo_arm/' + (
        'set_parameters' if kind is SetParameters else 'set_parameters_atomically'
    )
    good = Parameter('stations', value=51).to_parameter_msg()
    bad = ParameterMessage(name='stations', value=ParameterValue(type=77))
    answer = client.call(kind, name, kind.Request(parameters=[good, bad, good]))
    if kind is SetParameters:
        assert [result.successful for result in answer.results] == [True, False, True]
        result = answer.results[1]
    else:
        result = answer.result
    assert not result.successful
    assert result.reason == 'stations is of type 77, expected 0 to 9'
    assert client.change(stations=101) == (True, '')


NO_TIMES = [(-5, 0), (-(2**31), 0), (-1, 10**9), (2**31 - 1, 2**32 - 1)]


@pytest.mark.parametrize('kind', ['node', 'simulator'])
def test_a_clock_that_is_no_time_is_refused_and_the_next_one_taken(kind):
    make_node, _ = NODES[kind]
    with hosting(make_node, '-p', 'use_sim_time:=true', node='clocked') as client:
        is_node = kind == 'node'
        topic = 'backbone/path' if is_node else 'tendon_tensions'
        heard = client.answers[topic] if is_node else client.hear(TendonTensions, topic)
        clock = client.node.create_publisher(Clock, '/clock', 10)
        later = itertools.count(0, 1_000_000)  # [ns]

        def publish(sec, nanosec):
            message = Clock()
            message.clock.sec, message.clock.nanosec = sec, nanosec
            clock.publish(message)

        def stamped_with(sec, nanosec, expected):
            for bad in NO_TIMES:
                publish(*bad)
                client.spin(0.02)
            # The simulator measures when time goes on.
            publish(sec, nanosec + next(later))
            if is_node:
                client.send('tendon_tensions/array', FETCHING_IN_PLANE)
            client.spin(0.05)
            return heard and heard[-1].header.stamp.sec == expected

        # Nanoseconds beyond a second, back to before, and the last second there is.
        for sec, nanosec, expected in (
            (5, 4 * 10**9, 9),
            (3, 0, 3),
            (2**31 - 1, 0, 2**31 - 1),
        ):
            client.wait(
                lambda given=(sec, nanosec, expected): stamped_with(*given),
                f'an answer at {sec} s',
            )

        def is_logged():
            # At most one a second is logged, of whichever comes first.
            publish(-5, 0)
            client.spin(0.05)
            return any('/clock refused: it is -5 s' in log.msg for log in client.logs)

        client.wait(is_logged, 'a line in the log')
