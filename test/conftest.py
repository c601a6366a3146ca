"""Settings of all tests, and fixtures of solvers without ROS."""

import contextlib
import os
import signal
import time
from collections import Counter
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
_MOST = 5.0  # bound of the processor time of a test of `make test` [s]
_IS_LAST = pytest.StashKey[bool]()
_before = 0.0
_compiling = [0.0]  # time in which numba compiled in this process [s]


def pytest_configure(config: pytest.Config) -> None:
    """Set signals and the ROS domain, which programs under test inherit."""
    # Shells let background jobs ignore these signals; programs under test need them.
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_IGN:
            handler = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
            signal.signal(number, handler)
    # Tests without a domain of their own use that of this process.
    domain = contextlib.ExitStack()
    os.environ['ROS_DOMAIN_ID'] = str(domain.enter_context(ros_domains.reserved_domain()))
    config.add_cleanup(domain.close)


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


def _processor_time() -> float:
    """Processor time of this process and its ended children, without numba's compiling [s]."""
    return sum(os.times()[:4]) - _compiling[0]


def pytest_runtest_logstart() -> None:
    """Note the processor time at the start of a test."""
    global _before
    _before = _processor_time()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Any:
    """Note the last test of a file: after it end processes that the whole file used."""
    item.stash[_IS_LAST] = nextitem is None or nextitem.path != item.path
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Any:
    """Add the processor time to the report of each phase, which workers send."""
    global _before
    report = yield
    start, _before = _before, _processor_time()
    ends_file = report.when == 'teardown' and item.stash.get(_IS_LAST, False)
    report.processor_time = 0.0 if ends_file else _before - start
    return report


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the tests of `make test` with more processor time than `_MOST`."""
    times: Counter[str] = Counter()
    for report in (report for reports in terminalreporter.stats.values() for report in reports):
        if 'endurance' not in getattr(report, 'keywords', ()):
            times[report.nodeid] += getattr(report, 'processor_time', 0.0)
    slow = [(name, seconds) for name, seconds in times.most_common() if seconds > _MOST]
    if slow:
        terminalreporter.section(f'more than {_MOST:.0f} s of processor time')
        for name, seconds in slow:
            terminalreporter.line(f'{seconds:6.1f} s  {name}')


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


# Compiles here, so that no test that checks output gets the line about compiling.
HAS_NUMBA = is_available()
if HAS_NUMBA:
    from numba.core import event

    class _Compilation(event.Listener):
        """Sums the processor time in which numba compiles, which belongs to no single test."""

        _began, _depth = 0.0, 0

        def on_start(self, event: Any) -> None:
            """Note the start of an outermost compilation."""
            if not self._depth:
                self._start = time.process_time()
            self._depth += 1

        def on_end(self, event: Any) -> None:
            """Add the time of an outermost compilation."""
            self._depth -= 1
            if not self._depth:
                _compiling[0] += time.process_time() - self._start

    event.register('numba:compile', _Compilation())
