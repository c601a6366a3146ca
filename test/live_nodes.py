"""Run nodes as processes or in this one, with clients that communicate over DDS.

Every node has a ROS domain of its own, see `ros_domains`.
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
from ros_domains import new_domain
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from octo_arm_model import load_config, terminal
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.estimator.main import EstimatorNode, ManagedEstimatorNode
from octo_arm_model.ros.node import diagnostics
from octo_arm_model.ros.node.main import ManagedOctoArmNode, OctoArmNode, make_executor
from octo_arm_model.ros.processes import parameter_arguments
from octo_arm_model.ros.simulator.main import SimulatorNode
from octo_arm_model.ros.start import read_here
from octo_arm_model.ros.topics import message_class
from octo_arm_model.wire.tensions import TENSION_TOPICS

# [s] for steps of milliseconds on an idle machine; only a failing test waits so long.
DEADLINE = 120.0
NO_TRANSITION = 200  # number of no transition of managed nodes
PERIOD = 0.02  # [s] between polls of conditions without an executor
CONFIG_FILE = preset_path('renda2012_table4')
CONFIG = load_config(CONFIG_FILE)
NAMES = list(CONFIG.arm.tendon_names)
# Nodes in this process report and warn each 0.2 s instead of each second, to shorten tests.
diagnostics.PERIOD = terminal.WARNING_PERIOD = 0.2
NODES = {'node': OctoArmNode, 'lifecycle': ManagedOctoArmNode, 'simulator': SimulatorNode}
# Names of nodes other than octo_arm.
_OTHERS = {
    SimulatorNode: 'octo_arm_sim',
    EstimatorNode: 'octo_arm_estimator',
    ManagedEstimatorNode: 'octo_arm_estimator',
}
INPUTS = {topic: message_class(kind.type_name) for topic, kind in TENSION_TOPICS.items()}
# Reliable inputs, for tests that count every message.
RELIABLE = {
    f'qos_overrides./{topic}.subscription.reliability': 'reliable'
    for topic in (*INPUTS, 'tip_wrench')
}
# A budget of solves for busy machines, for tests of other things.
AFFORDED = {'solve_budget.seconds': 60.0}
# An arm that moves, strongly damped.
MOVING = {
    'dynamics': True,
    'model': 'exact',
    'material.density': 1080.0,
    'motion.damping_time': 0.3,
    'stations': 21,
    'rate': 20.0,
}
OUTPUTS = {
    'backbone/path': Path,
    'backbone/poses': PoseArray,
    'strains': SectionStrains,
    'tip_pose': PoseWithCovarianceStamped,
    'tendon_lengths': JointState,
}
# Also delivers log messages from before the discovery.
LOG_QOS = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def environment(domain, **more):
    """Return the environment variables of a process in ``domain``."""
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
    """Return a node's arguments: parameter ``files``, others, and parameters with `__` for `.`."""
    file_arguments = [word for file in files for word in ('--params-file', str(file))]
    by_name = {name.replace('__', '.'): value for name, value in parameters.items()}
    return ['--ros-args', *file_arguments, *map(str, arguments), *parameter_arguments(by_name)]


def start_node(module, domain, files=(CONFIG_FILE,), **parameters):
    """Run a node as a process."""
    return start(module, *_of_ros(files, (), parameters), domain=domain)


def stop(process):
    """End a process by Ctrl-C; return its stderr."""
    process.send_signal(signal.SIGINT)
    return check_end(process, 0)


def check_end(process, status):
    """Wait for the end of a process and check its status; return its stderr."""
    _, complaints = process.communicate(timeout=DEADLINE)
    assert process.returncode == status, complaints
    assert 'Traceback' not in complaints, complaints
    return complaints


def tensions_message(topic, tensions, names=NAMES):
    """Return tensions as a message of the type of ``topic``, without a stamp."""
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
    """Return a function that sets the field of a message at a dotted ``path``."""
    *parents, last = path.split('.')

    def change(message):
        for place in parents:
            message = message[int(place)] if place.isdigit() else getattr(message, place)
        if last.isdigit():
            message[int(last)] = value
        else:
            setattr(message, last, value)

    return change


def xyz(point):
    """Return a point or vector of a message as an array (3,)."""
    return np.array([point.x, point.y, point.z])


def spin_until(executor, condition):
    end = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < end, f'it did not happen in {DEADLINE} s'
        executor.spin_once(timeout_sec=0.1)


