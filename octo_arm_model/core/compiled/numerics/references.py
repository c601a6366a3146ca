"""Marks of kernels by how they are handed arrays: uncounted, or not handed over at all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

_Kernel = TypeVar('_Kernel', bound=Callable[..., Any])
# The kernels that `borrows` and `inlined` mark.
BORROWING: set[Callable[..., Any]] = set()
INLINED: set[Callable[..., Any]] = set()


def borrows(kernel: _Kernel) -> _Kernel:
    """Mark a ``kernel`` that uses the arrays it is given and makes, receives and returns no other.

    By default numba counts a reference of every array that a kernel is given or takes from a
    tuple, which takes a large part of the time of a loaded arm. In a marked kernel it does not, as
    the caller holds these arrays. Such a kernel that makes an array, also by arithmetic of whole
    arrays or by assigning one to another, which copies it in case they overlap, is refused when it
    is compiled ("NRT required but not enabled").
    """
    BORROWING.add(kernel)
    return kernel


def inlined(kernel: _Kernel) -> _Kernel:
    """Mark a ``kernel`` that becomes part of each kernel that calls it.

    A call copies all that is given, eight numbers for each array of a tuple: hundreds for the
    tables of a rod, which take longer to copy than to use. For kernels called in few places.
    """
    INLINED.add(kernel)
    return kernel
