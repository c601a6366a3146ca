"""Rates of topics."""

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')

from octo_arm_model.ros.client.client import Meter


def test_rates_count_what_was_passed_over_and_begin_anew_with_the_node():
    meter = Meter()
    assert meter.rate(0.0) == 0.0
    for step in range(31):
        meter.count(step / 30.0, 4 * step)
    assert meter.rate(1.0) == pytest.approx(120.0)
    assert meter.rate(10.0) == 0.0
    meter.count(10.0, 1000)
    meter.count(10.5, 3)  # another publisher, which counts from 1
    meter.count(11.0, 8)
    assert meter.rate(11.0) == pytest.approx(10.0)
