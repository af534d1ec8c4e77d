"""Every table of a run as LaTeX, for a paper: package booktabs, digits as on the page, the best values bold."""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks.records import RunFolder, slug
from benchmarks.report.base import Table
from benchmarks.report.formats.tables_csv import write_table
from benchmarks.report.run import Run
from benchmarks.report.shown import ShownCell, shown_table
from benchmarks.report.takeout import all_tables
from optik.plugins.files import forbid_code

LATEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "_": r"\_", "%": r"\%",
    "^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", '"': r"\textquotedbl{}", "–": "--", "−": r"$-$", "×": r"$\times$", "·": r"$\cdot$", "∞": r"$\infty$",
    "≤": r"$\le$", "≥": r"$\ge$", "±": r"$\pm$", "°": r"$^\circ$", "µ": r"$\mu$", "²": r"$^2$", "³": r"$^3$", "√": r"$\surd$",
    "α": r"$\alpha$", "β": r"$\beta$", "λ": r"$\lambda$", "μ": r"$\mu$", "σ": r"$\sigma$", "ρ": r"$\rho$", "τ": r"$\tau$",
    "ε": r"$\varepsilon$", "θ": r"$\theta$", "ω": r"$\omega$", "…": r"\ldots{}", "“": "``", "”": "''", "→": r"$\to$",
    "\n": " ", "\r": " ",
}  # fmt: skip
"""Characters with a meaning in LaTeX, or without a glyph in its usual fonts."""

_POWER = re.compile(r"·?10([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)")
"""Regular expression of a power of ten on the page."""

_LOWERED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
"""Superscript digits of the page, and their form in a LaTeX exponent."""


@forbid_code()
def write_tex(folder: RunFolder) -> list[Path]:
    """Write ``tables/ID.tex`` for every table of a run."""
    return [write_table(folder, table.id, "tex", tex_of(table)) for table in all_tables(Run(folder))]


def tex_of(table: Table) -> str:
    """Return a table as LaTeX, without the columns shown on request."""
    shown = shown_table(table)
    columns = [(k, column) for k, column in enumerate(table.columns) if not column.aside]
    heads = [escaped(f"{c.words} [{c.unit}]" if c.unit else c.words) for _, c in columns]
    rows = [" & ".join(_cell(row.cells[k]) for k, _ in columns) + r" \\" for row in shown.rows]
    return "\n".join(
        [
            r"% needs \usepackage{booktabs}",
            r"\begin{table}",
            rf"\caption{{{escaped(table.title)}}}",
            rf"\label{{tab:{slug(table.id)}}}",
            rf"\begin{{tabular}}{{{''.join('l' if c.show == 'text' else 'r' for _, c in columns)}}}",
            r"\toprule",
            " & ".join(heads) + r" \\",
            r"\midrule",
            *rows,
            r"\bottomrule",
            r"\end{tabular}",
            *([rf"\par\smallskip\footnotesize {escaped(table.note)}"] if table.note else []),
            r"\end{table}",
            "",
        ]
    )


def _cell(cell: ShownCell) -> str:
    text = escaped(cell.text)
    text = rf"\textbf{{{text}}}" if cell.best else text
    return text + (rf" {{\footnotesize ({escaped(cell.interval)})}}" if cell.interval else "")


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
    return "".join(LATEX.get(character, character) for character in text)
