"""Nodes as processes of their own, and clients that talk to them over DDS.

Every process started here is in a ROS domain of its own, see `ros_domains`.
"""

import contextlib
import gc
import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial

import numpy as np
import rclpy
from backbone_messages import assert_hold
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, WrenchStamped
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains
from rcl_interfaces.msg import Log
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_domains import new_domain, reserved_domain
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros import start
from octo_arm_model.ros.estimator.main import EstimatorNode, ManagedEstimatorNode
from octo_arm_model.ros.node import diagnostics
from octo_arm_model.ros.node.main import ManagedOctoArmNode, OctoArmNode, make_executor
from octo_arm_model.ros.processes import parameter_arguments
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.ros.start import read_here
from octo_arm_model.ros.topics import message_class
from octo_arm_model.wire.tensions import TENSION_TOPICS

# [s] for anything that takes milliseconds on an idle machine; long, since only what fails waits.
DEADLINE = 120.0
NO_TRANSITION = 200  # is none of those of managed nodes
PERIOD = 0.02  # [s] between polls of what is not waited for by an executor
CONFIG_FILE = preset_path('renda2012_table4')
CONFIG = load_config(CONFIG_FILE)
NAMES = list(CONFIG.arm.tendon_names)
# Nodes in this process report and warn more often than those in processes of their own, each
# second: most of the time of their tests would be waiting for that.
diagnostics.PERIOD = start.WARNING_PERIOD = 0.2
NODES = {'node': OctoArmNode, 'lifecycle': ManagedOctoArmNode, 'simulator': SimulatorNode}
# Names of nodes that are not of an arm.
_OTHERS = {
    SimulatorNode: 'octo_arm_sim',
    EstimatorNode: 'octo_arm_estimator',
    ManagedEstimatorNode: 'octo_arm_estimator',
}
INPUTS = {topic: message_class(kind.type_name) for topic, kind in TENSION_TOPICS.items()}
# Inputs of the node as reliable as its outputs, for tests that count every message.
RELIABLE = {
    f'qos_overrides./{topic}.subscription.reliability': 'reliable'
    for topic in (*INPUTS, 'tip_wrench')
}
# What is not about the budget has one that a busy machine keeps to.
AFFORDED = {'solve_budget.seconds': 60.0}
OUTPUTS = {
    'backbone/path': Path,
    'backbone/poses': PoseArray,
    'strains': SectionStrains,
    'tip_pose': PoseWithCovarianceStamped,
    'tendon_lengths': JointState,
}
# What the node says before it is discovered is kept for whoever subscribes later.
LOG_QOS = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def environment(domain, **more):
    """Variables of a process in ``domain``."""
    return {
        **os.environ,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_PYTHON_CHECK_FIELDS': '1',
        **more,
    }


