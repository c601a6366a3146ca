"""Array types, in one place."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
ComplexArray: TypeAlias = NDArray[np.complex128]
# What a formula takes and gives: a number or an array of numbers, real or, where a derivative is
# its imaginary part, complex.
Number: TypeAlias = Any
