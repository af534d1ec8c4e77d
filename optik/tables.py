"""Tables of numbers as other programs write them: any separator, decimal commas, units in the header, or no header.

A table is text in UTF-8. Empty lines and lines that begin with # are skipped. All lines have the separator of the first
one. Ambiguous values are refused. Assumptions are listed in the notes and in an `AssumptionWarning`.
"""

from __future__ import annotations

import csv
import io
import os
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from math import isfinite, nan, pi
from pathlib import Path
from typing import NamedTuple

import numpy as np

from optik.check import check_kind, check_words
from optik.errors import AssumptionWarning, InvalidInput
from optik.file_io import decode_text, read_bytes
from optik.types import Array

MOST_TABLE_BYTES = 64 * 2**20
"""Largest file of a table [bytes]."""
LONGEST_LINE, MOST_ROWS, MOST_COLUMNS = 2**16, 1_000_000, 1000
"""Longest line [characters], and most rows and columns."""
SEPARATORS = {";": "semicolons", "\t": "tabs", ",": "commas", " ": "spaces"}
"""Separators of cells, in the order in which the first line is searched for them."""
DECIMAL = re.compile(r"[-+]?(?:\d+(?:\.\d*|,\d+)?|\.\d+)(?:[eE][-+]?\d+)?", re.ASCII)
"""A number, with a decimal point or a decimal comma."""
UNIT_SIZES = (
    {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254},
    {"rad": 1.0, "deg": pi / 180.0, "°": pi / 180.0},
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
)
"""Units of lengths, angles and times, in SI units."""
SPELLINGS = {"radians": "rad", "degrees": "deg", "°": "deg", "sec": "s", "secs": "s", "seconds": "s", "msec": "ms", "µs": "us",
             "nsec": "ns", "nsecs": "ns", "nanosec": "ns", "nanosecs": "ns"}  # fmt: skip
"""Other spellings of units."""
UNITS, PER = "|".join((*SPELLINGS, *chain(*UNIT_SIZES))), r"(?:(?:/|_|_per_)s(?:\^?2|²)?)?"
"""Regular expressions of units, and of "per second" or "per second squared" after them."""
UNIT_END = re.compile(rf"(?:^|[\W_])((?:{UNITS}){PER})[\])\s]*$", re.IGNORECASE)
"""The unit at the end of a header: x_mm, x [mm], dq [deg/s], header.stamp.nanosec."""
Names = str | Iterable[str] | None
"""Names: a list, text with commas, or none."""


NO_HEADER = "columns='x,y,z,…' names the columns of a file without a header"
"""Advice for a header of numbers."""


class TableColumn(NamedTuple):
    """A column: its index, its unit in the header or an empty string, and the size of its unit in SI units."""

    at: int
    unit: str = ""
    size: float = 1.0


