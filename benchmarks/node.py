"""Compare latency and rate of the node with three simpler nodes.

Each node is a process of its own, which the same client measures over DDS:

* floor: publishes prepared messages, which takes the least time that rclpy and DDS need;
* plain: publishes prepared messages with the executor of `rclpy.spin`;
* naive: solves and builds message objects with the executor of `rclpy.spin`;
* ours: `octo_arm_node`;
* air: `octo_arm_node` with the arm's weight and the model exact;
* air, cov: air with the pose of the tip and its covariance.

The client publishes ``tendon_tensions`` and subscribes to ``backbone/path``, ``backbone/poses``
and ``strains``, for the last node also to ``tip_pose``, because nodes compute only outputs that
somebody subscribes to. Tensions vary by 10 % about those of fetching, by 1 % per question, with
increasing stamps. Latency is the time until all outputs have arrived, one question at a time; the
rate counts answers on ``backbone/poses``. Nodes are measured in turns, and the best turn of each
node counts, because other programs use the machine. The processor time per answer, which includes
the threads of DDS, depends least on them.

    python benchmarks/node.py [--brief]
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import rclpy
from brief import IS_BRIEF, make_parser
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import Path
from octo_arm_msgs.msg import SectionStrains, TendonTensions
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.subscription import Subscription

from octo_arm_model import load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.node import main as our_node
from octo_arm_model.wire.tensions import TENDON_TENSIONS

sys.path.insert(0, os.path.join(os.path.dirname(__file__), '..', 'test'))
from backbone_messages import messages_of
from ros_domains import new_domain

# BLAS uses one thread in the nodes, as in the programs of the package.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
CONFIG_FILE = preset_path('renda2012_table4')
CONFIG = load_config(CONFIG_FILE)
QUIET = ['--ros-args', '--log-level', 'warn']
OURS = ['-m', 'octo_arm_model.ros.node.main', *QUIET, '--params-file', str(CONFIG_FILE)]
IN_AIR = [
    '-p',
    'model:=exact',
    '-p',
    'material.density:=1080.0',
    '-p',
    'loads.gravity:=[0.0, 0.0, -9.81]',
]
UNCERTAIN = ['-p', 'tension_stddev:=0.02', '-p', 'material.youngs_modulus_stddev:=0.05']
COMMANDS = {
    'floor': [__file__, 'floor'],
    'plain': [__file__, 'plain'],
    'naive': [__file__, 'naive'],
    'ours': OURS,
    'air': OURS + IN_AIR,
    'air, cov': OURS + IN_AIR + UNCERTAIN,
}
OTHERS = ('floor', 'plain', 'naive')
TURNS = 1 if IS_BRIEF else 3
QUESTIONS = 20 if IS_BRIEF else 1000
LONGEST_LOOP = 4.0  # [s] of questions, one at a time
RATES = (250, 500, 1000, 2000, 3000, 4000, 5000, 6500, 8000, 10000, 12000)  # [Hz]
MOST_RATES = 1 if IS_BRIEF else len(RATES)
BURST = 0.2 if IS_BRIEF else 1.0  # [s] at each rate
RISE = 1.03  # ratio of answers; two rates in a row below it end the search for the highest rate
DEADLINE = 120.0  # [s] for a node to start or answer on a busy machine
OUTPUTS = {'backbone/path': Path, 'backbone/poses': PoseArray, 'strains': SectionStrains}
MORE: dict[str, dict[str, Any]] = {'air, cov': {'tip_pose': PoseWithCovarianceStamped}}
PERIOD = 63  # questions after which the tensions repeat
INPUT_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
OUTPUT_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)


def question(number: int) -> bytes:
    """Return serialised tensions, stamped with ``number`` nanoseconds."""
    message = TendonTensions(name=list(CONFIG.arm.tendon_names))
    # Tensions change, so that the node cannot reuse its last solution.
    phase = 2.0 * np.pi * number / PERIOD
    message.tension = (1.0 + 0.1 * np.sin(phase)) * np.ravel(FETCHING_IN_SPACE)
    message.header.stamp.sec, message.header.stamp.nanosec = 1, number
    return serialize_message(message)


def with_stamp(question: bytes, number: int) -> bytes:
    """Return a serialised ``question`` with the stamp of another ``number``."""
    return question[:8] + number.to_bytes(4, 'little') + question[12:]


def stamp_of(answer: bytes) -> int:
    """Return the nanoseconds of the stamp in a serialised message with a header."""
    return int.from_bytes(answer[8:12], 'little')


def run_other_node(kind: str) -> None:
    """Run the node floor, plain or naive until it is interrupted."""
    rclpy.init()
    node = Node(kind)
    publishers = [node.create_publisher(type_, to, OUTPUT_QOS) for to, type_ in OUTPUTS.items()]
    solver = CONFIG.solver()

    def solve(message: TendonTensions) -> tuple[Path, PoseArray, SectionStrains]:
        backbone = solver.solve(TENDON_TENSIONS.read(message, CONFIG.arm))
        return messages_of(backbone, message.header.stamp, CONFIG.base_frame)

    names, values = list(CONFIG.arm.tendon_names), np.ravel(FETCHING_IN_SPACE)
    prebuilt = [serialize_message(m) for m in solve(TendonTensions(name=names, tension=values))]

    def answer(message: TendonTensions) -> None:
        for publisher, data in zip(publishers, solve(message) if kind == 'naive' else prebuilt):
            publisher.publish(data)

    node.create_subscription(TendonTensions, 'tendon_tensions', answer, INPUT_QOS)
    executor = our_node.make_executor() if kind == 'floor' else SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.5)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass


class Result(NamedTuple):
    """Results of a node.

    Attributes:
        median: median latency [s].
        percentile_99: 99th percentile of the latency [s].
        cpu: processor time of the node per question [s].
        answered: highest rate of answers [Hz].
        asked: rate of questions with the highest rate of answers [Hz].
    """

    median: float
    percentile_99: float
    cpu: float
    answered: float
    asked: int

    @classmethod
    def best(cls, turns: Sequence[Result]) -> Result:
        """Return the best of each number, with both rates from the same turn."""
        fastest = max(turns, key=lambda turn: turn.answered)
        median, percentile_99, cpu = (min(turn[i] for turn in turns) for i in range(3))
        return cls(median, percentile_99, cpu, fastest.answered, fastest.asked)


def processor_time(process: int) -> float:
    """Return the processor time that a ``process`` has used [s]."""
    with open(f'/proc/{process}/stat') as file:
        fields = file.read().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def megabytes(process: int) -> float:
    """Return the resident memory of a ``process`` [MB]."""
    with open(f'/proc/{process}/status') as file:
        size = next(line for line in file if line.startswith('VmRSS:'))
    return float(size.split()[1]) / 1024.0


def environment_in(domain: int) -> dict[str, str]:
    """Return the environment variables of a process in ``domain``."""
    ours = {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    return os.environ | ours


def take(subscription: Subscription) -> bytes | None:
    """Return the next message that has arrived, or None."""
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, True)
    return None if taken is None else taken[0]


class Participant:
    """A node of this process in the domain of the measured node."""

    def __init__(
        self,
        domain: int,
        executor: Callable[[rclpy.Context], Executor] | None = None,
        namespace: str = '',
    ) -> None:
        """Join a ``domain`` in a ``namespace``, by default with an ``executor`` of one thread."""
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node('client', context=self.context, namespace=namespace)
        make = executor or (lambda context: SingleThreadedExecutor(context=context))
        self.executor = make(self.context)
        self.executor.add_node(self.node)

    def close(self) -> None:
        """Destroy the node and its context."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def wait(
        self,
        is_met: Callable[[], object],
        what: str,
        meanwhile: Callable[[], object] = lambda: None,
        deadline: float = DEADLINE,
    ) -> None:
        """Spin until a condition is met, and call ``meanwhile`` before every spin.

        Raises:
            RuntimeError: if ``what`` does not happen before the ``deadline`` [s].
        """
        end = time.monotonic() + deadline
        while not is_met():
            meanwhile()
            if time.monotonic() > end:
                raise RuntimeError(f'{what} did not happen in {deadline:g} s')
            self.executor.spin_once(timeout_sec=0.05)


