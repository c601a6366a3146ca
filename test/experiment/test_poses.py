"""Tables of static poses, a row for each: a set of tensions and the tip that it has."""

from pathlib import Path

import numpy as np
import pytest
from experiments import PARAMETERS

from octo_arm_model.config.config import Config

ARM = ['--config', 'renda2012_prototype', '--model', 'exact', '--align', 'none']
CONFIG = Config.from_parameters({**PARAMETERS, 'model': 'exact'})
COUNT = 40


def files(
    folder: Path, tensions: np.ndarray, time: np.ndarray, late: float = 0.0, every: int = 1
) -> list[str]:
    """Options of a table of ``tensions`` (n, 4) [N] and one of the tips that the model has."""
    poses = tensions[::every].reshape(-1, *CONFIG.arm.tension_shape)
    tips = np.repeat(CONFIG.solver().solve(poses).tip, every, axis=0)
    options = []
    for option, names, at, numbers in (
        ('--tension-csv', CONFIG.arm.tendon_names, time, tensions),
        ('--midline-csv', 'xyz', time + late, tips),
    ):
        path = folder / f'{option.strip("-")}.csv'
        rows = [','.join(map(repr, [t, *row])) for t, row in zip(at.tolist(), numbers.tolist())]
        path.write_text('\n'.join([','.join(['time', *names]), *rows]) + '\n')
        options += [option, str(path)]
    return options


def random_poses(seed: int, count: int = COUNT) -> np.ndarray:
    tensions = np.zeros((count, 4))
    tensions[:, :2] = np.random.default_rng(seed).uniform(0.0, 2.0, (count, 2)).round(2)
    return tensions


def test_poses_are_refused_as_steps_and_read_as_poses(tmp_path, cli):
    given = files(tmp_path, random_poses(0), 2.3 * np.arange(COUNT))
    for command in ('compare', 'identify'):
        status, out, err = cli(command, *given, *ARM)
        assert (status, out) == (1, '')
        assert 'no tension stays within 0.0' in err and err.count('\n') == 1
        assert 'each row is a static pose, as in a table of poses, say --poses' in err
        assert 'changes slowly instead of in steps, say --ramp' in err
    said = cli.json('compare', *given, *ARM, '--poses', '--json')
    assert len(said['steps']) == COUNT and said['clock_offset'] == 0.0
    assert max(step['tip_error_percent'] for step in said['steps']) < 1e-6
    assert any('40 poses, 40 of them with frames: 40 of 40 used' in one for one in said['notes'])


def test_tips_that_no_number_of_metres_reaches_are_left_out(tmp_path, cli):
    given = files(tmp_path, random_poses(5, 3), np.arange(3.0))
    table = Path(given[-1])
    table.write_text(table.read_text().rsplit('\n', 2)[0] + '\n2.0,1e300,0.0,0.0\n')
    said = cli.json('compare', *given, *ARM, '--poses', '--json')
    assert len(said['steps']) == 2
    assert any('1 left out, as point 1 is [1e+300, 0.0, 0.0]' in one for one in said['notes'])


def test_the_modulus_is_fitted_to_poses(tmp_path, cli):
    given = files(tmp_path, random_poses(1, 8), 2.3 * np.arange(8))
    said = cli.json('identify', *given, *ARM, '--poses', '--json')
    assert said['steps'] == 8
    assert said['estimates']['youngs_modulus']['value'] == pytest.approx(1.1e5, rel=1e-6)


@pytest.mark.parametrize(
    ('spacing', 'late'), [(1.0, 0.0), (0.05, 0.0), (1.0, 0.08), (1.0, -0.08), (3600.0, 0.0)]
)
def test_each_frame_is_that_of_the_pose_of_its_stamp(spacing, late, tmp_path, cli):
    given = files(tmp_path, random_poses(2, 12), spacing * np.arange(12), late)
    said = cli.json('compare', *given, *ARM, '--poses', '--json')
    assert [step['frames'] for step in said['steps']] == 12 * [1]
    assert max(step['tip_error_percent'] for step in said['steps']) < 1e-6


def test_few_frames_set_no_clock(tmp_path, cli):
    """A function of ten numbers passes through few tips at any offset of the clock."""
    held = np.repeat(random_poses(3, 4), 20, axis=0)
    given = files(tmp_path, held, 0.2 * np.arange(80), every=20)
    (tmp_path / 'midline-csv.csv').write_text('\n'.join(
        line for number, line in enumerate((tmp_path / 'midline-csv.csv').read_text().splitlines())
        if number % 10 in (0, 9)
    ) + '\n')  # fmt: skip
    said = cli.json('compare', *given, *ARM, '--json')
    assert said['clock_offset'] == 0.0
    assert any('clock offset taken as 0 s' in note for note in said['notes'])
    assert len(said['steps']) == 4
    assert max(step['tip_error_percent'] for step in said['steps']) < 1e-6


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (['--poses', '--steady', '0.1'], '--steady has no effect with --poses'),
        (['--poses', '--hold', '1.0'], '--hold has no effect with --poses'),
        (['--ramp', '--settle', '2'], '--settle has no effect with --ramp'),
        (['--ramp', '0.1', '--hold', '2'], '--hold has no effect with --ramp'),
        (['--poses', '--base-end', 'first'], '--base-end has no effect on tips and markers'),
    ],
)
def test_options_of_steps_have_no_effect_on_others(words, message, tmp_path, cli):
    given = files(tmp_path, random_poses(4, 3), np.arange(3.0))
    status, out, err = cli('compare', *given, *ARM, *words)
    assert (status, out) == (2, '') and message in err
