"""Programs that start others: their output, and that no process is left behind."""

import math
import os
import re
import shutil
import signal
import socket
import time
import uuid
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from live_nodes import DEADLINE, new_domain, start

from octo_arm_model import load_config
from octo_arm_model.apps import demo
from octo_arm_model.config.presets import preset_path
from octo_arm_model.simulation.profiles.commands import find_profile

NUMBERS = re.compile(r'tip +(\S+) +(\S+) +(\S+) mm .* (\S+) shapes/s')


class Program:
    """A program, and all that it starts."""

    def __init__(self, module, *arguments):
        mark = str(uuid.uuid4())
        self._mark = f'OCTO_ARM_TEST={mark}'
        self.process = start(f'apps.{module}', *arguments, domain=new_domain(), OCTO_ARM_TEST=mark)

    def family(self):
        """Processes that have its mark in their environment, itself among them."""
        found = set()
        for path in Path('/proc').glob('[0-9]*/environ'):
            try:
                if self._mark.encode() in path.read_bytes().split(b'\0'):
                    found.add(int(path.parent.name))
            except OSError:
                pass  # ended since, or of another user
        return found

    def line(self, pattern):
        """The next line of its output that ``pattern`` is found in."""
        end = time.monotonic() + DEADLINE
        for line in self.process.stdout:
            if found := re.search(pattern, line):
                return found
            assert time.monotonic() < end, f'no {pattern!r} in {DEADLINE} s, at last {line!r}'
        raise AssertionError(f'it ended by itself: {self.process.stderr.read()}')

    def end(self, how=signal.SIGINT):
        """Its exit status and its output to stderr."""
        self.process.send_signal(how)
        _, complaints = self.process.communicate(timeout=DEADLINE)
        return self.process.returncode, complaints


@pytest.fixture
def started():
    programs = []

    def start(*arguments):
        programs.append(Program(*arguments))
        return programs[-1]

    yield start
    for program in programs:
        for process in program.family():
            os.kill(process, signal.SIGKILL)
        program.process.communicate()


def test_the_demonstration_moves_the_arm_and_leaves_nothing_behind(started):
    program = started('demo', 'renda2012_table2', '--no-viewer')
    first = program.line(NUMBERS).groups()[:3]
    while program.line(NUMBERS).groups()[:3] == first:
        pass
    assert len(program.family()) == 3  # itself, node and simulator
    status, complaints = program.end()
    assert status == 0, complaints
    assert 'Traceback' not in complaints
    assert program.family() == set()


def test_the_demonstration_ends_quietly_with_the_reader_of_its_numbers(started):
    program = started('demo', 'renda2012_prototype', '--no-viewer')
    program.line('waiting|shapes/s')  # as quickly as the node has started
    program.process.stdout.close()  # as `head` does
    assert program.process.wait(DEADLINE) == 141
    assert 'Traceback' not in program.process.stderr.read()
    assert program.family() == set()


def test_the_demonstration_says_where_to_look(started):
    pytest.importorskip('viser', reason='needs viser')
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        program = started('demo', str(preset_path('renda2012_prototype')), '--port', str(port))
        said = program.line('viewer: port (.*) is in use; open http://localhost:(.*)')
    assert int(said[1]) == port < int(said[2])
    with socket.create_connection(('127.0.0.1', int(said[2])), timeout=DEADLINE):
        pass
    program.line(NUMBERS)
    assert program.end()[0] == 0
    assert program.family() == set()


def test_the_demonstration_ends_with_its_node(started):
    program = started('demo', 'renda2012_table4', '--no-viewer')
    program.line(NUMBERS)
    for process in program.family():
        command = Path(f'/proc/{process}/cmdline').read_bytes()
        if b'octo_arm_model.ros.node.main' in command:
            os.kill(process, signal.SIGKILL)
    _, complaints = program.process.communicate(timeout=DEADLINE)
    assert program.process.returncode == 1
    assert 'octo_arm_model.ros.node.main ended by itself with status -9' in complaints
    assert program.family() == set()


@pytest.mark.skipif(not shutil.which('setpriv'), reason='needs setpriv')
def test_what_is_killed_leaves_nothing_behind(started):
    program = started('demo', 'renda2012_prototype', '--no-viewer')
    program.line(NUMBERS)
    program.process.kill()
    assert program.process.wait(DEADLINE) == -signal.SIGKILL
    end = time.monotonic() + DEADLINE
    while program.family():
        assert time.monotonic() < end, f'after {DEADLINE} s they still run'


def test_what_is_ended_while_it_starts_leaves_nothing_behind(started):
    program = started('demo', 'renda2012_table4')
    while len(program.family()) < 3:
        assert program.process.poll() is None
    status, complaints = program.end(signal.SIGTERM)
    assert status == 0, complaints
    assert 'Traceback' not in complaints
    assert program.family() == set()


def test_eight_arms_crawl_and_leave_nothing_behind(started):
    program = started('octopus', '--no-viewer')
    rate = program.line(r'(\d+) shapes/s of 8 arms')
    while float(rate[1]) < 8.0:
        rate = program.line(r'(\d+) shapes/s of 8 arms')
    assert len(program.family()) == 3  # itself and two for the nodes
    status, complaints = program.end()
    assert status == 0, complaints
    assert 'Traceback' not in complaints
    assert program.family() == set()


@pytest.mark.parametrize('config', ['no_such_arm', 'no/such/file.yaml'])
def test_a_config_that_is_none_is_one_clear_line(config, capsys):
    assert demo.main([config]) == 2
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1
    assert config in complaint


@pytest.mark.parametrize('rate', [0.02, 0.5, 100.0])
def test_an_arm_that_is_pushed_moves_no_faster_than_its_tensions_may_change(rate):
    arm = load_config(preset_path('renda2012_table4')).arm
    profile = find_profile('fetching', arm)
    speed = demo.speed_within(profile, rate)
    step = 1.0 / demo.RATE
    samples = profile.at(np.arange(0.0, profile.duration, speed * step))
    fastest = np.abs(np.diff(samples, axis=0)).max()
    assert 0.0 < speed <= 0.3
    # A random walk of that rate has this standard deviation after a step.
    assert fastest <= 1.01 * rate * math.sqrt(step)
    assert speed == 0.3 or fastest > 0.9 * rate * math.sqrt(step)
