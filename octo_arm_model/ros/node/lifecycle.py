"""The node ``octo_arm_lifecycle_node``: the same, for stacks that supervise their nodes.

Configure loads and validates the arm, activate starts answering, deactivate stops, cleanup frees.
"""

from __future__ import annotations

import sys
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from octo_arm_model.core.errors import OctoArmError
from octo_arm_model.ros.node.arm_server import Engine
from octo_arm_model.ros.node.main import run


class ManagedOctoArmNode(LifecycleNode):
    """Publishes the shape of the arm for every valid tension message while it is active."""

    def __init__(self, **options: Any) -> None:
        """Declare the parameters; the arm is loaded when it is configured.

        Raises:
            ConfigError: if a parameter is of the wrong type.
        """
        super().__init__(
            'octo_arm', automatically_declare_parameters_from_overrides=True, **options
        )
        self._engine = Engine(self)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load and validate the arm; a failure leaves the node as it was."""
        try:
            self._engine.configure()
        except OctoArmError as error:
            self.get_logger().error(f'not configured: {error}')
            self._engine.cleanup()
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start answering; a failure leaves the node as it was."""
        try:
            self._engine.activate()
        except OctoArmError as error:
            self.get_logger().error(f'not activated: {error}')
            self._engine.deactivate()
            return TransitionCallbackReturn.FAILURE
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop answering."""
        self._engine.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Free the arm."""
        self._engine.cleanup()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and free, from whichever state."""
        self._engine.deactivate()
        self._engine.cleanup()
        return TransitionCallbackReturn.SUCCESS


def main(arguments: list[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run('octo_arm_lifecycle_node', ManagedOctoArmNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