class Client(Participant):
    """Publishes tensions to a node and receives its answers."""

    def __init__(self, domain: int, more: Mapping[str, Any] = {}) -> None:
        """Wait until the node in ``domain`` answers, on ``more`` topics besides `OUTPUTS`."""
        super().__init__(domain)
        # In bursts the client takes nothing from these subscriptions: they cost only transport.
        self._unread = Node('unread', context=self.context)
        self._publisher = self.node.create_publisher(TendonTensions, 'tendon_tensions', 10)
        self._answers: list[bytes] = []
        self._number = 0  # number of the last question
        self._poses = self.node.create_subscription(
            PoseArray, 'backbone/poses', self._answers.append, 1000, raw=True
        )
        self._others = [
            self._unread.create_subscription(kind, topic, print, 1, raw=True)
            for topic, kind in {**OUTPUTS, **more}.items()
            if kind is not PoseArray
        ]

        self.wait(
            lambda: bool(self._answers) and all(it.get_publisher_count() for it in self._others),
            'an answer of the node',
            lambda: self._publisher.publish(question(0)),
        )
        self._drain(0.5)

    def close(self) -> None:
        """Destroy both nodes and their context."""
        self._unread.destroy_node()
        super().close()

    def measure_latencies(self, are_stamped: bool) -> np.ndarray:
        """Return latencies of single questions [s]; check the stamps of answers that have them."""
        latencies, end = [], time.monotonic() + LONGEST_LOOP
        for number in range(1, QUESTIONS + 1):
            if time.monotonic() > end:
                break
            asked, self._number = question(number), number
            self._answers.clear()
            for other in self._others:
                take(other)  # an older answer; the queue has a depth of one
            start = time.perf_counter()
            self._publisher.publish(asked)
            while not self._answers:
                self._check_deadline(start, number)
                self.executor.spin_once(timeout_sec=1.0)
            answers = []
            for other in self._others:
                while (answer := take(other)) is None:
                    self._check_deadline(start, number)
                answers.append(answer)
            latencies.append(time.perf_counter() - start)
            stamps = [stamp_of(answer) for answer in (*self._answers, *answers)]
            if are_stamped and stamps != [number] * len(stamps):
                raise SystemExit(f'question {number} was answered with another stamp')
        return np.array(latencies)

    @staticmethod
    def _check_deadline(start: float, number: int) -> None:
        if time.perf_counter() - start > DEADLINE:
            raise SystemExit(f'question {number} was not answered within {DEADLINE:g} s')

    def find_highest_rate(self) -> tuple[float, int]:
        """Return the highest rate of answers, and the rate of questions that led to it [Hz]."""
        best, best_rate, failures = 0.0, 0, 0
        for rate in RATES[:MOST_RATES]:
            answered = self._burst(rate)
            failures = 0 if answered > RISE * best else failures + 1
            best, best_rate = max((best, best_rate), (answered, rate))
            if failures == 2:
                break
        return best, best_rate

    def _burst(self, rate: int) -> float:
        questions = [question(number) for number in range(PERIOD)]
        answered = sent = 0
        start = time.perf_counter()
        while (elapsed := time.perf_counter() - start) < BURST:
            for _ in range(int(elapsed * rate) + 1 - sent):
                self._number += 1
                asked = with_stamp(questions[self._number % PERIOD], self._number)
                self._publisher.publish(asked)
                sent += 1
            answered += self._take()
            time.sleep(max(0.0, start + sent / rate - time.perf_counter()))
        answered += self._take()
        duration = time.perf_counter() - start
        self._drain(0.3)
        return answered / duration

    def _take(self) -> int:
        """Take all answers that have arrived, without an executor, which would cost more."""
        count = 0
        while take(self._poses) is not None:
            count += 1
        return count

    def _drain(self, quiet: float) -> None:
        """Take answers until none has arrived for ``quiet`` [s]."""
        time.sleep(quiet)
        while self._take():
            time.sleep(quiet)
        self._answers.clear()


