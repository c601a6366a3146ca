"""Recordings of an arm that moves: `replay --dynamic`, `compare --dynamic` and fits."""

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from recordings import START, displacement_sample, samples, text_sample, write_bag

from octo_arm_model import Config
from octo_arm_model.cli.main import main
from octo_arm_model.config.parameter_files import load_parameters, parameters_as_yaml, preset_path

ARM = load_parameters(preset_path('renda2012_prototype')) | {
    'model': 'exact', 'stations': 11, 'material.density': 1080.0, 'motion.viscosity': 300.0,
    'motion.normal_drag': 2.5, 'motion.added_mass': 1.5, 'loads.fluid_density': 1000.0,
}  # fmt: skip
# A pull that is let go: the arm swings. Corners are moments that are recorded.
PROFILE = """\
times: [0.0, 0.04, 0.2, 0.24, 0.6]
tensions: [[0, 0, 0, 0], [0.5, 0, 0, 0], [0.5, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]]
interpolation: linear
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A simulated recording in bag and table, and the file of its arm."""
    folder = tmp_path_factory.mktemp('swing')
    (folder / 'arm.yaml').write_text(parameters_as_yaml(ARM))
    (folder / 'pull.yaml').write_text(PROFILE)
    files = '--out', str(folder / 'swing'), '--csv', str(folder / 'swing.csv')
    assert main(['simulate', str(folder / 'arm.yaml'), str(folder / 'pull.yaml'), *files]) == 0
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
    status, *_ = cli(
        'replay', folder / 'swing.csv', table, '--config', folder / 'arm.yaml', '--dynamic',
        '--step', '3e-3',
    )  # fmt: skip
    assert status == 0
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
    arm = Config.from_parameters(ARM).arm
    row = np.array([0.3, 0.0, 0.0, 0.0])
    rows = [part * row for part in (0.0, 0.5, 1.0)]
    spread = [one._replace(received_ns=START + 20_000_000 * number)
              for number, one in enumerate(samples(arm, [*rows, *rows]))]  # fmt: skip
    first, second = spread[:3], spread[3:]
    second = [one._replace(data=before.data) for one, before in zip(second, first)]
    text = text_sample('/arm_description', parameters_as_yaml(ARM))
    bag = write_bag(tmp_path / 'bag', [text, *first, *second])
    status, out, _ = cli('replay', bag, tmp_path / 'out', '--dynamic')
    assert status == 0 and 'began to move from rest 2 times' in out
    found = poses(tmp_path / 'out')
    assert_array_equal(found[:3], found[3:])


def test_winches_drive_the_moving_arm(tmp_path, cli):
    name = Config.from_parameters(ARM).arm.tendon_names[0]
    reeled = [0.0, 0.002, 0.004, 0.004]
    content = [displacement_sample([name], [one], START + 50_000_000 * number)
               for number, one in enumerate(reeled)]  # fmt: skip
    text = text_sample('/arm_description', parameters_as_yaml(ARM))
    bag = write_bag(tmp_path / 'bag', [text, *content])
    out = cli.json(
        'replay', bag, tmp_path / 'out', '--dynamic', '--csv', tmp_path / 'csv', '--json'
    )
    assert out['topics']['/tendon_displacements']['answered'] == 4
    pulled = np.loadtxt(tmp_path / 'csv' / 'tensions.csv', delimiter=',', skiprows=1)
    assert pulled[0, 1] == 0.0 and pulled[1, 1] > 0.01
    assert np.ptp(poses(tmp_path / 'out')[:, -1, :3], axis=0).max() > 0.005


def seen(folder: Path, tmp_path: Path, noise: float, **start: float) -> list[object]:
    """Arguments of identify: tables of tensions and of tips as seen, and an arm to begin with."""
    with (folder / 'swing.csv').open(newline='') as file:
        names = next(csv.reader(file))
        rows = np.loadtxt(file, delimiter=',')
    tips = rows[:, 1:4] + noise * np.random.default_rng(0).standard_normal((len(rows), 3))
    for name, columns, table in (
        ('pulled', names[7:], rows[:, 7:]), ('seen', ['x', 'y', 'z'], tips),
    ):  # fmt: skip
        content, head = np.column_stack([rows[:, 0], table]), ','.join(['time', *columns])
        np.savetxt(tmp_path / f'{name}.csv', content, '%.9g', ',', header=head, comments='')
    values = ARM | {f'motion.{name}': value for name, value in start.items()}
    (tmp_path / 'start.yaml').write_text(parameters_as_yaml(values))
    return [
        'identify', '--config', tmp_path / 'start.yaml', '--tension-csv', tmp_path / 'pulled.csv',
        '--midline-csv', tmp_path / 'seen.csv', '--align', 'none',
    ]  # fmt: skip


def test_a_swing_tells_damping_drag_and_added_mass(folder, tmp_path, cli):
    given = seen(folder, tmp_path, 1e-4, viscosity=200.0, normal_drag=2.0, added_mass=1.2)
    fitted = tmp_path / 'fitted.yaml'
    found = cli.json(
        *given, '--step', '1e-2', '--loss', 'linear', '--fit', 'damping', 'drag', 'added_mass',
        '--json', '--out', fitted,
    )  # fmt: skip
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
    text = cli.refused(*given, '--fit', 'damping', status=1)
    assert 'the arm does not swing: it is within' in text
    for more, message in (
        (('--fit', 'damping', 'axial_stiffness'), 'axial_stiffness is not fitted to an arm that'),
        (('--fit', 'damping', 'tension_scale'), 'tension_scale is not fitted to an arm that'),
        (('--fit', 'drag', '--model', 'renda2012'), 'of which only exact moves'),
        (('--fit', 'drag', '--ramp'), 'a fit of a motion, does not go with --ramp'),
    ):
        assert message in cli.refused(*given, *more)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (('replay', 'bag', 'out', '--step', '1e-3'), '--step has no effect without --dynamic'),
        (('replay', 'bag', 'out', '--dynamic', '--step', '9'), '--step is 9'),
        (('replay', 'bag', 'out', '--dynamic', '--model', 'renda2012'), 'does not move'),
        (('compare', 'bag', '--dynamic', '--model', 'all'), 'only exact moves'),
        (('compare', 'bag', '--dynamic', '--align', 'fit'), 'alignment of an arm that moves'),
        (('compare', 'bag', '--dynamic', '--hold', '2'), '--hold has no effect with --dynamic'),
        (('compare', 'bag', '--dynamic', '--config', 'renda2012_prototype'), 'density is 0.0'),
    ],
)
def test_wrong_options_are_refused(arguments, message, folder, tmp_path, cli):
    places = {'bag': folder / 'swing', 'out': tmp_path / 'out'}
    more = ('--midlines', '/tip_pose') if arguments[0] == 'compare' else ()
    assert message in cli.refused(*(places.get(one, one) for one in arguments), *more)
    assert not (tmp_path / 'out').exists()
