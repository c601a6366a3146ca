"""The packages as found by colcon and ROS."""

import re
import shutil
import subprocess

import pytest
import yaml
from checkout import ROOT

PACKAGES = ['octo_arm_msgs', 'octo_arm_model']  # in the order they must be built

needs_colcon = pytest.mark.skipif(shutil.which('colcon') is None, reason='needs colcon')


def colcon_list(folder, tmp_path):
    """Names of the packages found from ``folder``, dependencies first."""
    command = ['colcon', '--log-base', str(tmp_path / 'log'), 'list', '--topological-order', '-n']
    return subprocess.check_output(command, cwd=folder, text=True).split()


@needs_colcon
def test_colcon_in_the_repository_root_finds_both_packages_messages_first(tmp_path):
    assert colcon_list(ROOT, tmp_path) == PACKAGES


@needs_colcon
def test_a_workspace_needs_the_line_that_the_readme_gives(tmp_path):
    source = tmp_path / 'src'
    source.mkdir()
    (source / 'octo_arm_model').symlink_to(ROOT)
    assert colcon_list(tmp_path, tmp_path) == ['octo_arm_model']
    manual = (ROOT / 'docs' / 'installation.md').read_text()
    line = re.search(r'^ln -s (\S+) (src/\S+)$', manual, re.MULTILINE)
    assert line, 'the manual has lost its line for larger workspaces'
    (tmp_path / line[2]).symlink_to(line[1])
    assert colcon_list(tmp_path, tmp_path) == PACKAGES


def test_package_manifests_are_valid_and_of_one_version():
    parse_package = pytest.importorskip('catkin_pkg.package').parse_package
    versions = set(re.findall(r"version='(.*)'", (ROOT / 'setup.py').read_text()))
    versions |= set(
        re.findall(r"__version__ = '(.*)'", (ROOT / 'octo_arm_model/__init__.py').read_text())
    )
    for folder, name in ((ROOT, 'octo_arm_model'), (ROOT / 'msg_defs', 'octo_arm_msgs')):
        package = parse_package(folder / 'package.xml')
        package.validate()
        assert package.name == name
        versions.add(package.version)
    assert len(versions) == 1


@pytest.mark.parametrize('path', sorted((ROOT / 'msg_defs' / 'msg').glob('*.msg')), ids=str)
def test_every_message_field_is_explained_and_every_number_has_a_unit(path):
    explained = False
    for line in path.read_text().splitlines():
        if line.startswith('#'):
            explained = line
        elif line.strip() and 'Header' not in line:
            assert explained, line
            if line.startswith(('float', 'int', 'uint')):
                assert re.search(r'\[.+\]', explained), line
            explained = False


def test_colcon_defaults_name_the_message_package_for_every_verb():
    verbs = yaml.safe_load((ROOT / 'colcon_defaults.yaml').read_text())
    assert {'build', 'list', 'test'} <= set(verbs)
    assert all(options == {'base-paths': ['.', 'msg_defs']} for options in verbs.values())


@needs_colcon
@pytest.mark.parametrize('folder', ['.', 'msg_defs'])
def test_manifests_are_as_ros_wants_them(folder):
    from catkin_pkg.package import parse_package

    warnings = []
    package = parse_package(str(ROOT / folder / 'package.xml'), warnings=warnings)
    package.validate(warnings=warnings)
    assert not warnings


@needs_colcon
def test_what_the_launch_files_start_is_a_dependency():
    from catkin_pkg.package import parse_package

    package = parse_package(str(ROOT / 'package.xml'))
    depends = {dependency.name for dependency in package.exec_depends}
    shared = ROOT / 'octo_arm_model' / 'ros' / 'launch_parts.py'
    text = ''.join(path.read_text() for path in (*(ROOT / 'launch').iterdir(), shared))
    started = set(re.findall(r"package='(\w+)'", text))
    assert started == {'rviz2'} and "['ros2', 'bag'" in text
    # And the packages of the commands that run launch files and bags.
    assert depends >= started | {'ros2launch', 'ros2bag', 'launch', 'launch_ros'}
