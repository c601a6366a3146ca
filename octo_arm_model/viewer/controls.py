"""The controls of the page: tensions, movements, comparison of models, and a simulated arm."""

import html
import itertools
import threading
import time
from collections import deque
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np
import viser

from octo_arm_model.arm.errors import OctoArmError, ProfileError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.arm.stiffness import bending_force
from octo_arm_model.config.config import Config
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import MODELS, Solver
from octo_arm_model.ros.client.commands import SimulatorClient
from octo_arm_model.simulation import movements
from octo_arm_model.viewer import numbers
from octo_arm_model.viewer.commander import Commander, as_shell_line, as_yaml
from octo_arm_model.viewer.scene import OTHER_COLOUR, ArmScene, comparison_offset

# Queues a function for the thread of the viewer, because viser calls back in many threads.
Later = Callable[[Callable[[], None]], None]
_STEPS = 200  # number of steps of a slider
_COPY = (
    '<pre style="white-space:pre-wrap;word-break:break-all;user-select:all;margin:0 1em 0.6em;'
    'font-size:0.85em" class="octo-arm-copied">{text}</pre><button style="margin:0 1.2em 1em" '
    'onclick="navigator.clipboard.writeText(this.previousElementSibling.innerText);'
    "this.innerText='copied'\">copy</button>"
)


