"""Node, simulator and viewer as processes, for tests that come as a page to the viewer."""

import re
import socket
import time

import rclpy
from live_nodes import DEADLINE, PERIOD, new_domain, start, start_node, stop

from octo_arm_model.ros.client.client import DETAILS, POSES, ArmClient


class Setup:
    """Node, simulator and viewer, and a client that hears what they say."""

    def __init__(self):
        self._domain = new_domain()
        self.node = self.start_node()
        self.processes = [start_node('ros.simulator.main', self._domain)]
        # Its port is taken already, so it has to look for another.
        with socket.create_server(('127.0.0.1', 0)) as taken:
            self.port = taken.getsockname()[1]
            self.viewer = start(
                'viewer.main', '--port', self.port, domain=self._domain, PYTHONUNBUFFERED='1'
            )
            self.processes.append(self.viewer)
            self.said = self.viewer.stdout.readline()
        self.url = re.search(r'http://\S+', self.said)[0]
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=self._domain)
        self.client = ArmClient(rclpy.create_node('listener', context=self.context))
        self.client.listen({**POSES, **DETAILS})

    def start_node(self):
        return start_node('ros.node.main', self._domain)

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
        """End all of it; returns what the viewer complained of."""
        rclpy.shutdown(context=self.context)
        said = {process: stop(process) for process in [*self.processes, self.node]}
        return said[self.viewer]
