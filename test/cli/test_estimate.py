"""`octo-arm estimate`: two commands tell where and how hard an arm was touched."""

import csv
import dataclasses
import json
import re

import experiments
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from octo_arm_model.bags import outputs
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.types import known_types
from octo_arm_model.bags.writer import BagWriter
from octo_arm_model.cli.main import main
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.wire.estimate import read_covariance

PARAMETERS = {**load_parameters('renda2012_prototype'), 'stations': 31}
FORCE, HOLD, RAMP = 0.02, 2.0, 0.5
PUSH = FORCE * np.array(outputs.TOUCH_DIRECTION)
TOUCHED = 4 * (HOLD + RAMP) + np.array([0.1875, 0.8125]) * HOLD  # times of the full force [s]
# Few messages.
_RATES = {'tension_rate': 5.0, 'marker_rate': 5.0, 'camera_rate': 2.5}
_EXACT = {'clock_offset': 0.0, 'dropped': 0.0, 'outliers': 0.0}
EXPERIMENT = outputs.Experiment(1.0, touch=FORCE, hold=HOLD, ramp=RAMP, **_RATES, **_EXACT)
MARKERS = (0.09, 0.18)
TIP = ('--markers', '-')
MARKED = ('--marker-s', *MARKERS)


def record(path, **changes):
    """Write a bag of `EXPERIMENT` with ``changes``."""
    experiment = dataclasses.replace(EXPERIMENT, **changes)
    with BagWriter(path, custom=outputs.custom_data(experiment)) as writer:
        outputs.add_demo(writer, PARAMETERS, experiment)
    return path


@pytest.fixture(scope='module')
def touched_bag(tmp_path_factory):
    """With markers."""
    return record(tmp_path_factory.mktemp('touched') / 'bag', markers=MARKERS)


@pytest.fixture(scope='module')
def short_bag(tmp_path_factory):
    """Shorter."""
    path = tmp_path_factory.mktemp('short') / 'bag'
    return record(path, hold=0.8, ramp=0.2, tension_rate=10.0, camera_rate=5.0, marker_rate=5.0)


def test_the_summary_says_when_and_how_hard(touched_bag, cli):
    status, out, _ = cli('estimate', str(touched_bag), *TIP, '--clock-offset', '0')
    assert status == 0
    lines = out.splitlines()
    (touch,) = [line for line in lines if line.startswith('touched')]
    words = touch.split()
    assert words[1:3] == ['at', 'the']
    assert abs(float(words[5]) - TOUCHED[0]) < 0.3 and abs(float(words[7]) - TOUCHED[1]) < 0.3
    assert abs(float(words[9]) - 20.0) < 3.0 and words[10] == 'mN'
    words = r'midline while touched: tip off by (\S+) mm, without the estimator (\S+)'
    found, plain = map(float, re.search(words, out).groups())
    assert plain > 30.0 > 3.0 > found
    assert any(line.startswith('tip pose: ') and 'normalised innovation' in line for line in lines)
    assert any('tensions are measured to' in line for line in lines)


@pytest.mark.parametrize('how', [(), ('--smooth',)], ids=['filter', 'smoother'])
def test_a_touch_is_found_when_where_and_as_hard_as_it_was_and_bands_hold_the_truth(
    touched_bag, how, tmp_path, cli
):
    said = cli.json('estimate', touched_bag, *MARKED, *how, '--csv', tmp_path, '--json')
    (touch,) = said['touches']
    # It grows before and falls after the times of its full size.
    assert TOUCHED[0] - 0.2 < touch['start'] <= TOUCHED[0] + 0.25
    assert TOUCHED[1] - 0.25 <= touch['stop'] < TOUCHED[1] + 0.25
    assert (np.abs(touch['force'] - PUSH) < 3.0 * np.array(touch['force_stddev'])).all()
    assert np.linalg.norm(touch['force']) == pytest.approx(FORCE, rel=0.1)
    assert touch['contact'] == 'tip' and not said['without_estimate'] and not said['left_out']
    # The arm is not touched most of the time, which the prior does not know.
    tips, markers = (said['innovations'][name] for name in ('tip pose', 'markers'))
    assert tips['mean_square'] < 1.3 and tips['refused'] <= 2
    assert markers['mean_square'] < 1.1 and markers['refused'] <= 2, markers
    rows = list(csv.DictReader((tmp_path / 'estimate.csv').read_text().splitlines()))
    names = [
        'time [s]',
        *(f'force {axis}{what} [N]' for what in ('', ' stddev') for axis in 'xyz'),
    ]
    time, *both = np.array([[float(row[name]) for name in names] for row in rows]).T
    force, stddev = np.reshape(both, (2, 3, -1))
    corners, _ = EXPERIMENT.schedule(outputs.true_config(PARAMETERS, EXPERIMENT))
    inside = np.abs(force - EXPERIMENT.touches(time, corners).T) <= 1.96 * stddev
    # Where the arm is straight the prior of the force along it does not hold what never acts.
    assert inside[:, time > corners[3]].mean() > 0.9


