"""From the files of built robots to fitted parameters, by the commands of the manual."""

import numpy as np
import pytest
from built_robots import (
    BENDING,
    COUNTS,
    DISC_FRICTION,
    DISC_YOUNG,
    MARKER_S,
    MARKERS,
    OF_TENDON,
    REST,
    SPOOL,
    TUBE_S,
    WAYS,
    ZERO,
    disc_csv,
    disc_parameters,
    motive_csv,
    servo_poses,
    trunk_bag,
    trunk_parameters,
    tube_csv,
    tube_parameters,
)
from experiments import PARAMETERS, bag_of, nanoseconds, tension_samples
from numpy.testing import assert_allclose
from recordings import header, make, message

from octo_arm_model.arm.errors import MeasurementError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.config.parameter_files import load_parameters, parameters_as_yaml
from octo_arm_model.experiment.csv_recording import CsvSources
from octo_arm_model.experiment.read_recording import read_recording
from octo_arm_model.experiment.recording import MarkerSources

TURNS = ((0.0,) * 6, (0.4, 0.0, 0.2, 0.3, -0.3, 0.2), (-0.3, 0.4, 0.3, -0.2, 0.2, 0.4))
PER_COUNT = 2.0 * np.pi * SPOOL / COUNTS
PULLS = (0.5, 1.0, 1.5, 2.0, 2.5)


@pytest.fixture(scope='module')
def poses():
    return servo_poses(PULLS, np.random.default_rng(1))


def test_a_trunk_of_motors_that_reel_two_tendons_tells_the_radius_of_its_spools(tmp_path, cli):
    bag = trunk_bag(tmp_path / 'trunk', TURNS, np.random.default_rng(0))
    config = tmp_path / 'trunk.yaml'
    config.write_text(parameters_as_yaml(trunk_parameters()))
    guess = [f'{0.9 * way * SPOOL:.5f}' for way in WAYS]
    options = [
        '--json',
        '--config',
        str(config),
        '--displacements',
        '/motors:angle',
        '--motors',
        *OF_TENDON,
        '--spools',
        *guess,
        '--midlines',
        '/mocap:markers',
        '--marker-names',
        *MARKERS,
        '--marker-s',
        *map(str, MARKER_S),
        '--model',
        'exact',
        '--steady',
        '1e-4',
    ]
    out = '--out', tmp_path / 'fitted.yaml'
    fitted = cli.json('identify', bag, *options, '--fit', 'displacement_scale', *out)
    assert fitted['estimates']['displacement_scale']['value'] == pytest.approx(SPOOL, rel=5e-3)
    scale = load_parameters(str(tmp_path / 'fitted.yaml'))['displacement_scale']
    assert scale == pytest.approx([way * SPOOL for way in WAYS], rel=5e-3)


def test_counts_of_servos_and_a_table_of_motive_tell_radius_and_zero(tmp_path, cli, poses):
    counts, tips = (one[::2] for one in poses)
    times = 10.0 * np.arange(len(counts))
    ticks = tmp_path / 'ticks.csv'
    rows = [f'2024-05-02T10:00:{at:06.3f}Z,{count}' for at, count in zip(times, counts)]
    ticks.write_text('when,servo 1 [ticks]\n' + '\n'.join(rows) + '\n')
    start = np.datetime64('2024-05-02T10:00:00').astype('datetime64[s]').astype(float)
    motive = motive_csv(tmp_path / 'motive.csv', start + times, tips)
    config = tmp_path / 'arm.yaml'
    zero = (ZERO + 40) * PER_COUNT  # of a servo whose zero is known within 3 degrees
    known = {'displacement_scale': [1.1 * PER_COUNT], 'displacement_offset': [-zero, 0, 0, 0]}
    config.write_text(parameters_as_yaml({**PARAMETERS, **known}))
    options = [
        '--json',
        '--config',
        str(config),
        '--displacement-csv',
        str(ticks),
        '--midline-csv',
        str(motive),
        '--columns',
        'displacement:time=when',
        'displacement_tendon_1_1=servo 1',
        'x=Tip_x',
        'y=Tip_y',
        'z=Tip_z',
        '--poses',
        '--align',
        'none',
        '--model',
        'exact',
        '--fit',
        'displacement_scale',
        'displacement_offset',
    ]
    fitted = cli.json('identify', *options)['estimates']
    assert fitted['displacement_scale']['value'] == pytest.approx(PER_COUNT, rel=0.02)


