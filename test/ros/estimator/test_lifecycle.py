"""The managed estimator, over DDS."""

import numpy as np
from estimator_nodes import INPUTS, estimating_here
from lifecycle_msgs.msg import Transition

from octo_arm_model.ros.estimator.lifecycle import ManagedEstimatorNode


def test_a_managed_estimator_estimates_while_it_is_active_and_then_anew():
    with estimating_here(ManagedEstimatorNode) as client:
        assert client.transition(Transition.TRANSITION_CONFIGURE)
        client.wait(
            lambda: client.node.count_publishers('backbone/covariance') == 1, 'a configured node'
        )
        assert not any(client.node.count_subscribers(topic) for topic in INPUTS)
        client.force = np.array([0.0, -0.004, 0.008])
        for _ in range(2):
            assert client.transition(Transition.TRANSITION_ACTIVATE)
            client.connect()
            client.measure(1000.0 + 0.05 * np.arange(8))
            found, stddev = client.wrench()
            assert (np.abs(found - client.force) < 4.5 * stddev).all()
            status, values = client.status('estimate')
            assert status.message == 'estimating' and values['tip pose accepted'] == '8'
            assert client.transition(Transition.TRANSITION_DEACTIVATE)
            client.wait(
                lambda: not any(client.node.count_subscribers(topic) for topic in INPUTS),
                'an inactive node',
            )
            assert client.status('estimate')[0].message == 'inactive'
        assert client.transition(Transition.TRANSITION_CLEANUP)
        client.wait(
            lambda: client.node.count_publishers('backbone/covariance') == 0,
            'a node without publishers',
        )
