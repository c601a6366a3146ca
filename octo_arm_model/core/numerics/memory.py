"""A setting of the C library's allocator."""

from __future__ import annotations

import functools

import numpy as np


@functools.cache
def keep_freed_memory() -> None:
    """Make glibc keep freed memory of up to 24 MB for the process instead of unmapping it.

    Glibc maps and unmaps every array above a threshold, which for the arrays of a batch takes as
    long as their arithmetic. Freeing a larger array raises the threshold to its size.
    """
    np.empty(24 * 2**20, np.uint8)
