"""A setting of the C library's allocator."""

from __future__ import annotations

import functools

import numpy as np


@functools.cache
def keep_freed_memory() -> None:
    """Make glibc keep freed memory of up to 24 MB for the process instead of unmapping it.

    It maps and unmaps each array above a threshold, and mapping an array of a batch page by page
    takes as long as its arithmetic. Freeing one larger array raises the threshold to its size.
    """
    np.empty(24 * 2**20, np.uint8)
