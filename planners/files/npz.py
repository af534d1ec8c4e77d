"""The format NPZ of NumPy: arrays ``knots`` and ``coefficients``; other data as JSON in ``header``; nothing is pickled."""

from __future__ import annotations

import io
import json
import math
import zipfile
from typing import Any

import numpy as np

from optik.errors import InvalidInput
from optik.file_io import parse_json
from planners.files.base import Format, Parts, from_parts, to_parts
from planners.motion import Motion

UNPACKED = 2**29
"""Most bytes of the unpacked arrays of an NPZ file: ten times those of the longest setpoint list of 7 joints.
A zip archive of some megabytes can unpack to gigabytes of zeros."""


class Npz(Format):
    """Arrays in binary: the smallest and fastest of the formats."""

    def to_bytes(self, motion: Motion) -> bytes:
        """Write a motion as `Format.to_bytes`."""
        out, parts = io.BytesIO(), to_parts(motion)
        header = json.dumps(parts.header | {"sha256": parts.digest}, allow_nan=False)
        np.savez(out, header=np.array(header), knots=parts.knots, coefficients=parts.coefficients)
        return out.getvalue()

    def from_bytes(self, content: bytes) -> Motion:
        """Read a motion as `Format.from_bytes`."""
        try:
            header, knots, coefficients = _read_arrays(content, ("header", "knots", "coefficients"))
        except InvalidInput:
            raise
        except Exception as error:  # zipfile and NumPy raise a dozen types on invalid bytes
            raise InvalidInput(
                "content", f"{type(error).__name__}: {str(error)[:120]}", "a complete NPZ file"
            ) from None
        for name, array, kind in (("header", header, "U"), ("knots", knots, "f"), ("coefficients", coefficients, "f")):
            if array.dtype.kind != kind or (kind == "f" and array.dtype.itemsize != 8):
                raise InvalidInput(name, f"an array of {array.dtype}", "JSON text" if kind == "U" else "float64")
        data = parse_json(str(header), "header")
        if not isinstance(data, dict):
            raise InvalidInput("header", repr(data)[:60], "a mapping")
        digest = data.pop("sha256", None)
        return from_parts(Parts(data, knots, coefficients), digest)


def _read_arrays(content: bytes, names: tuple[str, ...]) -> list[Any]:
    """Return arrays of an NPZ file, after checking their sizes before they are unpacked."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [archive.getinfo(f"{name}.npy") for name in names]
        size = sum(member.file_size for member in members)
        if size > UNPACKED:
            raise InvalidInput("content", f"arrays of {size / 2**20:.0f} MB", f"at most {UNPACKED // 2**20} MB")
        found = []
        for member in members:
            packed = io.BytesIO(archive.read(member))
            version = np.lib.format.read_magic(packed)
            read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
            shape, _, dtype = read(packed)
            claimed, held = math.prod(shape) * dtype.itemsize, member.file_size - packed.tell()
            if claimed != held:
                raise InvalidInput(member.filename, f"{held} bytes for an array of {claimed}", "a complete array")
            packed.seek(0)
            found.append(np.lib.format.read_array(packed, allow_pickle=False))
    return found


METHOD = Npz
