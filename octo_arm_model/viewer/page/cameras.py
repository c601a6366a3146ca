"""The cameras of all browsers: the arm is in the picture until someone there looks elsewhere."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import viser

from octo_arm_model.viewer.page.view import ASPECT, FIELD, View

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
