"""Parameter files: reading, writing, and errors of invalid ones."""

import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from octo_arm_model import (
    Arm,
    Body,
    Config,
    ConfigError,
    Material,
    OctoArmError,
    Pose,
    Section,
    load_config,
)
from octo_arm_model.arm.errors import ContinuationError
from octo_arm_model.config.parameter_files import parameters_as_yaml, parse_parameters, preset_path
from octo_arm_model.config.parameters import PARAMETERS
from octo_arm_model.simulation.simulator import PARAMETERS as SIMULATOR_PARAMETERS

GOOD = preset_path('renda2012_table4').read_text(encoding='utf-8')
MINIMAL = {
    'material': {'youngs_modulus': 1.1e5},
    'body': {'length': 0.4, 'radius_base': 0.02, 'radius_tip': 0.01},
    'sections': {'anchorage': [0.4], 'offset_base': [0.008], 'offset_anchorage': [0.002]},
}
DOTTED = {f'{group}.{k}': v for group, entries in MINIMAL.items() for k, v in entries.items()}


NAN, INF = float('nan'), float('inf')


def read(folder: Path, text: str) -> Config:
    path = folder / 'arm.yaml'
    path.write_text(text, encoding='utf-8')
    return load_config(path)


def changed(old: str, new: str) -> str:
    assert GOOD.count(old) == 1, old
    return GOOD.replace(old, new)


def paper_arm(length: float, radii: tuple, *sections: tuple) -> Arm:
    """Return an arm from the paper's numbers in millimetres."""
    return Arm(
        Material(110e3, 0.5),
        Body(length / 1e3, radii[0] / 1e3, radii[1] / 1e3),
        tuple(Section(*(value / 1e3 for value in section)) for section in sections),
    )


# Valid files -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('name', 'arm'),
    [
        ('table2', paper_arm(310, (15, 6.5), (310, 7.5, 1), (217, 3.5, 3.5), (93, 6, 6))),
        ('table4', paper_arm(450, (15, 2), (450, 7.5, 1), (315, 3.5, 3.5), (135, 6, 6))),
        ('fem', paper_arm(300, (10, 1.5), (300, 0.66, 1))),
        ('prototype', paper_arm(270, (15, 7.4), (270, 5, 2.5))),
    ],
)
def test_presets_have_the_papers_numbers(name, arm):
    config = load_config(preset_path(f'renda2012_{name}'))
    assert config.arm == arm
    assert (config.model, config.stations, config.base_frame) == ('renda2012', 101, 'arm_base')
    # The axes of section 6 of the paper: t = (1, 0, 0), n = (0, -1, 0), b = (0, 0, -1).
    assert config.base == Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


def test_parameters_of_octo_arm_are_read_from_files_of_several_nodes(tmp_path):
    others = 'robot:\n  octo_arm:\n    ros__parameters: {stations: 7}\n'
    others += 'camera:\n  ros__parameters: {stations: 8, rate: 30}\n'
    assert read(tmp_path, GOOD + others).stations == 101
    own = '"/*":\n  ros__parameters: {stations: 9}\n'
    assert read(tmp_path, GOOD + others + own).stations == 9
    own += 'octo_arm:\n  ros__parameters: {stations: 10}\n'
    assert read(tmp_path, GOOD + others + own).stations == 10


def test_presets_are_found_by_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    named = load_config('renda2012_prototype')
    assert named == load_config(preset_path('renda2012_prototype'))
    # A file without suffix takes precedence over a preset of its name.
    softer = preset_path('renda2012_prototype').read_text().replace('110000.0', '90000')
    (tmp_path / 'renda2012_prototype').write_text(softer)
    assert load_config('renda2012_prototype').arm.material.youngs_modulus == 9e4
    for name in ('no_such_arm', 'x' * 300, '', 'a\0b'):
        with pytest.raises(ConfigError, match=r'no preset arm .* one of rao2021, renda2012_fem,'):
            load_config(name)


