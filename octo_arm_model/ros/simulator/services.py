"""Services that stop, step, reset, save and restore the simulator.

As those of `simulation_interfaces` too, where that package is installed.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from octo_arm_model.arm.errors import OctoArmError
from octo_arm_model.ros.simulator.simulation_clock import SimulationClock

MOST_STEPS, LONGEST = 1000, 10.0  # of one request, which all others wait for; [s]
NOT_PAUSED = 'is not paused, expected pause before step'


def offer_services(
    node: Node, clock: SimulationClock, reset: Callable[[], None], save: Callable[[], None],
    restore: Callable[[], None],
) -> None:  # fmt: skip
    """Offer the services on ``node``.

    ``reset`` begins anew, at rest with slack tendons; ``save`` writes the state to a file, and
    ``restore`` goes on from it. Each may raise an `OctoArmError`.
    """

    def pause(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        clock.is_paused, response.success = bool(request.data), True
        response.message = 'paused' if request.data else 'goes on'
        return response

    def step() -> None:
        if not clock.is_paused:
            raise OctoArmError(NOT_PAUSED)
        clock.step()

    def begin_anew() -> None:
        reset()
        clock.reset()

    node.create_service(SetBool, 'pause', pause)
    for name, act, done in (
        ('step', step, 'went on by one period'),
        ('reset', begin_anew, 'at rest, tendons slack'),
        ('save_state', save, 'saved'),
        ('restore_state', restore, 'restored'),
    ):
        node.create_service(Trigger, name, _answer(act, done))
    try:
        kinds = importlib.import_module('simulation_interfaces.srv')
        messages = importlib.import_module('simulation_interfaces.msg')
    except ImportError:
        return
    StandardServices(node, clock, reset, kinds, messages)


def _answer(
    act: Callable[[], None], done: str
) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    """Answers a request by what ``act`` does, and ``done`` where it is."""

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            act()
            response.success, response.message = True, done
        except OctoArmError as error:
            response.message = str(error)
        return response

    return answer


class StandardServices:
    """The same in the fields of `simulation_interfaces`.

    Its modules of services and messages are given, as they may not be installed.
    """

    def __init__(
        self, node: Node, clock: SimulationClock, reset: Callable[[], None], kinds: Any,
        messages: Any,
    ) -> None:  # fmt: skip
        """Offer them on ``node``."""
        self._clock, self._reset = clock, reset
        self._is_stopped = False
        self._kinds, self._messages = kinds, messages
        for name, kind, answer in (
            ('get_simulator_features', kinds.GetSimulatorFeatures, self._features),
            ('get_simulation_state', kinds.GetSimulationState, self._get),
            ('set_simulation_state', kinds.SetSimulationState, self._set),
            ('reset_simulation', kinds.ResetSimulation, self._on_reset),
            ('step_simulation', kinds.StepSimulation, self._step),
        ):
            node.create_service(kind, name, answer)

    @property
    def _state(self) -> int:
        known = self._messages.SimulationState
        if not self._clock.is_paused:
            return int(known.STATE_PLAYING)
        return int(known.STATE_STOPPED if self._is_stopped else known.STATE_PAUSED)

    def _features(self, _: Any, response: Any) -> Any:
        known = self._messages.SimulatorFeatures
        response.features.features = [
            known.SIMULATION_RESET, known.SIMULATION_RESET_TIME, known.SIMULATION_RESET_STATE,
            known.SIMULATION_STATE_GETTING, known.SIMULATION_STATE_SETTING,
            known.SIMULATION_STATE_PAUSE, known.STEP_SIMULATION_SINGLE,
            known.STEP_SIMULATION_MULTIPLE,
        ]  # fmt: skip
        return response

    def _get(self, _: Any, response: Any) -> Any:
        response.state.state = self._state
        return self._result(response, 'RESULT_OK')

    def _set(self, request: Any, response: Any) -> Any:
        known, wanted = self._messages.SimulationState, request.state.state
        if wanted not in (known.STATE_STOPPED, known.STATE_PLAYING, known.STATE_PAUSED):
            return self._result(
                response, 'RESULT_FEATURE_UNSUPPORTED',
                f'state is {wanted}, expected stopped, playing or paused',
            )  # fmt: skip
        if wanted == self._state:
            response.result.result = (
                self._kinds.SetSimulationState.Response.ALREADY_IN_TARGET_STATE
            )
            return response
        self._is_stopped = wanted == known.STATE_STOPPED
        self._clock.is_paused = wanted != known.STATE_PLAYING
        if self._is_stopped:
            self._reset()
            self._clock.reset()
        return self._result(response, 'RESULT_OK')

    def _on_reset(self, request: Any, response: Any) -> Any:
        known = self._kinds.ResetSimulation.Request
        scope = request.scope or known.SCOPE_ALL
        if scope == known.SCOPE_SPAWNED:
            return self._result(response, 'RESULT_FEATURE_UNSUPPORTED', 'nothing is spawned')
        if scope & known.SCOPE_STATE:
            self._reset()
        if scope & known.SCOPE_TIME:
            self._clock.reset()
        return self._result(response, 'RESULT_OK')

    def _step(self, request: Any, response: Any) -> Any:
        problem = ''
        if not self._clock.is_paused:
            problem = NOT_PAUSED
        elif request.steps > (most := min(MOST_STEPS, max(1, int(LONGEST / self._clock.period)))):
            problem = f'steps is {request.steps}, expected at most {most} in one request'
        if problem:
            return self._result(response, 'RESULT_OPERATION_FAILED', problem)
        self._is_stopped = False
        for _ in range(request.steps):
            self._clock.step()
        return self._result(response, 'RESULT_OK')

    def _result(self, response: Any, code: str, words: str = '') -> Any:
        response.result.result = getattr(self._messages.Result, code)
        response.result.error_message = words
        return response
