"""CSV files of laboratories, without a bag: load cells and image tracking of finite elements."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from labs import MARKER_S, TIP_ERRORS, marker_bag, seen, staircase_of

from octo_arm_model.arm import limits

STILL = ['--clock-offset', '0', '--json', '--align', 'none']
ARM = ['--config', 'renda2012_prototype', '--model', 'exact']
S = ['--marker-s', *map(str, MARKER_S)]
FINE = np.linspace(0.0, 0.27, 41)
EPOCH = 1_700_000_000.0


def loads_csv(
    path: Path, header: str = 'time [s],tendon_1_1 [N],tendon_1_2 [N],tendon_1_3 [N],tendon_1_4',
    row: Callable[[float, float], str] = lambda at, pull: f'{EPOCH + at:.4f},{pull!r},0,0,0',
) -> Path:  # fmt: skip
    time, pulled, _ = staircase_of()
    rows = [row(at, pull) for at, pull in zip(time.tolist(), pulled.tolist())]
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


def wide_csv(path: Path, hidden: bool = False) -> Path:
    """A row for each frame, of four markers, seen without depth; semicolons, German times."""
    lines = ['Zeit (ms);x1 (mm);y1 (mm);x2 (mm);y2 (mm);x3 (mm);y3 (mm);x4 (mm);y4 (mm)']
    for number, (at, tension) in enumerate(frames()):
        cells = [f'{1e3 * v:.4f}' for v in seen(tension, MARKER_S)[:, :2].ravel()]
        if hidden and number % 2:
            cells[2:4] = ['', '']
        lines.append(f'{1e3 * (EPOCH + at):.1f};' + ';'.join(cells))
    path.write_text('\n'.join(lines) + '\n')
    return path


def assert_tip_errors(said: dict[str, Any]) -> None:
    errors = [step['tip_error_percent'] for step in said['steps']]
    assert errors == pytest.approx(TIP_ERRORS, abs=0.03)


def test_midlines_and_loads_without_a_bag_are_compared_and_fitted(tmp_path, cli):
    files = ['--tension-csv', str(loads_csv(tmp_path / 'loads.csv'))]
    files += ['--midline-csv', str(tidy_csv(tmp_path / 'track.csv'))]
    said = cli.json('compare', *files, *ARM, *STILL)
    assert_tip_errors(said)
    fitted = cli.json('identify', *files, *ARM, *STILL)
    # Least squares spread the error of the model over all steps.
    assert fitted['estimates']['youngs_modulus']['value'] == pytest.approx(1.1e5, rel=0.03)


@pytest.mark.parametrize('is_yaml', [False, True])
def test_other_names_and_units_are_told_on_the_command_line_or_in_yaml(is_yaml, tmp_path, cli):
    loads = loads_csv(
        tmp_path / 'loads.csv', 'Zeit\tLC 1 [mN]\tnote',
        lambda at, pull: f'{EPOCH + at:.4f}\t{1e3 * pull!r}\tfine',
    )  # fmt: skip
    columns = {'time': 'Zeit', 'tendon_1_1': 'LC 1', 'tendon_1_2': '0', 'tendon_1_3': '0',
               'tendon_1_4': '0', 'z1': '0', 'z2': '0', 'z3': '0', 'z4': '0'}  # fmt: skip
    told = [f'{name}={column}' for name, column in columns.items()]
    if is_yaml:
        told = [str(tmp_path / 'columns.yaml')]
        text = ''.join(f'{name}: {column}\n' for name, column in columns.items())
        (tmp_path / 'columns.yaml').write_text(text)
    track = wide_csv(tmp_path / 'track.csv', hidden=True)
    files = ['--tension-csv', str(loads), '--midline-csv', str(track), '--columns', *told]
    said = cli.json('compare', *files, *S, *ARM, *STILL)
    assert_tip_errors(said)
    assert any('the marker at 0.09 m is not seen in 42 of 84' in note for note in said['notes'])


def test_a_file_of_loads_goes_with_a_bag_of_markers(tmp_path, cli):
    loads = loads_csv(tmp_path / 'loads.csv')
    bag = str(marker_bag(tmp_path / 'bag'))
    said = cli.json('compare', bag, '--tension-csv', loads, *S, *STILL)
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
        ('time,a\n', TRACK, 'no rows, expected a header and rows below it'),
        (LOADS + ',0,0,0,0\n', TRACK, 'line 3: time is nan s, expected a time below'),
        (LOADS + '3e9,0,0,0,0\n', TRACK, 'line 3: time is 3000000000.0 s, expected a time below'),
        (LOADS, 'time,x,y\n0,0,0\n', 'track.csv: no column z; it has time, x, y; of a picture'),
        (LOADS, 'time,x1,y1\n0,0,0\n', 'track.csv: no column z1;'),
        (LOADS, 'time,x,y,z [ft]\n0,0,0,0\n', "z is in 'ft', expected m or cm or mm"),
        (LOADS, '', 'track.csv: no rows'),
        (b'\xff\xfe', TRACK, 'loads.csv'),
        ('0,1,0,0,0\n1,1,0,0,0\n', TRACK, 'no column time; it has #1, #2, #3, #4, #5; say --col'),
        ('Trial,1\n\ntime,tendon_1_1,b\n0,1,2\n', TRACK,
         'line 4: 3 values, expected 2 as in the header; expected lines of headers, or none'),
        ('Trial,1\ntime,tendon_1_1\n0,1\n', TRACK, 'it has Trial time, 1 tendon_1_1'),
        ('Trial\n', TRACK, 'no rows, expected a header and rows below it'),
    ],
)  # fmt: skip
def test_files_that_are_wrong_are_refused_by_line(
    loads, track, message, tmp_path,
    cli,
):  # fmt: skip
    data = loads if isinstance(loads, bytes) else loads.encode()
    (tmp_path / 'loads.csv').write_bytes(data)
    (tmp_path / 'track.csv').write_text(track)
    files = ['--tension-csv', str(tmp_path / 'loads.csv')]
    files += ['--midline-csv', str(tmp_path / 'track.csv')]
    assert message in cli.refused('compare', *files, *ARM)


def test_a_table_is_told_how_it_is_given(tmp_path, cli):
    table = tmp_path / 'table.csv'
    table.write_text('time,F1,x,y,z\n0,1,0,0,0.1\n')
    assert 'table, expected a bag, or --mid' in cli.refused('compare', str(table), *ARM)
    told = 'no column tendon_1_1 or displacement_tendon_1_1, nor those of another tendon; it has '
    assert f'{told}time, F1, x, y, z; say --co' in cli.refused('estimate', str(table), *ARM[:2])


def test_what_is_read_has_bounds(tmp_path, cli, monkeypatch):
    from octo_arm_model.experiment import csv_table

    loads = tmp_path / 'loads.csv'
    files = ['--tension-csv', str(loads), '--midline-csv', str(loads), *ARM]
    loads.write_text(','.join(f'a{n}' for n in range(limits.MAX_CSV_COLUMNS + 1)) + '\n')
    assert '4001 columns, expected at most 4000' in cli.refused('compare', *files)
    monkeypatch.setattr(csv_table, 'MAX_CSV_ROWS', 1)
    loads.write_text(LOADS + '1,1,0,0,0\n')
    assert 'loads.csv, line 3: more than 1 rows' in cli.refused('compare', *files)
    monkeypatch.setattr(csv_table, 'MAX_CSV_BYTES', 10)
    assert 'larger than 10 bytes' in cli.refused('compare', *files)


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        ([], 'expected a bag, or --midline-csv and --tension-csv or --displacement-csv'),
        (['--tension-csv', 'a', '--midline-csv', 'b'], 'has to be given by --config'),
        (['bag', '--tension-csv', 'a', '--midline-csv', 'b'], 'a bag, bag and --tension-csv and'),
        (['bag', '--tension-csv', 'a', '--tensions', 't'], '--tensions and --tension-csv are'),
        (['bag', '--midline-csv', 'a', '--midlines', 't'], '--midlines and --midline-csv are'),
        (['bag', '--midline-csv', 'a', '--marker-frames', 'm', '--marker-s', '0'],
         '--marker-frames and --midline-csv are given, expected one or the other'),
        (['bag', '--columns', 'time'], "--columns has 'time', expected name=COLUMN or a YAML"),
        (['bag', '--columns', 'no.yaml'], 'no.yaml'),
        (['bag', '--columns', 'time=t'], '--columns is given, and no CSV file'),
    ],
)  # fmt: skip
def test_what_is_not_said_is_asked_for(words, message, cli):
    assert message in cli.refused('compare', *words)


def test_markers_are_named_by_columns_and_one_of_two_files_has_another_name_for_time(
    tmp_path, cli
):
    """Also in a file that has columns x and x1 of other things."""
    track = wide_csv(tmp_path / 'track.csv')
    names = [f'{marker}-{axis}' for marker in 'ABCD' for axis in 'XY']
    head = ';'.join(['time (ms)', *(f'{name} (mm)' for name in names), 'x (mm)', 'x1 (mm)'])
    rows = track.read_text().splitlines()[1:]
    track.write_text('\n'.join([head, *(f'{row};9;9' for row in rows)]))
    tendons = ','.join(f'tendon_1_{n}' for n in (1, 2, 3, 4))
    loads = loads_csv(tmp_path / 'loads.csv', f'Zeit,{tendons}')
    files = ['--tension-csv', str(loads), '--midline-csv', str(track), *S, *ARM, *STILL]
    told = ['time=Zeit', *(f'x_{n}={m}-X' for n, m in enumerate('ABCD', 1))]
    told += [f'y_{n}={m}-Y' for n, m in enumerate('ABCD', 1)]
    told += [f'z_{n}=0' for n in (1, 2, 3, 4)]
    assert_tip_errors(cli.json('compare', *files, '--columns', *told))
    loads.write_text(loads.read_text().replace('Zeit', 'time', 1))
    assert "loads.csv: no column 'Zeit' for time; it has time, " in cli.refused(
        'compare', *files, '--columns', *told
    )


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
)  # fmt: skip
def test_columns_that_are_not_read_are_refused(told, message, tmp_path, cli):
    files = ['--tension-csv', str(loads_csv(tmp_path / 'loads.csv'))]
    files += ['--midline-csv', str(tidy_csv(tmp_path / 'track.csv')), '--columns', *told]
    assert message in cli.refused('compare', *files, *ARM)


def test_options_that_files_leave_without_effect_are_refused(tmp_path, cli):
    files = ['--tension-csv', str(loads_csv(tmp_path / 'loads.csv'))]
    files += ['--midline-csv', str(tidy_csv(tmp_path / 'track.csv')), *ARM]
    assert '--length-unit has no effect on' in cli.refused(
        'compare', *files, '--length-unit', 'cm'
    )
