"""Tensions, wrenches and requests answered with the backbone of the core, over DDS."""

import math
import time
from functools import partial

import numpy as np
import pytest
from live_nodes import (
    AFFORDED,
    CONFIG,
    INPUTS,
    NAMES,
    OUTPUTS,
    RELIABLE,
    assert_is_backbone,
    hosting,
    running,
    tip_of,
)
from numpy.testing import assert_allclose, assert_array_equal
from octo_arm_msgs.msg import TendonTensions
from octo_arm_msgs.srv import FindTensions, Solve
from rcl_interfaces.srv import GetParameters

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.ros.node.main import OctoArmNode
from octo_arm_model.wire.tensions import TENSION_TOPICS


@pytest.fixture(scope='module')
def client():
    """Client of a node that is a process of its own."""
    with running('ros.node.main', **RELIABLE) as client:
        client.connect()
        yield client


@pytest.mark.parametrize('topic', INPUTS)
def test_every_input_is_answered_with_the_backbone_of_its_tensions(client, topic):
    for given in (FETCHING_IN_PLANE, FETCHING_IN_SPACE, np.zeros((3, 4))):
        tensions = np.float64(np.float32(given))  # which every type can hold
        assert_is_backbone(client.ask(topic, tensions), tensions)


def test_input_without_a_stamp_gets_the_time_of_receipt(client):
    before = time.time()
    answers = client.ask('tendon_tensions/array', FETCHING_IN_PLANE)
    stamp = answers[0].header.stamp
    assert before - 1.0 <= stamp.sec + stamp.nanosec * 1e-9 <= time.time() + 1.0
    assert all(answer.header.stamp == stamp for answer in answers)


def stamped(sec, nanosec):
    message = TendonTensions(name=list(NAMES), tension=np.ravel(FETCHING_IN_SPACE))
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    return message


NO_MESSAGES = {
    'before 1970': stamped(-5, 0),
    'of 4 s in nanoseconds': stamped(1, 4 * 10**9),
    'two bytes': b'\x00\x01',
    'bytes': bytes(range(80)),
    'ones': b'\xff' * 200,
}


@pytest.mark.parametrize('given', NO_MESSAGES.values(), ids=NO_MESSAGES)
def test_stamps_that_are_no_time_and_bytes_that_are_no_message_are_refused(client, given):
    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    client.forget()
    client.publishers['tendon_tensions'].publish(given)
    assert_goes_on(client, 'tendon_tensions', 'tendon_tensions/array')


def assert_goes_on(client, topic, other):
    """What was sent on ``topic`` is not answered, what follows on ``other`` and there is."""
    client.ask(other, FETCHING_IN_SPACE)  # its answer says that the bad one has had its turn
    assert_is_backbone(client.ask(topic, FETCHING_IN_PLANE), FETCHING_IN_PLANE)
    assert {name: len(got) for name, got in client.answers.items()} == dict.fromkeys(OUTPUTS, 2)


def tensions_with(value):
    tensions = np.array(FETCHING_IN_PLANE)
    tensions[1, 2] = value
    return tensions


BAD = {
    'negative': (tensions_with(-0.5), NAMES),
    'nan': (tensions_with(np.nan), NAMES),
    'infinite': (tensions_with(np.inf), NAMES),
    'enormous': (tensions_with(1e300), NAMES),
    'too few': (np.zeros(11), NAMES[:11]),
    'too many': (np.zeros(13), [*NAMES, 'tendon_4_1']),
    'none': (np.zeros(0), []),
    'unknown name': (np.zeros(12), [*NAMES[:11], 'elbow']),
    'duplicate name': (np.zeros(12), [*NAMES[:11], NAMES[0]]),
    'names and values of different length': (np.zeros(5), NAMES),
}


@pytest.mark.parametrize(
    ('topic', 'case'),
    [(t, c) for t in INPUTS for c in BAD if TENSION_TOPICS[t].names or 'name' not in c],
)
def test_bad_input_is_not_answered_and_the_next_good_one_is(client, topic, case):
    client.forget()
    client.send(topic, *BAD[case])
    assert_goes_on(client, topic, next(name for name in INPUTS if name != topic))


