"""A server of pages that the tests of a module share."""

import socket

import pytest


@pytest.fixture(scope='module')
def server():
    """An empty page, served on a free port."""
    from octo_arm_model.viewer.server import serving

    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with serving('127.0.0.1', port) as server:
        yield server
