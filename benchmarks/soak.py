"""The node under load for long, with invalid messages, changed parameters and restarts.

    python benchmarks/soak.py                 an hour: a million messages
    python benchmarks/soak.py --part 0.01     a minute

The node runs as a process of its own over real DDS, in a domain of its own. `make test` runs the
same with a thousandth part.
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
WARM = 2000  # hostile messages until every queue has been full and all that is cached is cached
LARGEST_RISE = 5.0  # [MB] of memory from then on
WRENCH = 3  # among the publishers of a `Client`
LARGE = 2**16  # [bytes] of a message of which the middleware may drop several at once
SAID: dict[int, IO[bytes]] = {}  # what nodes wrote to stderr, by their process
# Half of the node's input queue: a message that finds it full replaces one that is not counted.
MOST_UNDER_WAY = INPUT_QOS.depth // 2
STAMP = slice(4, 12)  # of a serialised message with a header


def start_node(domain: int, *arguments: str, file: Path = FILE) -> subprocess.Popen[bytes]:
    """A node of its own."""
    command = [sys.executable, '-m', 'octo_arm_model.ros.node.main', '--ros-args']
    said = tempfile.TemporaryFile()
    command += ['--params-file', str(file), *arguments]
    process = subprocess.Popen(command, env=environment_in(domain), stderr=said)
    SAID[process.pid] = said
    return process


def end(process: subprocess.Popen[bytes], expected: set[int]) -> int:
    """Wait until ``process`` ends; returns its exit status, one of those ``expected``."""
    status = process.wait(timeout=DEADLINE)
    if status not in expected:
        SAID[process.pid].seek(0)
        text = SAID[process.pid].read()[-3000:].decode(errors='replace')
        raise RuntimeError(f'exit status {status} of the node, which said ... {text}')
    return status


class Client(Participant):
    """Sends tensions as bytes, and computes the expected answers, byte for byte."""

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
        """Writer of the answers for ``config``."""
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
        """Receive what has arrived."""
        for _ in range(4):
            self.executor.spin_once(timeout_sec=0.0)

    def good(self, tensions: np.ndarray) -> bytes:
        """Send a valid message; returns its stamp as in the answer."""
        second = next(self.stamps)
        header = Header(stamp=Time(sec=second, nanosec=7))
        message = TendonTensions(header=header, name=self.names, tension=tensions.ravel())
        self.send(0, serialize_message(message))
        return second.to_bytes(4, 'little') + (7).to_bytes(4, 'little')

    def paced(self, tensions: np.ndarray) -> None:
        """Send a valid message, and wait for its answer if `MOST_UNDER_WAY` may be under way."""
        stamp = self.good(tensions)
        self.under_way += 1
        if self.under_way == MOST_UNDER_WAY:
            self.under_way = 0
            self.wait(lambda: stamp in self.answers, 'an answer to the newest of a burst')

    def send(self, topic: int, data: bytes) -> None:
        """Send bytes on one of the topics."""
        self.publishers[topic].publish(data)
        # Wrenches that are no message, or overtaken by others, are not counted by the node.
        self.sent += topic != WRENCH

    def expected(self, tensions: np.ndarray, stamp: bytes) -> bytes:
        """The expected answer."""
        backbone = self.solver.solve(tensions)
        second = int.from_bytes(stamp[:4], 'little')
        return self.writer.poses(backbone, second, 7)

    def ask_until_answered(self) -> None:
        """Ask until there is an answer."""
        rest = np.zeros(CONFIG.arm.tension_shape)
        self.wait(lambda: self.answers, 'a first answer', lambda: self.good(rest))

    def connect(self) -> None:
        """Ask until there is an answer, and drop it."""
        self.ask_until_answered()
        last = self.good(np.zeros(CONFIG.arm.tension_shape))
        self.wait(lambda: last in self.answers, 'an answer to the last one')
        # Messages sent before discovery were not delivered: count from here.
        for _ in range(2):
            self.totals.clear()
            self.wait(lambda: len(self.totals) > 5, 'a diagnosis')
        self.base, self.sent = self.counted(), 0

    def check_count(self) -> dict[str, int]:
        """Wait until the node accounts for every message; returns its totals."""
        self.wait(lambda: self.counted() - self.base >= self.sent, 'an account of every message')
        return {key: self.totals[key] for key in self.KEYS}

    def counted(self) -> int:
        """Messages the node has accounted for."""
        return sum(self.totals.get(key, 0) for key in self.KEYS)


def valid(client: Client, process: subprocess.Popen[bytes], count: int) -> list[str]:
    """Many valid messages: constant memory, none lost without being counted."""
    random = np.random.default_rng(1)
    sets = random.uniform(0.0, 1.0, (200, *CONFIG.arm.tension_shape)) * SCALE
    warm = max(count // 20, 500)
    memory = 0.0
    for number in range(count):
        # One by one, and in bursts faster than they can be answered.
        if number % 2000 < 1000:
            client.listen()
            time.sleep(0.001)
        client.paced(sets[number % len(sets)])
        if number % 1000 == 0:
            client.answers.clear()
        if number == warm:
            memory = megabytes(process.pid)
    totals = client.check_count()
    grown = megabytes(process.pid) - memory
    return [
        f'{count} valid messages',
        f'{totals["output answered"]} answered, '
        f'{totals["output skipped"]} skipped, memory {grown:+.1f} MB',
    ]


def hostile_messages(names: list[str], random: np.random.Generator) -> Callable[[], Any]:
    """A source of (topic, bytes) that no arm should answer; the topics are those of a `Client`."""
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


def hostile(client: Client, process: subprocess.Popen[bytes], count: int) -> list[str]:
    """Invalid messages among valid ones: every valid one answered correctly, memory constant."""
    random = np.random.default_rng(2)
    source = hostile_messages(client.names, random)
    sent = right = 0
    before = None
    while sent < count:
        if before is None and sent >= WARM:
            before = megabytes(process.pid)
        for _ in range(int(random.integers(1, 6))):
            topic, data = source()
            client.send(topic, data)
            sent += 1
            if len(data) > LARGE:
                break
        tensions = random.uniform(0.0, 1.0, CONFIG.arm.tension_shape) * SCALE
        client.answers.clear()
        stamp = client.good(tensions)
        client.wait(lambda: stamp in client.answers, 'an answer among hostile messages')
        if client.answers[stamp] != client.expected(tensions, stamp):
            raise RuntimeError(f'wrong shape for {tensions.tolist()}')
        right += 1
    client.check_count()
    if process.poll() is not None:
        raise RuntimeError('the node died')
    outcome = f'{right} good ones among them answered rightly'
    if before is not None:
        after = megabytes(process.pid)
        outcome += f', memory from {before:.1f} to {after:.1f} MB'
        if after > before + LARGEST_RISE:
            raise RuntimeError(f'{outcome}, expected a rise of at most {LARGEST_RISE} MB')
    return [f'{sent} hostile messages', outcome]


def recorded(domain: int, seconds: float) -> list[str]:
    """A node of which everything is heard, as by `ros2 bag record -a`: everything answered."""
    process = start_node(domain)
    client = Client(domain)
    counts, shares = [], []
    try:
        client.connect()
        for is_recorded in (False, True):
            if is_recorded:
                hear_everything(client)
            client.listen()
            client.answers.clear()
            began, worked = time.monotonic(), processor_time(process.pid)
            asked = ask_steadily(client, RECORDED_RATE, seconds)
            shares.append((processor_time(process.pid) - worked) / (time.monotonic() - began))
            counts.append(f'{len(client.answers)} of {asked}')
    finally:
        client.close()
        process.send_signal(signal.SIGINT)
        end(process, {0})
    return [
        f'everything recorded at {RECORDED_RATE:.0f} Hz',
        f'{counts[1]} answered ({counts[0]} '
        f'where only backbone/poses is heard), for {shares[1] / max(shares[0], 1e-3):.1f} times '
        f'the processor time, {shares[1]:.0%} of a core',
    ]


def ask_steadily(client: Client, rate: float, seconds: float) -> int:
    """Ask at ``rate`` [Hz], never two at once to catch up; returns how often."""
    now = due = time.monotonic()
    stop = now + seconds
    asked = 0
    while now < stop:
        if now >= due:
            client.good(TENSIONS)
            asked += 1
            due = max(due + 1.0 / rate, now)
        client.executor.spin_once(timeout_sec=max(due - time.monotonic(), 0.0))
        now = time.monotonic()
    with contextlib.suppress(RuntimeError):
        client.wait(lambda: len(client.answers) >= asked, 'every answer', deadline=3.0)
    return asked


def hear_everything(client: Client) -> None:
    """Subscribe to all that the node publishes."""
    heard = []
    for topic, (kind, *_) in client.node.get_publisher_names_and_types_by_node('octo_arm', '/'):
        package, name = kind.split('/msg/')
        message = getattr(importlib.import_module(f'{package}.msg'), name)
        heard.append(
            client.node.create_subscription(
                message, topic, lambda data: None, QoSProfile(depth=100), raw=True
            )
        )
    client.wait(lambda: all(it.get_publisher_count() for it in heard), 'all topics of the node')


def restless(client: Client, process: subprocess.Popen[bytes], count: int) -> list[str]:
    """Parameters changed under load: no wrong shape."""
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
            client.paced(TENSIONS)
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
    done = client.parameters.call_async(SetParametersAtomically.Request(parameters=first))
    client.wait(done.done, 'the first parameters again')
    return [f'{count} changes of parameters', f'no wrong shape; {len(seen)} of 3 right ones seen']


def restart(client: Client, domain: int, process: subprocess.Popen[bytes]) -> list[Any]:
    """Node killed and started again under a running client."""
    process.kill()
    process.wait()
    client.answers.clear()
    began = time.monotonic()
    process = start_node(domain)
    client.ask_until_answered()
    return [process, 'killed and started again', f'answers {time.monotonic() - began:.2f} s later']


def octopus(domain: int, seconds: float) -> list[str]:
    """Eight arms at once."""
    names = [f'/arm_{number}' for number in range(1, 9)]
    nodes = [start_node(domain, '-r', f'__ns:={name}') for name in names]
    clients = [Client(domain, namespace=name) for name in names]
    try:
        for client in clients:
            client.ask_until_answered()
        for client in clients:
            client.answers.clear()
        # As many as each arm is asked for, as long as all of them keep up.
        sustained = 0.0
        for rate in ARM_RATES:
            slowest = min(asked_at(rate, clients, seconds))
            sustained = max(sustained, slowest)
            if slowest < 0.95 * rate:
                break
    finally:
        for client in clients:
            client.close()
        for node in nodes:
            node.send_signal(signal.SIGTERM)
        # With 1 ends what Fast DDS does not let go of, see `octo_arm_model.ros.node.main.run`.
        codes = [end(node, {0, 1}) for node in nodes]
    return ['eight arms at once', f'{sustained:.0f} shapes/s each, {sum(codes)} ended by force']


def asked_at(rate: float, clients: list[Client], seconds: float) -> list[float]:
    """Answers in a second to every one of ``clients`` that ask at ``rate`` [Hz]."""
    for client in clients:
        client.listen()
        client.answers.clear()
    began = time.monotonic()
    sent = 0
    while (now := time.monotonic() - began) < seconds:
        while sent < now * rate:
            for client in clients:
                client.good(TENSIONS)
            sent += 1
        for client in clients:
            client.listen()
        time.sleep(0.001)
    for client in clients:
        client.listen()
    return [len(client.answers) / seconds for client in clients]


def run(part: float) -> list[list[str]]:
    """All parts for ``part`` of the full length; returns rows of (what, outcome)."""
    rows = []
    domain = new_domain()
    process = start_node(domain)
    client = Client(domain)
    try:
        client.connect()
        for abuse, full in ((hostile, 100_000), (restless, 1000), (valid, 1_000_000)):
            rows.append(abuse(client, process, max(int(full * part), 5)))
            print(*rows[-1], sep=': ', flush=True)
        process, *row = restart(client, domain, process)
        rows.append(row)
        print(*row, sep=': ', flush=True)
    finally:
        client.close()
        process.send_signal(signal.SIGINT)
        end(process, {0})
    for row in (
        recorded(new_domain(), max(60.0 * part, 2.0)),
        octopus(new_domain(), max(10.0 * part, 1.0)),
        soak_motion.soak(max(600.0 * part, 5.0)),
    ):
        rows.append(row)
        print(*row, sep=': ', flush=True)
    return rows


def main() -> None:
    """Run it and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('--part', type=float, default=1.0, help='of the full length')
    options = parser.parse_args()
    run(options.part)


if __name__ == '__main__':
    main()
