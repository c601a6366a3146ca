"""Calls in slices, queued work, and signals in the middle of a solve."""

import contextlib
import subprocess
import sys

import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import (
    CONFIG,
    CONFIG_FILE,
    NodeClient,
    check_end,
    environment,
    new_domain,
    spin_until,
)
from octo_arm_msgs.srv import FindTensions, Solve

from octo_arm_model.ros.node.main import make_executor
from octo_arm_model.ros.work import (
    MOST_WAITING,
    QueuedService,
    WorkQueue,
)


@pytest.fixture
def executor(context):
    """A spinning node and its executor."""
    node = rclpy.create_node('working', context=context)
    made = make_executor(context)
    made.add_node(node)
    yield node, made
    made.shutdown()
    node.destroy_node()


def test_requests_are_answered_in_order_a_piece_at_a_time_and_bounded(executor):
    node, spinning = executor
    work, log = WorkQueue(node), []

    def answer(request, response):
        for step in range(3):
            log.append((request.tip_wrench.force.x, step))
            yield
        response.success = True
        response.residual = request.tip_wrench.force.x

    service = QueuedService(node, Solve, 'queued', answer, work)
    client = node.create_client(Solve, 'queued')
    spin_until(spinning, client.service_is_ready)
    # Nothing is answered before all have come.
    wait, work._queue = work._queue, lambda: None
    asked = []
    count = MOST_WAITING + 5
    for number in range(count):
        request = Solve.Request()
        request.tip_wrench.force.x = float(number)
        asked.append(client.call_async(request))
        spin_until(
            spinning,
            lambda: len(service._waiting) + sum(one.done() for one in asked) == len(asked),
        )
    refused = [one.result() for one in asked[MOST_WAITING:]]
    assert not any(one.success for one in refused)
    assert {one.message for one in refused} == {
        f'{MOST_WAITING} requests are waiting, expected fewer at a time'
    }
    work._queue = wait
    work._queue()
    spin_until(spinning, lambda: all(one.done() for one in asked))
    answered = asked[:MOST_WAITING]
    assert [one.result().residual for one in answered] == [float(n) for n in range(MOST_WAITING)]
    assert log == [(float(n), step) for n in range(MOST_WAITING) for step in range(3)]


def test_a_closed_service_ends_the_answer_under_way_and_says_so_to_all_who_wait(executor):
    node, spinning = executor
    work, log = WorkQueue(node), []

    def answer(request, response):
        try:
            while True:
                log.append('step')
                yield
        finally:
            log.append('end')

    service = QueuedService(node, Solve, 'endless', answer, work)
    client = node.create_client(Solve, 'endless')
    spin_until(spinning, client.service_is_ready)
    asked = [client.call_async(Solve.Request()) for _ in range(3)]
    spin_until(spinning, lambda: len(log) > 3 and len(service._waiting) == 2)
    work.clear()
    service.close()
    assert log[-1] == 'end'
    spin_until(spinning, lambda: all(one.done() for one in asked))
    assert {(one.result().success, one.result().message) for one in asked} == {
        (False, 'the node stops answering')
    }


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


def started(program, domain):
    return subprocess.Popen(
        [sys.executable, '-c', program], env=environment(domain),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def ended(process):
    """End of a process without complaint, whatever happens before."""
    complaints = check_end(process, 0)
    assert 'xception' not in complaints, complaints


@contextlib.contextmanager
def killed(process):
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(
    ('what', 'name'), [('start', 'SIGINT'), ('tensions', 'SIGTERM'), ('service', 'SIGINT')]
)
def test_a_signal_ends_the_node_in_the_middle_of_a_solve(what, name):
    domain = new_domain()
    program = PROGRAM.format(patch=PATCHES[what], signal=name, config=str(CONFIG_FILE))
    with killed(started(program, domain)) as process:
        with contextlib.closing(NodeClient(domain)) as client:
            service = client.node.create_client(FindTensions, 'find_tensions')

            def has_ended():
                if what == 'tensions':
                    client.send('tendon_tensions', CONFIG.solver().rest_lengths)
                elif what == 'service' and service.service_is_ready():
                    service.call_async(FindTensions.Request())
                return process.poll() is not None

            client.wait(has_ended, 'the end of the node')
        ended(process)
