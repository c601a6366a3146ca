"""What the launch files start, where a ROS with launch is installed, which is in no wheel."""

import re
import runpy
from pathlib import Path
from typing import Any

import pytest
from checkout import ROOT

pytest.importorskip('launch_ros', reason='needs an installed ROS')

from launch import LaunchContext
from launch.actions import DeclareLaunchArgument, LogInfo
from launch.conditions import InvalidConditionExpressionError
from launch.utilities import perform_substitutions
from launch_ros.actions import Node
from launch_ros.utilities import evaluate_parameters

from octo_arm_model import ConfigError, load_config
from octo_arm_model.config.parameter_files import load_parameters
from octo_arm_model.simulation.simulator import for_arm_node

EXAMPLE = ROOT / 'config' / 'simulator.yaml'


def actions(name: str, **values: str) -> tuple[Any, list[Any]]:
    """The context of a launch file and its actions whose conditions hold."""
    loaded = runpy.run_path(str(ROOT / 'launch' / f'{name}.launch.py'))
    context = LaunchContext()
    context.launch_configurations.update(values)
    for entity in loaded['generate_launch_description']().entities:
        if isinstance(entity, DeclareLaunchArgument):
            entity.execute(context)
    found = loaded['start'](context)
    return context, [one for one in found if not one.condition or one.condition.evaluate(context)]


def logged(name: str, **values: str) -> list[str]:
    """What a launch file logs."""
    context, found = actions(name, **values)
    return [perform_substitutions(context, a.msg) for a in found if isinstance(a, LogInfo)]


def started(name: str, **values: str) -> dict[tuple[str, str], dict[str, Any]]:
    """Parameters of the nodes that a launch file starts, by executable and namespace."""
    context, found = actions(name, **values)
    nodes = {}
    for action in found:
        if not isinstance(action, Node):
            continue
        action._perform_substitutions(context)
        # Names that begin with an underscore hold what the public ones are computed from.
        given = evaluate_parameters(context, action._Node__parameters)
        parameters: dict[str, Any] = {}
        for part in given:
            parameters |= part if isinstance(part, dict) else {'file': str(part)}
        nodes[action.node_executable, action.expanded_node_namespace] = parameters
    return nodes


def test_what_is_given_overrides_the_file_and_what_is_not_leaves_it_alone():
    ((key, plain),) = started('octo_arm').items()
    assert key == ('octo_arm_node', '') or key == ('octo_arm_node', '/')
    assert {'model', 'frame_prefix'}.isdisjoint(plain) and plain['use_sim_time'] is False
    assert Path(plain['file']).stem == 'renda2012_table4'
    ((_, given),) = started('octo_arm', model='exact', frame_prefix='1_').items()
    assert (given['model'], given['frame_prefix']) == ('exact', '1_')


def test_a_bag_is_played_where_there_is_a_player(monkeypatch, tmp_path):
    installed(monkeypatch, tmp_path)
    with pytest.raises(ConfigError, match='needs ros2bag, expected ROS packages that are inst'):
        actions('octo_arm', bag='tensions')
    installed(monkeypatch, tmp_path / 'all', 'ros2bag')
    _, found = actions('octo_arm', bag='tensions')
    assert len(found) == 2


def test_the_node_finds_itself_in_a_file_of_several(tmp_path):
    file = tmp_path / 'arms.yaml'
    text = (ROOT / 'config' / 'renda2012_table4.yaml').read_text()
    file.write_text(
        ''.join(text.replace('/**', f'/{side}/octo_arm') for side in ('left', 'right'))
    )
    ((key, _),) = started('octo_arm', params_file=str(file), namespace='left').items()
    assert key == ('octo_arm_node', '/left')


@pytest.mark.parametrize('launch', ['octo_arm', 'simulation', 'octopus'])
def test_a_preset_is_taken_by_its_name(launch):
    nodes = started(launch, params_file='renda2012_table2')
    assert {Path(given['file']).stem for given in nodes.values()} == {'renda2012_table2'}


def test_two_simulated_arms_have_frames_of_their_own(tmp_path):
    file = tmp_path / 'arm.yaml'
    text = (ROOT / 'config' / 'renda2012_table4.yaml').read_text()
    file.write_text(re.sub(r'( +)model:', r"\1frame_prefix: 'of_file_'\n\1model:", text, count=1))
    prefixes = []
    left = {'frame_prefix': 'left_', 'base_frame': 'left_base'}
    for given in (left, {'params_file': str(file)}, {}):
        nodes = started('simulation', namespace='arm', ground_truth='true', **given)
        frames = [one.get('base_frame') for one in nodes.values()]
        assert frames == 3 * [given.get('base_frame')]
        assert set(nodes) == {
            ('octo_arm_node', '/arm'),
            ('octo_arm_sim', '/arm'),
            ('octo_arm_node', '/arm/ground_truth'),
        }
        prefixes.append(nodes['octo_arm_node', '/arm/ground_truth']['frame_prefix'])
        assert nodes['octo_arm_node', '/arm'].get('frame_prefix') == given.get('frame_prefix')
    assert prefixes == ['left_ground_truth_', 'of_file_ground_truth_', 'ground_truth_']


