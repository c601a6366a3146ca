"""Cost of the viewer for the node, and the pictures a second that reach the browser.

One node is asked again and again, in turn alone, with a viewer that nobody looks at, and with a
browser looking. The browser draws without a graphics card, which takes all there is of a small
machine; it runs at a lower priority, so that what is measured is the viewer, not the drawing.
Numbers depend on the machine, ratios less so. Needs chromium and chromedriver.

    python benchmarks/viewer.py [--brief]
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rclpy
from brief import IS_BRIEF, make_parser
from node import COMMANDS, Client, new_domain, question
from rclpy.node import Node

from octo_arm_model.ros.client.client import ArmClient
from octo_arm_model.ros.processes import stop_signals
from octo_arm_model.viewer.options import LOOPBACK, PORT
from octo_arm_model.viewer.page import Viewer
from octo_arm_model.viewer.server import free_port, serving, url

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / 'test'))

ROUNDS = 1 if IS_BRIEF else 3
STEADY = 200  # [Hz]
RATE = 60.0  # [Hz] of the tensions while pictures are counted
COUNTED = 6.0  # [s]
KINDS = ('alone', 'viewer', 'browser')


def serve(port: int) -> None:
    """Run the viewer until interrupted, and print every second how many pictures it drew."""
    is_over = stop_signals()
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    with serving(LOOPBACK, port) as server:
        viewer = Viewer(server, ArmClient(Node('viewer')))
        began, before = time.monotonic(), 0
        while not is_over():
            viewer.step()
            if (elapsed := time.monotonic() - began) > 1.0:
                print((viewer.pictures - before) / elapsed, flush=True)
                began, before = time.monotonic(), viewer.pictures
    rclpy.try_shutdown()


def look(address: str) -> None:
    """Run the browser until interrupted."""
    from browser import Browser

    os.nice(10)
    is_over = stop_signals()
    browser = Browser(address, wait=90.0)
    browser.shown('Tendons')
    print('looking', flush=True)
    while not is_over():
        time.sleep(0.1)
    browser.close()


class Part:
    """This file as another process.

    Attributes:
        said: lines it has said, once it has ended.
    """

    def __init__(self, *arguments: str) -> None:
        """Start it and wait for its first line."""
        self._process = subprocess.Popen(
            [sys.executable, __file__, *arguments], stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        if not self._process.stdout.readline():
            raise SystemExit(f'{arguments[0]} did not start')
        self.said: list[str] = []

    def end(self) -> None:
        """End it."""
        self._process.send_signal(signal.SIGINT)
        self.said = self._process.communicate(timeout=30.0)[0].splitlines()


def keep_asking(client: Client, seconds: float) -> None:
    """Ask at a steady rate, so that there is something new to draw."""
    end = time.monotonic() + seconds
    number = 0
    while time.monotonic() < end:
        number += 1
        client._publisher.publish(question(number))
        time.sleep(1.0 / RATE)
    client._drain(0.3)


class Measured(NamedTuple):
    """Of one kind: median latency [s], part of `STEADY` that is answered, most answers [Hz]."""

    latency: float
    kept: float
    answered: float
    pictures: float


def measure(kind: str, client: Client) -> Measured:
    """Measure the node alone, with a viewer, or with a viewer and a browser."""
    parts: list[Part] = []
    try:
        if kind != 'alone':
            port = free_port(LOOPBACK, PORT)
            parts.append(Part('serve', str(port)))
        if kind == 'browser':
            parts.append(Part('look', url(LOOPBACK, port)))
        latency = float(np.median(client.one_by_one(are_stamped=True)))
        kept = client._burst(STEADY) / STEADY
        answered, _ = client.sustained()
        if kind == 'browser':
            keep_asking(client, COUNTED)
    finally:
        for part in reversed(parts):
            part.end()
    # The last second is that in which the browser left.
    pictures = [float(line) for line in parts[0].said[-4:-1]] if kind == 'browser' else [0.0]
    return Measured(latency, kept, answered, float(np.median(pictures)))


def main() -> None:
    """Print the table."""
    make_parser(__doc__).parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    domain = new_domain()
    os.environ['ROS_DOMAIN_ID'] = str(domain)
    node = subprocess.Popen([sys.executable, *COMMANDS['ours']])
    results: dict[str, list[Measured]] = {kind: [] for kind in KINDS}
    client = Client(domain)
    try:
        for _ in range(ROUNDS):
            for kind in KINDS:
                results[kind].append(measure(kind, client))
    finally:
        client.close()
        node.send_signal(signal.SIGINT)
        node.wait(10.0)
    best = {
        kind: Measured(
            min(m.latency for m in row), *(max(column) for column in list(zip(*row))[1:])
        )
        for kind, row in results.items()
    }
    alone = best['alone']
    print(f'best of {ROUNDS} rounds, in turn')
    print(
        f'{"":9}{"median ms":>11}{"x alone":>9}{f"of {STEADY} Hz":>11}{"answers/s":>11}'
        f'{"x alone":>9}{"pictures/s":>12}'
    )
    for kind, of in best.items():
        pictures = f'{of.pictures:.1f}' if of.pictures else ''
        print(
            f'{kind:9}{1e3 * of.latency:11.3f}{of.latency / alone.latency:9.2f}{of.kept:11.0%}'
            f'{of.answered:11.0f}{of.answered / alone.answered:9.2f}{pictures:>12}'
        )


if __name__ == '__main__':
    if sys.argv[1:2] == ['serve']:
        serve(int(sys.argv[2]))
    elif sys.argv[1:2] == ['look']:
        look(sys.argv[2])
    else:
        main()
