"""The host, the port, the document and the command line of programs that serve a page."""

import signal
import socket
import urllib.request
from pathlib import Path

import pytest
import viser

from octo_arm_model.apps import octopus
from octo_arm_model.viewer import main as viewer
from octo_arm_model.viewer.server import AddressError, free_port, url

DEADLINE = 30.0  # [s]


def test_a_port_in_use_is_passed_over_until_none_is_left(monkeypatch):
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        assert port < free_port('127.0.0.1', port) <= port + 100
        monkeypatch.setattr('octo_arm_model.viewer.server._TRIED', 1)
        with pytest.raises(AddressError, match=f'ports {port} to {port} of 127.0.0.1 are all'):
            free_port('127.0.0.1', port)


@pytest.mark.parametrize(
    ('host', 'port', 'words'),
    [
        *(('127.0.0.1', port, f'port is {port}, expected 1 to 65535') for port in (0, -1, 65536)),
        *((host, 8080, 'host') for host in ('192.0.2.1', 'no host at all', '')),
    ],
)
def test_an_address_that_is_none_of_this_machine_is_refused(host, port, words):
    with pytest.raises(AddressError, match=words):
        free_port(host, port)


def test_the_page_is_for_this_machine_alone_and_named(server):
    port = server.get_port()
    assert url('127.0.0.1', port) == f'http://localhost:{port}'
    with pytest.raises(OSError), socket.create_connection(('127.0.0.2', port), timeout=1.0):
        pass
    # What is changed in the document of the installed viser is there.
    source = (Path(viser.__file__).parent / 'client' / 'build' / 'index.html').read_bytes()
    assert source.count(b'<title>Viser</title>') == 1
    with urllib.request.urlopen(f'http://127.0.0.1:{port}/', timeout=DEADLINE) as answer:
        page = answer.read()
    assert b'<title>octo_arm</title>' in page and b'Viser</title>' not in page


@pytest.mark.parametrize(
    ('program', 'arguments', 'words'),
    [
        (viewer, ('--port', '99999'), 'port is 99999, expected 1 to 65535'),
        (octopus, ('--port', '99999'), 'port is 99999, expected 1 to 65535'),
        (viewer, ('--allow-origin', 'arm.lab'),
         "origin is 'arm.lab', expected one such as http://arm.lab:8080"),
        *((viewer, ('--namespace', name), f'namespace is {name!r}, expected one such as arm_3')
          for name in ('a b', 'arm_3/', '3')),
    ],
)  # fmt: skip
def test_wrong_input_is_one_clear_line(program, arguments, words, capsys):
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        assert program.main(arguments) == 2
    finally:  # of which a program takes notice
        for number, handler in before.items():
            signal.signal(number, handler)
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1 and words in complaint
