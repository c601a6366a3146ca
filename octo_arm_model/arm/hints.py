"""Types of arrays and numbers."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
ComplexArray: TypeAlias = NDArray[np.complex128]
Vector: TypeAlias = tuple[float, float, float]
# Argument and result of a formula: a number or an array, real, or complex where the imaginary
# part is a derivative.
Number: TypeAlias = Any
Numbers: TypeAlias = tuple[Any, ...]
