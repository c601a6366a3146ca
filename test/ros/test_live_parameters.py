"""Parameters as ROS's own clients read, write and load them, over DDS."""

import itertools

import numpy as np
import pytest
import yaml
from lifecycle_msgs.msg import Transition
from live_nodes import NODES, assert_is_backbone, hosting
from octo_arm_msgs.msg import TendonTensions
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter

from octo_arm_model import load_config
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE
from octo_arm_model.config.parameter_files import is_of_every_node
from octo_arm_model.config.parameters import PARAMETERS

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


@pytest.mark.parametrize('kind', NODES)
def test_what_is_dumped_starts_the_same_node_and_loads_into_it(kind, tmp_path):
    tabulated = tmp_path / 'tabulated.yaml'
    tabulated.write_text(TABULATED)
    with hosting(NODES[kind], files=[tabulated]) as first:
        dumped, types = first.dump(), first.parameter_types()
        assert dumped['tendon_names'] == [] == dumped['sections.offset_base']
        assert dumped['body.radius_base'] == 0.0
        assert types['tendon_names'] == ParameterType.PARAMETER_STRING_ARRAY
        assert types['sections.tendons'] == ParameterType.PARAMETER_INTEGER_ARRAY
        assert types['loads.point_s'] == ParameterType.PARAMETER_DOUBLE_ARRAY
        path = write_dump(tmp_path / 'dumped.yaml', first.name, dumped)
        if kind == 'node':
            assert load_config(path) == load_config(tabulated)
        loaded = first.ask_parameters(first.parameters.load_parameter_file, str(path), True)
        refused = {r.reason for r in loaded.results if not r.successful}
        assert all('read-only' in reason for reason in refused), refused
        assert first.dump() == dumped
    with hosting(NODES[kind], files=[path]) as second:
        assert of_the_arm(second.dump()) == of_the_arm(dumped)
        assert second.parameter_types() == types
        if kind == 'lifecycle':
            assert second.transition(Transition.TRANSITION_CONFIGURE)


@pytest.mark.parametrize(
    'empty', ['byte_array', 'bool_array', 'integer_array', 'double_array', 'string_array']
)
def test_an_empty_list_is_taken_whatever_it_is_empty_of(client, empty):
    value = ParameterValue(type=getattr(ParameterType, f'PARAMETER_{empty.upper()}'))
    for name in ('tendon_names', 'sections.tendons', 'loads.point_s'):
        message = ParameterMessage(name=name, value=value)
        for ask in (client.parameters.set_parameters, client.parameters.set_parameters_atomically):
            answer = client.ask_parameters(ask, [message])
            result = answer.results[0] if hasattr(answer, 'results') else answer.result
            assert result.successful, result.reason
    refused = client.ask_parameters(
        client.parameters.set_parameters, [ParameterMessage(name='stations', value=value)]
    )
    assert not refused.results[0].successful


def test_integers_are_taken_where_numbers_are_wanted(client):
    before = client.dump()
    try:
        assert client.change(loads__fluid_density=1000, base__position=[1, 2, 3]) == (True, '')
        now = client.dump()
        assert now['loads.fluid_density'] == 1000.0
        assert now['base.position'] == [1.0, 2.0, 3.0]
        types = client.parameter_types()
        assert types['loads.fluid_density'] == ParameterType.PARAMETER_DOUBLE
        assert types['base.position'] == ParameterType.PARAMETER_DOUBLE_ARRAY
        done, why = client.change(base__position=[1] * 1001)
        assert not done and why == 'base.position has 1001 values, expected at most 1000'
        assert client.change(stations=31.0)[0] is False
    finally:
        client.change(
            loads__fluid_density=before['loads.fluid_density'],
            base__position=before['base.position'],
        )


def test_a_description_that_nobody_could_read_is_refused(client):
    small, long = 1.0000000000000002e-20, -1.0000000000000002e-100
    length = client.dump()['body.length']
    s = np.linspace(0.0, length, 1000).tolist()
    done, why = client.change(
        sections__anchorage=[length],
        sections__tendons=[20],
        sections__offset_base=[],
        sections__offset_anchorage=[],
        tendons__table_s=s,
        tendons__table_offset=[small] * 20_000,
        tendons__table_angle=[long] * 20_000,
        material__youngs_modulus=0.0,
        material__table_s=s,
        material__table_youngs_modulus=[small] * 1000,
        material__table_poisson_ratio=[small] * 1000,
    )
    assert not done and 'bytes, expected at most 1048576' in why


STATIONS = ParameterMessage(name='stations')


@pytest.mark.parametrize(
    ('service', 'kind', 'field', 'element', 'answered'),
    [
        ('set_parameters', SetParameters, 'parameters', STATIONS, 'results.0.reason'),
        (
            'set_parameters_atomically',
            SetParametersAtomically,
            'parameters',
            STATIONS,
            'result.reason',
        ),
        ('get_parameters', GetParameters, 'names', 'stations', 'values'),
        ('get_parameter_types', GetParameterTypes, 'names', 'stations', 'types'),
        ('describe_parameters', DescribeParameters, 'names', 'stations', 'descriptors'),
        ('list_parameters', ListParameters, 'prefixes', 'body', 'result.names'),
    ],
)
def test_a_request_is_of_no_more_parameters_than_there_are(
    client, service, kind, field, element, answered
):
    declared = len(client.parameter_names())
    request = kind.Request(**{field: [element] * 10 * declared})
    found = client.call(kind, f'octo_arm/{service}', request)
    for part in answered.split('.'):
        found = found[int(part)] if part.isdigit() else getattr(found, part)
    if element is STATIONS:
        assert f'expected at most {declared}' in found
    else:
        assert not found


