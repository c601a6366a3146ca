"""The node ``octo_arm_estimator``: whatever is measured in, estimated shape and contact out."""

from __future__ import annotations

import sys
from typing import Any

from octo_arm_model.ros.checked_node import CheckedNode
from octo_arm_model.ros.estimator.server import EstimatorServer
from octo_arm_model.ros.node.main import run

NAME = 'octo_arm_estimator'


class EstimatorNode(CheckedNode):
    """Publishes the estimate of the arm for the measurements it receives."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters, prepare the arm and create all ROS entities.

        Raises:
            OctoArmError: if a parameter is missing, unknown, of the wrong type or impossible, or
                they do not go together.
        """
        super().__init__(NAME, **options)
        self._server = EstimatorServer(self)
        self._server.configure()
        self._server.activate()


def main(arguments: list[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run(NAME, EstimatorNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
