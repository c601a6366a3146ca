"""The order in which a node computes and answers."""

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

import rclpy
from live_nodes import spin_until
from octo_arm_msgs.srv import Solve
from rclpy.executors import SingleThreadedExecutor

from octo_arm_model.ros.node.main import make_executor
from octo_arm_model.ros.work import MOST_WAITING, QueuedService, WorkQueue


@pytest.fixture(params=['events', 'single-threaded'])
def executor(request, context):
    """A spinning node and its executor."""
    node = rclpy.create_node('working', context=context)
    made = (
        make_executor(context)
        if request.param == 'events'
        else SingleThreadedExecutor(context=context)
    )
    made.add_node(node)
    yield node, made
    made.shutdown()
    node.destroy_node()


def test_pieces_take_turns_and_what_arrives_is_heard_between_two(executor):
    node, spinning = executor
    work, log = WorkQueue(node), []

    def piece(name, times):
        def do():
            log.append(name)
            if name == 'a' and log.count('a') == 1:
                spinning.create_task(lambda: log.append('arrived'))
            return log.count(name) < times

        return do

    for name, times in (('a', 3), ('b', 2), ('c', 1)):
        work.add(piece(name, times))
    spin_until(spinning, lambda: len(log) == 7)
    # One piece may have been a task before.
    assert [name for name in log if name != 'arrived'] == ['a', 'b', 'c', 'a', 'b', 'a']
    assert log.index('arrived') <= 2


def test_what_goes_on_first_is_done_before_what_is_due(executor):
    node, spinning = executor
    work, log = WorkQueue(node), []

    def long():
        log.append('long')
        if len(log) < 3:
            work.add_first(long)

    for piece in (long, lambda: log.append('other')):
        work.add(piece)
    spin_until(spinning, lambda: len(log) == 4)
    assert log == ['long', 'long', 'long', 'other']


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