def test_written_tables_are_read_unchanged():
    numbers = [1e17, 1e-7, 0.1, -1e300, INF, -INF, 5e-324, -0.0, 1.0]
    values = {'tendons.table_offset': numbers, 'tendon_limits': (1e5,), 'stations': 7}
    text = parameters_as_yaml(values)
    assert parse_parameters(text, 'it') == {**values, 'tendon_limits': [1e5]}
    # YAML 1.1 reads numbers without a point as text.
    assert yaml.safe_load(text)['/**']['ros__parameters']['tendons.table_offset'] == numbers
    assert parse_parameters(parameters_as_yaml({'tendon_limits': [2.0]}), 'it') == {
        'tendon_limits': [2.0]
    }


@pytest.mark.parametrize(
    'document',
    [
        *(
            {node: {'ros__parameters': MINIMAL}}
            for node in ('/**', 'octo_arm_model', '/a/b_model')
        ),
        {'robot': {'left': {'arm': {'ros__parameters': MINIMAL}}}},
        {'/**': {'ros__parameters': DOTTED}},
    ],
    ids=str,
)
def test_node_names_wildcards_and_dotted_names_are_read(tmp_path, document):
    config = read(tmp_path, yaml.safe_dump(document))
    assert config.arm.length == 0.4
    assert config.arm.sections == (Section(0.4, 0.008, 0.002),)
    # Other parameters have their defaults.
    assert (config.model, config.stations, config.base) == ('renda2012', 101, Pose())
    assert config.arm.material.poisson_ratio == 0.5


@pytest.mark.parametrize('number', ['110000', '1.1e5', '11e+4', '.11E6', '1.1e+5'])
def test_notations_of_numbers_are_read(tmp_path, number):
    text = changed('youngs_modulus: 110000.0', f'youngs_modulus: {number}')
    modulus = read(tmp_path, text).arm.material.youngs_modulus
    assert modulus == 110000.0 and isinstance(modulus, float)
    for text in ('0x65', '0X65', '0145'):  # as ROS reads integers
        assert read(tmp_path, changed('stations: 101', f'stations: {text}')).stations == 101


def test_budget_of_iterations_and_of_time(tmp_path):
    text = changed('model: renda2012', 'model: exact') + '    loads.gravity: [0.0, 0.0, -9.81]\n'
    text += '    material.density: 1080.0\n'
    timed = read(tmp_path, text + '    solve_budget.seconds: 1.0e-9\n')
    # A first shape beside obstacles takes longer.
    floor = '    obstacles: {type: [plane], position: [0.0, 0.0, -0.03], stiffness: [1.0e6]}\n'
    seconds = [read(tmp_path, each).solve_budget.seconds for each in (text, text + floor)]
    assert seconds == [0.08, 1.0]
    rest = np.zeros((3, 4))
    assert timed.solver().solve(rest).residual < 1e-10
    counted = read(tmp_path, text + '    solve_budget.iterations: 1\n')
    for solver, budget in (
        (timed.solver(budget=timed.solve_budget), '1e-09 s'),
        (counted.solver(), '1 iterations'),
    ):
        with pytest.raises(ContinuationError, match=f'budget of {budget} at .* % of the') as error:
            solver.solve(rest)
        assert 0.0 <= error.value.part < 1.0


# Invalid files ---------------------------------------------------------------------------------


@pytest.mark.parametrize('name', [p.name for p in PARAMETERS if p.default is None])
def test_error_of_a_missing_parameter_has_type_and_meaning(tmp_path, name):
    line = next(row for row in GOOD.splitlines() if row.strip().startswith(name.split('.')[1]))
    # The last part of each of these names occurs once in the file.
    parameter = next(p for p in PARAMETERS if p.name == name)
    with pytest.raises(ConfigError) as refusal:
        read(tmp_path, changed(line + '\n', ''))
    expected = f'{name} is missing, expected {parameter.type_name}: {parameter.description}'
    assert str(refusal.value) == f'{tmp_path / "arm.yaml"}: {expected}'


