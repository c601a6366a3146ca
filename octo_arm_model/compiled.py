"""The paper's models in machine code, many times as quick for one arm, where numba is installed.

Numba compiles the loops of `loops` and the formulas these use. That takes it some ten seconds,
once: it keeps the result beside this package or, where nothing can be written there, in the
user's cache. Shapes are those of NumPy to rounding, which is not to the last bit.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import importlib
import inspect
import types
from pathlib import Path
from typing import Any

import numpy as np

from octo_arm_model import loops
from octo_arm_model.closed_form import ClosedForm
from octo_arm_model.grid import StationGrid
from octo_arm_model.hints import FloatArray
from octo_arm_model.kinematics import Frame
from octo_arm_model.renda2012 import Renda2012
from octo_arm_model.results import Results
from octo_arm_model.tables import MarchTables, Tables, packed

# Divisions by zero give infinity as in NumPy, which what is found is looked through for.
_OPTIONS: dict[str, Any] = {'error_model': 'numpy'}


@functools.cache
def fault() -> str | None:
    """Why there is no machine code: '' without numba, else what is wrong with it; or None."""
    try:
        importlib.import_module('numba')
    except ModuleNotFoundError as error:
        return '' if error.name == 'numba' else str(error)
    except Exception as error:  # as with a NumPy that is newer than it knows
        return f'{type(error).__name__}: {error}'
    return None


def is_available() -> bool:
    """Whether numba is installed and works."""
    return fault() is None


def is_ready() -> bool:
    """Whether nothing is left to compile; if not, the first shape takes some ten seconds."""
    if not is_available():
        return True
    machine = _machine_code()
    kept = f'*.{machine.py_func.__qualname__}-*.nbi'
    return bool(machine.signatures) or any(Path(machine.stats.cache_path or '').glob(kept))


class Compiled:
    """Shapes of one arm by a model of the paper."""

    def __init__(self, statics: ClosedForm | Renda2012, grid: StationGrid, base: Frame) -> None:
        """Tabulate the arm of ``statics`` on ``grid``, standing on ``base``.

        Raises:
            ModuleNotFoundError: if numba is not installed.
        """
        self._find_shapes = _machine_code()
        nothing, none = np.zeros((0, 0)), np.zeros((0, 3), np.int64)
        march = MarchTables(
            weights=packed(nothing[np.newaxis]), stiffness=nothing,
            jump_weights=nothing[np.newaxis, np.newaxis], jump_bending=nothing.ravel(),
            pieces=none, integrate=nothing[np.newaxis], runs=none, to_nodes=nothing.ravel(),
        )  # fmt: skip
        if isinstance(statics, Renda2012):
            march = statics.march_tables()
        a, b = (complex(part) for part in base.rotation)
        tables = Tables(
            weights=packed(statics.weights.matrices),
            stiffness=np.array(statics.stiffness),
            march=march,
            step=grid.step,
            station_node=grid.station_node,
            base=np.array([*base.position, a.real, a.imag, b.real, b.imag]),
        )
        self._tables: Tables = _own(tables)

    @classmethod
    def of(
        cls, statics: ClosedForm | Renda2012, grid: StationGrid, base: Frame
    ) -> Compiled | None:
        """`Compiled`, if the loops cover the arm.

        They do where tendons make neither mixed second moment nor swirl, see `TendonSums`, which
        the paper's do not.

        Raises:
            ModuleNotFoundError: if numba is not installed.
        """
        return cls(statics, grid, base) if statics.weights.is_plain else None

    def solve(self, tensions: FloatArray, results: Results) -> list[int]:
        """Solve for ``tensions`` (batch, tendons) [N] and fill in ``results``.

        Returns:
            Numbers of the arms that have no answer, and have to be solved otherwise.
        """
        strains, others = results.strains, results.arrays
        if results.is_one:
            strains = strains[:, np.newaxis]
            others = tuple(array[np.newaxis] for array in others)
        without = self._find_shapes(self._tables, tensions, results.twist, strains, *others)
        return np.flatnonzero(results.iterations < 0).tolist() if without else []


def _own(value: Any) -> Any:
    """A copy with arrays that can be written and lie in order: one type for the compiler."""
    if isinstance(value, np.ndarray):
        return np.array(value, order='C')
    return type(value)(*map(_own, value)) if hasattr(value, '_fields') else value


@functools.cache
def _machine_code() -> Any:
    """`loops.find_shapes`, compiled."""
    import numba

    functions = {
        name: value for name, value in vars(loops).items() if isinstance(value, types.FunctionType)
    }
    # Each sees the others compiled, under the names they have in `loops`.
    scope = dict(vars(loops))
    for name, function in functions.items():
        plain = types.FunctionType(function.__code__, scope, name)
        scope[name] = numba.njit(plain, **_OPTIONS)
    entry = types.FunctionType(loops.find_shapes.__code__, scope, 'find_shapes')
    # Numba would look for changes in the file of this function alone.
    sources = sorted({__file__, *map(inspect.getfile, functions.values())})
    digest = hashlib.sha256(b''.join(Path(file).read_bytes() for file in sources))
    entry.__qualname__ = f'find_shapes_{digest.hexdigest()[:16]}'
    # Numba's many objects stay for good: the garbage collector need not look at them ever again.
    gc.freeze()
    try:
        return numba.njit(entry, cache=True, **_OPTIONS)
    except RuntimeError:  # there is no place to keep it
        return numba.njit(entry, **_OPTIONS)
