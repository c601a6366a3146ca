"""The texts of the page."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import trapezoid

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')


from octo_arm_model import SolveError, load_config
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.client.client import PublishedShape, PublishedStrains
from octo_arm_model.viewer import numbers

CONFIG = load_config(preset_path('renda2012_table4'))
SOLVER = CONFIG.solver()


def test_compared_tips_are_as_far_apart_as_they_are():
    exact = CONFIG.solver('exact').solve(FETCHING_IN_SPACE)
    text = numbers.compared(exact.tip + [0.003, 0.0, 0.004], exact)
    assert '>5.00<' in text
    assert '1.1 % of the length' in text


def test_the_angle_of_the_tip_is_that_of_a_bend():
    straight = SOLVER.solve(np.zeros((3, 4)))
    assert numbers.tip_angle(straight) == 0.0
    backbone = SOLVER.solve(0.1 * np.array(FETCHING_IN_PLANE))
    # In one plane the tangent turns by the integral of the curvature.
    turned = np.rad2deg(trapezoid(backbone.k * (1.0 + backbone.q), backbone.s))
    assert numbers.tip_angle(backbone) == pytest.approx(abs(turned), abs=3.0)


def test_what_a_node_says_cannot_become_part_of_the_page():
    assert '<script>' not in numbers.failed(SolveError('<script>alert(1)</script>'))
    assert '<b>' not in numbers.waiting('/<b>')
    backbone = SOLVER.solve(np.zeros((3, 4)))
    strains = (getattr(backbone, name) for name in PublishedStrains._fields[1:])
    client = SimpleNamespace(
        shape=PublishedShape(backbone.position, backbone.quaternion, 0.0, 0.0),
        strains=PublishedStrains('<script>alert(1)</script>', *strains),
        tip_deviation=np.zeros(3), force=None, covariance=None, latency=0.0, problem='<b>',
        rate=lambda: 1.0, age=lambda: 0.0,
    )  # fmt: skip
    text = numbers.live(client)
    assert '<script>' not in text and '&lt;script&gt;' in text
    assert '<b>' not in text
