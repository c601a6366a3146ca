"""The service ``push`` of the simulator: the arm is pushed, or let go, at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rclpy.node import Node
from std_srvs.srv import SetBool

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.simulation.sensors import Push


class PushService:
    """Begins the push that the parameters describe, or ends it, whatever `push.period` is."""

    def __init__(self, node: Node, push: Callable[[], Push]) -> None:
        """Offer the service on ``node``; ``push`` returns the present one."""
        self._push = push
        self._is_asked: bool | None = None
        node.create_service(SetBool, 'push', self._answer)

    def forget(self) -> None:
        """Push as the parameters say."""
        self._is_asked = None

    def at(self, time: float) -> FloatArray:
        """Force ``time`` [s] after the beginning (3,) [N]."""
        push = self._push()
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
