"""What the C library does with memory that is freed."""

from __future__ import annotations

import functools

import numpy as np


@functools.cache
def keep_freed_memory() -> None:
    """Let the C library keep what is freed, once and for all.

    Arrays of a batch are just large enough that glibc gives each of them back to the system, and
    to get the next one page by page costs as much as the arithmetic. Having seen one larger
    array freed, it keeps what is smaller.
    """
    np.empty(24 * 2**20, np.uint8)
