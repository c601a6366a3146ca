"""What the estimator's node spends on each kind of measurement, against the node of the same arm.

The prototype of the paper, with everything unknown that it estimates (tensions, biases, force and
moment on the tip) and everything measured: tensions, displacements, pose of the tip, two markers
and the wrench under the base. Every node is a process of its own, told one message at a time over
DDS; the next comes when the estimate of the last is there. What the processor spends counts, not
what a busy machine makes of it. Wanted: 200 estimates a second on one core.

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
        *(word for given in UNKNOWN for word in ('-p', given)),
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
    """Tells a node what is measured, and waits for what it makes of it."""

    def __init__(self, domain: int) -> None:
        """In a ``domain`` in which a node is started."""
        super().__init__(domain)
        self._publishers = {
            topic: self.node.create_publisher(kind, topic, 10) for topic, kind in KINDS.items()
        }
        self._answers: list[bytes] = []
        hear = partial(self.node.create_subscription, raw=True)
        hear(PoseArray, 'backbone/poses', self._answers.append, 100)
        # What nobody hears is not made.
        for topic, kind in ESTIMATES.items():
            hear(message_class(kind), topic, lambda message: None, 100)
        self._solver = CONFIG.solver('exact', STATIONS)
        self._random, self._number = np.random.default_rng(1), 0

    def connect(self) -> None:
        """Wait until the node answers."""
        self.wait(
            lambda: bool(self._answers),
            'an answer of the node',
            lambda: self._send('tendon_tensions'),
        )
        while self._spin(0.5):
            pass

    def tell(self, topic: str) -> None:
        """Tell of one measurement, and wait for the estimate."""
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
            drawn_in = self._solver.rest_lengths - self._solver.tendon_lengths(shape)
            message.name = list(CONFIG.arm.tendon_names)
            message.position = drawn_in.ravel() + 2e-4 * noise(4)
        elif topic == 'measured/tip_pose':
            message.pose.pose = pose_message(shape.tip + 5e-4 * noise(3), shape.quaternion[-1])
            message.pose.covariance = np.diag([2.5e-7] * 3 + [4e-4] * 3).ravel()
        elif topic == 'measured/markers':
            for place in (0.09, 0.18):
                x, y, z = (float(np.interp(place, shape.s, axis)) for axis in shape.position.T)
                message.poses.append(Pose(position=Point(x=x, y=y, z=z)))
        else:
            moment = np.cross(shape.tip, force) + 2e-4 * noise(3)
            read = force + 2e-3 * noise(3)
            for part, values in ((message.wrench.force, read), (message.wrench.torque, moment)):
                part.x, part.y, part.z = values.tolist()
        self._publishers[topic].publish(message)


def measure(name: str, domain: int) -> Iterator[tuple[str, float, float]]:
    """Topic, processor time [s] and time to the answer [s] of every kind of measurement."""
    topics = list(KINDS) if name == 'octo_arm_estimator' else ['tendon_tensions']
    with running(NODES[name], domain) as process, contextlib.closing(Client(domain)) as client:
        client.connect()
        for topic in [*topics, 'all in turn'] if len(topics) > 1 else topics:
            told = topics if topic not in KINDS else [topic]
            for one in told:
                client.tell(one)
            before, start = processor_time(process.pid), time.perf_counter()
            for _ in range(CYCLES):
                for one in told:
                    client.tell(one)
            count = CYCLES * len(told)
            took = time.perf_counter() - start
            yield topic, (processor_time(process.pid) - before) / count, took / count


def main() -> None:
    """Print the table."""
    make_parser(__doc__).parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    print(f'{STATIONS} stations, covariance at every one; one message at a time')
    print(
        f'{"node":20}{"told":24}{"CPU ms":>9}{"ms":>9}{"estimates/s of one core":>26}{"x node":>9}'
    )
    node = 0.0
    for name in NODES:
        for topic, spent, took in measure(name, new_domain()):
            node = node or spent
            rate = 1.0 / max(spent, 1e-9)
            print(
                f'{name:20}{topic:24}{1e3 * spent:9.2f}{1e3 * took:9.2f}{rate:26.0f}'
                f'{spent / max(node, 1e-9):9.1f}'
            )


if __name__ == '__main__':
    main()
