"""A file format in one file: a line per key, the key and its JSON with a tab between them.

Try it: ``optik plan line --out line.tsv --format examples/plugins/tsv.py``.
"""

from __future__ import annotations

import json

from optik.errors import InvalidInput
from planners.files.base import Format, from_plain, to_plain


class Tsv(Format):
    """Text in UTF-8, easy to read by a table program."""

    def to_bytes(self, motion):
        """Return the content of a file."""
        return "".join(f"{key}\t{json.dumps(value)}\n" for key, value in to_plain(motion).items()).encode()

    def from_bytes(self, content):
        """Return the motion. Damaged content raises InvalidInput, here or in `from_plain`."""
        try:
            lines = [line.partition("\t") for line in content.decode().splitlines()]
            return from_plain({key: json.loads(value) for key, _, value in lines})
        except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
            raise InvalidInput("content", str(error)[:120], "lines of a key, a tab and JSON") from None


METHOD = Tsv
