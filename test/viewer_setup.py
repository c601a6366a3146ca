"""Node, simulator and viewer, for tests that come as a page to the viewer."""

import contextlib
import re
import socket
import time

import rclpy
from live_nodes import DEADLINE, PERIOD, RosClient, hosting, new_domain, spinning, start, stop

from octo_arm_model.ros.client.client import DETAILS, POSES, ArmClient
from octo_arm_model.ros.node.main import OctoArmNode
from octo_arm_model.ros.simulator.main import SimulatorNode


class Setup:
    """Node and simulator, a viewer as a process, and a client that hears what they say."""

    def __init__(self):
        self.domain = new_domain()
        self.node = self._start(OctoArmNode)
        self._simulator = self._start(SimulatorNode, rate=10.0)
        # Its port is taken already, so it has to look for another.
        with socket.create_server(('127.0.0.1', 0)) as taken:
            self.port = taken.getsockname()[1]
            self.viewer = start(
                'viewer.main', '--port', self.port, domain=self.domain, PYTHONUNBUFFERED='1'
            )
            self.said = self.viewer.stdout.readline()
        self.url = re.search(r'http://\S+', self.said)[0]
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.client = ArmClient(rclpy.create_node('listener', context=self.context))
        self.client.listen({**POSES, **DETAILS})

    def _start(self, make_node, **parameters):
        """A node that works until what is returned is closed."""
        with contextlib.ExitStack() as stack:
            given = {'client': RosClient, 'domain': self.domain, **parameters}
            client = stack.enter_context(hosting(make_node, **given))
            stack.enter_context(spinning(client))
            return stack.pop_all()

    def tensions(self):
        """The newest that the node answered."""
        self.client.poll()
        return self.client.tensions

    def wait_for(self, condition, what):
        end = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < end, f'{what} did not happen in {DEADLINE} s'
            self.client.poll()
            time.sleep(PERIOD)

    def close(self):
        """End what still runs of it; returns what the viewer complained of."""
        rclpy.try_shutdown(context=self.context)
        said = stop(self.viewer) if self.viewer.returncode is None else ''
        self._simulator.close()
        self.node.close()
        return said
