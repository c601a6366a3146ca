"""Parameters of running nodes as ROS's own clients read, write and load them, over real DDS."""

import contextlib
import itertools
import subprocess
import sys
import threading

import numpy as np
import pytest
import yaml

rclpy = pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from lifecycle_msgs.msg import Transition
from octo_arm_msgs.msg import TendonTensions
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from ros.node.test_node import (
    CONFIG,
    CONFIG_FILE,
    DEADLINE,
    DOMAINS,
    FETCHING_IN_PLANE,
    Client,
    assert_is_backbone,
    call,
    change,
    environment,
    start,
    stop,
    transition,
    wrench_of,
)
from rosgraph_msgs.msg import Clock

from octo_arm_model import load_config
from octo_arm_model.config.config import is_of_every_node
from octo_arm_model.config.presets import preset_path

# Everything in tables: none of the parameters that they take the place of is given.
TABULATED = """\
/**:
  ros__parameters:
    model: exact
    material: {table_s: [0.0, 0.2], table_youngs_modulus: [1.1e5, 1.0e5]}
    body: {length: 0.2, table_s: [0.0, 0.2], table_radius: [0.01, 0.005]}
    sections: {anchorage: [0.2], tendons: [3]}
    tendons: {table_s: [0.0, 0.2], table_offset: [0.006, 0.003, 0.006, 0.003, 0.006, 0.003]}
    tendon_names: []
    material.table_poisson_ratio: []
"""


class Running:
    """A node of its own, with a client."""

    def __init__(self, module, *arguments, node='octo_arm'):
        self.domain, self.name = next(DOMAINS), node
        self.process = start(module, '--ros-args', *map(str, arguments), domain=self.domain)
        self.client = Client(self.domain)
        self.parameters = AsyncParameterClient(self.client.node, node)

    def __enter__(self):
        return self

    def __exit__(self, *failure):
        self.client.close()
        status, complaints = stop(self.process)
        if failure == (None, None, None):
            assert status == 0, complaints
            assert 'Traceback' not in complaints

    def answer(self, ask, *arguments):
        def is_ready():
            assert self.process.poll() is None, self.process.communicate()[1]
            return self.parameters.services_are_ready()

        self.client.wait(is_ready, f'the services of {self.name}')
        future = ask(*arguments)
        self.client.wait(future.done, 'an answer')
        return future.result()

    def dump(self):
        """All parameters by name, asked for as `ros2 param dump` does."""
        names = sorted(self.answer(self.parameters.list_parameters).result.names)
        values = self.answer(self.parameters.get_parameters, names).values
        assert len(values) == len(names)
        return {
            name: parameter_value_to_python(value)
            for name, value in zip(names, values, strict=True)
        }

    def types(self):
        names = sorted(self.answer(self.parameters.list_parameters).result.names)
        return dict(
            zip(names, self.answer(self.parameters.get_parameter_types, names).types, strict=True)
        )


def write_dump(path, node, values):
    """A file as `ros2 param dump` writes it: nested, empty lists without a type."""
    nested = {}
    for name, value in values.items():
        *groups, last = name.split('.')
        inner = nested
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[last] = value
    document = {f'/{node}': {'ros__parameters': nested}}
    path.write_text(yaml.dump(document, default_flow_style=False))
    return path


def of_the_arm(values):
    return {name: value for name, value in values.items() if not is_of_every_node(name)}


@pytest.fixture
def tabulated(tmp_path):
    path = tmp_path / 'tabulated.yaml'
    path.write_text(TABULATED)
    return path


KINDS = {
    'node': ('node.main', 'octo_arm'),
    'lifecycle': ('node.lifecycle', 'octo_arm'),
    'simulator': ('simulator_node', 'octo_arm_sim'),
}


