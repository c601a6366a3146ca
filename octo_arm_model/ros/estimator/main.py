"""The node ``octo_arm_estimator``: whatever is measured in, estimated shape and contact out."""

from __future__ import annotations

import sys
from functools import partial

from octo_arm_model.ros.estimator.server import EstimatorServer
from octo_arm_model.ros.node.main import ServedNode, run

NAME = 'octo_arm_estimator'
# Publishes the estimate of the arm for the measurements it receives.
EstimatorNode = partial(ServedNode, NAME, EstimatorServer)


def main(arguments: list[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run(NAME, EstimatorNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
