"""The host and port that a page is served on."""

import socket

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')


from octo_arm_model.viewer.server import AddressError, free_port, url

DEADLINE = 30.0  # [s]


def test_a_port_in_use_is_passed_over():
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        assert port < free_port('127.0.0.1', port) <= port + 100


def test_all_ports_in_use_is_an_error(monkeypatch):
    monkeypatch.setattr('octo_arm_model.viewer.server._TRIED', 1)
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(AddressError, match=f'ports {port} to {port} of 127.0.0.1 are all'):
            free_port('127.0.0.1', port)


@pytest.mark.parametrize('port', [0, -1, 65536])
def test_a_port_that_is_none_is_refused(port):
    with pytest.raises(AddressError, match=f'port is {port}, expected 1 to 65535'):
        free_port('127.0.0.1', port)


@pytest.mark.parametrize('host', ['192.0.2.1', 'no host at all', ''])
def test_a_host_that_is_none_of_this_machine_is_refused(host):
    with pytest.raises(AddressError, match='host'):
        free_port(host, 8080)


def test_the_page_is_for_this_machine_alone(server):
    port = server.get_port()
    assert url('127.0.0.1', port) == f'http://localhost:{port}'
    with socket.create_connection(('127.0.0.1', port), timeout=DEADLINE):
        pass
    with pytest.raises(OSError), socket.create_connection(('127.0.0.2', port), timeout=1.0):
        pass
