"""The package as a whole: its exports, imports, documentation and manifests."""

import pkgutil
import re
import shutil
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from checkout import ROOT

import octo_arm_model

# Folders that need neither ROS nor an optional extra, except for loops that numba compiles.
LOOPS = ('compiled', 'loops', 'paper_loops', 'inertia_loops', 'section_loops', 'angle_loops')
BASE = ('arm', 'rod', 'config', 'analysis', 'wire')
CORE = sorted(
    module.name
    for folder in BASE
    for module in pkgutil.walk_packages(
        [f'{octo_arm_model.__path__[0]}/{folder}'], f'octo_arm_model.{folder}.'
    )
    if not module.ispkg and module.name.rpartition('.')[2] not in LOOPS
)


SOLVE = (
    'from octo_arm_model.cli.main import main; '
    "main(['solve', 'renda2012_prototype', '--tensions', '[[3,0,0,0]]'])"
)


COMMANDS = 'import octo_arm_model.cli.play, octo_arm_model.simulation.simulator'


@pytest.mark.parametrize(
    'statement',
    ['import octo_arm_model', f'import {", ".join(CORE)}', SOLVE, COMMANDS],
    ids=['package', 'all', 'solve', 'commands'],
)
def test_core_needs_neither_ros_nor_an_extra(statement):
    code = f'{statement}; import sys; print(*sys.modules)'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    loaded = {name.split('.')[0] for name in done.stdout.split()}
    assert 'numpy' in loaded
    unwanted = {'rclpy', 'ament_index_python', 'octo_arm_msgs', 'std_msgs', 'matplotlib'}
    unwanted |= {'numba', 'rosbags', 'viser', 'skfem'}
    assert not loaded & unwanted


def test_exported_names_are_sorted_and_errors_have_one_base():
    names = octo_arm_model.__all__
    # Constants, then classes, then functions, each from A to Z.
    assert names == sorted(set(names), key=lambda name: (not name.isupper(), name.islower(), name))
    for value in (getattr(octo_arm_model, name) for name in names):
        if isinstance(value, type) and issubclass(value, Exception):
            assert issubclass(value, octo_arm_model.OctoArmError), value


def test_named_tuples_have_no_second_base():
    for path in (ROOT / 'octo_arm_model').rglob('*.py'):
        assert not re.search(r'class \w+\(NamedTuple, |, NamedTuple\)', path.read_text()), path


def test_version_is_the_same_everywhere():
    for file, line in (('setup.py', "version='{}'"), ('CITATION.cff', 'version: {}\n')):
        assert line.format(octo_arm_model.__version__) in (ROOT / file).read_text()
    for manifest in ('package.xml', 'msg_defs/package.xml'):
        assert ElementTree.parse(ROOT / manifest).findtext('version') == octo_arm_model.__version__


PACKAGES = ['octo_arm_msgs', 'octo_arm_model']  # in the order they must be built

needs_colcon = pytest.mark.skipif(shutil.which('colcon') is None, reason='needs colcon')


def colcon_list(folder, tmp_path):
    """Return the names of the packages below ``folder``, dependencies first."""
    command = ['colcon', '--log-base', str(tmp_path / 'log'), 'list', '--topological-order', '-n']
    return subprocess.check_output(command, cwd=folder, text=True).split()


@needs_colcon
def test_colcon_finds_both_packages(tmp_path):
    assert colcon_list(ROOT, tmp_path) == PACKAGES
    source = tmp_path / 'src'
    source.mkdir()
    (source / 'octo_arm_model').symlink_to(ROOT)
    assert colcon_list(tmp_path, tmp_path) == ['octo_arm_model']
    manual = (ROOT / 'docs' / 'getting_started.md').read_text()
    line = re.search(r'^ln -s (\S+) (src/\S+)$', manual, re.MULTILINE)
    assert line, 'the manual has lost its line for larger workspaces'
    (tmp_path / line[2]).symlink_to(line[1])
    assert colcon_list(tmp_path, tmp_path) == PACKAGES


@pytest.mark.parametrize(
    ('folder', 'name'), [('.', 'octo_arm_model'), ('msg_defs', 'octo_arm_msgs')]
)
def test_manifests_are_valid(folder, name):
    parse_package = pytest.importorskip('catkin_pkg.package').parse_package
    warnings = []
    package = parse_package(str(ROOT / folder / 'package.xml'), warnings=warnings)
    package.validate(warnings=warnings)
    assert not warnings and package.name == name


def test_packages_of_launch_files_and_imports_are_dependencies():
    parse_package = pytest.importorskip('catkin_pkg.package').parse_package
    packages = pytest.importorskip('ament_index_python.packages').get_packages_with_prefixes()
    package = parse_package(str(ROOT / 'package.xml'))
    depends = {dependency.name for dependency in package.exec_depends}
    sources = (path.read_text() for path in (ROOT / 'octo_arm_model').rglob('*.py'))
    imported = re.findall(r'^ *(?:from|import) (\w+)', '\n'.join(sources), re.MULTILINE)
    assert depends >= packages.keys() & set(imported) - {package.name}
    shared = ROOT / 'octo_arm_model' / 'ros' / 'launch_parts.py'
    text = ''.join(path.read_text() for path in (*(ROOT / 'launch').iterdir(), shared))
    controllers = (ROOT / 'config' / 'ros2_control' / 'controllers.yaml').read_text()
    started = set(re.findall(r"package='(\w+)'|type: (\w+)/", text + controllers))
    started = {name for names in started for name in names if name}
    assert (
        started >= {'rviz2', 'controller_manager', 'joint_state_broadcaster'}
        and "['ros2', 'bag'" in text
    )
    # With the packages of the commands that run launch files and bags.
    assert depends >= started | {'ros2launch', 'ros2bag', 'launch', 'launch_ros'}