def test_a_table_of_poses_without_time_or_header_is_compared_and_replayed(tmp_path, cli, poses):
    _, tips = poses
    table = tmp_path / 'poses.csv'
    table.write_text(
        ''.join(
            f'{pull / 9.80665e-3:.6f};{1e3 * x:.4f};{1e3 * y:.4f};{1e3 * z:.4f}\n'
            for pull, (x, y, z) in zip(PULLS, tips)
        )
    )
    config = tmp_path / 'arm.yaml'
    config.write_text(parameters_as_yaml({**PARAMETERS, 'tension_scale': [9.80665e-3] * 4}))
    slack = [f'tendon_1_{number}=0' for number in (2, 3, 4)]
    columns = ['--columns', 'tendon_1_1=#1', *slack]
    tip = ['x=#2', 'y=#3', 'z=#4', '--length-unit', 'mm', '--align', 'none', '--model', 'exact']
    files = ['--config', str(config), '--pose-csv', str(table)]
    compared = cli.json('compare', '--json', *files, *columns, *tip)
    errors = [step['tip_error_percent'] for step in compared['steps']]
    assert len(errors) == len(PULLS) and max(errors) < 0.2
    out = tmp_path / 'shapes'
    assert cli('replay', table, out, '--config', config, *columns)[0] == 0
    with BagReader(out) as reader:
        assert reader.count(['/backbone/path']) == len(PULLS)


def test_a_table_of_a_tube_of_nitinol_tells_how_it_is_bent_at_rest(tmp_path, cli):
    table = tube_csv(tmp_path / 'poses.csv', np.random.default_rng(5))
    config = tmp_path / 'tube.yaml'
    config.write_text(parameters_as_yaml(tube_parameters()))
    loads = [f'tendon_1_{number}=weight {number} [g]' for number in (1, 2, 3)]
    places = [f'{axis}{number}=S{number} {axis} (mm)' for number in range(1, 6) for axis in 'xyz']
    options = [
        '--config',
        str(config),
        '--pose-csv',
        str(table),
        '--columns',
        *loads,
        *places,
        '--marker-s',
        *map(str, TUBE_S),
        '--align',
        'none',
        '--model',
        'exact',
    ]
    fits = ['--fit', 'bending_stiffness', 'rest_curvature', '--loss', 'linear']
    out = ['--out', str(tmp_path / 'fitted.yaml')]
    fitted = cli.json('identify', '--json', *options, *fits, *out)
    left = fitted['residuals']
    assert left['before']['rms'] > 5e-3 and left['after']['rms'] < 5e-4
    names = 'bending_stiffness', 'rest_curvature_n', 'rest_curvature_b'
    for name, true in zip(names, (BENDING, *REST), strict=True):
        low, high = fitted['estimates'][name]['interval95']
        assert low < true < high
        assert high - low < (0.002 if name == 'bending_stiffness' else 0.1)
    files = ['--config', str(tmp_path / 'fitted.yaml'), *options[2:]]
    compared = cli.json('compare', '--json', *files)
    assert max(step['tip_error_percent'] for step in compared['steps']) < 0.3


