"""The wrench on the tip and other loads, over DDS."""

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from geometry_msgs.msg import WrenchStamped
from live_nodes import CONFIG, assert_is_backbone, running, tip_of
from rcl_interfaces.srv import GetParameters

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE

pytestmark = pytest.mark.slow


def test_a_wrench_is_refused_by_a_model_without_loads(client):
    message = WrenchStamped()
    message.wrench.force.z = 0.1
    for _ in range(3):
        client.wrench.publish(message)
        assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)


def ask(loaded):
    return loaded.ask('tendon_tensions', loaded.pull, loaded.names)


def test_loads_and_uncertainty_are_those_of_the_core(loaded):
    solver = loaded.config.solver()
    expected = solver.solve(loaded.pull)
    answers = ask(loaded)
    np.testing.assert_allclose(tip_of(answers), expected.tip, atol=1e-9)
    covariance = np.reshape(answers[3].pose.covariance, (6, 6))
    ours = solver.tip_covariance(expected, loaded.config.uncertainty)
    np.testing.assert_allclose(covariance, ours, rtol=1e-5, atol=1e-9 * ours.max())
    assert (np.diag(covariance)[:3] > 0.0).all()


def test_a_wrench_on_the_tip_acts_on_the_tensions_that_follow(loaded):
    expected = loaded.config.solver().solve(loaded.pull, [0, 0, 0.03, 0, 0, 0]).tip

    def is_felt():
        loaded.send_wrench(0.03)
        return np.allclose(tip_of(ask(loaded)), expected, atol=1e-8)

    loaded.wait(is_felt, 'the wrench')

    def is_gone():
        loaded.send_wrench(0.0)
        return np.allclose(
            tip_of(ask(loaded)), loaded.config.solver().solve(loaded.pull).tip, atol=1e-8
        )

    loaded.wait(is_gone, 'its end')


@pytest.mark.parametrize(('force', 'frame'), [(np.nan, 'arm_base'), (0.1, 'somewhere')])
def test_a_bad_wrench_is_ignored(loaded, force, frame):
    expected = tip_of(ask(loaded))
    loaded.send_wrench(force, frame)
    loaded.wait(
        lambda: any('tip_wrench' in log.msg for log in loaded.logs) or ask(loaded) is None,
        'a warning',
    )
    np.testing.assert_allclose(tip_of(ask(loaded)), expected, atol=1e-9)


def test_what_has_no_answer_is_not_published_and_diagnostics_say_why(loaded):
    def reasons():
        return [
            status.message
            for message in loaded.diagnostics
            for status in message.status
            if 'compress' in status.message or 'converge' in status.message
        ]

    def asked():
        loaded.send('tendon_tensions', 1e5 * loaded.pull, loaded.names)
        loaded.spin(0.1)
        return reasons()

    loaded.wait(asked, 'a diagnosis')
    loaded.forget()
    answers = ask(loaded)
    np.testing.assert_allclose(
        tip_of(answers), loaded.config.solver().solve(loaded.pull).tip, atol=1e-8
    )


@pytest.fixture
def exact():
    with running('ros.node.main', '-p', 'model:=exact') as client:
        client.connect()
        client.solver = CONFIG.solver('exact')
        yield client


def is_felt(client, force):
    """Ask until the force on the tip has arrived."""
    expected = client.solver.solve(FETCHING_IN_PLANE, [0.0, 0.0, force, 0.0, 0.0, 0.0]).tip

    def asked():
        client.send_wrench(force)
        tip = tip_of(client.ask('tendon_tensions', FETCHING_IN_PLANE))
        return np.allclose(tip, expected, atol=1e-7)

    client.wait(asked, 'the wrench')


def test_a_wrench_that_does_not_go_with_another_arm_is_dropped_with_a_warning(exact):
    is_felt(exact, 0.02)
    assert exact.change(model='renda2012') == (True, '')
    exact.log("tip_wrench dropped: model is 'renda2012', which has no loads")
    assert_is_backbone(exact.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)
    # And it does not come back by itself.
    assert exact.change(model='exact') == (True, '')
    tip = tip_of(exact.ask('tendon_tensions', FETCHING_IN_PLANE))
    free = exact.solver.solve(FETCHING_IN_PLANE).tip
    np.testing.assert_allclose(tip, free, atol=1e-7)
    is_felt(exact, 0.02)
    assert exact.change(base_frame='elsewhere') == (True, '')
    exact.log("tip_wrench dropped: it was given in 'arm_base', and base_frame is 'elsewhere'")


def test_a_wrench_beyond_its_bound_and_bytes_that_are_none_are_refused(exact):
    is_felt(exact, 0.02)
    exact.send_wrench(1e6)
    exact.log('tip_wrench refused: force on the tip is 1e+06 N, expected at most 138.2 N')
    is_felt(exact, 0.02)
    assert not exact.change(loads__tip_force=[0.0, 0.0, 1e6])[0]
    exact.wrench.publish(b'\x00\x01\x00\x00nothing')
    is_felt(exact, 0.02)


def test_parameters_are_answered_while_every_solve_takes_longer_than_the_next_message(exact):
    service = exact.node.create_client(GetParameters, 'octo_arm/get_parameters')
    exact.wait(service.service_is_ready, 'the parameter service')
    exact.wait(lambda: exact.node.count_publishers('/rosout') > 1, 'the log of the node')
    tensions = np.array(FETCHING_IN_PLANE)
    sent = 0

    def busy():
        nonlocal sent
        exact.send_wrench(100.0)  # no balance is found, and that takes long
        for _ in range(10):
            sent += 1
            exact.send('tendon_tensions', (1.0 + 0.1 * np.sin(sent)) * tensions)
        exact.spin(0.01)
        return any('did not converge' in log.msg for log in exact.logs)

    exact.wait(busy, 'a solve that takes long')
    for _ in range(2):
        answer = service.call_async(GetParameters.Request(names=['model']))
        exact.wait(lambda asked=answer: busy() and asked.done(), 'an answer')
        assert answer.result().values[0].string_value == 'exact'
