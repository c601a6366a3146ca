"""Calls in slices, queued work, and signals in the middle of a solve."""

import contextlib
import signal
import subprocess
import sys
import threading

import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import (
    CONFIG,
    CONFIG_FILE,
    DEADLINE,
    NodeClient,
    check_end,
    environment,
    new_domain,
    spin_until,
)
from octo_arm_msgs.srv import FindTensions, Solve
from rclpy.executors import SingleThreadedExecutor

from octo_arm_model.arm.errors import TargetError
from octo_arm_model.ros.node.main import make_executor
from octo_arm_model.ros.work import (
    MOST_WAITING,
    QueuedService,
    SlicedCall,
    WorkQueue,
    until_shutdown,
)


def paused(times, log, error=None):
    """A function that pauses so many ``times``, and logs its steps and its end."""

    def function(pause):
        try:
            for step in range(times):
                log.append(step)
                pause()
            if error is not None:
                raise error
            return 'all'
        finally:
            log.append('end')

    return function


@pytest.mark.parametrize('error', [None, TargetError('no target')])
def test_a_call_goes_on_only_while_somebody_waits_for_it(error):
    log = []
    call = SlicedCall(paused(3, log, error), 0.0)
    assert log == []
    for step in range(3):
        assert not call.advance()
        assert log == list(range(step + 1))
    assert call.advance()
    if error is None:
        assert call.result() == 'all'
    else:  # what is raised there is raised here
        with pytest.raises(TargetError, match='no target'):
            call.result()


def test_a_slice_that_is_not_over_is_not_interrupted():
    call = SlicedCall(paused(1000, []), 1e6)
    assert call.advance() and call.result() == 'all'


def test_an_abandoned_call_ends_where_it_paused():
    calls, log = [], []
    call = SlicedCall(paused(2, log), 0.0)
    assert not call.advance()
    call.abandon()
    steps = SlicedCall(paused(2, calls), 0.0).steps()
    next(steps)
    assert calls == [0]
    steps.close()
    assert log == calls == [0, 'end']


def test_steps_yield_between_slices_and_return_what_the_function_does():
    def caller():
        return (yield from SlicedCall(paused(2, []), 0.0).steps())

    steps = caller()
    assert [next(steps), next(steps)] == [None, None]
    with pytest.raises(StopIteration) as end:
        next(steps)
    assert end.value.value == 'all'


def test_a_signal_that_does_not_wake_whoever_waits_is_handled_in_the_slice():
    was_handled = threading.Event()

    def function(pause):
        # Delivered to this thread: the one that waits is not woken.
        signal.pthread_kill(threading.get_ident(), signal.SIGUSR1)
        return was_handled.wait(DEADLINE)

    handler = signal.signal(signal.SIGUSR1, lambda *_: was_handled.set())
    try:
        call = SlicedCall(function, 0.0)
        assert call.advance()
    finally:
        signal.signal(signal.SIGUSR1, handler)
    assert call.result()


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

# What comes while LLVM calls back is lost there, but not what comes of it.
COMPILING = """
import ctypes, os, signal, sys, time
from types import SimpleNamespace
from llvmlite.binding.executionengine import ExecutionEngine
from octo_arm_model.rod.solver import Solver
from octo_arm_model.ros.node import main as node
seen = []
def keep(module, code):
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.05)
    seen.append(code)
engine = SimpleNamespace(_object_cache_notify=keep, _find_module_ptr=lambda pointer: engine)
code = ctypes.create_string_buffer(b'code')
given = SimpleNamespace(module_ptr=1, buf_ptr=ctypes.addressof(code), buf_len=4)
data = SimpleNamespace(contents=given)
@ctypes.CFUNCTYPE(None)
def compiled():
    ExecutionEngine._raw_object_cache_notify(engine, data)
def endless(*given, **named):
    compiled()
    time.sleep(1000)
Solver.solve = endless
status = node.main(['--ros-args', '--params-file', {config!r}])
assert seen == [b'code'], 'what LLVM said was lost'
sys.exit(status)
"""


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


def test_a_signal_ends_a_node_that_compiles_and_nothing_of_it_is_lost():
    pytest.importorskip('llvmlite', reason='needs numba')
    with killed(started(COMPILING.format(config=str(CONFIG_FILE)), new_domain())) as process:
        ended(process)


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


def test_what_fails_because_the_context_has_ended_is_no_error():
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    with pytest.raises(RuntimeError), until_shutdown(context):
        raise RuntimeError('of its own')
    with until_shutdown(context):
        rclpy.shutdown(context=context)
        raise RuntimeError('publisher of a context that is no more')
