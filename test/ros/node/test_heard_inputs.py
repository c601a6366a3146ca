"""Inputs that were heard and are no more, and what the diagnostics say of them."""

import types

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from diagnostic_msgs.msg import DiagnosticArray

from octo_arm_model import load_config
from octo_arm_model.arm.errors import MessageError
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.config.parameters import DiagnosticLimits
from octo_arm_model.ros.node import diagnostics as heard_inputs
from octo_arm_model.ros.node.diagnostics import Diagnostics, HeardInputs

LIMIT = 2.0  # [s]
WINCHES, WRENCH = '/tendon_displacements', '/tip_wrench'


@pytest.fixture
def clock(monkeypatch):
    """A clock that stands still until its ``now`` [s] is set."""
    clock = types.SimpleNamespace(now=100.0)
    monkeypatch.setattr(heard_inputs, 'time', types.SimpleNamespace(monotonic=lambda: clock.now))
    return clock


@pytest.fixture
def heard(clock):
    made = HeardInputs()
    made.apart, made.unanswered = frozenset({WINCHES, WRENCH}), frozenset({WRENCH})
    return made


def test_an_input_that_was_heard_and_is_no_more_is_named(clock, heard):
    for topic in ('/tendon_tensions', WINCHES, WRENCH):
        heard.note(topic)
    clock.now += 3.0
    heard.note('/tendon_tensions')
    assert heard.silent(LIMIT) == [
        f'{WINCHES} is silent for 3.0 s',
        f'{WRENCH} is silent for 3.0 s',
    ]
    heard.is_used = lambda topic: topic != WRENCH  # it was of no force
    assert heard.silent(LIMIT) == [f'{WINCHES} is silent for 3.0 s']
    heard.begin()
    assert heard.silent(LIMIT) == []


def test_tensions_may_go_on_on_another_topic(clock, heard):
    heard.note('/tendon_tensions')
    clock.now += 3.0
    heard.note('/tendon_tensions/array')
    assert heard.silent(LIMIT) == []
    clock.now += 3.0
    assert heard.silent(LIMIT) == ['/tendon_tensions/array is silent for 3.0 s']


@pytest.mark.parametrize(('topic', 'is_silent'), [(WINCHES, False), (WRENCH, True)])
def test_who_hears_nothing_to_answer_is_silent(clock, heard, topic, is_silent):
    clock.now += 3.0
    assert heard.silent(LIMIT) == ['silent for 3.0 s']
    heard.note(topic)
    assert heard.silent(LIMIT) == (['silent for 3.0 s'] if is_silent else [])


def test_messages_that_are_refused_are_no_silence(clock, make_node):
    node, said = make_node('octo_arm'), []
    node.create_subscription(DiagnosticArray, '/diagnostics', said.append, 10)
    diagnostics = Diagnostics(node)
    config = load_config(preset_path('renda2012_table4'))
    diagnostics.describe(config.solver(compiled=None), DiagnosticLimits(LIMIT, 1.0, 0.1))
    diagnostics.begin()
    clock.now += 3.0
    diagnostics.refused('/tendon_tensions', MessageError('too short'))

    def heard_of_input():
        said.clear()
        while not said:
            node.executor.spin_once(timeout_sec=1.0)
        return said[-1].status[1].message

    assert heard_of_input() == '1 refused: /tendon_tensions: too short'
    clock.now += 3.0
    assert heard_of_input() == '/tendon_tensions is silent for 3.0 s'
