"""The clock of the simulator, and its services: pause, step, reset, save, restore and push.

If the package `simulation_interfaces` is installed, its services are offered as well.
"""

import importlib
import re
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import Vector3Stamped
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from octo_arm_model.arm.errors import LoadError, OctoArmError, shown
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.ros.topics import create_publisher
from octo_arm_model.ros.work import steady_timer
from octo_arm_model.simulation.dynamic_arm import DynamicArm
from octo_arm_model.simulation.pushed_arm import Push
from octo_arm_model.simulation.simulator import Course, SimulatorConfig

TOPIC = '/clock'
# A slice of steps, and the time from one to the next, with time for other callbacks [s].
_SLICE, _SLICE_PERIOD = 0.02, 1e-3
_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
MOST_STEPS, LONGEST = 1000, 10.0  # steps and seconds of one request, which all others wait for
NOT_PAUSED = 'is not paused, expected pause before step'
_FEATURES = (
    'SIMULATION_RESET',
    'SIMULATION_RESET_TIME',
    'SIMULATION_RESET_STATE',
    'SIMULATION_STATE_GETTING',
    'SIMULATION_STATE_SETTING',
    'SIMULATION_STATE_PAUSE',
    'STEP_SIMULATION_SINGLE',
    'STEP_SIMULATION_MULTIPLE',
)


