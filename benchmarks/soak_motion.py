"""Command the moving arm of `make run` at random: tensions, lengths, pushes, pauses and resets.

    python benchmarks/soak_motion.py [--seconds 600] [--seed 1]     part of `make soak`

About twice a second some tensions jump, up to the highest of the arm, or winches reel some tendons
in or out until these get a tension again. No time step may fail, the simulator may not compute for
two seconds without a shape, and after a fifth of the time the memory of no process may rise. The
programs, with the viewer, are processes of their own that communicate over DDS.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, Vector3Stamped
from node import DEADLINE, Participant, environment_in, megabytes, new_domain, processor_time
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from octo_arm_model import load_config
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import bending_force, default_highest

NAME = 'renda2012_table4'
CONFIG = load_config(NAME)
# Highest tensions [N], with which four tendons do not crush the arm.
MOST_TENSION = np.minimum(default_highest(CONFIG.arm).ravel(), 8.0)
MOST_LENGTH = 0.15 * CONFIG.solver().rest_lengths.ravel()  # [m], reeled in
MOST_FORCE = 10.0 * bending_force(CONFIG.arm, 0.3)  # [N] at the tip
SHORT = 100.0  # [s]; the memory in shorter runs is not checked
# Processor time of the simulator between two shapes [s], which does not depend on other programs.
LONGEST_GAP = 2.0
LARGEST_RISE = 5.0  # [MB] of a process after a fifth of the time


class _Service(Protocol):
    """A type of service of std_srvs."""

    Request: Any


class Commander(Participant):
    """Commands the arm and receives its shapes and diagnostics."""

    def __init__(self, domain: int) -> None:
        """Connect to the arm in ``domain``."""
        super().__init__(domain)
        self._joints = self.node.create_publisher(JointState, 'tendon_commands/joint_state', 10)
        self._push = self.node.create_publisher(Vector3Stamped, 'push/force', 10)
        self.node.create_subscription(
            PoseArray, 'backbone/poses', self._on_shape, QoSProfile(depth=10), raw=True
        )
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_health, 10)
        self.simulator: int | None = None  # its process
        self.shapes, self.last_shape, self.longest_gap = 0, 0.0, 0.0
        self.health: dict[str, str] = {}

    def time_computed(self) -> float:
        """Return the processor time of the simulator [s]; 0 before its process is known."""
        return 0.0 if self.simulator is None else processor_time(self.simulator)

    def _on_shape(self, _: bytes) -> None:
        now = self.time_computed()
        self.longest_gap, self.last_shape = max(self.longest_gap, now - self.last_shape), now
        self.shapes += 1

    def _on_health(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith('simulator'):
                self.health = {'says': status.message} | {v.key: v.value for v in status.values}

    def listen(self, seconds: float) -> None:
        """Receive messages for so many ``seconds``."""
        end = time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0.0:
            self.executor.spin_once(timeout_sec=remaining)

    def ask(self, kind: _Service, name: str, request: Any = None) -> None:
        """Call a service, which must succeed."""
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready, name)
        answer = client.call_async(kind.Request() if request is None else request)
        self.wait(answer.done, name)
        if not answer.result().success:
            raise RuntimeError(f'{name}: {answer.result().message}')
        self.node.destroy_client(client)

    def move(self, tendons: NDArray[np.bool_], **values: FloatArray) -> None:
        """Command effort [N] or position [m] (tendons,) where the mask ``tendons`` is true."""
        names = [name for name, chosen in zip(CONFIG.arm.tendon_names, tendons) if chosen]
        if not names:
            return
        selected = {interface: value[tendons].tolist() for interface, value in values.items()}
        self._joints.publish(JointState(name=names, **selected))

    def push(self, force: FloatArray) -> None:
        """Apply a ``force`` (3,) [N] to the tip for half a second."""
        message = Vector3Stamped()
        message.vector.x, message.vector.y, message.vector.z = force.tolist()
        self._push.publish(message)

    def pause(self, steps: int) -> None:
        """Pause, advance by ``steps`` time steps, and continue."""
        self.ask(SetBool, 'pause', SetBool.Request(data=True))
        for _ in range(steps):
            self.ask(Trigger, 'step')
        self.ask(SetBool, 'pause', SetBool.Request(data=False))
        self.last_shape = self.time_computed()


@contextmanager
def running(domain: int) -> Iterator[subprocess.Popen[bytes]]:
    """Run the programs of `make run` in ``domain``, which must end without an error."""
    command = [sys.executable, '-m', 'octo_arm_model.apps.demo', NAME, '--moving']
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(command, env=environment_in(domain), stdout=log, stderr=log)
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            status = process.wait(DEADLINE)
            log.seek(0)
            text = log.read().decode(errors='replace')
            if status or 'Traceback' in text:
                raise RuntimeError(f'exit status {status}, output ends with {text[-3000:]}')


def processes(process: int) -> dict[str, int]:
    """Return the numbers of a ``process`` and its children by the names of their modules."""
    found = {}
    for each in (process, *_children(process)):
        command = Path(f'/proc/{each}/cmdline').read_bytes().split(b'\0')
        found[command[2].decode().removeprefix('octo_arm_model.')] = each
    return found


def memories(process: int) -> dict[str, float]:
    """Return the memory [MB] of a ``process`` and its children by the names of their modules."""
    return {name: megabytes(each) for name, each in processes(process).items()}


def _children(process: int) -> list[int]:
    return [int(c) for c in Path(f'/proc/{process}/task/{process}/children').read_text().split()]


def soak(seconds: float, seed: int = 1) -> list[str]:
    """Command the arm at random for so many ``seconds``; return commands and outcome as text.

    Raises:
        RuntimeError: if a step failed, shapes were missing, or memory rose.
    """
    random, domain = np.random.default_rng(seed), new_domain()
    counts = dict.fromkeys(('jumps', 'lengths', 'pushes', 'pauses', 'resets'), 0)
    with running(domain) as process:
        hand = Commander(domain)
        try:
            hand.wait(lambda: hand.shapes and hand.health, 'a shape')
            hand.simulator = processes(process.pid)['ros.simulator.main']
            hand.last_shape, hand.longest_gap = hand.time_computed(), 0.0
            count = MOST_TENSION.size
            start, before = time.monotonic(), None
            while (elapsed := time.monotonic() - start) < seconds:
                if before is None and elapsed > 0.2 * seconds:
                    before = memories(process.pid)
                pulled = random.random(count) < random.random()
                level = random.random(count) ** 3
                if random.random() < 0.5:
                    hand.move(pulled, position=level * MOST_LENGTH)
                    counts['lengths'] += 1
                else:
                    hand.move(pulled, effort=level * MOST_TENSION)
                    counts['jumps'] += 1
                if random.random() < 0.2:
                    hand.push(MOST_FORCE * random.random() * random.uniform(-1.0, 1.0, 3))
                    counts['pushes'] += 1
                if random.random() < 0.02:
                    hand.pause(int(random.integers(5)))
                    counts['pauses'] += 1
                if random.random() < 0.02:
                    hand.ask(Trigger, 'reset')
                    counts['resets'] += 1
                hand.listen(random.exponential(0.4))
            assert before is not None
            return _outcome(hand, counts, before, memories(process.pid), seconds)
        finally:
            hand.close()


def _outcome(
    hand: Commander,
    counts: dict[str, int],
    before: dict[str, float],
    after: dict[str, float],
    seconds: float,
) -> list[str]:
    hand.health.clear()
    shapes = hand.shapes
    hand.wait(lambda: hand.health and hand.shapes > shapes, 'diagnostics and a shape')
    rises = {name: after.get(name, np.nan) - size for name, size in before.items()}
    outcome = (
        f'{hand.health["failed steps"]} failed steps, {hand.shapes / seconds:.1f} shapes/s, none '
        f'for at most {hand.longest_gap:.2f} s of processor time, memory '
        + ', '.join(f'{name} {before[name]:.0f} {rise:+.1f} MB' for name, rise in rises.items())
    )
    failed = hand.health['failed steps'] != '0' or hand.health['refused'] != '0'
    # The memory of a new program rises while it loads modules.
    has_grown = seconds > SHORT and not max(rises.values()) < LARGEST_RISE
    if failed or has_grown or hand.longest_gap > LONGEST_GAP:
        raise RuntimeError(f'{outcome}; {hand.health}')
    commands = ', '.join(f'{number} {what}' for what, number in counts.items())
    return [f'moving arm, {commands}', outcome]


def main() -> None:
    """Run the test and print its outcome."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('--seconds', type=float, default=600.0, help='duration [s]')
    parser.add_argument('--seed', type=int, default=1, help='seed of the random commands')
    options = parser.parse_args()
    print(*soak(options.seconds, options.seed), sep=': ')


if __name__ == '__main__':
    main()