class RosClient:
    """A ROS node in the domain of the tested node, with helpers of tests."""

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
        """Subscribe to ``topic``; return the list to which messages are appended."""
        messages = []
        self.node.create_subscription(kind, topic, messages.append, qos, **options)
        return messages

    def spin(self, seconds=0.05):
        """Receive messages that have arrived, or wait for the next one."""
        self.executor.spin_once(timeout_sec=seconds)
        # The events executor handles one event per call.
        for _ in range(20):
            self.executor.spin_once(timeout_sec=0.0)

    def wait(self, condition, what, again=lambda: None):
        """Spin and call ``again`` until ``condition`` returns something true, and return that."""
        end = time.monotonic() + DEADLINE
        again()
        while not (result := condition()):
            assert time.monotonic() < end, f'{what} did not happen in {DEADLINE} s'
            self.spin()
            again()
        return result

    def teller(self, kind, topic, qos=10):
        """Return a function that publishes a message, or one with given fields."""
        publisher = self.node.create_publisher(kind, topic, qos)
        return lambda message=None, **fields: publisher.publish(message or kind(**fields))

    def clock(self):
        """Return a function that publishes a simulated time [s, ns]."""
        tell = self.teller(Clock, '/clock')
        return lambda sec, nanosec=0: tell(clock=Time(sec=sec, nanosec=nanosec))

    def service(self, kind, name):
        """Wait for the service ``name`` and return its client."""
        if name not in self._services:
            self._services[name] = self.node.create_client(kind, name)
        self.wait(self._services[name].service_is_ready, f'the service {name}')
        return self._services[name]

    def call(self, kind, name, request):
        """Return the answer of a service to a ``request``, which may be sent twice."""
        return self.answer(partial(self.service(kind, name).call_async, request), name)

    def answer(self, ask, name):
        """Return the result of the future that ``ask`` returns; ask again if it is lost."""
        futures, first_time = [ask()], time.monotonic()

        def answered():
            # A server loses its first answer if it has not discovered the reader yet.
            if len(futures) == 1 and time.monotonic() > first_time + 0.25 * DEADLINE:
                futures.append(ask())
            return any(future.done() for future in futures)

        self.wait(answered, f'an answer of {name}')
        return next(future for future in futures if future.done()).result()

    def change(self, **values):
        """Set parameters of the node together; return whether it accepted them, and the reason."""
        parameters = [
            Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
            for name, value in values.items()
        ]
        request = SetParametersAtomically.Request(parameters=parameters)
        name = f'{self.name}/set_parameters_atomically'
        result = self.call(SetParametersAtomically, name, request).result
        return result.successful, result.reason

    def transition(self, number):
        """Request a transition of a managed node; return whether it succeeded."""
        name = f'{self.name}/change_state'
        if name not in self._services:
            # A repeated transition is refused, so the first, possibly lost answer is another.
            self.call(ChangeState, name, _transition(NO_TRANSITION))
        return self.call(ChangeState, name, _transition(number)).success

    @property
    def parameters(self):
        """Client of rclpy for the node's parameters, whose services are ready."""
        if self._parameters is None:
            self._parameters = AsyncParameterClient(self.node, self.name)
        self.wait(self._parameters.services_are_ready, f'the services of {self.name}')
        return self._parameters

    def ask_parameters(self, ask, *arguments):
        """Return the result of ``ask``, a method of `parameters`."""
        return self.answer(partial(ask, *arguments), self.name)

    def parameter_names(self):
        return sorted(self.ask_parameters(self.parameters.list_parameters).result.names)

    def dump(self):
        """Return all parameters by name, requested as by `ros2 param dump`."""
        names = self.parameter_names()
        values = self.ask_parameters(self.parameters.get_parameters, names).values
        return dict(zip(names, map(parameter_value_to_python, values), strict=True))

    def parameter_types(self):
        names = self.parameter_names()
        types = self.ask_parameters(self.parameters.get_parameter_types, names).types
        return dict(zip(names, types, strict=True))

    def status(self, part):
        """Return a status of ``part`` of the node from after this call, and its values."""
        name = f'{self.name}: {part}'

        def statuses():  # Other nodes may report as well.
            return [s for message in self.diagnostics for s in message.status if s.name == name]

        count = len(statuses())
        self.wait(lambda: len(statuses()) > count + 1, 'a diagnostic message')
        status = statuses()[-1]
        return status, {value.key: value.value for value in status.values}

    def told(self):
        """Return the messages of all statuses received."""
        return [status.message for message in self.diagnostics for status in message.status]

    def log(self, *words, again=lambda: None):
        """Wait for a line of the log with all ``words``, and call ``again`` meanwhile."""

        def is_logged():
            return any(all(word in log.msg for word in words) for log in self.logs)

        self.wait(is_logged, f'{words} in the log', again)