# What is in the file of table 4, what instead, and what is said of it.
WRONG = """
stations: 101 => solve_budget.iterations: 0 => solve budget: iterations is 0, expected a number > 0
youngs_modulus: => young_modulus: => material.young_modulus is no parameter of the arm; did you \
mean material.youngs_modulus?
stations: 101 => zzz: 1 => zzz is no parameter of the arm; known are model,\x20
stations: 101 => stations: 101.5 => stations is 101.5, expected integer
stations: 101 => stations: true => stations is True, expected integer
stations: 101 => stations: many => stations is 'many', expected integer
model: renda2012 => model: 2012 => model is 2012, expected string
base_frame: arm_base => base_frame: '' => base_frame is '', expected the name of a fr
base_frame: arm_base => base_frame: /a => base_frame is '/a', expected no / at its
base_frame: arm_base => frame_prefix: /a => frame_prefix is '/a', expected no / at its
length: 0.45 => length: '0.45' => body.length is '0.45', expected double
length: 0.45 => length: [0.45] => body.length is [0.45], expected double
length: 0.45 => length: yes => body.length is True, expected double
length: 0.45 => length: => body.length has no value
length: 0.45 => length: {m: 1} => body.length.m is no parameter of the arm; did you me
[0.45, 0.315, 0.135] => 0.45 => sections.anchorage is 0.45, expected double[], as [0.45]
[0.45, 0.315, 0.135] => [0.45, here, 0.135] => sections.anchorage is [0.45, 'here', 0.135], \
expected a list of values of one type
stations: 101 => markers_rate: 1.0e-11 => markers_rate is 1e-11, expected 0, or at least 1e-06 [Hz]
"""


@pytest.mark.parametrize('line', WRONG.strip().split('\n'))
def test_errors_name_value_and_expectation(tmp_path, line):
    old, new, message = line.split(' => ')
    with pytest.raises(ConfigError) as refusal:
        read(tmp_path, changed(old, new))
    assert str(refusal.value).startswith(f'{tmp_path / "arm.yaml"}: {message}')
    assert isinstance(refusal.value, OctoArmError)


def _doubling(kind: str) -> str:
    """Return a YAML document of 40 lines whose aliases expand to 2^40 values."""
    lines = ['a0: &a0 {k: 1}']
    for i in range(1, 40):
        pair = f'{{b: *a{i - 1}, c: *a{i - 1}}}' if kind == 'maps' else f'[*a{i - 1}, *a{i - 1}]'
        lines.append(f'a{i}: &a{i} {pair}')
    return '\n'.join(lines)


