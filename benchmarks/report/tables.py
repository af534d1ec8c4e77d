"""Tables of the report: numbers and names for people, cells for the page, and tables as CSV, Markdown and LaTeX."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import polars as pl

from benchmarks.blocks.block import Cell as Cell
from benchmarks.blocks.block import Column as Column
from benchmarks.blocks.contest import version_words
from benchmarks.records import slug
from benchmarks.report.boards import noise_floor

# ---------------- numbers and names for people


UNWRITTEN_EXCESS = 5e-13
"""Excess over a limit [1] that is not shown: it is the rounding of the polynomials' extrema."""

LEAST_P = 1e-6
"""p-values below it [1] are written as an upper bound."""

_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
"""Digits and the minus sign, superscript."""


def number(value: float | None, digits: int = 3) -> str:
    """Format a number: 0.00123, 88.4, 12,345, 1.2·10⁻⁷, ∞, – for NaN and None."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    mantissa, exponent = f"{abs(value):.{digits - 1}e}".split("e")
    power = int(exponent)
    sign = "−" if value < 0 else ""
    if -4 < power < 7:
        return f"{sign}{float(f'{mantissa}e{power}'):,.{max(digits - 1 - power, 0)}f}"
    return f"{sign}{mantissa}·10{str(power).translate(_RAISED)}"


def ratio(value: float) -> str:
    """Format the ratio of a value to its limit; above 1 with enough digits to show it, unless it is rounding."""
    off = value - 1.0
    if UNWRITTEN_EXCESS < off < 5e-4:
        return f"{value:.{1 - math.floor(math.log10(off))}f}"
    return number(value)


def p_value(p: float) -> str:
    """Format a p-value; below 10⁻⁶ only as a bound, because smaller values depend on the test's assumptions."""
    return f"< {number(LEAST_P, 1).replace('1·', '')}" if p < LEAST_P else number(p, 2)


def percent(share: float, digits: int = 1) -> str:
    """Format a rate given in percent."""
    return "–" if math.isnan(share) else f"{share:.{digits}f} %"


def quote_label(label: str) -> str:
    """Return a label for a list: in quotation marks if it contains a comma or a semicolon."""
    return f"“{label}”" if set(label) & set(",;") else label


def listed(labels: Iterable[str]) -> str:
    """Return the labels in a sentence, with commas between them."""
    return ", ".join(map(quote_label, labels))


# ---------------- tables of the report


LEAST_DIGITS, MOST_DIGITS = 2, 4
"""Significant digits of a value with an interval."""

DECIMALS_OF_SHARES = 3
"""Most decimals of a percentage."""


LOOKS = {"met": "good", "missed (a goal)": "partly", "missed": "bad"}
"""Look of each verdict of a target on the page, by its first words."""


@dataclass(frozen=True)
class Table:
    """A table, as the page shows it and as it is written as CSV, Markdown and LaTeX: `id` names its files."""

    id: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Mapping[str, Cell], ...]
    note: str = ""

    @property
    def aside(self) -> bool:
        """Whether some columns are shown only on request."""
        return any(column.aside for column in self.columns)

    @property
    def printed(self) -> Table:
        """The table without the columns shown only on request."""
        return replace(self, columns=tuple(column for column in self.columns if not column.aside))

    def only(self, keys: Sequence[str]) -> Table:
        """Return the table with some of its columns, in their order of `keys`, after that of the labels."""
        named = {column.key: replace(column, aside=False) for column in self.columns}
        order = dict.fromkeys(key for key in (self.columns[0].key, *keys) if key in named)
        return replace(self, columns=tuple(named[key] for key in order))


Group = tuple[Mapping[str, Cell], pl.DataFrame | None]
"""One row of a table: values that are given, and the rows of results from which all others are computed, if there are any."""


def table_of(id: str, title: str, columns: Iterable[Column], groups: Iterable[Group], note: str = "") -> Table:
    """Return a table with a row for each group of results."""
    columns = tuple(columns)
    computed = [(column.key, column.of) for column in columns if column.of is not None]
    rows = [{**given, **({} if rows is None else {key: of(rows) for key, of in computed})} for given, rows in groups]
    return Table(id, title, columns, tuple(rows), note)


VERSION_COLUMNS = tuple(Column(key, key, show="text") for key in ("version", "settings"))
"""Columns of a table of versions and settings."""


