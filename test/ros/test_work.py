"""Queued requests, and signals in the middle of a solve."""

import contextlib
import subprocess
import sys

import live_nodes
import pytest
from octo_arm_msgs.srv import FindTensions, Solve

from octo_arm_model.ros.work import MOST_WAITING, QueuedService, WorkQueue


def test_requests_are_answered_in_order_bounded_and_to_the_end(make_node):
    node, asked, is_open = make_node('working'), [], []

    def answer(request, response):
        while not is_open:
            yield
        response.residual = request.tip_wrench.force.x

    service = QueuedService(node, Solve, 'queued', answer, WorkQueue(node))
    client, executor = node.create_client(Solve, 'queued'), node.executor
    live_nodes.spin_until(executor, client.service_is_ready)

    def have_come():
        answered = sum(one.done() for one in asked)
        return len(service._waiting) + (service._under_way is not None) + answered == len(asked)

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
    is_open.clear()
    asked[:] = [client.call_async(Solve.Request()) for _ in range(3)]
    live_nodes.spin_until(executor, have_come)
    service.close()
    live_nodes.spin_until(executor, lambda: all(one.done() for one in asked))
    assert {one.result().message for one in asked} == {'the node stops answering'}


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
        [sys.executable, '-c', program], env=live_nodes.environment(domain),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        with contextlib.closing(live_nodes.NodeClient(domain)) as client:
            service = client.node.create_client(FindTensions, 'find_tensions')

            def has_ended():
                if what == 'tensions':
                    client.send('tendon_tensions', live_nodes.CONFIG.solver().rest_lengths)
                elif what == 'service' and service.service_is_ready():
                    service.call_async(FindTensions.Request())
                return process.poll() is not None

            client.wait(has_ended, 'the end of the node')
        assert 'xception' not in live_nodes.check_end(process, 0)
    finally:
        process.kill()
        process.communicate()
