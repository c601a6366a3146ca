"""The node ``octo_arm_node``: tendon tensions in, backbone and strains out.

``octo_arm_lifecycle_node`` is the same as a managed node: configure loads and validates the arm,
activate subscribes, deactivate unsubscribes, cleanup frees.
"""

import contextlib
import ctypes
import faulthandler
import os
import sys
from collections.abc import Callable, MutableMapping
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.ros.node.arm_server import ArmServer
from octo_arm_model.ros.node.server import Server
from octo_arm_model.ros.processes import arguments_of_ros
from octo_arm_model.ros.start import CheckedNode, start_ros
from octo_arm_model.ros.work import guarded, ignore_signals, install, interruptible
from octo_arm_model.terminal import fail, show_logs

PROFILES = Path(__file__).with_name('fastdds.xml')
_FILES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
_FROM_XML = 'RMW_FASTRTPS_USE_QOS_FROM_XML'
# A user who sets one of these variables, or has one of these files, has configured Fast DDS.
_DECISIONS = (*_FILES, _FROM_XML, 'RMW_FASTRTPS_PUBLICATION_MODE')
_LOCAL_FILES = ('DEFAULT_FASTDDS_PROFILES.xml', 'DEFAULT_FASTRTPS_PROFILES.xml')


def bound_memory(
    environment: MutableMapping[str, str] = os.environ, folder: Path = Path()
) -> bool:
    """Make Fast DDS load `PROFILES` in this process, by environment variables.

    By default every slot of every queue keeps the memory of the largest message it has held, so
    the memory of some hundred large messages is never freed.

    Returns:
        False if the user has configured Fast DDS, whose settings are then kept.
    """
    if any(name in environment for name in _DECISIONS):
        return False
    if any((folder / name).exists() for name in _LOCAL_FILES):
        return False
    environment.update(dict.fromkeys(_FILES, str(PROFILES)))
    environment[_FROM_XML] = '1'
    return True


LONGEST_WAIT = 0.5  # [s] between checks for shutdown
LONGEST_END = 4.0  # [s] that ROS may take to destroy a node


class ServedNode(CheckedNode):
    """A node whose server answers from the start."""

    def __init__(
        self, name: str, make_server: Callable[[Node], Server[Any, Any]], **options: Any
    ) -> None:
        """Prepare the arm and all ROS entities; OctoArmError if the parameters are invalid."""
        super().__init__(name, **options)
        self._server = make_server(self)
        self._server.configure()
        self._server.activate()


_SUCCESS = TransitionCallbackReturn.SUCCESS


class ManagedNode(CheckedNode, LifecycleNode):
    """A managed node whose server answers while the node is active."""

    def __init__(
        self, name: str, make_server: Callable[[Node], Server[Any, Any]], **options: Any
    ) -> None:
        """Declare the parameters; ConfigError if one has the wrong type."""
        super().__init__(name, **options)
        self._server = make_server(self)
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = guarded(self, partial(self._change_state, service.callback))

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
        self, state: str, change: Callable[[], None], undo: Callable[[], None]
    ) -> TransitionCallbackReturn:
        """Call ``change``; if it fails, log that the node is not in ``state``, and ``undo``."""
        try:
            change()
        except OctoArmError as error:
            self.get_logger().error(f'not {state}: {error}')
            undo()
            return TransitionCallbackReturn.FAILURE
        return _SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start answering; a failure leaves the node inactive."""
        result = self._attempt('activated', self._server.activate, self._server.deactivate)
        return super().on_activate(state) if result == _SUCCESS else result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop answering."""
        self._server.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Free the arm and its publishers."""
        self._server.cleanup()
        return _SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate the server and free the arm, from any state."""
        self._server.deactivate()
        self._server.cleanup('finalized')
        return _SUCCESS


# Both nodes publish the backbone of the arm for the tensions they receive.
OctoArmNode = partial(ServedNode, 'octo_arm', ArmServer)
ManagedOctoArmNode = partial(ManagedNode, 'octo_arm', ArmServer)


def make_executor(context: Context | None = None) -> Executor:
    """Return the events executor if rclpy has one, else the single-threaded executor."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def run(name: str, make_node: Callable[[], Node], arguments: list[str] | None = None) -> int:
    """Run a node until SIGINT or SIGTERM; return the exit status."""
    of_ros = arguments_of_ros(name, arguments)
    install()  # rclpy then shuts its context down at a signal, which ends the loop below
    bound_memory()
    try:
        start_ros(of_ros, SignalHandlerOptions.ALL)
    except OctoArmError as error:
        return fail(name, error, 1)
    logger = rclpy.logging.get_logger(name)
    show_logs(lambda text, is_warning: (logger.warning if is_warning else logger.info)(text))
    node = executor = None
    try:
        node = interruptible(make_node)()
        if node is None:
            return 0
        executor = make_executor()
        executor.add_node(node)
        context = rclpy.get_default_context()
        # `spin` would miss a signal just before the executor waits.
        while context.ok():
            executor.spin_once(timeout_sec=LONGEST_WAIT)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:
        # A signal may shut down the context while the executor builds a wait set on it.
        if rclpy.ok():
            raise
        # The executor has then lost count of its callbacks; freeing it would abort the process.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(executor))
    except (OctoArmError, ParameterException) as error:
        return fail(name, f'{error} (parameters come from --ros-args --params-file FILE)', 1)
    except MemoryError:
        return fail(name, 'out of memory', 1)
    finally:
        # Fast DDS may deadlock in C++ while many participants leave. A thread then prints a
        # traceback and ends the process with status 1.
        with contextlib.suppress(RuntimeError):  # no memory for the thread; report the first error
            faulthandler.dump_traceback_later(LONGEST_END, exit=True)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
        faulthandler.cancel_dump_traceback_later()
        ignore_signals()
    return 0


main = partial(run, 'octo_arm_node', OctoArmNode)
managed = partial(run, 'octo_arm_lifecycle_node', ManagedOctoArmNode)


if __name__ == '__main__':
    sys.exit(main())
