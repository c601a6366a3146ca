"""The command line of the programs that serve a page."""

import signal

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')

from octo_arm_model.apps import octopus
from octo_arm_model.viewer import main as viewer


@pytest.fixture
def signals():
    """Leave signals as they were, though a program takes notice of them."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures('signals')
@pytest.mark.parametrize('program', [viewer, octopus])
def test_wrong_input_is_one_clear_line(program, capsys):
    assert program.main(['--port', '99999']) == 2
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1
    assert 'port is 99999, expected 1 to 65535' in complaint


@pytest.mark.usefixtures('signals')
@pytest.mark.parametrize('name', ['a b', 'arm_3/', '3'])
def test_a_namespace_that_is_none_is_refused(name, capsys):
    assert viewer.main(['--namespace', name]) == 2
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1
    assert f'namespace is {name!r}, expected one such as arm_3' in complaint


def test_options_that_are_none_are_refused(capsys):
    with pytest.raises(SystemExit) as ended:
        viewer.main(['--prot', '8081', '--ros-args', '-r', '__node:=other'])
    assert ended.value.code == 2
    assert 'unrecognized arguments: --prot 8081' in capsys.readouterr().err
