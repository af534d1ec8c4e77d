"""Standard output of the command line: a closed pipe ends it quietly, any other failure is an OutputError."""

from __future__ import annotations

import io
import os
import sys
from typing import Any

from optik.errors import OutputError


class _Standard(io.FileIO):
    """Raw standard output."""

    def write(self, data: Any) -> int:
        """Write bytes; after a failure, discard all later output, so that the end of the process does not fail again."""
        try:
            return super().write(data) or 0
        except OSError as error:
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), self.fileno())
            if isinstance(error, BrokenPipeError):  # a closed pipe: `optik robots | head -1`
                return len(data)
            raise OutputError("standard output", error.strerror or str(error)) from None


def guard_output() -> None:
    """Let standard output end quietly when its pipe is closed, and raise an OutputError when it cannot be written.

    Characters that its encoding lacks, such as ° and table lines in ASCII, become question marks.
    """
    out = sys.stdout
    if type(out) is not io.TextIOWrapper:
        return  # replaced by another program, such as a test
    out.flush()
    if isinstance(sys.stderr, io.TextIOWrapper):
        sys.stderr.reconfigure(errors="replace")
    raw, buffered = _Standard(out.fileno(), "w", closefd=False), isinstance(out.buffer, io.BufferedWriter)
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(raw) if buffered else raw, encoding=out.encoding, errors="replace",
        line_buffering=out.line_buffering, write_through=not buffered,
    )  # fmt: skip
