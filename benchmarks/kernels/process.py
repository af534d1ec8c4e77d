"""Run one part in a separate process: ``python -m benchmarks.kernels.process PART`` prints each kernel that it compiles."""

from __future__ import annotations

import os
import sys
from typing import Any

from numba.core import event

from benchmarks.kernels.parts import WARM_UP, pages
from optik.compiled.kernel import Helper, Kernel


class Teller(event.Listener):  # type: ignore[misc]
    """Event listener of Numba that prints the name of each compiled kernel."""

    def __init__(self, out: Any) -> None:
        self._out = out

    def on_start(self, event: Any) -> None:
        """Do nothing, because the name of the kernel is not known yet."""

    def on_end(self, event: Any) -> None:
        """Print the kernel's name."""
        kernel = event.data["dispatcher"]
        if isinstance(kernel, Kernel) and not isinstance(kernel, Helper):
            print(f"{kernel.py_func.__module__}.{kernel.py_func.__name__}", file=self._out, flush=True)


def main(part: str) -> None:
    """Run a part, and discard its output."""
    with os.fdopen(os.dup(1), "w") as out, open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        with event.install_listener("numba:compile", Teller(out)):
            (WARM_UP | {"pages": pages})[part]()


if __name__ == "__main__":
    main(sys.argv[1])
