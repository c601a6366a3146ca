"""Tendons driven by length, over DDS."""

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import AFFORDED, NAMES, hosting, tip_of
from octo_arm_msgs.msg import TendonTensions
from sensor_msgs.msg import JointState

from octo_arm_model import displacements_of, load_config, solve_displacements, wound_sensitivity
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.node.main import OctoArmNode

TENSIONS = 0.5 * np.array(FETCHING_IN_SPACE)
OPTIONS = (
    '-p', 'model:=exact', '-p', 'tendons.axial_stiffness:=[800.0]', '-p',
    'material.youngs_modulus_stddev:=0.05',
)  # fmt: skip


@pytest.fixture(scope='module')
def wound():
    """Client of a node with tendons that stretch, and its ``solver``."""
    path = preset_path('renda2012_table4')
    with hosting(OctoArmNode, *AFFORDED, *OPTIONS, files=[path]) as client:
        client.winches = client.node.create_publisher(JointState, 'tendon_displacements', 10)
        client.estimates = client.hear(TendonTensions, 'tendon_tension_estimates')
        client.connect()
        parameters = client.dump()
        assert list(parameters['tendons.axial_stiffness']) == [800.0]
        client.solver = solver_of(path)
        yield client


def solver_of(path):
    from octo_arm_model.config.config import Config
    from octo_arm_model.config.parameter_files import load_parameters

    parameters = load_parameters(path)
    parameters |= {
        'model': 'exact', 'tendons.axial_stiffness': [800.0],
        'material.youngs_modulus_stddev': 0.05,
    }  # fmt: skip
    config = Config.from_parameters(parameters)
    assert load_config(path).arm.length == config.arm.length
    return config.solver(compiled=None)


def reel(client, displacements):
    """Publish displacements by name; returns the answer that carries their stamp."""
    message = JointState(name=list(displacements), position=list(displacements.values()))
    message.header.stamp.sec = next(client.stamps)
    client.winches.publish(message)

    def answered():
        stamp = message.header.stamp.sec
        return all(got and got[-1].header.stamp.sec == stamp for got in client.answers.values())

    client.wait(answered, 'an answer to tendon_displacements')
    return [got[-1] for got in client.answers.values()]


def connect(client):
    client.wait(lambda: client.winches.get_subscription_count(), 'a subscription')


def test_displacements_of_all_tendons_give_back_shape_and_tensions(wound):
    connect(wound)
    expected = wound.solver.solve(TENSIONS)
    asked = displacements_of(wound.solver, expected).ravel()
    answers = reel(wound, dict(zip(NAMES, asked.tolist(), strict=True)))
    np.testing.assert_allclose(tip_of(answers), expected.tip, atol=1e-8)
    wound.wait(lambda: wound.estimates, 'tension estimates')
    estimate = wound.estimates[-1]
    assert list(estimate.name) == NAMES
    assert estimate.header.stamp == answers[0].header.stamp
    np.testing.assert_allclose(estimate.tension, TENSIONS.ravel(), atol=1e-8 * TENSIONS.max())
    covariance = np.reshape(answers[3].pose.covariance, (6, 6))
    held = wound_sensitivity(
        wound.solver,
        solve_displacements(wound.solver, dict(zip(NAMES, asked.tolist(), strict=True))),
    ).held
    by_young = 0.05 * held.by_youngs_modulus.tip
    np.testing.assert_allclose(
        covariance, by_young @ by_young.T, rtol=1e-4, atol=1e-6 * np.abs(by_young).max() ** 2
    )


def test_a_displacement_in_other_units_is_refused_with_that_reason(wound):
    connect(wound)
    message = JointState(name=['tendon_1_1', 'tendon_2_2'], position=[0.01, 15.0])
    told = 'displacement of tendon_2_2 is 15 m, expected less than there is to reel in: '

    def refused():
        wound.winches.publish(message)
        _, values = wound.status('input')
        return told in values['last refusal']

    wound.wait(refused, 'the refusal')
    assert reel(wound, {'tendon_1_1': 0.01})  # and goes on


def test_winches_and_load_cells_drive_different_tendons_together(wound):
    connect(wound)
    asked = {'tendon_1_1': 0.02, 'tendon_2_2': 0.01}
    given = np.zeros((3, 4))
    given[2, 0] = 1.0
    reel(wound, {})
    wound.ask('tendon_tensions', given)
    expected = solve_displacements(wound.solver, asked, {'tendon_3_1': 1.0}).backbone
    np.testing.assert_allclose(tip_of(reel(wound, asked)), expected.tip, atol=1e-8)
    given[2, 0] = 1.5
    given[0, 0] = 7.0  # its winch is driven by length
    expected = solve_displacements(wound.solver, asked, {'tendon_3_1': 1.5}).backbone
    answers = wound.ask('tendon_tensions', given)
    np.testing.assert_allclose(tip_of(answers), expected.tip, atol=1e-8)
    lengths = answers[4]
    np.testing.assert_allclose(lengths.effort, expected.tensions.ravel(), atol=1e-8)
    status, _ = wound.status('input')
    assert 'several sources' not in status.message
    # Without names all tendons are let go, and follow the tensions again.
    reel(wound, {})
    alone = wound.solver.solve(given)
    np.testing.assert_allclose(tip_of(wound.ask('tendon_tensions', given)), alone.tip, atol=1e-9)


def test_two_publishers_of_displacements_are_diagnosed(wound):
    connect(wound)
    second = wound.node.create_publisher(JointState, 'tendon_displacements', 10)

    def told():
        reel(wound, {})
        said = [s.message for s in wound.diagnostics[-1].status] if wound.diagnostics else []
        return any('2 publishers on /tendon_displacements' in message for message in said)

    try:
        wound.wait(told, 'a warning')
    finally:
        wound.node.destroy_publisher(second)


@pytest.mark.parametrize(
    ('name', 'position', 'problem'),
    [
        (['elbow'], [0.01], 'unknown tendon elbow'),
        (['tendon_1_1'], [], 'name has 1 entries but position has 0'),
        (['tendon_1_1'] * 2, [0.01, 0.02], 'tendon named more than once: tendon_1_1'),
        (['tendon_1_1'], [float('nan')], 'displacement of tendon_1_1 is nan m'),
    ],
)
def test_displacements_that_are_none_are_refused_with_a_warning(wound, name, position, problem):
    connect(wound)

    def refused():
        wound.winches.publish(JointState(name=name, position=position))
        wound.spin(0.2)
        _, values = wound.status('input')
        return problem in values['last refusal']

    wound.wait(refused, 'a refusal')
    given = 0.2 * TENSIONS
    reel(wound, {})
    expected = wound.solver.solve(given).tip
    np.testing.assert_allclose(tip_of(wound.ask('tendon_tensions', given)), expected, atol=1e-9)


def test_an_arm_without_the_tendon_lets_go_of_it(wound):
    connect(wound)
    reel(wound, {'tendon_1_1': 0.02})
    other = [f'cable_{number}' for number in range(12)]
    assert wound.change(tendon_names=other)[0]
    wound.log('displacements dropped: this arm has no tendon tendon_1_1')
    given = 0.2 * TENSIONS
    expected = wound.solver.solve(given).tip
    answers = wound.ask('tendon_tensions', given, other)
    np.testing.assert_allclose(tip_of(answers), expected, atol=1e-9)
    assert wound.change(tendon_names=NAMES)[0]
