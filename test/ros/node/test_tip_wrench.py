"""The wrench on the tip and other loads, over DDS."""

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from geometry_msgs.msg import WrenchStamped
from live_nodes import AFFORDED, CONFIG, NAMES, RELIABLE, assert_is_backbone, hosting, tip_of
from octo_arm_msgs.srv import FindTensions, Solve
from rcl_interfaces.srv import GetParameters

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.ros.node.main import OctoArmNode


def test_a_wrench_is_refused_by_a_model_without_loads(client):
    message = WrenchStamped()
    message.wrench.force.z = 0.1
    for _ in range(3):
        client.wrench.publish(message)
        assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)


def ask(loaded):
    return loaded.ask('tendon_tensions', loaded.pull)


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
    reason = 'nan' if np.isnan(force) else 'somewhere'

    def is_told():
        loaded.send_wrench(force, frame)
        ask(loaded)
        return any('tip_wrench' in log.msg and reason in log.msg for log in loaded.logs)

    loaded.wait(is_told, 'a warning')
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
        loaded.send('tendon_tensions', 1e5 * loaded.pull)
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
    with hosting(OctoArmNode, *RELIABLE, *AFFORDED, '-p', 'model:=exact', node='exact') as client:
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


def node_with_budget(seconds):
    """A node of the model exact whose solves may take ``seconds``."""
    budget = f'solve_budget.seconds:={seconds}'
    given = '-p', budget, '-p', 'model:=exact', '-p', 'stations:=401'
    return hosting(OctoArmNode, *given, node='brief')


def send_unbearable(client):
    """Send tensions and a force that no balance is found for."""
    client.send_wrench(100.0)
    client.send('tendon_tensions', FETCHING_IN_PLANE)
    client.spin(0.01)


def unbearable():
    """The same as a request of the service solve."""
    request = Solve.Request()
    request.tensions.name, request.tensions.tension = NAMES, np.ravel(FETCHING_IN_PLANE).tolist()
    request.tip_wrench.force.z = 100.0
    return request


def test_a_solve_beyond_its_budget_is_refused_counted_and_told():
    with node_with_budget(1e-6) as client:

        def is_told():
            send_unbearable(client)
            words = 'continuation has spent its budget of 1e-06 s'
            return any('tendon_tensions refused' in m.msg and words in m.msg for m in client.logs)

        client.wait(is_told, 'a refusal in the log')

        def is_counted():
            send_unbearable(client)
            return int(client.status('solver')[1]['beyond solve_budget'])

        client.wait(is_counted, 'a count in the diagnostics')
        answer = client.call(Solve, 'solve', unbearable())
        assert not answer.success
        assert 'continuation has spent its budget of 1e-06 s' in answer.message
        # Of iterations the budget is the same on every computer.
        assert client.change(solve_budget__seconds=1e6, solve_budget__iterations=3) == (True, '')
        assert 'budget of 3 iterations' in client.call(Solve, 'solve', unbearable()).message
        refused = (False, 'solve budget: seconds is -1.0, expected a number > 0')
        assert client.change(solve_budget__seconds=-1.0) == refused


def test_parameters_and_diagnostics_come_between_the_solves_of_any_flood():
    search = FindTensions.Request(target=FindTensions.Request.TIP_POSITION)
    search.tip.position.x = 9.0  # out of reach: all starts are tried
    with node_with_budget(0.02) as client:
        solve = client.service(Solve, 'solve')
        find = client.service(FindTensions, 'find_tensions')
        request = GetParameters.Request(names=['model'])
        client.call(GetParameters, 'brief/get_parameters', request)
        parameters = client.service(GetParameters, 'brief/get_parameters')
        waiting = []

        def flood():
            """Have many requests waiting, behind and before tensions and wrenches."""
            waiting[:] = [one for one in waiting if not one.done()]
            waiting.extend(solve.call_async(unbearable()) for _ in range(80 - len(waiting)))
            send_unbearable(client)

        find.call_async(search)
        flood()
        client.wait(lambda: any(one.done() for one in waiting), 'a first answer')
        for _ in range(3):
            flood()
            before, left = list(waiting), []
            asked = parameters.call_async(request)
            asked.add_done_callback(
                lambda _, before=before, left=left: left.append(
                    sum(not one.done() for one in before)
                )
            )
            client.wait(lambda left=left: flood() or left, 'an answer')
            assert asked.result().values[0].string_value == 'exact'
            # In the order in which they were asked all these came first.
            assert left[0] > 0
        seen = len(client.diagnostics)
        client.wait(lambda: flood() or len(client.diagnostics) > seen + 1, 'a diagnosis')
        assert waiting
