"""The controls of a simulated arm that moves: its tip pulled by the mouse, pause and step."""

from __future__ import annotations

import numpy as np
import viser

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import bending_force
from octo_arm_model.config.config import Config
from octo_arm_model.ros.client.commands import SimulatorClient
from octo_arm_model.viewer import numbers
from octo_arm_model.viewer.controls import Later

_PULLED = 0.3  # of the length: how far the tip moves under a pull that is as far away
_COLOUR = (79, 124, 172)  # of the water
_BARB = np.array([[0.0, 0.0, 0.0], [-0.25, 0.08, 0.0], [-0.25, -0.08, 0.0]])


class MotionControls:
    """The controls, and the point in the scene that pulls the tip while it is dragged."""

    def __init__(
        self, server: viser.ViserServer, config: Config, simulator: SimulatorClient, later: Later
    ) -> None:
        """Add them to the page of ``server``, within the current container."""
        gui, length = server.gui, config.arm.length
        self._simulator, self._is_dragged = simulator, False
        # As a spring between tip and point [N/m].
        self._stiffness = bending_force(config.arm, _PULLED) / (_PULLED * length)
        gui.add_html(
            numbers.note('For a simulated arm that moves: drag the point at its tip to pull it.')
        )
        shown = gui.add_checkbox('Pull the tip', initial_value=False)
        self._paused = paused = gui.add_checkbox('Pause', initial_value=False)
        self._is_told = False
        self._handle = server.scene.add_transform_controls(
            '/pull', scale=0.18 * length, disable_rotations=True, depth_test=False, visible=False
        )
        shown.on_update(lambda event: later(lambda: self._show(shown.value)))
        self._step = step = gui.add_button('Step', disabled=True)
        reset = gui.add_button('Begin anew')

        def pause() -> None:
            simulator.pause(paused.value)
            step.disabled = not paused.value  # one that moves refuses steps

        paused.on_update(lambda event: later(pause) if event.client else None)  # not of `tell`
        step.on_click(lambda event: later(lambda: simulator.trigger('step')))
        reset.on_click(lambda event: later(lambda: simulator.trigger('reset')))
        self._handle.on_update(lambda event: later(lambda: self._drag(event.phase != 'end')))
        # Of a browser that is closed no end comes.
        server.on_client_disconnect(lambda client: later(lambda: self._drag(False)))
        if any(config.motion.current):
            _show_current(server.scene, config)

    def follow(self, tip: FloatArray) -> None:
        """Pull the ``tip`` (3,) [m] towards the point, or bring that to the tip."""
        if self._is_dragged:
            self._simulator.pull(self._stiffness * (np.array(self._handle.position) - tip))
        else:
            self._handle.position = tip

    def tell(self, is_paused: bool | None) -> None:
        """Show whether the simulator stands still where that changes, as others stop it too."""
        if is_paused is not None and is_paused is not self._is_told:
            self._is_told = is_paused
            self._paused.value = is_paused  # type: ignore[misc]
            self._step.disabled = not is_paused

    def _show(self, is_shown: bool) -> None:
        self._handle.visible = is_shown
        if not is_shown:
            self._drag(False)

    def _drag(self, is_dragged: bool) -> None:
        if self._is_dragged and not is_dragged:
            self._simulator.pull(np.zeros(3))
        self._is_dragged = is_dragged


def _show_current(scene: viser.SceneApi, config: Config) -> None:
    """An arrow beside the base, along the current of the water."""
    velocity = np.array(config.motion.current)
    speed, length = float(np.linalg.norm(velocity)), 0.3 * config.arm.length
    along = velocity / speed
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    axes = np.array([along, across / np.linalg.norm(across), np.cross(along, across)])
    start = np.array(config.base.position) + 0.5 * length * axes[1]
    tip, left, right = start + length * (along + _BARB @ axes)
    points = np.array([[start, tip], [tip, left], [tip, right]])
    colours = np.broadcast_to(_COLOUR, points.shape).astype(np.uint8)
    scene.add_line_segments('/current', points, colours, thickness=4.0)
    scene.add_label('/current_name', f'current {speed:.3g} m/s', position=start)
