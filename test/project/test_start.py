"""Start of programs: interrupted while they are imported, and where ROS or an extra is missing."""

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import pytest
from checkout import ROOT

import octo_arm_start
from octo_arm_model.config.parameter_files import preset_path

PROGRAMS = [name for name, value in vars(octo_arm_start).items() if isinstance(value, partial)]
PARAMETERS = str(preset_path('renda2012_prototype'))
OF_ROS = {
    'estimator': ['--ros-args', '--params-file', PARAMETERS],
    'lifecycle_estimator': ['--ros-args', '--params-file', PARAMETERS],
    'node': ['--ros-args', '--params-file', PARAMETERS],
    'lifecycle_node': ['--ros-args', '--params-file', PARAMETERS],
    'simulator': ['--ros-args', '--params-file', PARAMETERS],
    'viewer': [],
    'demo': ['renda2012_prototype', '--no-viewer'],
    'octopus': ['renda2012_prototype', '--no-viewer'],
}
# Ctrl-C comes at the import of NumPy.
INTERRUPT = """
import os, signal, sys
class Interrupt:
    def find_spec(name, path=None, target=None):
        if name == 'numpy':
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt)
signal.signal(signal.SIGINT, signal.default_int_handler)  # as in a terminal
"""
# Modules of these names are as if they were not installed.
HIDE = """
import re, sys
class Hidden:
    def find_spec(name, path=None, target=None):
        if re.fullmatch('{}', name):
            raise ModuleNotFoundError('No module named ' + name, name=name)
sys.meta_path.insert(0, Hidden)
"""
WITHOUT_ROS = HIDE.format(r'rclpy|rosidl_\\w+|ament_\\w+|\\w+_(msgs|interfaces|srvs)')


