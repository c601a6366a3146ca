"""The entry points of the programs, which end without a traceback at Ctrl-C during imports.

This module is beside the package, because the import of any of its modules takes most of the time.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from functools import partial


def _run(module: str, interrupted: int, program: str = 'main') -> int:
    """Run a ``program`` of ``module``, and return its exit status: ``interrupted`` during imports.

    If ROS or an extra is missing, one line says so, and --help is answered nevertheless.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is ignored
        # The programs of ROS replace this handler by their own.
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(interrupted))
    # Systems of equations are small. If BLAS has more threads than other programs leave cores, the
    # threads wait for each other, and a solve takes up to a hundred times as long.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    if sys.stderr is None:  # it is closed, and errors would go to standard output
        sys.stderr = open(os.devnull, 'w')
    try:
        status: int = getattr(importlib.import_module(module), program)()
    except ModuleNotFoundError as error:
        terminal = importlib.import_module('octo_arm_model.terminal')
        name = os.path.basename(sys.argv[0])
        if module.startswith('octo_arm_model.ros.'):  # these import ROS before they read arguments
            importlib.import_module('octo_arm_model.ros.processes').arguments_of_ros(name)
        status = terminal.fail(name, terminal.missing(error))
    return status


command_line = partial(_run, 'octo_arm_model.cli.main', 130)
# Ctrl-C is the usual end of the other programs.
demo = partial(_run, 'octo_arm_model.apps.demo', 0)
estimator = partial(_run, 'octo_arm_model.ros.estimator.main', 0)
lifecycle_estimator = partial(_run, 'octo_arm_model.ros.estimator.main', 0, 'managed')
lifecycle_node = partial(_run, 'octo_arm_model.ros.node.main', 0, 'managed')
node = partial(_run, 'octo_arm_model.ros.node.main', 0)
octopus = partial(_run, 'octo_arm_model.apps.octopus', 0)
simulator = partial(_run, 'octo_arm_model.ros.simulator.main', 0)
viewer = partial(_run, 'octo_arm_model.viewer.main', 0)
