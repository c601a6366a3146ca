"""Arms that move: `octo-arm simulate` and `modes`, and recordings with --dynamic."""

import csv
from pathlib import Path

import numpy as np
import pytest
from experiments import arm_file
from numpy.testing import assert_allclose, assert_array_equal
from recordings import START, displacement_sample, samples, text_sample, write_bag

from octo_arm_model import Config, MotionProperties, Sphere, load_config
from octo_arm_model.cli.main import main
from octo_arm_model.config.parameter_files import load_parameters, parameters_as_yaml
from octo_arm_model.simulation.moving_arm import Moment, draw_motion

ARM = 'renda2012_table4 --density 1080 --viscosity 300 --stations 11'
WATER = '--fluid-density 1000 --water renda2018'
PROFILE = """\
times: [0.0, 0.1, 0.3]
tensions:
  - [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
  - [0, 0, 0.02, 0, 0.1, 0, 0, 0, 0.2, 0, 0, 0]
  - [0, 0, 0.02, 0, 0.1, 0, 0, 0, 0.2, 0, 0, 0]
interpolation: linear
"""


@pytest.fixture
def profile(tmp_path):
    path = tmp_path / 'profile.yaml'
    path.write_text(PROFILE)
    return str(path)


SIMULATE = f'simulate {ARM} {WATER}'


def test_a_simulation_is_the_same_in_bag_and_table(profile, tmp_path, cli):
    pytest.importorskip('rosbags')
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.wire.backbone import read_poses

    bag, table, again = (tmp_path / name for name in ('bag', 'table.csv', 'again.csv'))
    held = f'{SIMULATE} {profile} --hold 0.1 --csv'
    status, out, err = cli(f'{held} {table} --out {bag}')
    assert status == 0 and out.startswith('0.4 s simulated in') and '20 moments in' in err
    names = table.read_text().partition('\n')[0].split(',')
    assert names[:2] == ['time [s]', 'tip_x [m]'] and names[-1] == 'tendon_3_4 [N]'
    rows = np.loadtxt(table, delimiter=',', skiprows=1)
    assert_allclose(rows[:, 0], 0.02 * np.arange(21), atol=1e-12)
    assert_allclose(rows[5:, names.index('tendon_3_1 [N]')], 0.2)
    with BagReader(bag) as reader:
        assert {'/tendon_tensions', '/backbone/poses', '/tip_pose'} <= set(reader.topics)
        poses = [record.data for record in reader.messages(['/backbone/poses'])]
    assert len(poses) == len(rows)
    _, last = read_poses(poses[-1])
    assert_allclose(last[-1, :3], rows[-1, 1:4], rtol=1e-6)
    assert cli(f'{SIMULATE} {profile} --rate 30 --csv {again}')[0] == 0
    times = np.loadtxt(again, delimiter=',', skiprows=1)[:, 0]
    assert_allclose(times, np.arange(10) / 30, atol=1e-9)
    # It lags behind its equilibrium, and the same options give the same numbers.
    assert np.abs(rows[-1, 4:7]).max() > 1e-3
    assert cli(f'{held} {again} --step 1e9')[0] == 0  # with one step for each moment
    assert_allclose(np.loadtxt(again, delimiter=',', skiprows=1)[:, :4], rows[:, :4], atol=5e-3)
    assert cli(f'{held} {again}')[0] == 0
    assert again.read_bytes() == table.read_bytes()


def test_pictures_of_a_simulation(profile, tmp_path, cli):
    matplotlib = pytest.importorskip('matplotlib.image')
    image = pytest.importorskip('PIL.Image')
    plot, gif = tmp_path / 'motion.png', tmp_path / 'motion.gif'
    assert cli(f'{SIMULATE} {profile} --rate 10 --plot {plot} --animate {gif}')[0] == 0
    assert np.ptp(matplotlib.imread(plot)) > 0.5
    with image.open(gif) as moving:
        assert (moving.n_frames, moving.info['duration']) == (4, 100)
    for rate in (1e-3, 250):
        said = cli(f'{SIMULATE} {profile} --rate {rate} --animate {gif}')
        assert said[0] == 2 and f'rate is {rate:g}, expected 0.0016 to 100 Hz for a GIF' in said[2]
        assert 'moments' not in said[2]  # It is refused before the arm moves.
    # An obstacle is in the picture where it is near the arm.
    shape = load_config('renda2012_table4').solver('exact').solve(np.zeros((3, 4)))
    moments, seen = [Moment(time, shape, np.zeros(3)) for time in (0.0, 1.0)], []
    for centre in ((0.2, 0.0, 0.1), (0.2, 0.0, 9.0)):
        draw_motion(plot, moments, 'ball', [Sphere(centre, 0.05, stiffness=1e6)])
        seen.append(matplotlib.imread(plot))
    assert (np.abs(seen[0] - seen[1]).max(axis=2) > 0.1).sum() > 2000


