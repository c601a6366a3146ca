"""Floating-point errors: results are checked for what they leave."""

from __future__ import annotations

import numpy as np


def silenced() -> np.errstate:
    """Context in which NumPy does not warn of overflows, invalid values and divisions by zero."""
    return np.errstate(over='ignore', invalid='ignore', divide='ignore')
