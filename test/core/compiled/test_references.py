"""Kernels that count no references of arrays: none is lost, and none is kept for ever."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import re
import sys
import types
from typing import Any, get_type_hints

import numpy as np
import pytest

from octo_arm_model import Loads, Solver, Uncertainty, load_config
from octo_arm_model.config.paper_data import FETCHING_IN_SPACE
from octo_arm_model.config.presets import preset_path
from octo_arm_model.core.compiled import kernel_compiler, numba_build
from octo_arm_model.core.compiled.kernel_compiler import _MADE
from octo_arm_model.core.compiled.loaded.rod_kernels import Outcome
from octo_arm_model.core.compiled.numerics.references import BORROWING

numba = pytest.importorskip('numba')


@functools.cache
def kernels() -> list[types.FunctionType]:
    """All kernels, those that other kernels call as well."""
    names = {name for made in numba_build.KERNELS.values() for name in modules(made)}
    found = (x for name in sorted(names) for x in vars(sys.modules[name]).values())
    return [x for x in found if isinstance(x, types.FunctionType) and '.compiled.' in x.__module__]


def modules(made: Any) -> list[str]:
    return kernel_compiler.modules_of(made.__wrapped__.args[0])


def returned(kernel: types.FunctionType) -> set[str]:
    return set(re.findall(r'\w+', kernel.__annotations__['return']))


def test_what_borrows_neither_returns_nor_receives_arrays() -> None:
    """A returned array would be freed too early, a received one never."""
    scalars = {'None', 'bool', 'int', 'float', 'tuple', 'Three', 'Outcome'}
    assert set(get_type_hints(Outcome).values()) <= {bool, int, float}
    borrowing = [kernel for kernel in kernels() if kernel in BORROWING]
    assert len(borrowing) > 50
    for kernel in borrowing:
        scope = vars(sys.modules[kernel.__module__])
        called = [scope.get(name) for name in kernel.__code__.co_names]
        own = [x for x in called if x in kernels()]
        for one in (kernel, *own):
            assert returned(one) <= scalars, (kernel.__name__, one.__name__)


def test_references_are_counted_in_all_kernels_but_those() -> None:
    numba_build.find_shapes()
    made = {kernel: machine.targetoptions['_nrt'] for kernel, machine in _MADE.items()}
    assert made == {kernel: kernel not in BORROWING for kernel in made}
    assert set(made.values()) == {True, False}


def doubled(row: Any) -> float:
    """Twice an element, by an array that the kernel makes itself."""
    twice = 2.0 * row
    return float(twice[0])


def test_what_borrows_and_makes_an_array_is_refused() -> None:
    machine = numba.njit(doubled, _nrt=False)
    with pytest.raises(numba.core.errors.NumbaError, match='NRT required but not enabled'):
        machine(np.ones(2))


def test_solves_free_all_that_they_allocate() -> None:
    statistics = importlib.import_module('numba.core.runtime').rtsys
    importlib.import_module('numba.core.runtime._nrt_python').memsys_enable_stats()
    arm = load_config(preset_path('renda2012_table4')).arm.with_density(1080.0)
    rough = dataclasses.replace(arm, friction=(0.2,))
    weight = Loads(gravity=(0.0, 0.0, -9.81))
    solvers = [Solver(one, 'exact', 21, loads=weight, compiled=True) for one in (arm, rough)]
    tensions = np.array(FETCHING_IN_SPACE)

    def work() -> None:
        for solver in solvers:
            found = solver.follow(1.01 * tensions, solver.solve(tensions))
            solver.sensitivity(found)
            solver.tip_covariance(found, Uncertainty(tension=0.1))

    work()
    before = statistics.get_allocation_stats()
    for _ in range(3):
        work()
    after = statistics.get_allocation_stats()
    assert after.alloc > before.alloc
    assert after.alloc - before.alloc == after.free - before.free
