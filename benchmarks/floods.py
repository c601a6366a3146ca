"""How long a request for parameters waits at the node while it is flooded, and diagnostics.

The node holds an arm under its own weight, model exact, with the default budget of a solve. One
request for parameters follows the other; of their times the median and the longest are told, and
the longest time between two diagnostics, of which there is one a second.

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
WAITING = 50  # requests that wait
FORCE = 10.0  # [N] on the tip, for which there is no balance


class Flooder(Participant):
    """Floods a node, and asks it for parameters meanwhile."""

    def __init__(self, domain: int) -> None:
        """Wait for the node in ``domain``."""
        super().__init__(domain, make_executor)
        make = self.node.create_publisher
        self._tensions = make(TendonTensions, 'tendon_tensions', 10)
        self._wrench = make(WrenchStamped, 'tip_wrench', 10)
        self._parameters = self.node.create_client(GetParameters, 'octo_arm/get_parameters')
        self._solve = self.node.create_client(Solve, 'solve')
        self._find = self.node.create_client(FindTensions, 'find_tensions')
        self._waiting: list[Any] = []
        self._heard: list[float] = []
        self.node.create_subscription(
            DiagnosticArray, '/diagnostics', lambda _: self._heard.append(time.monotonic()), 10
        )
        self._number = itertools.count(1)
        services = (self._parameters, self._solve, self._find)
        self.wait(
            lambda: all(service.service_is_ready() for service in services),
            'the start of the node',
        )

    def tensions(self) -> None:
        """Send tensions, which are feasible."""
        self._tensions.publish(question(next(self._number)))

    def wrench(self) -> None:
        """Send a wrench that no balance is found under, every tenth time with tensions."""
        message = WrenchStamped()
        message.header.frame_id = CONFIG.base_frame
        message.wrench.force.z = FORCE
        self._wrench.publish(serialize_message(message))
        if next(self._number) % 10 == 0:
            self.tensions()

    def solve(self) -> None:
        """Have requests of the service solve waiting, for the same wrench."""
        request = Solve.Request()
        request.tensions.name = list(CONFIG.arm.tendon_names)
        request.tensions.tension = np.ravel(FETCHING_IN_SPACE).tolist()
        request.tip_wrench.force.z = FORCE
        self._keep_waiting(self._solve, request)

    def find(self) -> None:
        """Have requests of the service find_tensions waiting, for a target out of reach."""
        request = FindTensions.Request(target=FindTensions.Request.TIP_POSITION)
        request.tip.position.x = 9.0
        self._keep_waiting(self._find, request)

    def everything(self) -> None:
        """All of these."""
        for flood in (self.tensions, self.wrench, self.solve, self.find):
            flood()

    def _keep_waiting(self, service: Any, request: Any) -> None:
        self._waiting = [one for one in self._waiting if not one.done()]
        if len(self._waiting) < WAITING:
            self._waiting.append(service.call_async(request))

    def ask(self, flood: Callable[[], None] | None) -> tuple[float, float, float]:
        """Median and longest time of a request [s], and between diagnostics [s]."""
        took = []
        self._heard.clear()
        began = now = due = time.monotonic()
        while now < began + DURATION:
            asked = self._parameters.call_async(GetParameters.Request(names=['model']))
            sent = time.monotonic()
            while not asked.done():
                now = time.monotonic()
                if flood is not None and now >= due:
                    flood()
                    due = max(due + 1.0 / RATE, now)
                self.executor.spin_once(timeout_sec=max(min(due - now, 0.001), 0.0))
            now = time.monotonic()
            took.append(now - sent)
        return float(np.median(took)), max(took), float(np.diff([began, *self._heard, now]).max())


def main() -> None:
    """Print the table."""
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
            'all of these': flooder.everything,
        }
        print(f'Flooded at {RATE:.0f} Hz, a request for parameters at a time [ms]')
        print(f'{"flood":16}{"median":>10}{"longest":>10}{"between diagnostics":>22}')
        for name, flood in floods.items():
            median, longest, gap = (1e3 * value for value in flooder.ask(flood))
            print(f'{name:16}{median:10.1f}{longest:10.1f}{gap:22.0f}', flush=True)


if __name__ == '__main__':
    main()
