"""The node ``octo_arm_lifecycle_estimator``: the estimator as a managed node."""

from __future__ import annotations

import sys
from functools import partial

from octo_arm_model.ros.estimator.main import NAME
from octo_arm_model.ros.estimator.server import EstimatorServer
from octo_arm_model.ros.node.lifecycle import ManagedNode
from octo_arm_model.ros.node.main import run

# `EstimatorNode` as a managed node.
ManagedEstimatorNode = partial(ManagedNode, NAME, EstimatorServer)


def main(arguments: list[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run('octo_arm_lifecycle_estimator', ManagedEstimatorNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
