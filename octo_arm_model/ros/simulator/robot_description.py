"""The URDF by which ros2_control drives the tendons of an arm, each a joint; needs no ROS.

`joint_state_topic_hardware_interface/JointStateTopicSystem` publishes the commands of controllers
as a JointState and reads the states from another, as `octo_arm_sim` with ``dynamics`` has them.
"""

from __future__ import annotations

from xml.etree import ElementTree

from octo_arm_model.arm.errors import ConfigError, shown
from octo_arm_model.config.config import Config
from octo_arm_model.simulation.movements import tendon_limits

PLUGIN = 'joint_state_topic_hardware_interface/JointStateTopicSystem'
INTERFACES = ('effort', 'position')
COMMANDS, STATES = 'tendon_commands/joint_state', 'tendon_states'
_FASTEST = 1.0  # [m/s] that a tendon is reeled in


def robot_description(config: Config, interface: str, namespace: str = '') -> str:
    """URDF of the tendons of ``config``, commanded by ``interface``: 'effort' or 'position'.

    Raises:
        ConfigError: if ``interface`` is another.
    """
    if interface not in INTERFACES:
        raise ConfigError(f'interface is {shown(interface)}, expected effort or position')
    robot = ElementTree.Element('robot', name='octo_arm')
    ElementTree.SubElement(robot, 'link', name='tendons')
    control = ElementTree.SubElement(robot, 'ros2_control', name='octo_arm', type='system')
    hardware = ElementTree.SubElement(control, 'hardware')
    ElementTree.SubElement(hardware, 'plugin').text = PLUGIN
    prefix = f'/{namespace.strip("/")}/' if namespace.strip('/') else '/'
    for name, topic in (('joint_commands_topic', COMMANDS), ('joint_states_topic', STATES)):
        ElementTree.SubElement(hardware, 'param', name=name).text = prefix + topic
    length = config.arm.length
    for name, highest in zip(config.arm.tendon_names, tendon_limits(config).tolist(), strict=True):
        ElementTree.SubElement(robot, 'link', name=name)
        joint = ElementTree.SubElement(robot, 'joint', name=name, type='prismatic')
        ElementTree.SubElement(joint, 'parent', link='tendons')
        ElementTree.SubElement(joint, 'child', link=name)
        ElementTree.SubElement(
            joint, 'limit', lower=f'{-length:g}', upper=f'{length:g}', effort=f'{highest:g}',
            velocity=f'{_FASTEST:g}',
        )  # fmt: skip
        driven = ElementTree.SubElement(control, 'joint', name=name)
        ElementTree.SubElement(driven, 'command_interface', name=interface)
        for state in ('position', 'velocity', 'effort'):
            ElementTree.SubElement(driven, 'state_interface', name=state)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode')