def test_the_place_of_a_touch_is_told_by_probabilities(touched_bag, cli):
    places = '--contact', 'somewhere', '0.12', '0.27'
    said = cli.json('estimate', touched_bag, *MARKED, *places, '--json')
    (touch,), means = said['touches'], said['hypotheses']
    assert touch['contact'] == '0.27 m' and touch['start'] <= np.mean(TOUCHED) <= touch['stop']
    assert set(means) == {'none', '0.12 m', '0.27 m'} and means['none'] > 0.8


def test_without_a_touch_none_is_found(tmp_path, cli):
    bag = record(tmp_path / 'bag', touch=0.0, markers=(0.27,), camera_rate=0.1)
    said = cli.json(f'estimate {bag} --marker-s 0.27 --marker-stddev 5e-4 --json')
    assert not said['touches'] and said['innovations']['markers']['accepted'] > 60


def test_an_arm_of_another_stiffness_is_estimated_as_well(tmp_path, cli):
    bag = record(tmp_path / 'bag', stiffness=1.15, markers=MARKERS, camera_rate=0.1)
    cli('estimate', bag, *MARKED, '--modulus-stddev', '0.2', '--csv', tmp_path)
    *_, last = csv.DictReader((tmp_path / 'estimate.csv').read_text().splitlines())
    mean, deviation = (float(last[f'log_modulus E{what} [-]']) for what in ('', ' stddev'))
    assert abs(mean - np.log(1.15)) < 3.0 * deviation < 0.06


def test_an_arm_that_was_lost_is_found_again_and_told(touched_bag, cli):
    # Tensions change by more than 0.01 N in a second, which is what is told.
    lost = '--tension-rate', '0.01', '--recover-after', '1'
    said = cli('estimate', touched_bag, *MARKED, *lost)[1]
    assert 2.0 < float(re.search(r'reset at (\S+) s', said)[1]) < 3.5


def test_where_no_time_has_a_shape_the_reason_is_the_error(tmp_path, cli):
    table = tmp_path / 'table.csv'
    table.write_text('time,tendon_1_1,tendon_1_2,tendon_1_3,tendon_1_4\n0,3e4,0,0,0\n')
    how = f'estimate {table} --config renda2012_prototype --tension-rate 1e6 --tension-stddev 1'
    status, _, err = cli(how)
    assert status == 1 and 'no estimate at any time; 1 left out, as tensions ' in err


def test_what_cannot_be_seen_is_not_called_untouched(short_bag, cli):
    given = f'estimate {short_bag} --tip-pose -'
    words = 'no touch found, but not all forces are observable: no force is larger'
    assert words in cli(given)[1]
    assert 'touches are not looked for' in cli(f'{given} --contact none')[1]


def test_sensors_of_which_one_may_lie_are_named_as_those_that_are_refused(short_bag, cli):
    # A force that is not expected: the tip lies, and for a while it may as well be a load cell.
    given = f'estimate {short_bag} --cell-fault 0.5 --sensor-fault 0.005 --tension-rate 1'
    given += ' --force-stddev 0.003'
    lines = [one for one in cli(given)[1].splitlines() if one.startswith('one of these sensors')]
    assert any('may lie: load cell tendon_1_1, tip pose (' in line for line in lines)
    assert len(cli.json(f'{given} --json')['suspects']) == len(lines)


