"""What is in the page, what its camera sees, and the server of it: host, port, document."""

import math
import signal
import socket
import urllib.request
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import viser
from checkout import PRESETS
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid

from octo_arm_model import Config, SolveError, load_config
from octo_arm_model.apps import octopus
from octo_arm_model.apps.demo import movement_of
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.rod.forms import is_available
from octo_arm_model.ros.client.client import PublishedShape, PublishedStrains
from octo_arm_model.simulation.movements import (
    figures,
    find_profile,
    highest_tensions,
    tendon_limits,
)
from octo_arm_model.viewer import main as viewer
from octo_arm_model.viewer import numbers
from octo_arm_model.viewer.controls import ModelOverlay
from octo_arm_model.viewer.scene import ASPECT, FIELD, framing, reachable_points, tangent_of
from octo_arm_model.viewer.server import AddressError, free_port, url
from octo_arm_model.wire.estimate import BackboneCovariance

CONFIG = load_config('renda2012_table4')
SOLVER = CONFIG.solver()
PROTOTYPE = load_config('renda2012_prototype')
EXACT = PROTOTYPE.solver('exact', 21)
SHAPE = EXACT.solve([[1.0, 0.4, 0.3, 0.5]])
FORCE = np.array([0.0, -0.006, 0.01])


def known(place, stddev=1e-3):
    pose = np.tile(1e-6 * np.eye(6), (21, 1, 1))
    return BackboneCovariance(SHAPE.s, pose, place, stddev**2 * np.eye(6))


def test_numbers_are_those_of_the_shapes():
    exact = CONFIG.solver('exact').solve(FETCHING_IN_SPACE)
    text = numbers.comparison(exact.tip + [0.003, 0.0, 0.004], exact)
    assert '>5.00<' in text and '1.1 % of the length' in text
    assert numbers.tip_angle(SOLVER.solve(np.zeros((3, 4)))) == 0.0
    backbone = SOLVER.solve(0.1 * np.array(FETCHING_IN_PLANE))
    # In one plane the tangent turns by the integral of the curvature.
    turned = np.rad2deg(trapezoid(backbone.k * (1.0 + backbone.q), backbone.s))
    assert numbers.tip_angle(backbone) == pytest.approx(abs(turned), abs=3.0)
    text = numbers.contact_force(FORCE, known(0.12))
    assert '-6.0 &plusmn; 1.0' in text and '10.0 &plusmn; 1.0' in text
    assert 'mN at s = 120 mm' in text
    assert 'all along' in numbers.contact_force(FORCE, known(math.nan))


def test_what_a_node_says_cannot_become_part_of_the_page():
    assert '<script>' not in numbers.error_text(SolveError('<script>alert(1)</script>'))
    assert '<b>' not in numbers.waiting('/<b>')
    backbone = SOLVER.solve(np.zeros((3, 4)))
    strains = (getattr(backbone, name) for name in PublishedStrains._fields[1:])
    client = SimpleNamespace(
        shape=PublishedShape(backbone.position, backbone.quaternion, 0.0, 0.0),
        strains=PublishedStrains('<script>alert(1)</script>', *strains),
        tip_deviation=np.zeros(3),
        force=None,
        covariance=None,
        latency=0.0,
        problem='<b>',
        rate=lambda: 1.0,
        age=lambda: 0.0,
    )
    text = numbers.live(client)
    assert '<script>' not in text and '&lt;script&gt;' in text and '<b>' not in text


def test_another_model_is_solved_beside_the_node_and_keeps_its_friction(server):
    rough = replace(PROTOTYPE, arm=replace(PROTOTYPE.arm, friction=(0.2,) * 4))
    overlay = ModelOverlay(server, rough, lambda do: do())
    overlay.choose('exact')
    solver, last = rough.solver('exact'), None
    for pull in (1.0, 3.0, 2.0):
        tensions = np.array([pull, 0.0, 0.0, 0.0])
        overlay.show(tensions, np.zeros(4), np.zeros(3))
        last = solver.follow([tensions], last)
        assert_allclose(overlay.backbone.tip, last.tip)
    # On the way back the friction holds the arm more bent than a pull from slack leaves it.
    apart = np.linalg.norm(overlay.backbone.tip - solver.solve([tensions]).tip)
    assert apart > 0.01 * rough.arm.length
    assert overlay._solver.is_compiled == is_available()


@pytest.mark.parametrize('name', PRESETS)
def test_sliders_reach_what_the_arm_bears_and_every_figure(name):
    arm = load_config(name).arm
    highest, bears = highest_tensions(arm), default_highest(arm).ravel()
    assert (highest >= bears).all() and (highest <= 1.25 * bears).all()
    for tensions in figures(arm).values():
        assert (tensions <= highest + 1e-12).all()
    find_profile(movement_of(arm), arm)
    expected = {'renda2012_table2': ['11 A', '11 B', '11 C'], 'renda2012_table4': ['14', '15']}
    assert list(figures(arm)) == expected.get(name, [])


