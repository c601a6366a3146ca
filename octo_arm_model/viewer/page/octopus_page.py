"""The page of `octo_arm_octopus`: eight arms, their rates and latency."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
import viser

from octo_arm_model.analysis.geometry.octopus_layout import RADIUS
from octo_arm_model.ros.client.client import ArmClient
from octo_arm_model.viewer.page import numbers
from octo_arm_model.viewer.page.scene import (
    BODY_COLOUR,
    ArmScene,
    LiveShape,
    set_scene,
    set_theme,
)
from octo_arm_model.viewer.page.view import View

_READING = 0.5  # [s] between numbers
_VIEW = (1.12, -0.94, 1.02)  # initial position of the camera, in units of 1.6 lengths


class OctopusPage:
    """Draws what the nodes of several arms publish."""

    def __init__(
        self,
        server: viser.ViserServer,
        clients: Sequence[ArmClient],
        describe: Callable[[], str],
    ) -> None:
        """Show on ``server`` the arms of ``clients``, and the text that ``describe`` returns."""
        self._server, self._clients, self._describe = server, clients, describe
        self._arms: list[ArmScene | None] = [None] * len(clients)
        self._stamps = [np.nan] * len(clients)
        self._read = -np.inf
        set_theme(server.gui, 'octo_arm: an octopus')
        self._text = server.gui.add_html('')
        server.scene.add_icosphere(
            '/body',
            radius=RADIUS,
            color=BODY_COLOUR,
            subdivisions=4,
            scale=(1.15, 1.15, 1.3),
            position=(0.0, 0.0, 0.6 * RADIUS),
        )

    def draw(self) -> None:
        """Draw new shapes and update the text, while a browser is connected."""
        if not self._server.get_clients():
            return
        with self._server.atomic():
            for index, client in enumerate(self._clients):
                self._draw_arm(index, client)
            if time.monotonic() - self._read > _READING:
                self._read = time.monotonic()
                self._text.content = numbers.note(self._describe())

    def _draw_arm(self, index: int, client: ArmClient) -> None:
        config, shape, strains = client.config, client.shape, client.strains
        if config is None or shape is None or strains is None:
            return
        arm = self._arms[index]
        if arm is None:
            if not any(self._arms):
                length = config.arm.length
                view = View(1.6 * length * np.array(_VIEW), np.zeros(3))
                set_scene(self._server, view, np.zeros(3), 1.6 * length, length)
            arm = ArmScene(
                self._server.scene,
                f'arm_{index + 1}',
                config.solver(),
                opacity=None,
                has_tendons=False,
            )
            self._arms[index] = arm
        if shape.stamp != self._stamps[index] and len(strains.s) == len(shape.position):
            self._stamps[index] = shape.stamp
            arm.show(LiveShape(shape.position, shape.quaternion, strains.q), np.zeros(0))