def test_what_is_not_known_is_null_in_json(short_bag, cli):
    tips = '--midlines /measured/tip_pose --tip-pose - --align none'
    status, out, _ = cli(f'estimate {short_bag} {tips} --json')
    result = json.loads(out, parse_constant=pytest.fail)
    assert status == 0 and result['camera']['mean_error'] == [None, None]
    assert all(0.0 < error < 1e-2 for error in result['camera']['tip_error'])


def test_bag_tables_and_json_say_the_same(short_bag, tmp_path, cli):
    out, tables = tmp_path / 'estimated', tmp_path / 'tables'
    result = cli.json(
        f'estimate {short_bag} --out {out} --csv {tables} --rate 0 --storage sqlite3 --json '
        '--tension-bias-stddev 0.01 --tension-loss-stddev 0.1'
    )
    rows, innovations = (
        list(csv.DictReader((tables / f'{name}.csv').read_text().splitlines()))
        for name in ('estimate', 'innovations')
    )
    assert len(rows) == result['times']
    assert len(innovations) == 4 * result['innovations']['tensions']['accepted'] + 6 * (
        sum(result['innovations']['tip pose'][name] for name in ('accepted', 'refused'))
    )
    refused = sum('tip pose' in row['refused'] for row in rows)
    assert refused == result['innovations']['tip pose']['refused']
    types, found = known_types(), {}
    with BagReader(short_bag) as reader:
        copied = reader.topics
    with BagReader(out) as reader:
        assert set(copied) < set(reader.topics)
        assert reader.metadata['octo_arm_estimate'] == f'estimates for {short_bag.name}'
        for name in (
            'tip_wrench/estimate',
            'backbone/covariance',
            'tension_bias',
            'tip_pose',
            'backbone/path',
            'backbone/poses',
            'strains',
            'tendon_tension_estimates',
        ):
            assert reader.count([f'/{name}']) == len(rows)
            found[name] = [
                types.deserialize_cdr(one.data, one.type_name)
                for one in reader.messages([f'/{name}'])
            ]
    for number in (0, len(rows) // 2, len(rows) - 1):
        row, wrench = rows[number], found['tip_wrench/estimate'][number]
        stamp = wrench.header.stamp
        assert int(row['stamp [ns]']) == stamp.sec * 10**9 + stamp.nanosec
        assert float(row['force z [N]']) == wrench.wrench.force.z
        assert float(row['tip x [m]']) == found['tip_pose'][number].pose.pose.position.x
        covariance = read_covariance(found['backbone/covariance'][number])
        deviation = float(row['force z stddev [N]'])
        assert deviation**2 == pytest.approx(covariance.contact[2, 2])
        deviation = float(row['tip y stddev [m]'])
        assert deviation**2 == pytest.approx(covariance.pose[-1, 1, 1])
        bias = found['tension_bias'][number].tension[1]
        assert float(row['tension_bias tendon_1_2 [N]']) == bias
        assert abs(float(row['tension_loss tendon_1_2 [-]'])) < 0.1
        assert 0.0 < float(row['tension_loss tendon_1_2 stddev [-]']) <= 0.1 + 1e-9


def test_a_rate_thins_out_the_bag_alone(short_bag, tmp_path, cli):
    out = tmp_path / 'estimated'
    result = cli.json(f'estimate {short_bag} --out {out} --rate 2 --no-copy --json')
    assert result['times'] > 60
    with BagReader(out) as reader:
        assert '/tendon_tensions' not in reader.topics
        count = reader.count(['/backbone/path'])
        assert abs(count - 2.0 * reader.duration) <= 2.0
        assert reader.count(['/arm_description']) == 1


@pytest.mark.parametrize('contact', ['tip', 'none'])
def test_the_picture_is_drawn(short_bag, tmp_path, cli, contact):
    pytest.importorskip('matplotlib')
    path = tmp_path / 'pictures' / 'touch.png'
    assert cli(f'estimate {short_bag} --contact {contact} --plot {path}')[0] == 0
    assert path.read_bytes().startswith(b'\x89PNG')


def test_markers_in_another_frame_are_where_transforms_have_them(tmp_path, cli):
    time, pulled, at_rest = experiments.staircase_of(experiments.TENSIONS[:2])
    bags = [tmp_path / frame for frame in ('arm_base', 'world')]
    for bag in bags:
        samples = [experiments.description(), *experiments.tension_samples(time, pulled)]
        for at, tension in zip(at_rest, np.interp(at_rest, time, pulled)):
            stamp = experiments.nanoseconds(at)
            points = experiments.seen(tension, experiments.MARKER_S[1:])
            frame = 'arm_base' if at == at_rest[0] else bag.name  # of the first, no transform
            if frame == 'world':  # in which the base moves
                turn = Rotation.from_rotvec([0.3 * at, 0.0, 1.0])
                place = np.array([1.0, 0.2 * at, 0.5])
                base = experiments.transform(stamp, 'arm_base', place, 'world', turn.as_quat())
                samples.append(experiments.tf_message([base], stamp))
                points = turn.apply(points) + place
            # A stamp that is not set stands for the time of receipt.
            poses = map(experiments.pose, points)
            header = experiments.header(0 if at == at_rest[2] else stamp, frame)
            name, kind = '/measured/markers', 'geometry_msgs/msg/PoseArray'
            samples.append(experiments.message(name, kind, stamp, header=header, poses=[*poses]))
        experiments.bag_of(bag, samples)
    markers = ' '.join(map(str, experiments.MARKER_S[1:]))
    result, moving = (cli.json(f'estimate {bag} --marker-s {markers} --json') for bag in bags)
    innovations = result['innovations']['markers']
    assert innovations['accepted'] == len(at_rest)
    assert moving['innovations']['markers'] == pytest.approx(innovations, rel=1e-6)


def test_tip_poses_alone_do(short_bag, cli):
    """Without load cells tensions keep their priors, and there is no shape to compare with."""
    result = cli.json(f'estimate {short_bag} --tensions - --force-stddev 0.001 --json')
    assert set(result['innovations']) == {'tip pose'}
    assert any('is not compared with: there are no tensions' in one for one in result['notes'])
    assert any('tensions change by' in one for one in result['notes'])


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        ('--contact elbow', '--contact is elbow, expected one of tip, at, somewhere'),
        ('--contact at', 'contact_s is empty, expected where the arm is touched'),
        ('--contact at here', '--contact at is followed by here, expected arc coord'),
        ('--contact somewhere --smooth', '--smooth goes with one place of contact'),
        ('--rate -5', '--rate is -5.0, expected a finite rate >= 0 [Hz]'),
        ('--clock-offset nan', '--clock-offset is nan, expected a finite time'),
        ('--align 1 2', '--align is 1 2, expected fit, none or X Y Z'),
        ('--markers /gone', 'no topic /gone for measured/markers; it has'),
        ('--tensions /camera/midline', 'topic /camera/midline is of nav_msgs/msg/Path'),
        ('--midlines /tendon_tensions', 'is of octo_arm_msgs/msg/TendonTensions, expected'),
        ('--tensions - --tip-pose -', 'nothing is measured there, expected tensions'),
        ('--no-copy', '--no-copy has no effect without --out'),
        ('--storage sqlite3', '--storage has no effect without --out'),
        ('--rate 0', '--rate has no effect without --out'),
        ('--marker-s 0.1', '--marker-s has no effect without measured/markers; there are te'),
        ('--tensions - --tension-stddev 1', '--tension-stddev has no effect without t'),
        ('--tensions - --tendons a b c d', '--tendons has no effect without tensions; t'),
        ('--motors a b c d', '--motors has no effect without tendon_displacements; there'),
        ('--spools 0.01', '--spools has no effect without tendon_displacements; there'),
        ('--contact none --force-stddev 1', 'no effect with --contact none'),
        ('--current-stddev 1', 'current_stddev is 1, which has no effect with contact tip'),
        ('--tension-bias-rate 1', 'or no value without estimator.tension_bias_stddev'),
        ('--tensions - --clock-offset 1', '--clock-offset has no effect without --mid'),
    ],
)
def test_wrong_options_are_one_line(short_bag, options, words, cli):
    assert words in cli.refused(f'estimate {short_bag} {options}')


def test_the_help_states_the_defaults_that_hold(capsys):
    with pytest.raises(SystemExit):
        main(['estimate', '--help'])
    assert 'cells that are never faulty (default: 0)' in ' '.join(capsys.readouterr().out.split())
