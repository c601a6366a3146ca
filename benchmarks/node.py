"""Latency and rate of the node against three other nodes, down to ROS itself.

Every node is a process of its own, asked over DDS by the same client, one after the other:

* floor: answers with messages made beforehand, what rclpy and DDS take at least;
* plain: the same with rclpy's own executor, as `rclpy.spin` has it;
* naive: solves and builds message objects under rclpy's own executor, as one would write it;
* ours: `octo_arm_node`;
* air: the same arm under its weight, `exact`;
* air, cov: with the pose of its tip and the covariance of that as well.

All are asked on ``tendon_tensions`` and heard on ``backbone/path``, ``backbone/poses`` and
``strains``, the last one on ``tip_pose`` as well: what nobody hears is not made. Tensions vary
about those of fetching by a tenth, by a percent from one question to the next, and their stamps
increase. One by one, an answer is there when all are; as many as they come, those on
``backbone/poses`` are counted. They take turns, and of every node its best turn counts, so that
whatever else the machine does is no node's own. What the processor spends on an answer, one by
one, depends least on that; it holds the threads of DDS as well.

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

# The nodes have one thread of BLAS, as the programs of the package set it.
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
LONGEST_LOOP = 4.0  # [s] of questions one by one
RATES = (250, 500, 1000, 2000, 3000, 4000, 5000, 6500, 8000, 10000, 12000)  # [Hz]
MOST_RATES = 1 if IS_BRIEF else len(RATES)
BURST = 0.2 if IS_BRIEF else 1.0  # [s] at each rate
RISE = 1.03  # what one of the next two higher rates has to bring for more to be tried
DEADLINE = 120.0  # [s] for a node to start or answer, as it may on a busy machine
OUTPUTS = {'backbone/path': Path, 'backbone/poses': PoseArray, 'strains': SectionStrains}
MORE: dict[str, dict[str, Any]] = {'air, cov': {'tip_pose': PoseWithCovarianceStamped}}
PERIOD = 63  # questions, after which the tensions are the same
INPUT_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
OUTPUT_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.RELIABLE)


def question(number: int) -> bytes:
    """Tensions, stamped with the ``number`` of the question as its nanoseconds."""
    message = TendonTensions(name=list(CONFIG.arm.tendon_names))
    # The tensions change, so that no answer can be reused.
    phase = 2.0 * np.pi * number / PERIOD
    message.tension = (1.0 + 0.1 * np.sin(phase)) * np.ravel(FETCHING_IN_SPACE)
    message.header.stamp.sec, message.header.stamp.nanosec = 1, number
    return serialize_message(message)


def stamped(question: bytes, number: int) -> bytes:
    """A serialised ``question`` with the stamp of that ``number``."""
    return question[:8] + number.to_bytes(4, 'little') + question[12:]


def stamp_of(answer: bytes) -> int:
    """Nanoseconds of a serialised message, which begins with a header."""
    return int.from_bytes(answer[8:12], 'little')


def answer_for_ever(kind: str) -> None:
    """Run the node ``kind``, floor, plain or naive, until interrupted."""
    rclpy.init()
    node = Node(kind)
    publishers = [node.create_publisher(of, to, OUTPUT_QOS) for to, of in OUTPUTS.items()]
    solver = CONFIG.solver()

    def solved(message: TendonTensions) -> tuple[Path, PoseArray, SectionStrains]:
        backbone = solver.solve(TENDON_TENSIONS.read(message, CONFIG.arm))
        return messages_of(backbone, message.header.stamp, CONFIG.base_frame)

    names, values = list(CONFIG.arm.tendon_names), np.ravel(FETCHING_IN_SPACE)
    prebuilt = [serialize_message(m) for m in solved(TendonTensions(name=names, tension=values))]

    def answer(message: TendonTensions) -> None:
        for publisher, made in zip(publishers, solved(message) if kind == 'naive' else prebuilt):
            publisher.publish(made)

    node.create_subscription(TendonTensions, 'tendon_tensions', answer, INPUT_QOS)
    executor = our_node.make_executor() if kind == 'floor' else SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.5)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass


class Measured(NamedTuple):
    """Measurements of a node.

    Attributes:
        median: latency of questions one by one [s].
        worst: the latency that 99 % of them stay below [s].
        spent: processor time of the node on one of them [s].
        answered: the most answers in a second [Hz].
        asked: the rate of questions that took [Hz].
    """

    median: float
    worst: float
    spent: float
    answered: float
    asked: int

    @classmethod
    def best(cls, turns: Sequence[Measured]) -> Measured:
        """The best of every number; the rates belong together."""
        quickest = max(turns, key=lambda turn: turn.answered)
        median, worst, spent = (min(turn[i] for turn in turns) for i in range(3))
        return cls(median, worst, spent, quickest.answered, quickest.asked)


def processor_time(process: int) -> float:
    """Processor time of a ``process`` so far [s]."""
    with open(f'/proc/{process}/stat') as file:
        fields = file.read().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def megabytes(process: int) -> float:
    """Memory of a ``process`` [MB]."""
    with open(f'/proc/{process}/status') as file:
        size = next(line for line in file if line.startswith('VmRSS:'))
    return float(size.split()[1]) / 1024.0


def environment_in(domain: int) -> dict[str, str]:
    """Variables of a process in ``domain``."""
    ours = {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    return os.environ | ours


def take(subscription: Subscription) -> bytes | None:
    """The next message there is."""
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, True)
    return None if taken is None else taken[0]


class Participant:
    """A node in the domain of the one that is measured."""

    def __init__(
        self,
        domain: int,
        executor: Callable[[rclpy.Context], Executor] | None = None,
        namespace: str = '',
    ) -> None:
        """In ``domain`` and ``namespace``, with an ``executor`` of one thread by default."""
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node('client', context=self.context, namespace=namespace)
        make = executor or (lambda context: SingleThreadedExecutor(context=context))
        self.executor = make(self.context)
        self.executor.add_node(self.node)

    def close(self) -> None:
        """Leave."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def wait(
        self,
        is_there: Callable[[], object],
        what: str,
        meanwhile: Callable[[], object] = lambda: None,
        deadline: float = DEADLINE,
    ) -> None:
        """Spin until something ``is_there``, and do something ``meanwhile`` before every spin.

        Raises:
            RuntimeError: if it is not there by the ``deadline`` [s].
        """
        end = time.monotonic() + deadline
        while not is_there():
            meanwhile()
            if time.monotonic() > end:
                raise RuntimeError(f'{what} did not happen in {deadline:g} s')
            self.executor.spin_once(timeout_sec=0.05)