def test_the_node_knows_what_the_simulated_load_cells_read():
    nodes = started('simulation', simulator_file=str(EXAMPLE))
    (node,) = [given for (program, _), given in nodes.items() if program == 'octo_arm_node']
    values = load_parameters(EXAMPLE)
    assert {name: node[name] for name in for_arm_node(values)} == for_arm_node(values)
    assert node['tension_deadband'] == 0.06


def test_true_tensions_are_no_readings_of_load_cells(tmp_path):
    file = tmp_path / 'arm.yaml'
    text = (ROOT / 'config' / 'renda2012_table4.yaml').read_text()
    file.write_text(re.sub(r'( +)model:', r'\1tension_deadband: 0.1\n\1model:', text, count=1))
    nodes = started('simulation', params_file=str(file), ground_truth='true')
    truth = nodes['octo_arm_node', '/ground_truth']
    assert truth['tension_deadband'] == 0.0 and set(truth['tension_scale']) == {1.0}
    assert tuple(truth['tension_names']) == load_config(file).arm.tendon_names


def test_an_estimator_takes_the_place_of_the_node_of_an_arm_that_is_pushed():
    nodes = started('simulation', estimate='true', ground_truth='true')
    programs = {program: given for (program, _), given in nodes.items()}
    assert set(programs) == {'octo_arm_estimator', 'octo_arm_sim', 'octo_arm_node'}
    assert len(programs['octo_arm_sim']['push.force']) == 3
    found = programs['octo_arm_estimator']['estimator.marker_s']
    assert found == programs['octo_arm_sim']['sensors.marker_s'] and len(found) == 2
    assert programs['octo_arm_node']['model'] == 'exact'
    with pytest.raises(InvalidConditionExpressionError):
        started('simulation', estimate='yes')


def installed(monkeypatch: pytest.MonkeyPatch, folder: Path, *packages: str) -> None:
    """Make ROS find this package and ``packages``, and no other."""
    index = folder / 'share' / 'ament_index' / 'resource_index' / 'packages'
    index.mkdir(parents=True)
    for package in ('octo_arm_model', *packages):
        (index / package).touch()
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(folder))


def test_the_octopus_has_eight_arms_and_rviz_if_wanted(monkeypatch, tmp_path):
    installed(monkeypatch, tmp_path, 'rviz2')
    nodes = started('octopus', rviz='true', base_frame='body')
    (seen,) = [key for key in nodes if key[0] == 'rviz2']
    assert nodes.pop(seen) == {'use_sim_time': False}
    assert {where for _, where in nodes} == {f'/arm_{number}' for number in range(1, 9)}
    for (_, where), parameters in nodes.items():
        assert parameters['base_frame'] == 'body'
        assert parameters['frame_prefix'] == f'{where[1:]}_'


@pytest.mark.parametrize('name', ['octo_arm', 'octopus', 'simulation'])
def test_without_rviz_that_is_logged_and_the_nodes_are_started(name, monkeypatch, tmp_path):
    expected = started(name)
    installed(monkeypatch, tmp_path)
    assert started(name, rviz='true') == expected
    assert logged(name, rviz='true') == ['no RViz: the package rviz2 is not installed']
    assert logged(name, rviz='false') == []


def test_controllers_drive_the_tendons_of_an_arm_that_moves(monkeypatch, tmp_path):
    plugin = 'joint_state_topic_hardware_interface'
    others = 'controller_manager', 'joint_state_broadcaster', plugin
    installed(monkeypatch, tmp_path, *others)
    with pytest.raises(ConfigError, match='needs robot_state_publisher, expected ROS packages'):
        started('ros2_control')
    installed(monkeypatch, tmp_path / 'all', 'robot_state_publisher', *others)
    nodes = started(
        'ros2_control',
        namespace='left',
        interface='position',
        params_file='renda2012_prototype',
        frame_prefix='left_',
        controllers_file='mine.yaml',
    )
    assert nodes['octo_arm_sim', '/left']['dynamics'] is True
    assert nodes['ros2_control_node', '/left']['file'] == 'mine.yaml'
    tendons = nodes['robot_state_publisher', '/left']
    assert '/left/tendon_states' in tendons['robot_description']
    assert tendons['frame_prefix'] == 'left_'
    assert ('spawner', '/left') in nodes