def version_cells(about: Mapping[str, Any]) -> dict[str, Cell]:
    """Return the cells of a method or peer in these columns."""
    return {"version": version_words(about), "settings": about["settings"]}


# ---------------------------------------------------------------- cells


@dataclass(frozen=True)
class ShownCell:
    """One cell: its text, its interval, its exact value, and whether no value of its column is significantly better."""

    text: str
    interval: str = ""
    value: float | None = None
    best: bool = False

    @property
    def look(self) -> str:
        """Look of a verdict on the page."""
        return next((look for words, look in LOOKS.items() if self.text.startswith(words)), "none")


def shown_rows(table: Table) -> list[list[ShownCell]]:
    """Return the cells of a table as text."""
    best = {column.key: _best(column, table.rows) for column in table.columns}
    return [
        [shown_cell(_own(column, row), row.get(column.key), k in best[column.key]) for column in table.columns]
        for k, row in enumerate(table.rows)
    ]


def _own(column: Column, row: Mapping[str, Cell]) -> Column:
    """Return a column with the unit of a row that has a separate one."""
    if column.show != "mixed":
        return column
    unit = str(row.get("unit") or "")
    return replace(column, unit=unit, show=str(row.get("show") or ("share" if unit == "%" else "number")))


def shown_cell(column: Column, value: Cell, best: bool = False) -> ShownCell:
    """Return a cell as text."""
    if isinstance(value, str):
        return ShownCell(value)
    middle, low, high = value if isinstance(value, tuple) else (value, math.nan, math.nan)
    if middle is None or math.isnan(middle):
        return ShownCell("–")
    floor = noise_floor(column.unit)
    if floor and abs(middle) < floor:
        return ShownCell(f"≤ {number(floor, 1).replace('1·', '')}", "", float(middle), best)
    text, interval = written(column.show, float(middle), low, high)
    return ShownCell(text, interval, float(middle), best)


def written(show: str, middle: float, low: float = math.nan, high: float = math.nan) -> tuple[str, str]:
    """Format a value and its interval with their significant digits."""
    if low == middle == high:
        low = high = math.nan  # an exact value
    half = (high - low) / 2
    if show == "share":
        decimals = 1 if not half > 0 else min(max(-math.floor(math.log10(half)), 1), DECIMALS_OF_SHARES)
        step = 10.0**-decimals
        text = "100" if middle >= 100 else f"{min(middle, 100 - step):.{decimals}f}"  # 100 means all
        return text, "" if math.isnan(half) else f"{low:.{decimals}f} to {high:.{decimals}f}"
    if show == "p":
        return p_value(middle), ""
    if show == "count":
        return (f"{middle:,.0f}" if middle == round(middle) else number(middle)), _interval(low, high, 3)
    if show == "limit":
        return ratio(middle), ""
    if show == "exact" and math.isfinite(middle):
        return f"{middle:.7g}", "" if math.isnan(half) else f"{low:.7g} to {high:.7g}"
    digits = 4 if show == "precise" else 3
    if half > 0 and math.isfinite(half) and middle:
        digits = 1 + math.floor(math.log10(abs(middle))) - math.floor(math.log10(half))
        digits = min(max(digits, LEAST_DIGITS), MOST_DIGITS)
    return number(middle, digits), _interval(low, high, digits)


def _interval(low: float, high: float, digits: int) -> str:
    if math.isnan(low) or math.isnan(high) or math.isinf(low):
        return ""
    return f"{number(low, digits)} to {number(high, digits)}"


def _best(column: Column, rows: Sequence[Mapping[str, Cell]]) -> Collection[int]:
    """Return the rows with the best value of a column and with overlapping intervals; empty if these are all rows.

    Told apart are two values of which neither is inside the other's interval: that is less than intervals without
    overlap, which small samples hardly ever have.
    """
    if not column.better:
        return ()
    found = {k: _ends(row.get(column.key)) for k, row in enumerate(rows) if not column.among or row.get(column.among)}
    known = {k: ends for k, ends in found.items() if math.isfinite(ends[0])}
    if len(known) < 2:
        return ()
    pick = max if column.better == "more" else min
    best, low, high = pick(known.values(), key=lambda ends: ends[0])
    level = {k for k, (value, a, b) in known.items() if low <= value <= high or a <= best <= b}
    return level if len(level) < len(known) else ()


