"""Corrections that take long: what else the node does in the midst of them, and what ends them."""

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

import functools

from estimator_nodes import FILE, NAMES, TENSIONS
from live_nodes import spin_until
from octo_arm_msgs.msg import BackboneCovariance, TendonTensions
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from octo_arm_model.arm.errors import SolveError
from octo_arm_model.estimation.tracker import Tracker
from octo_arm_model.ros.estimator import server
from octo_arm_model.ros.estimator.lifecycle import ManagedEstimatorNode

TOPIC = 'tendon_tensions'
SECOND = 10**9


class Held:
    """Corrections that end once they may.

    Attributes:
        begun: seconds of the stamps of those that have begun.
        ended: of those that have ended, also where they were abandoned.
        may_end: whether they may.
        error: raised by those that may end, if given.
    """

    def __init__(self):
        self.begun, self.ended, self.may_end, self.error = [], [], False, None
        self._add = Tracker.add

    def add(self, tracker, stamp_ns, measurements, pause=None):
        if pause is None:  # of an arm that is prepared
            return self._add(tracker, stamp_ns, measurements)
        self.begun.append(stamp_ns // SECOND)
        try:
            while not self.may_end:
                pause()
            if self.error is not None:
                raise self.error
            return self._add(tracker, stamp_ns, measurements, pause)
        finally:
            self.ended.append(stamp_ns // SECOND)


@pytest.fixture
def held(monkeypatch):
    held = Held()
    monkeypatch.setattr(Tracker, 'add', lambda *given: held.add(*given))
    monkeypatch.setattr(server, 'SLICE', 0.0)
    return held


class Sensors:
    """Load cells of an active estimator, and who hears what comes of them.

    Attributes:
        node: of the sensors.
        estimator: the node of the estimator.
        answers: seconds of the stamps of its estimates.
    """

    def __init__(self, node, estimator):
        self.node, self.estimator, self.answers = node, estimator, []
        self._publisher = node.create_publisher(TendonTensions, TOPIC, 10)
        node.create_subscription(
            BackboneCovariance,
            'backbone/covariance',
            lambda message: self.answers.append(message.header.stamp.sec),
            10,
        )
        self.connect()

    def connect(self):
        self.wait(lambda: self._publisher.get_subscription_count() == 1)
        self.wait(lambda: self.estimator.count_subscribers('backbone/covariance') == 1)

    def wait(self, condition):
        spin_until(self.node.executor, condition)

    def tell(self, seconds):
        message = TendonTensions(name=NAMES, tension=list(TENSIONS))
        message.header.stamp.sec = seconds
        self._publisher.publish(message)


@pytest.fixture
def sensors(context, make_node, held):
    arguments = ['--ros-args', '--params-file', str(FILE)]
    arguments += ['-p', f'qos_overrides./{TOPIC}.subscription.reliability:=reliable']
    arguments += ['-p', 'tension_stddev:=0.01', '-p', 'stations:=21']
    node = make_node('sensors')
    estimator = ManagedEstimatorNode(
        context=context, cli_args=arguments, use_global_arguments=False
    )
    node.executor.add_node(estimator)
    estimator.on_configure(None)
    estimator.on_activate(None)
    yield Sensors(node, estimator)
    node.executor.remove_node(estimator)
    estimator.destroy_node()


def test_parameters_are_told_in_the_midst_and_messages_wait_for_the_end(sensors, held):
    sensors.tell(1000)
    sensors.wait(lambda: held.begun)
    sensors.tell(1001)
    client = AsyncParameterClient(sensors.node, sensors.estimator.get_name())
    sensors.wait(client.services_are_ready)
    for _ in range(3):
        answer = client.get_parameters(['model'])
        sensors.wait(answer.done)
    assert (held.begun, held.ended) == ([1000], [])
    held.may_end = True
    sensors.wait(lambda: held.ended == [1000, 1001])
    sensors.wait(lambda: sensors.answers == [1000, 1001])


def test_what_fails_after_a_slice_is_refused_and_the_next_is_taken(sensors, held, capfd):
    sensors.tell(1000)
    sensors.wait(lambda: held.begun)
    held.may_end, held.error = True, SolveError('no shape at all')
    sensors.wait(lambda: held.ended)
    held.error = None
    sensors.tell(1001)
    sensors.wait(lambda: sensors.answers == [1001])
    assert '/tendon_tensions refused: no shape at all' in capfd.readouterr().err


def deactivate(sensors):
    sensors.estimator.on_deactivate(None)


def change(name, value, sensors):
    (result,) = sensors.estimator.set_parameters([Parameter(name, value=value)])
    assert result.successful


@pytest.mark.parametrize(
    'end', [deactivate, functools.partial(change, 'estimator.gate', 0.99)], ids=['off', 'other']
)
def test_it_ends_in_the_midst_with_what_it_is_for(sensors, held, end):
    sensors.tell(1000)
    sensors.wait(lambda: held.begun)
    end(sensors)
    assert held.ended == [1000]
    held.may_end = True
    if end is deactivate:
        sensors.estimator.on_activate(None)
        sensors.connect()
    sensors.tell(1001)
    sensors.wait(lambda: sensors.answers == [1001])


def test_it_goes_on_where_what_changes_does_not_concern_it(sensors, held):
    sensors.tell(1000)
    sensors.wait(lambda: held.begun)
    change('diagnostics.silence_limit', 7.0, sensors)
    assert held.ended == []
    held.may_end = True
    sensors.wait(lambda: sensors.answers == [1000])
