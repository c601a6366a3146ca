"""The types of arrays and numbers in type hints."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
ComplexArray: TypeAlias = NDArray[np.complex128]
Vector: TypeAlias = tuple[float, float, float]
# A formula takes and returns numbers or arrays, real, or complex with derivatives as imaginary
# parts.
Number: TypeAlias = Any
Numbers: TypeAlias = tuple[Any, ...]
