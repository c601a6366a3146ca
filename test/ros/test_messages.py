"""Conversion between messages and the core, without a node."""

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('octo_arm_msgs', reason='needs the message package, see make test')

from octo_arm_model import ConfigError
from octo_arm_model.ros.messages import message_class


@pytest.mark.parametrize('inside', ['__init__.py', 'other/__init__.py'])
def test_a_type_that_is_not_installed_runs_nothing_of_its_package(tmp_path, monkeypatch, inside):
    # Type names come from parameters, which whoever is on the network may set.
    for name in {'__init__.py', inside}:
        path = tmp_path / 'octo_arm_loud' / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('raise SystemExit("was run")')
    monkeypatch.syspath_prepend(tmp_path)
    for type_name in ('octo_arm_loud/msg/Any', 'octo_arm_absent/msg/Any', 'sensor_msgs/msg/Any'):
        with pytest.raises(ConfigError, match='no messages of type'):
            message_class(type_name)
    assert message_class('sensor_msgs/msg/JointState').__name__ == 'JointState'
