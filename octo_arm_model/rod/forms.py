"""The choice of the form of the node functions: loops compiled by numba, or arrays for NumPy."""

import functools
import importlib
import logging
from collections.abc import Callable
from typing import Protocol, TypeAlias

from octo_arm_model.arm.hints import FloatArray
from octo_arm_model.rod import arrays
from octo_arm_model.rod.tables import (
    Motion,
    MotionTables,
    PaperTables,
    Places,
    Tables,
    TimeRule,
    Work,
)

_LOG = logging.getLogger(__name__)
_Poses: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


class Form(Protocol):
    """The node functions; `loops` documents the arguments and results of each."""

    @property
    def orientations(self) -> Callable[[Tables, FloatArray, Work], None]:
        """Computes the orientation and r' of every node."""

    @property
    def poses(self) -> Callable[[Tables, FloatArray, Places, Work], _Poses]:
        """Computes poses of places, and estimated errors of positions."""

    @property
    def angles(self) -> Callable[[Tables, FloatArray, FloatArray, Work], None]:
        """Computes the angle by which every tendon turns between the base and every node."""

    @property
    def sections(self) -> Callable[[Tables, FloatArray, FloatArray, Work], None]:
        """Computes gradient and Hessian of the energy of every cross section."""

    @property
    def balance(
        self,
    ) -> Callable[[Tables, FloatArray, FloatArray, FloatArray, float, Work], tuple[float, int]]:
        """Finds the twists at which every cross section balances its wrench."""

    @property
    def wrenches(self) -> Callable[[Tables, FloatArray, FloatArray, Work], None]:
        """Computes minus the wrench that all loads beyond exert on every cross section."""

    @property
    def add_gradients(self) -> Callable[[Tables, FloatArray, FloatArray, Work], float]:
        """Computes the imbalance of every cross section from its wrench, and the largest."""

    @property
    def jacobian(self) -> Callable[[Tables, FloatArray, FloatArray, FloatArray, Work], None]:
        """Computes the derivative of the residual by the twists of all nodes."""

    @property
    def paper_twists(
        self,
    ) -> Callable[[PaperTables, FloatArray, float], tuple[FloatArray, FloatArray]]:
        """Computes twists that balance the tendons of sections as in the paper."""

    @property
    def moving_loads(
        self,
    ) -> Callable[[MotionTables, TimeRule, FloatArray, FloatArray, FloatArray, Motion], None]:
        """Computes the motion of the nodes, and their inertial loads."""


@functools.cache
def is_available() -> bool:
    """Whether numba is installed and works. If it is installed but fails, the error is logged."""
    try:
        importlib.import_module('octo_arm_model.rod.loops')
    except ModuleNotFoundError as error:
        if error.name == 'numba':
            return False
        reason = str(error)
    except Exception as error:  # such as a NumPy newer than numba supports
        reason = f'{type(error).__name__}: {error}'
    else:
        return True
    _LOG.warning('solving without numba, which does not work: %s', reason)
    return False


def choose_form(compiled: bool | None) -> Form:
    """Return the loops if ``compiled``, or if it is None and numba works; else the arrays.

    Raises:
        ModuleNotFoundError: if ``compiled`` but numba is not installed.
    """
    if compiled is None:
        compiled = is_available()
    if not compiled:
        return arrays
    from octo_arm_model.rod import loops

    announce_compiling()
    return loops


@functools.cache
def announce_compiling() -> None:
    """Log a line when numba begins to compile, which happens once on a machine."""
    from numba.core import event

    class Announcement(event.Listener):
        """A listener that logs the first compilation."""

        def on_start(self, event: object) -> None:
            """Log a line if this is the first compilation."""
            if not announced:
                announced.append(True)
                _LOG.warning('compiling the solver: up to a minute, once on this machine')

        def on_end(self, event: object) -> None:
            """Do nothing at the end of a compilation."""

    announced = list[bool]()
    event.register('numba:compile', Announcement())
