"""Measure the processor time of the estimator's node for each kind of measurement.

The arm is the prototype of the paper. The estimator has all unknowns (tensions, biases, force and
moment on the tip) and all measurements: tensions, displacements, pose of the tip, two markers and
the wrench under the base. Each node is a process of its own and receives one message at a time
over DDS; the next message is sent after the estimate for the last. Ratios are to `octo_arm_node`
of the same arm, in processor time, which a busy machine changes little. The goal is 200 estimates
per second on one core.

    python benchmarks/estimator_node.py [--brief]
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from brief import IS_BRIEF, make_parser
from geometry_msgs.msg import Point, Pose, PoseArray, PoseWithCovarianceStamped, WrenchStamped
from node import Participant, new_domain, processor_time, running
from octo_arm_msgs.msg import TendonTensions
from sensor_msgs.msg import JointState

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.topics import message_class, pose_message
from octo_arm_model.wire.estimate import ESTIMATES

FILE = preset_path('renda2012_prototype')
CONFIG = load_config(FILE)
STATIONS = 31
CYCLES = 2 if IS_BRIEF else 200
PERIOD = 5e-3  # [s] between measurements of one kind
COMMON = [
    '--ros-args',
    '--log-level',
    'error',
    '--params-file',
    str(FILE),
    '-p',
    f'stations:={STATIONS}',
    '-p',
    'model:=exact',
    '-p',
    'tension_stddev:=0.01',
]
UNKNOWN = [
    'estimator.tension_rate:=1.0',
    'estimator.tension_bias_stddev:=0.05',
    'estimator.tension_bias_rate:=0.01',
    'estimator.moment_stddev:=0.0001',
    'estimator.marker_s:=[0.09, 0.18]',
    'estimator.marker_stddev:=0.0005',
    'estimator.base_force_stddev:=0.002',
    'estimator.base_moment_stddev:=0.0002',
]
NODES = {
    'octo_arm_node': ['-m', 'octo_arm_model.ros.node.main', *COMMON],
    'octo_arm_estimator': [
        '-m',
        'octo_arm_model.ros.estimator.main',
        *COMMON,
        *(word for parameter in UNKNOWN for word in ('-p', parameter)),
    ],
}
KINDS: dict[str, Any] = {
    'tendon_tensions': TendonTensions,
    'tendon_displacements': JointState,
    'measured/tip_pose': PoseWithCovarianceStamped,
    'measured/markers': PoseArray,
    'measured/base_wrench': WrenchStamped,
}


class Client(Participant):
    """Publishes measurements to a node and waits for its estimates."""

    def __init__(self, domain: int) -> None:
        """Join the ``domain`` of a node."""
        super().__init__(domain)
        self._publishers = {
            topic: self.node.create_publisher(kind, topic, 10) for topic, kind in KINDS.items()
        }
        self._answers: list[bytes] = []
        subscribe = partial(self.node.create_subscription, raw=True)
        subscribe(PoseArray, 'backbone/poses', self._answers.append, 100)
        # The node computes only outputs that somebody subscribes to.
        for topic, kind in ESTIMATES.items():
            subscribe(message_class(kind), topic, lambda message: None, 100)
        self._solver = CONFIG.solver('exact', STATIONS)
        self._random, self._number = np.random.default_rng(1), 0

    def wait_for_node(self) -> None:
        """Publish tensions until the node answers."""
        self.wait(
            lambda: bool(self._answers),
            'an answer of the node',
            lambda: self._send('tendon_tensions'),
        )
        while self._spin(0.5):
            pass

    def measure_once(self, topic: str) -> None:
        """Publish one measurement of a ``topic`` and wait for the estimate."""
        self._answers.clear()
        self._send(topic)
        self.wait(lambda: bool(self._answers), f'an answer to {topic}')

    def _spin(self, seconds: float) -> bool:
        count = len(self._answers)
        self.executor.spin_once(timeout_sec=seconds)
        return len(self._answers) > count

    def _send(self, topic: str) -> None:
        self._number += 1
        time_ns = 10**12 + round(1e9 * PERIOD / len(KINDS) * self._number)
        tensions = 1.0 + 0.3 * np.sin(1e-9 * time_ns + np.arange(4.0))
        force = np.array([0.0, 0.004, 0.006]) * np.sin(2e-9 * time_ns)
        shape = self._solver.solve([tensions], np.append(force, np.zeros(3)))
        noise = self._random.standard_normal
        message = KINDS[topic]()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(time_ns, 10**9)
        if topic == 'tendon_tensions':
            message.name = list(CONFIG.arm.tendon_names)
            message.tension = tensions + 0.01 * noise(4)
        elif topic == 'tendon_displacements':
            displacement = self._solver.rest_lengths - self._solver.tendon_lengths(shape)
            message.name = list(CONFIG.arm.tendon_names)
            message.position = displacement.ravel() + 2e-4 * noise(4)
        elif topic == 'measured/tip_pose':
            message.pose.pose = pose_message(shape.tip + 5e-4 * noise(3), shape.quaternion[-1])
            message.pose.covariance = np.diag([2.5e-7] * 3 + [4e-4] * 3).ravel()
        elif topic == 'measured/markers':
            for s in (0.09, 0.18):
                x, y, z = (float(np.interp(s, shape.s, axis)) for axis in shape.position.T)
                message.poses.append(Pose(position=Point(x=x, y=y, z=z)))
        else:
            moment = np.cross(shape.tip, force) + 2e-4 * noise(3)
            read = force + 2e-3 * noise(3)
            for field, values in ((message.wrench.force, read), (message.wrench.torque, moment)):
                field.x, field.y, field.z = values.tolist()
        self._publishers[topic].publish(message)


def measure(name: str, domain: int) -> Iterator[tuple[str, float, float]]:
    """Yield each topic with the processor time [s] and the time to the answer [s] of a message."""
    topics = list(KINDS) if name == 'octo_arm_estimator' else ['tendon_tensions']
    with running(NODES[name], domain) as process, contextlib.closing(Client(domain)) as client:
        client.wait_for_node()
        for topic in [*topics, 'all in turn'] if len(topics) > 1 else topics:
            cycle = topics if topic not in KINDS else [topic]
            for each in cycle:
                client.measure_once(each)
            cpu_before, start = processor_time(process.pid), time.perf_counter()
            for _ in range(CYCLES):
                for each in cycle:
                    client.measure_once(each)
            count = CYCLES * len(cycle)
            elapsed = time.perf_counter() - start
            yield topic, (processor_time(process.pid) - cpu_before) / count, elapsed / count


def main() -> None:
    """Print a row for each node and measurement."""
    make_parser(__doc__).parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    print(f'{STATIONS} stations, covariance at each; one message at a time')
    print(
        f'{"node":20}{"measurement":24}{"CPU ms":>9}{"latency ms":>12}'
        f'{"estimates/s of a core":>24}{"x node":>9}'
    )
    node_cpu = 0.0
    for name in NODES:
        for topic, cpu, latency in measure(name, new_domain()):
            node_cpu = node_cpu or cpu
            rate = 1.0 / max(cpu, 1e-9)
            print(
                f'{name:20}{topic:24}{1e3 * cpu:9.2f}{1e3 * latency:12.2f}{rate:24.0f}'
                f'{cpu / max(node_cpu, 1e-9):9.1f}'
            )


if __name__ == '__main__':
    main()
