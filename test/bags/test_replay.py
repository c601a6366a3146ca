"""Replay: the shapes of tensions and displacements in a bag, as the node answers them."""

import dataclasses
import os
import signal
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from recordings import (
    ARRAY,
    JOINT_STATE,
    START,
    STEP,
    TENDON_TENSIONS,
    Sample,
    assert_alike,
    displacement_sample,
    header,
    make,
    message,
    point,
    random_tensions,
    samples,
    tensions_data,
    text_sample,
    write_bag,
)

from octo_arm_model import Backbone, Config, displacements_of, load_config, solve_displacements
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.replay import replay
from octo_arm_model.bags.sensor_topics import find_sensors
from octo_arm_model.bags.topics import ANSWERS, find_arms
from octo_arm_model.bags.writer import STORAGES, BagWriter
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import (
    load_parameters,
    parameters_as_yaml,
    parse_parameters,
    preset_path,
)
from octo_arm_model.wire.backbone import BackboneWriter

TABLE_4 = load_parameters('renda2012_table4')
ARM = Config.from_parameters(TABLE_4).arm
DESCRIPTION = text_sample('/arm_description', parameters_as_yaml(TABLE_4))
BACKBONE = ('/backbone/path', '/backbone/poses', '/strains', '/tip_pose')


def content_of(path: Path, *topics: str) -> list[tuple[str, str, int, bytes]]:
    with BagReader(path) as reader:
        return [tuple(record) for record in reader.messages(topics or None)]


def writer_of(config: Config) -> BackboneWriter:
    grid = config.solver().grid
    return BackboneWriter(
        config.base_frame, config.model, grid.s, grid.section, config.arm.tendon_names
    )


def expected_messages(
    config: Config, backbone: Backbone, stamp_ns: int, covariance: Any = None
) -> list[bytes]:
    """Answer of the node, on every topic but the lengths."""
    known = np.zeros((6, 6)) if covariance is None else covariance
    return [*writer_of(config).all(backbone, known, *divmod(stamp_ns, 10**9)).values()]


# The same bytes ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('preset', 'model', 'kind', 'storage', 'count'),
    [
        ('renda2012_table4', 'renda2012', TENDON_TENSIONS, 'mcap', 140),
        ('renda2012_table4', 'renda2012', ARRAY, 'sqlite3', 20),
        ('renda2012_table4', 'exact', JOINT_STATE, 'mcap', 20),
        ('renda2012_prototype', 'closed_form', TENDON_TENSIONS, 'mcap', 12),
        ('rao2021', 'closed_form', TENDON_TENSIONS, 'mcap', 12),
        ('rao2021', 'exact', TENDON_TENSIONS, 'mcap', 12),
    ],
)
def test_answers_are_those_of_single_solves(cli, tmp_path, preset, model, kind, storage, count):
    config = dataclasses.replace(load_config(preset_path(preset)), model=model)
    tensions = random_tensions(config.arm, count)
    bag = write_bag(tmp_path / 'in', samples(config.arm, tensions, '/pulls', kind), storage)
    given = '--config', preset, '--model', model, '--storage', storage
    assert cli('replay', bag, tmp_path / 'out', *given)[0] == 0
    solver = config.solver(compiled=None)
    found = content_of(tmp_path / 'out', *BACKBONE)
    assert len(found) == 4 * count
    for number, row in enumerate(tensions):
        received = START + number * STEP + 1000
        stamp = received if kind == ARRAY else received - 1000
        expected = expected_messages(config, solver.solve(row), stamp)
        for topic, data, one in zip(BACKBONE, expected, found[4 * number : 4 * number + 4]):
            assert one[:3] == (topic, ANSWERS[topic[1:]], received)
            assert_alike([one[3]], [data])


