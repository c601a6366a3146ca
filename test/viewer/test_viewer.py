"""The viewer without a browser: what it would command, draw and say."""

import shlex
import signal
import socket
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import trapezoid

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
viser = pytest.importorskip('viser', reason='needs viser')

from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from rclpy.serialization import serialize_message

from octo_arm_model import Inverse, SolveError, TipPosition, find_tensions, load_config
from octo_arm_model.analysis.arm_mesh import Drawing
from octo_arm_model.analysis.inverse import default_highest
from octo_arm_model.apps import octopus
from octo_arm_model.apps.demo import movement_of
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.config.presets import preset_path
from octo_arm_model.ros.client.topic import Meter, read_poses
from octo_arm_model.simulation.commands import find_profile
from octo_arm_model.simulation.limits import figures, highest_tensions
from octo_arm_model.simulation.profile import CommandProfile
from octo_arm_model.viewer import main as viewer
from octo_arm_model.viewer.address import AddressError, free_port, serving, url
from octo_arm_model.viewer.commander import Commander, as_shell_line, as_yaml
from octo_arm_model.viewer.page import numbers
from octo_arm_model.viewer.page.scene import ArmScene, _unit_disc
from octo_arm_model.viewer.page.target import Search
from octo_arm_model.wire.tension_messages import TENDON_TENSIONS

PRESETS = (
    'renda2012_fem',
    'renda2012_prototype',
    'renda2012_table2',
    'renda2012_table4',
    'rao2021',
)
DEADLINE = 30.0  # [s]
CONFIG = load_config(preset_path('renda2012_table4'))
SOLVER = CONFIG.solver()
RAMP = CommandProfile([0.0, 2.0, 3.0], [[1.0, 0.0], [3.0, 1.0], [1.0, 0.0]], 'linear')


# What is commanded ------------------------------------------------------------------------------


def test_nothing_is_commanded_before_a_hand_moves():
    commander = Commander([0.3, 0.0])
    assert commander.advance(0.0) is None
    assert not commander.is_moving
    commander.pull(1, 2.0)
    np.testing.assert_array_equal(commander.advance(1.0), [0.3, 2.0])
    assert commander.advance(2.0) is None


def test_a_posture_is_reached_smoothly_and_exactly():
    commander = Commander([2.0, 0.0])
    commander.move([0.0, 1.0], 10.0)
    way = [commander.advance(10.0 + t) for t in np.linspace(0.0, 1.0, 21)]
    seen = np.array([tensions for tensions in way if tensions is not None])
    assert (np.diff(seen[:, 0]) < 0.0).all()
    assert (np.diff(seen[:, 1]) > 0.0).all()
    assert np.abs(np.diff(seen, axis=0)).max() < 0.2  # no jump
    np.testing.assert_array_equal(seen[-1], [0.0, 1.0])
    assert not commander.is_moving
    assert commander.advance(12.0) is None


def test_a_profile_is_played_after_a_smooth_way_to_its_beginning():
    commander = Commander([0.0, 0.0])
    commander.play(RAMP, 5.0, speed=2.0)
    np.testing.assert_array_equal(commander.advance(6.0), RAMP.at(0.0))
    for time in (6.4, 7.1, 7.5, 8.9):
        np.testing.assert_allclose(commander.advance(time), RAMP.at(2.0 * (time - 6.0), loop=True))
    assert commander.is_moving
    commander.stop()
    assert commander.advance(10.0) is None


def test_a_profile_played_once_ends_where_it_ends():
    commander = Commander([1.0, 0.0])
    commander.play(RAMP, 0.0, loop=False)
    commander.advance(1.0)
    commander.advance(2.5)
    np.testing.assert_array_equal(commander.advance(9.0), RAMP.at(3.0))
    assert commander.profile is None
    assert commander.advance(10.0) is None


