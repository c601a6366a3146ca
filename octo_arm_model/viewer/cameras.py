"""The cameras of all browsers: the arm is in the picture until someone there looks elsewhere."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import viser

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.rod.rotations import axes_of
from octo_arm_model.rod.solver import Solver
from octo_arm_model.simulation.movements import figures

FIELD = 0.7  # vertical field of view [rad]
ASPECT = 0.9  # width over height of the scene between the panels, in a usual window
_DIRECTION = (0.6, -1.0, 0.6)  # towards the camera: along the arm, across it and up
_MARGIN = 1.12
_STATIONS = 31
_CURLED = 0.2  # of the length: extent of a curled arm from its base
_PULL = 0.15  # of the limits: tension at which the tip is farthest from the axis
_ON_THE_WAY = (0.25, 0.5, 0.75, 1.0)  # of the tensions of a figure


class View(NamedTuple):
    """Position of the camera and the point it looks at, each (3,) [m]."""

    position: FloatArray
    look_at: FloatArray


def across(tangent: FloatArray) -> FloatArray:
    """Horizontal direction (3,) normal to ``tangent`` (3,); x if that is vertical."""
    found = np.cross([0.0, 0.0, 1.0], tangent)
    size = float(np.linalg.norm(found))
    return np.asarray(found / size if size > 1e-3 else np.array([1.0, 0.0, 0.0]))


def tangent_of(config: Config) -> FloatArray:
    """Direction of the resting arm (3,)."""
    return axes_of(config.base.quaternion)[:, 0]


def reached(config: Config, limits: FloatArray) -> FloatArray:
    """Points (points, 3) [m] of the arm at rest, curled, and with tendons tensioned.

    One tendon at a time, and fractions of the tensions of the paper's figures of the arm, without
    loads. For an arm that the model closed_form does not cover, those at rest and curled.
    """
    base, arm = np.array(config.base.position), config.arm
    rest = np.linspace(base, base + arm.length * tangent_of(config), _STATIONS)
    about = base + _CURLED * arm.length * np.concatenate([np.eye(3), -np.eye(3)])
    rest = np.concatenate([rest, about])
    sets = [*_PULL * np.diag(limits)]
    sets += [part * tensions for tensions in figures(arm).values() for part in _ON_THE_WAY]
    tensions = np.reshape(sets, (-1, *arm.tension_shape))
    try:
        bent = Solver(arm, 'closed_form', _STATIONS + len(arm.sections), config.base)
        return np.concatenate([rest, bent.solve(tensions).position.reshape(-1, 3)])
    except OctoArmError:
        return rest


def framing(points: FloatArray, tangent: FloatArray, aspect: float = ASPECT) -> View:
    """The nearest view with all ``points`` (points, 3) [m] in the picture, and centred.

    ``tangent`` (3,) is the direction of the arm, which is seen from the side; ``aspect`` is the
    width of the picture over its height.
    """
    along, side, up = _DIRECTION
    towards = along * tangent + side * across(tangent) + [0.0, 0.0, up]
    towards /= np.linalg.norm(towards)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right), towards])
    seen = points @ axes.T
    half = np.tan(0.5 * FIELD) * np.array([aspect, 1.0]) / _MARGIN
    # Perspective: a point at depth z is at the edge of the picture if its distance from the middle
    # is half (distance - z).
    low, high = seen[:, :2] + np.outer(seen[:, 2], half), seen[:, :2] - np.outer(seen[:, 2], half)
    most, least = low.max(axis=0), high.min(axis=0)
    middle, distance = 0.5 * (most + least), float(np.max(0.5 * (most - least) / half))
    look_at = np.append(middle, np.mean([seen[:, 2].min(), seen[:, 2].max()]))
    eye = np.append(middle, distance)
    return View(eye @ axes, look_at @ axes)


_SAME = 1e-3  # of the distance looked from: a camera moved by less has not been moved
_RESHAPED = 0.01  # relative change of the shape of a picture that calls for another view


class _Shown(NamedTuple):
    view: View
    aspect: float


class Cameras:
    """Points the cameras of the browsers at what is to be seen.

    The picture is what the panels leave free of a window. Each browser tells its shape, when it
    connects, and when windows and panels are moved.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        """Point at nothing until `aim`."""
        self._server = server
        self._view_of: Callable[[float], View] | None = None
        self._near = 0.01
        self._first: _Shown | None = None
        self._shown: dict[int, _Shown] = {}
        self._lock = threading.Lock()  # viser calls back in many threads
        # A window may be closed while its camera is moved, which is no fault.
        warnings.filterwarnings('ignore', 'Queued .* on a closed connection', UserWarning)
        server.on_client_connect(self._meet)

    def aim(self, view_of: Callable[[float], View], near: float) -> None:
        """Show in all browsers ``view_of`` their aspect, the width of the picture over its height.

        What is nearer to a camera than ``near`` [m] is not drawn.
        """
        view = view_of(ASPECT)
        with self._lock:
            self._view_of, self._near, self._first = view_of, near, _Shown(view, ASPECT)
            self._shown.clear()
        first = self._server.initial_camera
        first.look_at, first.position = view.look_at, view.position
        first.near, first.fov = near, FIELD
        for client in self._server.get_clients().values():
            self.show(client)

    def show(self, client: viser.ClientHandle) -> None:
        """Move the camera of one browser back to its view."""
        with self._lock:
            if self._view_of is None:
                return
            camera = client.camera
            aspect = _aspect(camera)
            view = self._view_of(aspect)
            connected = self._server.get_clients()
            self._shown = {key: one for key, one in self._shown.items() if key in connected}
            self._shown[client.client_id] = _Shown(view, aspect)
            with client.atomic():
                camera.up_direction = (0.0, 0.0, 1.0)
                camera.position, camera.look_at = view.position, view.look_at
                camera.near, camera.fov = self._near, FIELD

    def _meet(self, client: viser.ClientHandle) -> None:
        client.camera.on_update(lambda camera: self._follow(client))
        self._follow(client)

    def _follow(self, client: viser.ClientHandle) -> None:
        """Show the view for another shape of the picture, unless the camera has been moved."""
        with self._lock:
            shown = self._shown.get(client.client_id, self._first)
        camera = client.camera
        if shown is None or abs(_aspect(camera) / shown.aspect - 1.0) < _RESHAPED:
            return
        moved = np.abs(np.subtract([camera.position, camera.look_at], shown.view)).max()
        if moved < _SAME * np.linalg.norm(np.subtract(*shown.view)):
            self.show(client)


def _aspect(camera: viser.CameraHandle) -> float:
    """Width of the picture over its height; ASPECT while a window is of no size."""
    width, height = camera.image_width, camera.image_height
    return width / height if width > 0 and height > 0 else ASPECT
