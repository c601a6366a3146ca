"""The simulator in the fields of `simulation_interfaces`, where that package is installed."""

import pytest

pytest.importorskip('simulation_interfaces', reason='needs simulation_interfaces, in no wheel')

from live_nodes import hosting
from octo_arm_msgs.msg import TendonTensions
from rosgraph_msgs.msg import Clock
from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures
from simulation_interfaces.srv import (
    GetSimulationState,
    GetSimulatorFeatures,
    ResetSimulation,
    SetSimulationState,
    StepSimulation,
)
from std_srvs.srv import SetBool, Trigger

from octo_arm_model.ros.simulator.main import SimulatorNode

PAUSED, PLAYING = SimulationState.STATE_PAUSED, SimulationState.STATE_PLAYING
STOPPED = SimulationState.STATE_STOPPED
PERIOD = 10_000_000  # [ns]


def test_states_steps_and_resets_are_those_of_the_standard():
    with hosting(SimulatorNode, publish_clock=True) as client:
        clock = client.hear(Clock, '/clock')
        readings = client.hear(TendonTensions, 'tendon_tensions')

        def ask(kind, name, **fields):
            return client.call(kind, name, kind.Request(**fields))

        def turn(state):
            wanted = SimulationState(state=state)
            return ask(SetSimulationState, 'set_simulation_state', state=wanted).result

        def state():
            return ask(GetSimulationState, 'get_simulation_state').state.state

        def step(count):
            return ask(StepSimulation, 'step_simulation', steps=count).result

        def reset(scope):
            return ask(ResetSimulation, 'reset_simulation', scope=scope).result.result

        def nanoseconds():
            return 10**9 * clock[-1].clock.sec + clock[-1].clock.nanosec

        features = ask(GetSimulatorFeatures, 'get_simulator_features').features
        assert SimulatorFeatures.STEP_SIMULATION_MULTIPLE in features.features
        client.wait(lambda: clock, 'time')
        assert state() == PLAYING
        refused = step(3)
        assert refused.result == Result.RESULT_OPERATION_FAILED
        assert refused.error_message == 'is not paused, expected pause before step'
        assert turn(PAUSED).result == Result.RESULT_OK and state() == PAUSED
        assert turn(PAUSED).result == SetSimulationState.Response.ALREADY_IN_TARGET_STATE
        client.spin(0.2)
        before = nanoseconds()
        assert step(3).result == Result.RESULT_OK
        client.wait(lambda: nanoseconds() == before + 3 * PERIOD, 'three steps')
        assert step(10**9).error_message == (
            'steps is 1000000000, expected at most 1000 in one request'
        )
        # The state alone, then time too.
        assert reset(ResetSimulation.Request.SCOPE_STATE) == Result.RESULT_OK
        step(1)
        client.wait(lambda: nanoseconds() == before + 4 * PERIOD, 'a step')
        assert reset(ResetSimulation.Request.SCOPE_DEFAULT) == Result.RESULT_OK
        step(1)
        client.wait(lambda: nanoseconds() == PERIOD, 'a new beginning')
        unsupported = Result.RESULT_FEATURE_UNSUPPORTED
        assert reset(ResetSimulation.Request.SCOPE_SPAWNED) == unsupported
        assert turn(STOPPED).result == Result.RESULT_OK and state() == STOPPED
        # What has moved since, or has been paused again, is not stopped.
        assert client.call(Trigger, 'step', Trigger.Request()).success and state() == PAUSED
        assert turn(STOPPED).result == Result.RESULT_OK and state() == STOPPED
        for is_paused, expected in ((False, PLAYING), (True, PAUSED)):
            assert client.call(SetBool, 'pause', SetBool.Request(data=is_paused)).success
            assert state() == expected
        assert turn(SimulationState.STATE_QUITTING).result == unsupported
        assert turn(PLAYING).result == Result.RESULT_OK and state() == PLAYING
        readings.clear()
        client.wait(lambda: readings, 'readings')
