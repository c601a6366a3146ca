"""A second arm, by another model: solved in the viewer for the tensions of the node."""

from __future__ import annotations

import numpy as np
import viser

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.config.config import Config
from octo_arm_model.rod.backbone import Backbone
from octo_arm_model.rod.solver import MODELS, Solver
from octo_arm_model.viewer.page import numbers
from octo_arm_model.viewer.page.controls import Later
from octo_arm_model.viewer.page.scene import OTHER_COLOUR, ArmScene, beside

NONE = 'none'


class ModelOverlay:
    """The second arm, shown while a model is chosen.

    Attributes:
        backbone: its backbone; None for none.
    """

    def __init__(self, server: viser.ViserServer, config: Config, later: Later) -> None:
        """Add the choice among the models that the node does not use."""
        self._server, self._config, self._later = server, config, later
        self.backbone: Backbone | None = None
        self._solver: Solver | None = None
        self._arm: ArmScene | None = None
        self._label: viser.LabelHandle | None = None
        others = tuple(model for model in MODELS if model != config.model)
        server.gui.add_html(
            numbers.note(
                f'The node uses <b>{config.model}</b>. Another model is solved in this viewer, '
                'for the same tensions, and stands beside it.'
            )
        )
        chosen = server.gui.add_dropdown('Compare with', (NONE, *others))
        self._text = server.gui.add_html('')
        chosen.on_update(lambda event: later(lambda: self.choose(chosen.value)))

    def choose(self, model: str) -> None:
        """Compare with ``model``, or with none."""
        for part in (self._arm, self._label):
            if part is not None:
                part.remove()
        self._arm = self._label = self._solver = self.backbone = None
        self._text.content = ''
        if model == NONE:
            return
        try:
            self._solver = self._config.solver(model)
        except OctoArmError as error:
            self._text.content = numbers.failed(error)
            return
        offset = beside(self._config)
        self._arm = ArmScene(
            self._server.scene, 'other', self._solver, colour=OTHER_COLOUR, offset=offset
        )
        above = np.array(self._config.base.position) + [0.0, 0.0, 0.06 * self._config.arm.length]
        self._label = self._server.scene.add_label('/other_name', model, position=above + offset)

    def show(self, tensions: FloatArray, pull: FloatArray, tip: FloatArray) -> None:
        """Solve and draw for ``tensions`` (tendons,) [N].

        ``pull`` (tendons,) is the tension over its limit, ``tip`` (3,) [m] the tip of the node.
        """
        if self._solver is None or self._arm is None:
            return
        shaped = tensions.reshape(self._config.arm.tension_shape)
        try:
            self.backbone = self._solver.follow(shaped, self.backbone)
        except OctoArmError as error:
            self.backbone = None
            self._text.content = numbers.failed(error)
        self._arm.root.visible = self.backbone is not None
        if self.backbone is not None:
            self._arm.show(self.backbone, pull)
            self._text.content = numbers.compared(tip, self.backbone)
