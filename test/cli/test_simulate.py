"""`octo-arm simulate` and `octo-arm modes`: files, output and wrong input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from octo_arm_model import Config, MotionProperties
from octo_arm_model.cli.main import main

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
def profile(tmp_path: Path) -> str:
    path = tmp_path / 'profile.yaml'
    path.write_text(PROFILE)
    return str(path)


def simulate(*arguments: str) -> int:
    return main(['simulate', *ARM, *WATER, *arguments])


def test_a_simulation_is_the_same_in_bag_and_table(
    profile: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('rosbags')
    from octo_arm_model.bags.reader import BagReader
    from octo_arm_model.wire.backbone import read_poses

    bag, table = tmp_path / 'bag', tmp_path / 'table.csv'
    assert simulate(profile, '--hold', '0.1', '--out', str(bag), '--csv', str(table)) == 0
    out, err = capsys.readouterr()
    assert out.startswith('0.4 s simulated in')
    assert '20 moments in' in err
    names = table.read_text().partition('\n')[0].split(',')
    assert names[:3] == ['time', 'tip_x', 'tip_y']
    assert names[-1] == 'tendon_3_4'
    rows = np.loadtxt(table, delimiter=',', skiprows=1)
    np.testing.assert_allclose(rows[:, 0], 0.02 * np.arange(21), atol=1e-12)
    np.testing.assert_allclose(rows[5:, names.index('tendon_3_1')], 0.2)
    with BagReader(bag) as reader:
        assert {'/tendon_tensions', '/backbone/poses', '/tip_pose'} <= set(reader.topics)
        poses = [record.data for record in reader.messages(['/backbone/poses'])]
    assert len(poses) == len(rows)
    _, last = read_poses(poses[-1])
    np.testing.assert_allclose(last[-1, :3], rows[-1, 1:4], rtol=1e-6)
    # It lags behind its equilibrium, and the same options give the same numbers.
    assert np.abs(rows[-1, 4:7]).max() > 1e-3
    again = tmp_path / 'again.csv'
    assert simulate(profile, '--hold', '0.1', '--csv', str(again)) == 0
    assert again.read_bytes() == table.read_bytes()


def test_pictures_of_a_simulation(profile: str, tmp_path: Path) -> None:
    matplotlib = pytest.importorskip('matplotlib.image')
    plot, gif = tmp_path / 'motion.png', tmp_path / 'motion.gif'
    assert simulate(profile, '--rate', '10', '--plot', str(plot), '--animate', str(gif)) == 0
    assert np.ptp(matplotlib.imread(plot)) > 0.5
    assert gif.read_bytes().startswith(b'GIF8')


@pytest.mark.parametrize(
    ('arguments', 'status', 'message'),
    [
        (('--model', 'renda2012'), 2, 'does not move: expected exact'),
        (('--rate', '1e4'), 2, 'at most one moment for each step'),
        (('--step', '0'), 2, 'step is 0'),
        (('--hold', '1e9'), 2, 'moments, expected at most'),
        (('--csv', 'one', '--plot', 'one'), 2, 'different files'),
    ],
)
def test_wrong_options_are_one_line(
    arguments: tuple[str, ...], status: int, message: str, profile: str,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert simulate(profile, *arguments) == status
    err = capsys.readouterr().err
    assert message in err
    assert err.count('\n') == 1


def test_an_arm_without_density_is_refused(
    profile: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['simulate', 'renda2012_table4', profile]) == 2
    assert 'material.density is 0.0' in capsys.readouterr().err


def test_modes_are_printed_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['modes', *ARM, *WATER, '--count', '5', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(found['frequencies'][::2], [0.2625, 0.7105, 1.4588], atol=6e-5)
    assert np.shape(found['shapes']) == (5, 11, 3)
    assert main(['modes', *ARM, '--count', '2']) == 0
    assert '0.4056' in capsys.readouterr().out
    pytest.importorskip('matplotlib')
    picture = tmp_path / 'modes.png'
    tensions = '[[0,0,0.02,0],[0,0,0,0],[0.2,0,0,0]]'
    assert main(['modes', *ARM, '--tensions', tensions, '--plot', str(picture)]) == 0
    assert picture.stat().st_size > 10_000
    assert main(['modes', *ARM, '--count', '0']) == 2
    assert 'number of modes is 0' in capsys.readouterr().err


def test_the_file_of_an_arm_says_how_it_moves() -> None:
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
