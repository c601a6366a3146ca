"""Start of programs with an interrupt, without ROS or an extra, and their terminal."""

import ast
import io
import json
import os
import queue
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import pytest
from checkout import ROOT

import octo_arm_start
from octo_arm_model.cli.files import Bar
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.terminal import StatusLine, missing, status_of

PROGRAMS = [name for name, value in vars(octo_arm_start).items() if isinstance(value, partial)]
OF_ROS = ['--ros-args', '--params-file', str(preset_path('renda2012_prototype'))]
ARGUMENTS = {
    **dict.fromkeys(PROGRAMS, OF_ROS),
    'viewer': [],
    'demo': ['renda2012_prototype', '--no-viewer'],
    'octopus': ['renda2012_prototype', '--no-viewer'],
}
# Sends Ctrl-C at the import of NumPy.
INTERRUPT = """
import os, signal, sys
class Interrupt:
    def find_spec(name, path=None, target=None):
        if name == 'numpy':
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt)
signal.signal(signal.SIGINT, signal.default_int_handler)  # as in a terminal
"""
# Hides modules as if they were not installed.
HIDE = """
import re, sys
class Hidden:
    def find_spec(name, path=None, target=None):
        if re.fullmatch('{}', name):
            raise ModuleNotFoundError('No module named ' + name, name=name)
sys.meta_path.insert(0, Hidden)
"""
WITHOUT_ROS = HIDE.format(r'rclpy|rosidl_\\w+|ament_\\w+|\\w+_(msgs|interfaces|srvs)')


# Runs programs one after the other in one process, because imports take most of the time.
ALL = """
import contextlib, io, json, octo_arm_start
for program, arguments in json.loads(sys.argv.pop()):
    sys.argv[1:], out, err = arguments, io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = getattr(octo_arm_start, program)()
        except SystemExit as end:
            status = end.code
    print(json.dumps([status, out.getvalue(), err.getvalue()]))
"""


