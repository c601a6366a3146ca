"""Small parts: types of messages, warnings, RViz."""

import pytest
import yaml
from checkout import ROOT

from octo_arm_model import ConfigError
from octo_arm_model.ros.node.outputs import MARKERS_TOPIC
from octo_arm_model.ros.topics import message_class
from octo_arm_model.wire.backbone import BACKBONE_TOPICS


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


def test_rviz_shows_what_the_nodes_publish():
    for name, frame, prefixes in (
        ('octo_arm', 'arm_base', ['']), ('octopus', 'octopus', [f'arm_{n}/' for n in range(1, 9)]),
    ):  # fmt: skip
        manager = yaml.safe_load((ROOT / 'rviz' / f'{name}.rviz').read_text())
        manager = manager['Visualization Manager']
        topics = [one['Topic']['Value'] for one in manager['Displays'] if 'Topic' in one]
        assert manager['Global Options']['Fixed Frame'] == frame
        assert {prefix + MARKERS_TOPIC for prefix in prefixes} <= set(topics)
        others = {topic for topic in topics if not topic.endswith(MARKERS_TOPIC)}
        assert others <= set(BACKBONE_TOPICS)