@contextlib.contextmanager
def running(arguments: Sequence[str], domain: int) -> Iterator[subprocess.Popen[bytes]]:
    """Run a node in ``domain`` as a Python process with ``arguments``."""
    process = subprocess.Popen([sys.executable, *arguments], env=environment_in(domain))
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            process.kill()


def measure(kind: str, domain: int) -> Result:
    """Start a node of `COMMANDS`, measure it and stop it."""
    with (
        running(COMMANDS[kind], domain) as process,
        contextlib.closing(Client(domain, MORE.get(kind, {}))) as client,
    ):
        cpu_before = processor_time(process.pid)
        latencies = client.measure_latencies(are_stamped=kind not in ('floor', 'plain'))
        cpu = (processor_time(process.pid) - cpu_before) / latencies.size
        median, percentile_99 = np.median(latencies), np.percentile(latencies, 99)
        return Result(float(median), float(percentile_99), cpu, *client.find_highest_rate())


def main() -> None:
    """Print a row for each node."""
    make_parser(__doc__).parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    turns = [{kind: measure(kind, new_domain()) for kind in COMMANDS} for _ in range(TURNS)]
    results = {kind: Result.best([turn[kind] for turn in turns]) for kind in COMMANDS}
    print(f'{CONFIG.stations} stations, {CONFIG.model}; one question at a time, and highest rates')
    ratios = ''.join(f'{f"x {other}":>9}' for other in OTHERS)
    print(
        f'{"node":9}{"median ms":>11}{"99 % < ms":>11}{ratios}{"CPU ms":>9}'
        f'{"answers/s":>12}{"asked/s":>9}{ratios}'
    )
    for kind, result in results.items():
        latencies = ''.join(f'{result.median / results[other].median:9.2f}' for other in OTHERS)
        rates = ''.join(f'{result.answered / results[other].answered:9.2f}' for other in OTHERS)
        print(
            f'{kind:9}{result.median * 1e3:11.3f}{result.percentile_99 * 1e3:11.3f}{latencies}'
            f'{result.cpu * 1e3:9.3f}{result.answered:12.0f}{result.asked:9}{rates}'
        )


if __name__ == '__main__':
    if sys.argv[1:2] and sys.argv[1] in OTHERS:
        run_other_node(sys.argv[1])
    else:
        main()