def test_a_loaded_arm_follows_its_last_solution_and_begins_anew_when_time_goes_back(cli, tmp_path):
    values = load_parameters('renda2012_prototype')
    values |= {
        'model': 'exact',
        'material.density': 1080.0,
        'loads.gravity': [0.0, 0.0, -9.81],
        'tension_stddev': 0.05,
    }
    config = Config.from_parameters(values)
    tensions = np.zeros((6, 1, 4))
    tensions[:, 0, 0] = (0.0, 0.3, 0.6, 0.9, 0.2, 0.4)
    content = samples(config.arm, tensions)
    early = tensions_data(TENDON_TENSIONS, config.arm.tendon_names, tensions[4], START + STEP)
    content[4] = content[4]._replace(data=early)
    bag = write_bag(tmp_path / 'in', content)
    (tmp_path / 'arm.yaml').write_text(parameters_as_yaml(values))
    options = ['--config', str(tmp_path / 'arm.yaml'), '--lengths']
    assert cli('replay', bag, tmp_path / 'out', *options)[0] == 0
    found = content_of(tmp_path / 'out', *BACKBONE, '/tendon_lengths')
    solver, last, writer = config.solver(compiled=None), None, writer_of(config)
    for number, row in enumerate(tensions):
        last = solver.solve(row, start=None if number == 4 else last)
        stamp = START + (number if number != 4 else 1) * STEP
        covariance = solver.tip_covariance(last, config.uncertainty)
        assert covariance.any()
        expected = expected_messages(config, last, stamp, covariance)
        lengths = solver.tendon_lengths(last)
        expected.append(writer.tendon_lengths(lengths, last.tensions, *divmod(stamp, 10**9)))
        assert_alike([one[3] for one in found[5 * number : 5 * number + 5]], expected)


@pytest.mark.parametrize('kind', [TENDON_TENSIONS, JOINT_STATE])
def test_stamps_stay_as_they_are_or_are_refused(tmp_path, kind, cli):
    good = [(1, 999_999_999), (2**31 - 1, 999_999_999), (0, 7)]
    bad = [(1, 4_000_000_000), (2**31 - 1, 2**32 - 1), (-(2**31), 0), (-1, 10**9)]
    stamps = [good[0], *bad, *good[1:]]
    content = samples(ARM, random_tensions(ARM, len(stamps)), '/tendon_tensions', kind)
    for number, stamp in enumerate(stamps):
        data = content[number].data
        data = data[:4] + struct.pack('<iI', *stamp) + data[12:]
        content[number] = content[number]._replace(data=data)
    bag = write_bag(tmp_path / 'in', [DESCRIPTION, *content])
    status, out, _ = cli('replay', bag, tmp_path / 'out', '--topics', '/tendon_tensions')
    assert status == 0 and f'  {len(bad)} refused\n' in out
    for topic in BACKBONE:
        found = content_of(tmp_path / 'out', topic)
        assert [struct.unpack_from('<iI', data, 4) for *_, data in found] == good


# What else is in the bag ------------------------------------------------------------------------


@pytest.mark.parametrize('storage', STORAGES)
def test_the_source_is_copied_and_stays_as_it_is(cli, tmp_path, storage):
    content = [DESCRIPTION, *samples(ARM, random_tensions(ARM, 30))]
    content.insert(7, text_sample('/note', 'the cat came in', START + 5 * STEP))
    bag = write_bag(tmp_path / 'in', content, storage)

    def files():
        return {one: (one.read_bytes(), one.stat().st_mtime_ns) for one in bag.iterdir()}

    before = files()
    assert cli('replay', bag, tmp_path / 'out')[0] == 0
    assert files() == before
    both = ('/note', '/tendon_tensions')
    assert content_of(tmp_path / 'out', *both) == content_of(bag, *both)
    assert cli('replay', bag, tmp_path / 'alone', '--no-copy')[0] == 0
    with BagReader(tmp_path / 'alone') as reader:
        assert set(reader.topics) == {*BACKBONE, '/arm_description'}
    # An answer stands right behind what it answers.
    order = [topic for topic, *_ in content_of(tmp_path / 'out')]
    assert order[1:6] == ['/tendon_tensions', *BACKBONE]


def test_answers_replace_those_recorded_and_say_so(tmp_path, cli):
    bag = write_bag(tmp_path / 'in', [DESCRIPTION, *samples(ARM, random_tensions(ARM, 10))])
    assert cli('replay', bag, tmp_path / 'once', '--model', 'closed_form')[0] == 0
    again = 'replay', tmp_path / 'once', tmp_path / 'twice', '--model', 'renda2012'
    assert '/backbone/path not copied: written anew' in cli(*again)[1]
    assert cli('replay', bag, tmp_path / 'plain')[0] == 0
    assert content_of(tmp_path / 'twice') == content_of(tmp_path / 'plain')


def test_the_description_of_the_answers_is_latched_and_has_the_model(cli, tmp_path):
    bag = write_bag(tmp_path / 'in', [DESCRIPTION, *samples(ARM, random_tensions(ARM, 2))])
    assert cli('replay', bag, tmp_path / 'out', '--model', 'closed_form')[0] == 0
    with BagReader(tmp_path / 'out') as reader:
        (record,) = reader.messages(['/arm_description'])
        values = parse_parameters(reader.decode(record).data, 'it')
        (connection,) = reader.connections(['/arm_description'])
        assert reader.metadata['octo_arm_replay'] == 'shapes for in'
    assert values == {
        **parse_parameters(parameters_as_yaml(TABLE_4), 'it'),
        'model': 'closed_form',
    }
    (qos,) = connection.ext.offered_qos_profiles
    assert qos.durability.name == 'TRANSIENT_LOCAL'
    information = yaml.safe_load((tmp_path / 'out' / 'metadata.yaml').read_text())
    assert information['rosbag2_bagfile_information']['version'] == 9