def test_a_table_of_a_robot_of_discs_tells_its_modulus_and_friction(tmp_path, cli):
    table = disc_csv(tmp_path / 'poses.csv', np.random.default_rng(6))
    config = tmp_path / 'discs.yaml'
    config.write_text(parameters_as_yaml(disc_parameters()))
    options = [
        '--config',
        str(config),
        '--pose-csv',
        str(table),
        '--columns',
        *(f'tendon_1_{number}=F{number} (N)' for number in (1, 2, 3)),
        *(f'{axis}=tip {axis} (mm)' for axis in 'xyz'),
        '--align',
        'none',
        '--model',
        'exact',
    ]
    fits = ['--fit', 'youngs_modulus', 'friction', '--loss', 'linear']
    out = ['--out', str(tmp_path / 'fitted.yaml')]
    fitted = cli.json('identify', '--json', *options, *fits, *out)
    for name, true in (('youngs_modulus', DISC_YOUNG), ('friction', DISC_FRICTION)):
        low, high = fitted['estimates'][name]['interval95']
        assert low < true < high and high - low < 0.4 * true
    compared = cli.json(
        'compare', '--json', '--config', str(tmp_path / 'fitted.yaml'), *options[2:]
    )
    assert max(step['tip_error_percent'] for step in compared['steps']) < 0.4
    # Without its discs it is another robot.
    fitted_file = load_parameters(str(tmp_path / 'fitted.yaml'))
    config.write_text(parameters_as_yaml({**fitted_file, 'tendons.disc_count': 0}))
    compared = cli.json('compare', '--json', *options)
    assert max(step['tip_error_percent'] for step in compared['steps']) > 2.0


@pytest.mark.parametrize(
    ('changes', 'fit', 'message'),
    [
        (
            {'body.radius_tip': 9e-4},
            'bending_stiffness',
            'bending_stiffness cannot be fitted: E J is',
        ),
        (
            {'rest.table_s': [0.0, 0.25], 'rest.table_torsion': [1.0, 2.0]},
            'rest_torsion',
            'rest_torsion cannot be fitted: the config has a table of it',
        ),
        (
            {'stiffness.table_s': [0.0, 0.25], 'stiffness.table_bending_n': [1e-2, 1e-2]},
            'bending_stiffness',
            'bending_stiffness cannot be fitted: the config has a table of it',
        ),
    ],
)
def test_what_varies_along_the_arm_is_not_fitted_as_one_number(
    changes, fit, message, tmp_path, cli
):
    table, config = tmp_path / 'poses.csv', tmp_path / 'tube.yaml'
    table.write_text('tendon_1_1,tendon_1_2,tendon_1_3,x,y,z\n1,0,0,0.2,0.1,0\n')
    config.write_text(parameters_as_yaml({**tube_parameters(), **changes}))
    words = ['identify', '--config', str(config), '--pose-csv', str(table), '--align', 'none']
    assert message in cli.refused(*words, '--model', 'exact', '--fit', fit)
    assert f'the model renda2012 has no {fit}' in cli.refused(
        *words, '--model', 'renda2012', '--fit', fit
    )


def test_a_table_is_estimated_as_a_bag_is(tmp_path, cli, poses):
    _, tips = poses
    table = tmp_path / 'poses.csv'
    names = ','.join(f'tendon_1_{number} [N]' for number in (1, 2, 3, 4))
    rows = [f'{pull},0,0,0,{",".join(map(repr, tip.tolist()))}' for pull, tip in zip(PULLS, tips)]
    table.write_text(f'{names},x,y,z\n' + '\n'.join(rows) + '\n')
    config = tmp_path / 'arm.yaml'
    config.write_text(parameters_as_yaml({**PARAMETERS, 'model': 'exact'}))
    words = ['--config', str(config), '--tip-position-stddev', '1e-3', '--tension-stddev', '0.05']
    found = cli.json('estimate', table, '--json', *words, '--csv', tmp_path / 'out')
    assert found['touches'] == []
    lines = (tmp_path / 'out' / 'estimate.csv').read_text().splitlines()
    assert len(lines) == 1 + len(PULLS)
    assert 'tme, which is not read here; expected names of' in cli.refused(
        'estimate', str(table), *words, '--columns', 'tme=x'
    )


PLACES = np.array([[0.0, 0.0, 0.1], [0.01, 0.0, 0.19], [0.03, 0.01, 0.25]])
NAMED = MarkerSources(marker_s=(0.1, 0.2, 0.27), marker_names=('a', 'b', 'c'))


