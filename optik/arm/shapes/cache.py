"""Cache of enclosures in the user's cache folder, by the content from which they are computed.

A file is named by the SHA-256 of that content and of the code that encloses. It holds the capsules as rows of numbers behind
their SHA-256, which detects damage. A damaged file is replaced. Without a folder that can be written, nothing is cached.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from optik.arm.shapes.enclosure import Capsule
from optik.errors import OutputError
from optik.file_io import write_atomically
from optik.types import content

MOST_FILES = 2000
"""Most cached enclosures, of a few hundred bytes each: beyond it, the older half is deleted."""
CODE = ("cache.py", "enclosure.py", "meshes.py", "sweep.py")
"""Files whose change makes cached enclosures invalid."""
SHA256_BYTES = 32
"""Length of a SHA-256."""
ROW = 8
"""Numbers of a row: both ends, the radius, and the excess of a capsule."""


def enclose_once(enclose: Callable[[], list[Capsule]], *source: Any) -> list[Capsule]:
    """Return the capsules that a function computes from arrays, texts and bytes, from the cache if they are there."""
    folder = _find_folder()
    if folder is None:
        return enclose()
    parts = [hashlib.sha256(part).digest() if isinstance(part, bytes) else part for part in source]
    file = folder / hashlib.sha256(_digest_code() + repr(content(parts)).encode()).hexdigest()
    found = _read(file)
    if found is None:
        found = enclose()
        _write(file, np.array([[*c.a, *c.b, c.radius, c.excess] for c in found]))
    return found


def _read(file: Path) -> list[Capsule] | None:
    """Read the capsules in a file; None if it is missing or damaged."""
    try:
        data = file.read_bytes()
    except OSError:
        return None
    rows = data[SHA256_BYTES:]
    if not rows or len(rows) % (8 * ROW) or hashlib.sha256(rows).digest() != data[:SHA256_BYTES]:
        return None
    return [Capsule(row[:3], row[3:6], float(row[6]), float(row[7])) for row in np.frombuffer(rows).reshape(-1, ROW)]


def _write(file: Path, rows: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    """Write capsules to a file, and delete the older half of the files if there are too many; a full disk is no error."""
    data = rows.tobytes()
    with contextlib.suppress(OSError, OutputError):
        write_atomically(file, lambda part: part.write_bytes(hashlib.sha256(data).digest() + data))
        files = list(file.parent.iterdir())
        if len(files) > MOST_FILES:
            for old in sorted(files, key=lambda one: one.stat().st_mtime)[: len(files) // 2]:
                old.unlink(missing_ok=True)


def _find_folder() -> Path | None:
    """Return the folder of the enclosures in the user's cache, which is created; None if it cannot be."""
    from numba.misc.appdirs import AppDirs  # where Numba places its own cache

    folder = Path(AppDirs(appname="optik", appauthor=False).user_cache_dir) / "enclosures"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder


@cache
def _digest_code() -> bytes:
    """Return the SHA-256 of the code that encloses."""
    digest = hashlib.sha256()
    for name in CODE:
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.digest()
