"""Whether figures and tables of a report fit a two-column page: no box that is too wide, figures of 88 and 181 mm.

Needs `pdflatex` and the folder of a run in ``RUN``, with its report in the formats pdf and tex.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.figures.figure import Row, Value, main

RUN = Path(os.environ.get("RUN", "run")).resolve()
PAGE = r"""\documentclass[twocolumn,10pt]{article}
\usepackage[utf8]{inputenc}\usepackage[T1]{fontenc}
\usepackage{array,booktabs,graphicx}
\usepackage[paperwidth=210mm,paperheight=297mm,textwidth=181mm,textheight=250mm]{geometry}
\setlength{\columnsep}{5mm}
\begin{document}
\begin{figure}\includegraphics{%s}\end{figure}
\begin{figure*}\includegraphics{%s}\end{figure*}
%s
\end{document}
"""
WIDE = re.compile(r"Overfull \\hbox \(([\d.]+)pt")
SIZE = re.compile(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)")


def width(file: Path) -> float:
    """Width of a PDF figure [mm]."""
    found = SIZE.search(file.read_bytes())
    assert found, file
    return float(found[1]) * 25.4 / 72.0


def pairs() -> list[tuple[Path, Path]]:
    """Two tables each: a narrow one and a wide one, in turn."""
    tables = sorted((RUN / "tables").glob("*.tex"))
    narrow = [file for file in tables if r"\begin{table}" in file.read_text(encoding="utf-8")]
    wide = [file for file in tables if file not in narrow]
    return [(narrow[k % len(narrow)], wide[k % len(wide)]) for k in range(max(len(narrow), len(wide)))]


def measure(case: int) -> Row:
    """Boxes that are too wide [pt] on a page with two figures and two tables."""
    figures = sorted((RUN / "report-figures").glob("*.pdf"), key=width)
    tables = pairs()[case]
    with TemporaryDirectory() as folder:
        chosen = figures[case % 3], figures[-1 - case % 3]
        for k, file in enumerate(chosen):
            shutil.copy(file, Path(folder) / f"figure{k}.pdf")
        text = "\n".join(file.read_text(encoding="utf-8") for file in tables)
        (Path(folder) / "page.tex").write_text(PAGE % ("figure0.pdf", "figure1.pdf", text), encoding="utf-8")
        command = ["pdflatex", "-interaction=nonstopmode", "page.tex"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", check=False)
    return {
        "tables": [file.stem for file in tables], "widths": [round(width(file), 1) for file in chosen],
        "overfull": [float(x) for x in WIDE.findall(done.stdout)], "status": done.returncode,
    }  # fmt: skip


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    wide = [row["tables"] for row in rows if row["overfull"] or row["status"]]
    widths = sorted({x for row in rows for x in row["widths"]})
    return [
        Value("pages with an overfull box or an error", "0", f"{len(wide)} of {len(rows)} {wide or ''}", not wide),
        Value("widths of figures", "88 and 181 mm", f"{widths} mm", set(widths) <= {88.0, 181.0}),
    ]


if __name__ == "__main__":
    main("paper_figures", measure, len(pairs()), judge)
