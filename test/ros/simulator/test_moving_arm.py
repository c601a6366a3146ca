"""The simulator of an arm that moves, over DDS: shape, tendons, services and sensors."""

import itertools
from functools import partial

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import (
    PoseArray,
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    Vector3,
    Vector3Stamped,
    WrenchStamped,
)
from live_nodes import MOVING, RosClient, hosting, tensions_message, xyz
from numpy.testing import assert_allclose, assert_array_equal
from octo_arm_msgs.msg import TendonTensions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.simulation.movements import find_profile
from octo_arm_model.simulation.pushed_arm import touched

FILE = preset_path('renda2012_prototype')
CONFIG = load_config(FILE)
NAMES = list(CONFIG.arm.tendon_names)
PULL = np.array([0.5, 0.0, 0.0, 0.0])


def moving(**more):
    """The simulator of an arm that moves, strongly damped, and a client."""
    return hosting(SimulatorNode, files=[FILE], client=MovingArm, **MOVING | {'rate': 50.0} | more)


class MovingArm(RosClient):
    """Hears the tip of an arm that moves, and asks its simulator."""

    def __init__(self, domain, node='octo_arm_sim'):
        super().__init__(domain, node)
        self.tips = self.hear(PoseWithCovarianceStamped, 'ground_truth/tip_pose')
        self.joints = self.hear(JointState, 'tendon_states')
        self.times = self.hear(Clock, '/clock')
        self.command = self.teller(TendonTensions, 'tendon_commands')

    def tip(self):
        return xyz(self.tips[-1].pose.pose.position)

    def values(self, key):
        """All values of a ``key`` that diagnoses said."""
        statuses = [status for message in self.diagnostics for status in message.status]
        return {v.value for status in statuses for v in status.values if v.key == key}

    def pause(self, is_paused=True):
        assert self.call(SetBool, 'pause', SetBool.Request(data=is_paused)).success
        self.spin(0.2)

    def trigger(self, name):
        answer = self.call(Trigger, name, Trigger.Request())
        return answer.success, answer.message

    def steps(self, count):
        """Tip [m] and rates of the tendons [m/s] after each of some steps of a paused arm."""
        found = []
        for _ in range(count):
            self.tips.clear()
            self.joints.clear()
            assert self.trigger('step') == (True, 'went on by one period')
            self.wait(lambda: self.tips and self.joints, 'a step')
            found.append([*self.tip(), *self.joints[-1].velocity])
        return np.array(found)


def ns(stamp):
    return 10**9 * stamp.sec + stamp.nanosec


def test_an_arm_whose_steps_take_longer_than_their_time_is_diagnosed():
    """Without damping, at a rate that no machine keeps."""
    stiff = {'material__youngs_modulus': 1e9, 'motion__damping_time': 0.0, 'rate': 1000.0}
    with moving(**stiff) as client:
        client.wait(
            lambda: any('of clock speed' in one for one in client.told()),
            'what is said of a slow arm',
            lambda: client.command(name=NAMES, tension=PULL),
        )


def test_the_moving_arm_is_published_paused_stepped_and_reset():
    with moving() as client:
        client.wait(lambda: client.tips and client.joints, 'the arm')
        straight = client.tip()
        assert_allclose(straight, [0.27, 0.0, 0.0], atol=1e-9)
        assert list(client.joints[-1].name) == NAMES
        expected = CONFIG.solver('exact').solve(PULL.reshape(1, 4)).tip
        client.wait(
            lambda: np.linalg.norm(client.tip() - expected) < 1e-4,
            'the equilibrium',
            lambda: client.command(name=NAMES, tension=PULL),
        )
        assert_allclose(client.joints[-1].effort, PULL, atol=1e-9)
        assert client.joints[-1].position[0] > 0.0
        # It took its time: shapes in between were published.
        away = [np.linalg.norm(xyz(one.pose.pose.position) - straight) for one in client.tips]
        whole = np.linalg.norm(expected - straight)
        assert any(0.1 * whole < one < 0.9 * whole for one in away)
        assert not client.trigger('step')[0]
        client.pause()
        client.tips.clear()
        client.spin(0.3)
        assert not client.tips
        client.steps(1)
        assert len(client.tips) == 1
        assert client.trigger('reset')[0]
        client.pause(False)
        client.tips.clear()
        client.wait(lambda: client.tips and np.linalg.norm(client.tip() - straight) < 1e-9, 'rest')


