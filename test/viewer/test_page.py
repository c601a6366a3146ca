"""What is in the page: scene, uncertainty, plots, texts, controls and other models."""

import asyncio
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import viser
from checkout import PRESETS
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid

from octo_arm_model import SolveError, load_config
from octo_arm_model.analysis.drawing import UncertaintyDrawing
from octo_arm_model.apps.demo import movement_of
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.config.paper_data import FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.rod.forms import is_available
from octo_arm_model.ros.client.client import PublishedShape, PublishedStrains
from octo_arm_model.simulation.movements import figures, find_profile, highest_tensions
from octo_arm_model.viewer import numbers
from octo_arm_model.viewer.commander import Commander
from octo_arm_model.viewer.controls import Controls, ModelOverlay
from octo_arm_model.viewer.scene import UncertaintyScene
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


def test_what_is_drawn_is_what_is_known(server):
    server.scene.reset()
    scene = UncertaintyScene(server.scene, EXACT)
    drawing = UncertaintyDrawing(PROTOTYPE.arm, SHAPE.s, sides=24)

    def mesh(name):
        return server.scene.get_handle_by_name(f'/estimate/{name}')

    scene.show(SHAPE.position[1:], SHAPE.quaternion[1:], known(0.1), FORCE)
    assert mesh('tube') is None  # of another arm
    scene.show(SHAPE.position, SHAPE.quaternion, known(float(SHAPE.s[13])), FORCE)
    tube = drawing.tube(SHAPE.position, SHAPE.quaternion, known(0.0).pose[:, :3, :3])
    arrow = drawing.arrow(SHAPE.position[13], FORCE, 1e-6 * np.eye(3))
    for name, expected in (('tube', tube), ('force', arrow.shaft), ('cone', arrow.cone)):
        assert_allclose(mesh(name).vertices, expected, atol=1e-7)
        assert mesh(name).visible
    # A force that may as well be none is not drawn, nor is one that is not known.
    for unknown in (0.1 * FORCE, None):
        scene.show(SHAPE.position, SHAPE.quaternion, known(0.1), unknown)
        assert mesh('tube').visible
        assert not mesh('force').visible and not mesh('cone').visible
    # That of a current acts everywhere, and is drawn at the middle.
    scene.show(SHAPE.position, SHAPE.quaternion, known(math.nan), FORCE)
    assert_allclose(mesh('cone').vertices[-2], SHAPE.position[10], atol=1e-4)
    scene.hide()
    assert not mesh('tube').visible


def test_numbers_are_those_of_the_shapes():
    exact = CONFIG.solver('exact').solve(FETCHING_IN_SPACE)
    text = numbers.compared(exact.tip + [0.003, 0.0, 0.004], exact)
    assert '>5.00<' in text and '1.1 % of the length' in text
    assert numbers.tip_angle(SOLVER.solve(np.zeros((3, 4)))) == 0.0
    backbone = SOLVER.solve(0.1 * np.array(FETCHING_IN_PLANE))
    # In one plane the tangent turns by the integral of the curvature.
    turned = np.rad2deg(trapezoid(backbone.k * (1.0 + backbone.q), backbone.s))
    assert numbers.tip_angle(backbone) == pytest.approx(abs(turned), abs=3.0)
    text = numbers.pushed(FORCE, known(0.12))
    assert '-6.0 &plusmn; 1.0' in text and '10.0 &plusmn; 1.0' in text
    assert 'mN at s = 120 mm' in text
    assert 'all along' in numbers.pushed(FORCE, known(math.nan))


def test_what_a_node_says_cannot_become_part_of_the_page():
    assert '<script>' not in numbers.failed(SolveError('<script>alert(1)</script>'))
    assert '<b>' not in numbers.waiting('/<b>')
    backbone = SOLVER.solve(np.zeros((3, 4)))
    strains = (getattr(backbone, name) for name in PublishedStrains._fields[1:])
    client = SimpleNamespace(
        shape=PublishedShape(backbone.position, backbone.quaternion, 0.0, 0.0),
        strains=PublishedStrains('<script>alert(1)</script>', *strains),
        tip_deviation=np.zeros(3), force=None, covariance=None, latency=0.0, problem='<b>',
        rate=lambda: 1.0, age=lambda: 0.0,
    )  # fmt: skip
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
    expected = {
        'renda2012_table2': ['11 A', '11 B', '11 C'], 'renda2012_table4': ['14', '15'],
    }  # fmt: skip
    assert list(figures(arm)) == expected.get(name, [])


class Moved:
    """Controls whose sliders are moved as a browser does, and whose actions run when told to."""

    def __init__(self, server):
        self.commander, self._actions = Commander(np.zeros(12)), []
        topic, later = '/tendon_commands', self._actions.append
        self.controls = Controls(server, CONFIG, self.commander, topic, later)
        with server.gui.add_folder('Profile'):
            self.controls.add_profiles()
        self.slider = self.controls._sliders[4]
        handles = server.gui._gui_input_handle_from_uuid.values()
        self.labelled = {handle.label: handle for handle in handles}

    def move(self, value):
        """As viser does where a browser says so: the value first, then what listens."""
        self.slider._impl.value = value
        self.tell(self.slider)

    def tell(self, handle):
        """Have what listens to a control hear of it, at once as viser calls coroutines alone."""
        event = viser.GuiEvent(client=None, client_id=1, target=handle)
        asyncio.run(handle._impl.update_cb[0](event))

    def act(self):
        while self._actions:
            self._actions.pop(0)()

    def follow(self):
        """Value of the slider once the controls follow what is commanded."""
        self.controls.follow_at_once()
        return self.slider.value

    def command_rest(self):
        self.commander.move(np.zeros(12), 0.0, 1.0)
        self.commander.advance(2.0)


@pytest.fixture
def moved():
    server = viser.ViserServer('127.0.0.1', 0, verbose=False)
    yield Moved(server)
    server.stop()


def test_a_slider_that_was_moved_meanwhile_does_not_jump_back(moved):
    moved.move(0.02)
    assert moved.follow() == 0.02  # nothing else is commanded yet
    moved.act()
    moved.move(0.04)  # between its command and what the page shows
    assert moved.follow() == 0.04
    moved.act()
    assert moved.commander.tensions[4] == 0.04
    moved.move(0.0412345)
    moved.act()
    assert moved.follow() == 0.0412345  # it is where it was moved to, not rounded
    moved.move(0.02)
    moved.commander.pull(4, 0.1)  # as a movement does until the slider's command
    moved.follow()
    moved.act()
    assert moved.follow() == moved.commander.tensions[4] == 0.02
    moved.command_rest()
    assert moved.follow() == 0.0  # something else is commanded
    moved.controls.close()
    moved.slider.remove()  # as where another arm is shown
    moved.move(0.02)
    assert moved.follow() == 0.02


@pytest.mark.parametrize('name', ['Let all go slack', 'Play', 'Stop'])
def test_what_is_pressed_and_moved_is_done_in_that_order(moved, name):
    moved.tell(moved.labelled[name])
    moved.move(0.02)
    moved.act()
    assert not moved.commander.is_moving  # the slider came last, and stops all movement
    moved.move(0.04)
    moved.tell(moved.labelled[name])
    moved.act()
    assert moved.commander.is_moving == (name != 'Stop')
