"""Calls that are suspended where they pause."""

import signal
import threading

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import DEADLINE

from octo_arm_model.arm.errors import TargetError
from octo_arm_model.ros.work import SlicedCall


def test_a_call_goes_on_only_while_somebody_waits_for_it():
    done = []

    def function(pause):
        for step in range(3):
            done.append(step)
            pause()
        return 'all'

    call = SlicedCall(function, 0.0)
    assert done == []
    for step in range(3):
        assert not call.advance()
        assert done == list(range(step + 1))
    assert call.advance()
    assert call.result() == 'all'


def test_a_slice_that_is_not_over_is_not_interrupted():
    call = SlicedCall(lambda pause: [pause() for _ in range(1000)], 1e6)
    assert call.advance()
    assert call.result() == [None] * 1000


def test_what_is_raised_there_is_raised_here():
    def function(pause):
        pause()
        raise TargetError('no target')

    call = SlicedCall(function, 0.0)
    assert not call.advance()
    assert call.advance()
    with pytest.raises(TargetError, match='no target'):
        call.result()


def test_an_abandoned_call_ends_where_it_paused():
    ended = []

    def function(pause):
        try:
            pause()
            ended.append('too late')
        finally:
            ended.append('here')

    call = SlicedCall(function, 0.0)
    assert not call.advance()
    call.abandon()
    assert ended == ['here']


def test_steps_yield_between_slices_and_return_what_the_function_does():
    def caller():
        return (yield from SlicedCall(function, 0.0).steps())

    def function(pause):
        pause()
        pause()
        return 'all'

    steps = caller()
    next(steps)
    next(steps)
    with pytest.raises(StopIteration) as end:
        next(steps)
    assert end.value.value == 'all'


def test_steps_that_are_closed_have_ended_the_function():
    ended = []

    def function(pause):
        try:
            pause()
        finally:
            ended.append('here')

    steps = SlicedCall(function, 0.0).steps()
    next(steps)
    assert ended == []
    steps.close()
    assert ended == ['here']


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