def test_each_arm_is_answered_in_its_namespace_as_it_describes_itself(cli, tmp_path):
    softer = {**TABLE_4, 'material.youngs_modulus': 1e5, 'model': 'closed_form'}
    content = [
        text_sample('/arm_1/arm_description', parameters_as_yaml(TABLE_4)),
        text_sample('/arm_2/arm_description', parameters_as_yaml(softer)),
        *samples(ARM, random_tensions(ARM, 5), '/arm_1/tendon_tensions'),
        *samples(ARM, random_tensions(ARM, 5), '/arm_2/tendon_tensions/array', ARRAY),
    ]
    bag = write_bag(tmp_path / 'in', content)
    assert cli('replay', bag, tmp_path / 'out')[0] == 0
    for name, values in (('arm_1', TABLE_4), ('arm_2', softer)):
        config = Config.from_parameters(values)
        found = content_of(tmp_path / 'out', *(f'/{name}{topic}' for topic in BACKBONE))
        assert len(found) == 20
        stamp = START + (1000 if name == 'arm_2' else 0)
        backbone = config.solver(compiled=None).solve(random_tensions(ARM, 5)[0])
        assert_alike([one[3] for one in found[:4]], expected_messages(config, backbone, stamp))
    # One of them alone, when asked.
    options = ['--topics', 'arm_1/tendon_tensions']
    assert cli('replay', bag, tmp_path / 'one', *options)[0] == 0
    with BagReader(tmp_path / 'one') as reader:
        assert '/arm_2/backbone/path' not in reader.topics


def test_sensors_and_description_of_another_arm_are_not_taken(cli, tmp_path):
    lengths = displacement_sample(
        ARM.tendon_names, np.zeros(12), START, '/right/tendon_displacements'
    )
    bag = write_bag(
        tmp_path / 'in',
        [
            text_sample('/right/arm_description', parameters_as_yaml(TABLE_4)),
            lengths,
            *samples(ARM, random_tensions(ARM, 5), '/left/tendon_tensions'),
            *samples(ARM, random_tensions(ARM, 5), '/right/tendon_tensions'),
        ],
    )
    with BagReader(bag) as reader:
        assert find_sensors(reader, 'left/tendon_tensions').all == ['/left/tendon_tensions']
        assert lengths.topic in find_sensors(reader, '/right/tendon_tensions').all
    said = cli.refused('replay', bag, tmp_path / 'out', '--topics', '/left/tendon_tensions')
    assert 'no topic arm_description, so say which arm' in said


# What does not fit ------------------------------------------------------------------------------


def test_what_cannot_be_answered_is_left_out_and_reported(tmp_path, cli):
    content = samples(ARM, random_tensions(ARM, 300))
    names, some = ARM.tendon_names, np.full(12, 0.1)
    bad = {
        100: (names, np.where(np.arange(12) == 4, np.nan, some), 'tension of tendon_2_1 is nan N'),
        150: (names[:11], some[:11], "no value 'tendon_3_4' for tendon_3_4"),
        200: (names, np.full(12, 500.0), 'did not converge'),
    }
    for place, (own, values, _) in bad.items():
        data = tensions_data(TENDON_TENSIONS, own, values, START + place * STEP)
        content[place] = content[place]._replace(data=data)
    late = tensions_data(TENDON_TENSIONS, names, some, START)
    content[250] = content[250]._replace(data=late)
    bag = write_bag(tmp_path / 'in', [DESCRIPTION, *content])
    report = cli.json('replay', bag, tmp_path / 'out', '--json')
    topic = report['topics']['/tendon_tensions']
    counts = {name: topic[name] for name in ('answered', 'refused', 'failed', 'unsorted')}
    assert counts == {'answered': 297, 'refused': 2, 'failed': 1, 'unsorted': 1}
    assert [stamp for stamp, _ in topic['skips']] == [START + place * STEP for place in bad]
    for (_, reason), (_, _, expected) in zip(topic['skips'], bad.values(), strict=True):
        assert expected in reason or 'compress' in reason
        assert 'in set' not in reason  # of a batch that nobody gave
    stamps = {one[2] for one in content_of(tmp_path / 'out', '/backbone/path')}
    assert stamps == {one.received_ns for i, one in enumerate(content) if i not in bad}
    out = cli('replay', bag, tmp_path / 'again')[1]
    assert f'{(START + 100 * STEP) * 1e-9:.6f} s: tension of tendon_2_1 is nan N' in out


