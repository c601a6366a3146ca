"""Programs that start others: their output, and the end of all processes."""

import contextlib
import io
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import DEADLINE, new_domain

from octo_arm_model.apps import demo, octopus
from octo_arm_model.apps.demo import own_domain
from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.config.parameter_files import preset_path

NUMBERS = re.compile(r'tip +(\S+) +(\S+) +(\S+) mm .* (\S+) shapes/s')


def processes_with(mark):
    """Return the processes with OCTO_ARM_TEST = ``mark`` in their environment."""
    processes, variable = set(), f'OCTO_ARM_TEST={mark}'.encode()
    for path in Path('/proc').glob('[0-9]*/environ'):
        try:
            if variable in path.read_bytes().split(b'\0'):
                processes.add(int(path.parent.name))
        except OSError:
            pass  # has ended, or belongs to another user
    return processes


class Watched(io.StringIO):
    """Output of a program in this process, which calls ``act`` with each line."""

    def __init__(self, act):
        super().__init__()
        self._act, self._line = act, ''

    def write(self, text):
        """Split ``text`` into lines."""
        self._line += text
        while '\n' in self._line:
            line, _, self._line = self._line.partition('\n')
            self._act(line)
        return len(text)


@pytest.fixture
def run_here(monkeypatch, capfd):
    """Return a function that runs a program in this process, with its children.

    The program has a domain of its own. ``act`` is called with each printed line and the process
    ids of the children. The function returns the exit status and all stderr.
    """
    mark = str(uuid.uuid4())
    monkeypatch.setenv('ROS_DOMAIN_ID', str(new_domain()))
    monkeypatch.setenv('OCTO_ARM_TEST', mark)
    numbers = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    before = [signal.getsignal(number) for number in numbers]

    def run(program, arguments, act):
        watched = Watched(lambda line: act(line, processes_with(mark)))
        with contextlib.redirect_stdout(watched):
            status = program.main(arguments)
        assert processes_with(mark) == set()
        complaints = capfd.readouterr().err
        assert 'Traceback' not in complaints
        return status, complaints

    yield run
    for process in processes_with(mark):
        os.kill(process, signal.SIGKILL)
    for number, handler in zip(numbers, before):
        signal.signal(number, handler)


def stop_here():
    """End the program in this process as Ctrl-C does."""
    os.kill(os.getpid(), signal.SIGINT)


def test_demo_moves_the_arm_prints_its_url_and_ends_all_processes(run_here):
    pytest.importorskip('viser', reason='needs viser')
    ports, tips = [], set()

    def watch(line, family):
        if found := re.search('port (.*) is in use; open http://localhost:(.*)', line):
            ports.extend(map(int, found.groups()))
            with socket.create_connection(('127.0.0.1', ports[1]), timeout=DEADLINE):
                pass
        if found := NUMBERS.search(line):
            tips.add(found.groups()[:3])
            assert len(family) == 2  # node and simulator
        if len(tips) == 2:
            stop_here()

    with socket.create_server(('127.0.0.1', 0)) as occupied:
        port = occupied.getsockname()[1]
        path = str(preset_path('renda2012_table2'))
        status, complaints = run_here(demo, [path, '--port', str(port)], watch)
    assert status == 0, complaints
    assert ports[0] == port < ports[1]


@pytest.mark.parametrize('more', [[], ['--estimate']])
def test_demo_shows_the_moving_arm(run_here, more):
    tips = set()

    def watch(line, family):
        assert 'nodes publish shapes' not in line
        if found := NUMBERS.search(line):
            tips.add(found.groups()[:3])
        if len(tips) == 2:
            stop_here()

    arguments = ['renda2012_prototype', '--moving', '--no-viewer', *more]
    status, complaints = run_here(demo, arguments, watch)
    assert status == 0 and complaints == ''


def test_demo_ends_when_its_node_ends(run_here):
    def watch(line, family):
        for process in family if NUMBERS.search(line) else ():
            command = Path(f'/proc/{process}/cmdline').read_bytes()
            if b'octo_arm_model.ros.node.main' in command:
                os.kill(process, signal.SIGKILL)

    status, complaints = run_here(demo, ['renda2012_table4', '--no-viewer'], watch)
    assert status == 1
    assert 'octo_arm_model.ros.node.main ended by itself with status -9' in complaints


@pytest.mark.parametrize('more', [[], pytest.param(['--moving'], marks=pytest.mark.endurance)])
def test_eight_arms_move_and_all_processes_end(run_here, more):
    def watch(line, family):
        found = re.search(r'(\d+) shapes/s of 8 arms', line)
        if found and float(found[1]) >= (1.0 if more else 8.0):  # slower on a busy machine
            assert len(family) == 1  # hosts the nodes
            stop_here()

    status, complaints = run_here(octopus, ['--no-viewer', '--processes', '1', *more], watch)
    assert status == 0, complaints


# A program with two children that only wait.
PARENT = """
import time
from octo_arm_model.ros.processes import children, stop_signals
is_over = stop_signals()
with children(2 * [('timeit', '-n1', '-r1', 'import time; time.sleep(1000)')]):
    print('started', flush=True)
    while not is_over():
        time.sleep(0.01)
"""


@pytest.mark.skipif(not shutil.which('setpriv'), reason='needs setpriv')
@pytest.mark.parametrize('how', [signal.SIGTERM, signal.SIGKILL])
def test_children_end_with_their_parent(how):
    mark = str(uuid.uuid4())
    process = subprocess.Popen(
        [sys.executable, '-c', PARENT],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, 'OCTO_ARM_TEST': mark},
    )
    assert process.stdout.readline() == 'started\n'
    end = time.monotonic() + DEADLINE
    while len(processes_with(mark)) < 3:  # a new process has no environment yet
        assert time.monotonic() < end, f'after {DEADLINE} s not all run'
    process.send_signal(how)
    process.communicate(timeout=DEADLINE)
    while processes_with(mark):
        assert time.monotonic() < end, f'after {DEADLINE} s they still run'


def test_second_arm_gets_another_domain(monkeypatch, capsys):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(new_domain()))
    domain = os.environ['ROS_DOMAIN_ID']
    with own_domain('first'), own_domain('elsewhere', '/arm_1'):
        assert os.environ['ROS_DOMAIN_ID'] == domain
        assert capsys.readouterr().out == ''
        with own_domain('second'):
            other = os.environ['ROS_DOMAIN_ID']
            assert other != domain
    expected = f'second: there is an arm in ROS domain {domain} already; this one is in domain '
    assert capsys.readouterr().out.startswith(f'{expected}{other}: ')


def test_invalid_domain_is_refused(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', 'lab')
    with pytest.raises(ConfigError, match="ROS_DOMAIN_ID is 'lab', expected a number"):
        with own_domain('octo_arm_demo'):
            pass


@pytest.mark.parametrize('config', ['no_such_arm', 'no/such/file.yaml'])
def test_unknown_config_is_one_line_of_error(config, capsys):
    assert demo.main([config]) == 2
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1
    assert config in complaint
