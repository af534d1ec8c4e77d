"""The array types that signatures name; shapes and units are said where an array is documented."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Real numbers in double precision."""
Flags: TypeAlias = NDArray[np.bool_]
"""One truth value each."""
Indices: TypeAlias = NDArray[np.int64]
"""Whole numbers: indices, counts or status codes."""