ONES = samples(ARM, np.ones((3, 12)))


@pytest.mark.parametrize(
    ('content', 'options', 'status', 'expected'),
    [
        (samples(ARM, np.full((3, 12), -1.0)), '', 2, 'none of 3 messages on /tendon_tensions'),
        (samples(ARM, np.full((3, 12), 1e5)), '', 1, 'none of 3 messages on /tendon_tensions'),
        ([], '', 2, 'no tensions, expected octo_arm_msgs/msg/TendonTensions or std_msgs'),
        (ONES, '--topics /pulls', 2, 'no topic /pulls for tens'),
        (
            ONES,
            '--topics tendon_tensions /tendon_tensions:tension',
            2,
            '--topics names tendon_tensions /tendon_tensions:tension, expected each topic once',
        ),
        (ONES, '--config octopus', 2, "no preset arm 'octopus'"),
        (ONES, '--config renda2012_prototype', 2, 'answered, 3 as unknown tendon tendon_2_1'),
        (ONES, '--config rao2021 --model renda2012', 2, "is 'renda2012', which does not cover"),
    ],
)
def test_where_there_is_nothing_to_answer_there_is_no_bag(
    tmp_path, cli, content, options, status, expected
):
    bag = write_bag(tmp_path / 'in', [DESCRIPTION, *content])
    found, _, error = cli(f'replay {bag} {tmp_path}/out {options}')
    *_, line = error.splitlines()
    assert found == status and line.startswith('octo-arm: error: ') and expected in line
    assert [path.name for path in tmp_path.iterdir()] == ['in']


def test_a_wrench_in_the_bag_is_not_applied_and_that_is_said(tmp_path, cli):
    vector = point((0.0, 0.0, 0.1), 'Vector3')
    wrench = make('geometry_msgs/msg/Wrench', force=vector, torque=vector)
    name = 'geometry_msgs/msg/WrenchStamped'
    sample = message('/tip_wrench', name, START, header=header(START), wrench=wrench)
    content = [DESCRIPTION, sample, *samples(ARM, random_tensions(ARM, 2))]
    bag = write_bag(tmp_path / 'in', content)
    assert '/tip_wrench is not applied' in cli('replay', bag, tmp_path / 'out')[1]


def test_without_a_description_the_arm_must_be_given(tmp_path, cli):
    bag = write_bag(tmp_path / 'in', samples(ARM, random_tensions(ARM, 3)))
    out = tmp_path / 'out'
    assert 'no topic arm_description, so say which arm' in cli.refused('replay', bag, out)
    text = parameters_as_yaml({**TABLE_4, 'base_frame': ''})
    content = [text_sample('/arm_description', text), *samples(ARM, random_tensions(ARM, 1))]
    other = write_bag(tmp_path / 'other', content)
    assert f"{other}, /arm_description: base_frame is ''" in cli.refused('replay', other, out)
    assert cli('replay', bag, out, '--config', 'renda2012_table4')[0] == 0


# However it ends --------------------------------------------------------------------------------


@pytest.mark.parametrize('command', ['replay', 'record-demo'])
@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_ends_it_leaves_no_bag(tmp_path, monkeypatch, cli, command, number):
    bag = write_bag(tmp_path / 'in', [DESCRIPTION, *samples(ARM, random_tensions(ARM, 10))])
    write = BagWriter.write

    def signalled(self, messages):
        write(self, messages)
        os.kill(os.getpid(), number)

    monkeypatch.setattr(BagWriter, 'write', signalled)
    sources = [str(bag)] if command == 'replay' else []
    # What nohup ignores stays ignored, so the tests may run under it.
    before = signal.signal(number, signal.SIG_DFL)
    try:
        status, _, err = cli(command, *sources, tmp_path / 'out')
        assert status == 128 + number
        assert signal.getsignal(number) == signal.SIG_DFL
    finally:
        signal.signal(number, before)
    assert f'interrupted, no {tmp_path / "out"} written' in err
    assert [path.name for path in tmp_path.iterdir()] == ['in']


