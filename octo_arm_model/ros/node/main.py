"""The node ``octo_arm_node``: tendon tensions in, backbone and strains out."""

from __future__ import annotations

import contextlib
import faulthandler
import signal
import sys
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from octo_arm_model.core.errors import OctoArmError
from octo_arm_model.logs import show_logs
from octo_arm_model.ros.checked_node import CheckedNode
from octo_arm_model.ros.node.arm_server import ArmServer
from octo_arm_model.ros.node.middleware import bound_memory
from octo_arm_model.ros.start import start_ros

LONGEST_WAIT = 0.5  # [s] between looks at whether to go on
LONGEST_END = 4.0  # [s] for ROS to let go of a node


class OctoArmNode(CheckedNode):
    """Publishes the shape of the arm for every valid tension message."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters, prepare the arm and start listening.

        Raises:
            ConfigError: if a parameter is missing, unknown or of the wrong type, or they do not go
                together.
            ArmDefinitionError: if the arm cannot exist.
        """
        super().__init__('octo_arm', **options)
        self._server = ArmServer(self)
        self._server.configure()
        self._server.activate()


def make_executor() -> Executor:
    """The quickest executor there is."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def run(name: str, make_node: Callable[[], Node], arguments: list[str] | None = None) -> int:
    """Run a node until it is told to stop; returns the exit status."""
    # rclpy ends its context at SIGINT, which ends the loop below. Python would raise as well, in
    # the middle of whatever is being solved, and the executor would report that as a fault.
    signal.signal(signal.SIGINT, lambda number, frame: None)
    bound_memory()
    try:
        start_ros(arguments, SignalHandlerOptions.ALL)
    except OctoArmError as error:
        return _fail(name, str(error))
    logger = rclpy.logging.get_logger(name)
    show_logs(lambda text, is_warning: (logger.warning if is_warning else logger.info)(text))
    node = None
    try:
        node = make_node()
        executor = make_executor()
        executor.add_node(node)
        # Not `spin`: a signal that arrives just before the executor waits does not wake it, and
        # it would wait for ever.
        while rclpy.ok():
            executor.spin_once(timeout_sec=LONGEST_WAIT)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        # A signal may end the context while the executor builds its wait set on it.
        if rclpy.ok():
            raise
    except (OctoArmError, ParameterException) as error:
        return _fail(name, f'{error} (parameters come from --ros-args --params-file FILE)')
    except MemoryError:
        return _fail(name, 'out of memory')
    finally:
        # Where many participants leave at once Fast DDS may wait for itself for ever, and nothing
        # of Python runs meanwhile. Then this ends the process with status 1 and says where it was.
        with contextlib.suppress(RuntimeError):  # Without memory for it: the error says more.
            faulthandler.dump_traceback_later(LONGEST_END, exit=True)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
        faulthandler.cancel_dump_traceback_later()
    return 0


def _fail(name: str, problem: str) -> int:
    print(f'{name}: error: {problem}', file=sys.stderr)
    return 1


def main(arguments: list[str] | None = None) -> int:
    """Run the node; returns the exit status."""
    return run('octo_arm_node', OctoArmNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
