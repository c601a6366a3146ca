"""The simulator as a process of its own, commanded over real DDS."""

import itertools
import signal
import subprocess
import time
from functools import partial

import numpy as np
import pytest
from live_nodes import (
    CONFIG,
    CONFIG_FILE,
    DEADLINE,
    INPUTS,
    NAMES,
    RosClient,
    hosting,
    new_domain,
    running,
    start,
    tensions_message,
)
from numpy.testing import assert_allclose, assert_array_equal
from octo_arm_msgs.msg import TendonTensions
from sensor_msgs.msg import JointState

from octo_arm_model import solve_displacements
from octo_arm_model.cli.main import main
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.ros.simulator.main import main as simulator_main
from octo_arm_model.simulation.movements import find_profile
from octo_arm_model.simulation.simulator import PARAMETERS

EXAMPLE = CONFIG_FILE.with_name('simulator.yaml')
SLACK = np.zeros(12)
PLANE, SPACE = np.ravel(FETCHING_IN_PLANE), np.ravel(FETCHING_IN_SPACE)
COMMANDS = {
    topic.replace('tendon_tensions', 'tendon_commands'): kind for topic, kind in INPUTS.items()
}


class Controller(RosClient):
    """Commands tensions and keeps what the load cells read."""

    def __init__(self, domain, node='octo_arm_sim'):
        super().__init__(domain, node)
        self.publishers = {topic: self.teller(kind, topic) for topic, kind in COMMANDS.items()}
        self.measured = self.hear(TendonTensions, 'tendon_tensions')
        self.effective = self.hear(TendonTensions, 'ground_truth/tendon_tensions')

    def command(self, tensions, topic='tendon_commands', names=NAMES):
        self.publishers[topic](tensions_message(topic, tensions, names))

    def reach(self, tensions, topic='tendon_commands', tolerance=1e-9):
        """Command tensions until they are measured; returns what was on the way there."""
        self.measured.clear()
        self.effective.clear()
        command = partial(self.command, tensions, topic)
        self.wait(lambda: self.reads(tensions, tolerance), f'tensions {tensions}', command)
        return np.array([message.tension for message in self.measured])

    def reads(self, tensions, tolerance):
        """Whether the newest reading is of these tensions [N]."""
        read = self.measured
        return read and np.allclose(read[-1].tension, tensions, rtol=0.0, atol=tolerance)

    def hear_anew(self, count=1):
        """Forget readings and hear so many."""
        self.measured.clear()
        self.wait(lambda: len(self.measured) >= count, 'readings')


def seconds(message):
    """The stamp of a message [s]."""
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


simulating = partial(hosting, SimulatorNode, client=Controller)
# No reading is replaced by a newer one before a busy reader takes it.
EVERY_READING = {
    f'qos_overrides./{topic}.publisher.depth': 1000
    for topic in ('tendon_tensions', 'ground_truth/tendon_tensions')
}


@pytest.fixture(scope='module')
def shared():
    given = {'client': Controller, 'node': 'octo_arm_sim'}
    with running('ros.simulator.main', **given, **EVERY_READING) as controller:
        for topic in COMMANDS:
            controller.reach(PLANE, topic)
            controller.reach(SLACK, topic)
        yield controller


@pytest.fixture
def controller(shared):
    """The simulator, perfect and slack."""
    try:
        yield shared
    finally:
        perfect = {p.name.replace('.', '__'): p.default for p in PARAMETERS}
        assert shared.change(**perfect) == (True, '')
        shared.reach(SLACK)


@pytest.mark.parametrize('topic', COMMANDS)
def test_perfect_hardware_measures_what_is_commanded_on_every_topic(controller, topic):
    for given in (PLANE, SPACE, SLACK):
        tensions = np.float64(np.float32(given))  # which every type can hold
        controller.reach(tensions, topic, tolerance=0.0)
    message = controller.measured[-1]
    assert message.name == NAMES
    assert message.header.frame_id == 'arm_base'
    assert abs(message.header.stamp.sec - time.time()) < DEADLINE


