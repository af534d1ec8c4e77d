"""The report of a small real run: one page, whole, self-contained, and its numbers those of the run's files."""

from __future__ import annotations

import base64
import gzip
import json
import math
import re
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from benchmarks.blocks.base import add_keys, load_kind
from benchmarks.blocks.entries import JOINT_LIMITS
from benchmarks.records import RunFolder
from benchmarks.report import write_report
from benchmarks.report.base import Run, load_report
from benchmarks.report.boards import strict
from benchmarks.report.tables import number
from benchmarks.report.timing import limitations
from benchmarks.report.timing.line import broken_limits, describe_limits, law_control
from benchmarks.run import run_suite
from optik.errors import InvalidInput
from planners.limits import MotionLimits
from tests.benchmarks import plain_demo
from tests.benchmarks.browser import Browser
from tests.benchmarks.conftest import SMALL, small

LOADS = ("src", "href", "srcset", "poster", "data", "action", "background")


class Page(HTMLParser):
    """What a page loads, says and shows, apart from the text of its scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self.styles: list[str] = []
        self.inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {k: v or "" for k, v in attrs}))
        self.inside = tag

    def handle_endtag(self, tag: str) -> None:
        self.inside = ""

    def handle_data(self, data: str) -> None:
        {"script": self.scripts, "style": self.styles}.get(self.inside, self.words).append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attrs for t, attrs in self.tags if t == tag]

    @property
    def anchors(self) -> list[str]:
        return [attrs["id"] for attrs in self.all("section")]


def boards_of(page: Page) -> list[Any]:
    """The plots of every board, as the browser has them."""
    scripts = zip(page.all("script"), page.scripts, strict=True)
    packed = [text for attrs, text in scripts if attrs.get("type") == "text/plain" and "id" not in attrs]
    return [json.loads(gzip.decompress(base64.b64decode(text)), parse_constant=refuse) for text in packed]


def refuse(constant: str) -> None:
    raise AssertionError(constant)


def page_of(folder: RunFolder) -> Page:
    return Page(write_report(folder).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def written(small_run: RunFolder, tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return RunFolder(shutil.copytree(small_run.path, tmp_path_factory.mktemp("report") / "run"))


@pytest.fixture(scope="module")
def page(written: RunFolder) -> Page:
    return page_of(written)


# ------------------------------------------------------------ one page, whole


def test_the_page_loads_nothing(page: Page) -> None:
    for tag, attrs in page.tags:
        for key in LOADS:
            if key in attrs:
                assert attrs[key].startswith(("#", "data:")), (tag, key, attrs[key])
    assert not re.search(r"@import|url\(", "".join(page.styles))
    policy = next(a["content"] for a in page.all("meta") if a.get("http-equiv") == "Content-Security-Policy")
    assert "default-src 'none'" in policy
    assert "http" not in policy


def test_the_page_has_a_language_a_title_and_every_section(page: Page) -> None:
    assert page.all("html")[0]["lang"] == "en"
    assert "a small run" in page.text
    wanted = [
        "budgets", "error", "maps", "line", "joints", "laws", "paper", "claims", "limitations", "provenance",
    ]  # fmt: skip
    assert page.anchors == wanted
    linked = {a["href"] for a in page.all("a")}
    assert {f"#{anchor}" for anchor in wanted} <= linked


def test_plotly_is_there_once_and_compressed(page: Page) -> None:
    large = [s for s in page.scripts if len(s) > 1e6]
    assert len(large) == 1
    assert b"plotly.js v" in gzip.decompress(base64.b64decode(large[0]))[:2000]
    assert len(large[0]) < 2.2e6


def test_every_board_is_strict_json_with_finite_numbers(page: Page) -> None:
    figures = [a for a in page.all("figure") if "board" in a.get("class", "")]
    boards = boards_of(page)
    assert len(boards) == len(figures) > 0
    for shown, plots in zip(figures, boards, strict=True):
        assert all(isinstance(v, str) for v in json.loads(shown["data-state"], parse_constant=refuse).values())
        assert all(plot["layout"]["meta"]["id"] in {a.get("id") for a in page.all("div")} for plot in plots)
        assert any(plot["data"] for plot in plots)


def test_every_method_and_plan_is_shown(page: Page) -> None:
    labels = {m["label"] for b in SMALL["budgets"] for m in b["methods"]}
    assert labels | {one["law"] for one in SMALL["timing"][0]["laws"]} <= set(page.words)
    assert "optik bench run small --out RUN" in page.text


def test_the_report_is_the_same_twice(written: RunFolder, page: Page) -> None:
    first = (written.path / "report.html").read_bytes()
    assert write_report(written).read_bytes() == first
    assert [f.name for f in written.path.iterdir() if f.name.endswith(".part")] == []


# ------------------------------------------------------------ its numbers


def shown_rows(folder: RunFolder, kind: str, table: str) -> dict[str, Any]:
    """Rows of a table of the report by their labels."""
    found = next(t for t in load_report(load_kind(kind)).tables(Run(folder)) if t.id == table)
    return {str(row["label"]): row for row in found.rows}


@pytest.mark.parametrize("block", ["workspace", "misprint"])
def test_the_method_table_is_what_the_files_hold(small_run: RunFolder, block: str) -> None:
    shown = shown_rows(small_run, "budgets", f"budgets-{block}")
    given = plain_demo.given_to_all(plain_demo.block(small_run.path, block), list(shown))
    assert set(shown) == {m["label"] for b in SMALL["budgets"] if b["id"] == block for m in b["methods"]}
    for method, mine in given.items():
        assert mine["problem"].size
        plain_demo.check_figures(shown[method], plain_demo.figures(mine))


def test_durations_are_the_plans(page: Page, small_run: RunFolder) -> None:
    for law, duration in small_run.rows("timing", "line").select("method", "duration").iter_rows():
        assert f" {law} {number(duration, 4)} " in page.text


@pytest.mark.parametrize(
    ("jerk", "broken"),
    [(0.8, []), (2.5, ["jerk 2.50×"]), (math.inf, ["jerk ∞"]), (None, []), (1.000003, ["jerk 1.0000030×"])],
)
def test_violated_limits_are_written_with_enough_digits(jerk: float | None, broken: list[str]) -> None:
    row = dict.fromkeys(JOINT_LIMITS, 0.5) | {"jerk": jerk, "breaks": ""}
    assert broken_limits(row) == broken
    assert broken_limits(row | {"breaks": "position"}) == [*broken, "joint range"]


def test_a_motion_that_breaks_a_limit_is_not_ranked(small_run: RunFolder) -> None:
    breaking = set(small_run.rows("timing", "line").filter(pl.col("breaks") != "")["method"])
    assert "quintic" in breaking
    rows = shown_rows(small_run, "timing", "laws")
    assert {law for law, row in rows.items() if row["broken"] != "none"} == breaking
    assert {law for law, row in rows.items() if row["place"] is None} == breaking


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (0.1234, "0.123"), (99.96, "100"), (12345.6, "12,300"), (-2.0, "−2.00"), (1.234e-7, "1.23·10⁻⁷"),
        (2.5e9, "2.50·10⁹"), (float("inf"), "∞"), (float("nan"), "–"), (None, "–"), (0.00099999, "0.00100"),
    ],
)  # fmt: skip
def test_numbers_are_readable(value: float | None, text: str) -> None:
    assert number(value) == text


# ------------------------------------------------------------ other runs


def edit(folder: RunFolder, change: Callable[[dict[str, Any]], None]) -> None:
    manifest = folder.manifest()
    change(manifest)
    folder.write_json("run.json", manifest)


def test_an_unfinished_run_says_so(copied: RunFolder) -> None:
    edit(copied, lambda m: m.update(complete=False))
    for file in (*(copied.path / "rows/budgets").glob("misprint--*"), *(copied.path / "rows/timing").iterdir()):
        file.unlink()
    page = page_of(copied)
    assert "This run is incomplete." in page.text
    assert "Not started: Methods: misprint" in page.text
    assert "line" not in page.anchors
    assert "budgets" in page.anchors


def test_a_run_of_which_nothing_is_there_yet_has_a_report(copied: RunFolder) -> None:
    edit(copied, lambda m: m.update(complete=False))
    for folder in ("rows", "problems"):
        shutil.rmtree(copied.path / folder)
    assert "This run is incomplete." in page_of(copied).text


@pytest.mark.parametrize("without", ["timing", "budgets"])
def test_sections_without_data_are_left_out(copied: RunFolder, without: str) -> None:
    settings = {k: v for k, v in small().settings.items() if k != without}
    shutil.rmtree(copied.path / f"rows/{without}")
    edit(copied, lambda m: m.update(settings=settings))
    page = page_of(copied)
    gone = {"line", "joints", "laws"} if without == "timing" else {"budgets", "error", "maps"}
    assert gone.isdisjoint(page.anchors)
    assert {"claims", "limitations", "provenance"} <= set(page.anchors)
    assert "incomplete" not in page.text


def test_a_plan_that_failed_has_its_reason_in_the_table(copied: RunFolder) -> None:
    file = "rows/timing/line--0000.parquet"
    rows = copied.read(file)
    lost = load_kind("timing").lost(
        **{k: rows.row(-1, named=True)[k] for k in ("method", "problem", "entry", "solver", "line")}
    )
    same = {k: rows.row(-1, named=True)[k] for k in ("robot", "kind", "index", "limits")}
    failed = lost | same | {"status": "no_ik", "reason": "out <of> reach"}
    copied.write(file, pl.concat([rows[:-1], add_keys("line", load_kind("timing").frame([failed]))]))
    assert "no motion: no ik: out <of> reach" in page_of(copied).text


def test_text_of_a_suite_is_escaped(tmp_path: Path) -> None:
    evil = "</script><script>alert('a & b')</script>"
    suite = small(title=evil)
    settings = json.loads(json.dumps(suite.settings))
    block = settings["budgets"][1] | {"title": evil, "options": {"count": 12}}
    block["methods"] = [{"label": evil, "solver": "dls"}]
    settings["budgets"] = [block]
    del settings["timing"]
    from benchmarks.suite import suite_of

    page = page_of(run_suite(suite_of("small", settings), tmp_path / "run"))
    assert evil in page.text
    assert all("alert(" not in s or s.startswith('{"state"') or len(s) > 1e6 for s in page.scripts)
    assert strict({"a": evil}).count("<") == 0
    assert json.loads(strict({"a": evil})) == {"a": evil}


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="optik bench run"):
        write_report(RunFolder(tmp_path))
    assert list(tmp_path.iterdir()) == []


# ------------------------------------------------------------ in a browser


def draws_every_plot(folder: RunFolder, scratch: Path) -> None:
    page = page_of(folder)
    with Browser(scratch, 1280, 2000) as browser:
        browser.open(folder.path / "report.html")
        browser.until("performance.getEntriesByName('all plots').length")
        assert browser.errors == []
        assert browser.asked(folder.path / "report.html") == []
        plots = sum("plot" in a.get("class", "").split() for a in page.all("div"))
        assert browser.run("document.querySelectorAll('.js-plotly-plot .main-svg').length") >= plots > 0
        assert browser.run("document.querySelectorAll('.js-plotly-plot').length") == plots


def test_provenance_names_every_block_s_problems_by_their_hash(written: RunFolder, page: Page) -> None:
    files = sorted((written.path / "problems").glob("*.json"))
    assert files
    for file in files:
        assert f"SHA-256 {json.loads(file.read_text(encoding='utf-8'))['sha256'][:16]}…" in page.text


def test_controls_of_laws_open_on_the_default_law() -> None:
    assert law_control(["quintic", "optimal", "toppra"], "all laws").value == "optimal"
    assert law_control(["quintic", "toppra"]).value == "quintic"


def test_limitations_name_the_limits_that_the_motions_had(small_run: RunFolder, copied: RunFolder) -> None:
    words = " ".join(limitations(Run(small_run)))
    assert "velocity, acceleration, jerk, torque are those of the robot file" in words
    assert "torque limits" not in words
    edit(copied, lambda m: m["settings"]["timing"][0]["limits"][0].pop("torque"))
    assert "Dynamics, torque limits, the controller and a real arm are not included" in " ".join(
        limitations(Run(copied))
    )


def test_limits_are_listed_joint_by_joint_with_repeats() -> None:
    assert describe_limits(MotionLimits(torque=[87.0, 87.0, 12.0]), 3).startswith("torque 87, 87, 12 ")
    assert describe_limits(MotionLimits(velocity=[2.0, 2.0]), 2).startswith("velocity 2 ")
    assert describe_limits(MotionLimits(velocity=[[-1.0, -1.0], [2.0, 2.0]]), 2).startswith("velocity -1 to 2 ")
