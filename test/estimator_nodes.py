"""The estimator's node, and a client that tells it what sensors of a simulated arm measure."""

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
    # A busy machine takes seconds from the last measurement to the diagnosis of it.
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
    """Measures an arm in which it knows the tensions and what pushes it."""

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
        """Wait until all topics lead from here to the node and back."""
        for topic, publisher in self.publishers.items():
            self.wait(publisher.get_subscription_count, f'a subscription to {topic}')
        for topic in OUTPUTS:
            self.wait(lambda topic=topic: self.node.count_publishers(topic), f'{topic}')
        tip = self.answers['tip_pose']

        def is_heard():
            # Long ago: what comes after it begins anew, or is not late.
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
        """The true one."""
        wrench = np.append(self.force, np.zeros(3))
        return self.solver.solve([self.tensions], wrench if self.force.any() else None)

    def noise(self, kind, size):
        return self.scale * NOISE[kind] * self.random.standard_normal(size)

    def message(self, topic, time):
        """What the sensor of ``topic`` measures, stamped with ``time`` [s]."""
        message, shape = INPUTS[topic](), self.shape
        message.header.frame_id = 'arm_base'
        stamp = round(time * SECOND)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
        if topic == 'tendon_tensions':
            message.name = NAMES
            message.tension = self.tensions + self.noise('tension', len(NAMES))
        elif topic == 'tendon_displacements':
            drawn_in = self.solver.rest_lengths - self.solver.tendon_lengths(shape)
            message.name, message.position = NAMES, drawn_in.ravel()
        elif topic == 'measured/tip_pose':
            position = shape.tip + self.noise('position', 3)
            message.pose.pose = pose_message(position, shape.quaternion[-1])
            variance = np.repeat([NOISE['position'], NOISE['rotation']], 3) ** 2
            message.pose.covariance = np.diag(variance).ravel()
        elif topic == 'measured/markers':
            places = [np.interp(MARKER_S, shape.s, axis) for axis in shape.position.T]
            for x, y, z in np.transpose(places) + self.noise('position', (len(MARKER_S), 3)):
                message.poses.append(Pose(position=Point(x=x, y=y, z=z)))
        else:
            force = self.force + self.noise('force', 3)
            moment = np.cross(shape.tip, self.force) + self.noise('moment', 3)
            for part, (x, y, z) in (
                (message.wrench.force, force),
                (message.wrench.torque, moment),
            ):
                part.x, part.y, part.z = x, y, z
        return message

    def send(self, topic, time, change=None):
        """Publish what the sensor of ``topic`` measures, after ``change`` of the message."""
        message = self.message(topic, time)
        if change is not None:
            change(message)
        self.publishers[topic].publish(message)

    def tell(self, topic, time, change=None):
        """The same, and wait for the estimate that comes of it; returns its tip pose."""
        self.before = {name: len(heard) for name, heard in self.answers.items()}
        self.send(topic, time, change)
        return self.newest('tip_pose')

    def measure(self, times, topics=('tendon_tensions', 'measured/tip_pose')):
        """Tell what all of ``topics`` measure at ``times`` [s], one after the other."""
        for time in times:
            for number, topic in enumerate(topics):
                self.tell(topic, time + 1e-3 * number)

    def newest(self, topic):
        """The answer on ``topic`` to what was told last."""
        heard, before = self.answers[topic], self.before[topic]
        self.wait(lambda: len(heard) > before, f'an answer on {topic}')
        return heard[-1]

    def wrench(self, topic='tip_wrench/estimate'):
        """The force of the newest wrench [N], and the standard deviations of its components."""
        force = xyz(self.newest(topic).wrench.force)
        covariance = np.reshape(self.newest('backbone/covariance').contact, (6, 6))
        return force, np.sqrt(covariance.diagonal()[:3])


def estimating_here(make_node, domain=None):
    """A node in this process that its client spins."""
    return hosting(make_node, files=(FILE,), client=EstimatorClient, domain=domain, **GIVEN)
