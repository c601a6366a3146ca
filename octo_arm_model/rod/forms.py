"""Which form of the node functions is used: loops compiled by numba, or arrays for NumPy."""

import functools
import importlib
import logging
from typing import Protocol

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


class Form(Protocol):
    """The node functions, see `loops` for what each computes."""

    def orientations(self, tables: Tables, z: FloatArray, work: Work) -> None:
        """Orientation and r' of every node."""

    def poses(
        self, tables: Tables, z: FloatArray, places: Places, work: Work
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions and orientations at places, and estimated errors of positions."""

    def angles(self, tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
        """Angle by which every tendon has turned between the base and every node."""

    def sections(self, tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
        """Gradient and Hessian of the energy of every cross section."""

    def balance(
        self,
        tables: Tables,
        z: FloatArray,
        tensions: FloatArray,
        wrench: FloatArray,
        tolerance: float,
        work: Work,
    ) -> tuple[float, int]:
        """Bring every cross section alone to balance with a wrench."""

    def residual(
        self,
        tables: Tables,
        z: FloatArray,
        tensions: FloatArray,
        force: FloatArray,
        couple: FloatArray,
        work: Work,
    ) -> float:
        """Imbalance of every cross section under the loads beyond it; orientations are known."""

    def wrenches(self, tables: Tables, force: FloatArray, couple: FloatArray, work: Work) -> None:
        """Minus what all beyond exerts on every cross section, where orientations are known."""

    def jacobian(
        self, tables: Tables, z: FloatArray, tensions: FloatArray, force: FloatArray, work: Work
    ) -> None:
        """Derivative of the residual by the twist of all nodes."""

    def paper_twists(
        self, tables: PaperTables, sums: FloatArray, tolerance: float
    ) -> tuple[FloatArray, FloatArray]:
        """Twists of cross sections that balance their tendons as in the paper."""

    def moving_loads(
        self,
        tables: MotionTables,
        rule: TimeRule,
        base: FloatArray,
        slope: FloatArray,
        rotation: FloatArray,
        motion: Motion,
    ) -> None:
        """How nodes move, and what this exerts."""

    def imbalance(
        self,
        viscous: FloatArray,
        rate: FloatArray,
        reference: FloatArray,
        residual: FloatArray,
        scale: FloatArray,
    ) -> float:
        """The residual with viscosity, over a reference."""


@functools.cache
def is_available() -> bool:
    """Whether numba is installed and works; an error of one that does not is logged."""
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
    """The loops if ``compiled``, or if that is None and numba is installed; else the arrays.

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
    """Log once when numba begins to compile, which it does once on a machine."""
    from numba.core import event

    class Announcement(event.Listener):
        """Logs the first of all beginnings."""

        def on_start(self, event: object) -> None:
            """Log it."""
            if not said:
                said.append(True)
                _LOG.warning('compiling the solver: up to a minute, once on this machine')

        def on_end(self, event: object) -> None:
            """Do nothing."""

    said = list[bool]()
    event.register('numba:compile', Announcement())
