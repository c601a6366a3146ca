"""The figures and the range of the sliders, and whom they follow."""

import asyncio

import numpy as np
import pytest
from checkout import PRESETS

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
viser = pytest.importorskip('viser', reason='needs viser')

from octo_arm_model import load_config
from octo_arm_model.apps.demo import movement_of
from octo_arm_model.arm.stiffness import default_highest
from octo_arm_model.config.paper_data import BENDING, FETCHING_IN_PLANE, FETCHING_IN_SPACE
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.simulation.profiles.commands import find_profile
from octo_arm_model.simulation.profiles.limits import figures, highest_tensions
from octo_arm_model.viewer.commander import Commander
from octo_arm_model.viewer.controls import Controls

CONFIG = load_config(preset_path('renda2012_table4'))


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


class _Moved:
    """Controls whose sliders are moved as a browser does, and whose actions run when told to."""

    def __init__(self, server):
        self.commander, self._actions = Commander(np.zeros(12)), []
        self.controls = Controls(
            server, CONFIG, self.commander, '/tendon_commands', self._actions.append
        )
        with server.gui.add_folder('Profile'):
            self.controls.add_profiles()
        self.slider = self.controls._sliders[4]
        self.labelled = {
            handle.label: handle for handle in server.gui._gui_input_handle_from_uuid.values()
        }

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

    def command_rest(self):
        self.commander.move(np.zeros(12), 0.0, 1.0)
        self.commander.advance(2.0)


@pytest.fixture
def moved():
    server = viser.ViserServer('127.0.0.1', 0, verbose=False)
    yield _Moved(server)
    server.stop()


def test_a_slider_that_was_moved_meanwhile_does_not_jump_back(moved):
    moved.move(0.02)
    moved.controls.follow_at_once()
    assert moved.slider.value == 0.02  # nothing else is commanded yet
    moved.act()
    moved.move(0.04)  # between its command and what the page shows
    moved.controls.follow_at_once()
    assert moved.slider.value == 0.04
    moved.act()
    assert moved.commander.tensions[4] == 0.04
    moved.move(0.0412345)
    moved.act()
    moved.controls.follow_at_once()
    assert moved.slider.value == 0.0412345  # it is where it was moved to, not rounded
    moved.command_rest()
    moved.controls.follow_at_once()
    assert moved.slider.value == 0.0  # something else is commanded


def test_controls_that_are_removed_are_set_no_more(moved):
    moved.move(0.02)
    moved.act()
    moved.controls.close()
    moved.slider.remove()  # as where another arm is shown
    moved.command_rest()
    moved.controls.follow_at_once()
    assert moved.slider.value == 0.02


def test_a_slider_that_was_moved_during_a_movement_shows_what_it_commands(moved):
    moved.move(0.02)
    moved.commander.pull(4, 0.1)  # as a movement does until the slider's command
    moved.controls.follow_at_once()
    moved.act()
    moved.controls.follow_at_once()
    assert moved.slider.value == moved.commander.tensions[4] == 0.02


def test_what_is_pressed_and_moved_is_done_in_that_order(moved):
    buttons = {name: moved.labelled[name] for name in ('Let all go slack', 'Play', 'Stop')}
    for name, button in buttons.items():
        moved.tell(button)
        moved.move(0.02 + moved.slider.value)
        moved.act()
        assert not moved.commander.is_moving, name  # the slider came last, and stops all movement
        moved.move(0.02 + moved.slider.value)
        moved.tell(button)
        moved.act()
        assert moved.commander.is_moving == (name != 'Stop')
