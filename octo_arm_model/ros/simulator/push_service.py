"""How the simulated arm is pushed: by parameters, at once by the service ``push``, by messages."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import Vector3Stamped
from rclpy.node import Node
from std_msgs.msg import Header
from std_srvs.srv import SetBool

from octo_arm_model.arm.errors import LoadError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.simulation.dynamic_arm import DynamicArm
from octo_arm_model.simulation.parameters import SimulatorConfig
from octo_arm_model.simulation.pushed_arm import Push

TOPIC = 'push/force'


def check_frame(header: Header, config: SimulatorConfig, what: str) -> None:
    """Refuse ``what`` a message says in another frame than the base_frame of ``config``.

    Raises:
        LoadError: if it is.
    """
    if header.frame_id not in ('', config.base_frame):
        given = shown(header.frame_id)
        raise LoadError(f'the {what} is in frame {given}, expected {config.base_frame!r}')


_HOLD = 0.5  # [s] for which a force of a message acts, unless another comes


class PushService:
    """Begins the push that the parameters describe, or ends it, whatever `push.period` is.

    A force that messages hold is in its place.
    """

    def __init__(self, node: Node, push: Callable[[], Push]) -> None:
        """Offer the service on ``node``; ``push`` returns the present one."""
        self._push = push
        self._is_asked: bool | None = None
        self._held: FloatArray | None = None
        self._until: float | None = None
        node.create_service(SetBool, 'push', self._answer)

    def forget(self) -> None:
        """Push as the parameters say."""
        self._is_asked = self._held = None

    def hold(self, message: Vector3Stamped, config: SimulatorConfig, arm: DynamicArm) -> None:
        """Push the ``arm`` of ``config`` with the force of a ``message``, for half a second.

        Raises:
            LoadError: if it is in another frame than base_frame, not finite, or too large.
        """
        check_frame(message.header, config, 'force')
        force = np.array([message.vector.x, message.vector.y, message.vector.z])
        if not np.isfinite(force).all():
            raise LoadError(f'the force is {force.tolist()}, expected finite numbers [N]')
        arm.check_force(force)
        self._held, self._until = force, None

    def at(self, time: float) -> FloatArray:
        """Force ``time`` [s] after the beginning (3,) [N]."""
        push = self._push()
        if self._held is not None:
            self._until = time + _HOLD if self._until is None else self._until
            if time < self._until:
                return self._held
            self._held = None
        if self._is_asked is None:
            return push.at(time)
        return np.array(push.force) * self._is_asked

    def _answer(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        push = self._push()
        if not any(push.force):
            response.message = 'push.force is 0, expected a force [N] to push with'
            return response
        self._is_asked, response.success = bool(request.data), True
        where = f's = {push.s:g} m' if push.s else 'the tip'
        response.message = (
            f'pushes {where} with {list(push.force)} N' if request.data else 'lets go'
        )
        return response