@pytest.mark.parametrize('kind', KINDS)
def test_what_is_dumped_starts_the_same_node_and_loads_into_it(kind, tmp_path, tabulated):
    module, name = KINDS[kind]
    with Running(module, '--params-file', tabulated, node=name) as first:
        dumped, types = first.dump(), first.types()
        assert dumped['tendon_names'] == [] == dumped['sections.offset_base']
        assert dumped['body.radius_base'] == 0.0
        assert types['tendon_names'] == ParameterType.PARAMETER_STRING_ARRAY
        assert types['sections.tendons'] == ParameterType.PARAMETER_INTEGER_ARRAY
        assert types['loads.point_s'] == ParameterType.PARAMETER_DOUBLE_ARRAY
        path = write_dump(tmp_path / 'dumped.yaml', name, dumped)
        if kind == 'node':
            assert load_config(path) == load_config(tabulated)
        loaded = first.answer(first.parameters.load_parameter_file, str(path), True)
        refused = {r.reason for r in loaded.results if not r.successful}
        assert all('read-only' in reason for reason in refused), refused
        assert first.dump() == dumped
    with Running(module, '--params-file', path, node=name) as second:
        assert of_the_arm(second.dump()) == of_the_arm(dumped)
        assert second.types() == types
        if kind == 'lifecycle':
            assert transition(second.client, Transition.TRANSITION_CONFIGURE)


@pytest.mark.parametrize(
    ('old', 'new', 'complaint'),
    [
        ('length: 0.45', 'length: long', "body.length is 'long', expected double"),
        ('length: 0.45', 'length: []', 'body.length is [], expected double'),
        ('stations: 101', 'stations: []', 'stations is [], expected integer'),
        ('stations: 101', 'tendon_names: [1, 2]', 'tendon_names is [1, 2], expected string[]'),
        ('stations: 101', 'use_sim_time: 5', 'use_sim_time'),
    ],
)
def test_a_value_of_another_type_ends_the_start_with_one_line(tmp_path, old, new, complaint):
    path = tmp_path / 'bad.yaml'
    text = CONFIG_FILE.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    process = start('node.main', '--ros-args', '--params-file', str(path), domain=next(DOMAINS))
    _, complaints = process.communicate(timeout=DEADLINE)
    assert process.returncode == 1
    assert complaint in complaints
    assert 'Traceback' not in complaints


@pytest.fixture(scope='module')
def running():
    with Running('node.main', '--params-file', CONFIG_FILE) as running:
        running.client.connect()
        yield running


@pytest.mark.parametrize(
    'empty',
    ['byte_array', 'bool_array', 'integer_array', 'double_array', 'string_array'],
)
def test_an_empty_list_is_taken_whatever_it_is_empty_of(running, empty):
    value = ParameterValue(type=getattr(ParameterType, f'PARAMETER_{empty.upper()}'))
    for name in ('tendon_names', 'sections.tendons', 'loads.point_s'):
        message = ParameterMessage(name=name, value=value)
        for ask in (
            running.parameters.set_parameters,
            running.parameters.set_parameters_atomically,
        ):
            answer = running.answer(ask, [message])
            result = answer.results[0] if hasattr(answer, 'results') else answer.result
            assert result.successful, result.reason
    refused = running.answer(
        running.parameters.set_parameters, [ParameterMessage(name='stations', value=value)]
    )
    assert not refused.results[0].successful


@pytest.mark.parametrize('kind', [SetParameters, SetParametersAtomically])
def test_a_parameter_of_no_known_type_is_refused(running, kind):
    name = 'octo_arm/' + (
        'set_parameters' if kind is SetParameters else 'set_parameters_atomically'
    )
    good = Parameter('stations', value=51).to_parameter_msg()
    bad = ParameterMessage(name='stations', value=ParameterValue(type=77))
    answer = call(running.client, kind, name, kind.Request(parameters=[good, bad, good]))
    if kind is SetParameters:
        assert [result.successful for result in answer.results] == [True, False, True]
        result = answer.results[1]
    else:
        result = answer.result
    assert not result.successful
    assert result.reason == 'stations is of type 77, expected 0 to 9'
    assert change(running.client, stations=101) == (True, '')


def test_a_managed_node_refuses_a_transition_that_is_none_and_goes_on():
    with Running('node.lifecycle', '--params-file', CONFIG_FILE) as managed:
        for impossible in (Transition.TRANSITION_ACTIVATE, 200):
            assert not transition(managed.client, impossible)
        assert transition(managed.client, Transition.TRANSITION_CONFIGURE)


# Simulated time ----------------------------------------------------------------------------------

NO_TIMES = [(-5, 0), (-(2**31), 0), (-1, 10**9), (2**31 - 1, 2**32 - 1)]