def _ends(cell: Cell) -> tuple[float, float, float]:
    """Return a value with the ends of its interval: itself if it has none; NaN if it is no number."""
    if isinstance(cell, tuple):
        middle, low, high = (float(v) for v in cell)
        return middle, middle if math.isnan(low) else low, middle if math.isnan(high) else high
    value = float(cell) if isinstance(cell, float | int) else math.nan
    return value, value, value


# ---------------------------------------------------------------- CSV


def csv_of(table: Table) -> str:
    """Return a table as CSV with all its columns and exact values; the ends of an interval have separate columns."""
    wide = {column.key for column in table.columns if any(isinstance(r.get(column.key), tuple) for r in table.rows)}
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    endings = {column: ("", " low", " high") if column.key in wide else ("",) for column in table.columns}
    units = {column: f" [{column.unit}]" if column.unit else "" for column in table.columns}
    writer.writerow([f"{c.key}{ending}{units[c]}" for c in table.columns for ending in endings[c]])
    for row in table.rows:
        cells = [(row.get(c.key), len(endings[c])) for c in table.columns]
        values = [v if isinstance(v, tuple) else (v, "", "")[:count] for v, count in cells]
        writer.writerow([_exact(one) for value in values for one in value])
    return out.getvalue()


def _exact(value: str | float | None) -> str:
    """Return a value with all its digits; NaN is written as in programs."""
    if value is None or isinstance(value, str):
        return value or ""
    return "NaN" if value != value else repr(value if isinstance(value, int) else float(value))


# ---------------------------------------------------------------- Markdown

_SPECIAL = re.compile(r"([\\`*_{}\[\]#|~$])")
"""Characters that have a meaning in Markdown."""


def markdown_of(table: Table) -> str:
    """Return a table as Markdown, without the columns shown on request; the best value is bold."""
    shown = table.printed
    lines = [
        f"**{marked(table.title)}**\n",
        f"| {' | '.join(marked(c.head) for c in shown.columns)} |",
        f"| {' | '.join('---' if c.is_text else '---:' for c in shown.columns)} |",
        *(f"| {' | '.join(map(_marked_cell, row))} |" for row in shown_rows(shown)),
    ]
    return "\n".join(lines) + "\n" + (f"\n{marked(table.note)}\n" if table.note else "")


def _marked_cell(cell: ShownCell) -> str:
    text = f"**{marked(cell.text)}**" if cell.best else marked(cell.text)
    return text + (f" ({marked(cell.interval)})" if cell.interval else "")


def marked(text: str) -> str:
    """Return text with Markdown's special characters escaped."""
    safe = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return " ".join(_SPECIAL.sub(r"\\\1", safe).split())


# ---------------------------------------------------------------- LaTeX

LATEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "_": r"\_", "%": r"\%",
    "^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': r"\textquotedbl{}", "–": "--", "−": r"$-$", "×": r"$\times$", "·": r"$\cdot$", "∞": r"$\infty$",
    "≤": r"$\le$", "≥": r"$\ge$", "±": r"$\pm$", "°": r"$^\circ$", "µ": r"$\mu$", "²": r"$^2$", "³": r"$^3$", "√": r"$\surd$",
    "α": r"$\alpha$", "β": r"$\beta$", "λ": r"$\lambda$", "μ": r"$\mu$", "σ": r"$\sigma$", "ρ": r"$\rho$", "τ": r"$\tau$",
    "ε": r"$\varepsilon$", "θ": r"$\theta$", "ω": r"$\omega$", "…": r"\ldots{}", "“": "``", "”": "''", "→": r"$\to$",
    "ṡ": r"$\dot s$", "s̈": r"$\ddot s$", "s⃛": r"$s^{(3)}$", "l̄": r"$\bar l$", "\n": " ", "\r": " ",
}  # fmt: skip
"""Characters with a meaning in LaTeX, or without a glyph in its usual fonts."""

_SPECIAL_IN_LATEX = re.compile("|".join(map(re.escape, sorted(LATEX, key=len, reverse=True))))
"""Regular expression of these characters."""

LATEX_SIZES = {"small": 62, "footnotesize": 70, "scriptsize": 80}
"""Sizes of text in LaTeX, and the number of characters in a line of a page of one column, digits and signs being wide."""