def test_another_speed_goes_on_from_the_same_place():
    commander = Commander([1.0, 0.0])
    commander.play(RAMP, 0.0)
    commander.advance(1.0)
    before = commander.advance(1.8)
    commander.change_speed(0.5, 1.8)
    np.testing.assert_allclose(commander.tensions, before)
    np.testing.assert_allclose(commander.advance(2.0), RAMP.at(0.9))


@pytest.mark.parametrize('what', ['move', 'play'])
def test_a_hand_on_a_slider_stops_what_is_under_way(what):
    commander = Commander([0.0, 0.0])
    if what == 'move':
        commander.move([4.0, 4.0], 0.0)
    else:
        commander.play(RAMP, 0.0)
        commander.advance(1.0)
    others = commander.advance(1.5)
    commander.pull(0, 0.25)
    assert not commander.is_moving
    np.testing.assert_array_equal(commander.advance(9.0), [0.25, others[1]])


@given(
    st.lists(st.integers(0, 50_000).map(lambda n: 1e-3 * n), min_size=12, max_size=12),
    st.floats(0.0, 5.0),
    st.floats(0.1, 3.0),
)
def test_whatever_is_commanded_is_a_tension(tensions, time, speed):
    commander = Commander(tensions)
    commander.play(find_profile('fetching', CONFIG.arm), 0.0, speed=speed)
    seen = commander.advance(time)
    assert seen is None or ((seen >= 0.0).all() and np.isfinite(seen).all())


def test_figures_are_those_of_the_paper_on_its_arms_alone():
    bends = figures(load_config(preset_path('renda2012_table2')).arm)
    assert list(bends) == ['11 A', '11 B', '11 C']
    np.testing.assert_array_equal(bends['11 B'], np.ravel(BENDING['B']))
    fetching = figures(CONFIG.arm)
    np.testing.assert_array_equal(fetching['14'], np.ravel(FETCHING_IN_PLANE))
    np.testing.assert_array_equal(fetching['15'], np.ravel(FETCHING_IN_SPACE))
    assert figures(load_config(preset_path('renda2012_prototype')).arm) == {}


@pytest.mark.parametrize('name', PRESETS)
def test_sliders_reach_what_the_arm_bears_and_every_figure(name):
    arm = load_config(preset_path(name)).arm
    highest = highest_tensions(arm)
    assert (highest >= default_highest(arm).ravel()).all()
    assert (highest <= 1.25 * default_highest(arm).ravel()).all()
    for tensions in figures(arm).values():
        assert (tensions <= highest + 1e-12).all()
    find_profile(movement_of(arm), arm)


@pytest.mark.parametrize('names', [(), ("it's", 'b: c', '#d', '"e"')])
def test_copied_tensions_are_the_message_they_stand_for(names):
    config = load_config(preset_path('renda2012_prototype'))
    arm = config.arm if not names else type(config.arm)(
        config.arm.material, config.arm.body, config.arm.sections, names
    )  # fmt: skip
    tensions = np.array([0.0, 1.0, 2.5, 1e-5])
    assert yaml.safe_load(as_yaml(arm, tensions)) == {
        'name': list(arm.tendon_names),
        'tension': tensions.tolist(),
    }
    *words, message = shlex.split(as_shell_line(arm, tensions, '/arm/tendon_commands'))
    assert words == [
        'ros2', 'topic', 'pub', '-1', '/arm/tendon_commands',
        'octo_arm_msgs/msg/TendonTensions',
    ]  # fmt: skip
    fields = yaml.safe_load(message)
    assert all(isinstance(tension, float) for tension in fields['tension'])
    read = TENDON_TENSIONS.read(SimpleNamespace(**fields), arm)
    np.testing.assert_array_equal(read.ravel(), tensions)


# What is searched -------------------------------------------------------------------------------


