"""The arguments of the launch files, from their text."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from checkout import ROOT

EXAMPLE = ROOT / 'config' / 'simulator.yaml'
SHARED = ROOT / 'octo_arm_model' / 'ros' / 'launch_parts.py'
OF_ONE_ARM = {'params_file', 'namespace', 'use_sim_time', 'rviz', 'model', 'frame_prefix'}
ARGUMENTS = {
    'octo_arm': OF_ONE_ARM | {'bag'},
    'octopus': {'params_file', 'use_sim_time', 'rviz', 'model', 'radius', 'base_frame'},
    'simulation': OF_ONE_ARM | {'simulator_file', 'profile', 'estimate', 'ground_truth'},
}
# What the shared functions read.
READ = {
    'arm_node': {'namespace', 'params_file', 'use_sim_time', 'model', 'frame_prefix'},
    'params_file': {'params_file'},
    'rviz': {'rviz', 'use_sim_time'},
    'sim_time': {'use_sim_time'},
}
READERS = ('LaunchConfiguration', 'text', 'value_of', 'overrides')


def calls_of(path: Path) -> list[ast.Call]:
    tree = ast.parse(path.read_text(encoding='utf-8'))
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call)]


def names_in(calls: list[ast.Call], *functions: str) -> list[str]:
    """Names given as text to ``functions``."""
    return [
        argument.value
        for call in calls
        if getattr(call.func, 'id', '') in functions
        for argument in call.args
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str)
    ]


def launch_file(name: str) -> Path:
    return ROOT / 'launch' / f'{name}.launch.py'


def test_every_launch_file_is_tested() -> None:
    assert {path.name.split('.')[0] for path in (ROOT / 'launch').iterdir()} == set(ARGUMENTS)


@pytest.mark.parametrize('name', sorted(ARGUMENTS))
def test_launch_files_declare_each_argument_once_and_read_no_other(name: str) -> None:
    calls = calls_of(launch_file(name))
    declared = names_in(calls, 'declare', 'DeclareLaunchArgument')
    assert sorted(declared) == sorted(ARGUMENTS[name])
    used = set(names_in(calls, *READERS))
    for call in calls:
        used |= READ.get(getattr(call.func, 'id', ''), set())
    assert used == ARGUMENTS[name]
    for call in calls:
        if getattr(call.func, 'id', '') == 'DeclareLaunchArgument':
            given = {keyword.arg: keyword.value for keyword in call.keywords}
            assert {'default_value', 'description'} <= given.keys()


def test_the_shared_functions_read_what_is_shared() -> None:
    tree = ast.parse(SHARED.read_text(encoding='utf-8'))
    (table,) = [
        node.value
        for node in tree.body
        if isinstance(node, ast.AnnAssign) and node.target.id == 'ARGUMENTS'
    ]
    assert set(ast.literal_eval(table)) == OF_ONE_ARM
    assert set(names_in(calls_of(SHARED), *READERS)) <= OF_ONE_ARM
