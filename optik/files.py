"""Files that are there whole or not at all: written under a temporary name beside the target, then renamed."""

from __future__ import annotations

import os
import uuid
from collections.abc import Callable
from pathlib import Path

from optik.errors import OutputError


def write_whole(path: str | os.PathLike[str], write: Callable[[Path], object]) -> None:
    """Write a file by a function that is given the temporary path.

    Raises
    ------
    OutputError
        The file cannot be written; nothing is left behind.
    """
    target = Path(path)
    if not target.name or "\0" in str(target):
        raise OutputError(target, "is no name that a file can have")
    part = target.parent / f".{uuid.uuid4().hex[:12]}.part"
    try:
        try:
            write(part)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(target, f"cannot be written ({error.strerror or error})") from None
