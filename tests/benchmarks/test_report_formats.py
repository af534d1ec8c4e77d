"""What leaves the page: tables as CSV, Markdown and LaTeX read back, and the data that the page packs."""

from __future__ import annotations

import base64
import gzip
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from benchmarks.cli.app import app
from benchmarks.records import RunFolder
from benchmarks.report import boards, budgets, tables, timing
from benchmarks.report.base import Run, Winner
from benchmarks.report.boards import Board, Control, Sample, add, figure, fractions, lean, line, log_axis, packed
from benchmarks.report.page import MethodRanking, rank_methods, render, winners_table, won
from benchmarks.report.tables import Column, ShownCell, Table, markdown_of, shown_cell, shown_rows, tex_of, written
from benchmarks.statistics import holm, mcnemar_p, percentage, signed_rank
from optik.errors import InvalidInput

EVIL = "a|b <script>& 50 % _x_ $y$ #1 {z} ~^\\"
COLUMNS = (
    Column("label", "Method | law", show="text"),
    Column("solved", "solved", "%", "more", "share"),
    Column("us", "median_time", "µs", "less"),
    Column("count", "problems", show="count"),
    Column("error", "error", "mm", "less"),
    Column("rest", "few ask", aside=True),
)
ROWS: tuple[dict[str, Any], ...] = (
    {
        "label": EVIL,
        "solved": (99.96, 99.9, 99.99),
        "us": (2.8123, 2.7, 2.9),
        "count": 4305,
        "error": 3.1e-7,
        "rest": 1 / 3,
    },
    {"label": "λ=0.1, “x”", "solved": (88.0, 86.1, 90.3), "us": 1234.5, "count": 7, "error": 2e-13, "rest": None},
    {"label": "none", "solved": None, "us": float("nan"), "count": 0, "error": None},
)
TABLE = Table("odd", "A title & more", COLUMNS, ROWS, "A note: 50 %.")


# ------------------------------------------------------------ cells


@pytest.mark.parametrize(
    ("column", "value", "text", "interval"),
    [
        (COLUMNS[1], (100.0, 99.1, 100.0), "100", "99.1 to 100.0"),
        (COLUMNS[1], (99.96, 95.0, 99.99), "99.9", "95.0 to 100.0"),  # not all of them: never rounded up to 100
        (COLUMNS[1], (99.999, 99.99, 100.0), "99.999", "99.990 to 100.000"),
        (COLUMNS[2], (12.345, 11.8, 12.9), "12.3", "11.8 to 12.9"),
        (COLUMNS[2], (12.345, 12.34, 12.35), "12.35", "12.34 to 12.35"),
        (COLUMNS[2], 12.345, "12.3", ""),
        (COLUMNS[2], (0.6032, 0.6032, 0.6032), "0.603", ""),
        (COLUMNS[2], (float("inf"), float("inf"), float("inf")), "∞", ""),
        (COLUMNS[3], 4305, "4,305", ""),
        (COLUMNS[4], 2e-10, "≤ 10⁻⁹", ""),
        (COLUMNS[4], 2e-9, "2.00·10⁻⁹", ""),
        (COLUMNS[4], float("inf"), "∞", ""),
        (Column("x", "x", show="exact"), 1.000000000000, "1", ""),
        (Column("x", "x", show="exact"), 1.00000571, "1.000006", ""),
        (Column("x", "x", "s", show="precise"), 0.603215, "0.6032", ""),
        (Column("x", "x", show="limit"), 1.0000057, "1.0000057", ""),
        (Column("x", "x", show="limit"), 457.987654, "458", ""),
        (Column("x", "x", show="limit"), 0.99999999, "1.00", ""),
    ],
)
def test_values_have_the_digits_that_they_deserve(column: Column, value: Any, text: str, interval: str) -> None:
    cell = shown_cell(column, value)
    assert (cell.text, cell.interval) == (text, interval)


def test_the_best_are_those_that_no_interval_tells_from_the_best() -> None:
    columns = (Column("label", "Method", show="text"), Column("v", "v", "", "less"), Column("w", "w", "", "more"))
    rows = (
        {"label": "a", "v": (5.0, 4.0, 6.0), "w": 1.0},
        {"label": "b", "v": (4.5, 4.2, 4.8), "w": 1.0},
        {"label": "c", "v": (9.0, 8.0, 9.5), "w": None},
        # overlaps with the best, and yet neither value is in the other's
        {"label": "d", "v": (5.2, 4.7, 5.7), "w": 1.0},
    )
    shown = shown_rows(Table("t", "t", columns, rows))
    assert [row[1].best for row in shown] == [True, True, False, False]
    assert [row[2].best for row in shown] == [False] * 4  # all the same: nothing to mark