class SimulationClock:
    """Calls a step function once a period, by the clock of the node or by its own time.

    Services pause, step and reset it.

    Attributes:
        is_paused: whether time stands still.
        is_stopped: whether it stands still since a reset that has stopped it.
    """

    def __init__(self, node: Node, step: Callable[[int, Time], None]) -> None:
        """Call ``step`` with the length of the step [ns] and the time at its end."""
        self._node, self._step = node, step
        self.is_paused = self.is_stopped = False
        self._timer: Timer | None = None
        self._clock: Any = node.get_clock()
        on_change = JumpThreshold(min_forward=None, min_backward=None, on_clock_change=True)
        self._changes = self._clock.create_jump_callback(on_change, post_callback=self._restart)
        self._course = Course()
        self._last, self._time_ns = 0, 0
        self._publisher: Publisher | None = None

    def use(self, course: Course) -> None:
        """Use the rate, the real time factor and the kind of clock of ``course`` from now on."""
        names = 'rate', 'publish_clock', 'real_time_factor'
        before, self._course = self._course, course
        if self._timer is None or any(getattr(before, n) != getattr(course, n) for n in names):
            self._restart()

    @property
    def period(self) -> float:
        """The period of the steps [s]."""
        return 1.0 / self._course.rate

    def _restart(self, _: TimeJump | None = None) -> None:
        """Start the timer of the present course and clock."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        self._last, factor = 0, self._course.real_time_factor
        if self._course.publish_clock:
            if self._publisher is None:
                self._publisher = create_publisher(self._node, ClockMessage, TOPIC, _QOS)
            period = self.period / factor if factor else _SLICE_PERIOD
            self._timer = steady_timer(self._node, period, self._run_freely)
            return
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None
        if self._clock.ros_time_is_active:
            self._timer = self._node.create_timer(self.period, self._follow_clock)
        else:
            # By the time of the system a timer would stand still for as long as that is set back.
            self._timer = steady_timer(self._node, self.period, self._follow_clock)

    def reset(self) -> None:
        """Set the simulator's own time to zero."""
        self._time_ns = 0

    def step(self) -> None:
        """Advance by one period, also while paused."""
        self._advance(round(1e9 * self.period), self._clock.now())

    def _follow_clock(self) -> None:
        clock_time = self._clock.now()
        now = clock_time.nanoseconds
        if now == self._last:
            return  # rclpy calls the timer once for each of several waiting clock messages
        # A time of 0 is not set yet. If time jumps back, as when a bag is played again or the
        # system's clock is set, the winches do not move.
        elapsed_ns = now - self._last if self._last else round(1e9 * self.period)
        self._last = now
        if not self.is_paused:
            self._advance(max(elapsed_ns, 0), clock_time)

    def _run_freely(self) -> None:
        until = time.monotonic() + (0.0 if self._course.real_time_factor else _SLICE)
        while not self.is_paused:
            self.step()
            if time.monotonic() >= until:
                return

    def _advance(self, elapsed_ns: int, now: Time) -> None:
        self.is_stopped = False
        if self._publisher is not None:
            self._time_ns += elapsed_ns
            now = Time(nanoseconds=self._time_ns)
            # The clock comes first, so that subscribers know the time of the messages to come.
            self._publisher.publish(ClockMessage(clock=now.to_msg()))
        self._step(elapsed_ns, now)

    def offer_services(
        self, reset: Callable[[], None], save: Callable[[], None], restore: Callable[[], None]
    ) -> None:
        """Offer the services but the one that pushes the arm.

        ``reset`` returns to rest with slack tendons, ``save`` writes the state to a file, and
        ``restore`` continues from it. Each may raise an `OctoArmError`.
        """
        self._reset_arm, node = reset, self._node
        node.create_service(SetBool, 'pause', self._pause)
        for name, act, done in (
            ('step', self._step_once, 'went on by one period'),
            ('reset', self._reset_all, 'at rest, tendons slack'),
            ('save_state', save, 'saved'),
            ('restore_state', restore, 'restored'),
        ):
            node.create_service(Trigger, name, partial(self._trigger, act, done))
        try:
            self._kinds: Any = importlib.import_module('simulation_interfaces.srv')
            self._messages: Any = importlib.import_module('simulation_interfaces.msg')
        except ImportError:
            return
        for name, answer in (
            ('GetSimulatorFeatures', self._features),
            ('GetSimulationState', self._get_state),
            ('SetSimulationState', self._set_state),
            ('ResetSimulation', self._on_reset),
            ('StepSimulation', self._step_many),
        ):
            service = re.sub('(?<!^)(?=[A-Z])', '_', name).lower()
            node.create_service(getattr(self._kinds, name), service, answer)

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.is_paused, self.is_stopped = bool(request.data), False
        response.success = True
        response.message = 'paused' if request.data else 'goes on'
        return response

    def _trigger(
        self, act: Callable[[], None], done: str, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        try:
            act()
            response.success, response.message = True, done
        except OctoArmError as error:
            response.message = str(error)
        return response

    def _step_once(self) -> None:
        if not self.is_paused:
            raise OctoArmError(NOT_PAUSED)
        self.step()

    def _reset_all(self) -> None:
        self._reset_arm()
        self.reset()

    @property
    def _state(self) -> int:
        states = self._messages.SimulationState
        if not self.is_paused:
            return int(states.STATE_PLAYING)
        return int(states.STATE_STOPPED if self.is_stopped else states.STATE_PAUSED)

    def _features(self, _: Any, response: Any) -> Any:
        constants = self._messages.SimulatorFeatures
        response.features.features = [getattr(constants, name) for name in _FEATURES]
        return response

    def _get_state(self, _: Any, response: Any) -> Any:
        response.state.state = self._state
        return self._result(response, 'RESULT_OK')

    def _set_state(self, request: Any, response: Any) -> Any:
        states, requested = self._messages.SimulationState, request.state.state
        if requested not in (states.STATE_STOPPED, states.STATE_PLAYING, states.STATE_PAUSED):
            return self._result(
                response,
                'RESULT_FEATURE_UNSUPPORTED',
                f'state is {requested}, expected stopped, playing or paused',
            )
        if requested == self._state:
            unchanged = self._kinds.SetSimulationState.Response.ALREADY_IN_TARGET_STATE
            response.result.result = unchanged
            return response
        self.is_stopped = requested == states.STATE_STOPPED
        self.is_paused = requested != states.STATE_PLAYING
        if self.is_stopped:
            self._reset_all()
        return self._result(response, 'RESULT_OK')

    def _on_reset(self, request: Any, response: Any) -> Any:
        scopes = self._kinds.ResetSimulation.Request
        scope = request.scope or scopes.SCOPE_ALL
        if scope == scopes.SCOPE_SPAWNED:
            return self._result(response, 'RESULT_FEATURE_UNSUPPORTED', 'nothing is spawned')
        if scope & scopes.SCOPE_STATE:
            self._reset_arm()
        if scope & scopes.SCOPE_TIME:
            self.reset()
        return self._result(response, 'RESULT_OK')

    def _step_many(self, request: Any, response: Any) -> Any:
        most = min(MOST_STEPS, max(1, int(LONGEST / self.period)))
        problem = '' if self.is_paused else NOT_PAUSED
        if not problem and request.steps > most:
            problem = f'steps is {request.steps}, expected at most {most} in one request'
        if problem:
            return self._result(response, 'RESULT_OPERATION_FAILED', problem)
        for _ in range(request.steps):
            self.step()
        return self._result(response, 'RESULT_OK')

    def _result(self, response: Any, code: str, words: str = '') -> Any:
        response.result.result = getattr(self._messages.Result, code)
        response.result.error_message = words
        return response


PUSH_TOPIC = 'push/force'


def check_frame(header: Header, config: SimulatorConfig, what: str) -> None:
    """Raise LoadError if the quantity ``what`` of a message is not in base_frame."""
    if header.frame_id not in ('', config.model.base_frame):
        frame = shown(header.frame_id)
        raise LoadError(f'the {what} is in frame {frame}, expected {config.model.base_frame!r}')


_HOLD = 0.5  # [s] for which the force of a message acts, unless another comes


class PushService:
    """The push on the arm: a periodic one from parameters, and a service that holds or ends it.

    A force from messages takes its place.
    """

    def __init__(self, node: Node, push: Callable[[], Push]) -> None:
        """Offer the service on ``node``; ``push`` returns the present push parameters."""
        self._push = push
        self._is_requested: bool | None = None
        self._held: FloatArray | None = None
        self._until: float | None = None
        node.create_service(SetBool, 'push', self._answer)

    def forget(self) -> None:
        """Push as the parameters say, without requests and forces of messages."""
        self._is_requested = self._held = None

    def hold(self, message: Vector3Stamped, config: SimulatorConfig, arm: DynamicArm) -> None:
        """Push the ``arm`` of ``config`` with the force of a ``message``, for half a second.

        LoadError if it is in another frame than base_frame, not finite, or too large.
        """
        check_frame(message.header, config, 'force')
        force = np.array([message.vector.x, message.vector.y, message.vector.z])
        if not np.isfinite(force).all():
            raise LoadError(f'the force is {force.tolist()}, expected finite numbers [N]')
        arm.check_force(force)
        self._held, self._until = force, None

    def at(self, time: float) -> FloatArray:
        """Return the push force (3,) [N] at the simulated ``time`` [s]."""
        push = self._push()
        if self._held is not None:
            self._until = time + _HOLD if self._until is None else self._until
            if time < self._until:
                return self._held
            self._held = None
        if self._is_requested is None:
            return push.at(time)
        return np.array(push.force) * self._is_requested

    def _answer(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        push = self._push()
        if not any(push.force):
            response.message = 'push.force is 0, expected a force [N] to push with'
            return response
        self._is_requested, response.success = bool(request.data), True
        place = f's = {push.s:g} m' if push.s else 'the tip'
        pushes = f'pushes {place} with {list(push.force)} N'
        response.message = pushes if request.data else 'lets go'
        return response
