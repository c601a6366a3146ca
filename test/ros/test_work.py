"""Queued requests, signals amid a solve, types of messages, arms prepared or refused."""

import contextlib
import subprocess
import sys
import time
from collections import Counter
from functools import partial
from typing import Any

import live_nodes
import numpy as np
import pytest
import yaml
from checkout import ROOT
from octo_arm_msgs.srv import FindTensions, Solve
from std_msgs.msg import String
from std_srvs.srv import Trigger

from octo_arm_model import ConfigError, terminal
from octo_arm_model.analysis.driven_arm import DrivenArm
from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.config.parameter import Parameter
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.estimation.settings import ESTIMATOR_PARAMETERS
from octo_arm_model.ros.estimator.main import PreparedEstimator
from octo_arm_model.ros.node.main import make_executor
from octo_arm_model.ros.node.outputs import MARKERS_TOPIC
from octo_arm_model.ros.node.server import Prepared
from octo_arm_model.ros.start import CheckedNode
from octo_arm_model.ros.topics import message_class
from octo_arm_model.ros.work import LONGEST_WAIT, MOST_WAITING, QueuedService
from octo_arm_model.wire.backbone import BACKBONE_TOPICS


def test_requests_are_answered_in_order_bounded_and_to_the_end(make_node):
    node, asked, is_open = make_node('working'), [], []

    def answer(request, response, pause):
        while not is_open:
            pause()
        time.sleep(0.01)  # the client keeps ten answers that it has not read
        response.residual = request.tip_wrench.force.x

    service = QueuedService(node, Solve, 'queued', answer)
    client, executor = node.create_client(Solve, 'queued'), node.executor
    live_nodes.spin_until(executor, client.service_is_ready)

    def have_come():
        return len(service._waiting) + sum(one.done() for one in asked) == len(asked)

    for number in range(MOST_WAITING + 5):
        request = Solve.Request()
        request.tip_wrench.force.x = float(number)
        asked.append(client.call_async(request))
        live_nodes.spin_until(executor, have_come)
    is_open.append(True)
    live_nodes.spin_until(executor, lambda: all(one.done() for one in asked))
    found = [one.result() for one in asked]
    answered = [float(number) for number in range(MOST_WAITING + 1)]  # one was under way
    assert [one.residual for one in found[: len(answered)]] == answered
    assert {one.message for one in found[len(answered) :]} == {
        f'{MOST_WAITING} requests are waiting, expected fewer at a time'
    }
    service._answer = lambda *_: time.sleep(2.0 * LONGEST_WAIT)  # which nothing ends
    asked[:] = [client.call_async(Solve.Request()) for _ in range(3)]
    live_nodes.spin_until(executor, have_come)
    service.close()
    live_nodes.spin_until(executor, lambda: all(one.done() for one in asked))
    assert {one.result().message for one in asked} == {'the node stops answering'}
    # One that the executor knew of before is not answered, which rclpy cannot do any more.
    service._service.send_response(Solve.Response(), None)
    assert len(service._waiting) == 3


def test_faults_of_callbacks_are_logged_once_a_period_and_end_nothing(context, capfd, monkeypatch):
    monkeypatch.setattr(terminal, 'WARNING_PERIOD', 60.0)
    node, calls = CheckedNode('faulty', context=context), Counter()

    def fault(what, *arguments):
        calls[what] += 1
        raise OSError(f'{what} {calls[what]}')

    executor = make_executor(context)
    executor.add_node(node)
    node.create_subscription(String, 'heard', partial(fault, 'message'), 10)
    node.create_timer(0.01, partial(fault, 'time'))
    node.create_service(Trigger, 'asked', partial(fault, 'request'))
    service = QueuedService(node, Solve, 'queued', partial(fault, 'queued'))
    publisher = node.create_publisher(String, 'heard', 10)
    clients = node.create_client(Trigger, 'asked'), node.create_client(Solve, 'queued')
    live_nodes.spin_until(executor, lambda: all(one.service_is_ready() for one in clients))
    answers = [client.call_async(client.srv_type.Request()) for client in clients for _ in '12']

    def is_done():
        publisher.publish(String())
        is_repeated = min(calls['message'], calls['time']) > 2
        return is_repeated and all(answer.done() for answer in answers)

    live_nodes.spin_until(executor, is_done)
    service.close()
    node.destroy_node()
    logged = capfd.readouterr().err
    assert all(logged.count(f'OSError: {what} ') == 1 for what in calls) and len(calls) == 4
    assert [answer.result().success for answer in answers] == [False] * 4
    assert answers[-1].result().message == 'unexpected OSError: queued 2'


# The solver sends the signal itself and then never returns.
PROGRAM = """
import os, signal, sys, time
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.node import arm_server as services
from octo_arm_model.ros.node import main as node
def endless(*given, **named):
    os.kill(os.getpid(), signal.{signal})
    time.sleep(1000)
{patch} = endless
sys.exit(node.main(['--ros-args', '--params-file', {config!r}]))
"""
PATCHES = {
    'start': 'Solver.solve',
    'tensions': 'Solver.follow',
    'service': 'services.find_tensions',
}