@pytest.mark.parametrize('kind', ['node', 'simulator'])
def test_a_clock_that_is_no_time_is_refused_and_the_next_one_taken(kind):
    module, name = KINDS[kind]
    arguments = ('--params-file', CONFIG_FILE, '-p', 'use_sim_time:=true')
    with Running(module, *arguments, node=name) as node:
        client, heard = node.client, []
        topic = 'backbone/path' if kind == 'node' else 'tendon_tensions'
        if kind == 'simulator':
            client.node.create_subscription(TendonTensions, topic, heard.append, 100)
        else:
            heard = client.answers[topic]
        clock = client.node.create_publisher(Clock, '/clock', 10)
        later = itertools.count(0, 1_000_000)  # [ns]

        def stamped_with(sec, nanosec, expected):
            for bad in NO_TIMES:
                message = Clock()
                message.clock.sec, message.clock.nanosec = bad
                clock.publish(message)
                client.executor.spin_once(timeout_sec=0.02)
            # The simulator measures when time goes on.
            message = Clock()
            message.clock.sec, message.clock.nanosec = sec, nanosec + next(later)
            clock.publish(message)
            if kind == 'node':
                client.send('tendon_tensions/array', FETCHING_IN_PLANE)
            client.executor.spin_once(timeout_sec=0.05)
            return heard and heard[-1].header.stamp.sec == expected

        # Nanoseconds beyond a second, back to before, and the last second there is.
        for sec, nanosec, expected in (
            (5, 4 * 10**9, 9),
            (3, 0, 3),
            (2**31 - 1, 0, 2**31 - 1),
        ):
            client.wait(
                lambda given=(sec, nanosec, expected): stamped_with(*given),
                f'an answer at {sec} s',
            )
        assert any('/clock refused: it is -5 s' in log.msg for log in client.logs)


# The arm of a file -------------------------------------------------------------------------------


def load(running, *arguments):
    return subprocess.run(
        [sys.executable, '-m', 'octo_arm_model.cli.main', 'load', *map(str, arguments)],
        env=environment(running.domain),
        capture_output=True, text=True, timeout=DEADLINE, check=False,
    )  # fmt: skip


def test_the_arm_of_a_running_node_is_exchanged_as_a_whole(running):
    before = running.dump()
    assert change(running.client, loads__point_s=[0.1], loads__point_force=[0.0, 0.0, 0.01],
                  model='exact', stations=51) == (True, '')  # fmt: skip
    done = load(running, 'renda2012_table2')
    assert (done.returncode, done.stderr) == (0, '')
    assert '/octo_arm has the arm of' in done.stdout
    after = running.dump()
    # What the file does not name is as if it had never been set.
    assert after['loads.point_s'] == after['loads.point_force'] == []
    wanted = load_config(preset_path('renda2012_table2'))
    assert after['model'] == wanted.model
    assert after['sections.anchorage'] == [section.anchorage for section in wanted.arm.sections]
    done = load(running, CONFIG_FILE)
    assert (done.returncode, done.stderr) == (0, '')
    assert running.dump() == before
    answers = running.client.ask('tendon_tensions', FETCHING_IN_PLANE)
    assert_is_backbone(answers, FETCHING_IN_PLANE)


@pytest.mark.parametrize(
    ('old', 'new', 'complaint'),
    [
        ('length: 0.45', 'length: -1.0', 'body.length is -1.0, expected a finite number > 0 [m]'),
        ('length: 0.45', '', 'body.length is missing, expected double'),
        ('length: 0.45', 'girth: 0.45', 'body.girth is no parameter of arm or simulator; did you'),
        ('stations: 101', 'stations: 3', '/octo_arm stays as it is: stations is 3, expected'),
        ('/**:', 'nothing', 'not valid YAML'),
    ],
)
def test_a_file_that_is_no_arm_changes_nothing(running, tmp_path, old, new, complaint):
    before = running.dump()
    path = tmp_path / 'bad.yaml'
    text = CONFIG_FILE.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    done = load(running, path)
    assert done.returncode == 2
    assert complaint in done.stderr
    assert done.stderr.count('\n') == 1
    assert running.dump() == before


