"""Programs that start others: their output, and that no process is left behind."""

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


def family_of(mark):
    """Processes that were started with OCTO_ARM_TEST as ``mark`` in their environment."""
    found, wanted = set(), f'OCTO_ARM_TEST={mark}'.encode()
    for path in Path('/proc').glob('[0-9]*/environ'):
        try:
            if wanted in path.read_bytes().split(b'\0'):
                found.add(int(path.parent.name))
        except OSError:
            pass  # ended since, or of another user
    return found


class Watched(io.StringIO):
    """Output of a program that runs here; ``act`` is called with each of its lines."""

    def __init__(self, act):
        super().__init__()
        self._act, self._line = act, ''

    def write(self, text):
        """Take what is printed."""
        self._line += text
        while '\n' in self._line:
            line, _, self._line = self._line.partition('\n')
            self._act(line)
        return len(text)


@pytest.fixture
def run_here(monkeypatch, capfd):
    """Runs a program here whose children are processes.

    It gets a domain of its own. What it prints is given to ``act``, a line at a time, with the
    processes of its children. Returns its exit status and what it and they wrote to stderr.
    """
    mark = str(uuid.uuid4())
    monkeypatch.setenv('ROS_DOMAIN_ID', str(new_domain()))
    monkeypatch.setenv('OCTO_ARM_TEST', mark)
    numbers = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    before = [signal.getsignal(number) for number in numbers]

    def run(program, arguments, act):
        watched = Watched(lambda line: act(line, family_of(mark)))
        with contextlib.redirect_stdout(watched):
            status = program.main(arguments)
        assert family_of(mark) == set()
        complaints = capfd.readouterr().err
        assert 'Traceback' not in complaints
        return status, complaints

    yield run
    for process in family_of(mark):
        os.kill(process, signal.SIGKILL)
    for number, handler in zip(numbers, before):
        signal.signal(number, handler)


def stop_here():
    """End the program that runs here, as Ctrl-C does."""
    os.kill(os.getpid(), signal.SIGINT)


def test_the_demonstration_moves_the_arm_says_where_to_look_and_leaves_nothing_behind(run_here):
    pytest.importorskip('viser', reason='needs viser')
    said, tips = [], set()

    def watch(line, family):
        if found := re.search('port (.*) is in use; open http://localhost:(.*)', line):
            said.extend(map(int, found.groups()))
            with socket.create_connection(('127.0.0.1', said[1]), timeout=DEADLINE):
                pass
        if found := NUMBERS.search(line):
            tips.add(found.groups()[:3])
            assert len(family) == 2  # node and simulator
        if len(tips) == 2:
            stop_here()

    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        path = str(preset_path('renda2012_table2'))
        status, complaints = run_here(demo, [path, '--port', str(port)], watch)
    assert status == 0, complaints
    assert said[0] == port < said[1]


@pytest.mark.parametrize('more', [[], ['--estimate']])
def test_an_arm_that_moves_is_shown_and_not_the_one_at_rest(run_here, more):
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


def test_the_demonstration_ends_with_its_node(run_here):
    def watch(line, family):
        for process in family if NUMBERS.search(line) else ():
            command = Path(f'/proc/{process}/cmdline').read_bytes()
            if b'octo_arm_model.ros.node.main' in command:
                os.kill(process, signal.SIGKILL)

    status, complaints = run_here(demo, ['renda2012_table4', '--no-viewer'], watch)
    assert status == 1
    assert 'octo_arm_model.ros.node.main ended by itself with status -9' in complaints


@pytest.mark.parametrize('more', [[], pytest.param(['--moving'], marks=pytest.mark.endurance)])
def test_eight_arms_crawl_and_leave_nothing_behind(run_here, more):
    def watch(line, family):
        found = re.search(r'(\d+) shapes/s of 8 arms', line)
        if found and float(found[1]) >= (1.0 if more else 8.0):  # a busy machine moves few
            assert len(family) == 1  # hosts the nodes
            stop_here()

    status, complaints = run_here(octopus, ['--no-viewer', '--processes', '1', *more], watch)
    assert status == 0, complaints


# A program with two children that do nothing for long.
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
    while len(family_of(mark)) < 3:  # a process has no environment while it becomes a program
        assert time.monotonic() < end, f'after {DEADLINE} s not all run'
    process.send_signal(how)
    process.communicate(timeout=DEADLINE)
    while family_of(mark):
        assert time.monotonic() < end, f'after {DEADLINE} s they still run'


def test_a_domain_with_an_arm_is_left_to_it(monkeypatch, capsys):
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


def test_a_domain_that_is_no_number_is_refused(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', 'lab')
    with pytest.raises(ConfigError, match="ROS_DOMAIN_ID is 'lab', expected a number"):
        with own_domain('octo_arm_demo'):
            pass


@pytest.mark.parametrize('config', ['no_such_arm', 'no/such/file.yaml'])
def test_a_config_that_is_none_is_one_clear_line(config, capsys):
    assert demo.main([config]) == 2
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1
    assert config in complaint
