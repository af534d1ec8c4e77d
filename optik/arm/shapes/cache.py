"""Cache of enclosures and of their contacts in the user's cache folder, by the content from which they are computed.

A file is named by the SHA-256 of that content and of the code that encloses. It holds the capsules as numbers behind
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

from optik.arm.shapes.enclosure import Capsule, Hull
from optik.errors import OutputError
from optik.file_io import write_atomically
from optik.types import Array, content

MOST_FILES = 2000
"""Most cached enclosures, of some kilobytes each: beyond it, the older half is deleted."""
CODE = ("cache.py", "contact.py", "enclosure.py", "hulls.py", "urdf.py")
"""Files whose change makes cached enclosures invalid."""
SHA256_BYTES = 32
"""Length of a SHA-256."""
CAPSULE, HULL = 9, 3
"""Numbers of a capsule: ends, radius, excess and number of hulls. Of a hull, before its corners: their number, radius,
excess."""


def enclose_once(enclose: Callable[[], list[Capsule]], *source: Any) -> list[Capsule]:
    """Return the capsules that a function computes from arrays, texts and bytes, from the cache if they are there."""
    x, found = compute_once(lambda: _to_numbers(enclose()), *source), list[Capsule]()
    while len(x):
        (*_, radius, excess, count), a, b, x, hulls = x[:CAPSULE].tolist(), x[:3], x[3:6], x[CAPSULE:], list[Hull]()
        for _ in range(int(count)):
            corners, *sizes = x[:HULL].tolist()
            end = HULL + 3 * int(corners)
            hulls.append(Hull(x[HULL:end].reshape(-1, 3), *sizes))
            x = x[end:]
        found.append(Capsule(a, b, radius, excess, tuple(hulls)))
    return found


def _to_numbers(found: list[Capsule]) -> Array:
    """Return capsules as numbers."""
    parts = [
        [*c.a, *c.b, c.radius, c.excess, len(c.hulls)]
        + [x for hull in c.hulls for x in (len(hull.corners), hull.radius, hull.excess, *hull.corners.ravel())]
        for c in found
    ]
    return np.concatenate(parts)


def compute_once(compute: Callable[[], Array], *source: Any) -> Array:
    """Return the numbers that a function computes from arrays, texts and bytes, from the cache if they are there."""
    folder = _find_folder()
    if folder is None:
        return compute()
    parts = [hashlib.sha256(part).digest() if isinstance(part, bytes) else part for part in source]
    file = folder / hashlib.sha256(_digest_code() + repr(content(parts)).encode()).hexdigest()
    found = _read(file)
    if found is None:
        found = compute()
        _write(file, found)
    return found


def _read(file: Path) -> Array | None:
    """Read the numbers in a file; None if it is missing or damaged."""
    try:
        data = file.read_bytes()
    except OSError:
        return None
    rows = data[SHA256_BYTES:]
    if not rows or len(rows) % 8 or hashlib.sha256(rows).digest() != data[:SHA256_BYTES]:
        return None
    return np.frombuffer(rows)


def _write(file: Path, rows: Array) -> None:
    """Write numbers to a file, and delete the older half of the files if there are too many; a full disk is no error."""
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
