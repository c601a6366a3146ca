"""Tables of static poses, recordings without steps, markers in place of midlines, CSV files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experiments import (
    MARKER_S,
    PARAMETERS,
    STATIONS,
    TENSIONS,
    TIP_ERRORS,
    WAYS,
    at_any,
    bag_of,
    description,
    marker_bag,
    nanoseconds,
    one_tendon,
    path_sample,
    pose_array,
    seen,
    staircase_of,
    tension_sample,
    tension_samples,
)
from numpy.testing import assert_allclose
from recordings import Sample

from octo_arm_model.arm import limits
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.config.config import Config
from octo_arm_model.experiment.csv_recording import CsvSources
from octo_arm_model.experiment.read_recording import read_recording
from octo_arm_model.experiment.recording import MarkerSources

ARM = ['--config', 'renda2012_prototype', '--model', 'exact', '--align', 'none']
CONFIG = Config.from_parameters({**PARAMETERS, 'model': 'exact'})
COUNT = 40


def tips_of(tensions: np.ndarray) -> np.ndarray:
    """The tips that the model has."""
    return CONFIG.solver().solve(tensions.reshape(-1, *CONFIG.arm.tension_shape)).tip


def files(folder: Path, tensions: np.ndarray, time: np.ndarray, late: float = 0.0) -> list[str]:
    """Options of a table of ``tensions`` (n, 4) [N] and one of the tips that the model has."""
    options = []
    for option, names, at, numbers in (
        ('--tension-csv', CONFIG.arm.tendon_names, time, tensions),
        ('--midline-csv', 'xyz', time + late, tips_of(tensions)),
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
        line = cli.refused(command, *given, *ARM, status=1)
        assert 'no tension stays within 0.0' in line
        assert 'each row is a static pose, as in a table of poses, say --poses' in line
        assert 'changes slowly instead of in steps, say --ramp' in line
    said = cli.json('compare', *given, *ARM, '--poses', '--json')
    assert len(said['steps']) == COUNT and said['clock_offset'] == 0.0
    assert max(step['tip_error_percent'] for step in said['steps']) < 1e-6
    assert any('40 poses, 40 of them with frames: 40 of 40 used' in one for one in said['notes'])
    given = files(tmp_path, random_poses(0, 2), np.arange(2.0), late=1.7e9)
    line = cli.refused('compare', *given, *ARM, '--poses', status=1)
    assert line.endswith('--clock-offset is added to stamps of frames\n')


def test_tips_that_no_number_of_metres_reaches_are_left_out(tmp_path, cli):
    given = files(tmp_path, random_poses(5, 3), np.arange(3.0))
    table = Path(given[-1])
    table.write_text(table.read_text().rsplit('\n', 2)[0] + '\n2.0,1e300,0.0,0.0\n')
    said = cli.json('compare', *given, *ARM, '--poses', '--json')
    assert len(said['steps']) == 2
    assert any('1 left out, as point 1 is [1e+300, 0.0, 0.0]' in one for one in said['notes'])


@pytest.mark.parametrize(
    ('spacing', 'late'), [(1.0, 0.0), (0.05, 0.0), (1.0, 0.08), (1.0, -0.08), (3600.0, 0.0)]
)
def test_each_frame_is_that_of_the_pose_of_its_stamp(spacing, late, tmp_path, cli):
    given = files(tmp_path, random_poses(2, 12), spacing * np.arange(12), late)
    said = cli.json('compare', *given, *ARM, '--poses', '--json')
    assert [step['frames'] for step in said['steps']] == 12 * [1]
    assert max(step['tip_error_percent'] for step in said['steps']) < 1e-6


def compared(tmp_path, cli, rows, *options):
    """Return what is said of a table of poses: time, tensions and tip in each of ``rows``."""
    table = tmp_path / 'poses.csv'
    head = ','.join(['time', *CONFIG.arm.tendon_names, *'xyz'])
    np.savetxt(table, rows, '%.17g', ',', header=head, comments='')
    return cli.json('compare', '--pose-csv', table, *options, '--json')


def test_points_of_a_row_without_tensions_count_for_no_other_row(tmp_path, cli):
    tensions = random_poses(6, 3)
    tips = tips_of(tensions)
    tensions[1, 0] = -1.0
    said = compared(tmp_path, cli, np.column_stack([[0.0, 0.05, 1.0], tensions, tips]), *ARM)
    assert [step['frames'] for step in said['steps']] == [1, 1]
    assert max(step['tip_error_percent'] for step in said['steps']) < 1e-6


@pytest.mark.parametrize('pulls', [(1.0, 1.0, 1.0), (1.0, 2.0, 3.0)])
def test_exact_tips_are_compared_with_the_camera_aligned(pulls, tmp_path, cli):
    tensions = np.outer(pulls, [1.0, 0.0, 0.0, 0.0])
    rows = np.column_stack([np.arange(3.0), tensions, tips_of(tensions)])
    said = compared(tmp_path, cli, rows, *ARM[:4])
    assert max(step['tip_error_percent'] for step in said['steps']) < 1e-6


def test_an_end_of_the_base_has_no_effect_on_tips(tmp_path, cli):
    given = files(tmp_path, random_poses(4, 3), np.arange(3.0))
    line = cli.refused('compare', *given, *ARM, '--poses', '--base-end', 'first')
    assert '--base-end has no effect on tips and markers' in line


STILL = ['--clock-offset', '0', '--json']
S = ['--marker-s', *map(str, MARKER_S)]


def ramp_bag(
    path: Path, seconds: float, every: float, s: Sequence[float], see: Callable[..., list[Sample]]
) -> Path:
    """Pulled for 30 s and let go for 30 s, at a steady rate; points at ``s`` are seen."""
    time = np.arange(0.0, seconds, 0.02)
    pulled = np.interp(time, [0.0, 30.0, 60.0], [TENSIONS[0], TENSIONS[-1], TENSIONS[0]])
    samples = [description(model='exact'), *tension_samples(time, pulled)]
    for at in np.arange(0.1, seconds - 0.1, every):
        points = at_any(float(np.interp(at, time, pulled)), s)
        samples += see(points, nanoseconds(at))
    return bag_of(path, samples)


@pytest.fixture(scope='module')
def ramp(tmp_path_factory):
    """Midlines at 5 Hz."""
    path = tmp_path_factory.mktemp('ramp') / 'bag'
    return ramp_bag(path, 60.0, 0.2, STATIONS, lambda *seen: [path_sample(*seen)])


def assert_errors_of_a_ramp(said: dict[str, Any]) -> None:
    for step in said['steps']:
        expected = np.interp(step['tension'], TENSIONS, TIP_ERRORS)
        assert step['tip_error_percent'] == pytest.approx(expected, abs=0.12)


def test_what_has_no_steps_is_refused_with_the_way_to_read_it(ramp, cli):
    # At the defaults the turn at the top counts as a step, of a fraction of the time.
    said = cli.json('compare', ramp, *STILL)
    assert len(said['steps']) == 1
    assert any('tensions are steady in' in note and 'say --ramp' in note for note in said['notes'])
    line = cli.refused('compare', ramp, '--steady', '0.02', *STILL, status=1)
    assert 'no tension stays within' in line
    assert 'where it changes slowly instead of in steps, say --ramp' in line


@pytest.mark.parametrize('width', [[], ['0.3']])
def test_a_ramp_has_the_errors_of_its_tensions(width, ramp, cli):
    said = cli.json('compare', ramp, '--ramp', *width, *STILL)
    assert len(said['steps']) > 20
    assert_errors_of_a_ramp(said)
    assert any('windows of a ramp' in note for note in said['notes'])


def test_markers_of_a_ramp_are_no_outliers_for_moving_more_towards_the_tip(tmp_path, cli):
    bag = ramp_bag(tmp_path / 'bag', 30.0, 0.1, MARKER_S, pose_array)
    said = cli.json('compare', bag, *S, '--ramp', *STILL)
    assert [step['outliers'] for step in said['steps']] == [0] * len(said['steps'])
    assert any('298 of 298 used' in note for note in said['notes'])
    assert_errors_of_a_ramp(said)


def test_an_arm_is_fitted_to_a_ramp(ramp, cli):
    fitted = cli.json('identify', ramp, '--ramp', '1.2', *STILL, '--model', 'exact')
    assert fitted['estimates']['youngs_modulus']['value'] == pytest.approx(1.1e5, rel=0.03)


@pytest.mark.parametrize(
    ('width', 'message'),
    [
        ('1e-4', 'more than 1000 windows of 0.0001 N, expected a wider'),
        ('nan', '--ramp is '),
        ('0', '--ramp is '),
    ],
)
def test_widths_that_make_too_many_windows_or_none_are_refused(width, message, ramp, cli):
    assert message in cli.refused('compare', ramp, '--ramp', width, *STILL)


# Raw load cells: noise around zero, a wrong scale and an offset, told and fitted -----------------


GIVEN = [*S, *STILL]
STEPS = len(staircase_of()[0])
FEW = TENSIONS[::2]


def cell_bag(
    path: Path,
    scale: float = 1.0,
    offset: float = 0.0,
    held: Sequence[float] = TENSIONS,
    **changes: Any,
) -> Path:
    """Cells of which the true tension is ``scale`` times the reading plus ``offset`` [N]."""
    rng = np.random.default_rng(0)

    def read(pull: float, stamp_ns: int) -> Sample:
        row = one_tendon((pull - offset) / scale) + 2e-3 * rng.standard_normal(4)
        return tension_sample(row, stamp_ns)

    return marker_bag(path, held=held, read=read, **changes)


def assert_tip_errors(said: dict[str, Any], near: float = 0.03) -> None:
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS, abs=near)


def test_readings_below_zero_are_counted_by_reason_and_zero_within_a_deadband(tmp_path, cli):
    bag = cell_bag(tmp_path / 'raw')
    notes = cli.json('compare', bag, *GIVEN)['notes']
    counts = [int(note.split()[1]) for note in notes if 'left out, as tension of tendon_1' in note]
    # Seven of eight messages have one of three slack tendons below zero, by its name.
    assert len(counts) == 3
    assert sum(counts) == pytest.approx(7 / 8 * STEPS, rel=0.05)
    (report,) = cli.json('replay', bag, tmp_path / 'out', '--json')['topics'].values()
    assert sorted(report['reasons'].values()) == sorted(counts)
    quiet = cell_bag(tmp_path / 'quiet', tension_deadband=0.012)
    said = cli.json('compare', quiet, *GIVEN)
    assert not any('left out' in note for note in said['notes'])
    assert_tip_errors(said, 0.05)
    (report,) = cli.json('replay', quiet, tmp_path / 'all', '--json')['topics'].values()
    assert (report['answered'], report['refused']) == (STEPS, 0)


def test_the_fitted_file_reproduces_the_fit(tmp_path, cli):
    bag = cell_bag(tmp_path / 'bag', 1.2, 0.15, FEW, tension_deadband=0.012)
    fitted = tmp_path / 'fitted.yaml'
    fits = ['--model', 'exact', '--fit', 'tension_scale', 'tension_offset']
    said = cli.json('identify', bag, *GIVEN, *fits, '--out', fitted)
    scale, offset = (said['estimates'][name] for name in ('tension_scale', 'tension_offset'))
    assert scale['interval95'][0] < 1.2 < scale['interval95'][1]
    assert offset['interval95'][0] < 0.15 < offset['interval95'][1]
    before, after = (said['residuals'][name]['tip_error_percent'] for name in ('before', 'after'))
    assert after < 0.1 * before
    again = cli.json('compare', bag, *GIVEN, '--config', fitted)
    average = again['models']['exact']['average_tip_error_percent']
    assert average == pytest.approx(after, rel=5e-3)
    report = cli.json('replay', bag, tmp_path / 'out', '--config', fitted, '--json')['topics']
    assert report['/tendon_tensions']['answered'] == len(staircase_of(FEW)[0])


@pytest.mark.parametrize('way', WAYS)
def test_four_points_have_the_errors_of_points(way, tmp_path, cli):
    see, options = WAYS[way]
    bag = marker_bag(tmp_path / 'bag', see)
    said = cli.json('compare', bag, *S, *options, *STILL)
    assert [step['tension'] for step in said['steps']] == pytest.approx(TENSIONS, abs=2e-3)
    assert_tip_errors(said)
    for step in said['steps']:
        assert step['mean_error_percent'] < step['tip_error_percent'] + 0.05
        assert step['hausdorff_percent'] is None
    if way != next(iter(WAYS)):
        return
    fitted = cli.json('identify', bag, *S, *options, *STILL, '--model', 'exact')
    # The error of the model at the highest tensions, of which a marker at the tip sees all.
    assert fitted['estimates']['youngs_modulus']['value'] == pytest.approx(1.1e5, rel=0.03)


def test_hidden_markers_are_left_out_and_their_frames_are_not(tmp_path, cli):
    def hide(points, number):
        points = points.copy()
        points[1 + number % 3] = np.nan
        if number < 12:
            points[3] = np.nan  # in all of the first step
        if number == 41:
            points[2] += 0.1  # which leaves the others of its frame
        return points

    bag = marker_bag(tmp_path / 'bag', pose_array, change=hide)
    said = cli.json('compare', bag, *S, *STILL)
    whole = cli.json('compare', marker_bag(tmp_path / 'whole'), *S, *STILL)
    assert said['steps'][0]['tip_error_percent'] is None
    assert said['steps'][0]['mean_error_percent'] < 0.1
    assert sum(step['outliers'] for step in said['steps']) == 1
    average = np.mean(TIP_ERRORS[1:])
    assert said['models']['exact']['average_tip_error_percent'] == pytest.approx(average, abs=0.03)
    for one, other in zip(said['steps'][1:], whole['steps'][1:]):
        assert one['frames'] == other['frames']
        assert one['tip_error_percent'] == pytest.approx(other['tip_error_percent'], rel=1e-6)
    assert any('the marker at 0.27 m is not seen in 36 of 84' in note for note in said['notes'])


def test_millimetres_are_asked_about_and_not_guessed(tmp_path, cli):
    bag = marker_bag(tmp_path / 'bag', change=lambda points, number: 1e3 * points)
    assert 'are they in mm? then say --length-unit mm' in cli.refused('compare', bag, *S, *STILL)
    said = cli.json('compare', bag, *S, *STILL, '--length-unit', 'mm')
    average = np.mean(TIP_ERRORS)
    assert said['models']['exact']['average_tip_error_percent'] == pytest.approx(average, abs=0.03)
    # The other way round, a bag in metres that is said to be in millimetres.
    metres = 'compare', marker_bag(tmp_path / 'metres'), *S, '--length-unit', 'mm'
    assert 'are they in m? then say --length-unit m' in cli.refused(*metres)
    # Midlines likewise.
    assert 'are they in mm? then say --length-unit mm' in cli.refused('compare', bag, *STILL)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (['--marker-s', '0', '0.1', '0.1', '0.2'], '--marker-s has 0.1 after 0.1, expected incr'),
        (
            ['--marker-s', '0', '90', '180', '270'],
            '--marker-s has 90, expected arc coordinates from 0 to 0.27 m: in metres?',
        ),
        (['--marker-s', '0', '0.27'], 'it has 4 point(s), expected 2, one for each of --marker-s'),
        (['--marker-s', 'nan'], '--marker-s has nan'),
        (['--marker-s', *map(str, np.linspace(0.0, 0.27, 1001))], 'at most 1000'),
        ([*S, '--midlines', '/mocap/markers', '/tf'], '--midlines names 2, --marker-s has 4'),
        ([*S, '--marker-frames', 'm0'], '--marker-frames names 1, --marker-s has 4'),
    ],
)
def test_markers_that_cannot_be_are_refused_in_one_line(options, message, tmp_path, cli):
    bag = marker_bag(tmp_path / 'bag', held=TENSIONS[:2])
    assert message in cli.refused('compare', bag, *options)


# CSV files ---------------------------------------------------------------------------------------


UNALIGNED = ['--clock-offset', '0', '--json', '--align', 'none']
EXACT = ['--config', 'renda2012_prototype', '--model', 'exact']
FINE = np.linspace(0.0, 0.27, 41)
EPOCH = 1_700_000_000.0


def loads_csv(
    path: Path,
    header: str = 'time [s],tendon_1_1 [N],tendon_1_2 [N],tendon_1_3 [N],tendon_1_4',
    row: str = '{:.4f},{:.4f},0,0,0',
) -> Path:
    time, pulled, _ = staircase_of()
    rows = [row.format(EPOCH + at, pull) for at, pull in zip(time, pulled)]
    path.write_text('\n'.join([header, *rows]) + '\n')
    return path


def frames() -> list[tuple[float, float]]:
    time, pulled, times = staircase_of()
    return list(zip(times.tolist(), np.interp(times, time, pulled).tolist()))


def tidy_csv(path: Path) -> Path:
    """A row for each point, in millimetres."""
    lines = ['time [s],point,x [mm],y [mm],z [mm]']
    for at, tension in frames():
        for number, point in enumerate(1e3 * seen(tension, FINE)):
            lines.append(f'{EPOCH + at:.4f},{number},' + ','.join(f'{v:.4f}' for v in point))
    path.write_text('\n'.join(lines) + '\n')
    return path


def wide_csv(path: Path) -> Path:
    """A row for each frame, of four markers, one of which is hidden in every other frame.

    They are seen without depth; semicolons, German times.
    """
    lines = ['Zeit (ms);x1 (mm);y1 (mm);x2 (mm);y2 (mm);x3 (mm);y3 (mm);x4 (mm);y4 (mm)']
    for number, (at, tension) in enumerate(frames()):
        cells = [f'{1e3 * v:.4f}' for v in seen(tension, MARKER_S)[:, :2].ravel()]
        if number % 2:
            cells[2:4] = ['', '']
        lines.append(f'{1e3 * (EPOCH + at):.1f};' + ';'.join(cells))
    path.write_text('\n'.join(lines) + '\n')
    return path


@pytest.mark.parametrize('is_yaml', [False, True])
def test_other_names_and_units_are_told_on_the_command_line_or_in_yaml(is_yaml, tmp_path, cli):
    header = 'Zeit\tLC 1 [mN]\tnote'
    loads = loads_csv(tmp_path / 'loads.csv', header, '{:.4f}\t{:.4f}e3\tfine')
    columns = {'time': 'Zeit', 'tendon_1_1': 'LC 1'}
    columns |= dict.fromkeys((f'tendon_1_{number}' for number in (2, 3, 4)), '0')
    columns |= dict.fromkeys((f'z{number}' for number in (1, 2, 3, 4)), '0')
    told = [f'{name}={column}' for name, column in columns.items()]
    if is_yaml:
        told = [tmp_path / 'columns.yaml']
        told[0].write_text(''.join(f'{name}: {column}\n' for name, column in columns.items()))
    track = wide_csv(tmp_path / 'track.csv')
    files = ['--tension-csv', loads, '--midline-csv', track, '--columns', *told]
    said = cli.json('compare', *files, *S, *EXACT, *UNALIGNED)
    assert_tip_errors(said)
    assert any('the marker at 0.09 m is not seen in 42 of 84' in note for note in said['notes'])


def test_a_file_of_loads_goes_with_a_bag_of_markers(tmp_path, cli):
    loads = loads_csv(tmp_path / 'loads.csv')
    bag = marker_bag(tmp_path / 'bag')
    said = cli.json('compare', bag, '--tension-csv', loads, *S, *UNALIGNED)
    assert_tip_errors(said)


LOADS = 'time,tendon_1_1,tendon_1_2,tendon_1_3,tendon_1_4\n0,1,0,0,0\n'
TRACK = 'time,x,y,z\n0,0,0,0\n'


@pytest.mark.parametrize(
    ('loads', 'track', 'message'),
    [
        (LOADS + '1,one,0,0,0\n', TRACK, "loads.csv, line 3: tendon_1_1 is 'one', expected a fin"),
        (LOADS + '1,1_0,0,0,0\n', TRACK, "line 3: tendon_1_1 is '1_0', expected a finite number"),
        (LOADS + '1,0,0,0\n', TRACK, 'loads.csv, line 3: 4 values, expected 5 as in the header'),
        ('time,a\n0,1\n', TRACK, 'no column tendon_1_1; it has time, a; say --columns tendon'),
        ('time [h]' + LOADS[4:], TRACK, "time is in 'h', expected s or ms or us or ns"),
        ('time,time\n0,1\n', TRACK, "2 columns 'time'; say which by its number, as #1"),
        ('time,a\n', TRACK, 'no row of numbers, expected some below a header'),
        ('time;a\n0,5;1,0\n', TRACK, 'no row of numbers with a decimal point, expected'),
        (LOADS + ',0,0,0,0\n', TRACK, 'line 3: time is nan s, expected a time below'),
        (LOADS + '3e9,0,0,0,0\n', TRACK, 'line 3: time is 3000000000.0 s, expected a time below'),
        (LOADS, 'time,x,y\n0,0,0\n', 'track.csv: no column z; it has time, x, y; of a picture'),
        (LOADS, 'time,x1,y1\n0,0,0\n', 'track.csv: no column z1;'),
        (LOADS, TRACK + '0,0,0,1\n1,0,0,0\n2,0,0,0\n', '1 of 3 times have several rows, expec'),
        (LOADS, 'time,x,y,z [ft]\n0,0,0,0\n', "z is in 'ft', expected m or cm or mm"),
        (LOADS, '', 'track.csv: no row'),
        (b'\xff\xfe', TRACK, 'loads.csv'),
        ('0,1,0,0,0\n1,1,0,0,0\n', TRACK, 'no column time; it has #1, #2, #3, #4, #5; say --col'),
        (
            'Trial,1\n\ntime,tendon_1_1,b\n0,1,2\n',
            TRACK,
            'line 4: 3 values, expected 2 as in the header; expected lines of headers, or none',
        ),
        ('Trial,1\ntime,tendon_1_1\n0,1\n', TRACK, 'it has Trial time, 1 tendon_1_1'),
        ('Trial\n', TRACK, 'no row of numbers, expected some below a header'),
        (LOADS + 'End\n', TRACK, 'line 3: 1 values, expected 5 as in the header; expected lines'),
        (LOADS + '1,"1,5",0,0,0\n', TRACK, 'a finite number with a decimal point [N], or'),
        (LOADS + '1.2.24,0,0,0,0\n', TRACK, 'finite number [s] or a time such as 2024-05-02T10:1'),
        (LOADS + '17e17,0,0,0,0\n', TRACK, 'in ns? then say --columns "time=time [ns]"'),
        (LOADS.replace('time', 'time_us') + '17e17,0,0,0,0\n', TRACK, 'below 2147483648 s\n'),
        ('time,tendon_1_1_mA\n0,1\n', TRACK, "tendon_1_1 is in 'mA', expected N or mN or kN"),
    ],
)
def test_files_that_are_wrong_are_refused_by_line(loads, track, message, tmp_path, cli):
    data = loads if isinstance(loads, bytes) else loads.encode()
    (tmp_path / 'loads.csv').write_bytes(data)
    (tmp_path / 'track.csv').write_text(track)
    files = '--tension-csv', tmp_path / 'loads.csv', '--midline-csv', tmp_path / 'track.csv'
    assert message in cli.refused('compare', *files, *EXACT)


TENDONS = ('tendon_1_1', 'tendon_1_2', 'tendon_1_3', 'tendon_1_4')


@pytest.mark.parametrize(
    ('head', 'row', 'columns'),
    [
        ('time,{0},{1},{2},{3}\n', '{0}.5,{1},0,0,0,,', {}),
        ('# time {0} {1} {2} {3}\n', ' {0}.5000000e+00   {1}   0   0   0 ', {}),
        ('time_ms,{0}_mN,{1},{2},{3}\n', '{0}500,{1}000,0,0,0', {}),
        ('time [\u00b5s];{0};{1};{2};{3}\n', '{0}500000;{1};0;0;0', {}),
        ('%time,{0},{1},{2},{3}\n', '{0}500000000,{1},0,0,0', {'time': '%time [ns]'}),
        (
            '',
            '{0}500,{1}',
            {'time': '#1 [ms]', 'tendon_1_1': '#2'} | dict.fromkeys(TENDONS[1:], '0'),
        ),
        ('time,{0},{1},{2},{3}\n', '1970/01/01 00:00:0{0}.5,{1},0,0,0', {}),
        (
            '# 0,1,2,3,4\n',
            '{0},{1},0,0,0',
            {'time': '#1'} | dict(zip(TENDONS, '#2 #3 #4 #5'.split())),
        ),
        (
            'time,{0},{0},{1},{2},{3}\ns,g,N,N,N,N\n',
            '{0},7,{1},0,0,0',
            {TENDONS[0]: TENDONS[0] + ' [N]'},
        ),
    ],
)
def test_tables_are_read_as_programs_write_them(head, row, columns, tmp_path):
    loads, track = tmp_path / 'loads.csv', tmp_path / 'track.csv'
    rows = [row.format(second, second + 1) for second in range(3)]
    loads.write_text(head.format(*TENDONS) + '\n'.join(rows) + '\n', encoding='utf-8')
    track.write_text('time,x_mm,y_mm,z_mm\n0,250,10,0\n1,250,10,1\n2,0,0,0\n')
    files = CsvSources(loads, track, columns={f'tension:{k}': v for k, v in columns.items()})
    # --length-unit may say again what a header says.
    millimetres = MarkerSources(unit='mm')
    found = read_recording(None, 'renda2012_prototype', measured=millimetres, files=files)
    assert_allclose(found.tension_time, [0.0, 1.0, 2.0], atol=1e-9)
    assert_allclose(found.tensions, [[1, 0, 0, 0], [2, 0, 0, 0], [3, 0, 0, 0]])
    assert_allclose(found.frames[0], [[0.25, 0.01, 0.0]])
    assert '1 of 3 frames on' in found.notes[0] and 'at exactly 0, 0, 0' in found.notes[0]


@pytest.mark.parametrize('unit', ['ns', 's'])
def test_the_stamps_of_a_table_are_those_of_a_clock_to_the_nanosecond(unit, tmp_path, cli):
    table, out = tmp_path / 'table.csv', tmp_path / 'shapes'
    stamps = [1_700_000_000_123_456_789, 1_700_000_000_123_456_790, 1_700_000_001_000_000_001]
    time = [f'{one // 10**9}{"." * (unit == "s")}{one % 10**9:09d}' for one in stamps]
    rows = ''.join(f'{at},1,0,0,0\n' for at in time)
    table.write_text(f'time [{unit}],{",".join(TENDONS)}\n{rows}')
    assert cli('replay', table, out, *ARM[:2])[0] == 0
    with BagReader(out) as reader:
        assert [one.received_ns for one in reader.messages(['/backbone/path'])] == stamps


def test_a_unit_in_the_name_of_a_column_is_that_of_this_column_alone(tmp_path):
    loads, track = tmp_path / 'loads.csv', tmp_path / 'track.csv'
    loads.write_text('time,tendon_1_1\n0,1\n1,2\n')
    track.write_text('time_ms,x,y,z\n500,0.25,0,0\n1000,0.25,0,0\n')
    columns = {'time': 'time_ms'} | dict.fromkeys(TENDONS[1:], '0')
    files = CsvSources(loads, track, columns=columns)
    found = read_recording(None, 'renda2012_prototype', files=files)
    assert_allclose(found.tension_time, [0.0, 1.0])
    assert_allclose(found.tensions[:, 0], [1.0, 2.0])
    assert_allclose(found.frame_time, [0.5, 1.0])


def test_a_table_is_told_how_it_is_given(tmp_path, cli):
    table = tmp_path / 'table.csv'
    table.write_text('time,F1,x,y,z\n0,1,0,0,0.1\n')
    assert 'table, expected a bag, or --mid' in cli.refused('compare', str(table), *EXACT)
    told = 'no column tendon_1_1 or displacement_tendon_1_1, nor those of another tendon; it has '
    assert f'{told}time, F1, x, y, z; say --co' in cli.refused('estimate', str(table), *EXACT[:2])


def test_what_is_read_has_bounds(tmp_path, cli, monkeypatch):
    from octo_arm_model.experiment import csv_table

    loads = tmp_path / 'loads.csv'
    files = '--tension-csv', loads, '--midline-csv', loads, *EXACT
    loads.write_text(','.join(f'a{n}' for n in range(limits.MAX_CSV_COLUMNS + 1)) + '\n')
    assert '4001 columns, expected at most 4000' in cli.refused('compare', *files)
    monkeypatch.setattr(csv_table, 'MAX_CSV_ROWS', 1)
    loads.write_text(LOADS + '1,1,0,0,0\n')
    assert 'loads.csv, line 3: more than 1 rows' in cli.refused('compare', *files)
    monkeypatch.setattr(csv_table, 'MAX_CSV_BYTES', 10)
    assert 'larger than 10 bytes' in cli.refused('compare', *files)


def test_a_constant_has_the_unit_of_the_points(tmp_path):
    table = tmp_path / 'poses.csv'
    table.write_text(LOADS.replace('\n', ',x,y\n', 1).rstrip('\n') + ',150,20\n')
    files = CsvSources(table, table, None, {'z': '5'}, is_poses=True)
    (tip,) = read_recording(None, EXACT[1], None, MarkerSources(unit='mm'), files).frames
    assert_allclose(tip, [[0.15, 0.02, 0.005]])


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        ([], 'expected a bag, or --midline-csv and --tension-csv or --displacement-csv'),
        (['--tension-csv', 'a', '--midline-csv', 'b'], 'has to be given by --config'),
        (['bag', '--tension-csv', 'a', '--midline-csv', 'b'], 'a bag, bag, and --tension-csv a'),
        (['bag', '--pose-csv', 'a'], 'a bag, bag, and --pose-csv are given'),
        (['bag', '--tension-csv', 'a', '--tensions', 't'], '--tensions and --tension-csv are'),
        (['bag', '--midline-csv', 'a', '--midlines', 't'], '--midlines and --midline-csv are'),
        (
            ['bag', '--midline-csv', 'a', '--marker-frames', 'm', '--marker-s', '0'],
            '--marker-frames and --midline-csv are given, expected one or the other',
        ),
        (['bag', '--columns', 'time'], "--columns has 'time', expected name=COLUMN or a YAML"),
        (['bag', '--columns', 'no.yaml'], 'no.yaml'),
        (['bag', '--columns', 'time=t'], '--columns is given, and no CSV file'),
        (['bag', '--poses', '--steady', '0.1'], '--steady has no effect with --poses'),
        (['bag', '--poses', '--hold', '1.0'], '--hold has no effect with --poses'),
        (['bag', '--ramp', '--settle', '2'], '--settle has no effect with --ramp'),
        (['bag', '--ramp', '0.1', '--hold', '2'], '--hold has no effect with --ramp'),
        (['--pose-csv', 'a', '--clock-offset', '1'], '--clock-offset has no effect with --pose'),
        (['--pose-csv', 'a', '--tolerance', '1'], '--tolerance has no effect with --pose'),
    ],
)
def test_options_that_are_missing_or_have_no_effect_are_named(words, message, cli):
    assert message in cli.refused('compare', *words)


@pytest.mark.parametrize(
    ('told', 'message'),
    [
        (['tendon_1_5=F', 'X=a'], '--columns names tendon_1_5, X, which is not read here; expect'),
        (['x1=x'], 'no column y1; it has time, point, x, y, z; say --columns y1=COLUMN'),
        (['y2=x'], '--columns names y2, which is not read here; expected names of tendon_1_1, t'),
        (['displacement_tendon_1_1=0'], '--columns names displacement_tendon_1_1, which is not'),
        (['z=0', 'z=z'], "--columns names 'z' twice, expected once"),
        (['z='], "--columns has 'z=', expected name=COLUMN"),
    ],
)
def test_columns_that_are_not_read_are_refused(told, message, tmp_path, cli):
    files = '--tension-csv', loads_csv(tmp_path / 'loads.csv')
    files += '--midline-csv', tidy_csv(tmp_path / 'track.csv'), '--columns', *told
    assert message in cli.refused('compare', *files, *EXACT)


def test_a_name_given_may_be_that_of_one_of_two_files(tmp_path, cli):
    tendons = ','.join(f'tendon_1_{n}' for n in (1, 2, 3, 4))
    loads = loads_csv(tmp_path / 'loads.csv', f'Zeit,{tendons}')
    track = tidy_csv(tmp_path / 'track.csv')
    given = '--tension-csv', loads, '--midline-csv', track, *EXACT, *UNALIGNED
    assert_tip_errors(cli.json('compare', *given, '--columns', 'time=Zeit'))
    loads.write_text(loads.read_text().replace('Zeit', 'time', 1))
    line = cli.refused('compare', *given, '--columns', 'time=Zeit')
    assert "loads.csv: no column 'Zeit' for time; it has time, " in line
    line = cli.refused('compare', *given, '--length-unit', 'cm')
    assert '--length-unit has no effect on' in line
