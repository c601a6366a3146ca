"""From the files of built robots to fitted parameters, by the commands of the manual.

Recordings are as such robots leave them: motors, foreign messages, tables of motion capture,
written by rosbags and by hand, not by our own writers.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experiments import PARAMETERS, arm_file, bag_of, nanoseconds, tension_samples
from numpy.testing import assert_allclose
from recordings import START, header, make, message, point
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg

from octo_arm_model import Config, displacements_of, solve_displacements
from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.types import known_types
from octo_arm_model.config.parameter_files import load_parameters, parse_parameters
from octo_arm_model.experiment.csv_recording import CsvSources
from octo_arm_model.experiment.read_recording import read_recording
from octo_arm_model.experiment.recording import MarkerSources
from octo_arm_model.rod.stations import interpolated

SPOOL = 0.012  # radius [m]
GRAM = 9.80665e-3  # its weight [N]
AS_IT_IS = '--align none --model exact --json'


def spaced(values: Sequence[object]) -> str:
    """Values as words of a command."""
    return ' '.join(map(str, values))


def assert_holds(estimate: dict[str, Any], true: float, width: float) -> None:
    """The interval of an estimate, no wider than ``width``, holds what is true."""
    low, high = estimate['interval95']
    assert low < true < high and high - low < width


def tip_errors(compared: dict[str, Any]) -> list[float]:
    return [step['tip_error_percent'] for step in compared['steps']]


# A trunk of motors that reel two tendons each, in opposite directions ----------------------------


TRUNK = {**load_parameters('renda2012_table2'), 'model': 'exact', 'stations': 31}
MOTORS = tuple(f'motor_{section}{side}' for section in (1, 2, 3) for side in 'ab')
# Motors of the tendons, section by section from the tip, and which way each reels.
OF_TENDON = tuple(f'motor_{section}{side}' for section in (1, 2, 3) for side in 'abab')
WAYS = (1.0, 1.0, -1.0, -1.0) * 3
TURNS = ((0.0,) * 6, (0.4, 0.0, 0.2, 0.3, -0.3, 0.2), (-0.3, 0.4, 0.3, -0.2, 0.2, 0.4))
MARKER_S = (0.1, 0.2, 0.31)
MARKERS = ('low', 'middle', 'top')
FOREIGN = {
    'Marker': 'string marker_name\ngeometry_msgs/Point translation\nfloat32 residual\n',
    'Markers': 'std_msgs/Header header\ntrunk_msgs/Marker[] markers\n',
    'Motors': 'std_msgs/Header header\nstring[] name\nfloat64[] angle\n',
}


def trunk_shapes(turns: Sequence[Sequence[float]]) -> list[np.ndarray]:
    """Points of the trunk at its markers for angles of its six motors [rad]."""
    config = Config.from_parameters(TRUNK)
    solver, names, found, last = config.solver(), config.arm.tendon_names, [], None
    for angles in turns:
        angle = dict(zip(MOTORS, angles, strict=True))
        lengths = [way * SPOOL * angle[motor] for motor, way in zip(OF_TENDON, WAYS)]
        last = solve_displacements(solver, dict(zip(names, lengths, strict=True)), start=last)
        found.append(interpolated(np.array(MARKER_S), last.backbone.s, last.backbone.position))
    return found


def trunk_bag(path: Path, turns: Sequence[Sequence[float]]) -> Path:
    """Each of the poses held for 3 s: motors at 20 Hz, and markers in another order at 10 Hz."""
    rng, store = np.random.default_rng(0), known_types()
    if 'trunk_msgs/msg/Marker' not in store.fielddefs:
        for name, text in FOREIGN.items():
            store.register(get_types_from_msg(text, f'trunk_msgs/msg/{name}'))
    marker, markers, motors = (store.types[f'trunk_msgs/msg/{name}'] for name in FOREIGN)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            kind: writer.add_connection(topic, kind.__msgtype__, typestore=store)
            for topic, kind in (('/motors', motors), ('/mocap', markers))
        }

        def write(at: int, one: Any) -> None:
            data = store.serialize_cdr(one, one.__msgtype__)
            writer.write(topics[type(one)], at, data)

        for number, (angles, points) in enumerate(zip(turns, trunk_shapes(turns), strict=True)):
            for step in range(60):
                at = START + round((3.0 * number + 0.05 * step) * 1e9)
                read = np.array(angles) + 1e-4 * rng.standard_normal(len(angles))
                write(at, motors(header(at, 'arm_base'), list(MOTORS), read))
                if step % 2 == 0:
                    seen = points + 1e-4 * rng.standard_normal(points.shape)
                    several = [marker(*one, 0.1) for one in zip(MARKERS, map(point, seen))]
                    write(at, markers(header(at, 'arm_base'), several[::-1]))
    return path


def test_a_trunk_of_motors_that_reel_two_tendons_tells_the_radius_of_its_spools(tmp_path, cli):
    bag, config = trunk_bag(tmp_path / 'trunk', TURNS), arm_file(tmp_path, TRUNK)
    fitted = cli.json(
        f'identify {bag} --config {config} --displacements /motors:angle '
        f'--motors {spaced(OF_TENDON)} --spools {spaced(0.9 * SPOOL * np.array(WAYS))} '
        f'--midlines /mocap:markers --marker-names {spaced(MARKERS)} '
        f'--marker-s {spaced(MARKER_S)} --model exact --steady 1e-4 --fit displacement_scale '
        f'--out {tmp_path}/fitted.yaml --json'
    )
    assert fitted['estimates']['displacement_scale']['value'] == pytest.approx(SPOOL, rel=5e-3)
    scale = load_parameters(str(tmp_path / 'fitted.yaml'))['displacement_scale']
    assert scale == pytest.approx([way * SPOOL for way in WAYS], rel=5e-3)


def test_an_estimator_takes_motors_and_markers_of_foreign_messages(tmp_path, cli):
    own = {'displacement_names': list(OF_TENDON), 'displacement_scale': [w * SPOOL for w in WAYS]}
    # What a motor lets out is slack: its reading is not the tendon's length, by up to 4 mm here.
    found = cli.json(
        f'estimate {trunk_bag(tmp_path / "trunk", TURNS[:2])} '
        f'--config {arm_file(tmp_path, {**TRUNK, **own})} --markers /mocap:markers '
        f'--marker-s {spaced(MARKER_S)} --marker-names {spaced(MARKERS)} --marker-stddev 1e-3 '
        '--tendon-displacements /motors:angle --displacement-stddev 4e-3 --contact none --json'
    )['innovations']
    assert found['markers']['accepted'] == 60
    assert found['tendon displacements']['accepted'] == 120


# The prototype, pulled by a servo or weights and seen by motion capture --------------------------


PULLS = (0.5, 1.0, 1.5, 2.0, 2.5)
COUNTS = 4096  # of a turn of a servo
ZERO = 2048  # counts at the unloaded arm
PER_COUNT = 2.0 * np.pi * SPOOL / COUNTS


@pytest.fixture(scope='module')
def poses():
    """Counts of the servo of the first tendon (n,), and tips (n, 3) [m]."""
    solver = Config.from_parameters({**PARAMETERS, 'model': 'exact'}).solver()
    rng, counts, tips = np.random.default_rng(1), [], []
    for pull in PULLS:
        shape = solver.solve([[pull, 0.0, 0.0, 0.0]])
        counts.append(round(ZERO + displacements_of(solver, shape).flat[0] / PER_COUNT))
        tips.append(shape.tip + 1e-4 * rng.standard_normal(3))
    return np.array(counts), np.array(tips)


def motive_csv(path: Path, times: np.ndarray, tips: np.ndarray) -> Path:
    """An export of Motive 2: a rigid body at the tip, in millimetres, and a marker beside it."""
    lines = [
        'Format Version,1.23,Take Name,Take 1,Export Frame Rate,120.0,Length Units,Millimeters',
        '',
        ',Type,' + ','.join(['Rigid Body'] * 7 + ['Marker'] * 3),
        ',Name,' + ','.join(['Tip'] * 7 + ['Unlabeled 1'] * 3),
        ',,' + ','.join(['Rotation'] * 4 + ['Position'] * 6),
        'Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z',
    ]
    for number, (time, tip) in enumerate(zip(times, tips)):
        place = ','.join(f'{1e3 * one:.4f}' for one in tip)
        lines.append(f'{number},{time:.3f},0,0,0,1,{place},,,')
    path.write_text('\n'.join(lines) + '\n')
    return path


def test_counts_of_servos_and_a_table_of_motive_tell_radius_and_zero(tmp_path, cli, poses):
    counts, tips = (one[::2] for one in poses)
    times = 10.0 * np.arange(len(counts))
    rows = [f'2024-05-02T10:00:{at:06.3f}Z,{count}' for at, count in zip(times, counts)]
    (tmp_path / 'ticks.csv').write_text('when,servo 1 [ticks]\n' + '\n'.join(rows) + '\n')
    start = np.datetime64('2024-05-02T10:00:00').astype('datetime64[s]').astype(float)
    motive = motive_csv(tmp_path / 'motive.csv', start + times, tips)
    zero = (ZERO + 40) * PER_COUNT  # of a servo whose zero is known within 3 degrees
    known = {'displacement_scale': [1.1 * PER_COUNT], 'displacement_offset': [-zero, 0, 0, 0]}
    fitted = cli.json(
        f'identify --config {arm_file(tmp_path, {**PARAMETERS, **known})} '
        f'--displacement-csv {tmp_path}/ticks.csv --midline-csv {motive} '
        "--columns displacement:time=when 'displacement_tendon_1_1=servo 1' x=Tip_x y=Tip_y "
        f'z=Tip_z --poses {AS_IT_IS} --fit displacement_scale displacement_offset'
    )
    scale = fitted['estimates']['displacement_scale']['value']
    assert scale == pytest.approx(PER_COUNT, rel=0.02)


def test_a_table_of_poses_without_time_or_header_is_compared_and_replayed(tmp_path, cli, poses):
    table, out = tmp_path / 'poses.csv', tmp_path / 'shapes'
    np.savetxt(table, np.column_stack([np.array(PULLS) / GRAM, 1e3 * poses[1]]), '%.6f', ';')
    config = arm_file(tmp_path, {**PARAMETERS, 'tension_scale': [GRAM] * 4})
    columns = '--columns tendon_1_1=#1 tendon_1_2=0 tendon_1_3=0 tendon_1_4=0'
    command = f'compare --config {config} --pose-csv {table} {columns} x=#2 y=#3 z=#4'
    errors = tip_errors(cli.json(f'{command} --length-unit mm {AS_IT_IS}'))
    assert len(errors) == len(PULLS) and max(errors) < 0.2
    named = tmp_path / 'named.csv'
    named.write_text('l,x_mm,y_mm,z_mm\n' + table.read_text().replace(';', ','))
    status, said, _ = cli(f'replay {named} {out} --config {config} {columns}')
    wrong = cli.refused(f'replay {named} {tmp_path}/new --config {config} {columns} --topics /a')
    assert wrong.startswith(f'{named}: no topic /a for tensions')
    # Nothing says that these points are in base_frame, as those of the new bag are.
    assert status == 0 and 'the points of named.csv are left out' in said
    with BagReader(out) as reader:
        assert reader.count(['/backbone/path']) == len(PULLS)
        assert not {'/measured/midline', '/measured/tip_pose'} & {*reader.topics}


def test_a_replayed_table_of_motors_is_compared_with_the_config_of_the_motors(
    tmp_path, cli, poses
):
    """The bag of a table has lengths of tendons, which are not calibrated again."""
    table, tips, bag = tmp_path / 'motors.csv', tmp_path / 'tips.csv', tmp_path / 'shapes'
    counts = np.zeros((len(PULLS), 4))
    counts[:, 0] = poses[0] - ZERO
    names = [f'm{number}' for number in range(4)]
    own = {'model': 'exact', 'displacement_names': names, 'displacement_scale': [PER_COUNT]}
    config = arm_file(tmp_path, {**PARAMETERS, **own})
    rows = np.column_stack([np.arange(len(PULLS)), poses[1]])
    np.savetxt(table, counts, delimiter=',', header=','.join(names), comments='')
    np.savetxt(tips, rows, delimiter=',', header='time,x,y,z', comments='')
    status, _, _ = cli(f'replay {table} {bag} --config {config}')
    command = f'compare {bag} --midline-csv {tips} --poses {AS_IT_IS}'
    errors = tip_errors(cli.json(f'{command} --config {config}'))
    assert status == 0 and len(errors) == len(PULLS) and max(errors) < 0.2
    again = f'{command} --config {config} --spools 1'
    assert 'made from motors.csv, its readings are those of tendons' in cli.refused(again)


def test_a_table_is_estimated_as_a_bag_is(tmp_path, cli, poses):
    table = tmp_path / 'poses.csv'
    names = ','.join(f'tendon_1_{number} [N]' for number in (1, 2, 3, 4))
    content = np.column_stack([PULLS, np.zeros((len(PULLS), 3)), poses[1]])
    np.savetxt(table, content, delimiter=',', header=f'{names},x,y,z', comments='')
    command = (
        f'estimate {table} --config {arm_file(tmp_path, {**PARAMETERS, "model": "exact"})} '
        f'--tip-position-stddev 1e-3 --tension-stddev 0.05 --csv {tmp_path}/out --json'
    )
    said = cli.json(command)
    assert said['touches'] == []
    assert 'points of a table are in base_frame' in ' '.join(said['notes'])
    content[:, 4:] = (poses[1] - [0.0, 0.0, 1.0]) * [1, -1, -1]  # from behind
    np.savetxt(table, content, delimiter=',', header=f'{names},x,y,z', comments='')
    behind = cli.json(f'{command} --align 0 0 1 1 0 0 0')
    for name, innovation in said['innovations'].items():
        assert behind['innovations'][name] == pytest.approx(innovation, rel=1e-6)
    more = '--force-stddev 0.1 --tension-rate 5 --align 0 0.01 1 1 0 0 0'  # 10 mm aside
    (touch,) = cli.json(f'{command} {more}')['touches']  # of poses a second apart
    assert touch['force'][1] > 0.0
    lines = (tmp_path / 'out' / 'estimate.csv').read_text().splitlines()
    assert len(lines) == 1 + len(PULLS)
    wanted = 'tme, which is not read here; expected names of'
    assert wanted in cli.refused(f'{command} --columns tme=x')
    np.savetxt(table, content[:, :4], delimiter=',', header=names, comments='')
    command = command.replace('--tip-position-stddev 1e-3 ', '')
    assert not any('points' in note for note in cli.json(command)['notes'])
    assert '--align has no effect' in cli.refused(f'{command} --align 0 0 1 1 0 0 0')


# A tube of nitinol, straight as its catalogue has it, with three tendons in discs ----------------


TUBE = parse_parameters(
    """\