def _length(text: str) -> str:
    return changed('length: 0.45', f'length: {text}')


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', ": no node name at the top, expected '/**:' and ros__parameters below it"),
        ('- 1\n- 2\n', ': no node name at the top'),
        ('just words', ': no node name at the top'),
        ('body:\n  length: 1.0\n', ': ros__parameters found below no node name, expected exactly'),
        ('/**:\n  ros__parameters:\n', ': ros__parameters is None, expected parameters'),
        (
            'a:\n  ros__parameters: {}\nb/c:\n  ros__parameters: {}\n',
            ": ros__parameters found below ['/a', '/b/c'], expected exactly one, best",
        ),
        # Wrong indentation.
        (GOOD + '  loads: {gravity: [0, 1, 2]}\n', ': /**/loads/gravity is [0, 1, 2] beside ros'),
        ('/**:\n  a: [1\n', ', line 3: not valid YAML, '),
        ('/**:\n\tros__parameters: 1\n', ", line 2: not valid YAML, found character '\\t'"),
        (GOOD + '---\n' + GOOD, 'not valid YAML, but found another document'),
        (_length('!!python/object:os.system x'), ', line 16: not valid Y'),
        (changed('    stations: 101', '    stations: 1\n    stations: 2'), "'stations' is given"),
        (_length('0.45\n      length: 0.5'), "'length' is given twice"),
        (_length('0x' + 'F' * 6000), 'is no integer'),
        (GOOD + GOOD, "not valid YAML, '/**' is given twice"),
        (changed('    body:', '    body.length: 0.9\n    body:'), 'body.length is given twice'),
        *(
            (_length(text), '')
            for text in (
                '2001-99-99',
                '!!int x',
                '!!bool x',
                '!!timestamp x',
                '[' * 3000,
                '9' * 400,
                '&a [*a]',
                '"\0"',
            )
        ),
        # Keys are strings.
        ('1: {a: 2}\n1.0: {a: 3}\n', 'ros__parameters found below no node name'),
        ('1: {a: 2}\n1: {a: 3}\n', "line 2: not valid YAML, '1' is given twice"),
        ('true: {a: 2}\nyes: {a: 3}\n', 'ros__parameters found below no node name'),
        ('[a]: 1\n', 'line 1: not valid YAML, expected a name before the colon'),
        ('{a: 1}: 1\n', 'line 1: not valid YAML, expected a name before the colon'),
        (GOOD + '    1: 2\n    1.0: 3\n', '1 is no parameter of the arm'),
        # Aliases, nesting and sizes.
        (_doubling('maps'), 'line 15: not valid YAML, more than 100000 values, with aliases'),
        (_doubling('lists'), 'not valid YAML, more than 100000 values, with aliases written out'),
        ('{a: ' * 50_000, 'line 1: not valid YAML, nested more than 20 deep'),
        ('[' * 1_000_000, 'line 1: not valid YAML, nested more than 20 deep'),
        ('a: &a {b: *a}', 'line 1: not valid YAML, an alias within what it stands for'),
        ('# ' * 600_000, 'arm.yaml: larger than 1048576 bytes'),
        ('a: ' + '9' * 5000, 'is no integer'),
        # ROS reads these as strings.
        *(
            (_length(text), f"is '{text}', expected double")
            for text in ('1:30', '1_000', '0b1', '2026-01-01', '190:20:30.15', '6_8.0')
        ),
        (_length('!!float 1:30'), 'is no number'),
        *(
            (changed('base_frame: arm_base', f'base_frame: {text}'), f'base_frame is {value}, exp')
            for text, value in (('y', True), ('N', False), ('on', True), ('True', True))
        ),
    ],
    ids=lambda text: text[-24:],
)
def test_invalid_files_are_refused_in_one_line(tmp_path, text, message):
    with pytest.raises(ConfigError) as refusal:
        read(tmp_path, text)
    said = str(refusal.value)
    assert said.startswith(str(tmp_path / 'arm.yaml')) and message in said and '\n' not in said


def test_unreadable_files_are_refused(tmp_path):
    (tmp_path / 'bytes').write_bytes(b'\xff\xfe\x00')
    (tmp_path / 'folder').mkdir()
    os.mkfifo(tmp_path / 'pipe')  # reading it would block
    for name, reason in {
        'nowhere.yaml': 'No such file or directory',
        'folder': 'Is a directory',
        'bytes': 'not a text file in UTF-8',
        'pipe': 'not a regular file',
    }.items():
        with pytest.raises(ConfigError, match=f'{name}: {reason}$'):
            load_config(tmp_path / name)


@pytest.mark.parametrize('text', ['1:30', '1_000', '2026-01-01', '=', '<<', '.'])
def test_strings_are_read_as_by_ros(tmp_path, text):
    config = read(tmp_path, changed('base_frame: arm_base', f'base_frame: {text}'))
    assert config.base_frame == text


ODD_NAMES = ('y', 'n', '1', '1.0', '1e5', '08', '0x1F', 'nan', 'inf', '1:30', 'null', '~', 'ø')


def test_files_of_launch_ros_are_read():
    parameters = {'base.position': (0.0, 0.1, 0.0), 'tension_names': ('a', '-'), 'stations': 11}
    text = yaml.dump({'/**': {'ros__parameters': parameters}}, default_flow_style=False)
    assert 'python/tuple' in text
    expected = {name: list(v) if name != 'stations' else v for name, v in parameters.items()}
    assert parse_parameters(text, 'it') == expected


