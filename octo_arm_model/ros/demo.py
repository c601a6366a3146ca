"""A live demonstration: the node in one process, a player of movements in another.

The player pulls tendons slowly through the fetching movements of Table 5 and shows, in the
terminal, what the node answers.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import time
from collections.abc import Sequence

import numpy as np
import rclpy
from nav_msgs.msg import Path
from octo_arm_msgs.msg import TendonTensions
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from octo_arm_model.arm import Arm
from octo_arm_model.config import load_config
from octo_arm_model.errors import OctoArmError
from octo_arm_model.hints import FloatArray
from octo_arm_model.inverse import default_highest
from octo_arm_model.paper import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.ros.outbox import OUTPUT_QOS

RATE = 50.0  # [Hz] of the tensions
MOVE_TIME = 3.0  # [s] from one posture to the next
HOLD_TIME = 1.0  # [s] in each posture


def postures_of(arm: Arm) -> list[tuple[str, FloatArray]]:
    """Names and tensions [N] of the postures to move through."""
    rest = ('coming to rest', np.zeros(arm.tension_shape))
    if arm.tension_shape == np.shape(FETCHING_IN_PLANE):
        return [
            rest,
            ('fetching in one plane', np.array(FETCHING_IN_PLANE)),
            rest,
            ('fetching in space', np.array(FETCHING_IN_SPACE)),
        ]
    # Any other arm: each tendon of the first section in turn, pulled so that the arm shortens
    # by a few per cent at its anchorage or bends by half a turn.
    highest = 0.25 * default_highest(arm, 0.12).ravel()
    postures = []
    for tendon in range(len(arm.sections[0].tendons)):
        tensions = np.zeros(len(arm.tendons))
        tensions[tendon] = highest[tendon]
        postures.append(
            (f'pulling {arm.tendon_names[tendon]}', tensions.reshape(arm.tension_shape))
        )
    return postures


class Player(Node):
    """Publishes tensions and shows the answers."""

    def __init__(self, arm: Arm) -> None:
        """Play on ``arm``."""
        super().__init__('octo_arm_player')
        self._postures = postures_of(arm)
        self._names = list(arm.tendon_names)
        self._tensions = self.create_publisher(TendonTensions, 'tendon_tensions', 5)
        self.create_subscription(Path, 'backbone/path', self._on_path, OUTPUT_QOS)
        self.create_timer(1.0 / RATE, self._play)
        self._live = sys.stdout.isatty()
        self.create_timer(0.1 if self._live else 1.0, self._show)
        self._start = self._shown = time.monotonic()
        self._doing = ''
        self._path: Path | None = None
        self._answers = 0
        self._rate = 0.0

    def _play(self) -> None:
        period = MOVE_TIME + HOLD_TIME
        step, within = divmod(time.monotonic() - self._start, period)
        count = len(self._postures)
        _, before = self._postures[int(step) % count]
        self._doing, after = self._postures[(int(step) + 1) % count]
        part = min(1.0, within / MOVE_TIME)
        smooth = part * part * (3.0 - 2.0 * part)
        message = TendonTensions(
            name=self._names, tension=((1.0 - smooth) * before + smooth * after).ravel()
        )
        message.header.stamp = self.get_clock().now().to_msg()
        self._tensions.publish(message)

    def _on_path(self, path: Path) -> None:
        self._path = path
        self._answers += 1

    def _show(self) -> None:
        now = time.monotonic()
        elapsed, self._shown = now - self._shown, now
        # The rate is smoothed over about a second.
        weight = min(1.0, elapsed)
        self._rate += weight * (self._answers / elapsed - self._rate)
        self._answers = 0
        if self._path is None:
            line = 'waiting for the node ...'
        else:
            base, tip = (
                np.array([pose.pose.position.x, pose.pose.position.y, pose.pose.position.z]) * 1e3
                for pose in (self._path.poses[0], self._path.poses[-1])
            )
            line = (
                f'tip {tip[0]:7.1f} {tip[1]:7.1f} {tip[2]:7.1f} mm   '
                f'to the base {np.linalg.norm(tip - base):6.1f} mm   '
                f'{self._rate:5.1f} shapes/s   {self._doing}'
            )
        print(f'\r{line:<98}' if self._live else line, end='' if self._live else '\n', flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run node and player until one of them ends; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog='octo_arm_demo',
        description='Start the node on an arm and play movements on it, until Ctrl-C.',
    )
    parser.add_argument('config', metavar='CONFIG', help='ROS parameter file of the arm')
    options = parser.parse_args(arguments)
    try:
        arm = load_config(options.config).arm
    except OctoArmError as error:
        print(f'octo_arm_demo: error: {error}', file=sys.stderr)
        return 2
    command = (sys.executable, '-m', 'octo_arm_model.ros.node')
    # A session of its own, so that Ctrl-C reaches the node once, from here.
    node = subprocess.Popen(
        [*command, '--ros-args', '--params-file', options.config, '--log-level', 'warn'],
        start_new_session=True,
    )
    # However it is ended, it ends like by Ctrl-C, so that the node is not left behind. A shell
    # starts background jobs with SIGINT ignored, which is why that one is set as well.
    for ending in (signal.SIGINT, signal.SIGTERM):
        signal.signal(ending, signal.default_int_handler)
    try:
        rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
        player = Player(arm)
        while node.poll() is None:
            rclpy.spin_once(player, timeout_sec=0.1)
    except (KeyboardInterrupt, ExternalShutdownException):
        print()
    finally:
        rclpy.try_shutdown()
        if node.poll() is None:
            node.send_signal(signal.SIGINT)
        status = node.wait(timeout=10.0)
    return 0 if status in (0, -signal.SIGINT) else status


if __name__ == '__main__':
    sys.exit(main())