def test_winches_reel_in_lengths_and_their_encoders_read_them():
    """Two tendons by length, one by tension: what the arm answers is what the core solves."""
    asked = {'tendon_1_1': 0.02, 'tendon_2_2': 0.01}
    given = np.zeros((3, 4))
    given[2, 0] = 1.0
    with simulating(model='exact', winches__encoders=True) as controller:
        reel = controller.teller(JointState, 'tendon_commands/displacements')
        encoders = controller.hear(JointState, 'tendon_displacements')
        controller.reach(given.ravel())
        solver = CONFIG.solver('exact')
        expected = solve_displacements(solver, asked, {'tendon_3_1': 1.0})
        tensions = expected.backbone.tensions.ravel()
        controller.wait(
            lambda: controller.reads(tensions, 1e-7),
            'lengths',
            lambda: reel(name=list(asked), position=list(asked.values())),
        )
        encoders.clear()
        controller.wait(lambda: encoders, 'encoders')
        assert list(encoders[-1].name) == NAMES
        assert_allclose(encoders[-1].position, expected.displacement.ravel(), atol=1e-8)
        # Beyond what a tendon bears is refused, and what was held still is.
        reel(name=['tendon_1_1'], position=[0.4])
        controller.log('displacements refused')
        # So it is after a change of what the balance does not depend on.
        assert controller.change(markers_rate=7.0) == (True, '')
        controller.hear_anew()
        assert_allclose(controller.measured[-1].tension, tensions, atol=1e-7)
        assert controller.change(profile__name='ramps') == (True, '')
        controller.log('the profile leaves out, as driven by length: tendon_1_1 tendon_2_2')
        reel(JointState())
        controller.reach(given.ravel())
        assert controller.change(tendon_names=[f'cable_{n}' for n in range(12)]) == (True, '')
        controller.log('all tendons go slack, as they have other names')


def test_encoders_read_an_arm_that_a_new_budget_suffices_for():
    """Also where the arm was solved, or tried to be, within another budget before."""
    given = {'loads.tip_force': [0.0, 0.0, 0.01], 'solve_budget.iterations': 1}
    with simulating(model='exact', winches__encoders=True, **given) as controller:
        encoders = controller.hear(JointState, 'tendon_displacements')
        controller.reach(SPACE)
        encoders.clear()
        controller.hear_anew(6)
        assert not encoders
        assert controller.change(solve_budget__iterations=1000) == (True, '')
        controller.wait(lambda: encoders, 'encoders')


def test_the_hardware_that_parameters_describe_is_between_command_and_reading(controller):
    """What each part does is tested without ROS; here that it is there, by the stamps' time."""
    lag = 0.3
    assert controller.change(winches__lag=lag, winches__force_limit=5.0) == (True, '')
    seen = controller.reach(np.minimum(PLANE, 5.0), tolerance=0.01)[:, 10]
    at = list(map(seconds, controller.measured))
    rising = np.flatnonzero((seen[:-1] > 0.0) & (seen[:-1] < 4.5))
    assert rising.size > 5
    left = (5.0 - seen[rising + 1]) / (5.0 - seen[rising])
    assert_allclose(left, np.exp(-np.diff(at)[rising] / lag), rtol=1e-4)
    assert controller.change(load_cells__drop_probability=1.0) == (True, '')
    controller.effective.clear()
    controller.wait(lambda: len(controller.effective) > 1, 'the truth')
    # Readings of before may still be under way.
    since = seconds(controller.effective[-1])
    controller.effective.clear()
    controller.wait(lambda: len(controller.effective) > 20, 'more of it')
    assert all(seconds(message) < since for message in controller.measured)


BAD = {
    'negative': (np.where(PLANE == 13.0, -1.0, PLANE), NAMES, 'tension of tendon_3_3 is -1.0 N'),
    'nan': (np.where(PLANE == 13.0, np.nan, PLANE), NAMES, 'tension of tendon_3_3 is nan N'),
    'too few': (PLANE[:11], NAMES[:11], "no value 'tendon_3_4' for tendon_3_4"),
    'unknown': (PLANE, [*NAMES[:11], 'elbow'], 'unknown tendon elbow'),
    'beyond its limit': (1.01 * PLANE, NAMES, 'tendon_1_3 is 0.505 N, expected at most its limit'),
}


@pytest.mark.parametrize('case', BAD)
def test_a_bad_command_is_refused_with_a_reason_and_the_one_before_is_kept(controller, case):
    values, names, reason = BAD[case]
    controller.reach(SPACE)
    controller.diagnostics.clear()
    bad = partial(controller.command, values, names=names)
    controller.log('refused: ', reason, again=bad)
    controller.wait(
        lambda: any('refused: ' in one and reason in one for one in controller.told()),
        'the refusal in diagnostics',
        bad,
    )
    controller.hear_anew(4)
    assert_array_equal(controller.measured[-1].tension, SPACE)
    controller.reach(PLANE)


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'winches__lag': -1.0}, 'winches.lag is -1.0, expected a finite time >= 0 [s]'),
        ({'winches__lag': 0.5, 'rate': 1e-11}, 'rate is 1e-11, expected a finite number within'),
        ({'profile__name': 'dance'}, "no profile 'dance'"),
        ({'profile__name': 'bending'}, 'these tensions are for renda2012_table2'),
        ({'body__length': -1.0}, 'body.length is -1.0'),
    ],
)
def test_an_impossible_change_is_refused_as_a_whole(controller, values, reason):
    is_taken, why = controller.change(**values)
    assert not is_taken
    assert reason in why
    # Neither a lag nor another rate.
    assert controller.reach(PLANE)[-1].tolist() == PLANE.tolist()