def test_memory_is_bounded_whatever_the_length(tmp_path):
    # Pictures beside the tensions: a hundred megabytes would show.
    picture = 'x' * 2**18
    content = samples(ARM, random_tensions(ARM, 200))
    pictures = [text_sample('/picture', picture, START + i * STEP) for i in range(200)]
    both = sorted([*content, *pictures], key=lambda sample: sample.received_ns)
    bag = write_bag(tmp_path / 'in', [DESCRIPTION, *both])
    del content, pictures, both
    with BagReader(bag) as reader, BagWriter(tmp_path / 'out') as writer:
        arms = find_arms(reader, model='closed_form')
        tracemalloc.start()
        report = replay(reader, writer, arms)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert report.copied == 400
    assert (tmp_path / 'out' / 'out_0.mcap').stat().st_size > 50 * 2**20
    # The solver asks once for 24 MiB that it never fills.
    assert peak < (24 + 12) * 2**20


# Displacements -----------------------------------------------------------------------------------


PARAMETERS = load_parameters('renda2012_table4') | {
    'model': 'exact',
    'tendons.axial_stiffness': [800.0],
}
FIRST = 10**6  # [ns]
PULL = 0.3 * np.array(FETCHING_IN_SPACE)
HALF = {'tendon_1_1': 0.02, 'tendon_2_2': 0.01}


def replayed(path: Path, topic: str) -> list[Any]:
    with BagReader(path) as reader:
        return [reader.decode(record) for record in reader.messages([topic])]


def test_winches_and_load_cells_drive_different_tendons_until_all_are_let_go(tmp_path, cli):
    solver = Config.from_parameters(PARAMETERS).solver()
    shapes = [solver.solve(part * PULL) for part in (0.4, 0.7, 1.0)]
    names = ARM.tendon_names
    reeled = [dict(zip(names, displacements_of(solver, one).ravel().tolist())) for one in shapes]
    bad = Sample('/tendon_tensions/array', ARRAY, 2, tensions_data(ARRAY, names, [0.1], 2))
    content = [text_sample('/arm_description', parameters_as_yaml(PARAMETERS), 1), bad]
    inputs = [*reeled, {}, PULL, HALF, 1.2 * PULL, {'elbow': 0.1}, {}]  # 1 ms apart
    for stamp, given in zip(range(FIRST, 10 * FIRST, FIRST), inputs, strict=True):
        if isinstance(given, dict):
            lengths = list(given.values())
            content.append(displacement_sample(list(given), lengths, stamp, delay=5))
        else:
            data = tensions_data(TENDON_TENSIONS, names, given, stamp)
            content.append(Sample('/tendon_tensions', TENDON_TENSIONS, stamp + 5, data))
    bag = write_bag(tmp_path / 'in', content)
    table = tmp_path / 'table'
    report = cli.json('replay', bag, tmp_path / 'out', '--json', '--csv', table)['topics']
    assert report['/tendon_tensions']['answered'] == 2
    winches = report['/tendon_displacements']
    assert (winches['answered'], winches['refused']) == (6, 1)
    ((stamp, reason),) = winches['skips']
    assert stamp == 8 * FIRST and reason.startswith('unknown tendon elbow')
    # Displacements alone give back shapes and tensions; of none all tendons are slack.
    expected = dict(enumerate([*shapes, solver.solve(0.0 * PULL), solver.solve(PULL)]))
    for number, tensions in ((5, PULL), (6, 1.2 * PULL)):
        named = dict(zip(names, tensions.ravel().tolist()))
        others = {name: value for name, value in named.items() if name not in HALF}
        expected[number] = solve_displacements(solver, HALF, others).backbone
    expected[8] = solver.solve(1.2 * PULL)
    tips = replayed(tmp_path / 'out', '/tip_pose')
    assert [one.header.stamp.nanosec // FIRST - 1 for one in tips] == list(expected)
    for one, shape in zip(tips, expected.values()):
        tip = one.pose.pose.position
        assert_allclose([tip.x, tip.y, tip.z], shape.tip, atol=1e-8)
    # Estimates are those of shapes with tendons driven by length.
    estimates = replayed(tmp_path / 'out', '/tendon_tension_estimates')
    driven = [0, 1, 2, 5, 6]
    assert [one.header.stamp.nanosec // FIRST - 1 for one in estimates] == driven
    pulls = [expected[number].tensions.ravel() for number in driven]
    assert_allclose([one.tension for one in estimates], pulls, atol=1e-7)
    assert {tuple(one.name) for one in estimates} == {names}
    assert not list(table.glob('*array*'))  # without an answer
    of_cells, of_winches = (
        np.loadtxt(table / f'tensions_{name}.csv', delimiter=',', skiprows=1)[:, 1:]
        for name in ('tendon_tensions', 'tendon_displacements')
    )
    assert len(of_cells) == 2 and len(of_winches) == 6
    assert_allclose(of_winches[:3], pulls[:3], atol=1e-7)
    assert not of_winches[3].any()
