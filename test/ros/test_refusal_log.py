"""Warnings of what comes on topics."""

import types

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')

from octo_arm_model.arm.errors import MessageError
from octo_arm_model.ros import refusal_log
from octo_arm_model.ros.refusal_log import WARNING_PERIOD, RefusalLog


def test_each_topic_is_warned_of_once_a_period_as_refused_and_else(make_node, monkeypatch, capfd):
    clock = types.SimpleNamespace(now=100.0)
    monkeypatch.setattr(refusal_log, 'time', types.SimpleNamespace(monotonic=lambda: clock.now))
    log = RefusalLog(make_node('warner'))
    for _ in range(2):
        for _ in range(3):
            for topic in ('/a', '/b'):
                log.warn(topic, MessageError('too short'))
                log.say(topic, 'stamps run back')
        clock.now += 1.01 * WARNING_PERIOD
    said = [line.split('[warner]: ')[1] for line in capfd.readouterr().err.splitlines()]
    expected = '/a refused: too short', '/a: stamps run back', '/b refused: too short'
    assert said == 2 * [*expected, '/b: stamps run back']
