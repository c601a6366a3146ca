"""The client of a simulator: what pulls its arm, and stops it."""

from __future__ import annotations

from geometry_msgs.msg import Vector3, Vector3Stamped
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from octo_arm_model.arm.errors import ConfigError
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.ros.node.outputs import OUTPUT_QOS
from octo_arm_model.ros.simulator.push_service import TOPIC as PUSH_TOPIC


class SimulatorClient:
    """Publishes forces and calls services, whose answers are not waited for."""

    def __init__(self, node: Node, prefix: str = '') -> None:
        """Create the entities on ``node``, with ``prefix`` before their names."""
        self._force = node.create_publisher(Vector3Stamped, prefix + PUSH_TOPIC, OUTPUT_QOS)
        self._services = {
            name: node.create_client(SetBool if name == 'pause' else Trigger, prefix + name)
            for name in ('pause', 'step', 'reset')
        }

    def pull(self, force: FloatArray) -> None:
        """Pull the arm with a ``force`` (3,) [N], for half a second or until the next."""
        x, y, z = force.tolist()
        self._force.publish(Vector3Stamped(vector=Vector3(x=x, y=y, z=z)))

    def pause(self, is_paused: bool) -> None:
        """Stop the simulator, or let it go on.

        Raises:
            ConfigError: if there is none.
        """
        self._call('pause', SetBool.Request(data=is_paused))

    def trigger(self, name: str) -> None:
        """Call the service ``name``, step or reset.

        Raises:
            ConfigError: as `pause`.
        """
        self._call(name, Trigger.Request())

    def _call(self, name: str, request: SetBool.Request | Trigger.Request) -> None:
        service = self._services[name]
        if not service.service_is_ready():
            raise ConfigError(f'nobody offers {service.srv_name}, expected octo_arm_sim')
        # Nothing spins the node: the answer is not taken.
        service.remove_pending_request(service.call_async(request))