def start(module, *arguments, domain, **variables):
    """Run a module of the package as a process."""
    return subprocess.Popen(
        [sys.executable, '-m', f'octo_arm_model.{module}', *map(str, arguments)],
        env=environment(domain, **variables),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _of_ros(files, arguments, parameters):
    """Arguments of a node: parameter ``files``, others, and parameters, `__` for `.`."""
    given = [word for file in files for word in ('--params-file', str(file))]
    named = {name.replace('__', '.'): value for name, value in parameters.items()}
    return ['--ros-args', *given, *map(str, arguments), *parameter_arguments(named)]


def start_node(module, domain, *arguments, files=(CONFIG_FILE,), **parameters):
    """Run a node as a process."""
    return start(module, *_of_ros(files, arguments, parameters), domain=domain)


def stop(process, how=signal.SIGINT):
    """End a process by a signal; returns what it wrote to stderr."""
    process.send_signal(how)
    return check_end(process, 0)


def check_end(process, status):
    """Wait for the end of a process, check its status; returns what it wrote to stderr."""
    _, complaints = process.communicate(timeout=DEADLINE)
    assert process.returncode == status, complaints
    assert 'Traceback' not in complaints, complaints
    return complaints


def tensions_message(topic, tensions, names=NAMES):
    """Tensions as a message of the type of ``topic``, without a stamp."""
    measured = topic.replace('tendon_commands', 'tendon_tensions')
    kind, message = TENSION_TOPICS[measured], INPUTS[measured]()
    setattr(message, kind.tensions, np.ravel(np.asarray(tensions, dtype=float)).tolist())
    if kind.names is not None:
        setattr(message, kind.names, names)
    return message


def _transition(number):
    request = ChangeState.Request()
    request.transition.id = number
    return request


def setting(path, value):
    """What sets the field at a dotted ``path`` of a message."""
    *places, last = path.split('.')

    def change(message):
        for place in places:
            message = message[int(place)] if place.isdigit() else getattr(message, place)
        if last.isdigit():
            message[int(last)] = value
        else:
            setattr(message, last, value)

    return change


def xyz(point):
    """A point or vector of a message, (3,)."""
    return np.array([point.x, point.y, point.z])


def spin_until(executor, condition):
    end = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < end, f'it did not happen in {DEADLINE} s'
        executor.spin_once(timeout_sec=0.1)


class RosClient:
    """A ROS node in the domain of a process, with what tests need of it."""

    def __init__(self, domain, node='octo_arm'):
        self.domain, self.name = domain, node
        self.context = rclpy.Context()
        os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('client', context=self.context)
        self.executor = make_executor(self.context)
        self.executor.add_node(self.node)
        self.diagnostics = self.hear(DiagnosticArray, '/diagnostics')
        self.logs = self.hear(Log, '/rosout', LOG_QOS)
        self._parameters = None
        self._services = {}

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def hear(self, kind, topic, qos=1000, **options):
        """The list that messages are appended to."""
        heard = []
        self.node.create_subscription(kind, topic, heard.append, qos, **options)
        return heard

    def spin(self, seconds=0.05):
        """Take what has arrived, or wait for it."""
        self.executor.spin_once(timeout_sec=seconds)
        # The events executor takes one event a call.
        for _ in range(20):
            self.executor.spin_once(timeout_sec=0.0)

    def wait(self, condition, what, again=lambda: None):
        """Spin, doing something ``again`` and again, until ``condition``, which is returned."""
        end = time.monotonic() + DEADLINE
        again()
        while not (found := condition()):
            assert time.monotonic() < end, f'{what} did not happen in {DEADLINE} s'
            self.spin()
            again()
        return found

    def teller(self, kind, topic, qos=10):
        """What publishes messages of ``kind``, given whole or by their fields."""
        publisher = self.node.create_publisher(kind, topic, qos)
        return lambda message=None, **fields: publisher.publish(message or kind(**fields))

    def clock(self):
        """What tells nodes on simulated time a time [s], and whole nanoseconds more."""
        tell = self.teller(Clock, '/clock')
        return lambda sec, nanosec=0: tell(clock=Time(sec=sec, nanosec=nanosec))

    def service(self, kind, name):
        """The client of the service ``name``, which is ready."""
        if name not in self._services:
            self._services[name] = self.node.create_client(kind, name)
        self.wait(self._services[name].service_is_ready, f'the service {name}')
        return self._services[name]

    def call(self, kind, name, request):
        """The answer of a service to a ``request`` that does no harm when it is repeated."""
        return self.answer(partial(self.service(kind, name).call_async, request), name)

    def answer(self, ask, name):
        """Result of the future that ``ask`` returns, asked for again where it is lost."""
        asked, begin = [ask()], time.monotonic()

        def answered():
            # A server that has not discovered the reader of its answers yet loses the first.
            if len(asked) == 1 and time.monotonic() > begin + 0.25 * DEADLINE:
                asked.append(ask())
            return any(one.done() for one in asked)

        self.wait(answered, f'an answer of {name}')
        return next(one for one in asked if one.done()).result()

    def change(self, **values):
        """Set parameters of the node together; returns whether it took them, and why not."""
        parameters = [
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
            for name, value in values.items()
        ]
        request = SetParametersAtomically.Request(parameters=parameters)
        name = f'{self.name}/set_parameters_atomically'
        result = self.call(SetParametersAtomically, name, request).result
        return result.successful, result.reason

    def transition(self, number):
        """Ask a managed node for a transition; returns whether it succeeded."""
        name = f'{self.name}/change_state'
        if name not in self._services:
            # A transition that is repeated is refused: its answer must not be the first.
            self.call(ChangeState, name, _transition(NO_TRANSITION))
        return self.call(ChangeState, name, _transition(number)).success

    @property
    def parameters(self):
        """The client of rclpy for the node's parameters, its services ready."""
        if self._parameters is None:
            self._parameters = AsyncParameterClient(self.node, self.name)
        self.wait(self._parameters.services_are_ready, f'the services of {self.name}')
        return self._parameters

    def ask_parameters(self, ask, *arguments):
        """Result of ``ask``, a method of `parameters`."""
        return self.answer(partial(ask, *arguments), self.name)

    def parameter_names(self):
        return sorted(self.ask_parameters(self.parameters.list_parameters).result.names)

    def dump(self):
        """All parameters by name, asked for as `ros2 param dump` does."""
        names = self.parameter_names()
        values = self.ask_parameters(self.parameters.get_parameters, names).values
        return dict(zip(names, map(parameter_value_to_python, values), strict=True))

    def parameter_types(self):
        names = self.parameter_names()
        types = self.ask_parameters(self.parameters.get_parameter_types, names).types
        return dict(zip(names, types, strict=True))

    def status(self, part):
        """A status of ``part`` of the node that began after this call, and its values."""
        name = f'{self.name}: {part}'

        def said():  # Other nodes may report as well.
            return [s for message in self.diagnostics for s in message.status if s.name == name]

        seen = len(said())
        self.wait(lambda: len(said()) > seen + 1, 'a diagnosis')
        status = said()[-1]
        return status, {value.key: value.value for value in status.values}

    def told(self):
        """What all statuses say that were heard."""
        return [status.message for message in self.diagnostics for status in message.status]

    def log(self, *words, again=lambda: None):
        """Wait for a line of the log that has all ``words``, doing something ``again``."""

        def is_logged():
            return any(all(one in log.msg for one in words) for log in self.logs)

        self.wait(is_logged, f'{words} in the log', again)


class NodeClient(RosClient):
    """Publishes tensions and keeps what the node answers.

    Attributes:
        names: of the tendons of the node's arm.
    """

    def __init__(self, domain, node='octo_arm'):
        super().__init__(domain, node)
        self.names = NAMES
        # Deep: a burst does not replace what has not left yet.
        self.publishers = {
            topic: self.node.create_publisher(kind, topic, 1000) for topic, kind in INPUTS.items()
        }
        self.answers = {topic: self.hear(kind, topic) for topic, kind in OUTPUTS.items()}
        self.wrench = self.node.create_publisher(WrenchStamped, 'tip_wrench', 10)
        self.stamps = itertools.count(1)

    def connect(self):
        """Ask until each input reaches the node and each output comes back."""
        for topic in INPUTS:
            self.forget()

            def answered(topic=topic):
                self.send(topic, np.zeros(len(self.names)))
                self.spin(0.1)
                return all(self.answers.values())

            self.wait(answered, f'an answer to {topic}')
            self.settle(topic)
        self.wait(self.wrench.get_subscription_count, 'a subscription to wrenches')

    def settle(self, topic):
        """Leave nothing of ``topic`` under way that a test could take for its answer."""
        mark = np.zeros(len(self.names))
        # In no other message, and exact in single precision as well.
        mark[0] = 2.0**-20 * next(self.stamps)
        self.send(topic, mark)

        def last_is_answered():
            if not self.answers['tendon_lengths']:
                return False
            last = self.answers['tendon_lengths'][-1]
            return last.effort[0] == mark[0] and all(
                got and got[-1].header.stamp == last.header.stamp for got in self.answers.values()
            )

        self.wait(last_is_answered, f'an answer to the last message on {topic}')

    def forget(self):
        for got in self.answers.values():
            got.clear()

    def send(self, topic, tensions, names=None):
        """Publish tensions; returns the seconds of the stamp, None where there is none."""
        message = tensions_message(topic, tensions, self.names if names is None else names)
        second = None
        if hasattr(message, 'header'):
            second = message.header.stamp.sec = next(self.stamps)
            message.header.frame_id = 'of the load cells'
        self.publishers[topic].publish(message)
        return second

    def send_wrench(self, z, frame='arm_base'):
        """Publish a force along z on the tip [N]."""
        message = WrenchStamped()
        message.header.frame_id = frame
        message.wrench.force.z = z
        self.wrench.publish(message)

    def ask(self, topic, tensions, names=None):
        """Publish and wait for the answer on every topic, in the order of OUTPUTS."""
        before = {name: len(got) for name, got in self.answers.items()}
        return self.answered(self.send(topic, tensions, names), topic, before)

    def answered(self, stamp, topic, before=None):
        """Wait for answers with this ``stamp`` [s], or where it is None for more than before."""

        def has_come(name, got):
            if stamp is None:
                return len(got) > before[name]
            return got and got[-1].header.stamp.sec == stamp

        self.wait(lambda: all(has_come(*one) for one in self.answers.items()), f'one to {topic}')
        return [self.answers[name][-1] for name in OUTPUTS]


@contextlib.contextmanager
def running(
    module,
    *arguments,
    files=(CONFIG_FILE,),
    client=NodeClient,
    node='octo_arm',
    domain=None,
    **parameters,
):
    """A node in a domain of its own, or one given, and its client, which has its ``process``.

    Parameters are given by name, with `__` for `.`, beside other ``arguments`` of ROS.
    """
    given = contextlib.nullcontext(domain)
    with reserved_domain() if domain is None else given as domain:
        process = start_node(module, domain, *arguments, files=files, **parameters)
        connected = client(domain, node)
        connected.process = process
        try:
            yield connected
            if process.returncode is None:  # else the test itself has waited for the end
                assert process.poll() is None, process.communicate()[1]
        except BaseException:
            process.kill()
            process.communicate()
            raise
        finally:
            connected.close()
        if process.returncode is None:
            stop(process)


@contextlib.contextmanager
def hosting(
    make_node, *arguments, files=(CONFIG_FILE,), client=None, node=None, domain=None, **parameters
):
    """As `running`, with a node in this process that works while its client waits.

    It costs a tenth of the processor time of a process, which imports everything anew. Of nodes
    of one name in a process only the first is heard in /rosout.
    """
    node = node or _OTHERS.get(make_node, 'octo_arm')
    client = client or (RosClient if make_node in _OTHERS else NodeClient)
    connected, made = client(domain or new_domain(), node), None
    try:
        of_ros = _of_ros(files, ['-r', f'__node:={node}', *arguments], parameters)
        with read_here(of_ros) as cli_args:
            made = make_node(
                context=connected.context, cli_args=cli_args, use_global_arguments=False
            )
        connected.executor.add_node(made)
        yield connected
    finally:
        if made is not None:
            connected.executor.remove_node(made)
            made.destroy_node()
        connected.close()
        # A managed node, whose parts refer to it, frees its publisher of logs no earlier.
        del made
        gc.collect()


@contextlib.contextmanager
def spinning(client):
    """A node that its ``client`` hosts works, whatever is done meanwhile."""
    is_over = threading.Event()

    def spin():
        while not is_over.is_set():
            client.spin()

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


def assert_is_backbone(answers, tensions):
    """Check that the ``answers`` of the node of table 4 are those of the core."""
    path, poses, strains, tip, lengths = answers
    solver = CONFIG.solver(compiled=None)
    expected = solver.solve(tensions)
    assert tip.pose.pose == poses.poses[-1]
    assert lengths.name == NAMES
    np.testing.assert_allclose(
        lengths.position, solver.tendon_lengths(expected).ravel(), rtol=1e-12
    )
    np.testing.assert_array_equal(lengths.effort, np.ravel(tensions))
    assert_hold(path, poses, strains, expected)
    assert {answer.header.frame_id for answer in answers} == {'arm_base'}


def tip_of(answers):
    """Position of the tip (3,) [m] in what `NodeClient.ask` returns."""
    return xyz(answers[3].pose.pose.position)


def file_with(folder, old, new):
    """The parameter file of table 4 with one text replaced."""
    text = CONFIG_FILE.read_text()
    assert old in text
    path = folder / 'changed.yaml'
    path.write_text(text.replace(old, new))
    return path