def test_only_rows_that_may_are_the_best() -> None:
    columns = (
        Column("label", "Law", show="text"),
        Column("T", "T", "s", "less", among="rank"),
        Column("rank", "rank", show="text"),
    )
    rows = (
        {"label": "breaks", "T": 1.0, "rank": None},
        {"label": "a", "T": 2.0, "rank": "1"},
        {"label": "b", "T": 3.0, "rank": "2"},
    )
    shown = shown_rows(Table("t", "t", columns, rows))
    assert [row[1].best for row in shown] == [False, True, False]


def test_verdicts_have_a_look_and_values_the_digits_of_their_measure() -> None:
    words = ("met", "met (a goal)", "missed", "missed (a goal)", "not measured")
    assert [ShownCell(text).look for text in words] == ["good", "good", "bad", "partly", "none"]
    rows = tuple({"label": show, "v": 93.333333333, "unit": "%", "show": show} for show in ("exact", "number", ""))
    shown = shown_rows(Table("t", "t", (Column("label", "x"), Column("v", "v", show="mixed")), rows))
    assert [row[1].text for row in shown] == ["93.33333", "93.3", "93.3"]


# ------------------------------------------------------------ read back


def test_csv_has_the_exact_values() -> None:
    found = pl.read_csv(io.StringIO(tables.csv_of(TABLE)))
    assert found.columns == [
        "label", "solved [%]", "solved low [%]", "solved high [%]", "us [µs]", "us low [µs]", "us high [µs]", "count",
        "error [mm]", "rest",
    ]  # fmt: skip
    assert found["label"].to_list() == [row["label"] for row in ROWS]
    assert found["solved [%]"].to_list() == [99.96, 88.0, None]
    assert found["us low [µs]"].to_list() == [2.7, None, None]
    assert found["us [µs]"].to_list()[:2] == [2.8123, 1234.5]
    assert np.isnan(found["us [µs]"][2])
    assert found["error [mm]"].to_list() == [3.1e-7, 2e-13, None]
    assert found["rest"].to_list() == [1 / 3, None, None]


def markdown_rows(text: str) -> list[list[str]]:
    """Cells of a Markdown table as a reader sees them."""
    rows = [line for line in text.splitlines() if line.startswith("|")]
    cells = [re.split(r"(?<!\\)\|", row)[1:-1] for row in rows]

    def seen(cell: str) -> str:
        plain = re.sub(r"\*\*(.*)\*\*", r"\1", cell.strip())
        plain = re.sub(r"\\([\\`*_{}\[\]#|~$])", r"\1", plain)
        return plain.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")

    return [[seen(cell) for cell in row] for row in cells]


def test_markdown_reads_back() -> None:
    head, rule, *rows = markdown_rows(markdown_of(TABLE))
    assert head == ["Method | law", "solved [%]", "median_time [µs]", "problems", "error [mm]"]
    assert rule == ["---", "---:", "---:", "---:", "---:"]
    shown = shown_rows(TABLE)
    for row, cells in zip(shown, rows, strict=True):
        assert cells == [c.text + (f" ({c.interval})" if c.interval else "") for c in row[:5]]
    assert rows[0][0] == EVIL
    assert "<script>" not in markdown_of(TABLE)


def test_latex_is_whole_and_has_no_bare_special_character() -> None:
    text = tex_of(TABLE)
    body = text.partition(r"\midrule")[2].partition(r"\bottomrule")[0].strip().splitlines()
    assert len(body) == len(ROWS)
    for row in body:
        assert len(re.split(r"(?<!\\)&", row)) == 5
        assert row.endswith(r"\\")
    assert text.count(r"\begin{table*}") == text.count(r"\end{table*}") == 1
    assert text.count("{") - text.count(r"\{") == text.count("}") - text.count(r"\}")
    for row in body:
        bare = re.sub(r"\\[%#_&${}]|\$[^$]*\$|\\\\$", "", row)
        assert not set("%#_$|<>~^λµ−") & set(bare), bare
    assert tables.escaped("1.23·10⁻⁷ ≤ λ s̈") == r"1.23$\cdot 10^{-7}$ $\le$ $\lambda$ $\ddot s$"


