"""Small parts: types of messages, warnings, RViz."""

import pytest
import yaml
from checkout import ROOT

from octo_arm_model import ConfigError, load_config
from octo_arm_model.config.parameter_files import preset_path
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


CONFIG = load_config(preset_path('renda2012_table4'))


def test_rviz_shows_what_the_node_publishes_and_the_markers_of_eight_arms():
    manager, eight = (
        yaml.safe_load((ROOT / 'rviz' / f'{name}.rviz').read_text())['Visualization Manager']
        for name in ('octo_arm', 'octopus')
    )
    assert manager['Global Options']['Fixed Frame'] == CONFIG.base_frame == 'arm_base'
    topics = {
        display['Class'].split('/')[1]: display.get('Topic', {}).get('Value')
        for display in manager['Displays']
    }
    assert topics == {
        'Grid': None,
        'MarkerArray': MARKERS_TOPIC,
        'Path': 'backbone/path',
        'PoseArray': 'backbone/poses',
        'TF': None,
    }
    for topic, kind in (('backbone/path', 'Path'), ('backbone/poses', 'PoseArray')):
        assert BACKBONE_TOPICS[topic].endswith(f'/{kind}')
    topics = [one['Topic']['Value'] for one in eight['Displays']
              if one['Class'].endswith('/MarkerArray')]  # fmt: skip
    assert topics == [f'arm_{number}/markers' for number in range(1, 9)]
    assert eight['Global Options']['Fixed Frame'] == 'octopus'
    assert eight['Tools'] == manager['Tools']
