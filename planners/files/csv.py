"""The format CSV: the keys of the JSON format as comment lines, then a table of t, q, q̇, q̈ at the knots."""

from __future__ import annotations

import csv
import io
import json

import numpy as np

from optik.arm.motors import maker_joints, maker_names
from optik.check import check_number
from optik.errors import InvalidInput
from optik.file_io import decode_text, parse_json
from optik.types import Array
from planners.files.base import Format, from_plain, to_plain
from planners.motion import Motion

MOST_TABLE_ROWS = 1_000_000
"""Largest number of rows of a table with a rate."""


class Csv(Format):
    """A table for spreadsheets; the comment lines contain the motion as polynomials.

    Parameters
    ----------
    rate : float, optional
        Points per second in the table [1/s], the last one at the end of the motion; by default points at the knots.
    """

    def __init__(self, *, rate: float | None = None) -> None:
        self._rate = rate if rate is None else check_number(rate, "rate", "points per second, above 0", above=0.0)

    def to_bytes(self, motion: Motion) -> bytes:
        """Write a motion as `Format.to_bytes`."""
        columns, rows = _table(motion, self._rate)
        out = io.StringIO()
        rate = {} if self._rate is None else {"rate": self._rate}
        for key, value in (to_plain(motion) | rate).items():
            out.write(f"# {key}: {json.dumps(value, allow_nan=False)}\n")
        returns = any("\r" in name for name in columns)  # a row would end there; the writer quotes only its own ending
        csv.writer(out, lineterminator="\n", quoting=csv.QUOTE_ALL if returns else csv.QUOTE_MINIMAL).writerow(columns)
        csv.writer(out, lineterminator="\n").writerows(rows.tolist())
        return out.getvalue().encode(errors="surrogatepass")

    def from_bytes(self, content: bytes) -> Motion:
        """Read a motion as `Format.from_bytes`; the table must match the motion of the comment lines."""
        lines = decode_text(content).split("\n")
        ours = "# " if lines[0].startswith("# format: ") else "# format: "  # comments of another program are no keys
        count = next((i for i, line in enumerate(lines) if not line.startswith(ours)), len(lines))
        data = {}
        for line in lines[:count]:
            key, colon, value = line[2:].partition(": ")
            if not colon:
                raise InvalidInput("header", repr(line[:60]), "comment lines '# KEY: JSON'")
            data[key] = parse_json(value, key)
        rate = data.pop("rate", None)
        if rate is not None:
            check_number(rate, "rate", "points per second, above 0", above=0.0)
        motion = from_plain(data)
        try:
            rows = [row for row in csv.reader(io.StringIO("\n".join(lines[count:]), newline="")) if row]
        except csv.Error as error:
            raise InvalidInput("table", str(error), "comma-separated values") from None
        _check_table(rows, motion, rate)
        return motion


def _table(motion: Motion, rate: float | None) -> tuple[list[str], Array]:
    """Return the names of the columns, and rows (m + 1, 1 + 3n) of t, q, q̇, q̈ at the knots, or at a rate."""
    t = motion.trajectory.knots
    if rate is not None:
        count = np.ceil((t[-1] - t[0]) * rate - 1e-9)
        if count >= MOST_TABLE_ROWS:
            raise InvalidInput("rate", f"{rate:g}, which is {count:.3g} points", f"at most {MOST_TABLE_ROWS} points")
        t = np.append(t[0] + np.arange(count) / rate, t[-1])
    columns = ["t", *(f"{kind}_{name}" for kind in ("q", "dq", "ddq") for name in maker_names(motion.robot))]
    states = (maker_joints(motion.robot, motion.trajectory(t, order), order) for order in range(3))
    return columns, np.hstack([t[:, None], *states])


def _check_table(rows: list[list[str]], motion: Motion, rate: float | None) -> None:
    """Raise InvalidInput unless the table shows the polynomials of the header to nine digits."""
    columns, expected = _table(motion, rate)
    if not rows or rows[0] != columns:
        raise InvalidInput("table", repr(rows[0] if rows else [])[:80], f"the columns {', '.join(columns)}"[:200])
    if len(rows) != len(expected) + 1:
        raise InvalidInput(
            "table", f"{len(rows) - 1} rows", f"{len(expected)}, one a {'knot' if rate is None else 'point'}"
        )
    scale = 1e-9 * np.maximum(np.abs(expected).max(axis=0), 1e-9)
    for i, (row, wanted) in enumerate(zip(rows[1:], expected, strict=True)):
        try:
            with np.errstate(invalid="ignore", over="ignore"):
                off = np.abs(np.array([float(x) for x in row]) - wanted) / scale
        except ValueError:  # an entry that is no number, or another number of entries
            raise InvalidInput(f"table, row {i}", repr(row)[:80], f"{len(columns)} numbers") from None
        if not (off <= 1.0).all():
            k = int(np.argmax(~(off <= 1.0)))
            raise InvalidInput(
                f"table, row {i}, {columns[k]}", row[k][:40], f"{wanted[k]!r}, as the header's polynomial"
            )


METHOD = Csv
