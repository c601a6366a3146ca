"""The estimator's node, and a client that publishes measurements of a simulated arm."""

import dataclasses

import numpy as np
from geometry_msgs.msg import Point, Pose, PoseArray, PoseWithCovarianceStamped, WrenchStamped
from live_nodes import RosClient, hosting, xyz
from octo_arm_msgs.msg import BackboneCovariance, TendonTensions
from sensor_msgs.msg import JointState

from octo_arm_model import load_config
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.ros.topics import pose_message

FILE = preset_path('renda2012_prototype')
MARKER_S = (0.1, 0.2)
STATIONS = 21
CONFIG = dataclasses.replace(load_config(FILE), model='exact', stations=STATIONS)
ARM, LENGTH = CONFIG.arm, CONFIG.arm.length
NAMES = list(ARM.tendon_names)
TENSIONS = np.array([1.0, 0.4, 0.3, 0.5])
SECOND = 10**9  # [ns]
NOISE = {'tension': 0.01, 'position': 2e-4, 'rotation': 1e-2, 'force': 1e-3, 'moment': 1e-4}
INPUTS = {
    'tendon_tensions': TendonTensions,
    'tendon_displacements': JointState,
    'measured/tip_pose': PoseWithCovarianceStamped,
    'measured/markers': PoseArray,
    'measured/base_wrench': WrenchStamped,
}
OUTPUTS = {
    'tip_pose': PoseWithCovarianceStamped,
    'tip_wrench/estimate': WrenchStamped,
    'contact/estimate': WrenchStamped,
    'backbone/covariance': BackboneCovariance,
    'tension_bias': TendonTensions,
    'tendon_tension_estimates': TendonTensions,
}
GIVEN = {
    'stations': STATIONS,
    # On a busy machine diagnostics come seconds after the last measurement.
    'diagnostics.silence_limit': 1e6,
    'tension_stddev': NOISE['tension'],
    'estimator.force_stddev': 0.01,
    'estimator.tension_rate': 0.05,
    'estimator.marker_s': list(MARKER_S),
    'estimator.marker_stddev': NOISE['position'],
    'estimator.base_force_stddev': NOISE['force'],
    'estimator.base_moment_stddev': NOISE['moment'],
    'solve_budget.seconds': 60.0,
    **{f'qos_overrides./{topic}.subscription.reliability': 'reliable' for topic in INPUTS},
}


class EstimatorClient(RosClient):
    """Publishes measurements of an arm with known tensions and tip force."""

    def __init__(self, domain, node='octo_arm_estimator'):
        super().__init__(domain, node)
        self.publishers = {
            topic: self.node.create_publisher(kind, topic, 100) for topic, kind in INPUTS.items()
        }
        self.answers = {topic: self.hear(kind, topic) for topic, kind in OUTPUTS.items()}
        self.before = dict.fromkeys(OUTPUTS, 0)
        self.solver = CONFIG.solver()
        self.random = np.random.default_rng(1)
        self.tensions, self.force, self.scale = TENSIONS, np.zeros(3), 1.0

    def connect(self):
        """Wait until all inputs reach the node and all outputs come back."""
        for topic, publisher in self.publishers.items():
            self.wait(publisher.get_subscription_count, f'a subscription to {topic}')
        for topic in OUTPUTS:
            self.wait(lambda topic=topic: self.node.count_publishers(topic), f'{topic}')
        tip = self.answers['tip_pose']

        def is_heard():
            # An early stamp, so that no later measurement of a test is late.
            self.send('tendon_tensions', 1.0)
            self.spin(0.1)
            return tip and self.answers['backbone/covariance']

        self.wait(is_heard, 'an answer')
        while True:
            count = len(tip)
            self.spin(0.5)
            if len(tip) == count:
                return

    @property
    def shape(self):
        """The true shape."""
        wrench = np.append(self.force, np.zeros(3))
        return self.solver.solve([self.tensions], wrench if self.force.any() else None)

    def noise(self, kind, size):
        return self.scale * NOISE[kind] * self.random.standard_normal(size)

    def message(self, topic, time):
        """Return the message of the sensor of ``topic`` with the stamp ``time`` [s]."""
        message, shape = INPUTS[topic](), self.shape
        message.header.frame_id = 'arm_base'
        stamp = round(time * SECOND)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
        if topic == 'tendon_tensions':
            message.name = NAMES
            message.tension = self.tensions + self.noise('tension', len(NAMES))
        elif topic == 'tendon_displacements':
            displacements = self.solver.rest_lengths - self.solver.tendon_lengths(shape)
            message.name, message.position = NAMES, displacements.ravel()
        elif topic == 'measured/tip_pose':
            position = shape.tip + self.noise('position', 3)
            message.pose.pose = pose_message(position, shape.quaternion[-1])
            variance = np.repeat([NOISE['position'], NOISE['rotation']], 3) ** 2
            message.pose.covariance = np.diag(variance).ravel()
        elif topic == 'measured/markers':
            positions = [np.interp(MARKER_S, shape.s, axis) for axis in shape.position.T]
            for x, y, z in np.transpose(positions) + self.noise('position', (len(MARKER_S), 3)):
                message.poses.append(Pose(position=Point(x=x, y=y, z=z)))
        else:
            force = self.force + self.noise('force', 3)
            moment = np.cross(shape.tip, self.force) + self.noise('moment', 3)
            for field, (x, y, z) in (
                (message.wrench.force, force),
                (message.wrench.torque, moment),
            ):
                field.x, field.y, field.z = x, y, z
        return message

    def send(self, topic, time, change=None):
        """Publish a measurement of ``topic`` after a ``change`` of the message."""
        message = self.message(topic, time)
        if change is not None:
            change(message)
        self.publishers[topic].publish(message)

    def tell(self, topic, time, change=None):
        """Publish a measurement, wait for the next estimate and return its tip pose."""
        self.before = {name: len(heard) for name, heard in self.answers.items()}
        self.send(topic, time, change)
        return self.newest('tip_pose')

    def measure(self, times, topics=('tendon_tensions', 'measured/tip_pose')):
        """Publish measurements of ``topics`` at ``times`` [s], and wait for each estimate."""
        for time in times:
            for number, topic in enumerate(topics):
                self.tell(topic, time + 1e-3 * number)

    def newest(self, topic):
        """Return the answer on ``topic`` to the last measurement of `tell`."""
        heard, before = self.answers[topic], self.before[topic]
        self.wait(lambda: len(heard) > before, f'an answer on {topic}')
        return heard[-1]

    def wrench(self, topic='tip_wrench/estimate'):
        """Return the force of the newest wrench [N] and its standard deviations."""
        force = xyz(self.newest(topic).wrench.force)
        covariance = np.reshape(self.newest('backbone/covariance').contact, (6, 6))
        return force, np.sqrt(covariance.diagonal()[:3])


def estimating_here(make_node, domain=None):
    """Run a node in this process, which its client spins."""
    return hosting(make_node, files=(FILE,), client=EstimatorClient, domain=domain, **GIVEN)