# Cameras -----------------------------------------------------------------------------------------


HANGING = (0.0, 0.5**0.5, 0.0, 0.5**0.5)


def seen(view, points, aspect=ASPECT):
    """Where ``points`` are in the picture, from -1 to 1 across it and upwards."""
    forward = (view.look_at - view.position) / np.linalg.norm(view.look_at - view.position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    offset = points - view.position
    depth = offset @ forward
    assert (depth > 0.0).all()
    across = np.stack([offset @ right / aspect, offset @ np.cross(right, forward)], axis=1)
    return across / (depth * np.tan(0.5 * FIELD))[:, np.newaxis]


@pytest.mark.parametrize('aspect', [0.5, ASPECT, 2.0])
@pytest.mark.parametrize('quaternion', [(0.0, 0.0, 0.0, 1.0), HANGING])
@pytest.mark.parametrize('name', PRESETS)
def test_all_of_the_arm_is_in_the_middle_of_the_picture_and_fills_it(name, quaternion, aspect):
    config = Config.from_parameters({**load_parameters(name), 'base.quaternion': quaternion})
    points = reachable_points(config, tendon_limits(config))
    view = framing(points, tangent_of(config), aspect)
    places = seen(view, points, aspect)
    low, high = places.min(axis=0), places.max(axis=0)
    assert (np.abs(places) < 0.95).all()
    assert_allclose(low + high, 0.0, atol=0.2)
    assert (high - low).max() > 1.7
    # So is the arm at rest, which is what is seen at first.
    rest = np.array([points[0], points[30]])
    assert np.linalg.norm(points[30] - points[0]) == pytest.approx(config.arm.length)
    ends = seen(view, rest, aspect) * [aspect, 1.0]
    assert np.linalg.norm(ends[1] - ends[0]) > 1.0 * min(aspect, 1.0)
    solver = config.solver()
    for tensions in figures(config.arm).values() if aspect == ASPECT else ():
        for part in (0.4, 0.52, 0.6, 1.0):
            shape = solver.solve((part * tensions).reshape(config.arm.tension_shape))
            assert (np.abs(seen(view, shape.position)) < 1.0).all()


def test_an_arm_that_closed_form_does_not_cover_is_seen_at_rest():
    parameters = load_parameters('renda2012_table4')
    twisted = Config.from_parameters({**parameters, 'model': 'exact', 'tendons.twist': [0.5] * 12})
    points = reachable_points(twisted, tendon_limits(twisted))
    assert np.isfinite(points).all()
    assert_allclose(points[30], [0.45, 0.0, 0.0], atol=1e-12)


# Server ------------------------------------------------------------------------------------------


DEADLINE = 30.0  # [s]


def test_a_port_in_use_is_passed_over_until_none_is_left(monkeypatch):
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        assert port < free_port('127.0.0.1', port) <= port + 100
        monkeypatch.setattr('octo_arm_model.viewer.server._MOST_PORTS', 1)
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


def test_a_spare_connection_of_a_browser_is_no_refusal(server, caplog):
    for sent, lines in ((b'', 0), (b'GET /', 0), (b'what\r\n', 1)):
        with socket.create_connection(('127.0.0.1', server.get_port()), DEADLINE) as spare:
            spare.sendall(sent)
            spare.shutdown(socket.SHUT_WR)
            while spare.recv(1000):
                pass  # until the server has ended it
        # It has logged that when it answers another request, which has to be read to its end.
        urllib.request.urlopen(f'http://127.0.0.1:{server.get_port()}/', timeout=DEADLINE).read()
        assert len(caplog.messages) == lines


@pytest.mark.parametrize(
    ('program', 'arguments', 'words'),
    [
        (viewer, ('--port', '99999'), 'port is 99999, expected 1 to 65535'),
        (octopus, ('--port', '99999'), 'port is 99999, expected 1 to 65535'),
        (
            viewer,
            ('--allow-origin', 'arm.lab'),
            "origin is 'arm.lab', expected one such as http://arm.lab:8080",
        ),
        *(
            (viewer, ('--namespace', name), f'namespace is {name!r}, expected one such as arm_3')
            for name in ('a b', 'arm_3/', '3')
        ),
    ],
)
def test_wrong_input_is_one_clear_line(program, arguments, words, capsys):
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        assert program.main(arguments) == 2
    finally:  # of which a program takes notice
        for number, handler in before.items():
            signal.signal(number, handler)
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1 and words in complaint