class Client(Participant):
    """Asks a node."""

    def __init__(self, domain: int, more: Mapping[str, Any] = {}) -> None:
        """Wait until a node is there and answers, on ``more`` topics than the usual ones."""
        super().__init__(domain)
        # In bursts nothing is taken from this subscription: it costs the client only transport.
        self._unread = Node('unread', context=self.context)
        self._publisher = self.node.create_publisher(TendonTensions, 'tendon_tensions', 10)
        self._answers: list[bytes] = []
        self._asked = 0  # number of the last question
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
        """Leave."""
        self._unread.destroy_node()
        super().close()

    def one_by_one(self, are_stamped: bool) -> np.ndarray:
        """Time from a question to its answer [s]; whether answers ``are_stamped`` as it is."""
        latencies, end = [], time.monotonic() + LONGEST_LOOP
        for number in range(1, QUESTIONS + 1):
            if time.monotonic() > end:
                break
            asked, self._asked = question(number), number
            self._answers.clear()
            for other in self._others:
                take(other)  # of the depth of one, what came before
            start = time.perf_counter()
            self._publisher.publish(asked)
            while not self._answers:
                self._expect_within(start, number)
                self.executor.spin_once(timeout_sec=1.0)
            answers = []
            for other in self._others:
                while (answer := take(other)) is None:
                    self._expect_within(start, number)
                answers.append(answer)
            latencies.append(time.perf_counter() - start)
            stamps = [stamp_of(answer) for answer in (*self._answers, *answers)]
            if are_stamped and stamps != [number] * len(stamps):
                raise SystemExit(f'question {number} was answered with another stamp')
        return np.array(latencies)

    @staticmethod
    def _expect_within(start: float, number: int) -> None:
        if time.perf_counter() - start > DEADLINE:
            raise SystemExit(f'question {number} was not answered within {DEADLINE:g} s')

    def sustained(self) -> tuple[float, int]:
        """Most answers in a second [Hz], and the rate of questions it took [Hz]."""
        best, best_rate, in_vain = 0.0, 0, 0
        for rate in RATES[:MOST_RATES]:
            answered = self._burst(rate)
            in_vain = 0 if answered > RISE * best else in_vain + 1
            best, best_rate = max((best, best_rate), (answered, rate))
            if in_vain == 2:
                break
        return best, best_rate

    def _burst(self, rate: int) -> float:
        questions = [question(number) for number in range(PERIOD)]
        answered = sent = 0
        start = time.perf_counter()
        while (now := time.perf_counter() - start) < BURST:
            for _ in range(int(now * rate) + 1 - sent):
                self._asked += 1
                asked = stamped(questions[self._asked % PERIOD], self._asked)
                self._publisher.publish(asked)
                sent += 1
            answered += self._take()
            time.sleep(max(0.0, start + sent / rate - time.perf_counter()))
        answered += self._take()
        duration = time.perf_counter() - start
        self._drain(0.3)
        return answered / duration

    def _take(self) -> int:
        """Number of answers there are, taken without an executor, which would cost more."""
        count = 0
        while take(self._poses) is not None:
            count += 1
        return count

    def _drain(self, quiet: float) -> None:
        """Take messages until none has arrived for ``quiet`` [s]."""
        time.sleep(quiet)
        while self._take():
            time.sleep(quiet)
        self._answers.clear()


