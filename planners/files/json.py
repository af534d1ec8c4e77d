"""The format JSON: one key per line, numbers with the digits that reproduce them exactly."""

from __future__ import annotations

import json

from optik.file_io import decode_text, parse_json
from planners.files.base import Format, from_plain, to_plain
from planners.motion import Motion


class Json(Format):
    """Strict JSON (no NaN, no Infinity), for people and other programs."""

    def to_bytes(self, motion: Motion) -> bytes:
        """Write a motion as `Format.to_bytes`."""
        lines = (f'"{key}": {json.dumps(value, allow_nan=False)}' for key, value in to_plain(motion).items())
        return ("{\n" + ",\n".join(lines) + "\n}\n").encode()

    def from_bytes(self, content: bytes) -> Motion:
        """Read a motion as `Format.from_bytes`."""
        return from_plain(parse_json(decode_text(content), "content"))


METHOD = Json
