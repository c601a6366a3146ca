"""Where the cameras of browsers point when windows and panels change."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')

from octo_arm_model.viewer.cameras import ASPECT, Cameras, View


class Browser:
    """What `Cameras` needs of a client of viser: a camera, and word of its changes."""

    atomic = contextlib.nullcontext

    def __init__(self, number, view, width, height):
        self.client_id = number
        self.camera = SimpleNamespace(
            position=view.position, look_at=view.look_at, image_width=width, image_height=height,
            on_update=lambda tell: setattr(self, 'tell', tell),
        )  # fmt: skip

    def resize(self, width, height):
        self.camera.image_width, self.camera.image_height = width, height
        self.tell(self.camera)


class Server:
    """A server of viser with the browsers that it is given."""

    def __init__(self):
        self.initial_camera, self.browsers = SimpleNamespace(), {}

    def on_client_connect(self, meet):
        self.meet = meet

    def get_clients(self):
        return self.browsers

    def open(self, number, width, height):
        first = self.initial_camera
        view = View(getattr(first, 'position', np.ones(3)), getattr(first, 'look_at', np.zeros(3)))
        browser = self.browsers[number] = Browser(number, view, width, height)
        self.meet(browser)
        return browser


def view_of(aspect):
    """Farther for a narrower picture."""
    return View(np.array([0.0, -1.0 / aspect, 0.0]), np.array([aspect, 0.0, 0.0]))


def sees(browser, aspect):
    return np.allclose(browser.camera.position, view_of(aspect).position)


@pytest.fixture
def server():
    return Server()


@pytest.fixture
def cameras(server):
    return Cameras(server)


def test_each_browser_sees_the_view_of_its_own_picture(server, cameras):
    early = server.open(1, 400, 800)  # before the arm is known
    cameras.aim(view_of, 0.1)
    np.testing.assert_allclose(server.initial_camera.position, view_of(ASPECT).position)
    late = server.open(2, 900, 600)
    assert sees(early, 0.5)
    assert sees(late, 1.5)
    early.resize(800, 800)
    assert sees(early, 1.0)
    assert sees(late, 1.5)


def test_a_camera_that_somebody_moved_is_left_until_the_button_is_pressed(server, cameras):
    cameras.aim(view_of, 0.1)
    browser = server.open(1, 800, 800)
    moved = browser.camera.position = np.array([0.3, -0.8, 0.1])
    browser.resize(400, 800)
    assert browser.camera.position is moved
    cameras.show(browser)
    assert sees(browser, 0.5)
    browser.resize(800, 400)
    assert sees(browser, 2.0)


def test_another_arm_is_shown_to_all_and_a_window_of_no_size_breaks_nothing(server, cameras):
    cameras.aim(lambda aspect: View(np.ones(3), np.zeros(3)), 0.1)
    browsers = [server.open(1, 800, 800), server.open(2, 0, 0)]
    cameras.aim(view_of, 0.1)
    assert sees(browsers[0], 1.0)
    assert sees(browsers[1], ASPECT)
    del server.browsers[1]
    browsers[1].resize(100, 100)
    assert sees(browsers[1], 1.0)
