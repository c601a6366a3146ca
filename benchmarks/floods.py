"""Measure how long a flooded node takes to answer a request for parameters.

The node has an arm under its own weight, the model exact and the default budget of a solve. A
client requests parameters again and again while another kind of message floods the node. Printed
are the median and the longest time to an answer, and the longest time between two diagnostics,
which are due once per second.

    python benchmarks/floods.py [--brief]
"""

from __future__ import annotations

import contextlib
import itertools
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from brief import IS_BRIEF, make_parser
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from node import CONFIG, IN_AIR, OURS, Participant, new_domain, question, running
from octo_arm_msgs.msg import TendonTensions
from octo_arm_msgs.srv import FindTensions, Solve
from rcl_interfaces.srv import GetParameters
from rclpy.serialization import serialize_message

from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.ros.node.main import make_executor

DURATION = 1.0 if IS_BRIEF else 10.0  # [s] of each flood
RATE = 500.0  # [Hz] of messages in a flood
WAITING = 50  # requests of a service that wait at a time
FORCE = 10.0  # [N] on the tip, with which the arm has no equilibrium


class Flooder(Participant):
    """Floods a node and meanwhile requests its parameters."""

    def __init__(self, domain: int) -> None:
        """Wait for the node in ``domain``."""
        super().__init__(domain, make_executor)
        create_publisher = self.node.create_publisher
        self._tensions = create_publisher(TendonTensions, 'tendon_tensions', 10)
        self._wrench = create_publisher(WrenchStamped, 'tip_wrench', 10)
        self._parameters = self.node.create_client(GetParameters, 'octo_arm/get_parameters')
        self._solve = self.node.create_client(Solve, 'solve')
        self._find = self.node.create_client(FindTensions, 'find_tensions')
        self._waiting: list[Any] = []
        self._times: list[float] = []
        self.node.create_subscription(
            DiagnosticArray, '/diagnostics', lambda _: self._times.append(time.monotonic()), 10
        )
        self._number = itertools.count(1)
        services = (self._parameters, self._solve, self._find)
        self.wait(
            lambda: all(service.service_is_ready() for service in services),
            'the start of the node',
        )

    def tensions(self) -> None:
        """Publish tensions for which there is a solution."""
        self._tensions.publish(question(next(self._number)))

    def wrench(self) -> None:
        """Publish a wrench without an equilibrium, every tenth time with tensions."""
        message = WrenchStamped()
        message.header.frame_id = CONFIG.base_frame
        message.wrench.force.z = FORCE
        self._wrench.publish(serialize_message(message))
        if next(self._number) % 10 == 0:
            self.tensions()

    def solve(self) -> None:
        """Keep requests of the service solve waiting, for a wrench without an equilibrium."""
        request = Solve.Request()
        request.tensions.name = list(CONFIG.arm.tendon_names)
        request.tensions.tension = np.ravel(FETCHING_IN_SPACE).tolist()
        request.tip_wrench.force.z = FORCE
        self._keep_waiting(self._solve, request)

    def find(self) -> None:
        """Keep requests of the service find_tensions waiting, for a target out of reach."""
        request = FindTensions.Request(target=FindTensions.Request.TIP_POSITION)
        request.tip.position.x = 9.0
        self._keep_waiting(self._find, request)

    def everything(self) -> None:
        """Send a message of each flood."""
        for flood in (self.tensions, self.wrench, self.solve, self.find):
            flood()

    def _keep_waiting(self, service: Any, request: Any) -> None:
        self._waiting = [answer for answer in self._waiting if not answer.done()]
        if len(self._waiting) < WAITING:
            self._waiting.append(service.call_async(request))

    def measure(self, flood: Callable[[], None] | None) -> tuple[float, float, float]:
        """Return median and longest time to an answer, and the longest between diagnostics [s]."""
        durations = []
        self._times.clear()
        start = now = due = time.monotonic()
        while now < start + DURATION:
            answer = self._parameters.call_async(GetParameters.Request(names=['model']))
            begin = time.monotonic()
            while not answer.done():
                now = time.monotonic()
                if flood is not None and now >= due:
                    flood()
                    due = max(due + 1.0 / RATE, now)
                self.executor.spin_once(timeout_sec=max(min(due - now, 0.001), 0.0))
            now = time.monotonic()
            durations.append(now - begin)
        gap = float(np.diff([start, *self._times, now]).max())
        return float(np.median(durations)), max(durations), gap


def main() -> None:
    """Print a row for each flood."""
    make_parser(__doc__).parse_args()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    domain = new_domain()
    command = [*OURS, *IN_AIR, '--log-level', 'error']
    with running(command, domain), contextlib.closing(Flooder(domain)) as flooder:
        floods: dict[str, Callable[[], None] | None] = {
            'nothing': None,
            'tensions': flooder.tensions,
            'wrenches': flooder.wrench,
            'solve': flooder.solve,
            'find_tensions': flooder.find,
            'all together': flooder.everything,
        }
        print(f'Flood of {RATE:.0f} Hz; time to an answer with parameters, one request at a time')
        print(f'{"flood":16}{"median ms":>10}{"longest ms":>12}{"between diagnostics ms":>24}')
        for name, flood in floods.items():
            median, longest, gap = (1e3 * value for value in flooder.measure(flood))
            print(f'{name:16}{median:10.1f}{longest:12.1f}{gap:24.0f}', flush=True)


if __name__ == '__main__':
    main()