@pytest.mark.parametrize(
    ('command', 'message'),
    [
        (f'{SIMULATE} PROFILE --model renda2012', 'does not move: expected exact'),
        (f'{SIMULATE} PROFILE --rate 1e9', 'moments, expected at most'),
        (f'{SIMULATE} PROFILE --step 1e-9', 'step is 1e-09, expected'),
        (f'{SIMULATE} PROFILE --hold 1e9', 'moments, expected at most'),
        (f'{SIMULATE} PROFILE --csv one --plot one', 'different files'),
        (f'{SIMULATE} PROFILE --rate 100 --hold 29.7 --animate one', '3001 frames, expected'),
        (f'{SIMULATE} PROFILE --storage mcap', '--storage has no effect without --out'),
        ('simulate renda2012_table4 PROFILE', 'material.density is 0.0'),
        (f'modes {ARM} --count 0', 'number of modes is 0'),
    ],
)
def test_wrong_options_are_one_line(command, message, profile, cli, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert message in cli.refused(command.replace('PROFILE', profile))


def test_modes_are_printed_and_drawn(tmp_path, cli):
    found = cli.json(f'modes {ARM} {WATER} --count 5 --json')
    assert_allclose(found['frequencies'][::2], [0.2625, 0.7105, 1.4588], atol=6e-5)
    assert np.shape(found['shapes']) == (5, 11, 3)
    assert '0.4056' in cli(f'modes {ARM} --count 2')[1]
    pytest.importorskip('matplotlib')
    picture, tensions = tmp_path / 'modes.png', '[[0,0,0.02,0],[0,0,0,0],[0.2,0,0,0]]'
    assert cli(f'modes {ARM} --tensions {tensions} --plot {picture}')[0] == 0
    assert picture.stat().st_size > 10_000


def test_the_file_of_an_arm_says_how_it_moves():
    given = load_parameters('renda2012_prototype')
    given |= {'model': 'exact', 'material.density': 1080.0, 'loads.fluid_density': 1000.0}
    motion = {'motion.viscosity': 300.0, 'motion.water': 'cylinder', 'motion.current': [0.1, 0, 0]}
    config = Config.from_parameters(given | motion)
    assert config.motion == MotionProperties(300.0, 0.0, 1.1, 0.01, 1.0, (0.1, 0.0, 0.0))
    assert config.dynamics(5).properties == config.motion
    for wrong, message in (
        ({'motion.water': 'empty'}, "motion.water is 'empty', expected renda2018 or cylinder"),
        ({'motion.current': [1.0]}, 'motion.current'),
        ({'motion.viscosity': -1.0}, 'motion.viscosity'),
    ):
        with pytest.raises(ValueError, match=message):
            Config.from_parameters(given | motion | wrong)


MOVING = load_parameters('renda2012_prototype') | {
    'model': 'exact',
    'stations': 11,
    'material.density': 1080.0,
    'motion.viscosity': 300.0,
    'motion.normal_drag': 2.5,
    'motion.added_mass': 1.5,
    'loads.fluid_density': 1000.0,
}
TEXT = text_sample('/arm_description', parameters_as_yaml(MOVING))
# A pull that is let go: the arm swings. Corners are moments that are recorded.
PULLS = """\
times: [0.0, 0.04, 0.2, 0.24, 0.6]
tensions: [[0, 0, 0, 0], [0.5, 0, 0, 0], [0.5, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
interpolation: linear
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A simulated recording in bag and table, and the file of its arm."""
    folder = tmp_path_factory.mktemp('swing')
    (folder / 'pull.yaml').write_text(PULLS)
    given = f'{arm_file(folder, MOVING)} {folder}/pull.yaml'
    command = f'simulate {given} --out {folder}/swing --csv {folder}/swing.csv'
    assert main(command.split()) == 0
    return folder


def poses(bag: Path) -> np.ndarray:
    """Shapes in a bag, (messages, stations, 7)."""
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.wire.backbone import read_poses

    with BagReader(bag) as reader:
        return np.array(
            [read_poses(record.data)[1] for record in reader.messages(['/backbone/poses'])]
        )


def test_a_replayed_motion_is_the_simulated_one(folder, tmp_path, cli):
    again, table = tmp_path / 'again', tmp_path / 'table'
    status, out, _ = cli('replay', folder / 'swing', again, '--dynamic', '--lengths')
    assert status == 0 and '31 answered by the moving arm' in out
    assert_allclose(poses(again), poses(folder / 'swing'), atol=1e-7)
    # From the table too, in steps of another length.
    config = folder / 'arm.yaml'
    other = f'replay {folder}/swing.csv {table} --config {config} --dynamic --step 3e-3'
    assert cli(other)[0] == 0
    assert_allclose(poses(table)[..., :3], poses(folder / 'swing')[..., :3], atol=2e-4)
    equilibria = tmp_path / 'equilibria'
    assert cli('replay', folder / 'swing', equilibria)[0] == 0
    away = poses(equilibria)[:, -1, :3] - poses(again)[:, -1, :3]
    assert np.abs(away).max() > 0.02


def test_compared_with_its_motion_the_error_is_far_less(folder, tmp_path, cli):
    common = 'compare', folder / 'swing', '--midlines', '/tip_pose', '--clock-offset', '0'
    still = cli.json(*common, '--poses', '--tolerance', '0.005', '--json')
    moving = cli.json(*common, '--dynamic', '--json')
    errors = [one['models']['exact']['average_tip_error_percent'] for one in (still, moving)]
    assert errors[0] > 5.0 and errors[1] < 1e-3
    assert len(moving['steps']) == len(still['steps']) == 31
    pytest.importorskip('matplotlib', reason='needs matplotlib')
    status, out, _ = cli(*common, '--dynamic', '--out', tmp_path / 'out')
    assert status == 0 and 'errors [% of L] at 31 moments' in out
    assert (tmp_path / 'out' / 'tip_over_time.png').stat().st_size > 10_000
    with (tmp_path / 'out' / 'tensions.csv').open(newline='') as file:
        assert len(list(csv.reader(file))) == 32


def test_a_motion_begins_again_where_stamps_go_back(tmp_path, cli):
    arm = Config.from_parameters(MOVING).arm
    row = np.array([0.3, 0.0, 0.0, 0.0])
    rows = [part * row for part in (0.0, 0.5, 1.0)]
    spread = [
        one._replace(received_ns=START + 20_000_000 * number)
        for number, one in enumerate(samples(arm, [*rows, *rows]))
    ]
    first, second = spread[:3], spread[3:]
    second = [one._replace(data=before.data) for one, before in zip(second, first)]
    bag = write_bag(tmp_path / 'bag', [TEXT, *first, *second])
    status, out, _ = cli('replay', bag, tmp_path / 'out', '--dynamic')
    assert status == 0 and 'began to move from rest 2 times' in out
    found = poses(tmp_path / 'out')
    assert_array_equal(found[:3], found[3:])


def test_winches_drive_the_moving_arm(tmp_path, cli):
    name = Config.from_parameters(MOVING).arm.tendon_names[0]
    reeled = [0.0, 0.002, 0.004, 0.004]
    content = [
        displacement_sample([name], [one], START + 50_000_000 * number)
        for number, one in enumerate(reeled)
    ]
    bag = write_bag(tmp_path / 'bag', [TEXT, *content])
    out = cli.json(f'replay {bag} {tmp_path}/out --dynamic --csv {tmp_path}/csv --json')
    assert out['topics']['/tendon_displacements']['answered'] == 4
    pulled = np.loadtxt(tmp_path / 'csv' / 'tensions.csv', delimiter=',', skiprows=1)
    assert pulled[0, 1] == 0.0 and pulled[1, 1] > 0.01
    assert np.ptp(poses(tmp_path / 'out')[:, -1, :3], axis=0).max() > 0.005


def seen(folder: Path, tmp_path: Path, noise: float, **start: float) -> str:
    """A command: tables of tensions and of tips as seen, and an arm to begin with."""
    with (folder / 'swing.csv').open(newline='') as file:
        names = next(csv.reader(file))
        rows = np.loadtxt(file, delimiter=',')
    tips = rows[:, 1:4] + noise * np.random.default_rng(0).standard_normal((len(rows), 3))
    for name, columns, table in (
        ('pulled', names[7:], rows[:, 7:]),
        ('seen', ['x', 'y', 'z'], tips),
    ):
        content, head = np.column_stack([rows[:, 0], table]), ','.join(['time', *columns])
        np.savetxt(tmp_path / f'{name}.csv', content, '%.9g', ',', header=head, comments='')
    values = MOVING | {f'motion.{name}': value for name, value in start.items()}
    return (
        f'identify --config {arm_file(tmp_path, values)} --tension-csv {tmp_path}/pulled.csv '
        f'--midline-csv {tmp_path}/seen.csv --align none'
    )


def test_a_swing_tells_damping_drag_and_added_mass(folder, tmp_path, cli):
    given = seen(folder, tmp_path, 1e-4, viscosity=200.0, normal_drag=2.0, added_mass=1.2)
    fitted = tmp_path / 'fitted.yaml'
    fits = '--fit damping drag added_mass'
    found = cli.json(f'{given} --step 1e-2 --loss linear {fits} --json --out {fitted}')
    truth = {'damping': 300.0, 'drag': 2.5, 'added_mass': 1.5}
    for name, value in truth.items():
        low, high = found['estimates'][name]['interval95']
        assert low < value < high and high - low < 0.35 * value
    assert found['residuals']['after']['rms'] < 2e-4 < found['residuals']['before']['rms']
    motion = Config.from_parameters(load_parameters(fitted)).motion
    assert motion.normal_drag == pytest.approx(found['estimates']['drag']['value'])
    assert motion.viscosity == pytest.approx(found['estimates']['damping']['value'])


def test_what_does_not_swing_tells_nothing(folder, tmp_path, cli):
    given = seen(folder, tmp_path, 0.0)
    table = tmp_path / 'pulled.csv'
    head, *rows = table.read_text().splitlines()
    held = [f'{row.split(",")[0]},0.3,0,0,0' for row in rows]
    table.write_text('\n'.join([head, *held]))
    for more, status, message in (
        ('damping', 1, 'the arm does not swing: it is within'),
        ('damping axial_stiffness', 2, 'axial_stiffness is not fitted to an arm that'),
        ('damping tension_scale', 2, 'tension_scale is not fitted to an arm that'),
        ('drag --model renda2012', 2, 'of which only exact moves'),
        ('drag --ramp', 2, 'a fit of a motion, does not go with --ramp'),
    ):
        assert message in cli.refused(f'{given} --fit {more}', status=status)


COMPARE = 'compare BAG --midlines /tip_pose --dynamic'


@pytest.mark.parametrize(
    ('command', 'message'),
    [
        ('replay BAG OUT --step 1e-3', '--step has no effect without --dynamic'),
        ('replay BAG OUT --dynamic --step 9', '--step is 9'),
        ('replay BAG OUT --motors 0', '--motors has no effect on tensions alone'),
        ('replay BAG OUT --spools 0.01', '--spools has no effect on tensions alone'),
        ('replay BAG OUT --dynamic --model renda2012', 'does not move'),
        (f'{COMPARE} --model all', 'only exact moves'),
        (f'{COMPARE} --align fit', 'alignment of an arm that moves'),
        (f'{COMPARE} --hold 2', '--hold has no effect with --dynamic'),
        (f'{COMPARE} --config renda2012_prototype', 'density is 0.0'),
    ],
)
def test_wrong_options_are_refused(command, message, folder, tmp_path, cli):
    command = command.replace('BAG', f'{folder}/swing').replace('OUT', f'{tmp_path}/out')
    assert message in cli.refused(command)
    assert not (tmp_path / 'out').exists()
