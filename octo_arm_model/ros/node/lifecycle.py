"""Managed nodes, and the node ``octo_arm_lifecycle_node``: `octo_arm_node` as one.

Configure loads and validates the arm, activate subscribes, deactivate unsubscribes, cleanup frees.
"""

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.ros.node.arm_server import ArmServer
from octo_arm_model.ros.node.main import run
from octo_arm_model.ros.node.server import Server
from octo_arm_model.ros.start import CheckedNode

SUCCESS = TransitionCallbackReturn.SUCCESS


class ManagedNode(CheckedNode, LifecycleNode):
    """Does what its server does while it is active."""

    def __init__(
        self, name: str, make_server: Callable[[Node], Server[Any, Any]], **options: Any
    ) -> None:
        """Declare the parameters; the arm is loaded when it is configured.

        Raises:
            ConfigError: if a parameter is of the wrong type.
        """
        super().__init__(name, **options)
        self._server = make_server(self)
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = partial(self._change_state, service.callback)

    def _change_state(
        self,
        change: Callable[..., ChangeState.Response],
        request: ChangeState.Request,
        response: ChangeState.Response,
    ) -> ChangeState.Response:
        """Change the state; a transition that is impossible from this state is refused."""
        try:
            return change(request, response)
        except RuntimeError as error:
            if not self.context.ok():
                raise
            self.get_logger().warning(f'transition {request.transition.id} refused: {error}')
            response.success = False
            return response

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load and validate the arm; a failure leaves the node unconfigured."""
        return self._attempt('configured', self._server.configure, self._server.cleanup)

    def _attempt(
        self, what: str, change: Callable[[], None], undo: Callable[[], None]
    ) -> TransitionCallbackReturn:
        """``change`` the server, or log that it is not ``what`` it should be, and ``undo`` it."""
        try:
            change()
        except OctoArmError as error:
            self.get_logger().error(f'not {what}: {error}')
            undo()
            return TransitionCallbackReturn.FAILURE
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to answer; a failure leaves the node inactive."""
        found = self._attempt('activated', self._server.activate, self._server.deactivate)
        return super().on_activate(state) if found == SUCCESS else found

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop answering."""
        self._server.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Free the arm and its publishers."""
        self._server.cleanup()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate and clean up, from any state."""
        self._server.deactivate()
        self._server.cleanup('finalized')
        return SUCCESS


# `OctoArmNode` as a managed node.
ManagedOctoArmNode = partial(ManagedNode, 'octo_arm', ArmServer)


main = partial(run, 'octo_arm_lifecycle_node', ManagedOctoArmNode)


if __name__ == '__main__':
    sys.exit(main())