def test_written_strings_are_read_unchanged():
    values = {'tendon_names': list(ODD_NAMES), 'base_frame': 'no', 'frame_prefix': '.inf'}
    text = parameters_as_yaml(values)
    assert parse_parameters(text, 'it') == values
    # As plain scalars ROS reads these as numbers.
    for word in ('nan', 'inf', 'y', '08', '1e5'):
        assert f"'{word}'" in text


@pytest.mark.parametrize('name', ['base_frame', 'frame_prefix', 'tendon_names', 'profile.name'])
@pytest.mark.parametrize('text', ['a\0b', 'a\ud800b', 'x' * 256])
def test_invalid_strings_are_refused(name, text):
    table = (*PARAMETERS, *SIMULATOR_PARAMETERS)
    parameter = next(p for p in table if p.name == name)
    value = ['a', text] if parameter.is_array else text
    with pytest.raises(ConfigError, match=f'{name} is .*, expected string.* of at most 255 char'):
        parameter.convert(value)


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'stations': 10_001}, 'stations is 10001, expected at most 10000'),
        ({'body.length': 1e9}, 'this arm takes more than 20000 intervals'),
        ({'body.radius_tip': 1e-29}, 'this arm takes more than 20000 intervals'),
        ({'sections.tendons': [10**12]}, 'number of tendons is 1000000000000, expected at most'),
        ({'sections.anchorage': [0.4] * 65}, 'sections.anchorage has 65 values, expected at'),
        (
            {'loads.point_s': [0.1] * 257, 'loads.point_force': [0.0] * 771},
            'loads.point_s has 257 values, expected at most 256',
        ),
        (
            {'loads.distributed_s': [0.1] * 1001, 'loads.distributed_force': [0.0] * 3003},
            'loads.distributed_s has 1001 values, expected at most 1000',
        ),
        (
            {'material.table_s': [0.0] * 1001, 'material.table_youngs_modulus': [1e5] * 1001},
            'material.table_s has 1001 values, expected at most 1000',
        ),
        ({'base.position': [0.0] * 10**6}, 'base.position has 1000000 values, expected at most'),
        ({'base.position': [0.0] * 999}, r'base.position is \(0.0, .*\.\.\., expected 3'),
        # Parameters that build nothing here.
        ({'body.table_radius': [0.01] * 1001}, 'body.table_radius has 1001 values, expected at m'),
        (
            {'material.table_youngs_modulus': [NAN]},
            r'table_youngs_modulus\[0\] is nan, expected a fi',
        ),
        (
            {'material.table_poisson_ratio': [INF]},
            r'table_poisson_ratio\[0\] is inf, expected a fin',
        ),
        ({'tendons.table_angle': [1e31]}, r'table_angle\[0\] is 1e.31, expected .* at most 1e.'),
        ({'tendons.table_offset': [0.0] * 20_001}, 'tendons.table_offset has 20001 values, expec'),
        (
            {
                'body.table_s': [0.0, 0.4],
                'body.table_radius': [0.02, 0.01],
                'body.radius_tip': NAN,
            },
            'body.radius_tip is nan, expected a finite number',
        ),
    ],
    ids=lambda value: str(value)[:30],
)
def test_sizes_are_bounded(changes, message):
    # Sizes are checked before anything of that size is allocated.
    values = {**DOTTED, 'sections.offset_anchorage': [0.0], **changes}
    with pytest.raises(OctoArmError, match=message) as refusal:
        Config.from_parameters(values).solver()
    assert len(str(refusal.value)) < 600


@pytest.mark.parametrize('model', ['closed_form', 'exact'])
def test_largest_numbers_of_tendons_and_stations_work_together(model):
    values = DOTTED | {'sections.tendons': [256], 'stations': 10_000, 'model': model}
    solver = Config.from_parameters(values).solver()
    shape = solver.solve(np.full(solver.arm.tension_shape, 1e-3))
    assert shape.tendon_tensions.shape == (10_000, 256)
