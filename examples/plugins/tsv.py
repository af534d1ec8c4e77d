"""A file format in one file: a line per key, the key and its JSON with a tab between them.

Try it: ``optik plan line --out line.tsv --format examples/plugins/tsv.py``.
"""

from __future__ import annotations

import json

from optik.file_io import decode_text, parse_json
from planners.files.base import Format, from_plain, to_plain


class Tsv(Format):
    """Text in UTF-8, easy to read by a table program."""

    def to_bytes(self, motion):
        """Return the content of a file."""
        return "".join(f"{key}\t{json.dumps(value)}\n" for key, value in to_plain(motion).items()).encode()

    def from_bytes(self, content):
        """Return the motion. Damaged content raises InvalidInput, in each of these functions."""
        lines = [line.partition("\t") for line in decode_text(content).splitlines()]
        return from_plain({key: parse_json(value, key[:60]) for key, _, value in lines})


METHOD = Tsv
