"""Settings of all tests, and fixtures of the solvers; nothing of ROS."""

import contextlib
import os
import signal
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# As the programs do; tests run beside each other. BLAS reads it when it is loaded.
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


# Files of the last folders are short, so that all workers end at about the same time.
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
_MOST = 5.0  # of processor time for a test of `make test` [s]
_IS_LAST = pytest.StashKey[bool]()
_before = 0.0
_compiling = [0.0]  # of that, what numba took to compile here


def pytest_configure(config: pytest.Config) -> None:
    """Set what programs under test inherit."""
    # They hear signals that shells have their background jobs ignore ...
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_IGN:
            how = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
            signal.signal(number, how)
    # ... and are in a ROS domain of this process where a test gives them no other.
    domain = contextlib.ExitStack()
    os.environ['ROS_DOMAIN_ID'] = str(domain.enter_context(ros_domains.reserved_domain()))
    config.add_cleanup(domain.close)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the folders of long files."""
    places = {name: place for place, name in enumerate(_ORDER)}
    items.sort(key=lambda item: places.get(item.path.relative_to(_HERE).parts[0], len(places)))


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Cli:
    """Runs `octo-arm`."""
    return Cli(capsys)


@pytest.fixture(scope='module', autouse=True)
def domains_of_a_file() -> Iterator[None]:
    """Give back the ROS domains of a file when all in it has ended."""
    yield
    ros_domains.release()


def _processor_time() -> float:
    """Of this process and those that it has waited for, without what numba compiled here [s]."""
    return sum(os.times()[:4]) - _compiling[0]


def pytest_runtest_logstart() -> None:
    """Begin to count the processor time of a test."""
    global _before
    _before = _processor_time()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Any:
    """Note the last test of a file: after it processes end that all tests of the file used."""
    item.stash[_IS_LAST] = nextitem is None or nextitem.path != item.path
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Any:
    """Give the report of each phase of a test its processor time, which workers hand over."""
    global _before
    report = yield
    before, _before = _before, _processor_time()
    is_of_file = report.when == 'teardown' and item.stash.get(_IS_LAST, False)
    report.processor_time = 0.0 if is_of_file else _before - before
    return report


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Name the tests of `make test` that took more processor time than they should."""
    spent: Counter[str] = Counter()
    for report in (one for reports in terminalreporter.stats.values() for one in reports):
        if 'endurance' not in getattr(report, 'keywords', ()):
            spent[report.nodeid] += getattr(report, 'processor_time', 0.0)
    dear = [(name, seconds) for name, seconds in spent.most_common() if seconds > _MOST]
    if dear:
        terminalreporter.section(f'more than {_MOST:.0f} s of processor time')
        for name, seconds in dear:
            terminalreporter.line(f'{seconds:6.1f} s  {name}')


@pytest.fixture(params=PAPERS_PRESETS)
def preset(request: pytest.FixtureRequest) -> Config:
    """Every arm of the paper."""
    return load_config(preset_path(request.param))


@pytest.fixture(params=sorted(MODELS))
def model(request: pytest.FixtureRequest) -> str:
    """Every model."""
    return request.param


@pytest.fixture(params=['closed_form', 'renda2012'])
def papers_model(request: pytest.FixtureRequest) -> str:
    """Both models of the paper, which share (3a), (9a) and a tangent that is not normalised."""
    return request.param


def _arm(name: str) -> Any:
    """Fixture of the arm of the preset ``name``."""

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
    """Tips of the arm of the fetching simulations, in four chunks."""
    return sample_workspace(table4, HIGHEST, 4 * CHUNK, processes=1)


# Compiled before any test checks the output, which would have the line about compiling.
HAS_NUMBA = is_available()
if HAS_NUMBA:
    from numba.core import event

    class _Compilation(event.Listener):
        """Sums the processor time in which numba compiles: machine code is kept, and no test's."""

        _began, _depth = 0.0, 0

        def on_start(self, event: Any) -> None:
            """Begin to count, unless this is part of another compilation."""
            if not self._depth:
                self._began = time.process_time()
            self._depth += 1

        def on_end(self, event: Any) -> None:
            """Add what the outermost compilation took."""
            self._depth -= 1
            if not self._depth:
                _compiling[0] += time.process_time() - self._began

    event.register('numba:compile', _Compilation())
