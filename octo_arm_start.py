"""Starts each of the programs, and ends it without a traceback at Ctrl-C while it is imported.

It stands beside the package, because importing anything of that takes most of the time.
"""

from __future__ import annotations

import importlib
import os
import signal


def _run(module: str, interrupted: int) -> int:
    """Run ``module``; returns its exit status, or ``interrupted`` where it is not yet imported."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # and not ignored
        # The programs of ROS go on with a handler of their own.
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(interrupted))
    status: int = importlib.import_module(module).main()
    return status


def command_line() -> int:
    """Run ``octo-arm``."""
    return _run('octo_arm_model.cli.main', 130)


def demo() -> int:
    """Run ``octo_arm_demo``."""
    return _run('octo_arm_model.apps.demo', 0)


def estimator() -> int:
    """Run ``octo_arm_estimator``."""
    return _run('octo_arm_model.ros.estimator.main', 0)


def lifecycle_estimator() -> int:
    """Run ``octo_arm_lifecycle_estimator``."""
    return _run('octo_arm_model.ros.estimator.lifecycle', 0)


def lifecycle_node() -> int:
    """Run ``octo_arm_lifecycle_node``."""
    return _run('octo_arm_model.ros.node.lifecycle', 0)


def node() -> int:
    """Run ``octo_arm_node``."""
    return _run('octo_arm_model.ros.node.main', 0)


def octopus() -> int:
    """Run ``octo_arm_octopus``."""
    return _run('octo_arm_model.apps.octopus', 0)


def simulator() -> int:
    """Run ``octo_arm_sim``."""
    return _run('octo_arm_model.ros.simulator_node', 0)


def viewer() -> int:
    """Run ``octo_arm_viewer``."""
    return _run('octo_arm_model.viewer.main', 0)
