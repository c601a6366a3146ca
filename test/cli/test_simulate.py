"""`octo-arm simulate` and `octo-arm modes`: files, output and wrong input."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from octo_arm_model import Config, MotionProperties, Sphere, load_config
from octo_arm_model.simulation.moving_arm import Moment, draw_motion

ARM = ('renda2012_table4', '--density', '1080', '--viscosity', '300', '--stations', '11')
WATER = ('--fluid-density', '1000', '--water', 'renda2018')
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


SIMULATE = ('simulate', *ARM, *WATER)


def test_a_simulation_is_the_same_in_bag_and_table(profile, tmp_path, cli):
    pytest.importorskip('rosbags')
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.wire.backbone import read_poses

    bag, table, again = (tmp_path / name for name in ('bag', 'table.csv', 'again.csv'))
    held = *SIMULATE, profile, '--hold', '0.1', '--csv'
    status, out, err = cli(*held, table, '--out', bag)
    assert status == 0 and out.startswith('0.4 s simulated in') and '20 moments in' in err
    names = table.read_text().partition('\n')[0].split(',')
    assert names[:3] == ['time', 'tip_x', 'tip_y'] and names[-1] == 'tendon_3_4'
    rows = np.loadtxt(table, delimiter=',', skiprows=1)
    assert_allclose(rows[:, 0], 0.02 * np.arange(21), atol=1e-12)
    assert_allclose(rows[5:, names.index('tendon_3_1')], 0.2)
    with BagReader(bag) as reader:
        assert {'/tendon_tensions', '/backbone/poses', '/tip_pose'} <= set(reader.topics)
        poses = [record.data for record in reader.messages(['/backbone/poses'])]
    assert len(poses) == len(rows)
    _, last = read_poses(poses[-1])
    assert_allclose(last[-1, :3], rows[-1, 1:4], rtol=1e-6)
    # It lags behind its equilibrium, and the same options give the same numbers.
    assert np.abs(rows[-1, 4:7]).max() > 1e-3
    assert cli(*held, again)[0] == 0
    assert again.read_bytes() == table.read_bytes()


def test_pictures_of_a_simulation(profile, tmp_path, cli):
    matplotlib = pytest.importorskip('matplotlib.image')
    plot, gif = tmp_path / 'motion.png', tmp_path / 'motion.gif'
    assert cli(*SIMULATE, profile, '--rate', '10', '--plot', plot, '--animate', gif)[0] == 0
    assert np.ptp(matplotlib.imread(plot)) > 0.5
    assert gif.read_bytes().startswith(b'GIF8')
    # An obstacle is in the picture where it is near the arm.
    shape = load_config('renda2012_table4').solver('exact').solve(np.zeros((3, 4)))
    moments, seen = [Moment(time, shape, np.zeros(3)) for time in (0.0, 1.0)], []
    for centre in ((0.2, 0.0, 0.1), (0.2, 0.0, 9.0)):
        draw_motion(plot, moments, 'ball', [Sphere(centre, 0.05, stiffness=1e6)])
        seen.append(matplotlib.imread(plot))
    assert (np.abs(seen[0] - seen[1]).max(axis=2) > 0.1).sum() > 2000


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ((*SIMULATE, 'PROFILE', '--model', 'renda2012'), 'does not move: expected exact'),
        ((*SIMULATE, 'PROFILE', '--rate', '1e4'), 'at most one moment for each step'),
        ((*SIMULATE, 'PROFILE', '--step', '0'), 'step is 0'),
        ((*SIMULATE, 'PROFILE', '--hold', '1e9'), 'moments, expected at most'),
        ((*SIMULATE, 'PROFILE', '--csv', 'one', '--plot', 'one'), 'different files'),
        (('simulate', 'renda2012_table4', 'PROFILE'), 'material.density is 0.0'),
        (('modes', *ARM, '--count', '0'), 'number of modes is 0'),
    ],
)
def test_wrong_options_are_one_line(
    arguments, message, profile, cli,
    monkeypatch, tmp_path,
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    given = (profile if word == 'PROFILE' else word for word in arguments)
    assert message in cli.refused(*given)


def test_modes_are_printed_and_drawn(tmp_path, cli):
    found = cli.json('modes', *ARM, *WATER, '--count', '5', '--json')
    assert_allclose(found['frequencies'][::2], [0.2625, 0.7105, 1.4588], atol=6e-5)
    assert np.shape(found['shapes']) == (5, 11, 3)
    assert '0.4056' in cli('modes', *ARM, '--count', '2')[1]
    pytest.importorskip('matplotlib')
    picture, tensions = tmp_path / 'modes.png', '[[0,0,0.02,0],[0,0,0,0],[0.2,0,0,0]]'
    assert cli('modes', *ARM, '--tensions', tensions, '--plot', picture)[0] == 0
    assert picture.stat().st_size > 10_000


def test_the_file_of_an_arm_says_how_it_moves():
    given = {
        'material.youngs_modulus': 1e5, 'material.density': 1080.0, 'body.length': 0.4,
        'body.radius_base': 0.01, 'body.radius_tip': 0.005, 'sections.anchorage': [0.4],
        'sections.offset_base': [0.005], 'sections.offset_anchorage': [0.003],
    }  # fmt: skip
    motion = {'motion.viscosity': 300.0, 'motion.water': 'cylinder', 'motion.current': [0.1, 0, 0]}
    config = Config.from_parameters(given | motion)
    assert config.motion == MotionProperties(300.0, 0.0, 1.1, 0.01, 1.0, (0.1, 0.0, 0.0))
    assert config.dynamics(5).properties == config.motion
    for wrong, message in (
        ({'motion.water': 'sea'}, "motion.water is 'sea', expected renda2018 or cylinder"),
        ({'motion.added_mass': 1.0}, 'expected 0 where motion.water is given'),
        ({'motion.current': [1.0]}, 'motion.current'),
        ({'motion.viscosity': -1.0}, 'motion.viscosity'),
    ):
        with pytest.raises(ValueError, match=message):
            Config.from_parameters(given | motion | wrong)
