"""The page in a real browser: every control, keys, themes, print, and names that would be tags."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from benchmarks.records import RunFolder
from benchmarks.report import budgets, write_report
from benchmarks.report.base import QUESTION, Section, Winner
from benchmarks.report.boards import METHOD_COLOURS, method_dash
from benchmarks.report.tables import Column, Table
from tests.benchmarks.browser import CHROMIUM, Browser

EVIL = "<script>alert('x')</script> & <b>a|b</b>"
PART = "document.getElementById('arm').shadowRoot.getElementById"
ALL_DRAWN = "performance.getEntriesByName('all plots').length"


def shown(run: Any) -> dict[str, Any]:
    found = budgets.methods(run)
    assert found is not None
    return {"lead": "An answer.", "boards": [], "tables": tables(run), "prose": ["How."]}


def tables(run: Any) -> list[Table]:
    columns = (
        Column("label", "Method", show="text"),
        Column("solved", "solved", "%", "more", "share"),
        Column("error", "error", "mm", "less"),
        Column("aside", "few ask", "µs", aside=True),
    )
    labels = run.labels
    rows = (
        {"label": labels[0], "solved": (90.0, 85.0, 94.0), "error": 3e-10, "aside": 1.5},
        {"label": labels[1], "solved": (40.0, 30.0, 50.0), "error": 12.5, "aside": None},
        {"label": "none", "solved": None, "error": float("nan"), "aside": 3.0},
    )
    return [Table("odd|name", f"A table of {EVIL}", columns, rows, "A note.")]


def winners(run: Any) -> list[Winner]:
    a, b = run.labels[:2]
    entries = ((a, 90.0, 85.0, 94.0), (b, 40.0, 30.0, 50.0))
    return [Winner("Solves the most", "%", "more", entries, "question", "100 targets", "by tossing")]


@pytest.fixture(scope="module")
def page(small_run: RunFolder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with odd names, whose kinds say who wins and bring a table and a section."""
    folder = RunFolder(tmp_path_factory.mktemp("browser") / "run")
    shutil.copytree(small_run.path, folder.path)
    manifest = folder.manifest()
    manifest["settings"]["budgets"][1]["methods"][0]["label"] = EVIL
    manifest["settings"]["budgets"][1]["title"] = EVIL
    folder.write_json("run.json", manifest)
    for file in (folder.path / "rows/budgets").glob("misprint--00*"):
        rows = folder.read(f"rows/budgets/{file.name}")
        folder.write(f"rows/budgets/{file.name}", rows.with_columns(method=pl.lit(EVIL)))
    question = Section("A question", "question", shown, QUESTION, 5)
    changed = replace(budgets.REPORT, winners=winners, tables=tables, sections=(*budgets.REPORT.sections, question))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(budgets, "REPORT", changed)
        return write_report(folder)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    with Browser(tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture(scope="module")
def drawn(browser: Browser, page: Path) -> Browser:
    """The page, drawn."""
    browser.emulate(width=1280)
    browser.open(page)
    browser.until(ALL_DRAWN)
    return browser


@pytest.fixture
def opened(drawn: Browser, page: Path) -> Iterator[Browser]:
    """The page, drawn; after the test its console must be empty and nothing must have been asked for."""
    drawn.emulate(width=1280)
    drawn.run("scrollTo(0, 0)")
    yield drawn
    assert drawn.errors == []
    assert drawn.asked(page) == []


def test_the_arm_plays_the_default_law_and_a_second_one_on_request(opened: Browser, small_run: RunFolder) -> None:
    rows = small_run.read("rows/timing/line.joints.parquet")
    ends = dict(rows.group_by("law").agg(pl.col("t").max()).iter_rows())
    first = "optimal" if "optimal" in ends else rows["law"][0]
    laws = f"[...{PART}('which').options].map(option => option.value)"
    assert set(opened.run(laws)) == set(ends)
    assert [opened.run(f"{PART}('{name}').value") for name in ("which", "beside")] == [first, ""]
    assert opened.run(f"Number({PART}('time').max)") == pytest.approx(ends[first])
    slowest = max(ends, key=lambda law: ends[law])
    opened.run(f"(s => {{ s.value = '{slowest}'; s.dispatchEvent(new Event('change')); }})({PART}('beside'))")
    opened.until(f"Math.abs(Number({PART}('time').max) - {ends[slowest]}) < 1e-6")
    opened.run(f"{PART}('play').click()")
    opened.until(f"Number({PART}('time').value) > 0.1")
    opened.run(f"{PART}('play').click()")
    assert opened.run(f"{PART}('play').getAttribute('aria-pressed')") == "false"


def test_every_control_is_driven(opened: Browser) -> None:
    driven = opened.run("""(async () => {
        let count = 0;
        for (const select of document.querySelectorAll('select[data-control]')) {
            const first = select.value;
            for (const value of [...[...select.options].map(option => option.value), first]) {
                select.value = value;
                select.dispatchEvent(new Event('change', { bubbles: true }));
                await new Promise(resolve => setTimeout(resolve));
                const chosen = select.closest('figure').querySelector('.chosen').textContent;
                const said = select.closest('[hidden]') || chosen.includes(select.selectedOptions[0].textContent);
                if (!said) return select.outerHTML;
                count++;
            }
        }
        return count;
    })()""")
    assert isinstance(driven, int), driven
    assert driven > 20
    assert opened.run("[...document.querySelectorAll('.plot')].every(plot => plot.querySelector('.main-svg, canvas'))")


def test_no_button_talks_to_a_server(opened: Browser) -> None:
    titles = "[...document.querySelectorAll('.modebar-btn')].map(b => b.dataset.title)"
    assert set(opened.run(titles)) <= {"Zoom", "Pan", "Reset axes", "Download plot", "Orbital rotation",
                                       "Reset camera to default"}  # fmt: skip
    assert opened.run("[...document.querySelectorAll('.js-plotly-plot')].every(p => !p._context.plotlyServerURL)")


def test_a_figure_is_saved_as_svg(opened: Browser) -> None:
    plot = "document.querySelector('.js-plotly-plot')"
    assert opened.run(f"Plotly.toImage({plot}, {plot}._context.toImageButtonOptions)").startswith("data:image/svg+xml")


def test_names_with_tags_stay_text(opened: Browser) -> None:
    assert opened.run(f"document.body.textContent.includes({json.dumps(EVIL)})")
    ticks = "[...document.querySelectorAll('#status .ytick')].map(t => t.textContent)"
    opened.run("""(() => { const s = document.querySelector('#statuses select'); s.value = 'misprint';
        s.dispatchEvent(new Event('change')); })()""")
    assert EVIL in opened.run(ticks)
    opened.run("""(() => { const s = document.querySelector('#success select'); s.value = 'misprint';
        s.dispatchEvent(new Event('change')); })()""")
    entries = "[...document.querySelectorAll('#success .legend li')].map(li => li.lastChild.textContent)"
    opened.until(f"{entries}.includes({json.dumps(EVIL)})", 10)
    assert opened.run(f"{entries}.length") == 2
    assert opened.run("[...document.querySelectorAll('#success .legend svg')].every(svg => svg.children.length > 0)")
    assert opened.run("document.querySelectorAll('main b, header b, main script:not([type])').length") == 0


def test_tables_sort_by_click_and_show_more_on_request(opened: Browser) -> None:
    table = "document.querySelector('main .table table')"
    first = f"{table}.tBodies[0].rows[0].cells[0].textContent.trim()"
    names = opened.run(f"[...{table}.tBodies[0].rows].map(r => r.cells[0].textContent.trim())")
    opened.run(f"{table}.querySelector('[data-sort=\"1\"]').click()")
    assert opened.run(first) == names[1]
    opened.run(f"{table}.querySelector('[data-sort=\"1\"]').click()")
    assert opened.run(first) == names[0]
    assert opened.run(f"{table}.tBodies[0].rows[2].cells[0].textContent.trim()") == "none"
    hidden = f"getComputedStyle({table}.querySelector('td.aside')).display"
    assert opened.run(hidden) == "none"
    opened.run("document.querySelector('main .table .more').click()")
    assert opened.run(hidden) == "table-cell"
    assert opened.run(f"[...{table}.querySelectorAll('td.best')].map(c => c.textContent.trim())") == [
        "90.0 85.0 to 94.0",
        "≤ 10⁻⁹",
    ]


def test_the_winners_come_first_and_lead_to_their_section(opened: Browser) -> None:
    assert opened.run("document.querySelector('#winners').getBoundingClientRect().bottom < 900")
    how = "getComputedStyle(document.querySelector('#winners small.how')).display"
    assert opened.run(how) == "none"
    opened.run("document.querySelector('#more-winners').click()")
    assert opened.run(how) == "block"
    assert opened.run("document.querySelector('#winners td.best').textContent").strip() == "dls λ=0.01"
    target = opened.run("document.querySelector('#winners a').getAttribute('href')")
    assert opened.run(f"document.querySelectorAll('section{target}').length") == 1


def test_keys_reach_the_content_first_and_every_control(opened: Browser) -> None:
    def tab() -> str:
        for kind in ("keyDown", "keyUp"):
            opened.send("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
        return str(opened.run("document.activeElement.className || document.activeElement.tagName"))

    opened.run("document.activeElement.blur()")
    assert tab() == "skip"
    reached = {tab() for _ in range(60)}
    assert {"A", "SELECT", "SUMMARY", "BUTTON", "scroll"} <= {word.split()[0] for word in reached}


def test_nothing_is_wider_than_a_phone(opened: Browser) -> None:
    opened.emulate(width=390)
    opened.until("document.documentElement.scrollWidth <= 390", 10)


def test_a_plot_is_as_wide_as_its_place_also_where_the_window_stays(opened: Browser) -> None:
    plot = "document.querySelector('.plot.js-plotly-plot')"
    opened.run(f"{plot}.parentElement.style.width = '300px'")
    opened.until(f"{plot}.querySelector('.main-svg').getBoundingClientRect().width <= 301", 10)
    opened.run(f"{plot}.parentElement.style.width = ''")


def test_print_says_what_was_chosen_and_shows_everything(opened: Browser, tmp_path: Path) -> None:
    opened.send("Emulation.setEmulatedMedia", media="", features=[{"name": "prefers-color-scheme", "value": "dark"}])
    opened.run("addEventListener('beforeprint', () => { window.seen = [document.querySelectorAll('details:not([open])').length,"
               " getComputedStyle(document.documentElement).getPropertyValue('--paper')]; })")  # fmt: skip
    opened.pdf(tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")
    assert opened.run("window.seen") == [0, "#ffffff"]
    assert opened.run("document.querySelectorAll('details:not([open])').length") > 0
    said = opened.run("[...document.querySelectorAll('.chosen')].map(p => p.textContent)")
    assert said
    assert all(words.strip() for words in said)


def test_methods_that_look_alike_have_another_dash() -> None:
    assert {method_dash(i) for i in range(METHOD_COLOURS)} == {"solid", "dash", "dot", "dashdot"}
    assert method_dash(0) != method_dash(METHOD_COLOURS)
