"""The page of `octo_arm_octopus`: eight arms, their rates and latencies."""

import time
from collections.abc import Callable, Sequence

import numpy as np
import viser

from octo_arm_model.analysis.drawing import RADIUS
from octo_arm_model.ros.client.client import ArmClient
from octo_arm_model.viewer import numbers, scene
from octo_arm_model.viewer.scene import Cameras, View

_READING = 0.5  # [s] between updates of the numbers
_FROM = (1.8, -1.5, 1.63)  # position of the camera in lengths of an arm, for a wide picture
_WIDE = 1.5  # width over height of the narrowest picture that shows all arms from there


class OctopusPage:
    """Draws what the nodes of several arms publish."""

    def __init__(
        self,
        server: viser.ViserServer,
        clients: Sequence[ArmClient],
        describe: Callable[[], str],
        title: str,
    ) -> None:
        """Show the arms of ``clients`` and the text that ``describe`` returns on ``server``.

        ``title`` is the heading of the panel.
        """
        self._server, self._clients, self._describe = server, clients, describe
        self._arms: list[scene.ArmScene | None] = [None] * len(clients)
        self._stamps = [np.nan] * len(clients)
        self._read = -np.inf
        scene.set_theme(server.gui, title)
        self._cameras = Cameras(server)
        self._text = server.gui.add_html('')
        server.scene.add_icosphere(
            '/body',
            radius=RADIUS,
            color=scene.BODY_COLOUR,
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
                scene.set_scene(self._server, np.zeros(3), 1.6 * length, length)
                far = length * np.array(_FROM)
                self._cameras.aim(
                    lambda aspect: View(far * max(1.0, _WIDE / aspect), np.zeros(3)),
                    0.016 * length,
                )
            arm = scene.ArmScene(
                self._server.scene,
                f'arm_{index + 1}',
                config.solver(),
                opacity=None,
                has_tendons=False,
            )
            self._arms[index] = arm
        if shape.stamp != self._stamps[index] and len(strains.s) == len(shape.position):
            self._stamps[index] = shape.stamp
            arm.show(shape.position, shape.quaternion, strains.q, np.zeros(0))