def python(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python code to its end."""
    command = [sys.executable, '-c', code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


def run_all(cases: Sequence[tuple[str, list[str]]], before: str) -> list[tuple[int, str, str]]:
    """Run programs after the code ``before``; return status, output and errors of each."""
    done = python(before + ALL, json.dumps(cases))
    assert done.returncode == 0, done.stderr
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


def run_program(program: str, *arguments: str, before: str) -> tuple[int, str]:
    """Run a program after the code ``before``; return status and stderr."""
    code = f'{before}\nimport sys, octo_arm_start; sys.exit(octo_arm_start.{program}())'
    done = python(code, *arguments)
    return done.returncode, done.stderr


def test_setup_lists_all_programs():
    scripts = re.findall(r"'octo.* = (\w+):(\w+)'", (ROOT / 'setup.py').read_text())
    assert sorted(scripts) == [('octo_arm_start', name) for name in sorted(PROGRAMS)]


def test_help_needs_no_ros():
    for program, (status, out, err) in zip(
        PROGRAMS, run_all([(name, ['--help']) for name in PROGRAMS], WITHOUT_ROS), strict=True
    ):
        assert (status, err) == (0, ''), program
        assert out.startswith('usage: ') and 'example' in out, program


def test_missing_ros_is_one_line_of_error():
    cases = [(name, given) for name, given in ARGUMENTS.items() if name != 'command_line']
    for (program, _), (status, _, err) in zip(cases, run_all(cases, WITHOUT_ROS), strict=True):
        assert status == 2, program
        assert re.fullmatch(
            r'.*: error: needs ROS 2 and the package octo_arm_msgs \(\w+ is missing\): '
            r'source them, or put tools/with_ros of the checkout in front\n',
            err,
        ), program


@pytest.mark.parametrize(
    ('module', 'commands'),
    [
        (
            'rosbags',
            {
                'compare bag': 'bags,figures',
                'identify bag': 'bags,figures',
                'estimate bag': 'bags,figures',
                'replay bag new': 'bags',
                'record-demo new': 'bags',
            },
        ),
        (
            'matplotlib',
            {
                'compare bag --out new': 'bags,figures',
                'workspace renda2012_table4 --out new.png': 'figures',
                'reproduce new': 'figures',
            },
        ),
    ],
)
def test_missing_extra_is_named(module, commands):
    cases = [('command_line', command.split()) for command in commands]
    answers = run_all(cases, HIDE.format(rf'{module}\\b.*'))
    for extras, answer in zip(commands.values(), answers, strict=True):
        hint = f"install it with: pip install 'octo_arm_model[{extras}]'"
        assert answer == (2, '', f'octo-arm: error: needs {module}; {hint}\n')


@pytest.mark.parametrize('program', PROGRAMS)
def test_ctrl_c_during_imports_ends_a_program_quietly(program):
    status, complaint = run_program(program, before=INTERRUPT)
    assert complaint == ''
    assert status == (130 if program == 'command_line' else 0)


def test_out_of_memory_is_one_line_of_error():
    before = (
        'import octo_arm_model.cli.solve as report\n'
        'def summary(*given): raise MemoryError\n'
        'report.summary = summary'
    )
    arguments = ['solve', 'renda2012_prototype', '--tensions', '[[1, 0, 0, 0]]']
    status, complaint = run_program('command_line', *arguments, before=before)
    assert (status, complaint) == (2, 'octo-arm: error: out of memory\n')


def test_closed_stderr_does_not_change_the_output():
    code = 'import sys, octo_arm_start; sys.exit(octo_arm_start.command_line())'
    table = 'workspace renda2012_prototype --model closed_form --samples 4 --json'.split()
    command = f'exec {shlex.join([sys.executable, "-c", code, *table])} 2>&-'
    done = subprocess.run(['sh', '-c', command], stdout=subprocess.PIPE, text=True, timeout=600)
    assert done.returncode == 0
    assert json.loads(done.stdout)['samples'] == 4


# The terminal ------------------------------------------------------------------------------------


# Required packages of setup.py, and a module of Python 3.14.
BASE = {'numpy', 'scipy', 'yaml', 'octo_arm_model', 'compression'}


def imports(path: Path) -> set[str]:
    """Return the top-level names of the modules that a file imports."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or '')
    return {name.split('.')[0] for name in names}


def test_every_module_of_an_extra_has_its_hint():
    tree = ast.parse((ROOT / 'setup.py').read_text())
    (extras,) = [
        ast.literal_eval(word.value)
        for word in ast.walk(tree)
        if isinstance(word, ast.keyword) and word.arg == 'extras_require'
    ]
    package = ROOT / 'octo_arm_model'
    for path in package.rglob('*.py'):
        for module in imports(path) - BASE - sys.stdlib_module_names:
            hint = missing(ModuleNotFoundError(name=f'{module}.some'))
            if found := re.search(r"octo_arm_model\[(\w+)\]'$", hint):
                assert extras[found[1]]
            else:  # a module of ROS
                assert 'needs ROS 2' in hint
                folder = path.relative_to(package).parts[0]
                assert folder in ('apps', 'ros', 'viewer'), f'{module} in {path}'


def test_missing_module_of_the_package_is_raised():
    with pytest.raises(ModuleNotFoundError):
        missing(ModuleNotFoundError(name='octo_arm_model.nothing'))


def test_closed_pipe_ends_a_program_quietly(monkeypatch):
    reader, writer = os.pipe()
    os.close(reader)  # as `head` does
    with os.fdopen(writer, 'w') as stream:
        monkeypatch.setattr(sys, 'stdout', stream)

        def run_program():
            with StatusLine(sys.stdout) as line:
                line.show(lambda: 'a line', always=True)
            return 0

        assert status_of('program', run_program) == 141
        print('what Python has left to write at exit', flush=True)


class Terminal(io.StringIO):
    """A terminal whose texts are also in a queue."""

    def __init__(self):
        super().__init__()
        self.texts = queue.SimpleQueue()

    def isatty(self):
        return True

    def write(self, text):
        self.texts.put(text)
        return super().write(text)


def test_progress_bar_shows_at_once_and_updates_without_progress():
    elsewhere, terminal = io.StringIO(), Terminal()
    with Bar('messages', elsewhere):
        assert not elsewhere.getvalue()
    with Bar('messages', terminal) as bar:
        assert 'messages: 0 s' in terminal.texts.get()
        bar(0, 2)
        for _ in range(2):
            assert '] 0/2, ' in terminal.texts.get(timeout=60.0)
    assert terminal.getvalue().endswith('\n')
