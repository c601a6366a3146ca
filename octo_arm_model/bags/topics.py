"""Names of topics, in whatever namespace."""

from __future__ import annotations

from octo_arm_model.wire.tension_messages import TENSION_TOPICS

# What the model answers with, and the types of that: never a measurement.
ANSWERS: dict[str, str] = {
    'backbone/path': 'nav_msgs/msg/Path',
    'backbone/poses': 'geometry_msgs/msg/PoseArray',
    'strains': 'octo_arm_msgs/msg/SectionStrains',
    'tip_pose': 'geometry_msgs/msg/PoseWithCovarianceStamped',
    'tendon_lengths': 'sensor_msgs/msg/JointState',
}
DESCRIPTION = 'arm_description'  # the arm as a ROS parameter file, from the node
MIDLINE = 'camera/midline'
_USUAL = (*TENSION_TOPICS, MIDLINE)


def names(topic: str, usual: str) -> bool:
    """Whether ``topic`` is the ``usual`` name."""
    return f'/{topic}'.endswith(f'/{usual}')


def is_answer(topic: str) -> bool:
    """Whether ``topic`` is one that the model answers on."""
    return any(names(topic, answer) for answer in ANSWERS)


def is_usual(topic: str) -> bool:
    """Whether ``topic`` is one that tensions or midlines are usually measured on."""
    return any(names(topic, usual) for usual in _USUAL)