class SpinningNode:
    """A node without an arm that answers."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        node = rclpy.create_node('other', context=self.context)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(node)
        self.thread = threading.Thread(target=self.spin)
        self.thread.start()

    def spin(self):
        with contextlib.suppress(rclpy.executors.ExternalShutdownException):
            self.executor.spin()

    def close(self):
        rclpy.shutdown(context=self.context)
        self.thread.join()


@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        (('--node', '/nobody', '--wait', '0.1'), 'no node /nobody within 0.1 s'),
        (('--node', '/not a name'), "--node is '/not a name', expected the name of a node"),
        (('--node', '/other'), '/other has no arm'),
        (('--wait', 'nan'), '--wait is nan'),
    ],
)
def test_a_node_that_has_no_arm_is_told(running, arguments, complaint):
    other = SpinningNode(running.domain)
    try:
        done = load(running, CONFIG_FILE, *arguments)
    finally:
        other.close()
    assert done.returncode == 2
    assert complaint in done.stderr
    assert done.stderr.count('\n') == 1


def test_the_simulator_keeps_what_is_its_own():
    arguments = ('--params-file', CONFIG_FILE, '-p', 'winches.lag:=0.5')
    with Running('simulator_node', *arguments, node='octo_arm_sim') as simulator:
        simulator.dump()
        done = load(simulator, 'renda2012_prototype', '--node', '/octo_arm_sim')
        assert (done.returncode, done.stderr) == (0, '')
        after = simulator.dump()
        assert after['winches.lag'] == 0.5
        assert after['sections.anchorage'] == [0.27]


# The wrench on the tip ---------------------------------------------------------------------------


@pytest.fixture
def exact():
    arguments = ('--params-file', CONFIG_FILE, '-p', 'model:=exact')
    with Running('node.main', *arguments) as running:
        running.client.connect()
        yield running


def is_felt(client, force):
    """Ask until the force on the tip has arrived."""
    solver = client.solver
    expected = solver.solve(FETCHING_IN_PLANE, [0.0, 0.0, force, 0.0, 0.0, 0.0]).tip

    def asked():
        wrench_of(client, force)
        tip = client.ask('tendon_tensions', FETCHING_IN_PLANE)[3].pose.pose.position
        return np.allclose([tip.x, tip.y, tip.z], expected, atol=1e-7)

    client.wait(asked, 'the wrench')


def logged(client, words):
    client.wait(lambda: any(words in log.msg for log in client.logs), f'{words} in the log')


def test_a_wrench_that_does_not_go_with_another_arm_is_dropped_with_a_warning(exact):
    client = exact.client
    client.solver = CONFIG.solver('exact')
    is_felt(client, 0.02)
    assert change(client, model='renda2012') == (True, '')
    logged(client, "tip_wrench dropped: model is 'renda2012', which has no loads")
    assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)
    # And it does not come back by itself.
    assert change(client, model='exact') == (True, '')
    tip = client.ask('tendon_tensions', FETCHING_IN_PLANE)[3].pose.pose.position
    free = client.solver.solve(FETCHING_IN_PLANE).tip
    np.testing.assert_allclose([tip.x, tip.y, tip.z], free, atol=1e-7)
    is_felt(client, 0.02)
    assert change(client, base_frame='elsewhere') == (True, '')
    logged(client, "tip_wrench dropped: it was given in 'arm_base', and base_frame is 'elsewhere'")


def test_a_wrench_beyond_its_bound_and_bytes_that_are_none_are_refused(exact):
    client = exact.client
    client.solver = CONFIG.solver('exact')
    is_felt(client, 0.02)
    wrench_of(client, 1e6)
    logged(client, 'tip_wrench refused: force on the tip is 1e+06 N, expected at most 138.2 N')
    is_felt(client, 0.02)
    assert not change(client, loads__tip_force=[0.0, 0.0, 1e6])[0]
    client.wrench.publish(b'\x00\x01\x00\x00nothing')
    is_felt(client, 0.02)


def test_parameters_are_answered_while_every_solve_takes_longer_than_the_next_message(exact):
    client = exact.client
    service = client.node.create_client(GetParameters, 'octo_arm/get_parameters')
    client.wait(service.service_is_ready, 'the parameter service')
    client.wait(lambda: client.node.count_publishers('/rosout') > 1, 'the log of the node')
    tensions = np.array(FETCHING_IN_PLANE)
    sent = 0

    def busy():
        nonlocal sent
        wrench_of(client, 100.0)  # no balance is found, and that takes long
        for _ in range(10):
            sent += 1
            client.send('tendon_tensions', (1.0 + 0.1 * np.sin(sent)) * tensions)
        client.executor.spin_once(timeout_sec=0.01)
        return any('did not converge' in log.msg for log in client.logs)

    client.wait(busy, 'a solve that takes long')
    for _ in range(2):
        answer = service.call_async(GetParameters.Request(names=['model']))
        client.wait(lambda asked=answer: busy() and asked.done(), 'an answer')
        assert answer.result().values[0].string_value == 'exact'
