"""Starts each of the programs, and ends it without a traceback at Ctrl-C while it is imported.

It stands beside the package, because importing anything of that takes most of the time.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from functools import partial


def _run(module: str, interrupted: int, program: str = 'main') -> int:
    """Run a ``program`` of ``module``; returns its exit status, ``interrupted`` while importing.

    Where ROS or an extra is missing, that is one line, and --help is answered nevertheless.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # and not ignored
        # The programs of ROS go on with a handler of their own.
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(interrupted))
    # Systems of equations are small. More threads of BLAS than cores that are free, as where other
    # programs run too, wait for each other: a solve takes up to a hundred times as long.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    if sys.stderr is None:  # closed: what is printed to it would go to standard output
        sys.stderr = open(os.devnull, 'w')
    try:
        status: int = getattr(importlib.import_module(module), program)()
    except ModuleNotFoundError as error:
        terminal = importlib.import_module('octo_arm_model.terminal')
        name = os.path.basename(sys.argv[0])
        if module.startswith('octo_arm_model.ros.'):  # which imports ROS before it reads arguments
            importlib.import_module('octo_arm_model.ros.processes').arguments_of_ros(name)
        status = terminal.fail(name, terminal.missing(error))
    return status


command_line = partial(_run, 'octo_arm_model.cli.main', 130)
# To the others Ctrl-C is the usual end.
demo = partial(_run, 'octo_arm_model.apps.demo', 0)
estimator = partial(_run, 'octo_arm_model.ros.estimator.main', 0)
lifecycle_estimator = partial(_run, 'octo_arm_model.ros.estimator.main', 0, 'managed')
lifecycle_node = partial(_run, 'octo_arm_model.ros.node.main', 0, 'managed')
node = partial(_run, 'octo_arm_model.ros.node.main', 0)
octopus = partial(_run, 'octo_arm_model.apps.octopus', 0)
simulator = partial(_run, 'octo_arm_model.ros.simulator.main', 0)
viewer = partial(_run, 'octo_arm_model.viewer.main', 0)
