"""The package as a whole: its exports, imports and documentation."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from checkout import ROOT

import octo_arm_model

# Folders that need neither ROS nor any optional extra, but for the loops that numba compiles.
LOOPS = ('compiled', 'loops', 'paper_loops', 'inertia_loops')
BASE = ('arm', 'rod', 'config', 'analysis', 'wire')
CORE = sorted(
    module.name
    for folder in BASE
    for module in pkgutil.walk_packages(
        [f'{octo_arm_model.__path__[0]}/{folder}'], f'octo_arm_model.{folder}.'
    )
    if not module.ispkg and module.name.rpartition('.')[2] not in LOOPS
)


def modules_after(statement: str) -> set[str]:
    """Top-level modules a fresh interpreter has loaded after ``statement``."""
    code = f'{statement}; import sys; print(*sys.modules)'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    return {name.split('.')[0] for name in done.stdout.split()}


@pytest.mark.parametrize('modules', ['octo_arm_model', ', '.join(CORE)], ids=['package', 'all'])
def test_the_core_imports_neither_ros_nor_matplotlib(modules: str) -> None:
    loaded = modules_after(f'import {modules}')
    assert 'numpy' in loaded
    unwanted = {'rclpy', 'ament_index_python', 'octo_arm_msgs', 'std_msgs', 'matplotlib'}
    unwanted |= {'numba', 'rosbags', 'viser', 'skfem'}
    assert not loaded & unwanted


def test_solving_imports_neither_ros_nor_matplotlib() -> None:
    loaded = modules_after(
        'from octo_arm_model.cli.main import main; '
        "main(['solve', 'renda2012_prototype', '--tensions', '[[3,0,0,0]]'])"
    )
    assert not loaded & {'rclpy', 'matplotlib'}


def test_exported_names_exist_and_are_listed_once_in_order() -> None:
    names = octo_arm_model.__all__
    for name in names:
        assert hasattr(octo_arm_model, name), name
    # Constants, then classes, then functions, each from A to Z.
    assert names == sorted(set(names), key=lambda name: (not name.isupper(), name.islower(), name))


def test_every_error_on_purpose_has_one_base() -> None:
    for name in octo_arm_model.__all__:
        value = getattr(octo_arm_model, name)
        if isinstance(value, type) and issubclass(value, Exception):
            assert issubclass(value, octo_arm_model.OctoArmError), name


@pytest.mark.parametrize('module', CORE)
def test_public_names_are_documented(module: str) -> None:
    loaded = importlib.import_module(module)
    assert loaded.__doc__
    for name, value in vars(loaded).items():
        if name.startswith('_') or getattr(value, '__module__', None) != module:
            continue
        if inspect.isclass(value) or inspect.isfunction(value):
            assert value.__doc__, f'{module}.{name}'
        if inspect.isclass(value):
            for method, function in vars(value).items():
                if inspect.isfunction(function) and not method.startswith('_'):
                    assert function.__doc__, f'{module}.{name}.{method}'


def test_one_version_everywhere() -> None:
    root = ROOT
    for manifest in ('package.xml', 'msg_defs/package.xml'):
        assert ElementTree.parse(root / manifest).findtext('version') == octo_arm_model.__version__
    for file, line in (('setup.py', "version='{}'"), ('CITATION.cff', 'version: {}\n')):
        assert line.format(octo_arm_model.__version__) in (root / file).read_text()