def test_what_is_said_of_a_refusal_is_short_whatever_was_sent(client):
    client.diagnostics.clear()
    names, words = ['x' * 500_000, *NAMES[1:]], 'unknown tendon x'

    def send():
        client.send('tendon_tensions', FETCHING_IN_PLANE, names)

    # The log may be throttled since the test before.
    client.log(words, again=send)
    client.wait(lambda: any(words in line for line in client.told()), 'a warning', send)
    values = [v.value for m in client.diagnostics for s in m.status for v in s.values]
    lines = [*client.told(), *(log.msg for log in client.logs), *values]
    assert max(map(len, lines)) < 1000
    # Not for every message, and of a model without loads for a wrench too.
    seen = len(client.logs)
    for _ in range(20):
        send()
        client.send_wrench(0.1)
        assert_is_backbone(
            client.ask('tendon_tensions/array', FETCHING_IN_PLANE), FETCHING_IN_PLANE
        )
    assert sum('refused' in log.msg for log in client.logs[seen:]) < 40


def test_a_message_without_a_byte_is_survived():
    # Not reliable, as by default: a reliable subscription gets nothing more after it.
    with hosting(OctoArmNode) as client:
        client.connect()
        client.publishers['tendon_tensions'].publish(b'')
        assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)


def test_a_burst_is_answered_with_its_newest_and_the_rest_is_counted(client):
    before = client.status('output')[1]
    client.forget()
    stamps = [client.send('tendon_tensions', FETCHING_IN_PLANE) for _ in range(60)]
    got = client.answers['backbone/path']
    client.wait(lambda: got and got[-1].header.stamp.sec == stamps[-1], 'an answer to the newest')
    after = client.status('output')[1]
    assert sum(int(after[key]) - int(before[key]) for key in ('answered', 'skipped')) == 60


def test_loads_and_uncertainty_are_those_of_the_core(loaded):
    solver = loaded.config.solver()
    expected = solver.solve(loaded.pull)
    answers = loaded.ask('tendon_tensions', loaded.pull)
    assert_allclose(tip_of(answers), expected.tip, atol=1e-9)
    covariance = np.reshape(answers[3].pose.covariance, (6, 6))
    ours = solver.tip_covariance(expected, loaded.config.uncertainty)
    assert_allclose(covariance, ours, rtol=1e-5, atol=1e-9 * ours.max())
    assert (np.diag(covariance)[:3] > 0.0).all()


def tip_with(client, force):
    """Where the tip is, and where a force along z would have it."""
    tip = tip_of(client.ask('tendon_tensions', FETCHING_IN_PLANE))
    return tip, client.solver.solve(FETCHING_IN_PLANE, [0.0, 0.0, force, 0.0, 0.0, 0.0]).tip


def is_felt(client, force):
    """Ask until the force on the tip has arrived."""
    client.wait(
        lambda: np.allclose(*tip_with(client, force), atol=1e-7),
        f'a wrench of {force} N',
        lambda: client.send_wrench(force),
    )


def test_what_has_no_answer_is_not_published_and_diagnostics_say_why(loaded):
    loaded.wait(
        lambda: any('compress' in one or 'converge' in one for one in loaded.told()),
        'a diagnosis',
        lambda: loaded.send('tendon_tensions', 1e5 * loaded.pull),
    )
    loaded.forget()
    tip = tip_of(loaded.ask('tendon_tensions', loaded.pull))
    assert_allclose(tip, loaded.config.solver().solve(loaded.pull).tip, atol=1e-8)


@pytest.fixture
def exact():
    with hosting(OctoArmNode, node='exact', model='exact', **RELIABLE, **AFFORDED) as client:
        client.connect()
        client.solver = CONFIG.solver('exact')
        yield client


def test_a_wrench_that_does_not_go_with_another_arm_is_dropped_with_a_warning(exact):
    is_felt(exact, 0.02)
    assert exact.change(model='renda2012') == (True, '')
    exact.log("tip_wrench dropped: model is 'renda2012', which has no loads")
    assert_is_backbone(exact.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)
    # And it does not come back by itself.
    assert exact.change(model='exact') == (True, '')
    assert_allclose(*tip_with(exact, 0.0), atol=1e-7)
    is_felt(exact, 0.02)
    assert exact.change(base_frame='elsewhere') == (True, '')
    exact.log("tip_wrench dropped: it was given in 'arm_base', and base_frame is 'elsewhere'")