@pytest.mark.parametrize(
    ('what', 'name'), [('start', 'SIGINT'), ('tensions', 'SIGTERM'), ('service', 'SIGINT')]
)
def test_a_signal_ends_the_node_in_the_middle_of_a_solve(what, name):
    domain = live_nodes.new_domain()
    program = PROGRAM.format(patch=PATCHES[what], signal=name, config=str(live_nodes.CONFIG_FILE))
    process = subprocess.Popen(
        [sys.executable, '-c', program],
        env=live_nodes.environment(domain),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        with contextlib.closing(live_nodes.NodeClient(domain)) as client:
            service = client.node.create_client(FindTensions, 'find_tensions')

            def ask():
                if what == 'tensions':
                    client.send('tendon_tensions', live_nodes.CONFIG.solver().rest_lengths)
                elif what == 'service' and service.service_is_ready():
                    service.call_async(FindTensions.Request())

            client.wait(lambda: process.poll() is not None, 'the end of the node', ask)
        assert 'xception' not in live_nodes.check_end(process, 0)
    finally:
        process.kill()
        process.communicate()


# Most signals come while rclpy converts the message, and loses the exception of the handler.
READING = """
import signal
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.serialization import serialize_message
from octo_arm_model.ros import work
from octo_arm_model.ros.topics import decoded
data = serialize_message(PoseWithCovarianceStamped())
def read(response):
    signal.setitimer(signal.ITIMER_REAL, 0.001)
    while True:
        decoded(data, PoseWithCovarianceStamped)
for _ in range(10):
    work.install()
    assert work.interruptible(read)('the response') == 'the response'
"""


def test_a_message_that_a_signal_interrupts_is_not_called_damaged():
    reading = subprocess.run([sys.executable, '-c', READING], capture_output=True, text=True)
    assert reading.returncode == 0, reading.stderr


# Parts -------------------------------------------------------------------------------------------


@pytest.mark.parametrize('inside', ['__init__.py', 'other/__init__.py'])
def test_a_type_that_is_not_installed_runs_nothing_of_its_package(tmp_path, monkeypatch, inside):
    # Type names come from parameters, which whoever is on the network may set.
    for name in {'__init__.py', inside}:
        path = tmp_path / 'octo_arm_loud' / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('raise SystemExit("was run")')
    monkeypatch.syspath_prepend(tmp_path)
    for type_name in ('octo_arm_loud/msg/Any', 'octo_arm_absent/msg/Any', 'sensor_msgs/msg/Any'):
        with pytest.raises(ConfigError, match='no messages of type'):
            message_class(type_name)
    assert message_class('sensor_msgs/msg/JointState').__name__ == 'JointState'


def test_rviz_shows_what_the_nodes_publish():
    for name, frame, prefixes in (
        ('octo_arm', 'arm_base', ['']),
        ('octopus', 'octopus', [f'arm_{n}/' for n in range(1, 9)]),
    ):
        manager = yaml.safe_load((ROOT / 'rviz' / f'{name}.rviz').read_text())
        manager = manager['Visualization Manager']
        topics = [one['Topic']['Value'] for one in manager['Displays'] if 'Topic' in one]
        assert manager['Global Options']['Fixed Frame'] == frame
        assert {prefix + MARKERS_TOPIC for prefix in prefixes} <= set(topics)
        others = {topic for topic in topics if not topic.endswith(MARKERS_TOPIC)}
        assert others <= set(BACKBONE_TOPICS)


# Prepared arms -----------------------------------------------------------------------------------


EXTREMES = (1e300, 1e160, 1e-160, 1e-300)
LOADED = {
    **load_parameters('renda2012_prototype'),
    'stations': 11,
    'model': 'exact',
    'loads.gravity': [0.0, 0.0, -9.81],
}


def with_extreme(parameter: Parameter, value: float) -> dict[str, Any]:
    """The parameters of an arm, one of them ``value``."""
    before = LOADED.get(parameter.name) or [0.0]
    return {**LOADED, parameter.name: [value] * len(before) if parameter.is_array else value}


@pytest.mark.filterwarnings('ignore::RuntimeWarning')
@pytest.mark.parametrize(
    'parameter',
    [
        pytest.param(one, id=one.name)
        for one in (*PARAMETERS, *ESTIMATOR_PARAMETERS)
        if one.kind is float
    ],
)
def test_an_arm_and_an_estimator_answer_in_numbers_or_are_refused(parameter):
    for value in EXTREMES:
        given = with_extreme(parameter, value)
        try:
            arm = Prepared.of(given)
            tensions = np.full(arm.config.arm.tension_shape, 0.3)
            answer = DrivenArm().answer(arm.solver, arm.config, None, 0, tensions)
        except OctoArmError as error:
            assert str(error)
        else:
            assert np.isfinite(answer.backbone.position).all()
            assert np.isfinite(answer.covariance).all()
        try:
            PreparedEstimator.of(given)
        except OctoArmError as error:
            assert str(error)
