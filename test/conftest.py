"""Settings and fixtures of the core's tests; nothing of ROS."""

from __future__ import annotations

import signal
from typing import Any

import numpy as np
import pytest
from checkout import PAPERS_PRESETS
from hypothesis import HealthCheck, settings
from workspaces import HIGHEST

from octo_arm_model import MODELS, Config, load_config
from octo_arm_model.analysis.workspace import CHUNK, Workspace, sample_workspace
from octo_arm_model.config.presets import preset_path
from octo_arm_model.core.compiled.numba_build import is_available

settings.register_profile(
    'octo_arm_model',
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile('octo_arm_model')


def pytest_configure() -> None:
    """Let programs under test hear signals that shells have their background jobs ignore."""
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) == signal.SIG_IGN:
            how = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
            signal.signal(number, how)


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
        return load_config(preset_path(name))

    return config


table2 = _arm('renda2012_table2')  # bending simulations, three sections
table4 = _arm('renda2012_table4')  # fetching simulations, three sections
rod = _arm('rao2021')  # metal rod of Rao et al. 2021, two sections of three tendons
prototype = _arm('renda2012_prototype')  # arm of the tank, one section


@pytest.fixture(scope='session')
def cloud(table4: Config) -> Workspace:
    """Tips of the arm of the fetching simulations, in four chunks."""
    return sample_workspace(table4, HIGHEST, 4 * CHUNK, processes=1)


@pytest.fixture
def numpy_to_the_last_bit() -> None:
    """Skip where a repeated solve may differ by rounding."""
    if np.__version__.startswith('1.'):
        pytest.skip('NumPy 1 rounds products of complex numbers as they lie in memory')


# Compiled before any test checks the output, which would have the line about compiling.
HAS_NUMBA = is_available()


@pytest.fixture
def installed_to_the_last_bit(request: pytest.FixtureRequest) -> None:
    """As `numpy_to_the_last_bit`, which matters where numba is not installed."""
    if not HAS_NUMBA:
        request.getfixturevalue('numpy_to_the_last_bit')


@pytest.fixture(params=['numba', 'NumPy'])
def to_the_last_bit(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """With numba, and as if it were not installed; skipped where repeated solves may differ."""
    if request.param == 'numba':
        pytest.importorskip('numba')
    else:
        request.getfixturevalue('numpy_to_the_last_bit')
        monkeypatch.setattr('octo_arm_model.core.solver.is_available', lambda: False)
