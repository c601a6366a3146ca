"""Run node, simulator and viewer for tests of the viewer."""

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
    """Node, simulator, a viewer as a process, and a client that receives their messages."""

    def __init__(self):
        self.domain = new_domain()
        self.node = self._start(OctoArmNode)
        self._simulator = self._start(SimulatorNode, rate=10.0)
        # The port is occupied, so that the viewer has to find another one.
        with socket.create_server(('127.0.0.1', 0)) as occupied:
            self.port = occupied.getsockname()[1]
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
        """Run a node until the returned stack is closed."""
        with contextlib.ExitStack() as stack:
            arguments = {'client': RosClient, 'domain': self.domain, **parameters}
            client = stack.enter_context(hosting(make_node, **arguments))
            stack.enter_context(spinning(client))
            return stack.pop_all()

    def tensions(self):
        """Return the newest tensions that the node has answered."""
        self.client.poll()
        return self.client.tensions

    def wait_for(self, condition, what):
        end = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < end, f'{what} did not happen in {DEADLINE} s'
            self.client.poll()
            time.sleep(PERIOD)

    def close(self):
        """End all programs and return the viewer's stderr."""
        rclpy.try_shutdown(context=self.context)
        stderr = stop(self.viewer) if self.viewer.returncode is None else ''
        self._simulator.close()
        self.node.close()
        return stderr