class NodeClient(RosClient):
    """Publishes tensions and stores the node's answers.

    Attributes:
        names: names of the tendons of the node's arm.
    """

    def __init__(self, domain, node='octo_arm'):
        super().__init__(domain, node)
        self.names = NAMES
        # A deep queue, so that a burst replaces no message that is not sent yet.
        self.publishers = {
            topic: self.node.create_publisher(kind, topic, 1000) for topic, kind in INPUTS.items()
        }
        self.answers = {topic: self.hear(kind, topic) for topic, kind in OUTPUTS.items()}
        self.wrench = self.node.create_publisher(WrenchStamped, 'tip_wrench', 10)
        self.stamps = itertools.count(1)

    def connect(self):
        """Publish until each input reaches the node and each output comes back."""
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
        """Wait until no answer to an earlier message on ``topic`` is under way."""
        mark = np.zeros(len(self.names))
        # A tension of no other message, exact in single precision too.
        mark[0] = 2.0**-20 * next(self.stamps)
        self.send(topic, mark)

        def last_is_answered():
            if not self.answers['tendon_lengths']:
                return False
            last = self.answers['tendon_lengths'][-1]
            return last.effort[0] == mark[0] and all(
                messages and messages[-1].header.stamp == last.header.stamp
                for messages in self.answers.values()
            )

        self.wait(last_is_answered, f'an answer to the last message on {topic}')

    def forget(self):
        for messages in self.answers.values():
            messages.clear()

    def send(self, topic, tensions, names=None):
        """Publish tensions; return the seconds of the stamp, None without a header."""
        message = tensions_message(topic, tensions, self.names if names is None else names)
        second = None
        if hasattr(message, 'header'):
            second = message.header.stamp.sec = next(self.stamps)
            message.header.frame_id = 'load_cells'
        self.publishers[topic].publish(message)
        return second

    def send_wrench(self, z, frame='arm_base'):
        """Publish a force ``z`` along z on the tip [N]."""
        message = WrenchStamped()
        message.header.frame_id = frame
        message.wrench.force.z = z
        self.wrench.publish(message)

    def ask(self, topic, tensions, names=None):
        """Publish tensions and wait for the answers, in the order of OUTPUTS."""
        before = {name: len(messages) for name, messages in self.answers.items()}
        return self.answered(self.send(topic, tensions, names), topic, before)

    def answered(self, stamp, topic, before=None):
        """Wait for answers with the ``stamp`` [s], or if it is None, for more than ``before``."""

        def has_come(name, messages):
            if stamp is None:
                return len(messages) > before[name]
            return messages and messages[-1].header.stamp.sec == stamp

        self.wait(lambda: all(has_come(*item) for item in self.answers.items()), f'one to {topic}')
        return [self.answers[name][-1] for name in OUTPUTS]


@contextlib.contextmanager
def running(module, files=(CONFIG_FILE,), client=NodeClient, node='octo_arm', **parameters):
    """Run a node in a domain of its own; its client has the ``process``.

    Parameters are given by name with `__` for `.`.
    """
    domain = new_domain()
    process = start_node(module, domain, files=files, **parameters)
    connected = client(domain, node)
    connected.process = process
    try:
        yield connected
        if process.returncode is None:  # otherwise the test has waited for the end
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
    """Run a node in this process, which works while its client waits; otherwise like `running`.

    Other ``arguments`` are those of ROS, ``domain`` is a given one. It takes a tenth of the
    processor time of a new process, which imports all modules again. In a process only the first
    node of a name publishes to /rosout.
    """
    node = node or _OTHERS.get(make_node, 'octo_arm')
    client = client or (RosClient if make_node in _OTHERS else NodeClient)
    connected, hosted = client(domain or new_domain(), node), None
    try:
        of_ros = _of_ros(files, ['-r', f'__node:={node}', *arguments], parameters)
        with read_here(of_ros) as cli_args:
            hosted = make_node(
                context=connected.context, cli_args=cli_args, use_global_arguments=False
            )
        connected.executor.add_node(hosted)
        yield connected
    finally:
        if hosted is not None:
            connected.executor.remove_node(hosted)
            hosted.destroy_node()
        connected.close()
        # Reference cycles keep a managed node, and with it its publisher of logs, alive.
        del hosted
        gc.collect()


@contextlib.contextmanager
def spinning(client):
    """Spin ``client``, and with it a node of `hosting`, in another thread."""
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
    """Check that the ``answers`` of the node of table 4 have the results of the solver."""
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
    """Return the position of the tip (3,) [m] in ``answers`` of `NodeClient.ask`."""
    return xyz(answers[3].pose.pose.position)


def file_with(folder, old, new):
    """Write the parameter file of table 4 with one text replaced."""
    text = CONFIG_FILE.read_text()
    assert old in text
    path = folder / 'changed.yaml'
    path.write_text(text.replace(old, new))
    return path