def test_a_wrench_beyond_its_bound_and_bytes_that_are_none_are_refused(exact):
    is_felt(exact, 0.02)
    for force, frame, reason in (
        (1e6, 'arm_base', 'force on the tip is 1e+06 N, expected at most 138.2 N'),
        (math.nan, 'arm_base', 'tip wrench is [0.0, 0.0, nan'),
        (0.1, 'somewhere', "its frame is 'somewhere'"),
    ):
        send = partial(exact.send_wrench, force, frame)
        exact.log('tip_wrench refused', reason, again=send)
        assert_allclose(*tip_with(exact, 0.02), atol=1e-7)
    assert not exact.change(loads__tip_force=[0.0, 0.0, 1e6])[0]
    exact.wrench.publish(b'\x00\x01\x00\x00nothing')
    is_felt(exact, 0.02)


def node_with_budget(seconds):
    """A node of the model exact whose solves may take ``seconds``."""
    given = {'model': 'exact', 'stations': 401, 'solve_budget.seconds': seconds}
    return hosting(OctoArmNode, node='brief', **given)


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
        spent = 'continuation has spent its budget of 1e-06 s'
        send = partial(send_unbearable, client)
        client.log('tendon_tensions refused', spent, again=send)
        client.wait(
            lambda: int(client.status('solver')[1]['beyond solve_budget']),
            'a count in the diagnostics',
            send,
        )
        answer = client.call(Solve, 'solve', unbearable())
        assert not answer.success and spent in answer.message
        # Of iterations the budget is the same on every computer.
        assert client.change(solve_budget__seconds=1e6, solve_budget__iterations=3) == (True, '')
        assert 'budget of 3 iterations' in client.call(Solve, 'solve', unbearable()).message
        refused = (False, 'solve_budget.seconds is -1.0, expected a finite time >= 0 [s]')
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
            client.wait(lambda left=left: left, 'an answer', flood)
            assert asked.result().values[0].string_value == 'exact'
            # In the order in which they were asked all these came first.
            assert left[0] > 0
        seen = len(client.diagnostics)
        client.wait(lambda: len(client.diagnostics) > seen + 1, 'a diagnosis', flood)
        assert waiting


def test_the_service_solve_answers_like_the_core_and_explains_refusals(loaded):
    request = Solve.Request()
    request.tensions.name = loaded.names
    request.tensions.tension = [0.5, 0.0, 0.0, 0.2]
    request.tip_wrench.force.y = 0.01
    answer = loaded.call(Solve, 'solve', request)
    solver = loaded.config.solver(compiled=None)
    expected = solver.solve([[0.5, 0.0, 0.0, 0.2]], [0, 0.01, 0, 0, 0, 0])
    assert answer.success, answer.message
    assert_array_equal(answer.strains.k, expected.k)
    lengths = solver.tendon_lengths(expected).ravel()
    assert_allclose(answer.tendon_length, lengths, rtol=1e-12)
    assert len(answer.path.poses) == 101
    assert answer.residual < 1e-10
    request.tensions.tension = [0.5, 0.0, -1.0, 0.2]
    refused = loaded.call(Solve, 'solve', request)
    assert not refused.success
    assert 'tension of tendon_1_3 is -1.0 N' in refused.message


def test_the_service_find_tensions_reaches_what_can_be_reached(loaded):
    solver = loaded.config.solver()
    request = FindTensions.Request(target=FindTensions.Request.TIP_POSITION)
    wanted = solver.solve(loaded.pull).tip
    place = request.tip.position
    place.x, place.y, place.z = wanted.tolist()
    answer = loaded.call(FindTensions, 'find_tensions', request)
    assert answer.success and answer.reached, answer.message
    found = solver.solve(np.reshape(answer.tensions.tension, (1, 4)))
    assert_allclose(found.tip, wanted, atol=1e-6)
    place.x = 9.0
    far = loaded.call(FindTensions, 'find_tensions', request)
    assert far.success and not far.reached and far.error > 8.0
    # What no optimiser can begin with is refused, and the node goes on.
    request.stiffness = 5.0
    for highest, direction, words in (
        ([1.0, 2.0], 1.0, 'highest has 2 values'),
        ([], math.inf, 'expected 3 finite numbers'),
    ):
        request.highest, request.stiffness_direction.x = highest, direction
        refused = loaded.call(FindTensions, 'find_tensions', request)
        assert not refused.success and words in refused.message
