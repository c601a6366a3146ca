"""Test the node for long: load, invalid messages, parameter changes and restarts.

    python benchmarks/soak.py                 an hour: a million messages
    python benchmarks/soak.py --part 0.01     a minute

The node is a process of its own in a DDS domain of its own. `make test` runs a thousandth of this.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import itertools
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np
import soak_motion
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, WrenchStamped
from node import DEADLINE, Participant, environment_in, megabytes, new_domain, processor_time
from octo_arm_msgs.msg import TendonTensions
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout

from octo_arm_model import Config, load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.node.inputs import INPUT_QOS
from octo_arm_model.wire.backbone import BackboneWriter

FILE = preset_path('renda2012_table4')
CONFIG = load_config(FILE)
SCALE = np.array([[0.2], [1.5], [3.0]])
TENSIONS = np.array([[0.1, 0.0, 0.05, 0.0], [1.0, 0.0, 0.0, 0.3], [0.0, 2.0, 0.0, 0.0]])
ARM_RATES = (50.0, 100.0, 150.0, 200.0, 300.0, 400.0)  # [Hz]
RECORDED_RATE = 100.0  # [Hz]
WARM = 2000  # invalid messages until queues and caches are full
LARGEST_RISE = 5.0  # [MB] of memory after `WARM` messages
WRENCH = 3  # index of the publisher of wrenches in `Client.publishers`
LARGE = 2**16  # [bytes]; of larger messages the middleware may drop several at once
STDERR: dict[int, IO[bytes]] = {}  # output of the nodes, by their process
# Half of the node's input queue: in a full queue a message replaces another, which is not counted.
MOST_UNDER_WAY = INPUT_QOS.depth // 2
STAMP = slice(4, 12)  # of a serialised message with a header


def start_node(domain: int, *arguments: str, file: Path = FILE) -> subprocess.Popen[bytes]:
    """Start a node in ``domain``."""
    command = [sys.executable, '-m', 'octo_arm_model.ros.node.main', '--ros-args']
    stderr = tempfile.TemporaryFile()
    command += ['--params-file', str(file), *arguments]
    process = subprocess.Popen(command, env=environment_in(domain), stderr=stderr)
    STDERR[process.pid] = stderr
    return process


def end(process: subprocess.Popen[bytes], expected: set[int]) -> int:
    """Wait for the end of a ``process``; return its status, which must be one ``expected``."""
    status = process.wait(timeout=DEADLINE)
    if status not in expected:
        STDERR[process.pid].seek(0)
        text = STDERR[process.pid].read()[-3000:].decode(errors='replace')
        raise RuntimeError(f'exit status {status} of the node, its output ends with {text}')
    return status


class Client(Participant):
    """Publishes serialised tensions and computes the bytes of the expected answers."""

    KEYS = ('output answered', 'output skipped', 'input refused', 'solver failures')

    def __init__(self, domain: int, config: Config = CONFIG, namespace: str = '') -> None:
        """Connect to the node in ``domain``."""
        super().__init__(domain, namespace=namespace)
        kinds = (TendonTensions, Float64MultiArray, JointState, WrenchStamped)
        topics = (
            'tendon_tensions',
            'tendon_tensions/array',
            'tendon_tensions/joint_state',
            'tip_wrench',
        )
        self.publishers = [
            self.node.create_publisher(kind, topic, QoSProfile(depth=1000))
            for kind, topic in zip(kinds, topics, strict=True)
        ]
        self.answers: dict[bytes, bytes] = {}
        self.node.create_subscription(
            PoseArray, 'backbone/poses', self._on_poses, QoSProfile(depth=1000), raw=True
        )
        self.totals: dict[str, int] = {}
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_health, 10)
        self.parameters = self.node.create_client(
            SetParametersAtomically, 'octo_arm/set_parameters_atomically'
        )
        self.names = list(config.arm.tendon_names)
        self.solver = config.solver(compiled=None)
        self.frame = config.base_frame
        self.writer = self.writer_of(config)
        self.stamps = itertools.count(1)
        self.sent = self.base = self.under_way = 0

    @staticmethod
    def writer_of(config: Config) -> BackboneWriter:
        """Return the writer of answers for ``config``."""
        solver = config.solver()
        return BackboneWriter(config.base_frame, config.model, solver.grid.s, solver.grid.section)

    def _on_poses(self, data: bytes) -> None:
        self.answers[bytes(data[STAMP])] = bytes(data)

    def _on_health(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for value in status.values:
                if value.value.isdigit():
                    self.totals[f'{status.name.split(": ")[1]} {value.key}'] = int(value.value)

    def listen(self) -> None:
        """Receive messages that have arrived."""
        for _ in range(4):
            self.executor.spin_once(timeout_sec=0.0)

    def publish_valid(self, tensions: np.ndarray) -> bytes:
        """Publish a valid message and return the bytes of its stamp, which its answer has too."""
        second = next(self.stamps)
        header = Header(stamp=Time(sec=second, nanosec=7))
        message = TendonTensions(header=header, name=self.names, tension=tensions.ravel())
        self.publish(0, serialize_message(message))
        return second.to_bytes(4, 'little') + (7).to_bytes(4, 'little')

    def publish_paced(self, tensions: np.ndarray) -> None:
        """Publish a valid message; wait for an answer after every `MOST_UNDER_WAY` messages."""
        stamp = self.publish_valid(tensions)
        self.under_way += 1
        if self.under_way == MOST_UNDER_WAY:
            self.under_way = 0
            self.wait(lambda: stamp in self.answers, 'an answer to the newest of a burst')

    def publish(self, topic: int, data: bytes) -> None:
        """Publish bytes on the topic with the index ``topic``."""
        self.publishers[topic].publish(data)
        # The node counts neither malformed nor replaced wrenches.
        self.sent += topic != WRENCH

    def expected_answer(self, tensions: np.ndarray, stamp: bytes) -> bytes:
        """Return the bytes of the expected answer."""
        backbone = self.solver.solve(tensions)
        second = int.from_bytes(stamp[:4], 'little')
        return self.writer.poses(backbone, second, 7)

    def ask_until_answered(self) -> None:
        """Publish tensions until one of them is answered: earlier answers may still be queued."""
        rest, asked = np.zeros(CONFIG.arm.tension_shape), set[bytes]()
        self.wait(
            lambda: asked & self.answers.keys(),
            'a first answer',
            lambda: asked.add(self.publish_valid(rest)),
        )

    def connect(self) -> None:
        """Wait until the node answers, and start to count messages."""
        self.ask_until_answered()
        last = self.publish_valid(np.zeros(CONFIG.arm.tension_shape))
        self.wait(lambda: last in self.answers, 'an answer to the last message')
        # Messages before discovery were not delivered, so that the count starts here.
        for _ in range(2):
            self.totals.clear()
            self.wait(lambda: len(self.totals) > 5, 'a diagnostic message')
        self.base, self.sent = self.handled(), 0

    def wait_for_count(self) -> dict[str, int]:
        """Wait until the diagnostics count every message; return their totals."""
        self.wait(lambda: self.handled() - self.base >= self.sent, 'a count of every message')
        return {key: self.totals[key] for key in self.KEYS}

    def handled(self) -> int:
        """Return the number of messages that the diagnostics count."""
        return sum(self.totals.get(key, 0) for key in self.KEYS)


def send_valid(client: Client, process: subprocess.Popen[bytes], count: int) -> list[str]:
    """Publish many valid messages: memory stays constant, every message is counted."""
    random = np.random.default_rng(1)
    sets = random.uniform(0.0, 1.0, (200, *CONFIG.arm.tension_shape)) * SCALE
    warm_up = max(count // 20, 500)
    memory, before = 0.0, client.wait_for_count()
    for number in range(count):
        # Half one by one, half in bursts faster than the node can answer.
        if number % 2000 < 1000:
            client.listen()
            time.sleep(0.001)
        client.publish_paced(sets[number % len(sets)])
        if number % 1000 == 0:
            client.answers.clear()
        if number == warm_up:
            memory = megabytes(process.pid)
    totals = {key: total - before[key] for key, total in client.wait_for_count().items()}
    memory_rise = megabytes(process.pid) - memory
    return [
        f'{count} valid messages',
        f'{totals["output answered"]} answered, '
        f'{totals["output skipped"]} skipped, memory {memory_rise:+.1f} MB',
    ]


def invalid_messages(names: list[str], random: np.random.Generator) -> Callable[[], Any]:
    """Return a source of (topic, bytes) of invalid messages; topics are indices of publishers."""
    good = np.full(12, 0.1)
    value = [np.nan, np.inf, -np.inf, -1.0, -1e-300, 1e300]

    def tensions(names: list[str], values: np.ndarray) -> tuple[int, bytes]:
        second = int(random.integers(-(2**31), 2**31))
        header = Header(stamp=Time(sec=second if random.random() < 0.5 else 0, nanosec=0))
        return 0, serialize_message(TendonTensions(header=header, name=names, tension=values))

    def one_bad() -> tuple[int, bytes]:
        bad = good.copy()
        bad[random.integers(12)] = random.choice(value)
        return tensions(names, bad)

    def wrong_length() -> tuple[int, bytes]:
        length = int(random.choice([0, 1, 11, 13, 500]))
        data = np.full(length, 0.1)
        if random.random() < 0.5:
            return 1, serialize_message(Float64MultiArray(data=data))
        return tensions((names * 50)[:length], data)

    def wrong_names() -> tuple[int, bytes]:
        odd = list(names)
        odd[int(random.integers(12))] = str(random.choice(['', 'elbow', names[0] + '\u00e9']))
        if random.random() < 0.3:
            odd[-1] = odd[0]
        return tensions(odd, good)

    def odd_layout() -> tuple[int, bytes]:
        sizes = random.choice([[4, 3], [2, 6], [12, 1], [1, 12]]).tolist()
        dims = [MultiArrayDimension(size=size) for size in sizes]
        layout = MultiArrayLayout(dim=dims, data_offset=int(random.integers(1, 9)))
        return 1, serialize_message(Float64MultiArray(layout=layout, data=good))

    def empty_joints() -> tuple[int, bytes]:
        return 2, serialize_message(JointState(name=names, position=good))

    def broken() -> tuple[int, bytes]:
        topic, data = one_bad()
        # At least a byte: DDS delivers no empty message.
        if random.random() < 0.5:
            return topic, data[: int(random.integers(1, len(data)))]
        return int(random.integers(3)), random.bytes(int(random.integers(1, 300)))

    def large() -> tuple[int, bytes]:
        count = int(2.0 ** random.uniform(0.0, 15.0))
        kind = int(random.integers(4))
        if kind == 0:
            return tensions(['x' * count, *names[1:]], good)
        if kind == 1:
            return tensions([f'tendon {number}' for number in range(count // 16)], good)
        if kind == 2:
            return 1, serialize_message(Float64MultiArray(data=np.full(count + 12, 0.1)))
        return int(random.integers(4)), random.bytes(8 * count)

    def wrench() -> tuple[int, bytes]:
        message = WrenchStamped(header=Header(frame_id=str(random.choice(['', 'x' * 5000]))))
        message.wrench.force.z = float(random.choice([np.nan, np.inf, 1e300]))
        data = serialize_message(message)
        return WRENCH, data[: int(random.integers(1, len(data) + 1))]

    kinds = (one_bad, wrong_length, wrong_names, odd_layout, empty_joints, broken, large, wrench)
    return lambda: kinds[int(random.integers(len(kinds)))]()


def send_invalid(client: Client, process: subprocess.Popen[bytes], count: int) -> list[str]:
    """Publish invalid messages among valid ones: answers are correct, memory stays constant."""
    random = np.random.default_rng(2)
    source = invalid_messages(client.names, random)
    sent = right = 0
    before = None
    while sent < count:
        if before is None and sent >= WARM:
            before = megabytes(process.pid)
        for _ in range(int(random.integers(1, 6))):
            topic, data = source()
            client.publish(topic, data)
            sent += 1
            if len(data) > LARGE:
                break
        tensions = random.uniform(0.0, 1.0, CONFIG.arm.tension_shape) * SCALE
        client.answers.clear()
        stamp = client.publish_valid(tensions)
        client.wait(lambda: stamp in client.answers, 'an answer among invalid messages')
        if client.answers[stamp] != client.expected_answer(tensions, stamp):
            raise RuntimeError(f'wrong shape for {tensions.tolist()}')
        right += 1
    client.wait_for_count()
    if process.poll() is not None:
        raise RuntimeError('the node died')
    outcome = f'{right} valid ones among them answered correctly'
    if before is not None:
        after = megabytes(process.pid)
        outcome += f', memory from {before:.1f} to {after:.1f} MB'
        if after > before + LARGEST_RISE:
            raise RuntimeError(f'{outcome}, expected a rise of at most {LARGEST_RISE} MB')
    return [f'{sent} invalid messages', outcome]


def record_everything(domain: int, seconds: float) -> list[str]:
    """Subscribe to all topics of a node, as `ros2 bag record -a`: it still answers everything."""
    process = start_node(domain)
    client = Client(domain)
    counts, shares = [], []
    try:
        client.connect()
        for is_recorded in (False, True):
            if is_recorded:
                subscribe_to_everything(client)
            client.listen()
            client.answers.clear()
            start, cpu_before = time.monotonic(), processor_time(process.pid)
            published = publish_steadily(client, RECORDED_RATE, seconds)
            shares.append((processor_time(process.pid) - cpu_before) / (time.monotonic() - start))
            counts.append(f'{len(client.answers)} of {published}')
    finally:
        client.close()
        process.send_signal(signal.SIGINT)
        end(process, {0})
    return [
        f'everything recorded at {RECORDED_RATE:.0f} Hz',
        f'{counts[1]} answered ({counts[0]} '
        f'with a subscriber of backbone/poses only), with {shares[1] / max(shares[0], 1e-3):.1f} '
        f'times the processor time, {shares[1]:.0%} of a core',
    ]


def publish_steadily(client: Client, rate: float, seconds: float) -> int:
    """Publish tensions at ``rate`` [Hz], without catching up; return their number."""
    now = due = time.monotonic()
    stop = now + seconds
    published = 0
    while now < stop:
        if now >= due:
            client.publish_valid(TENSIONS)
            published += 1
            due = max(due + 1.0 / rate, now)
        client.executor.spin_once(timeout_sec=max(due - time.monotonic(), 0.0))
        now = time.monotonic()
    with contextlib.suppress(RuntimeError):
        client.wait(lambda: len(client.answers) >= published, 'every answer', deadline=3.0)
    return published


def subscribe_to_everything(client: Client) -> None:
    """Subscribe to all topics of the node."""
    subscriptions = []
    for topic, (kind, *_) in client.node.get_publisher_names_and_types_by_node('octo_arm', '/'):
        package, name = kind.split('/msg/')
        message = getattr(importlib.import_module(f'{package}.msg'), name)
        subscriptions.append(
            client.node.create_subscription(
                message, topic, lambda data: None, QoSProfile(depth=100), raw=True
            )
        )
    client.wait(lambda: all(s.get_publisher_count() for s in subscriptions), 'all topics')


def change_parameters(client: Client, process: subprocess.Popen[bytes], count: int) -> list[str]:
    """Change parameters under load: each shape belongs to one set of parameters."""
    variants = [
        {'stations': 101, 'material.youngs_modulus': 1.1e5},
        {'stations': 61, 'material.youngs_modulus': 2.2e5},
        {'stations': 31, 'material.youngs_modulus': 1.6e5},
    ]
    allowed = set()
    for values in variants:
        text = FILE.read_text()
        text = text.replace('stations: 101', f'stations: {values["stations"]}')
        text = text.replace(
            'youngs_modulus: 110000.0', f'youngs_modulus: {values["material.youngs_modulus"]}'
        )
        path = Path(f'/tmp/octo_arm_soak_{os.getpid()}.yaml')
        path.write_text(text)
        config = load_config(path)
        path.unlink()
        backbone = config.solver(compiled=None).solve(TENSIONS)
        allowed.add(Client.writer_of(config).poses(backbone, 0, 0)[STAMP.stop :])
    client.answers.clear()
    seen = set()
    for number in range(count):
        values = variants[(number + 1) % len(variants)]
        parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        future = client.parameters.call_async(
            SetParametersAtomically.Request(parameters=parameters)
        )
        while not future.done():
            client.publish_paced(TENSIONS)
            client.executor.spin_once(timeout_sec=0.002)
        if not future.result().result.successful:
            raise RuntimeError(future.result().result.reason)
        client.listen()
        shapes = {data[STAMP.stop :] for data in client.answers.values()}
        if not shapes <= allowed:
            raise RuntimeError('a shape that belongs to no set of parameters')
        seen |= shapes
        client.answers.clear()
    first = [Parameter(n, value=v).to_parameter_msg() for n, v in variants[0].items()]
    future = client.parameters.call_async(SetParametersAtomically.Request(parameters=first))
    client.wait(future.done, 'a return to the first parameters')
    return [f'{count} changes of parameters', f'no wrong shape; {len(seen)} of 3 right ones seen']


def kill_and_restart(client: Client, domain: int, process: subprocess.Popen[bytes]) -> list[Any]:
    """Kill the node and start it again while the client runs."""
    process.kill()
    process.wait()
    client.answers.clear()
    start = time.monotonic()
    process = start_node(domain)
    client.ask_until_answered()
    return [process, 'killed and started again', f'answers after {time.monotonic() - start:.2f} s']


def run_eight_arms(domain: int, seconds: float) -> list[str]:
    """Run the nodes of eight arms at the same time."""
    names = [f'/arm_{number}' for number in range(1, 9)]
    nodes = [start_node(domain, '-r', f'__ns:={name}') for name in names]
    clients = [Client(domain, namespace=name) for name in names]
    try:
        for client in clients:
            client.ask_until_answered()
        for client in clients:
            client.answers.clear()
        # The rate rises until one of the arms answers less than it is asked.
        sustained = 0.0
        for rate in ARM_RATES:
            slowest = min(answer_rates(rate, clients, seconds))
            sustained = max(sustained, slowest)
            if slowest < 0.95 * rate:
                break
    finally:
        for client in clients:
            client.close()
        for node in nodes:
            node.send_signal(signal.SIGTERM)
        # The status is 1 if Fast DDS does not shut down, see `octo_arm_model.ros.node.main.run`.
        codes = [end(node, {0, 1}) for node in nodes]
    return ['eight arms at once', f'{sustained:.0f} shapes/s each, {sum(codes)} ended by force']


def answer_rates(rate: float, clients: list[Client], seconds: float) -> list[float]:
    """Return the rates of answers if each of ``clients`` publishes at ``rate`` [Hz]."""
    for client in clients:
        client.listen()
        client.answers.clear()
    start = time.monotonic()
    sent = 0
    while (elapsed := time.monotonic() - start) < seconds:
        while sent < elapsed * rate:
            for client in clients:
                client.publish_valid(TENSIONS)
            sent += 1
        for client in clients:
            client.listen()
        time.sleep(0.001)
    for client in clients:
        client.listen()
    return [len(client.answers) / seconds for client in clients]


def run(part: float) -> list[list[str]]:
    """Run all tests for ``part`` of their full length; return rows of (test, outcome)."""
    rows = []
    domain = new_domain()
    process = start_node(domain)
    client = Client(domain)
    try:
        client.connect()
        counts = {send_invalid: 100_000, change_parameters: 1000, send_valid: 1_000_000}
        for test, full in counts.items():
            rows.append(test(client, process, max(int(full * part), 5)))
            print(*rows[-1], sep=': ', flush=True)
        process, *row = kill_and_restart(client, domain, process)
        rows.append(row)
        print(*row, sep=': ', flush=True)
    finally:
        client.close()
        process.send_signal(signal.SIGINT)
        end(process, {0})
    for measure in (
        lambda: record_everything(new_domain(), max(60.0 * part, 2.0)),
        lambda: run_eight_arms(new_domain(), max(10.0 * part, 1.0)),
        lambda: soak_motion.soak(max(600.0 * part, 5.0)),
    ):
        rows.append(measure())
        print(*rows[-1], sep=': ', flush=True)
    return rows


def main() -> None:
    """Run all tests and print their outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('--part', type=float, default=1.0, help='fraction of the full length')
    options = parser.parse_args()
    run(options.part)


if __name__ == '__main__':
    main()