class TextTable(NamedTuple):
    """A table: its file, the line of its header, its separator and columns, numbered lines of cells, and assumptions."""

    file: str
    header: int
    separator: str
    columns: dict[str, TableColumn]
    lines: list[tuple[int, list[str]]]
    notes: list[str]

    def locate(self, row: int | None = None, *columns: str) -> str:
        """Return the place of a row, or of the header, for errors."""
        line = f"{self.file}, line {self.header if row is None else self.lines[row][0]}"
        return f"{line}, column{'s' * (len(columns) > 1)} {','.join(columns)}" if columns else line

    def read_cells(self, row: int, names: Iterable[str]) -> list[str]:
        """Return the cells of a row in some columns."""
        cells = self.lines[row][1]
        return [cells[self.columns[name].at] for name in names]

    def read_numbers(self, names: Sequence[str]) -> Array:
        """Return the finite numbers of some columns (k, m), in SI units."""
        bare = [name for name in names if not self.columns[name].unit]
        if 0 < len(bare) < len(names):
            expected = f"a unit for each of {','.join(names)}, or for none"
            raise InvalidInput(self.locate(None, *bare), "no unit", expected)
        cells = [self.read_cells(row, names) for row in range(len(self.lines))]
        values = np.array([[read_cell(cell) for cell in row] for row in cells]).reshape(len(cells), len(names))
        for row, j in np.argwhere(~np.isfinite(values))[:1]:
            raise InvalidInput(self.locate(row, names[j]), repr(cells[row][j])[:60], "a finite number")
        return np.asarray(values * [self.columns[name].size for name in names])

    def resolve(self, wanted: Mapping[str, str]) -> TextTable:
        """Return the table with wanted columns named without units; a unit in the header replaces the wanted unit."""
        columns: dict[str, TableColumn] = {}
        for whole, column in self.columns.items():
            name, unit = split_unit(whole)
            for each, own in ((whole, ""), (whole.lower(), ""), (name, unit), (name.lower(), unit)):
                size = find_size(own, wanted[each]) if each in wanted else None
                if size is not None:
                    whole, column = each, TableColumn(column.at, own, size)
                    break
            if columns.setdefault(whole, column) is not column:
                raise InvalidInput(self.locate(), f"the column {whole!r} twice", "each column once")
        return self._replace(columns=columns)

    def refuse_others(self, known: Iterable[str], expected: str) -> None:
        """Raise InvalidInput for columns that are not known."""
        if others := [name for name in self.columns if name not in known]:
            raise self.make_header_error(expected, f"ignore={','.join(others)!r} leaves columns out")

    def make_header_error(self, expected: str, advice: str = "", names: Sequence[str] = ()) -> InvalidInput:
        """Return an error about the columns."""
        names = names or list(self.columns)
        advice = NO_HEADER if any(isfinite(read_cell(name)) for name in names) else advice
        return InvalidInput(self.locate(), repr(",".join(names))[:40], expected, advice=advice)

    def select_rows(self, rows: Iterable[int]) -> TextTable:
        """Return some rows."""
        return self._replace(lines=[self.lines[i] for i in rows])


def read_table(file: str | os.PathLike[str], columns: Names = None, ignore: Names = None) -> TextTable:
    """Read a table; `columns` names the columns of a file without a header, or renames them; `ignore` leaves some out."""
    check_kind(file, "file", str | os.PathLike, "the path of a CSV file")
    name, left, lines = str(file), read_names(ignore, "ignore"), list[tuple[int, str]]()
    text = decode_text(read_bytes(Path(file), most=MOST_TABLE_BYTES), name).removeprefix("\ufeff")
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        if not line.strip(' \t\n,;"') or line.lstrip().startswith("#"):
            continue
        if len(line) > LONGEST_LINE or len(lines) > MOST_ROWS:
            expected = f"lines of at most {LONGEST_LINE} characters, and at most {MOST_ROWS:,} rows"
            raise InvalidInput(f"{name}, line {number}", "more", expected)
        lines.append((number, line.rstrip("\n")))
    if not lines:
        raise InvalidInput(name, "no lines", "a header line that names the columns, and rows")
    number, first = lines[0]
    try:
        table, with_data = _read_header(TextTable(name, number, ",", {}, [], []), first, read_names(columns, "columns"))
        width, marks = len(table.columns), set[str]()
        for word in left:
            if table.columns.pop(word, None) is None:
                raise InvalidInput("ignore", repr(word)[:60], f"columns of {name}: {', '.join(table.columns)}"[:160])
        for number, line in lines if with_data else lines[1:]:
            cells = _split(line, table.separator)
            if len(cells) != width and (len(cells) != width + 1 or cells[-1]):  # a separator may end a line
                expected = f"{width} values, one for each column, separated by {SEPARATORS[table.separator]}"
                advice = "with decimal commas, use another separator" if table.separator == "," else ""
                raise InvalidInput(f"{name}, line {number}", f"{len(cells)} values", expected, advice=advice)
            table.lines.append((number, cells))
            if table.separator == "," and '"' not in line:  # no cell has a comma
                continue
            for cell in (cells[column.at] for column in table.columns.values()):
                if ("," in cell or ("." in cell and "." not in marks)) and DECIMAL.fullmatch(cell):
                    marks.add("," if "," in cell else ".")
                    if "," in marks and (len(marks) > 1 or table.separator == ","):
                        expected = "one decimal mark: a point, or a comma in a table that has another separator"
                        raise InvalidInput(f"{name}, line {number}", repr(cell), expected)
    except csv.Error as error:
        raise InvalidInput(f"{name}, line {number}", str(error), "cells with separators and closed quotes") from None
    table.notes.extend(["decimal commas"] * ("," in marks))
    return table