def test_of_many_targets_the_newest_is_found():
    answers = []
    search = Search(SOLVER, highest_tensions(CONFIG.arm), answers.append)
    try:
        for x in (0.44, 0.3, 0.2):
            search.look_for([x, 0.1, -0.1], np.zeros(12))
        last = SOLVER.solve(0.5 * np.array(FETCHING_IN_SPACE)).tip
        search.look_for(last, np.zeros(12))
        search.close()
        wait_for_end(search)
    finally:
        search.close()
    # Nothing of those left behind.
    assert len(answers) == 1
    assert answers[-1].reached
    np.testing.assert_allclose(answers[-1].backbone.tip, last, atol=1e-6)
    assert 'reached' in numbers.found(answers[-1])
    assert 'out of reach' not in numbers.found(answers[-1])


def test_what_cannot_be_reached_is_not_called_reached():
    answers = []
    search = Search(SOLVER, highest_tensions(CONFIG.arm), answers.append)
    search.look_for([0.5, 0.0, 0.0], np.zeros(12))
    search.close()
    wait_for_end(search)
    (answer,) = answers
    assert not answer.reached
    assert answer.error == pytest.approx(0.05, rel=1e-3)
    assert 'out of reach: the nearest found leaves 50.0 mm' in numbers.found(answer)


def test_nonsense_is_told_and_the_search_goes_on():
    answers = []
    search = Search(SOLVER, highest_tensions(CONFIG.arm), answers.append)
    search.look_for([np.nan, 0.0, 0.0], np.zeros(12))
    search.close()
    wait_for_end(search)
    assert 'finite' in numbers.failed(answers[0])


def wait_for_end(search):
    search.thread.join(DEADLINE)
    assert not search.thread.is_alive()


# What is drawn ----------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def server():
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with serving('127.0.0.1', port) as server:
        yield server


@pytest.mark.parametrize('name', PRESETS)
def test_the_scene_has_the_geometry_of_the_drawing(server, name):
    config = load_config(preset_path(name))
    solver = config.solver('exact')
    arm = ArmScene(server.scene, name, solver)
    highest = highest_tensions(config.arm)
    for part in (0.0, 0.3):
        tensions = np.zeros(highest.size)
        tensions[0] = part * highest[0]
        backbone = solver.solve(tensions.reshape(config.arm.tension_shape))
        arm.show(backbone, tensions / highest)
        drawn = Drawing(config.arm, solver.grid.s, widen=solver.law.widens, sides=24).draw(
            backbone.position, backbone.quaternion, backbone.q
        )
        body = server.scene.get_handle_by_name(f'/{name}/body')
        np.testing.assert_allclose(body.vertices, drawn.vertices, atol=1e-7)
        assert body.faces.max() < len(body.vertices)
        lines = server.scene.get_handle_by_name(f'/{name}/tendons')
        assert len(lines.points) == sum(len(path) - 1 for path in drawn.tendons)
        # The one that is pulled is the reddest, as are all its segments.
        first = len(drawn.tendons[0]) - 1
        red = lines.colors[:, 0, 0].astype(int) - lines.colors[:, 0, 1]
        assert (red[:first] > 0).all() == (part > 0.0)
        assert (red[first:] == 0).all()
        # Rims of discs are where they belong: in the plane of an anchorage, at its radius.
        discs = server.scene.get_handle_by_name(f'/{name}/discs').vertices
        each = discs.reshape(len(config.arm.sections), -1, 3)
        for vertices, centre, radius in zip(each, drawn.disc_position, drawn.disc_radius):
            away = np.linalg.norm(vertices[:-2] - centre, axis=1)
            half = 0.002 * config.arm.length
            np.testing.assert_allclose(away, np.hypot(radius, half), rtol=1e-4)


def test_a_disc_is_closed_and_faces_outwards():
    vertices, triangles = _unit_disc(0.2)
    first, second, third = vertices.T[triangles].transpose(1, 0, 2)
    volume = np.einsum('ti,ti->', first, np.cross(second, third)) / 6.0
    assert volume == pytest.approx(0.2 * 12.0 * np.sin(np.pi / 12.0), rel=1e-12)
    edges = {(a, b) for row in triangles.tolist() for a, b in zip(row, row[1:] + row[:1])}
    assert len(edges) == 3 * len(triangles)
    assert all((b, a) in edges for a, b in edges)


