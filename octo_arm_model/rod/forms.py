"""Which form of the node functions is used: loops compiled by numba, or arrays for NumPy."""

from __future__ import annotations

import importlib.util
from typing import Protocol

from octo_arm_model.core.hints import FloatArray
from octo_arm_model.rod import arrays
from octo_arm_model.rod.tables import Tables, Work


class Form(Protocol):
    """The node functions, see `loops` for what each computes."""

    def orientations(self, tables: Tables, z: FloatArray, work: Work) -> None:
        """Orientation and r' of every node."""

    def angles(self, tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
        """Angle by which every tendon has turned between the base and every node."""

    def sections(self, tables: Tables, z: FloatArray, tensions: FloatArray, work: Work) -> None:
        """Gradient and Hessian of the energy of every cross section."""

    def section_steps(
        self, tables: Tables, z: FloatArray, tensions: FloatArray, wrench: FloatArray, work: Work
    ) -> float:
        """Newton's step of every cross section alone."""

    def residual(
        self, tables: Tables, z: FloatArray, tensions: FloatArray, force: FloatArray,
        couple: FloatArray, work: Work,
    ) -> float:  # fmt: skip
        """Imbalance of every cross section under the loads beyond it."""

    def jacobian(
        self, tables: Tables, z: FloatArray, tensions: FloatArray, force: FloatArray, work: Work
    ) -> None:
        """Derivative of the residual by the twist of all nodes."""


def choose_form(compiled: bool | None) -> Form:
    """The loops if ``compiled``, or if that is None and numba is installed; else the arrays.

    Raises:
        ModuleNotFoundError: if ``compiled`` but numba is not installed.
    """
    if compiled is None:
        compiled = importlib.util.find_spec('numba') is not None
    if not compiled:
        return arrays
    from octo_arm_model.rod import loops

    return loops