def test_trajectories_of_vicon_are_read_in_their_units_at_their_rate(tmp_path):
    loads, track = tmp_path / 'loads.csv', tmp_path / 'track.csv'
    loads.write_text('time,tendon_1_1,tendon_1_2,tendon_1_3,tendon_1_4\ns,lbf,N,N,N\n0,1,0,0,0\n')
    cells = [','.join(f'{1e3 * one:.3f}' for one in row) for row in PLACES]
    track.write_text(
        'Trajectories\n100\n,,arm:c,,,arm:a,,,arm:b,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z\n'
        f',,mm,mm,mm,mm,mm,mm,mm,mm,mm\n7,0,{cells[2]},{cells[0]},,,\n'
        f'8,0,{cells[2]},{cells[0]},{cells[1]}\n'
    )
    config = tmp_path / 'arm.yaml'
    config.write_text(parameters_as_yaml(PARAMETERS))
    found = read_recording(None, str(config), measured=NAMED, files=CsvSources(loads, track))
    assert_allclose(found.frame_time, [0.07, 0.08])
    assert_allclose(found.frames[1], PLACES)
    assert np.isnan(found.frames[0][1]).all()
    assert found.tensions[0, 0] == pytest.approx(4.4482, rel=1e-4)
    with pytest.raises(MeasurementError, match=r'names midline:tme, which is not read here.*time'):
        files = CsvSources(loads, track, columns={'midline:tme': 'Frame'})
        read_recording(None, str(config), measured=NAMED, files=files)


def test_a_cloud_of_points_is_markers_by_their_numbers(tmp_path):
    fields = [
        make('sensor_msgs/msg/PointField', name=axis, offset=4 * place, datatype=7, count=1)
        for place, axis in enumerate('xyz')
    ]
    data = np.column_stack([PLACES[::-1], np.zeros(3)]).astype('<f4')
    cloud = {
        'height': 1,
        'width': 3,
        'fields': fields,
        'is_bigendian': False,
        'point_step': 16,
        'row_step': 48,
        'data': data.view(np.uint8).ravel(),
        'is_dense': True,
    }
    samples = tension_samples(np.arange(3.0), np.ones(3))
    for number, changes in enumerate(({}, {'width': 3000}, {'fields': fields[:2]})):
        stamp = nanoseconds(float(number))
        kind = 'sensor_msgs/msg/PointCloud2'
        one = {'header': header(stamp, 'lidar'), **cloud, **changes}
        samples.append(message('/points', kind, stamp, **one))
    config = tmp_path / 'arm.yaml'
    config.write_text(parameters_as_yaml(PARAMETERS))
    measured = MarkerSources(marker_s=NAMED.marker_s, marker_names=('2', '1', '0'))
    found = read_recording(bag_of(tmp_path / 'bag', samples), str(config), measured=measured)
    assert_allclose(found.frames, [PLACES], atol=1e-8)
    said = ' '.join(found.refusals.lines())
    assert '3000 points of 16 bytes' in said and 'x, y, z are missing' in said


def test_an_estimator_takes_motors_and_markers_of_foreign_messages(tmp_path, cli):
    bag = trunk_bag(tmp_path / 'trunk', TURNS[:2], np.random.default_rng(0))
    config = tmp_path / 'trunk.yaml'
    own = {'displacement_names': list(OF_TENDON), 'displacement_scale': [w * SPOOL for w in WAYS]}
    config.write_text(parameters_as_yaml({**trunk_parameters(), **own}))
    # What a motor lets out is slack: its reading is not the tendon's length, by up to 4 mm here.
    words = [
        '--json',
        '--config',
        str(config),
        '--markers',
        '/mocap:markers',
        '--marker-s',
        *map(str, MARKER_S),
        '--marker-stddev',
        '1e-3',
        '--displacement-stddev',
        '4e-3',
        '--tendon-displacements',
        '/motors:angle',
        '--contact',
        'none',
    ]
    found = cli.json('estimate', bag, *words, '--marker-names', *MARKERS)
    found = found['innovations']
    assert found['markers']['accepted'] == 60
    assert found['tendon displacements']['accepted'] == 120