@contextlib.contextmanager
def running(arguments: Sequence[str], domain: int) -> Iterator[subprocess.Popen[bytes]]:
    """A node in ``domain``, as a Python process with ``arguments``."""
    process = subprocess.Popen([sys.executable, *arguments], env=environment_in(domain))
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            process.kill()


def measure(kind: str, domain: int) -> Measured:
    """Start the node ``kind``, ask it and stop it."""
    with (
        running(COMMANDS[kind], domain) as process,
        contextlib.closing(Client(domain, MORE.get(kind, {}))) as client,
    ):
        before = processor_time(process.pid)
        latencies = client.one_by_one(are_stamped=kind not in ('floor', 'plain'))
        spent = (processor_time(process.pid) - before) / latencies.size
        median, worst = np.median(latencies), np.percentile(latencies, 99)
        return Measured(float(median), float(worst), spent, *client.sustained())


def main() -> None:
    """Print the table."""
    make_parser(__doc__).parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    turns = [{kind: measure(kind, new_domain()) for kind in COMMANDS} for _ in range(TURNS)]
    results = {kind: Measured.best([turn[kind] for turn in turns]) for kind in COMMANDS}
    print(f'{CONFIG.stations} stations, {CONFIG.model}; one by one, and as many as are answered')
    ratios = ''.join(f'{f"x {other}":>9}' for other in OTHERS)
    print(
        f'{"node":9}{"median ms":>11}{"99 % ms":>9}{ratios}{"CPU ms":>9}'
        f'{"answers/s":>12}{"asked/s":>9}{ratios}'
    )
    for kind, got in results.items():
        later = ''.join(f'{got.median / results[other].median:9.2f}' for other in OTHERS)
        more = ''.join(f'{got.answered / results[other].answered:9.2f}' for other in OTHERS)
        print(
            f'{kind:9}{got.median * 1e3:11.3f}{got.worst * 1e3:9.3f}{later}{got.spent * 1e3:9.3f}'
            f'{got.answered:12.0f}{got.asked:9}{more}'
        )


if __name__ == '__main__':
    if sys.argv[1:2] and sys.argv[1] in OTHERS:
        answer_for_ever(sys.argv[1])
    else:
        main()