LATEX_COLUMN = 0.5
"""Width of a column of a journal over that of such a line."""

_POWER = re.compile(r"·?10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)")
"""Regular expression of a power of ten on the page."""

_LOWERED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
"""Superscript digits of the page, and their form in a LaTeX exponent."""


def tex_of(table: Table) -> str:
    """Return a table as LaTeX as wide as its line, without the columns shown on request; the best values are bold.

    Of a page of two columns it takes one if no word is broken there, else both.
    """
    shown = table.printed
    rows = shown_rows(shown)
    size, widths, star = _widths(shown, rows)
    columns = [
        rf">{{\{'raggedright' if c.is_text else 'raggedleft'}\arraybackslash}}p{{{width:.3f}\linewidth}}"
        for c, width in zip(shown.columns, widths, strict=True)
    ]
    gaps = f"{2 * (len(columns) - 1)}\\tabcolsep"
    lines = [
        r"% needs \usepackage{array,booktabs}",
        rf"\begin{{table{star}}}",
        rf"\caption{{{escaped(table.title)}}}",
        rf"\label{{tab:{slug(table.id)}}}",
        rf"\{size}\setlength{{\tabcolsep}}{{3pt}}\addtolength{{\linewidth}}{{-{gaps}}}%",
        rf"\begin{{tabular}}{{@{{}}{''.join(columns)}@{{}}}}",
        r"\toprule",
        " & ".join(escaped(c.head) for c in shown.columns) + r" \\",
        r"\midrule",
        *(" & ".join(map(_tex_cell, row)) + r" \\" for row in rows),
        r"\bottomrule",
        r"\end{tabular}",
        *(
            [rf"\addtolength{{\linewidth}}{{{gaps}}}\par\smallskip\footnotesize {escaped(table.note)}"]
            if table.note
            else []
        ),
        rf"\end{{table{star}}}",
        "",
    ]
    return "\n".join(lines)


def _widths(table: Table, rows: Sequence[Sequence[ShownCell]]) -> tuple[str, list[float], str]:
    """Return the largest size of text at which no word is broken, the widths as fractions of the line, and * for a wide one."""
    texts = [[c.head, *(row[k].text for row in rows)] for k, c in enumerate(table.columns)]
    least = [max(len(word) for text in column for word in text.split() or [""]) + 1 for column in texts]
    tiny = [max((math.ceil(0.75 * len(row[k].interval)) for row in rows), default=0) for k in range(len(table.columns))]
    longest = [max(max(map(len, column[1:]), default=1), small) for column, small in zip(texts, tiny, strict=True)]
    wanted = [max(most, low) + 1 for most, low in zip(longest, least, strict=True)]
    part = LATEX_COLUMN if sum(least) <= LATEX_COLUMN * LATEX_SIZES["scriptsize"] else 1.0
    size = next((name for name, most in LATEX_SIZES.items() if sum(least) <= part * most), "scriptsize")
    room = max(part * LATEX_SIZES[size] - sum(least), 0)
    more = [high - low for low, high in zip(least, wanted, strict=True)]
    share = room / max(sum(more), room, 1)
    found = [low + share * extra for low, extra in zip(least, more, strict=True)]
    whole = max(sum(found), part * LATEX_SIZES[size])
    return size, [math.floor(1e3 * width / whole) / 1e3 for width in found], "" if part < 1.0 else "*"


def _tex_cell(cell: ShownCell) -> str:
    text = rf"\textbf{{{escaped(cell.text)}}}" if cell.best else escaped(cell.text)
    return text + (rf"\newline{{\tiny {escaped(cell.interval)}}}" if cell.interval else "")


def escaped(text: str) -> str:
    """Return text with LaTeX's special characters escaped."""
    out, end = [], 0
    for found in _POWER.finditer(text):
        out.append(_plain(text[end : found.start()]))
        dot = r"\cdot " if found[0].startswith("·") else ""
        out.append(f"${dot}10^{{{found[1].translate(_LOWERED)}}}$")
        end = found.end()
    return "".join([*out, _plain(text[end:])])


def _plain(text: str) -> str:
    return _SPECIAL_IN_LATEX.sub(lambda found: LATEX[found[0]], text)