def test_the_simulator_plays_a_profile_until_a_command_comes(controller):
    expected = find_profile('fetching', CONFIG.arm)
    # Neither a command nor a reading of the test before is on its way when the profile begins.
    controller.reach(0.0 * PLANE)
    controller.hear_anew(31)
    looped = {'profile__name': 'fetching', 'profile__speed': 20.0, 'profile__loop': True}
    assert controller.change(**looped) == (True, '')
    for _ in range(2):
        # In a single round a busy machine may miss the peak.
        controller.measured.clear()
        controller.wait(
            lambda: (
                controller.measured
                and np.allclose(
                    np.max([m.tension for m in controller.measured], axis=0),
                    expected.tensions.max(axis=0),
                    rtol=0.05,
                )
            ),
            'another round',
        )
    assert controller.change(profile__loop=False) == (True, '')
    controller.wait(lambda: not any(controller.measured[-1].tension), 'the end of the profile')
    assert controller.change(profile__name='fetching', profile__loop=True) == (True, '')
    controller.wait(lambda: any(controller.measured[-1].tension), 'a new beginning')
    controller.reach(SPACE)
    controller.hear_anew(31)
    assert all(np.array_equal(m.tension, SPACE) for m in controller.measured)


def test_a_profile_is_played_from_the_command_line(controller, monkeypatch, capfd):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(controller.domain))
    controller.measured.clear()
    assert main(['play', 'fetching_in_plane', '--speed', '6', '--wait', str(DEADLINE)]) == 0
    assert capfd.readouterr() == ('', '')
    read = controller.measured
    controller.wait(lambda: any(one.tension[10] > 0.0 for one in read), 'a pull')
    controller.wait(lambda: not any(read[-1].tension), 'slack tendons')
    peak = np.max([message.tension for message in read], axis=0)
    assert_allclose(peak, PLANE, rtol=1e-9)


@pytest.mark.parametrize(
    'how', [signal.SIGINT, pytest.param(signal.SIGHUP, marks=pytest.mark.endurance)]
)
def test_interrupted_in_the_middle_it_lets_the_tendons_go_smoothly(controller, how):
    heard = controller.hear(TendonTensions, 'tendon_commands')
    words = f'play fetching_in_plane --loop --speed 9 --wait {DEADLINE}'.split()
    process = start('cli.main', *words, domain=controller.domain)
    controller.wait(lambda: heard and heard[-1].tension[10] > 6.0, 'a pull')
    process.send_signal(how)
    controller.wait(lambda: process.poll() is not None, 'the release')
    assert (*process.communicate(), process.returncode) == ('', '', 0)
    controller.wait(lambda: not any(heard[-1].tension), 'slack tendons')
    force = np.array([message.tension[10] for message in heard])
    release = force[np.argmax(force) :]
    assert (np.diff(release) <= 0.0).all()
    assert len(np.unique(release)) > 3


def test_nobody_to_play_to_is_an_error_that_says_what_to_start(monkeypatch, capfd):
    monkeypatch.setenv('ROS_DOMAIN_ID', str(new_domain()))
    assert main(['play', 'ramps', '--topic', 'unheard', '--wait', '0.1']) == 2
    complaints = capfd.readouterr().err
    assert complaints.startswith('octo-arm: error: nobody subscribes to /unheard: start octo_arm_')


def test_under_simulated_time_winches_move_with_that_clock():
    later = itertools.count(0, 20_000_000)  # [ns]: two readings a look
    with simulating(use_sim_time=True, winches__rate_limit=1.0) as controller:
        tell_time, read = controller.clock(), controller.measured

        def advance(second):
            tell_time(second, next(later) % 1_000_000_000)
            controller.command(PLANE)

        # Before the command is heard time may pass without a movement.
        controller.wait(
            lambda: read and read[-1].tension[10] > 0.0, 'a movement', partial(advance, 5000)
        )
        del read[:-1]
        # A bag that begins anew plays an earlier clock.
        for second in (5003, 4000, 4002):
            controller.wait(
                lambda second=second: read[-1].header.stamp.sec == second,
                f'a reading at {second} s',
                partial(advance, second),
            )
    at = list(map(seconds, controller.measured))
    force = np.array([message.tension[10] for message in controller.measured])
    assert force[-1] > 4.0
    moved = np.minimum(force[:-1] + np.maximum(np.diff(at), 0.0), 13.0)
    assert_allclose(force[1:], moved, atol=1e-5)