def run(
    program: str, *arguments: str, before: str = '', **environment: str | None
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end."""
    code = f'{before}\nimport sys, octo_arm_start; sys.exit(octo_arm_start.{program}())'
    variables = {**os.environ, **environment}
    return subprocess.run(
        [sys.executable, '-c', code, *arguments],
        env={name: value for name, value in variables.items() if value is not None},
        capture_output=True,
        text=True,
        timeout=600,
    )


# Imports modules, which takes most of the time of a program, and then runs programs in forks.
FORKS = """
import json, os, signal, sys, tempfile
import octo_arm_start, {modules}
for line in sys.stdin:
    case = json.loads(line)
    with tempfile.TemporaryFile('w+') as out, tempfile.TemporaryFile('w+') as err:
        if not (child := os.fork()):
            signal.alarm(600)
            os.dup2(out.fileno(), 1), os.dup2(err.fileno(), 2)
            for name, value in case['environment'].items():
                os.environ.pop(name, None) if value is None else os.environ.update({{name: value}})
            exec(case['before'])
            sys.argv[1:] = case['arguments']
            sys.exit(getattr(octo_arm_start, case['program'])())
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        out.seek(0), err.seek(0)
        print(json.dumps([status, out.read(), err.read()]), flush=True)
"""
Run = Callable[..., subprocess.CompletedProcess[str]]


@contextmanager
def forking(modules: str, before: str = '') -> Iterator[Run]:
    """As `run`, in a fork of one process that has imported ``modules`` after ``before``."""
    code = before + FORKS.format(modules=modules)
    with subprocess.Popen(
        [sys.executable, '-c', code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin and process.stdout
        given, answers = process.stdin, process.stdout

        def run(
            program: str, *arguments: str, before: str = '', **environment: str | None
        ) -> subprocess.CompletedProcess[str]:
            case = {
                'program': program,
                'arguments': arguments,
                'before': before,
                'environment': environment,
            }
            given.write(json.dumps(case) + '\n')
            given.flush()
            return subprocess.CompletedProcess(arguments, *json.loads(answers.readline()))

        yield run
        given.close()


@pytest.fixture(scope='module')
def run_without_ros():
    """As `run`, where ROS is not installed."""
    with forking('octo_arm_model', WITHOUT_ROS) as run:
        yield run


@pytest.fixture(scope='module')
def run_quickly():
    """As `run`, with what the command always needs imported before ``before``."""
    with forking('octo_arm_model.cli.main') as run:
        yield run


def started(program: str, *arguments: str, **options: str | None) -> tuple[int, str]:
    """Run a program to its end; returns status and stderr."""
    done = run(program, *arguments, **options)
    return done.returncode, done.stderr


def test_every_program_is_started_here():
    scripts = re.findall(r"'octo.* = (\w+):(\w+)'", (ROOT / 'setup.py').read_text())
    assert sorted(scripts) == [('octo_arm_start', name) for name in sorted(PROGRAMS)]


@pytest.mark.parametrize('program', PROGRAMS)
def test_help_needs_no_ros(run_without_ros, program):
    done = run_without_ros(program, '--help')
    assert (done.returncode, done.stderr) == (0, '')
    assert done.stdout.startswith('usage: ')
    assert 'example' in done.stdout


@pytest.mark.parametrize('program', OF_ROS)
def test_without_ros_that_is_one_line(run_without_ros, program):
    done = run_without_ros(program, *OF_ROS[program])
    assert done.returncode == 2
    assert re.fullmatch(
        r'.*: error: needs ROS 2 and the package octo_arm_msgs \(\w+ is missing\): '
        r'source them, or put tools/with_ros of the checkout in front\n',
        done.stderr,
    )


@pytest.mark.parametrize(
    ('command', 'module', 'extras'),
    [
        (['compare', 'bag'], 'rosbags', 'bags,figures'),
        (['compare', 'bag', '--out', 'new'], 'matplotlib', 'bags,figures'),
        (['identify', 'bag'], 'rosbags', 'bags,figures'),
        (['estimate', 'bag'], 'rosbags', 'bags,figures'),
        (['replay', 'bag', 'new'], 'rosbags', 'bags'),
        (['record-demo', 'new'], 'rosbags', 'bags'),
        (['workspace', 'renda2012_table4', '--out', 'new.png'], 'matplotlib', 'figures'),
        (['reproduce', 'new'], 'matplotlib', 'figures'),
    ],
)
def test_without_an_extra_all_that_the_command_may_need_are_named(
    run_quickly, command, module, extras
):
    done = run_quickly('command_line', *command, before=HIDE.format(rf'{module}\\b.*'))
    hint = f"install it with: pip install 'octo_arm_model[{extras}]'"
    assert (done.returncode, done.stderr) == (2, f'octo-arm: error: needs {module}; {hint}\n')


def test_without_viser_the_viewer_says_what_to_install():
    pytest.importorskip('rclpy', reason='needs ROS 2')
    pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
    status, complaint = started('viewer', before=HIDE.format('viser'))
    hint = "install it with: pip install 'octo_arm_model[viewer]'"
    assert status == 2
    assert complaint.endswith(f': error: needs viser; {hint}\n')


@pytest.mark.parametrize('program', PROGRAMS)
def test_ctrl_c_ends_a_program_quietly_while_it_is_imported(program):
    status, complaint = started(program, before=INTERRUPT)
    assert complaint == ''
    assert status == (130 if program == 'command_line' else 0)


def test_without_memory_that_is_said():
    before = (
        'import octo_arm_model.cli.solve as report\n'
        'def summary(*given): raise MemoryError\n'
        'report.summary = summary'
    )
    arguments = ['solve', 'renda2012_prototype', '--tensions', '[[1, 0, 0, 0]]']
    status, complaint = started('command_line', *arguments, before=before)
    assert (status, complaint) == (2, 'octo-arm: error: out of memory\n')


def test_without_standard_error_a_command_works_and_its_notes_stay_out_of_its_output():
    code = 'import sys, octo_arm_start; sys.exit(octo_arm_start.command_line())'
    table = 'workspace renda2012_prototype --model closed_form --samples 4 --json'.split()
    command = f'exec {shlex.join([sys.executable, "-c", code, *table])} 2>&-'
    done = subprocess.run(['sh', '-c', command], stdout=subprocess.PIPE, text=True, timeout=600)
    assert done.returncode == 0
    assert json.loads(done.stdout)['samples'] == 4