/**:
  ros__parameters:
    model: exact
    stations: 41
    material: {law: linear, youngs_modulus: 60000000000.0, poisson_ratio: 0.33}
    body: {length: 0.25, radius_base: 0.001, radius_tip: 0.001, inner_radius: 0.00085}
    body.disc_radius: 0.01
    sections: {anchorage: [0.25], tendons: [3], offset_base: [0.008], offset_anchorage: [0.008]}
""",
    'tube',
)
TUBE_S = (0.05, 0.1, 0.15, 0.2, 0.25)  # its electromagnetic sensors [m]
# Of the tube as it is: E J [N m^2], curvature at rest about n and b [1/m].
TRUE = {'bending_stiffness': 0.021, 'rest_curvature_n': -0.9, 'rest_curvature_b': 1.6}


def test_a_table_of_a_tube_of_nitinol_tells_how_it_is_bent_at_rest(tmp_path, cli):
    """Static poses: weights in grams, and sensors in mm."""
    bending, *rest = TRUE.values()
    own, rng = {'stiffness.bending': [bending], 'rest_curvature': rest}, np.random.default_rng(5)
    solver = Config.from_parameters(TUBE | own).solver()
    axes = [f'S{number} {axis} (mm)' for number in range(1, 6) for axis in 'xyz']
    lines = [[*(f'weight {number} [g]' for number in (1, 2, 3)), *axes]]
    for grams in ((0, 0, 0), (400, 0, 0), (0, 300, 0), (0, 0, 300)):
        shape = solver.solve([[GRAM * one for one in grams]])
        seen = interpolated(np.array(TUBE_S), shape.s, shape.position)
        seen = 1e3 * (seen + 2e-4 * rng.standard_normal(seen.shape))
        lines.append([*map(str, grams), *(f'{one:.2f}' for one in seen.ravel())])
    table, fitted = tmp_path / 'poses.csv', tmp_path / 'fitted.yaml'
    table.write_text('\n'.join(map(';'.join, lines)) + '\n')
    loads = [f'tendon_1_{number}=weight {number} [g]' for number in (1, 2, 3)]
    places = [f'{axis}{number}=S{number} {axis} (mm)' for number in range(1, 6) for axis in 'xyz']
    of_table = (
        f'--pose-csv {table} --columns {spaced(map(repr, loads + places))} '
        f'--marker-s {spaced(TUBE_S)} {AS_IT_IS}'
    )
    found = cli.json(
        f'identify --config {arm_file(tmp_path, TUBE)} {of_table} '
        f'--fit bending_stiffness rest_curvature --loss linear --out {fitted}'
    )
    left = found['residuals']
    assert left['before']['rms'] > 5e-3 and left['after']['rms'] < 5e-4
    for name, true in TRUE.items():
        width = 0.002 if name == 'bending_stiffness' else 0.1
        assert_holds(found['estimates'][name], true, width)
    assert max(tip_errors(cli.json(f'compare --config {fitted} {of_table}'))) < 0.3


@pytest.mark.parametrize(
    ('changes', 'fit', 'reason'),
    [
        ({'body.radius_tip': 9e-4}, 'bending_stiffness', 'E J is'),
        (
            {'rest.table_s': [0.0, 0.25], 'rest.table_torsion': [1.0, 2.0]},
            'rest_torsion',
            'the config has a table of it',
        ),
        (
            {'stiffness.table_s': [0.0, 0.25], 'stiffness.table_bending_n': [1e-2, 1e-2]},
            'bending_stiffness',
            'the config has a table of it',
        ),
    ],
)
def test_what_varies_along_the_arm_is_not_fitted_as_one_number(
    changes, fit, reason, tmp_path, cli
):
    table = tmp_path / 'poses.csv'
    table.write_text('tendon_1_1,tendon_1_2,tendon_1_3,x,y,z\n1,0,0,0.2,0.1,0\n')
    config = arm_file(tmp_path, {**TUBE, **changes})
    command = f'identify --config {config} --pose-csv {table} --align none --fit {fit} --model'
    assert f'{fit} cannot be fitted: {reason}' in cli.refused(f'{command} exact')
    assert f'the model renda2012 has no {fit}' in cli.refused(f'{command} renda2012')


# Other sensors -----------------------------------------------------------------------------------


PLACES = np.array([[0.0, 0.0, 0.1], [0.01, 0.0, 0.19], [0.03, 0.01, 0.25]])
SEEN_S = (0.1, 0.2, 0.27)


def test_trajectories_of_vicon_are_read_in_their_units_at_their_rate(tmp_path):
    loads, track = tmp_path / 'loads.csv', tmp_path / 'track.csv'
    loads.write_text('time,tendon_1_1,tendon_1_2,tendon_1_3,tendon_1_4\ns,lbf,N,N,N\n0,1,0,0,0\n')
    cells = [','.join(f'{1e3 * one:.3f}' for one in row) for row in PLACES]
    track.write_text(
        'Trajectories\n100\n,,arm:c,,,arm:a,,,arm:b,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z\n'
        f',,mm,mm,mm,mm,mm,mm,mm,mm,mm\n7,0,{cells[2]},{cells[0]},,,\n'
        f'8,0,{cells[2]},{cells[0]},{cells[1]}\n'
    )
    config = str(arm_file(tmp_path, PARAMETERS))
    measured = MarkerSources(marker_s=SEEN_S, marker_names=('a', 'b', 'c'))
    found = read_recording(None, config, measured=measured, files=CsvSources(loads, track))
    assert_allclose(found.frame_time, [0.07, 0.08])
    assert_allclose(found.frames[1], PLACES)
    assert np.isnan(found.frames[0][1]).all()
    assert found.tensions[0, 0] == pytest.approx(4.4482, rel=1e-4)
    with pytest.raises(MeasurementError, match=r'names midline:tme, which is not read here.*time'):
        files = CsvSources(loads, track, columns={'midline:tme': 'Frame'})
        read_recording(None, config, measured=measured, files=files)
    track.write_text(
        'Segments\n100\n,,arm:a\nFrame,Sub Frame,RX,TX,TY,TZ\n,,deg,mm,mm,mm\n7,0,1,10,20,30\n'
    )
    files = CsvSources(loads, track, columns={axis: f'a_t{axis}' for axis in 'xyz'})
    assert_allclose(read_recording(None, config, files=files).frames, [[[0.01, 0.02, 0.03]]])


def test_a_cloud_of_points_is_markers_by_their_numbers(tmp_path):
    fields = [
        make('sensor_msgs/msg/PointField', name=axis, offset=4 * place, datatype=7, count=1)
        for place, axis in enumerate('xyz')
    ]
    data = np.column_stack([PLACES[::-1], np.zeros(3)]).astype('<f4')
    cloud = {'height': 1, 'width': 3, 'fields': fields, 'point_step': 16, 'row_step': 48}
    cloud |= {'data': data.view(np.uint8).ravel(), 'is_bigendian': False, 'is_dense': True}
    samples = tension_samples(np.arange(5.0), np.ones(5))
    padded = np.full((3, 32), 255, np.uint8)  # rows of one point, with room after it
    padded[:, :16] = cloud['data'].reshape(3, 16)
    rows = {'height': 3, 'width': 1, 'row_step': 32, 'data': padded.ravel()}
    cases = {}, rows, {'width': 3000}, {'fields': fields[:2]}, rows | {'row_step': 8}
    for number, changes in enumerate(cases):
        stamp = nanoseconds(float(number))
        one = {'header': header(stamp, 'lidar'), **cloud, **changes}
        samples.append(message('/points', 'sensor_msgs/msg/PointCloud2', stamp, **one))
    measured = MarkerSources(marker_s=SEEN_S, marker_names=('2', '1', '0'))
    bag, config = bag_of(tmp_path / 'bag', samples), str(arm_file(tmp_path, PARAMETERS))
    found = read_recording(bag, config, measured=measured)
    assert_allclose(found.frames, [PLACES, PLACES], atol=1e-8)
    said = ' '.join(found.refusals.lines())
    assert '2 left out, as 3000 points of 16 bytes' in said and 'x, y, z are missing' in said