# What is said -----------------------------------------------------------------------------------


def test_compared_tips_are_as_far_apart_as_they_are():
    exact = CONFIG.solver('exact').solve(FETCHING_IN_SPACE)
    text = numbers.compared(exact.tip + [0.003, 0.0, 0.004], exact)
    assert '>5.00<' in text
    assert '1.1 % of the length' in text


def test_the_angle_of_the_tip_is_that_of_a_bend():
    straight = SOLVER.solve(np.zeros((3, 4)))
    assert numbers.tip_angle(straight) == 0.0
    backbone = SOLVER.solve(0.1 * np.array(FETCHING_IN_PLANE))
    # In one plane the tangent turns by the integral of the curvature.
    turned = np.rad2deg(trapezoid(backbone.k * (1.0 + backbone.q), backbone.s))
    assert numbers.tip_angle(backbone) == pytest.approx(abs(turned), abs=3.0)


def test_what_a_node_says_cannot_become_part_of_the_page():
    assert '<script>' not in numbers.failed(SolveError('<script>alert(1)</script>'))
    assert '<b>' not in numbers.waiting('/<b>')


def test_a_search_says_nothing_better_than_it_found():
    found = find_tensions(SOLVER, TipPosition([0.3, 0.2, 0.0]), highest_tensions(CONFIG.arm)[0])
    assert isinstance(found, Inverse)
    assert ('out of reach' in numbers.found(found)) == (not found.reached)


# Where it is served -----------------------------------------------------------------------------


def test_a_port_in_use_is_passed_over():
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        assert port < free_port('127.0.0.1', port) <= port + 100


def test_all_ports_in_use_is_an_error(monkeypatch):
    monkeypatch.setattr('octo_arm_model.viewer.address._TRIED', 1)
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


def test_options_that_are_none_are_refused(capsys):
    with pytest.raises(SystemExit) as ended:
        viewer.main(['--prot', '8081', '--ros-args', '-r', '__node:=other'])
    assert ended.value.code == 2
    assert 'unrecognized arguments: --prot 8081' in capsys.readouterr().err


def test_without_viser_there_is_a_hint(monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith('octo_arm_model.viewer.')]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'viser', None)
    assert viewer.main([]) == 2
    assert capsys.readouterr().err == (
        'octo_arm_viewer: error: needs viser; install it with: pip install viser\n'
    )


# What is heard ----------------------------------------------------------------------------------


@pytest.mark.parametrize('count', [0, 1, 101])
@given(frame=st.text(st.characters(codec='ascii', exclude_characters='\0'), max_size=20))
def test_poses_are_read_from_bytes_as_ros_reads_them(count, frame):
    message = PoseArray()
    message.header.stamp.sec, message.header.stamp.nanosec = -3, 250_000_000
    message.header.frame_id = frame
    expected = np.random.default_rng(count).normal(size=(count, 7))
    for x, y, z, qx, qy, qz, qw in expected.tolist():
        pose = Pose(position=Point(x=x, y=y, z=z))
        pose.orientation = Quaternion(x=qx, y=qy, z=qz, w=qw)
        message.poses.append(pose)
    stamp, poses = read_poses(serialize_message(message))
    assert stamp == -2.75
    np.testing.assert_array_equal(poses, expected)


# How often it happens ---------------------------------------------------------------------------


def test_rates_count_what_was_passed_over_and_begin_anew_with_the_node():
    meter = Meter()
    assert meter.rate(0.0) == 0.0
    for step in range(31):
        meter.count(step / 30.0, 4 * step)
    assert meter.rate(1.0) == pytest.approx(120.0)
    assert meter.rate(10.0) == 0.0
    meter.count(10.0, 1000)
    meter.count(10.5, 3)  # another publisher, which counts from 1
    meter.count(11.0, 8)
    assert meter.rate(11.0) == pytest.approx(10.0)
