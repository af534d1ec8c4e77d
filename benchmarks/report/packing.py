"""Data inside the page: numbers as 32-bit floats and the remaining data as JSON, compressed to text for the browser."""

from __future__ import annotations

import base64
import gzip
import json
import math
import struct
from typing import Any

import numpy as np

LEAST_PACKED = 50
"""Lists of at least this many numbers are stored as floats; shorter ones stay in the JSON, where they cost less."""

LEAST_FLOAT, MOST_FLOAT = 1e-37, 1e38
"""Magnitudes that a 32-bit float represents with all shown digits."""

WHOLE_DIGITS = 2**24
"""Whole numbers up to this are exact as 32-bit floats."""

PACKED = "f32"
"""Key of the reference that replaces a list in the JSON: the offset of its floats, and its shape."""


def pack(data: Any) -> str:
    """Compress data for the page; the script `page.js` and `unpack` read it."""
    floats = _Floats()
    words = json.dumps(floats.taken_out(data), allow_nan=False, ensure_ascii=False, separators=(",", ":")).encode()
    words += b" " * (-len(words) % 4)  # so that the floats are aligned
    return squeeze(struct.pack("<I", len(words)) + words + floats.joined())


def squeeze(content: bytes) -> str:
    """Compress bytes to text; the result is reproducible."""
    return base64.b64encode(gzip.compress(content, compresslevel=9, mtime=0)).decode()


def unpack(text: str) -> Any:
    """Read the output of `pack`."""
    content = gzip.decompress(base64.b64decode(text))
    (length,) = struct.unpack_from("<I", content)
    numbers = np.frombuffer(content, dtype="<f4", offset=4 + length)

    def put_back(data: dict[str, Any]) -> Any:
        if set(data) != {PACKED}:
            return data
        first, *shape = data[PACKED]
        found = [None if math.isnan(v) else v for v in numbers[first : first + math.prod(shape)].tolist()]
        if len(shape) == 1:
            return found
        return [found[k : k + shape[1]] for k in range(0, len(found), shape[1])]

    return json.loads(content[4 : 4 + length], object_hook=put_back)


class _Floats:
    """Numbers taken out of data; the same numbers are stored once."""

    def __init__(self) -> None:
        self.count = 0
        self.parts: list[bytes] = []
        self.places: dict[bytes, int] = {}

    def taken_out(self, data: Any) -> Any:
        """Return data with a reference in place of every long list of numbers."""
        if isinstance(data, dict):
            return {key: self.taken_out(value) for key, value in data.items()}
        if not isinstance(data, list | tuple):
            return data
        shape = _shape(data)
        if shape is None:
            return [self.taken_out(value) for value in data]
        flat = data if len(shape) == 1 else [v for row in data for v in row]
        numbers = np.array([math.nan if v is None else v for v in flat], dtype="<f4").tobytes()
        if numbers not in self.places:
            self.places[numbers] = self.count
            self.parts.append(numbers)
            self.count += len(flat)
        return {PACKED: [self.places[numbers], *shape]}

    def joined(self) -> bytes:
        """Return all numbers one after another."""
        return b"".join(self.parts)


def _shape(data: list[Any] | tuple[Any, ...]) -> tuple[int, ...] | None:
    """Return the shape of a list or a matrix that is stored as floats; None if it stays in the JSON."""
    if len(data) >= LEAST_PACKED and all(map(_fits, data)):
        return (len(data),)
    if not data or not all(isinstance(row, list) and row and len(row) == len(data[0]) for row in data):
        return None
    if len(data) * len(data[0]) < LEAST_PACKED or not all(_fits(v) for row in data for v in row):
        return None
    return (len(data), len(data[0]))


def _fits(value: Any) -> bool:
    """Return whether a 32-bit float represents a value of a list with all shown digits."""
    if value is None:
        return True
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= WHOLE_DIGITS
    return isinstance(value, float) and (value == 0.0 or LEAST_FLOAT < abs(value) < MOST_FLOAT)
