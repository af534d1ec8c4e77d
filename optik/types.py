"""Array types of signatures; each array's documentation gives shape and unit."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Real numbers in double precision."""
Flags: TypeAlias = NDArray[np.bool_]
"""Truth values."""
Indices: TypeAlias = NDArray[np.int64]
"""Integers: indices, counts or status codes."""