def test_under_simulated_time_readings_come_once_a_period_of_that_clock():
    period = 20_000_000  # [ns]
    with simulating(use_sim_time=True, rate=50.0, **EVERY_READING) as controller:
        tell_time = controller.clock()

        def is_read_at(nanoseconds):
            now = divmod(nanoseconds, 10**9)
            tell_time(*now)
            stamps = (message.header.stamp for message in controller.measured)
            return any((stamp.sec, stamp.nanosec) == now for stamp in stamps)

        # What nobody hears yet does not come again: time goes on until a reading is heard. Where
        # several times wait, rclpy may call the timer once for each and leave out periods for it;
        # it is in step once no other time waits, at the second moment that is read alone.
        moments = itertools.count(5000 * 10**9, period)
        controller.wait(lambda: is_read_at(next(moments)) or controller.measured, 'a reading')
        heard = next(moments)
        for begun in (heard + 1000 * period, heard + 2000 * period):
            controller.wait(lambda begun=begun: is_read_at(begun), 'a reading alone')
        for half in range(1, 11):
            now = begun + half * period // 2
            if half % 2:
                is_read_at(now)
                controller.spin(0.02)
            else:
                controller.wait(lambda now=now: is_read_at(now), 'a reading')
    at = [seconds(m) for m in controller.measured if seconds(m) > 1e-9 * begun - 1e-6]
    assert_allclose(np.diff(at), 1e-9 * period, atol=1e-6)


# The clock of the system for a process, ahead by the seconds in the file `AHEAD`.
CLOCK = """
#include <fcntl.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
int clock_gettime(clockid_t kind, struct timespec *time) {
  char text[20] = "";
  int failed = syscall(SYS_clock_gettime, kind, time), file;
  if (kind != CLOCK_REALTIME || (file = open(getenv("AHEAD"), O_RDONLY)) < 0) return failed;
  if (read(file, text, 19) > 0) time->tv_sec += atol(text);
  close(file);
  return failed;
}
"""


def test_a_clock_that_is_set_back_does_not_stop_the_simulator(tmp_path, monkeypatch):
    source, library, ahead = (tmp_path / name for name in ('clock.c', 'clock.so', 'ahead'))
    source.write_text(CLOCK)
    subprocess.run(['cc', '-shared', '-fPIC', '-o', library, source], check=True)
    ahead.write_text('0')
    monkeypatch.setenv('LD_PRELOAD', str(library))
    monkeypatch.setenv('AHEAD', str(ahead))
    with running('ros.simulator.main', client=Controller, node='octo_arm_sim') as controller:
        controller.hear_anew(3)
        before = seconds(controller.measured[-1])
        ahead.write_text('-3600')
        controller.wait(lambda: seconds(controller.measured[-1]) < before - 3000.0, 'readings')
        controller.hear_anew(3)


@pytest.mark.parametrize(
    ('parameter', 'complaint'),
    [
        ('winches.lag:=-1', 'winches.lag is -1.0, expected a finite time >= 0 [s]'),
        ('sensors.marker_s:=[0, 9.9]', 'sensors.marker_s is 9.9, expected a finite number within'),
        ('push.s:=1', 'push.s is 1.0, expected a finite number within [0, 0.45] [m]'),
        ('profile.name:=nowhere.csv', 'nowhere.csv: No such file or directory'),
    ],
)
def test_bad_parameters_end_the_simulator_with_one_line_that_says_why(
    parameter, complaint, run_here
):
    given = '--ros-args', '--params-file', CONFIG_FILE, '-p', parameter
    assert complaint in run_here(simulator_main, 1, *given)


def test_the_example_is_read_in_any_namespace_and_overridden_by_single_parameters():
    given = {'files': (CONFIG_FILE, EXAMPLE), 'winches.slack_floor': 0.03}
    with simulating('-r', '__ns:=/deep/down', **given) as controller:
        heard = controller.hear(TendonTensions, '/deep/down/ground_truth/tendon_tensions')
        controller.wait(lambda: heard and heard[-1].tension[0] > 0.0299, 'the slack floor')
        assert heard[-1].tension[0] <= 0.03


def test_readings_have_the_names_that_the_arm_says_and_are_raw_but_not_the_truth(controller):
    names = [f'LC {number}' for number in range(12)]
    names[0] = '-'
    offset = np.full(12, 0.1)
    try:
        assert controller.change(tension_names=names, tension_offset=offset.tolist()) == (True, '')
        controller.measured.clear()
        controller.effective.clear()
        controller.wait(
            lambda: controller.measured and 'LC 1' in controller.measured[-1].name, 'other names'
        )
        reading = controller.measured[-1]
        assert list(reading.name) == names[1:]
        assert len(reading.tension) == 11
        assert min(reading.tension) < 0.0

        def is_true():
            true = controller.effective[-1] if controller.effective else None
            return true and list(true.name) == NAMES and np.array_equal(true.tension, PLANE)

        command = partial(controller.command, PLANE)
        controller.wait(is_true, 'true tensions of all tendons', command)
    finally:
        assert controller.change(tension_names=[], tension_offset=[]) == (True, '')