@pytest.mark.parametrize("copies", [1, 2, 5])
def test_latex_is_as_wide_as_a_line_and_gives_a_column_the_room_of_its_words(copies: int) -> None:
    wide = tuple(replace(c, key=c.key if k == 0 else f"{c.key}{k}") for k in range(copies) for c in COLUMNS[:4])
    rows = tuple({c.key: row.get(c.key.rstrip("1234")) for c in wide} for row in ROWS)
    text = tex_of(Table("wide", "Wide", wide, rows))
    widths = [float(width) for width in re.findall(r"p\{([\d.]+)\\linewidth\}", text)]
    assert len(widths) == 4 * copies and 0.9 < sum(widths) <= 1.0 + 1e-9
    assert widths[0] > widths[3]  # a long label, a short count
    assert (r"\begin{table}" in text) == (copies == 1), "one column of a journal is enough"


def test_columns_are_chosen_by_their_keys_in_their_order() -> None:
    found = TABLE.only(["rest", "us", "unknown"])
    assert [(column.key, column.aside) for column in found.columns] == [
        ("label", False),
        ("rest", False),
        ("us", False),
    ]
    assert found.rows == TABLE.rows


# ------------------------------------------------------------ figures


def board() -> Board:
    plot = figure("p", "A $title$ <b>", "t [s]", log_axis("error [mm]", range=(-14, 2)))
    look = {"color": "#d55e00", "dash": "dash"}
    add(plot, line([1, 2, 3], [1.0, 1e-6, 1e-13], name="<b> $x$", line=look), {"k": ["a"]})
    add(plot, line([1, 2, 3], [2.0, 2.0, 2.0], name="b", line={"color": "#123456"}), {"k": ["b"]})
    return Board("odd", (plot,), (Control.of("k", "K", ("a", "b")),), "A caption.")


def test_nothing_is_drawn_below_what_is_a_result() -> None:
    (plot,) = board().figures
    assert plot.data[0].y.tolist() == [1.0, 1e-6, 1e-9]
    assert plot.layout.yaxis.range[0] > -9.5
    assert [mark.text for mark in plot.layout.annotations] == ["≤ 10<sup>−9</sup>"]


def test_packed_figures_are_what_they_were() -> None:
    values = np.array([[0.12345, np.nan], [3.0, 1e-20]])
    plot = figure("p", "A title", "x")
    add(plot, boards.heatmap(z=np.log10(values), customdata=values, meta={"log10": True}), {"k": ["<b>"]})
    add(plot, line([1.0, None], ["<b>", "c"], name="<b>"), at={"k": ["d"]}, look={"name": "d"})
    text = packed(Board("odd", (plot,)), ["<b>"])
    (found,) = json.loads(gzip.decompress(base64.b64decode(text)))
    assert found["layout"] == {"xaxis": {"title": {"text": "x"}}, "height": 340, "meta": {"id": "p"}}
    of_map, of_line = found["data"]
    assert of_map["customdata"] == [[0.12345, None], [3, 1e-20]] and "z" not in of_map
    assert of_map["meta"] == {"log10": True, "when": {"k": ["&lt;b&gt;"]}}
    assert (of_line["x"], of_line["y"], of_line["name"]) == ([1, None], ["&lt;b&gt;", "c"], "&lt;b&gt;")
    assert packed(Board("odd", (plot,)), ["<b>"]) == text


def test_rounded_numbers_have_no_digits_beyond_those_asked_for() -> None:
    values = [0.123456, 123456.0, -9.99996e-7, 0.0, None, float("inf"), 1.0]
    found = lean(values)
    assert found[:4].tolist() == [0.1235, 123500.0, -1e-6, 0.0] and np.isnan(found[4:6]).all() and found[6] == 1.0
    many = np.exp(np.random.default_rng(0).uniform(-40, 40, 2000))
    assert lean(many).tolist() == [float(f"{v:.4g}") for v in many]


# ------------------------------------------------------------ from the command line


@pytest.fixture
def failing(copied: RunFolder, monkeypatch: pytest.MonkeyPatch) -> RunFolder:
    """A run with failures, one table and winners."""
    winner = Winner(
        "Who?", "%", "more", (("a", 90.0, 80.0, 95.0), ("b", 85.0, 70.0, 91.0), ("c", 1.0, 0.5, 2.0)), "methods"
    )
    failed = [
        {"file": f"rows/budgets/{block}--01-corrected--{part:03d}.parquet", "label": "corrected <b>, x", "why": why, "times": 2}
        for block, part, why in (("misprint", 0, "SIGSEGV"), ("misprint", 1, "SIGSEGV"), ("damping", 0, "it hung"))
    ]  # fmt: skip
    copied.write_json("run.json", copied.manifest() | {"failed": failed})
    shown = replace(budgets.REPORT, tables=lambda run: [TABLE], winners=lambda run: [winner])
    monkeypatch.setattr(budgets, "REPORT", shown)
    few = tuple(one for one in timing.REPORT.sections if one.title == "Clearance")  # no figure: each takes 0.5 s
    bare = replace(timing.REPORT, tables=lambda run: [], winners=lambda run: [], sections=few)
    monkeypatch.setattr(timing, "REPORT", bare)
    return copied


