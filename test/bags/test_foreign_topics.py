"""What is read of which topics: tensions of any type under any name, and what estimators read."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from experiments import ARM, MARKER_S, TIP_ERRORS, marker_bag, staircase_of
from numpy.testing import assert_array_equal
from recordings import (
    START,
    Sample,
    displacement_sample,
    header,
    make,
    message,
    point,
    pose,
    tensions_data,
    write_bag,
)

from octo_arm_model.arm.errors import BagError, TensionError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.sensor_topics import NONE, SensorTopics, find_sensors
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.experiment.bag_recording import read_readings
from octo_arm_model.experiment.recording import Count, StampedRows
from octo_arm_model.experiment.sensor_recording import read_measured
from octo_arm_model.wire.measurements import MeasuredArm, points_of
from octo_arm_model.wire.messages import Refusals
from octo_arm_model.wire.tensions import field_values, tensions_by_names

S = ['--marker-s', *map(str, MARKER_S)]
STILL = ['--clock-offset', '0', '--json']
CELLS = '/daq/cells'


def array(size: int, data: list[float], stamp: int) -> Sample:
    kind, layout = f'std_msgs/msg/Float{size}MultiArray', 'std_msgs/msg/MultiArrayLayout'
    numbers = np.array(data, f'f{size // 8}')
    return message(CELLS, kind, stamp, layout=make(layout, dim=[], data_offset=0), data=numbers)


def float32(pull: float, stamp: int) -> Sample:
    return array(32, [0.0, 0.0, pull, 0.0], stamp)


def six_channels(pull: float, stamp: int) -> Sample:
    return array(64, [20.5, 0.0, 3.3, pull, 0.0, 0.0], stamp)


def joints(pull: float, stamp: int) -> Sample:
    fields = dict.fromkeys(('position', 'velocity'), np.zeros(0))
    fields['effort'] = np.array([7.0, 0.0, 0.0, 0.0, pull])
    names = ['elbow', 'LC west', 'LC south', 'LC east', 'LC north']
    kind = 'sensor_msgs/msg/JointState'
    return message(CELLS, kind, stamp, header=header(stamp), name=names, **fields)


def wrench(pull: float, stamp: int) -> Sample:
    force, none = (point(one, 'Vector3') for one in ((1.0, 2.0, pull), (0.0, 0.0, 0.0)))
    both = make('geometry_msgs/msg/Wrench', force=force, torque=none)
    kind = 'geometry_msgs/msg/WrenchStamped'
    return message(CELLS, kind, stamp, header=header(stamp), wrench=both)


WAYS = {
    'Float32MultiArray': (float32, [], ['2', '0', '1', '3']),
    'Float64MultiArray': (six_channels, [], ['3', '4', '5', '-']),
    'a field of an array': (six_channels, ['--tensions', f'{CELLS}:data'], ['3', '4', '5', '1']),
    'one entry': (six_channels, ['--tensions', f'{CELLS}:data[3]'], ['0', '-', '-', '-']),
    'JointState': (joints, [], ['LC north', 'LC east', 'LC south', 'LC west']),
    'a field of JointState': (
        joints,
        ['--tensions', f'{CELLS}:effort'],
        ['LC north', '-', 'LC south', 'LC west'],
    ),
    'WrenchStamped': (wrench, ['--tensions', f'{CELLS}:wrench.force.z'], ['0', '-', '-', '-']),
}


@pytest.mark.parametrize('way', WAYS)
def test_any_numbers_are_tensions_where_it_is_said_whose(way, tmp_path, cli):
    cell, topic, tendons = WAYS[way]
    path = marker_bag(tmp_path / 'bag', read=cell)
    said = cli.json('compare', path, *topic, '--tendons', *tendons, *S, *STILL)
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS, abs=0.03)
    topics = ['--topics', *topic[1:]] if topic else []
    out = tmp_path / 'out'
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
        (joints, ['--tendons', *'----'], 'expected distinct names or -, one name at least'),
    ],
)
def test_what_fits_no_tendon_is_refused_and_says_what_there_is(
    cell, options, message, tmp_path, cli
):
    bag = marker_bag(tmp_path / 'bag', read=cell)
    assert message in cli.refused('compare', bag, *options, *S, *STILL)


def test_fields_of_messages_hold_numbers_or_are_refused():
    many, rows = np.arange(3, dtype=np.float32), ((1.0, 2.0), (3.0,))
    inner = SimpleNamespace(value=2.5, text='x', many=many, rows=rows)
    outer = SimpleNamespace(inner=inner, bits=(True,))
    assert field_values(outer, 'inner.value') == [2.5]
    assert field_values(outer, 'inner.many[1]') == [1.0]
    assert_array_equal(field_values(outer, 'inner.many'), [0.0, 1.0, 2.0])
    no_numbers = 'inner', 'inner.text', 'inner.rows', 'bits', 'inner.__class__', '', 'inner.'
    for path in (*no_numbers, 'inner.many[3]', 'inner.value[0]', 'inner.many[-1]'):
        with pytest.raises(TensionError):
            field_values(outer, path)


def test_a_name_that_is_there_twice_is_refused_where_it_is_wanted():
    values, names = np.arange(3.0), ['a', 'a', 'b']
    found = tensions_by_names(values, names, ['b', '-', '-', '-'], ARM)
    assert_array_equal(found.ravel(), [2.0, 0.0, 0.0, 0.0])
    with pytest.raises(TensionError, match='named more than once: a'):
        tensions_by_names(values, names, ['a', '-', '-', '-'], ARM)


def test_a_name_that_is_a_number_is_no_place_among_other_names():
    values, chosen = np.arange(3.0), ['2', '-', '-', '-']
    assert tensions_by_names(values, ['1', '2', '3'], chosen, ARM)[0, 0] == 1.0
    assert tensions_by_names(values, None, chosen, ARM)[0, 0] == 2.0
    with pytest.raises(TensionError, match="no value '2' for tendon_1_1; there are 1, 3, 4"):
        tensions_by_names(values, ['1', '3', '4'], chosen, ARM)
    places = [SimpleNamespace(id=number, x=float(number), y=0.0, z=0.0) for number in (1, 3, 4)]
    assert_array_equal(points_of(places, ['2', '3'])[:, 0], [np.nan, 3.0])  # 2 is hidden
    for place in places:
        place.id = 0
    assert_array_equal(points_of(places, ['2', '0'])[:, 0], [4.0, 1.0])


CONFIG = Config.from_parameters(load_parameters('renda2012_prototype'))
NAMES = CONFIG.arm.tendon_names
MILLISECOND = 10**6


def tensions(at: int, row: list[float], topic: str = '/tendon_tensions') -> Sample:
    kind = 'octo_arm_msgs/msg/TendonTensions'
    data = tensions_data(kind, NAMES, row, START + at * MILLISECOND)
    return Sample(topic, kind, START + (at + 3) * MILLISECOND, data)


def encoders(at: int, topic: str = '/tendon_displacements') -> Sample:
    stamp = START + at * MILLISECOND
    return displacement_sample(NAMES, np.full(4, 1e-3), stamp, topic, 40 * MILLISECOND)


def markers(at: int, count: int = 1, topic: str = '/measured/markers') -> Sample:
    stamp = START + at * MILLISECOND
    return message(
        topic,
        'geometry_msgs/msg/PoseArray',
        stamp + 90 * MILLISECOND,
        header=header(stamp, 'arm_base'),
        poses=count * [pose(np.zeros(3))],
    )


def read(path: Path, content: list[Sample]) -> tuple[SensorTopics, StampedRows, list, Refusals]:
    """The sensors of a bag, tensions, all that is measured by its stamps, and what is left out."""
    settings = EstimatorSettings.from_parameters({'estimator.marker_s': [0.2]}, CONFIG)
    content, refusals = sorted(content, key=lambda one: one.received_ns), Refusals()
    with BagReader(write_bag(path, content)) as reader:
        sensors = find_sensors(reader)
        read = read_readings(reader, sensors.tensions, CONFIG, refusals, Count(), raw=True)
        rows, arm = read or StampedRows(''), MeasuredArm(CONFIG, settings)
        groups = read_measured(reader, sensors, rows, arm, refusals, Count())
    return sensors, rows, groups, refusals


def test_all_is_in_order_of_stamps_whenever_it_came(tmp_path):
    # Markers come 90 ms late, encoders 40 ms, and two tensions are the wrong way round.
    content = [
        tensions(0, [0.1, 0, 0, 0]),
        tensions(20, [0.3, 0, 0, 0]),
        tensions(10, [-0.01, 0, 0, 0]),
        encoders(10),
        markers(5),
        markers(20),
        encoders(30),
    ]
    sensors, rows, groups, refusals = read(tmp_path / 'bag', content)
    assert sensors.all == ['/tendon_tensions', '/tendon_displacements', '/measured/markers']
    assert sensors.prefix == '/'
    assert sorted(row[0] for row in rows.rows) == [-0.01, 0.1, 0.3]
    found = [
        ((group[0].stamp_ns - START) // MILLISECOND, [one.measurement.name for one in group])
        for group in groups
    ]
    assert found == [
        (0, ['tensions']),
        (5, ['markers']),
        (10, ['tensions', 'tendon displacements']),
        (20, ['tensions', 'markers']),
        (30, ['tendon displacements']),
    ]
    assert not refusals.total


def test_messages_that_measure_nothing_are_told(tmp_path):
    broken = 'geometry_msgs/msg/PoseArray', START, b'\0\1\0\0broken'
    content = [
        tensions(0, [np.nan, 0, 0, 0]),
        markers(5, 2),
        tensions(10, [0.1, 0, 0, 0]),
        tensions(20, [0, 0, -1e200, 0]),
        Sample('/measured/markers', *broken),
        markers(-2 * START // MILLISECOND)._replace(received_ns=START),
    ]
    _, rows, groups, refusals = read(tmp_path / 'bag', content)
    assert len(groups) == 1 and [row.tolist() for row in rows.rows] == [[0.1, 0.0, 0.0, 0.0]]
    reasons = ' | '.join(refusals.lines())
    for words in (
        f'/tendon_tensions: 1 left out, as reading of {NAMES[0]} is nan, expected a finite',
        f'reading of {NAMES[2]} is -1e+200, expected a finite number [N] of at most 1e+30',
        '/measured/markers: 1 left out, as ',
        '2 marker(s), expected 1',
        'bytes that are no geometry_msgs',
        f'its stamp is -{START // 10**9} s and 0 ns, expected s >= 0',
    ):
        assert words in reasons


def test_a_robot_with_encoders_alone_has_no_tensions(tmp_path):
    sensors, rows, groups, _ = read(tmp_path / 'bag', [encoders(0, '/left/tendon_displacements')])
    assert (sensors.tensions, sensors.prefix) == (None, '/left/')
    assert not rows.rows and len(groups) == 1


def test_topics_of_tensions_without_a_message_are_none(tmp_path):
    silent = dict.fromkeys(('/tendon_tensions', '/cells'), 'std_msgs/msg/Float64MultiArray')
    path = write_bag(tmp_path / 'bag', [encoders(0)], silent=silent)
    with BagReader(path) as reader:
        assert find_sensors(reader).tensions is None


def test_topics_are_named_or_left_out(tmp_path):
    content = [
        tensions(0, [0.1, 0, 0, 0]),
        tensions(0, [0.2, 0, 0, 0], '/other/cells'),
        markers(0),
        markers(0, topic='/mocap/points'),
        encoders(0),
    ]
    with BagReader(write_bag(tmp_path / 'bag', content)) as reader:
        assert find_sensors(reader).tensions.topic == '/tendon_tensions'
        found = find_sensors(
            reader,
            'other/cells',
            {'measured/markers': '/mocap/points', 'tendon_displacements': NONE},
        )
        assert found.all == ['/other/cells', '/mocap/points']
        assert find_sensors(reader, '/other/cells:tension').tensions.field == 'tension'
        assert find_sensors(reader, NONE).tensions is None
        with pytest.raises(BagError, match=r'topic /tendon_tensions is of octo_arm_msgs'):
            find_sensors(reader, None, {'measured/markers': '/tendon_tensions'})


def test_estimates_of_an_estimator_are_no_measurements(tmp_path):
    content = [
        tensions(0, [0.1, 0, 0, 0], topic)
        for topic in ('/tension_bias', '/tendon_tension_estimates', '/cells')
    ]
    with BagReader(write_bag(tmp_path / 'bag', content)) as reader:
        assert find_sensors(reader).all == ['/cells']
