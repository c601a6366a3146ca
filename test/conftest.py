"""Settings of all tests, and fixtures of solvers without ROS."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# One thread of BLAS, which reads this when it is loaded, because tests run in parallel.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import pytest
import ros_domains
from checkout import PAPERS_PRESETS
from command_line import HIGHEST, Cli
from hypothesis import HealthCheck, settings

from octo_arm_model import MODELS, Config, load_config
from octo_arm_model.analysis.workspace import CHUNK, Workspace, sample_workspace
from octo_arm_model.config.parameter_files import preset_path
from octo_arm_model.rod.forms import is_available

settings.register_profile(
    'octo_arm_model',
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile('octo_arm_model')


# Folders with short files come last, so that all workers end at about the same time.
_ORDER = (
    'viewer',
    'apps',
    'ros',
    'project',
    'experiment',
    'estimation',
    'analysis',
    'truth',
    'rod',
    'arm',
    'bags',
    'cli',
    'reproduce',
    'simulation',
    'config',
    'wire',
)
_HERE = Path(__file__).parent


def pytest_configure(config: pytest.Config) -> None:
    """Set signals and the ROS domain, which programs under test inherit."""
    # Shells let background jobs ignore these signals; programs under test need them.
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_IGN:
            handler = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
            signal.signal(number, handler)
    # Tests without a domain of their own use that of this process.
    domain, mark = ros_domains.reserve()
    os.environ['ROS_DOMAIN_ID'] = str(domain)
    config.add_cleanup(mark.close)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run folders with long files first."""
    places = {name: place for place, name in enumerate(_ORDER)}
    items.sort(key=lambda item: places.get(item.path.relative_to(_HERE).parts[0], len(places)))


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Cli:
    """Return a runner of `octo-arm`."""
    return Cli(capsys)


@pytest.fixture(scope='module', autouse=True)
def domains_of_a_file() -> Iterator[None]:
    """Release the ROS domains of a file after its last test."""
    yield
    ros_domains.release()


@pytest.fixture(params=PAPERS_PRESETS)
def preset(request: pytest.FixtureRequest) -> Config:
    """Return each arm of the paper."""
    return load_config(preset_path(request.param))


@pytest.fixture(params=sorted(MODELS))
def model(request: pytest.FixtureRequest) -> str:
    """Return each model."""
    return request.param


@pytest.fixture(params=['closed_form', 'renda2012'])
def papers_model(request: pytest.FixtureRequest) -> str:
    """Return both models of the paper, which share (3a), (9a) and an unnormalised tangent."""
    return request.param


def _arm(name: str) -> Any:
    """Return a fixture of the arm of the preset ``name``."""

    @pytest.fixture(scope='session')
    def config() -> Config:
        return load_config(name)

    return config


table2 = _arm('renda2012_table2')  # bending simulations, three sections
table4 = _arm('renda2012_table4')  # fetching simulations, three sections
rod = _arm('rao2021')  # metal rod of Rao et al. 2021, two sections of three tendons
prototype = _arm('renda2012_prototype')  # arm of the tank, one section


@pytest.fixture(scope='session')
def cloud(table4: Config) -> Workspace:
    """Return tips of the arm of the fetching simulations, in four chunks."""
    return sample_workspace(table4, HIGHEST, 4 * CHUNK, processes=1)


# Compiles here, so that no test that checks output gets the line about compiling, or the time.
is_available()
