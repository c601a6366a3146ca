"""A server of pages that the tests of a module share."""

import socket
from importlib.util import find_spec

import pytest

# All of them need ROS 2, the message package, see make test, and viser.
_NEEDED = 'rclpy', 'octo_arm_msgs', 'viser'
collect_ignore_glob = [] if all(map(find_spec, _NEEDED)) else ['*']


@pytest.fixture(scope='module')
def server():
    """An empty page, served on a free port."""
    from octo_arm_model.viewer.server import serving

    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with serving('127.0.0.1', port) as server:
        yield server
