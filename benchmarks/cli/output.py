"""Where the command line writes: what nobody reads is let go, what cannot be written is an error of ours."""

from __future__ import annotations

import io
import os
import sys
from typing import Any

from optik.errors import OutputError


class _Standard(io.FileIO):
    """The standard output at its lowest level, where everything that is printed comes through."""

    def write(self, data: Any) -> int:
        """Write bytes; after a failure nothing more is tried, so that the end of the process does not fail again."""
        try:
            return super().write(data) or 0
        except OSError as error:
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), self.fileno())
            if isinstance(error, BrokenPipeError):  # the reader has what it wanted: `optik robots | head -1`
                return len(data)
            raise OutputError("standard output", error.strerror or str(error)) from None


def guard_output() -> None:
    """Have the standard output end quietly where its reader has gone, and by name where it cannot be written.

    What its encoding does not have (degrees, the lines of tables, in plain ASCII) is printed as a question mark.
    """
    out = sys.stdout
    if type(out) is not io.TextIOWrapper:
        return  # a program that took it over, as tests do
    out.flush()
    if isinstance(sys.stderr, io.TextIOWrapper):
        sys.stderr.reconfigure(errors="replace")
    raw, buffered = _Standard(out.fileno(), "w", closefd=False), isinstance(out.buffer, io.BufferedWriter)
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(raw) if buffered else raw, encoding=out.encoding, errors="replace",
        line_buffering=out.line_buffering, write_through=not buffered,
    )  # fmt: skip
