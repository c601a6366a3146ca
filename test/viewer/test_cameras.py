"""From where an arm is seen at first, and where cameras point when windows change."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')
pytest.importorskip('viser', reason='needs viser')

from octo_arm_model.config.config import Config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.simulation.profiles.limits import figures, tendon_limits
from octo_arm_model.viewer.cameras import (
    ASPECT,
    FIELD,
    Cameras,
    View,
    framing,
    reached,
    tangent_of,
)

PRESETS = ('renda2012_prototype', 'renda2012_table2', 'renda2012_table4', 'rao2021')
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
    points = reached(config, tendon_limits(config))
    view = framing(points, tangent_of(config), aspect)
    places = seen(view, points, aspect)
    low, high = places.min(axis=0), places.max(axis=0)
    assert (np.abs(places) < 0.95).all()
    np.testing.assert_allclose(low + high, 0.0, atol=0.2)
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
    points = reached(twisted, tendon_limits(twisted))
    assert np.isfinite(points).all()
    np.testing.assert_allclose(points[30], [0.45, 0.0, 0.0], atol=1e-12)


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


def test_each_browser_sees_the_view_of_its_own_picture():
    server = Server()
    cameras = Cameras(server)
    early = server.open(1, 400, 800)  # before the arm is known
    cameras.aim(view_of, 0.1)
    np.testing.assert_allclose(server.initial_camera.position, view_of(ASPECT).position)
    late, none = server.open(2, 900, 600), server.open(3, 0, 0)
    assert sees(early, 0.5) and sees(late, 1.5) and sees(none, ASPECT)
    early.resize(800, 800)
    assert sees(early, 1.0) and sees(late, 1.5)
    cameras.aim(lambda aspect: view_of(2.0 * aspect), 0.1)  # another arm
    assert sees(early, 2.0) and sees(late, 3.0)


def test_a_camera_that_somebody_moved_is_left_until_the_button_is_pressed():
    server = Server()
    cameras = Cameras(server)
    cameras.aim(view_of, 0.1)
    browser = server.open(1, 800, 800)
    moved = browser.camera.position = np.array([0.3, -0.8, 0.1])
    browser.resize(400, 800)
    assert browser.camera.position is moved
    cameras.show(browser)
    assert sees(browser, 0.5)
    browser.resize(800, 400)
    assert sees(browser, 2.0)
