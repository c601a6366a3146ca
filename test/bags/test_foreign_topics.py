"""Tensions on topics of any type, under any names."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experiments import ARM, bag_of, description, nanoseconds
from labs import MARKER_S, TIP_ERRORS, pose_array, seen, staircase_of
from numpy.testing import assert_array_equal
from recordings import Sample, header, make, message

from octo_arm_model.arm.errors import TensionError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.wire.tensions import field_values, tensions_by_names

S = ['--marker-s', *map(str, MARKER_S)]
STILL = ['--clock-offset', '0', '--json']
CELLS = '/daq/cells'


def layout() -> Any:
    return make('std_msgs/msg/MultiArrayLayout', dim=[], data_offset=0)


def float32(pull: float, stamp: int) -> Sample:
    data = np.array([0.0, 0.0, pull, 0.0], np.float32)
    return message(CELLS, 'std_msgs/msg/Float32MultiArray', stamp, layout=layout(), data=data)


def six_channels(pull: float, stamp: int) -> Sample:
    data = np.array([20.5, 0.0, 3.3, pull, 0.0, 0.0])
    return message(CELLS, 'std_msgs/msg/Float64MultiArray', stamp, layout=layout(), data=data)


def joints(pull: float, stamp: int) -> Sample:
    names = ['elbow', 'LC west', 'LC south', 'LC east', 'LC north']
    none = np.zeros(0)
    return message(
        CELLS, 'sensor_msgs/msg/JointState', stamp, header=header(stamp), name=names,
        position=none, velocity=none, effort=np.array([7.0, 0.0, 0.0, 0.0, pull]),
    )  # fmt: skip


def wrench(pull: float, stamp: int) -> Sample:
    force, none = ({'x': 1.0, 'y': 2.0, 'z': pull}, {'x': 0.0, 'y': 0.0, 'z': 0.0})
    both = {
        name: make('geometry_msgs/msg/Vector3', **one)
        for name, one in (('force', force), ('torque', none))
    }
    return message(
        CELLS, 'geometry_msgs/msg/WrenchStamped', stamp, header=header(stamp),
        wrench=make('geometry_msgs/msg/Wrench', **both),
    )  # fmt: skip


def bag(path: Path, cell: Any) -> str:
    time, pulled, times = staircase_of()
    samples = [description(model='exact')]
    samples += [cell(float(pull), nanoseconds(at)) for at, pull in zip(time, pulled)]
    for at, pull in zip(times, np.interp(times, time, pulled)):
        samples += pose_array(seen(float(pull), MARKER_S), nanoseconds(at))
    return str(bag_of(path, samples))


WAYS = {
    'Float32MultiArray': (float32, [], ['2', '0', '1', '3']),
    'Float64MultiArray': (six_channels, [], ['3', '4', '5', '-']),
    'a field of an array': (six_channels, ['--tensions', f'{CELLS}:data'], ['3', '4', '5', '1']),
    'one entry': (six_channels, ['--tensions', f'{CELLS}:data[3]'], ['0', '-', '-', '-']),
    'JointState': (joints, [], ['LC north', 'LC east', 'LC south', 'LC west']),
    'a field of JointState': (joints, ['--tensions', f'{CELLS}:effort'],
                              ['LC north', '-', 'LC south', 'LC west']),
    'WrenchStamped': (wrench, ['--tensions', f'{CELLS}:wrench.force.z'], ['0', '-', '-', '-']),
}  # fmt: skip


@pytest.mark.parametrize('way', WAYS)
def test_any_numbers_are_tensions_where_it_is_said_whose(way, tmp_path, cli):
    cell, topic, tendons = WAYS[way]
    path = bag(tmp_path / 'bag', cell)
    said = cli.json('compare', path, *topic, '--tendons', *tendons, *S, *STILL)
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS, abs=0.03)
    topics = ['--topics', *topic[1:]] if topic else []
    out = str(tmp_path / 'out')
    replayed = cli.json('replay', path, out, *topics, '--tendons', *tendons, '--json')
    (report,) = replayed['topics'].values()
    assert report['answered'] == len(staircase_of()[0])
    with BagReader(out) as reader:
        assert reader.count(['/daq/tip_pose']) == report['answered']


@pytest.mark.parametrize(
    ('cell', 'options', 'message'),
    [
        (wrench, [], 'any numeric field will do, as TOPIC:FIELD: /daq/cells:{wrench.force.x,'),
        (wrench, ['--tensions', CELLS], '/daq/cells:{wrench.force.x,wrench.force.y,wrench.force.'),
        (wrench, ['--tensions', f'{CELLS}:force'], "no numeric field 'force'; it has wrench.forc"),
        (wrench, ['--tensions', '/none:data'], 'no topic /none for tensions; it has'),
        (wrench, ['--tensions', f'{CELLS}:wrench.force.z'], '1 values, expected 4, one for each'),
        (six_channels, ['--tendons', '0', '1', '2', '9'], "no value '9' for tendon_1_4; there ar"),
        (six_channels, ['--tensions', f'{CELLS}:data[9]'], 'it has no entry 9'),
        (joints, ['--tendons', 'a', 'b', 'c', 'd'], "no value 'a' for tendon_1_1; there are elbo"),
        (joints, ['--tendons', 'a'], 'tension_names has 1 values, expected 4, one per tendon'),
        (joints, ['--tendons', 'a', 'a', '-', '-'], 'expected distinct names or -'),
        (
            joints,
            ['--tendons', '-', '-', '-', '-'],
            'expected distinct names or -, one name at least',
        ),
    ],
)
def test_what_fits_no_tendon_is_refused_and_says_what_there_is(
    cell, options, message, tmp_path,
    cli,
):  # fmt: skip
    assert message in cli.refused('compare', bag(tmp_path / 'bag', cell), *options, *S, *STILL)


def test_fields_of_messages_hold_numbers_or_are_refused():
    class Inner:
        value = 2.5
        text = 'x'
        many = np.arange(3, dtype=np.float32)
        rows = ((1.0, 2.0), (3.0,))

    class Outer:
        inner = Inner()
        bits = (True,)

    assert field_values(Outer(), 'inner.value') == [2.5]
    assert field_values(Outer(), 'inner.many[1]') == [1.0]
    assert_array_equal(field_values(Outer(), 'inner.many'), [0.0, 1.0, 2.0])
    for path in ('inner', 'inner.text', 'inner.rows', 'bits', 'inner.__class__', '', 'inner.',
                 'inner.many[3]', 'inner.value[0]', 'inner.many[-1]'):  # fmt: skip
        with pytest.raises(TensionError):
            field_values(Outer(), path)


def test_a_name_that_is_there_twice_is_refused_where_it_is_wanted():
    values, names = np.arange(3.0), ['a', 'a', 'b']
    found = tensions_by_names(values, names, ['b', '-', '-', '-'], ARM)
    assert_array_equal(found.ravel(), [2.0, 0.0, 0.0, 0.0])
    with pytest.raises(TensionError, match='named more than once: a'):
        tensions_by_names(values, names, ['a', '-', '-', '-'], ARM)
