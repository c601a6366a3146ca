"""Node, simulator and viewer as processes, for tests that come as a page to the viewer."""

import itertools
import os
import re
import signal
import socket
import subprocess
import sys
import time

import rclpy

from octo_arm_model import load_config
from octo_arm_model.config.presets import preset_path
from octo_arm_model.ros.client.client import DETAILS, POSES, ArmClient

DEADLINE = 30.0  # [s]
CONFIG_FILE = str(preset_path('renda2012_table4'))
CONFIG = load_config(CONFIG_FILE)
SOLVER = CONFIG.solver()
_DOMAINS = itertools.count(101 + os.getpid() % 40)


class Setup:
    """Node, simulator and viewer, and a client that hears what they say."""

    def __init__(self):
        self._domain = next(_DOMAINS)
        self._environment = dict(
            os.environ,
            ROS_DOMAIN_ID=str(self._domain),
            ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST',
            PYTHONUNBUFFERED='1',
        )
        self.node = self.start_node()
        self.processes = [
            self.start('ros.simulator_node', '--ros-args', '--params-file', CONFIG_FILE),
        ]
        # Its port is taken already, so it has to look for another.
        with socket.create_server(('127.0.0.1', 0)) as taken:
            self.port = taken.getsockname()[1]
            self.viewer = self.start('viewer.main', '--port', str(self.port))
            self.processes.append(self.viewer)
            self.said = self.viewer.stdout.readline()
        self.url = re.search(r'http://\S+', self.said)[0]
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=self._domain)
        self.client = ArmClient(rclpy.create_node('listener', context=self.context))
        self.client.listen({**POSES, **DETAILS})

    def start(self, module, *arguments):
        return subprocess.Popen(
            [sys.executable, '-m', f'octo_arm_model.{module}', *arguments],
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def start_node(self):
        return self.start('ros.node.main', '--ros-args', '--params-file', CONFIG_FILE)

    def tensions(self):
        """The newest that the node answered."""
        self.client.poll()
        return self.client.tensions

    def wait_for(self, condition, what):
        end = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < end, f'{what} did not happen in {DEADLINE} s'
            self.client.poll()

    def close(self):
        """End all of it; returns what the viewer complained of."""
        rclpy.shutdown(context=self.context)
        said = {}
        for process in [*self.processes, self.node]:
            process.send_signal(signal.SIGINT)
            _, said[process] = process.communicate(timeout=DEADLINE)
            assert process.returncode == 0, said[process]
            assert 'Traceback' not in said[process], said[process]
        return said[self.viewer]