class Controls:
    """The controls for the tensions of one arm.

    Their callbacks are coroutines, which viser calls in the order of the events; it would call
    functions in any of many threads.

    Attributes:
        highest: limit of each tendon and end of its slider [N], (tendons,).
    """

    def __init__(
        self,
        server: viser.ViserServer,
        config: Config,
        commander: Commander,
        topic: str,
        later: Later,
    ) -> None:
        """Add the controls to the page of ``server``; commands are published on ``topic``."""
        self._gui, self._arm, self._commander = server.gui, config.arm, commander
        self._loop = server.get_event_loop()
        self._topic, self._later = topic, later
        self._lock, self._is_closed = threading.Lock(), False
        self.highest = movements.tendon_limits(config)
        self._sliders: list[viser.GuiSliderHandle[float]] = []
        # Values that browsers have moved each slider to and that are not commanded yet [N].
        self._moved: list[deque[float]] = []
        self._add_presets()
        self._add_sliders()
        self._add_copies()

    def follow(self) -> None:
        """Schedule that the controls are set to the commanded tensions.

        The event loop of viser does it: any other thread could do it between a value from a
        browser and its callback, and that value would be lost.
        """
        self._loop.call_soon_threadsafe(self._follow)

    def close(self) -> None:
        """Stop setting the controls, because they will be removed."""
        with self._lock:
            self._is_closed = True

    def _follow(self) -> None:
        """Set the sliders to the commanded tensions, except those whose command is due."""
        with self._lock:
            if self._is_closed:
                return
            tensions = self._commander.tensions.tolist()
            for slider, moved, tension in zip(self._sliders, self._moved, tensions, strict=True):
                # A slider that a browser is moving would jump back.
                if not moved and round(tension, 4) != round(slider.value, 4):
                    # The rounded value may exceed the slider's maximum. mypy misses the setter.
                    slider.value = min(round(tension, 4), slider.max)  # type: ignore[misc]
            is_playing = self._commander.profile is not None
            self._play.visible, self._stop.visible = not is_playing, is_playing

    def _add_presets(self) -> None:
        slack = self._gui.add_button('Let all go slack')
        rest = np.zeros(len(self._arm.tendons))

        slack.on_click(_in_order(lambda event: self._move(rest)))
        tensions_of = movements.figures(self._arm)
        if tensions_of:
            group = self._gui.add_button_group(
                'Figure', tuple(tensions_of), hint='Tensions of the figures of Renda et al. 2012'
            )
            group.on_click(_in_order(lambda event: self._move(tensions_of[event.target.value])))

    def _move(self, tensions: FloatArray) -> None:
        self._later(lambda: self._commander.move(tensions, time.monotonic()))

    def _add_sliders(self) -> None:
        tendons, count = itertools.count(), len(self._arm.sections)
        for number, section in enumerate(self._arm.sections, start=1):
            where = ' (tip)' if number == 1 < count else ' (base)' if number == count > 1 else ''
            with self._gui.add_folder(f'Section {number}{where}: tension [N]'):
                for _ in section.tendons:
                    self._add_slider(next(tendons))

    def _add_slider(self, tendon: int) -> None:
        name, highest = self._arm.tendon_names[tendon], float(self.highest[tendon])
        slider = self._gui.add_slider(
            name,
            min=0.0,
            max=highest,
            step=highest / _STEPS,
            initial_value=0.0,
            hint=f'Commanded tension of {name} [N]',
        )
        moved = deque[float]()
        self._sliders.append(slider)
        self._moved.append(moved)

        def pull() -> None:
            self._commander.pull(tendon, moved[0])
            moved.popleft()  # only now, because the slider then follows the commanded tension

        def moved_by(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client_id is not None:  # from a browser, not by `follow`
                moved.append(event.target.value)
                self._later(pull)

        slider.on_update(_in_order(moved_by))

    def add_profiles(self) -> None:
        """Add the controls that play movements to the current container."""
        names = movements.profile_names(self._arm)
        movement = self._gui.add_dropdown('Movement', tuple(names))
        description = self._gui.add_html(numbers.note(names[movement.value]))
        speed = self._gui.add_slider('Speed', min=0.1, max=3.0, step=0.1, initial_value=1.0)
        loop = self._gui.add_checkbox('Loop', initial_value=True)
        self._play = self._gui.add_button('Play', icon=viser.Icon.PLAYER_PLAY)
        self._stop = self._gui.add_button('Stop', icon=viser.Icon.PLAYER_STOP, visible=False)

        def play() -> None:
            # Only listed names are allowed: `movements.find_profile` reads others as file paths.
            if movement.value not in names:
                raise ProfileError(f'no movement {movement.value!r}, expected one that is listed')
            profile = movements.find_profile(movement.value, self._arm)
            movements.check_profile(profile, self._arm, self.highest)
            self._commander.play(profile, time.monotonic(), speed=speed.value, loop=loop.value)

        def describe(event: object) -> None:
            description.content = numbers.note(names[movement.value])

        def change_speed() -> None:
            self._commander.change_speed(speed.value, time.monotonic())

        movement.on_update(describe)
        self._play.on_click(_in_order(lambda event: self._later(play)))
        self._stop.on_click(_in_order(lambda event: self._later(self._commander.stop)))
        speed.on_update(_in_order(lambda event: self._later(change_speed)))

    def _add_copies(self) -> None:
        group = self._gui.add_button_group('Tensions as', ('YAML', 'ros2 line'))

        @group.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
            tensions = self._commander.tensions
            text = as_yaml(self._arm, tensions)
            if event.target.value != 'YAML':
                text = as_shell_line(self._arm, tensions, self._topic)
            if event.client is None:
                return
            gui = event.client.gui  # only this browser gets the window
            with (modal := gui.add_modal('Commanded tensions [N]')):
                gui.add_html(_COPY.format(text=html.escape(text)))
                gui.add_button('Close').on_click(lambda event: modal.close())


def _in_order(act: Callable[[Any], None]) -> Callable[[Any], Coroutine[Any, Any, None]]:
    """Return ``act`` as a coroutine, which viser calls in the order of the events."""

    async def call(event: Any) -> None:
        act(event)

    return call


NONE = 'none'


class ModelOverlay:
    """A second arm beside the first, solved by another model while one is chosen.

    Attributes:
        backbone: backbone of the second arm, or None.
    """

    def __init__(self, server: viser.ViserServer, config: Config, later: Later) -> None:
        """Add a list of the models that the node does not use."""
        self._server, self._config = server, config
        self.backbone: Backbone | None = None
        self._solver: Solver | None = None
        self._arm: ArmScene | None = None
        others = tuple(model for model in MODELS if model != config.model)
        server.gui.add_html(
            numbers.note(
                f'The node uses <b>{config.model}</b>. Another model is solved in this viewer, '
                'for the same tensions, and stands beside it.'
            )
        )
        menu = server.gui.add_dropdown('Compare with', (NONE, *others))
        self._text = server.gui.add_html('')
        menu.on_update(lambda event: later(lambda: self.choose(menu.value)))

    def choose(self, model: str) -> None:
        """Compare with ``model``, or end the comparison if it is `NONE`."""
        if self._arm is not None:
            self._arm.root.remove()
        self._arm = self._solver = self.backbone = None
        self._text.content = ''
        if model == NONE:
            return
        try:
            self._solver = self._config.solver(model)
        except OctoArmError as error:
            self._text.content = numbers.error_text(error)
            return
        scene, offset = self._server.scene, comparison_offset(self._config)
        self._arm = ArmScene(scene, 'other', self._solver, colour=OTHER_COLOUR, offset=offset)
        place = np.array(self._config.base.position) + [0.0, 0.0, 0.06 * self._config.arm.length]
        scene.add_label('/other/name', model, position=place)

    def show(self, tensions: FloatArray, pull: FloatArray, tip: FloatArray) -> None:
        """Solve the second arm for ``tensions`` (tendons,) [N], and draw it.

        ``pull`` (tendons,) is each tension divided by its limit, ``tip`` (3,) [m] the node's tip.
        """
        if self._solver is None or self._arm is None:
            return
        shaped = tensions.reshape(self._config.arm.tension_shape)
        try:
            self.backbone = self._solver.follow(shaped, self.backbone)
        except OctoArmError as error:
            self.backbone = None
            self._text.content = numbers.error_text(error)
        self._arm.root.visible = self.backbone is not None
        if self.backbone is not None:
            shape = self.backbone
            self._arm.show(shape.position, shape.quaternion, shape.q, pull)
            self._text.content = numbers.comparison(tip, self.backbone)


_PULLED = 0.3  # deflection of the tip by a pull that is as far away, over the length of the arm
_COLOUR = (79, 124, 172)  # colour of the current of the water


class MotionControls:
    """The controls of a simulated arm, with a point in the scene that pulls the tip if dragged."""

    def __init__(
        self, server: viser.ViserServer, config: Config, simulator: SimulatorClient, later: Later
    ) -> None:
        """Add the controls to the current container of the page of ``server``."""
        gui, length = server.gui, config.arm.length
        self._simulator, self._is_dragged = simulator, False
        # The pull acts as a spring between tip and point, of this stiffness [N/m].
        self._stiffness = bending_force(config.arm, _PULLED) / (_PULLED * length)
        gui.add_html(
            numbers.note('For a simulated arm that moves: drag the point at its tip to pull it.')
        )
        shown = gui.add_checkbox('Pull the tip', initial_value=False)
        self._paused = paused = gui.add_checkbox('Pause', initial_value=False)
        self._shown_pause = False
        self._handle = server.scene.add_transform_controls(
            '/pull', scale=0.18 * length, disable_rotations=True, depth_test=False, visible=False
        )

        def show() -> None:
            self._handle.visible = shown.value
            self._drag(self._is_dragged and shown.value)

        shown.on_update(lambda event: later(show))
        self._step = step = gui.add_button('Step', disabled=True)
        reset = gui.add_button('Reset')

        def pause() -> None:
            simulator.pause(paused.value)
            step.disabled = not paused.value  # a simulator that is not paused refuses steps

        paused.on_update(lambda event: later(pause) if event.client else None)  # of a browser
        step.on_click(lambda event: later(lambda: simulator.trigger('step')))
        reset.on_click(lambda event: later(lambda: simulator.trigger('reset')))
        self._handle.on_update(lambda event: later(lambda: self._drag(event.phase != 'end')))
        if any(config.motion.current):
            _show_current(server.scene, config)

    def let_go(self) -> None:
        """Stop pulling, as a browser that is closed does not send the end of a drag."""
        self._drag(False)

    def follow(self, tip: FloatArray) -> None:
        """Pull the ``tip`` (3,) [m] towards a dragged point, or move the point to the tip."""
        if self._is_dragged:
            self._simulator.pull(self._stiffness * (np.array(self._handle.position) - tip))
        else:
            self._handle.position = tip

    def show_pause(self, is_paused: bool | None) -> None:
        """Show a change of the pause of the simulator, which others may pause too."""
        if is_paused is not None and is_paused is not self._shown_pause:
            self._shown_pause = is_paused
            self._paused.value = is_paused  # type: ignore[misc]
            self._step.disabled = not is_paused

    def _drag(self, is_dragged: bool) -> None:
        if self._is_dragged and not is_dragged:
            self._simulator.pull(np.zeros(3))
        self._is_dragged = is_dragged


def _show_current(scene: viser.SceneApi, config: Config) -> None:
    """Draw an arrow beside the base along the current of the water."""
    velocity = np.array(config.motion.current)
    speed, length = float(np.linalg.norm(velocity)), 0.3 * config.arm.length
    beside = np.cross(velocity, np.eye(3)[np.argmin(np.abs(velocity))])
    start = config.base.position + 0.5 * length * beside / np.linalg.norm(beside)
    points = np.array([[start, start + length * velocity / speed]])
    scene.add_arrows(
        '/current',
        points,
        _COLOUR,
        shaft_radius=0.015 * length,
        head_radius=0.05 * length,
        head_length=0.2 * length,
    )
    scene.add_label('/current_name', f'current {speed:.3g} m/s', position=start)
