"""Explicit fused multiply–add, x y + z rounded once, so that one lane and many lanes give the same result."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic


def _fma(typingctx: Any, x: Any, y: Any, z: Any) -> Any:
    """Return x y + z for float64: one instruction if the processor has it, else a slow call."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


fma: Any = intrinsic(_fma)