def test_all_of_an_arm_is_slower_than_a_clock_that_jumps():
    with moving(use_sim_time=True, rate=20.0, profile__name='ramps') as client:
        joints, tell_time = client.joints, client.clock()
        assert 'nothing is heard on /clock' in client.status('simulator')[0].message
        for second in (5000, 10**6, 2 * 10**6):  # [s], of which it goes on by 0.1 s
            client.wait(
                lambda second=second: joints and joints[-1].header.stamp.sec == second,
                f'the arm at {second} s',
                partial(tell_time, second),
            )
            assert client.change(push__force=[0.0, 0.02, 0.0]) == (True, '')
        client.status('simulator')
        assert max(map(float, client.values('real time factor'))) < 100.0
    reeled = np.diff([one.position for one in joints], axis=0)
    assert np.abs(reeled).max() > 1e-6
    velocities = [one.velocity for one in joints[1:]]
    assert_allclose(velocities, reeled / 0.1, rtol=1e-9, atol=1e-12)
    played = find_profile('ramps', CONFIG.arm).at(np.array([0.0, 0.05, 0.15]))
    assert_allclose([one.effort for one in joints], played, atol=1e-12)


@pytest.mark.parametrize('lag', [0.0, 0.1])
def test_a_state_that_is_saved_goes_on_to_the_same_bits(tmp_path, lag):
    file = tmp_path / 'state.npz'
    pushed = {'push__force': [0.0, 0.02, 0.0], 'push__period': 0.12}
    with moving(state_file=str(file), winches__lag=lag, profile__name='ramps', **pushed) as client:
        client.wait(lambda: client.tips, 'the arm')
        client.pause()
        client.steps(3)
        assert client.trigger('save_state') == (True, 'saved')
        expected = client.steps(4)
        assert np.abs(np.diff(expected, axis=0)).max() > 0.0
        for _ in range(2):
            assert client.trigger('restore_state') == (True, 'restored')
            assert_array_equal(client.steps(4), expected)
        assert client.trigger('reset') == (True, 'at rest, tendons slack')
        assert client.trigger('restore_state')[0]
        assert_array_equal(client.steps(4), expected)

        # What is none of this arm is refused, and the arm goes on.
        whole = file.read_bytes()
        file.write_bytes(whole[: len(whole) // 2])
        is_done, why = client.trigger('restore_state')
        assert not is_done and why.startswith(f'{file} cannot be read as a state: ')
        for name, value, reason in (
            ('command', 9.0, 'tension of tendon_1_1 is 9'),
            ('played', None, 'is the state of an arm alone, without its winches: no played'),
            ('hardware', np.nan, 'hardware is [[nan, '),
            ('surroundings', 9.0, 'surroundings are not those of the base'),
        ):
            file.write_bytes(whole)
            with np.load(file) as before:
                arrays = dict(before)
            arrays[name] = np.full(arrays[name].shape, value)
            np.savez(file, **{key: one for key, one in arrays.items() if one.dtype != object})
            is_done, why = client.trigger('restore_state')
            assert not is_done and reason in why, why
        file.unlink()
        assert not client.trigger('restore_state')[0]
        client.steps(1)
        # Who sets parameters over the network chooses no folder to write to.
        for other in (tmp_path / 'no' / 'state.npz', tmp_path / 'no' / '..' / 'state.npz'):
            is_taken, why = client.change(state_file=str(other))
            assert not is_taken and why.endswith(f'given at the start, {tmp_path}')
        file.mkdir()
        is_done, why = client.trigger('save_state')
        assert not is_done and why.endswith('state.npz cannot be written: Is a directory')
        assert client.change(state_file='') == (True, '')
        wanted = "state_file is '', expected the name of a file of a state"
        assert client.trigger('save_state') == (False, wanted)


@pytest.mark.parametrize('factor', [0.0, 2.0])
def test_the_simulators_own_time_goes_on_by_a_period_each_step(factor):
    with moving(publish_clock=True, real_time_factor=factor) as client:
        client.wait(lambda: len(client.tips) > 20 and len(client.times) > 20, 'time')
        period = 20_000_000  # [ns]
        for times in (
            [ns(one.clock) for one in client.times],
            [ns(one.header.stamp) for one in client.tips],
        ):
            assert set(np.diff(times)) <= {period * count for count in range(1, 1000)}
            assert times[0] % period == 0
        _, values = client.status('simulator')
        assert float(values['real time factor']) > 0.0
        client.pause()
        client.times.clear()
        client.spin(0.3)
        assert not client.times
        assert client.trigger('reset')[0]
        client.steps(2)
        assert ns(client.times[-1].clock) == 2 * period
        assert ns(client.tips[-1].header.stamp) == 2 * period
        client.times.clear()
        client.pause(False)
        client.wait(lambda: len(client.times) > 3, 'time')
        # Others may publish the time then.
        assert client.change(publish_clock=False, real_time_factor=1.0) == (True, '')
        client.wait(lambda: not client.node.count_publishers('/clock'), 'the end of the clock')
        assert client.change(publish_clock=True) == (True, '')
        client.times.clear()
        client.wait(lambda: client.times, 'time')


def test_an_arm_that_is_crushed_stays_as_it_was_and_is_not_published():
    with moving(on_failure='pause', publish_clock=True) as client:
        client.wait(lambda: len(client.tips) > 3, 'the arm')
        rest = client.tip()
        assert client.change(push__force=[0.0, 1500.0, 0.0]) == (True, '')
        client.log('paused, as no step succeeds')
        client.spin(0.2)
        client.tips.clear()
        _, values = client.status('simulator')
        assert int(values['failed steps']) == 1 and not client.tips
        assert values['source'] == 'nothing, as it is paused'
        assert client.trigger('step')[0]
        client.log('the arm stays as it was: the motion ends at ')
        assert not client.tips
        # It goes on from there, also where it is told to try again and again.
        assert client.change(on_failure='go_on') == (True, '')
        client.pause(False)
        client.wait(lambda: int(client.status('simulator')[1]['failed steps']) > 4, 'failures')
        assert 'steps failed: ' in client.status('simulator')[0].message and not client.tips
        assert client.change(push__force=[0.0, 0.0, 0.0]) == (True, '')
        client.wait(lambda: client.tips, 'the arm')
        assert_allclose(client.tip(), rest, atol=1e-9)


def test_the_base_and_the_water_move_as_messages_tell(tmp_path):
    given = {'loads__fluid_density': 1022.0, 'motion__water': 'cylinder', 'publish_clock': True}
    with moving(state_file=str(tmp_path / 'state.npz'), **given) as client:
        base = client.teller(PoseStamped, 'base_pose')
        current = client.teller(Vector3Stamped, 'current')
        push = client.teller(Vector3Stamped, 'push/force')
        client.wait(lambda: client.tips, 'the arm')
        pose = PoseStamped()
        pose.pose.position.z, turn = 0.05, CONFIG.base.quaternion
        pose.pose.orientation = Quaternion(**dict(zip('xyzw', turn)))
        moved = [0.27, 0.0, 0.05]
        client.wait(
            lambda: np.allclose(client.tip(), moved, atol=1e-4), 'a move', partial(base, pose)
        )
        flow = Vector3(y=0.1)
        client.wait(lambda: client.tip()[1] > 1e-3, 'a current', partial(current, vector=flow))
        # All of it is in the state that is saved.
        client.pause()
        assert client.trigger('save_state')[0]
        expected = client.steps(2)
        assert client.trigger('restore_state')[0]
        assert_array_equal(client.steps(2), expected)
        client.pause(False)
        far, odd, strange = PoseStamped(), PoseStamped(), PoseStamped()
        far.pose.position.x, far.pose.orientation = 1.0, pose.pose.orientation
        odd.pose.orientation.w = float('nan')
        strange.header.frame_id = 'map'
        fast, strong = (Vector3Stamped(vector=Vector3(x=x)) for x in (float('inf'), 1e300))
        for tell, message, reason in (
            (base, far, 'rad from where the base is, expected at most 0.1 m and 0.3 rad'),
            (base, odd, 'base.quaternion is '),
            (base, strange, "the pose is in frame 'map', expected 'arm_base'"),
            (current, fast, 'expected three finite numbers [m/s]'),
            (push, strong, 'force on the tip is 1e+300 N, expected'),
        ):
            client.log(reason, again=partial(tell, message))
        assert client.trigger('reset')[0]
        client.tips.clear()
        client.wait(lambda: client.tips and abs(client.tip()[2]) < 1e-9, 'the arm at first')
        assert client.status('simulator')[1]['failed steps'] == '0'
        assert client.values('commands [Hz]') == {'0.0'}


def test_commanders_that_contradict_each_other_are_named():
    with moving(rate=20.0) as client:
        other = rclpy.create_node('second', namespace='lab', context=client.context)
        array = other.create_publisher(Float64MultiArray, '/tendon_commands/array', 10)
        same = other.create_publisher(TendonTensions, '/tendon_commands', 10)
        mine = client.node.create_publisher(TendonTensions, 'tendon_commands', 10)

        def following(expected, *commands):
            """Wait for what is reported while ``commands`` come again and again."""
            turns = itertools.cycle(commands)

            def command():
                publisher, topic, pull = next(turns)
                publisher.publish(tensions_message(topic, pull * PULL, NAMES))

            client.diagnostics.clear()
            client.wait(lambda: expected in client.told()[-2:], expected, command)
            return client.told()

        one = mine, 'tendon_commands', 1.0
        quiet = 'following commands'
        following(quiet, one)
        apart = 'commanders contradict each other: /tendon_commands of /client, /lab/second'
        following(apart, one, (same, 'tendon_commands', 0.5))
        following(quiet, one)
        following(
            f'{apart}; /tendon_commands/array of /lab/second',
            one,
            (array, 'tendon_commands/array', 0.5),
        )
        following(quiet, one)
        # Several that agree are no contradiction.
        for _ in range(3):
            agree = following(
                quiet, one, (same, 'tendon_commands', 1.0), (array, 'tendon_commands/array', 1.0)
            )
        assert set(agree) == {quiet}
        other.destroy_node()


@pytest.mark.parametrize('is_moving', [False, pytest.param(True, marks=pytest.mark.endurance)])
def test_a_reset_forgets_commands_pushes_and_the_history_of_friction(is_moving):
    # At rest the tip follows the tensions at once, and is measured.
    more = {} if is_moving else {'sensors__tip_pose_rate': 20.0}
    topic = 'ground_truth/tip_pose' if is_moving else 'measured/tip_pose'
    with moving(
        dynamics=is_moving,
        model='exact',
        rate=20.0,
        publish_clock=True,
        tendons__friction=[0.3] * 4,
        **more,
    ) as client:
        tips = client.hear(PoseWithCovarianceStamped, topic)

        def last(count):
            return np.array([xyz(one.pose.pose.position) for one in tips[-count:]])

        def settled(pull):
            """Place of the tip at rest under a pull, once it is told."""
            tips.clear()
            client.wait(
                lambda: len(tips) > 10 and np.ptp(last(5), axis=0).max() < 1e-6,
                'rest',
                lambda: client.command(name=NAMES, tension=pull * PULL),
            )
            return last(1)[0]

        client.wait(lambda: tips, 'the arm')
        first = settled(0.5)
        settled(1.0)
        assert np.linalg.norm(settled(0.5) - first) > 1e-4  # let out: friction holds the bend
        # Commands that are still under way have come by then.
        tips.clear()
        client.wait(lambda: len(tips) > 5, 'readings')
        assert client.trigger('reset')[0]
        tips.clear()
        client.wait(lambda: len(tips) > 5, 'the arm')
        assert_allclose(last(1), [[0.27, 0.0, 0.0]], atol=1e-9)
        assert_allclose(settled(0.5), first, atol=1e-5)


# Sensors -----------------------------------------------------------------------------------------


OF_SIMULATOR, _ = touched(CONFIG)
FORCE = np.array(OF_SIMULATOR['push.force'])
KINDS = {
    'measured/tip_pose': PoseWithCovarianceStamped,
    'measured/markers': PoseArray,
    'measured/base_wrench': WrenchStamped,
    'ground_truth/tip_wrench': WrenchStamped,
}


def pushed(**more):
    """The simulator of an arm that is pushed all the time, and a client."""
    given = {'stations': 21, **OF_SIMULATOR, 'push.period': 0.0, 'rate': 20.0, **more}
    return hosting(SimulatorNode, files=[FILE], **given)


def test_sensors_measure_the_arm_that_is_pushed():
    kinds = 'tip_position', 'tip_rotation', 'marker'
    exact = {f'sensors.{kind}_stddev': 0.0 for kind in kinds} | {'sensors.base_wrench_rate': 10.0}
    with pushed(**exact) as client:
        heard = {topic: client.hear(kind, topic) for topic, kind in KINDS.items()}
        client.wait(lambda: all(heard.values()), 'measurements')
        solver = CONFIG.solver('exact', 401)
        shape = solver.solve(np.zeros((1, 4)), np.append(FORCE, np.zeros(3)))
        tip = heard['measured/tip_pose'][-1]
        assert_allclose(xyz(tip.pose.pose.position), shape.tip, atol=1e-6)
        assert tip.header.frame_id == 'arm_base'
        places = [
            np.interp(OF_SIMULATOR['sensors.marker_s'], shape.s, one) for one in shape.position.T
        ]
        seen = [xyz(pose.position) for pose in heard['measured/markers'][-1].poses]
        assert_allclose(seen, np.transpose(places), atol=1e-5)
        moment = xyz(heard['measured/base_wrench'][-1].wrench.torque)
        assert_allclose(moment, np.cross(shape.tip, FORCE), atol=1e-6)
        true = xyz(heard['ground_truth/tip_wrench'][-1].wrench.force)
        assert_allclose(true, FORCE, rtol=1e-12)
        # Nothing pushes any more, and another place cannot be pushed.
        assert client.change(push__force=[0.0, 0.0, 0.0]) == (True, '')
        heard['measured/tip_pose'].clear()
        client.wait(lambda: heard['measured/tip_pose'], 'the tip')
        place = xyz(heard['measured/tip_pose'][-1].pose.pose.position)
        assert_allclose(place, [0.27, 0.0, 0.0], atol=1e-9)
        done, why = client.change(push__s=1.0, push__force=[0.0, 0.0, 0.01])
        assert not done and 'push.s is 1.0' in why


def test_the_arm_is_pushed_and_let_go_when_asked():
    with pushed(**{'push.period': 1e6}) as client:
        heard = client.hear(WrenchStamped, 'ground_truth/tip_wrench')

        def push(is_on, force):
            answer = client.call(SetBool, 'push', SetBool.Request(data=is_on))
            becomes(force)
            return answer.success, answer.message

        def becomes(force):
            client.wait(
                lambda: heard and np.allclose(xyz(heard[-1].wrench.force), force, atol=1e-12),
                f'a push of {force} N',
            )

        becomes(np.zeros(3))  # the first half of the period
        done, said = push(True, FORCE)
        assert done and said.startswith('pushes the tip with [')
        assert push(False, np.zeros(3)) == (True, 'lets go')
        assert push(True, FORCE)[0]
        # Parameters are as they say again.
        assert client.change(push__period=1e5) == (True, '')
        becomes(np.zeros(3))
        assert client.change(push__force=[0.0, 0.0, 0.0]) == (True, '')
        done, said = push(True, np.zeros(3))
        assert not done and said.startswith('push.force is 0, expected')
