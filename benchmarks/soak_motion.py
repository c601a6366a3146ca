"""`make run` in random hands: an arm that moves is pulled, pushed, paused, stepped and begun anew.

    python benchmarks/soak_motion.py [--seconds 600] [--seed 1]     `make soak` does it too

Every half a second or so tensions of some tendons jump, up to what the arm bears, or winches reel
some in or out, until these are commanded by tension again. No step may fail, no shape may be
missing for two seconds but in a pause, and the memory of every process stays what it was after a
fifth of the time. The programs are processes of their own over DDS, the viewer among them.
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
from node import DEADLINE, Participant, environment_in, megabytes, new_domain
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from octo_arm_model import load_config
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import bending_force, default_highest

NAME = 'renda2012_table4'
CONFIG = load_config(NAME)
MOST_TENSION = np.minimum(default_highest(CONFIG.arm).ravel(), 8.0)  # [N], without a crush of four
MOST_LENGTH = 0.15 * CONFIG.solver().rest_lengths.ravel()  # [m], reeled in
MOST_FORCE = 10.0 * bending_force(CONFIG.arm, 0.3)  # [N] at the tip
SHORT = 100.0  # [s] of a run in which memory is not judged
SILENCE = 2.0  # [s] that no shape may be missing for
LARGEST_RISE = 5.0  # [MB] of memory of a process after a fifth of the time


class _Service(Protocol):
    """A kind of service, as std_srvs has them."""

    Request: Any


class Hand(Participant):
    """Commands the arm, and hears what becomes of it."""

    def __init__(self, domain: int) -> None:
        """Connect to the arm in ``domain``."""
        super().__init__(domain)
        self._joints = self.node.create_publisher(JointState, 'tendon_commands/joint_state', 10)
        self._push = self.node.create_publisher(Vector3Stamped, 'push/force', 10)
        self.node.create_subscription(
            PoseArray, 'backbone/poses', self._on_shape, QoSProfile(depth=10), raw=True
        )
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_health, 10)
        self.shapes, self.heard, self.longest = 0, time.monotonic(), 0.0
        self.health: dict[str, str] = {}

    def _on_shape(self, _: bytes) -> None:
        now = time.monotonic()
        self.longest, self.heard = max(self.longest, now - self.heard), now
        self.shapes += 1

    def _on_health(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith('simulator'):
                self.health = {'says': status.message} | {v.key: v.value for v in status.values}

    def listen(self, seconds: float) -> None:
        """Receive for so long."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            self.executor.spin_once(timeout_sec=left)

    def ask(self, kind: _Service, name: str, request: Any = None) -> None:
        """Call a service, which has to succeed."""
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready, name)
        answer = client.call_async(kind.Request() if request is None else request)
        self.wait(answer.done, name)
        if not answer.result().success:
            raise RuntimeError(f'{name}: {answer.result().message}')
        self.node.destroy_client(client)

    def move(self, tendons: NDArray[np.bool_], **values: FloatArray) -> None:
        """Command the effort [N], or position [m], of some ``tendons`` alone, (tendons,) each."""
        names = [name for name, one in zip(CONFIG.arm.tendon_names, tendons) if one]
        if not names:
            return
        some = {interface: value[tendons].tolist() for interface, value in values.items()}
        self._joints.publish(JointState(name=names, **some))

    def push(self, force: FloatArray) -> None:
        """Push the tip with a ``force`` (3,) [N], for half a second."""
        message = Vector3Stamped()
        message.vector.x, message.vector.y, message.vector.z = force.tolist()
        self._push.publish(message)

    def rest(self, steps: int) -> None:
        """Pause, go on by some ``steps``, and go on."""
        self.ask(SetBool, 'pause', SetBool.Request(data=True))
        for _ in range(steps):
            self.ask(Trigger, 'step')
        self.ask(SetBool, 'pause', SetBool.Request(data=False))
        self.heard = time.monotonic()


@contextmanager
def running(domain: int) -> Iterator[subprocess.Popen[bytes]]:
    """What `make run` starts, in ``domain``."""
    command = [sys.executable, '-m', 'octo_arm_model.apps.demo', NAME, '--moving']
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, env=environment_in(domain), stdout=said, stderr=said)
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            status = process.wait(DEADLINE)
            said.seek(0)
            text = said.read().decode(errors='replace')
            if status or 'Traceback' in text:
                raise RuntimeError(f'exit status {status} of a program that said {text[-3000:]}')


def memories(process: int) -> dict[str, float]:
    """Memory of a ``process`` and its children [MB], by what they run."""
    found = {}
    for one in (process, *_children(process)):
        command = Path(f'/proc/{one}/cmdline').read_bytes().split(b'\0')
        found[command[2].decode().removeprefix('octo_arm_model.')] = megabytes(one)
    return found


def _children(process: int) -> list[int]:
    return [int(c) for c in Path(f'/proc/{process}/task/{process}/children').read_text().split()]


def soak(seconds: float, seed: int = 1) -> list[str]:
    """Command the arm at random for so many ``seconds``; what was done and how it went.

    Raises:
        RuntimeError: if a step failed, the arm was silent, or memory grew.
    """
    random, domain = np.random.default_rng(seed), new_domain()
    counts = dict.fromkeys(('jumps', 'lengths', 'pushes', 'pauses', 'resets'), 0)
    with running(domain) as process:
        hand = Hand(domain)
        try:
            hand.wait(lambda: hand.shapes and hand.health, 'a shape')
            hand.longest, count = 0.0, MOST_TENSION.size
            began, before = time.monotonic(), None
            while (now := time.monotonic() - began) < seconds:
                if before is None and now > 0.2 * seconds:
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
                    hand.rest(int(random.integers(5)))
                    counts['pauses'] += 1
                if random.random() < 0.02:
                    hand.ask(Trigger, 'reset')
                    counts['resets'] += 1
                hand.listen(random.exponential(0.4))
            assert before is not None
            return _judged(hand, counts, before, memories(process.pid), seconds)
        finally:
            hand.close()


def _judged(
    hand: Hand,
    counts: dict[str, int],
    before: dict[str, float],
    after: dict[str, float],
    seconds: float,
) -> list[str]:
    hand.health.clear()
    hand.wait(lambda: hand.health, 'diagnostics')
    grown = {name: after.get(name, np.nan) - size for name, size in before.items()}
    outcome = (
        f'{hand.health["failed steps"]} failed steps, {hand.shapes / seconds:.1f} shapes/s, none '
        f'for at most {hand.longest:.2f} s, memory '
        + ', '.join(f'{name} {before[name]:.0f} {rise:+.1f} MB' for name, rise in grown.items())
    )
    failed = hand.health['failed steps'] != '0' or hand.health['refused'] != '0'
    # A program that has just begun still loads what it needs.
    grows = seconds > SHORT and not max(grown.values()) < LARGEST_RISE
    if failed or grows or hand.longest > SILENCE:
        raise RuntimeError(f'{outcome}; {hand.health}')
    done = ', '.join(f'{number} {what}' for what, number in counts.items())
    return [f'an arm that moves, {done}', outcome]


def main() -> None:
    """Run it and print how it went."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('--seconds', type=float, default=600.0, help='how long')
    parser.add_argument('--seed', type=int, default=1, help='of the commands')
    options = parser.parse_args()
    print(*soak(options.seconds, options.seed), sep=': ')


if __name__ == '__main__':
    main()