def test_tables_are_written_into_the_run(failing: RunFolder) -> None:
    for name, files in (
        ("csv", ["tables/winners.csv", "tables/odd.csv", "tables/failed-budgets.csv"]),
        ("tex", ["tables/winners.tex", "tables/odd.tex", "tables/failed-budgets.tex"]),
    ):
        done = CliRunner().invoke(app, ["bench", "report", str(failing.path), "--format", name, "--json"])
        assert done.exit_code == 0, done.output
        assert [str(Path(f).relative_to(failing.path)) for f in json.loads(done.stdout)["files"]] == files
    chosen = ["bench", "report", str(failing.path), "--format", "tex", "--json", "--columns", "us, rest"]
    done = CliRunner().invoke(app, chosen)
    assert [Path(f).name for f in json.loads(done.stdout)["files"]] == ["odd.tex"]
    assert "few ask" in (failing.path / "tables/odd.tex").read_text() and "problems" not in done.stdout
    assert not (failing.path / "tables/winners.tex").exists(), "tables of other columns do not stay beside the new ones"
    plain = ["bench", "report", str(failing.path), "--columns"]
    for wrong in (["us, x", "--format", "tex"], ["us"]):
        assert isinstance(CliRunner().invoke(app, [*plain, *wrong]).exception, InvalidInput)
    winners = pl.read_csv(failing.path / "tables/winners.csv").row(0, named=True)
    assert (winners["best"], winners["value"], winners["tied"], winners["second"]) == ("a", 90.0, "b", "c")
    crashes = pl.read_csv(failing.path / "tables/failed-budgets.csv").rows()
    titles = {block.id: block.title for _, block in Run(failing).suite.pairs()}
    first = ("corrected <b>, x", titles["misprint"], 4, "SIGSEGV", 2)
    assert crashes[0] == first
    if "damping" in titles:
        assert crashes[1] == ("corrected <b>, x", titles["damping"], 2, "it hung", 1)


def test_the_report_in_markdown_has_tables_and_failures(failing: RunFolder) -> None:
    done = CliRunner().invoke(app, ["bench", "report", str(failing.path), "--format", "md", "--json"])
    assert done.exit_code == 0, done.output
    text = (failing.path / "report.md").read_text(encoding="utf-8")
    assert text.count("A title &amp; more") == 1
    assert text.index("## Methods") < text.index("Methods: failures") < text.index("SIGSEGV")
    assert "Failures or crashes: “corrected &lt;b&gt;, x”." in text
    page = render(Run(failing))
    assert page.index('<section id="budgets">') < page.index("Methods: failures") < page.index("SIGSEGV")
    assert page.index("SIGSEGV") < page.index("<section", page.index('<section id="budgets">') + 1)


def test_a_distribution_is_drawn_from_every_value_and_exact_at_its_ends() -> None:
    x, percents = fractions([3.0, 1.0, 2.0, math.inf, 2.0])  # the fourth has failed
    assert (x.tolist(), percents.tolist()) == ([1.0, 1.0, 2.0, 3.0], [0.0, 20.0, 60.0, 80.0])
    values = np.random.default_rng(1).lognormal(size=20_000)
    x, percents = fractions([*values, *[math.nan] * 5_000])
    assert len(x) <= 302
    assert (x[0], x[-1], percents[0], percents[-1]) == (values.min(), values.max(), 0.0, 80.0)
    for value, percent in zip(x[1:], percents[1:], strict=True):
        assert percent == pytest.approx(100.0 * np.count_nonzero(values <= value) / 25_000)
    assert percents[1] == 100.0 / 25_000  # not the first whole percent
    assert np.diff(percents).max() < 1.0
    samples = [
        Sample("some", values, {}, {"group": ["a"]}),
        Sample("none", [math.inf], {}, {}),
        Sample("no rows", [], {}, {}),
    ]
    (trace,) = boards.fraction_plot("id", "title", "x", "paths", "%{y}", samples).data
    assert (trace.name, trace.meta) == ("some", {"when": {"group": ["a"]}})


