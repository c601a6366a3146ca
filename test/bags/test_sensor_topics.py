"""What a bag holds for an estimator: its topics, in order of stamps, and what is left out."""

from pathlib import Path

import numpy as np
import pytest
import recordings

from octo_arm_model.arm.errors import BagError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.sensor_topics import (
    NONE,
    RecordedTensions,
    SensorTopics,
    find_sensors,
    read_measured,
    read_tension_rows,
)
from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters, preset_path
from octo_arm_model.estimation.settings import EstimatorSettings
from octo_arm_model.wire.measurements import MeasuredArm
from octo_arm_model.wire.messages import Refusals

CONFIG = Config.from_parameters(load_parameters(preset_path('renda2012_prototype')))
NAMES = CONFIG.arm.tendon_names
MILLISECOND = 10**6


def tensions(at: int, row: list[float], topic: str = '/tendon_tensions') -> recordings.Sample:
    kind = 'octo_arm_msgs/msg/TendonTensions'
    data = recordings.tensions_data(kind, NAMES, row, recordings.START + at * MILLISECOND)
    return recordings.Sample(topic, kind, recordings.START + (at + 3) * MILLISECOND, data)


def encoders(at: int, topic: str = '/tendon_displacements') -> recordings.Sample:
    stamp = recordings.START + at * MILLISECOND
    return recordings.displacement_sample(NAMES, np.full(4, 1e-3), stamp, topic, 40 * MILLISECOND)


def markers(at: int, count: int = 1, topic: str = '/measured/markers') -> recordings.Sample:
    stamp = recordings.START + at * MILLISECOND
    return recordings.message(
        topic, 'geometry_msgs/msg/PoseArray', stamp + 90 * MILLISECOND,
        header=recordings.header(stamp, 'arm_base'), poses=count * [recordings.pose(np.zeros(3))],
    )  # fmt: skip


def read(
    path: Path, content: list[recordings.Sample]
) -> tuple[SensorTopics, RecordedTensions, list, Refusals]:
    """The sensors of a bag, tensions, all that is measured by its stamps, and what is left out."""
    noise = EstimatorSettings.from_parameters({'estimator.marker_s': [0.2]}, CONFIG).noise
    content, refusals = sorted(content, key=lambda one: one.received_ns), Refusals()
    with BagReader(recordings.write_bag(path, content)) as reader:
        sensors = find_sensors(reader)
        rows = read_tension_rows(reader, sensors, CONFIG, refusals)
        groups = read_measured(reader, sensors, rows, MeasuredArm(CONFIG, noise), refusals)
    return sensors, rows, groups, refusals


def test_all_is_in_order_of_stamps_whenever_it_came(tmp_path):
    # Markers come 90 ms late, encoders 40 ms, and two tensions are the wrong way round.
    content = [
        tensions(0, [0.1, 0, 0, 0]), tensions(20, [0.3, 0, 0, 0]), tensions(10, [-0.01, 0, 0, 0]),
        encoders(10), markers(5), markers(20), encoders(30),
    ]  # fmt: skip
    sensors, rows, groups, refusals = read(tmp_path / 'bag', content)
    assert sensors.all == ['/tendon_tensions', '/tendon_displacements', '/measured/markers']
    assert sensors.prefix == '/'
    assert sorted(rows.rows[:, 0]) == [-0.01, 0.1, 0.3]
    found = [
        (
            (group[0].stamp_ns - recordings.START) // MILLISECOND,
            [one.measurement.name for one in group],
        )
        for group in groups
    ]
    assert found == [
        (0, ['tensions']), (5, ['markers']), (10, ['tensions', 'tendon displacements']),
        (20, ['tensions', 'markers']), (30, ['tendon displacements']),
    ]  # fmt: skip
    assert not refusals.total


def test_messages_that_measure_nothing_are_told(tmp_path):
    broken = 'geometry_msgs/msg/PoseArray', recordings.START, b'\0\1\0\0broken'
    content = [
        tensions(0, [np.nan, 0, 0, 0]), markers(5, 2), tensions(10, [0.1, 0, 0, 0]),
        tensions(20, [0, 0, -1e200, 0]), recordings.Sample('/measured/markers', *broken),
    ]  # fmt: skip
    _, rows, groups, refusals = read(tmp_path / 'bag', content)
    assert len(groups) == 1 and rows.rows.tolist() == [[0.1, 0.0, 0.0, 0.0]]
    reasons = ' | '.join(refusals.lines())
    for words in (
        f'/tendon_tensions: 1 left out, as reading of {NAMES[0]} is nan N, expected a finite',
        f'reading of {NAMES[2]} is -1e+200 N, expected a finite number of at most 1e+30',
        '/measured/markers: 1 left out, as ', '2 marker(s), expected 1',
        'bytes that are no geometry_msgs',
    ):  # fmt: skip
        assert words in reasons


def test_a_robot_with_encoders_alone_has_no_tensions(tmp_path):
    sensors, rows, groups, _ = read(tmp_path / 'bag', [encoders(0, '/left/tendon_displacements')])
    assert (sensors.tensions, sensors.prefix) == ('', '/left/')
    assert not len(rows.rows) and len(groups) == 1


def test_topics_are_named_or_left_out(tmp_path):
    content = [
        tensions(0, [0.1, 0, 0, 0]), tensions(0, [0.2, 0, 0, 0], '/other/cells'),
        markers(0), markers(0, topic='/mocap/points'), encoders(0),
    ]  # fmt: skip
    with BagReader(recordings.write_bag(tmp_path / 'bag', content)) as reader:
        assert find_sensors(reader).tensions == '/tendon_tensions'
        found = find_sensors(
            reader, 'other/cells', {'measured/markers': '/mocap/points',
                                    'tendon_displacements': NONE},
        )  # fmt: skip
        assert found.all == ['/other/cells', '/mocap/points']
        assert find_sensors(reader, '/other/cells:tension').field == 'tension'
        assert find_sensors(reader, NONE).tensions == ''
        with pytest.raises(BagError, match=r'topic /tendon_tensions is of octo_arm_msgs'):
            find_sensors(reader, None, {'measured/markers': '/tendon_tensions'})
        with pytest.raises(BagError, match='no topic /gone for measured/tip_pose'):
            find_sensors(reader, None, {'measured/tip_pose': '/gone'})
        everything = dict.fromkeys(('tendon_displacements', 'measured/markers'), NONE)
        with pytest.raises(BagError, match='nothing is measured there, expected tensions or'):
            find_sensors(reader, NONE, everything)


def test_estimates_of_an_estimator_are_no_measurements(tmp_path):
    content = [tensions(0, [0.1, 0, 0, 0], topic)
               for topic in ('/tension_bias', '/tendon_tension_estimates', '/cells')]  # fmt: skip
    with BagReader(recordings.write_bag(tmp_path / 'bag', content)) as reader:
        assert find_sensors(reader).all == ['/cells']