def test_parameters_are_described_with_their_unit_and_range(client):
    request = DescribeParameters.Request(names=[parameter.name for parameter in PARAMETERS])
    answer = client.call(DescribeParameters, 'octo_arm/describe_parameters', request)
    for parameter, descriptor in zip(PARAMETERS, answer.descriptors):
        assert descriptor.name == parameter.name
        assert descriptor.description == parameter.description
        assert descriptor.additional_constraints == parameter.range
        assert not descriptor.read_only


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'model': 'octopus'}, "model is 'octopus', expected one of renda2012"),
        ({'body__length': 0.2}, 'sections[1].anchorage is 0.45, expected at most the length'),
        ({'stations': 51, 'body__length': -1.0}, 'body.length is -1.0, expected a finite number'),
        (
            {'body__radius_tip': 1e-12, 'sections__offset_anchorage': [0.0, 0.0035, 0.006]},
            'this arm takes more than 20000 intervals, each no longer than thick',
        ),
        ({'base_frame': 'x' * 256}, 'expected string of at most 255 characters'),
    ],
)
def test_a_change_that_makes_no_arm_is_refused_as_a_whole(client, values, reason):
    is_taken, why = client.change(**values)
    assert not is_taken
    assert reason in why
    assert_is_backbone(client.ask('tendon_tensions', FETCHING_IN_PLANE), FETCHING_IN_PLANE)


@pytest.mark.parametrize('kind', [SetParameters, SetParametersAtomically])
@pytest.mark.parametrize(
    ('given', 'type_number', 'reason'),
    [
        ('stations', 77, 'stations is of type 77, expected 0 to 9'),
        ('statoins', 2, "'statoins' is no parameter of this node"),
    ],
)
def test_a_parameter_of_no_known_type_or_name_is_refused(client, kind, given, type_number, reason):
    is_plain = kind is SetParameters
    good = Parameter('stations', value=51).to_parameter_msg()
    bad = ParameterMessage(name=given, value=ParameterValue(type=type_number))
    name = 'set_parameters' if is_plain else 'set_parameters_atomically'
    answer = client.call(kind, f'octo_arm/{name}', kind.Request(parameters=[good, bad, good]))
    results = answer.results if is_plain else [answer.result]
    # Plain requests set each by itself, others all or none.
    assert [result.successful for result in results] == (
        [True, False, True] if is_plain else [False]
    )
    assert results[len(results) // 2].reason == reason
    assert client.dump()['stations'] == (51 if is_plain else 101)
    assert client.change(stations=101) == (True, '')


def test_tensions_are_answered_however_fast_parameters_change(client):
    assert client.change(markers_rate=20.0) == (True, '')
    request = SetParametersAtomically.Request()
    request.parameters = [Parameter('markers_rate', value=30.0).to_parameter_msg()]
    changes = client.service(SetParametersAtomically, 'octo_arm/set_parameters_atomically')
    asked = [changes.call_async(request) for _ in range(8)]
    client.ask('tendon_tensions', FETCHING_IN_PLANE)
    assert not all(one.done() for one in asked)
    client.wait(lambda: all(one.done() for one in asked), 'the changes')


NO_TIMES = [(-5, 0), (-(2**31), 0), (-1, 10**9), (2**31 - 1, 2**32 - 1)]


@pytest.mark.parametrize('kind', ['node', 'simulator'])
def test_a_clock_that_is_no_time_is_refused_and_the_next_one_taken(kind):
    with hosting(NODES[kind], node='clocked', use_sim_time=True) as client:
        is_node = kind == 'node'
        topic = 'backbone/path' if is_node else 'tendon_tensions'
        heard = client.answers[topic] if is_node else client.hear(TendonTensions, topic)
        tell, later = client.clock(), itertools.count(0, 1_000_000)  # [ns]
        # Nanoseconds beyond a second, back to before, and the last second there is.
        for sec, nanosec, expected in ((5, 4 * 10**9, 9), (3, 0, 3), (2**31 - 1, 0, 2**31 - 1)):

            def go_on(sec=sec, nanosec=nanosec):
                for bad in NO_TIMES:
                    tell(*bad)
                    client.spin(0.02)
                # The simulator measures when time goes on.
                tell(sec, nanosec + next(later))
                if is_node:
                    client.send('tendon_tensions/array', FETCHING_IN_PLANE)

            client.wait(
                lambda sec=expected: heard and heard[-1].header.stamp.sec == sec,
                f'an answer at {expected} s',
                go_on,
            )
        if is_node:
            client.diagnostics.clear()
            client.wait(lambda: client.diagnostics, 'a diagnosis, though time stands still')
            assert client.diagnostics[-1].header.stamp.sec == 2**31 - 1
            client.stamps = itertools.count(7)
            path, *_ = client.ask('tendon_tensions', FETCHING_IN_PLANE)
            assert path.header.stamp.sec == 7
        # At most one a second is logged, of whichever comes first.
        client.log('/clock refused: it is -5 s', again=lambda: tell(-5))