def test_a_name_with_a_comma_is_told_from_two_names() -> None:
    assert tables.listed(["lm", "lm, one attempt"]) == "lm, “lm, one attempt”"
    found = rank_methods({"a, b": 3, "c": 100, "d": 60})
    assert found.labels == ("c", "d") and found.left_out.endswith(": “a, b” (3)")
    assert rank_methods({"a": 3, "c": 100}) == MethodRanking(("a", "c"), "")  # one alone wins nothing
    found = rank_methods({"a": 100_000, "b": 999, "c": 1000})
    assert found.labels == ("a", "c") and found.left_out.endswith(": b (999)")


def test_digits_of_shares_and_p_values() -> None:
    assert written("share", 89.6667, 88.46, 90.76)[0] == "89.7"
    assert written("share", 99.97, 99.0, 100.0)[0] == "99.9"  # 100 only where all are solved
    counts = {"100": (100_000, 100_000), "99.999": (999_999, 1_000_000), "99.98": (9999, 10_001), "0.0": (0, 10)}
    assert {written("share", *percentage(*solved))[0]: solved for solved in counts.values()} == counts
    assert written("share", *percentage(100_000, 100_000))[1] == "99.996 to 100.000"
    assert [written("p", p)[0] for p in (2e-112, 0.0, 0.0345)] == ["< 10⁻⁶", "< 10⁻⁶", "0.035"]


@pytest.mark.parametrize(
    ("methods", "count", "words"),
    [(2, 6, " (n = 6)"), (2, 5, " (n = 5: too few for a test)"), (3, 6, "too few"), (3, 7, "7)")],
)
def test_a_test_that_cannot_find_a_difference_says_so(methods: int, count: int, words: str) -> None:
    entries = tuple((f"m{k}", 1.0, 0.0, 2.0) for k in range(methods))
    assert words in Winner("Who?", "%", "more", entries, "methods", level=("m0",), count=count).sample
    p = holm([mcnemar_p(0, count)] * (methods - 1))[0]  # the most unequal outcome
    assert p == holm([signed_rank(np.arange(2.0, 2.0 + count), np.ones(count))] * (methods - 1))[0]
    assert (p >= 0.05) == ("too few" in Winner("Who?", "%", "more", entries, "methods", level=(), count=count).sample)


@pytest.mark.parametrize(
    ("second", "count", "tied", "remark"),
    [
        (61.0, 7, ("b", "c"), "no significant difference (n = 7)"),
        (61.0, 6, (), "ranked by value (n = 6: too few for a test)"),
        (1.0, 5, ("b",), "same value (n = 5: too few for a test)"),
    ],
)
def test_with_too_few_values_for_a_test_entries_are_ranked_by_value(
    second: float, count: int, tied: tuple[str, ...], remark: str, small_run: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    entries = tuple((label, value, 0.0, 99.0) for label, value in (("a", 1.0), ("b", second), ("c", 90.0)))
    answer = [Winner("Who?", "s", "less", entries, "methods", level=("a", "b", "c"), count=count)]
    monkeypatch.setattr(budgets, "REPORT", replace(budgets.REPORT, winners=lambda run: answer))
    found = won(Run(small_run))[0]
    assert (found.level, found.remark) == (("a", *tied), remark)
    table = winners_table(Run(small_run))
    assert ("ranked by value" in str(table.rows[0]["note"])) == (count < 7)


def test_the_first_screen_names_ties_and_the_next_best(small_run: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = (("ipopt", 90.0, 80.0, 95.0), ("b", 85.0, 70.0, 91.0), ("c", 1.0, 0.5, 2.0))
    answer = [Winner("Who?", "%", "more", entries, "methods")]
    monkeypatch.setattr(budgets, "REPORT", replace(budgets.REPORT, winners=lambda run: answer))
    found = won(Run(small_run))[0]
    exact = [
        Winner("Who?", "s", "less", (("a", 0.60321, 0.60321, 0.60321), ("b", 0.60333, 0.60333, 0.60333)), "methods")
    ]
    assert (found.best.label, found.best.value, found.best.interval) == ("ipopt", "90.0 %", "80.0 to 95.0")
    assert found.level == ("ipopt", "b")
    assert found.remark == "no significant difference"
    assert found.second.label == "c"
    page = render(Run(small_run))
    dot = f'<i class="dot" style="--k:{boards.variable(Run(small_run).colour("ipopt"))}"></i>'
    assert f'<td class="best"><span class="tied">{dot}ipopt' in page
    monkeypatch.setattr(budgets, "REPORT", replace(budgets.REPORT, winners=lambda run: exact))
    found = won(Run(small_run))[0]
    assert (found.best.value, found.second.value) == ("0.6032 s", "0.6033 s")
