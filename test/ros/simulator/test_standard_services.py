"""The simulator in the fields of `simulation_interfaces`, where that package is installed."""

import pytest

pytest.importorskip('simulation_interfaces', reason='needs simulation_interfaces, in no wheel')

from live_nodes import RosClient, hosting, new_domain
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

from octo_arm_model.ros.simulator.main import SimulatorNode

PAUSED, PLAYING = SimulationState.STATE_PAUSED, SimulationState.STATE_PLAYING
STOPPED = SimulationState.STATE_STOPPED
PERIOD = 10_000_000  # [ns]


def test_states_steps_and_resets_are_those_of_the_standard():
    options = '-p', 'publish_clock:=true'
    with hosting(
        SimulatorNode, *options, client=RosClient, node='octo_arm_sim', domain=new_domain()
    ) as client:
        clock = client.hear(Clock, '/clock')
        readings = client.hear(TendonTensions, 'tendon_tensions')

        def turn(state):
            request = SetSimulationState.Request()
            request.state.state = state
            return client.call(SetSimulationState, 'set_simulation_state', request).result

        def state():
            request = GetSimulationState.Request()
            return client.call(GetSimulationState, 'get_simulation_state', request).state.state

        def step(count):
            request = StepSimulation.Request(steps=count)
            return client.call(StepSimulation, 'step_simulation', request).result

        def reset(scope):
            request = ResetSimulation.Request(scope=scope)
            return client.call(ResetSimulation, 'reset_simulation', request).result.result

        def nanoseconds():
            return 10**9 * clock[-1].clock.sec + clock[-1].clock.nanosec

        request = GetSimulatorFeatures.Request()
        features = client.call(GetSimulatorFeatures, 'get_simulator_features', request).features
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
        assert turn(SimulationState.STATE_QUITTING).result == unsupported
        assert turn(PLAYING).result == Result.RESULT_OK and state() == PLAYING
        readings.clear()
        client.wait(lambda: readings, 'readings')