def _read_header(table: TextTable, first: str, given: tuple[str, ...]) -> tuple[TextTable, bool]:
    """Return the table with the separator and the columns of its first line, and whether that line has data."""
    first = first.strip(" ")
    fitting = [each for each in SEPARATORS if given and _holds_numbers(_split(first, each), len(given))]
    separator = next((each for each in (*fitting, *SEPARATORS) if each in first), ",")
    cells = _split(first, separator)
    cells = cells if cells[-1] else cells[:-1]  # a separator may end the line
    data = [isfinite(read_cell(cell)) or cell.lower() in ("nan", "inf") for cell in cells]
    if given and not any(data):
        table.notes.append(f"the columns {','.join(cells)} are read as {','.join(given)}"[:200])
    names = given or cells
    columns = {name: TableColumn(at) for at, name in enumerate(names)}
    table = table._replace(separator=separator, columns=columns)
    if len(columns) < len(names) or len(names) > MOST_COLUMNS:
        raise table.make_header_error(f"different columns, at most {MOST_COLUMNS}", names=names)
    return table, bool(given) and any(data)


def _holds_numbers(cells: list[str], count: int) -> bool:
    """Return whether there are `count` cells of numbers or of text without digits; a separator may end the line."""
    numbers = all(isfinite(read_cell(cell)) or not re.search(r"\d", cell) for cell in cells)
    return len(cells) - (not cells[-1]) <= count <= len(cells) and numbers


def _split(line: str, separator: str) -> list[str]:
    """Return the cells of a line."""
    if separator == " ":
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))]


def read_cell(cell: str) -> float:
    """Return a number with a decimal point or comma, or NaN."""
    if "," in cell or "_" in cell or not cell.isascii():  # Python reads more than tables mean
        return float(cell.replace(",", ".")) if DECIMAL.fullmatch(cell) else nan
    try:
        return float(cell)
    except ValueError:
        return nan


def split_unit(header: str) -> tuple[str, str]:
    """Return the name in a header without its unit, and the unit, such as deg/s, or an empty text."""
    found = UNIT_END.search(header)
    if found is None:
        return header, ""
    own, _, over = found[1].lower().replace("_per_", "/").replace("_", "/").partition("/")
    return header[: found.start()].rstrip(" [("), SPELLINGS.get(own, own) + f"/{over}" * bool(over)


def find_size(unit: str, usual: str) -> float | None:
    """Return the size of a unit, by default the usual one, in SI units; None for a unit of another quantity."""
    (own, _, over), (base, _, per) = (unit or usual).partition("/"), usual.partition("/")
    known = next((sizes for sizes in UNIT_SIZES if base in sizes), {"": 1.0})
    return known.get(own) if over.replace("^", "").replace("²", "2") in ("", per) else None


def read_names(value: Names, argument: str) -> tuple[str, ...]:
    """Return names from a list, or from text with commas."""
    if isinstance(value, str):
        value = [name.strip() for name in value.split(",")]
    return check_words(() if value is None else value, argument)


def warn_of_assumptions(file: str | os.PathLike[str], notes: Iterable[str], stacklevel: int = 3) -> tuple[str, ...]:
    """Warn of assumptions made while reading a file, and return them."""
    if told := tuple(notes):
        warnings.warn(f"{file}: {'; '.join(told)}", AssumptionWarning, stacklevel=stacklevel)
    return told
