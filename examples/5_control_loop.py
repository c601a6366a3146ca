"""A controller at 200 Hz of a simulated arm, whose tip follows a circle.

The program starts the node and a simulator whose winches lag by 50 ms. The controller takes the
position of the tip from the node alone. Run it with ROS, or by tools/with_ros.
"""

import sys

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from octo_arm_msgs.msg import TendonTensions
from rclpy.node import Node

from octo_arm_model import TipPosition, find_tensions, load_config
from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.ros.node.main import make_executor
from octo_arm_model.ros.processes import children
from octo_arm_model.simulation.movements import tendon_limits

CONFIG = 'config/renda2012_table4.yaml'
RATE = 200.0  # [Hz]
PERIOD = 8.0  # time of a circle [s]
GAIN = 4.0  # [1/s]
HIGHEST = 1.0  # largest tension, if the limit of a tendon is not less [N]
SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0


def wanted(time: float) -> tuple[FloatArray, FloatArray]:
    """Return the target position [m] and velocity [m/s] of the tip at ``time`` [s]."""
    angle = 2.0 * np.pi * time / PERIOD
    radial, along = (
        np.array([0, np.cos(angle), np.sin(angle)]),
        np.array([0, -np.sin(angle), np.cos(angle)]),
    )
    return np.array([0.38, 0.0, 0.0]) + 0.05 * radial, 0.05 * 2.0 * np.pi / PERIOD * along


class Controller(Node):
    """A controller that changes tensions by the distance of the tip to its target."""

    def __init__(self) -> None:
        """Begin with tensions that bring the tip to the circle."""
        super().__init__('controller')
        config = load_config(CONFIG)
        self.solver = config.solver('closed_form', stations=41)
        # The simulator refuses tensions beyond the limit of a tendon.
        self.highest = np.minimum(HIGHEST, tendon_limits(config))
        target = TipPosition(wanted(0.0)[0])
        highest = self.highest.reshape(config.arm.tension_shape)
        start = find_tensions(config.solver('exact'), target, highest=highest)
        self.tensions = start.backbone.tensions.ravel().copy()
        self.command = TendonTensions(name=list(config.arm.tendon_names))
        self.tip: FloatArray | None = None
        self.steps = 0
        self.errors: list[float] = []
        self.publisher = self.create_publisher(TendonTensions, 'tendon_commands', 1)
        self.create_subscription(PoseWithCovarianceStamped, 'tip_pose', self.on_tip, 1)
        self.create_timer(1.0 / RATE, self.step)

    def on_tip(self, message: PoseWithCovarianceStamped) -> None:
        """Store the position of the tip."""
        p = message.pose.pose.position
        self.tip = np.array([p.x, p.y, p.z])

    def step(self) -> None:
        """Publish tensions that move the tip towards its target."""
        if self.tip is not None:
            target, speed = wanted(self.steps / RATE)
            error = target - self.tip
            # The Jacobian is the model's; the position of the tip is the node's.
            backbone = self.solver.solve(self.tensions.reshape(self.solver.arm.tension_shape))
            jacobian = self.solver.sensitivity(backbone).by_tension.tip[:3]
            damped = jacobian @ jacobian.T + 1e-4 * np.eye(3)
            change = jacobian.T @ np.linalg.solve(damped, speed + GAIN * error)
            self.tensions = np.clip(self.tensions + change / RATE, 0.0, self.highest)
            self.errors.append(float(np.linalg.norm(error)))
            self.steps += 1
            if self.steps % int(2 * RATE) == 0:
                recent = 1e3 * np.array(self.errors[-int(2 * RATE) :])
                print(
                    f'{self.steps / RATE:5.1f} s   error {recent.mean():5.1f} mm, '
                    f'at most {recent.max():.1f} mm',
                    flush=True,
                )
        self.command.header.stamp = self.get_clock().now().to_msg()
        self.command.tension = self.tensions.tolist()
        self.publisher.publish(self.command)


arm = ('--ros-args', '--params-file', CONFIG)
rclpy.init()
with children(
    [
        ('octo_arm_model.ros.node.main', *arm),
        (
            'octo_arm_model.ros.simulator.main',
            *arm,
            '-p',
            f'rate:={RATE}',
            '-p',
            'winches.lag:=0.05',
        ),
    ]
):
    controller, executor = Controller(), make_executor()
    executor.add_node(controller)
    try:
        while controller.steps < SECONDS * RATE:
            executor.spin_once(timeout_sec=1.0)
    except KeyboardInterrupt:
        pass
    executor.shutdown()
