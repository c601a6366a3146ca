"""Raw readings of load cells, under the names that a laboratory has for them, over DDS."""

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import CONFIG, NAMES

from octo_arm_model.config.paper_data import FETCHING_IN_PLANE as PLANE

FETCHING_IN_PLANE = np.array(PLANE)
CELLS = [f'LC {number}' for number in range(12)]


def tip(answers):
    place = answers[3].pose.pose.position
    return np.array([place.x, place.y, place.z])


def test_readings_around_zero_are_answered_within_the_deadband_and_counted_beyond(client):
    noise = 0.004 * np.random.default_rng(0).standard_normal((3, 4))
    expected = CONFIG.solver().solve(FETCHING_IN_PLANE).tip
    readings = np.where(FETCHING_IN_PLANE > 0.0, FETCHING_IN_PLANE, noise)
    assert (readings < 0.0).any()
    try:
        assert client.change(tension_deadband=0.02) == (True, '')
        np.testing.assert_allclose(tip(client.ask('tendon_tensions', readings)), expected)
        client.send('tendon_tensions', readings - 0.05)

        def counted():
            client.spin(0.1)
            return 'tension_deadband' in client.status('input')[1]['refused by reason']

        client.wait(counted, 'the refusal by its reason')
        scale, offset = np.linspace(0.5, 2.0, 12), np.linspace(-0.3, 0.3, 12)
        raw = (readings.ravel() - offset) / scale
        assert client.change(tension_scale=scale.tolist(), tension_offset=offset.tolist())[0]
        answers = client.ask('tendon_tensions/array', raw.reshape(3, 4))
        np.testing.assert_allclose(tip(answers), expected, atol=1e-9)
    finally:
        none = {'tension_scale': [], 'tension_offset': []}
        assert client.change(tension_deadband=0.0, **none) == (True, '')


@pytest.mark.parametrize('topic', ['tendon_tensions', 'tendon_tensions/joint_state'])
def test_names_of_a_laboratory_are_those_of_tension_names(client, topic):
    names, pulled = CELLS.copy(), FETCHING_IN_PLANE.copy()
    names[5], pulled[1, 1] = '-', 0.0  # without a load cell
    expected = CONFIG.solver().solve(pulled).tip
    sent = [*CELLS[::-1], 'elbow']
    values = np.append(FETCHING_IN_PLANE.ravel()[::-1], 99.0)
    try:
        assert client.change(tension_names=names) == (True, '')
        np.testing.assert_allclose(tip(client.ask(topic, values, sent)), expected)
    finally:
        assert client.change(tension_names=[]) == (True, '')
    assert client.ask(topic, FETCHING_IN_PLANE, NAMES)


@pytest.mark.parametrize('topic', ['tendon_tensions/array', 'tendon_tensions/float32_array'])
def test_values_without_names_are_those_of_tension_names_by_number(client, topic):
    order = np.random.default_rng(1).permutation(12)
    numbers, pulled = list(map(str, order)), np.float64(np.float32(FETCHING_IN_PLANE))
    numbers[5], pulled[1, 1] = '-', 0.0  # without a load cell
    values = np.full(15, 99.0)  # those of other cells as well
    values[order] = pulled.ravel()
    try:
        assert client.change(tension_names=numbers) == (True, '')
        expected = CONFIG.solver().solve(pulled).tip
        np.testing.assert_allclose(tip(client.ask(topic, values)), expected, atol=1e-12)
    finally:
        assert client.change(tension_names=[]) == (True, '')
