"""The published results: complete runs without paths of a machine, and each number of the tables is one of a file."""

from __future__ import annotations

import csv
import json
import re
from typing import NamedTuple

import pytest

from docs import results
from tests.oracles import REPOSITORY

RESULTS = REPOSITORY / "benchmarks/results"
PAGE, README = RESULTS / "README.md", REPOSITORY / "README.md"
RUNS = sorted(file.parent.name for file in RESULTS.glob("*/run.json"))
NUMBER = r"[\d,]*\.?\d+"


class Row(NamedTuple):
    what: str
    ours: str
    peer: str
    ratio: str


def rows_of(page: str) -> list[Row]:
    table = re.search(r"<!-- results -->\n(.*?)<!-- end -->", page, re.S)
    assert table
    cells = [[cell.strip() for cell in line.split("|")[1:5]] for line in table[1].splitlines()[2:]]
    return [Row(*row) for row in cells]


def read(file: str) -> list[dict[str, str]]:
    with (RESULTS / file).open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def value_of(source: dict[str, str]) -> float:
    where = dict(pair.split("=", 1) for pair in source["where"].split("; "))
    (row,) = (row for row in read(source["file"]) if all(row[key] == value for key, value in where.items()))
    return float(row[source["column"]])


def rounds_to(text: str, value: float) -> bool:
    """Whether a text is a value rounded to the text's last digit; zeros before the point may be rounded ones."""
    digits = text.replace(",", "")
    unit = 10.0 ** -len(digits.partition(".")[2]) if "." in digits else 10.0 ** (len(digits) - len(digits.rstrip("0")))
    return abs(float(digits) - value) <= 0.5 * unit * (1.0 + 1e-9)


@pytest.mark.parametrize("page", [PAGE, README])
def test_each_number_of_a_table_is_one_of_a_published_file(page) -> None:
    sources = read("numbers.csv")
    for row in rows_of(page.read_text(encoding="utf-8")):
        if "not run" in (row.ours, row.peer):
            continue
        what = re.sub(r" \[[^]]*\]$", "", row.what)
        values: dict[str, list[float]] = {}
        for side, cell in (("ours", row.ours.strip("*")), ("peer", row.peer.rpartition(": ")[2])):
            mine = [one for one in sources if (one["row"], one["side"]) == (what, side)]
            shown = re.findall(NUMBER, cell)
            assert shown == [one["text"] for one in mine], what
            values[side] = [value_of(one) for one in mine]
            for text, value in zip(shown, values[side], strict=True):
                assert rounds_to(text, value), (what, text, value)
                assert text != "100" or value == 100.0, "a failure is not rounded away"
        ratios = [b / a for a, b in zip(values["ours"], values["peer"], strict=True) if a]
        for text in re.findall(NUMBER, row.ratio):
            way = -1.0 if "% certified" in row.what else 1.0  # a rate is better if it is larger
            assert any(rounds_to(text, ratio**way) for ratio in ratios), (what, text)


def test_the_page_has_twelve_rows_and_the_readme_those_that_were_run() -> None:
    long, short = (rows_of(page.read_text(encoding="utf-8")) for page in (PAGE, README))
    assert len(long) == 12
    assert [row for row in long if "not run" not in (row.ours, row.peer)] == short
    assert [*results.draw_tables()] == [
        re.search(r"<!-- results -->\n(.*?)\n<!-- end -->", page.read_text(encoding="utf-8"), re.S)[1]  # type: ignore[index]
        for page in (PAGE, README)
    ], "python -m docs.results --page"


def test_the_readme_s_words_on_false_claims_are_those_of_the_run() -> None:
    (row,) = (row for row in read("ik-speed/tables/calls-hard-cold.csv") if row["label"] == "EAIK")
    assert f"on {int(row['false_claims']):,} of the 100,000" in " ".join(README.read_text(encoding="utf-8").split())


@pytest.mark.parametrize("name", RUNS)
def test_a_published_run_is_complete_and_says_where_it_is_from(name: str) -> None:
    text = (RESULTS / name / "run.json").read_text(encoding="utf-8")
    run = json.loads(text)
    assert run.get("complete", True)
    assert run.get("failed", []) == []
    assert {"commit", "cpu", "versions"} <= set(run["provenance"])
    assert not run["provenance"]["dirty"]
    assert not re.search(r"[\" ]/\w|\"[A-Z]:\\\\", text)  # no path of the machine it ran on
    assert any((RESULTS / name / "tables").glob("*.csv"))


def test_each_published_figure_has_a_source_a_version_and_a_machine() -> None:
    assert all(all(row.values()) for row in read("published.csv"))


def test_the_links_of_the_published_results_exist() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)#:]+)\)", text):
        assert (RESULTS / link).exists(), link
    heads = {re.sub(r"\W+", "-", head.lower()) for head in re.findall(r"^## (.+)$", text, re.M)}
    assert set(re.findall(r"\]\(#([^)]+)\)", text)) <= heads


def test_a_part_without_its_files_is_a_row_that_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setattr(results, "RESULTS", tmp_path)
    long, short = results.draw_tables()
    assert long.count("not run | not run") == 12
    assert len(short.splitlines()) == 2
