"""The report as one self-contained HTML page: findings, sections in their order, and rankings."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import groupby
from pathlib import Path, PurePath
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from benchmarks.blocks.base import Kind
from benchmarks.experiments.base import FAILS, HOLDS, PAPER_METHOD, PAPER_TITLE, PARTLY, Finding
from benchmarks.records import RunFolder, slug
from benchmarks.report.base import Run, Section, Winner, load_report
from benchmarks.report.boards import THEME, packed, squeeze, strict, template, variable
from benchmarks.report.tables import Cell, Column, Table, listed, number, percent, quote_label, shown_rows, written
from benchmarks.statistics import mcnemar, not_told_apart, percentage
from optik.errors import UnknownName
from optik.plugins.files import forbid_code
from optik.registry import short_name
from optik.types import Flags

# ---------------- the sections of the page in their order


_TEMPLATES = Path(__file__).parent / "templates"
"""Folder of the templates of the frame."""

BADGES = {HOLDS: "good", FAILS: "bad", PARTLY: "partly"}
"""Look of each verdict."""


def claims(run: Run) -> dict[str, Any] | None:
    """Show every claim of the paper with this run's verdict; nothing if the run only measures speed."""
    if not run.on_paper:
        return None
    return claims_of(run.findings)


def claims_of(findings: Sequence[Finding]) -> dict[str, Any]:
    """Return the data for the template of claims."""
    return {"paper": PAPER_TITLE, "findings": [(f, badge(f.verdict)) for f in findings]}


def badge(verdict: str) -> str:
    """Look of a verdict."""
    return next(
        (look for words, look in BADGES.items() if verdict == words or (words == PARTLY and verdict.startswith(words))),
        "none",
    )


def limitations(run: Run) -> dict[str, Any]:
    """List the limitations of the results."""
    provenance = run.manifest["provenance"]
    workers, cores = provenance.get("workers"), provenance.get("cores")
    robots = sorted(map(short_name, run.suite.robots))
    items = (
        [f"One arm only: {robots[0]}." if len(robots) == 1 else f"Only these arms: {', '.join(robots)}."]
        if robots
        else []
    )
    items += [
        f"Times were measured with {workers} worker process{'es' if workers != 1 else ''} on {cores} cores of one machine "
        f"({provenance.get('cpu')}), possibly under other load. They include the call from Python. Ratios between methods "
        "are more reliable than absolute times.",
        "An iteration of one method may cost more than one of another: compare iterations within one method, and times "
        "between methods.",
        "Success rates hold for these targets and this start. The Wilson intervals account for the number of targets, "
        "not for other targets or another start.",
    ]
    for kind in run.suite.kinds:
        items += load_report(kind).limitations(run)
    return {"items": items}


def targets_section(run: Run) -> dict[str, Any] | None:
    """Return the acceptance targets of the suite with their outcomes."""
    found = run.outcomes
    if not found:
        return None
    held, unknown = sum(o.held is True for o in found), sum(o.held is None for o in found)
    words = f"{held} of {len(found)} targets met"
    words += f", {unknown} not measured." if unknown else "."
    return {"words": [words], "tables": [asked_table(run)]}


ASKED_COLUMNS = (
    Column("label", "Measure", show="text"),
    Column("where", "Block", show="text"),
    Column("value", "value", show="mixed"),
    Column("asked", "target", show="text"),
    Column("unit", "unit", show="text"),
    Column("held", "outcome", show="verdict"),
    Column("note", "sample", show="text"),
)
"""Columns of the table of targets."""


def asked_table(run: Run) -> Table | None:
    """Return every acceptance target of the suite with its outcome."""
    words = {True: "met", False: "missed", None: "not measured"}
    rows: list[dict[str, Cell]] = [
        {
            "label": o.what, "where": o.where, "value": None if math.isnan(o.value) else o.value, "asked": o.asked,
            "unit": o.unit or None, "note": o.note, "held": words[o.held] + (" (a goal)" if o.target.goal else ""),
            "show": "exact" if o.measure.show == "exact" else "number",
        }
        for o in run.outcomes
    ]  # fmt: skip
    title = "Acceptance targets of the suite, and the values of this run"
    return Table("asked", title, ASKED_COLUMNS, tuple(rows)) if rows else None


def provenance_section(run: Run) -> dict[str, Any]:
    """Show code, versions and machine of the run, and the command that repeats it."""
    p = run.manifest["provenance"]
    commit = p.get("commit")
    state = "" if not commit else (" with uncommitted changes" if p.get("dirty") else " (clean)")
    versions = ", ".join(f"{name} {version}" for name, version in p.get("versions", {}).items() if version)
    rows = [
        ("suite", run.manifest["suite"]),
        ("settings", f"SHA-256 {run.manifest['fingerprint']}… (first 16 digits, over all settings)"),
        ("seed", p.get("seed")),
        ("created", p.get("created")),
        ("code", f"commit {commit}{state}" if commit else "an installed package"),
        ("versions", versions),
        ("Python", p.get("python")),
        ("machine", f"{p.get('cpu')}, {p.get('cores')} cores, {p.get('system')}"),
        ("worker processes", p.get("workers")),
        *_problem_rows(run),
        *((f"plug-in {row['name']} ({row['group']})", _plugin_words(row)) for row in run.manifest.get("plugins", [])),
    ]
    command = run.manifest.get("command") or f"optik bench run {run.manifest['suite']} --out RUN"
    return {"rows": rows, "command": command, "report": "optik bench report RUN"}


def _problem_rows(run: Run) -> list[tuple[str, str]]:
    """Return the number of problems of each block and their hash, by which runs with the same problems are recognised."""
    rows = []
    for _, block in run.suite.pairs():
        about = run.folder.read_json(f"problems/{slug(block.id)}.json")
        if about is not None:
            known = f", {about['known']:,} with a known solution" if "known" in about else ""
            of = f" (of {about['sha256_of']})" if "sha256_of" in about else ""
            words = f"{about['problems']:,}{known}, SHA-256 {about['sha256'][:16]}…{of}"
            rows.append((f"problems of {block.id}", words))
    return rows


def _plugin_words(row: Mapping[str, str]) -> str:
    """Return file or package of a plug-in, and its version. Folders are not named, because a report may be published."""
    if "sha256" in row:
        return f"{PurePath(row['path'].replace(chr(92), '/')).name}, SHA-256 {row['sha256']}"
    return f"{row['distribution']} {row['version']}"


# ---------------------------------------------------------------- failures

FAILURE_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("block", "Problems", show="text"),
    Column("times", "times", show="count"),
    Column("why", "why", show="text"),
    Column("files", "files with missing rows or crashes", show="count", aside=True),
)
"""Columns of the table of failures."""

Failures = list[dict[str, Any]]


def failures_section(run: Run) -> dict[str, Failures]:
    """Return the failures in `run.json` by the name of their block's kind."""
    found: dict[str, Failures] = {}
    for one in run.manifest.get("failed", []):
        kind, block = _whose(run, str(one["file"]))
        found.setdefault(kind.name, []).append({**one, "block": block})
    return found


def _whose(run: Run, file: str) -> tuple[Kind, str]:
    """Return the kind that wrote or should have written a file, and the title of the block."""
    pairs = list(run.suite.pairs())
    for kind, block in pairs:
        if file.startswith((kind.file(block), kind.file(block, "", "*").removesuffix("*."))):
            return kind, block.title
    return pairs[0][0], file.rpartition("/")[2]


def failure_table(kind: Kind, run: Run) -> Table | None:
    """Return the failures of a kind, each method and reason once."""
    counted: dict[tuple[str, str, str], list[int]] = {}
    for one in failures_section(run).get(kind.name, []):
        of = counted.setdefault((str(one["label"]), str(one["block"]), str(one["why"])), [0, 0])
        of[0] += int(one["times"])
        of[1] += 1
    rows: tuple[Mapping[str, Cell], ...] = tuple(
        {"label": label, "block": block, "why": why, "times": times, "files": files}
        for (label, block, why), (times, files) in counted.items()
    )
    note = "A part that fails is repeated in smaller pieces. Problems in which a method crashed count as not solved."
    return Table(f"failed-{slug(kind.name)}", f"{kind.title}: failures", FAILURE_COLUMNS, rows, note) if rows else None


def failure_section(kind: Kind, home: Section, run: Run) -> Section | None:
    """Return a piece of a kind's own section with the table of failures."""
    table = failure_table(kind, run)
    if table is None:
        return None
    return Section(home.title, home.anchor, lambda run: {"tables": [table]}, order=home.order)


def home_of(kind: Kind, sections: Sequence[Section]) -> Section:
    """Return the report section that lists a kind's failures: the section with the kind's title, else its first one."""
    own = sorted((s for s in sections if s.place == "section"), key=lambda section: section.order)
    return next((section for section in own if section.title == kind.title), own[0])


def failure_words(run: Run) -> str:
    """Describe the failures in a sentence for the head of the report."""
    labels = dict.fromkeys(str(one["label"]) for found in failures_section(run).values() for one in found)
    return f"Failures or crashes: {listed(labels)}." if labels else ""


# ---------------------------------------------------------------- the page

CLOSING = (
    Section("The paper's claims", "claims", claims, _TEMPLATES / "claims.html.j2", 100),
    Section("Known limitations", "limitations", limitations, _TEMPLATES / "limitations.html.j2", 120),
    Section("Acceptance targets", "asked", targets_section, order=125),
    Section("Provenance", "provenance", provenance_section, _TEMPLATES / "provenance.html.j2", 130),
)
"""Last sections of every page, for all kinds."""


def all_sections(run: Run) -> list[Section]:
    """Return the sections of all kinds that were run, and the last sections of the page."""
    found: dict[Section, None] = {}
    for kind in run.suite.kinds:
        own = load_report(kind).sections
        failed = failure_section(kind, home_of(kind, own), run)
        found |= dict.fromkeys([*own, *([] if failed is None else [failed])])
    return sorted((*found, *CLOSING), key=lambda section: section.order)


def built(run: Run, place: str) -> list[tuple[Section, list[tuple[Section, dict[str, Any]]]]]:
    """Return the sections that are not empty, each with its pieces: those with the same anchor."""
    shown = []
    for _, group in groupby((s for s in all_sections(run) if s.place == place), key=lambda section: section.anchor):
        pieces = [(section, context) for section in group if (context := section.build(run)) is not None]
        if pieces:
            shown.append((pieces[0][0], pieces))
    return shown


# ---------------- who wins


RANKED_PROBLEMS = 1000
"""Number of problems that suffices for a ranking: Wilson's interval of a rate is then 6 points wide, 0.4 near 100 %."""

MOST_TIED = 3
"""Number of ties that are named; of more only their number is given."""

WINNER_COLUMNS = (
    Column("question", "Question", show="text"),
    Column("best", "Best", show="text"),
    Column("value", "Value", show="mixed"),
    Column("unit", "Unit", show="text"),
    Column("tied", "Not significantly different", show="text"),
    Column("second", "Next", show="text"),
    Column("second_value", "Value of the next", show="mixed"),
    Column("note", "Problems", show="text"),
)
"""Columns of the winners as a table."""


# ---------------------------------------------------------------- ranking


@dataclass(frozen=True)
class MethodRanking:
    """The ranked methods, and the others with how many problems they were given, in words that end a note."""

    labels: tuple[str, ...]
    left_out: str


def rank_methods(given: Mapping[str, int]) -> MethodRanking:
    """Rank methods that were given `RANKED_PROBLEMS`, or half the largest number: all are compared on the fewest of the ranked.

    Where that leaves fewer than two, all are ranked.
    """
    most = max(given.values(), default=0)
    asked = tuple(label for label, count in given.items() if count)
    many = tuple(label for label in asked if given[label] >= min(RANKED_PROBLEMS, most / 2))
    labels = many if len(many) > 1 else asked
    out = [f"{quote_label(label)} ({count:,})" for label, count in given.items() if label not in labels]
    return MethodRanking(labels, f"; not ranked (fewer problems): {', '.join(out)}" if out else "")


def most_solved(question: str, anchor: str, solved: Mapping[str, Flags], note: str) -> Winner:
    """Return the method that solved the most of the same problems, and those not significantly different (McNemar's test)."""
    entries = sorted(((label, *percentage(int(x.sum()), len(x))) for label, x in solved.items()), key=lambda e: -e[1])
    best = entries[0][0]
    p_values = {label: mcnemar(solved[best], x).p for label, x in solved.items() if label != best}
    return Winner(
        question, "%", "more", tuple(entries), anchor, note, "Wilson 95 % intervals; differences by McNemar's test",
        not_told_apart(best, p_values), len(solved[best]),
    )  # fmt: skip


# ---------------------------------------------------------------- questions


@dataclass(frozen=True)
class Place:
    """One entry of a question, as the page shows it."""

    label: str
    value: str
    interval: str


@dataclass(frozen=True)
class QuestionResult:
    """One question with its winner, as the page shows it."""

    asked: Winner
    best: Place
    level: tuple[str, ...]
    """The best and those that stand beside it; of many only the first are named."""
    remark: str
    second: Place | None


def winners(run: Run) -> list[Winner]:
    """Return every question with its entries, in the order of the kinds."""
    return [winner for kind in run.suite.kinds for winner in load_report(kind).winners(run) if winner.entries]


def won(run: Run) -> list[QuestionResult]:
    """Return the winners as the first screen of the page shows them."""
    found = []
    for winner in winners(run):
        tied, second = _order(winner)
        other = None if second is None else _place(winner, second)
        level = (winner.entries[0][0], *(tied if len(tied) <= MOST_TIED else tied[: MOST_TIED - 1]))
        found.append(QuestionResult(winner, _place(winner, 0), level, _remark(winner, tied), other))
    return found


MOST_FINDINGS = 6
"""Largest number of questions that the key findings answer in words; the table has all."""


def _finding(found: QuestionResult) -> str:
    """Return the answer of a question as a sentence."""
    also = f", as {listed(found.level[1:])}" if len(found.level) > 1 else ""
    other = f"; next is {found.second.label} with {found.second.value}" if found.second else ""
    return f"{found.asked.question}: {found.best.label} with {found.best.value}{also}{other}."


def _remark(winner: Winner, tied: tuple[str, ...]) -> str:
    """Say why entries stand beside the best, how many are not named, and if there are too few values for a test."""
    if not tied:
        return f"ranked by value{winner.sample}" if winner.is_too_few else ""
    words = "same value" if winner.is_too_few else "no significant difference"
    more = f"and {len(tied) - MOST_TIED + 1} more: " if len(tied) > MOST_TIED else ""
    return f"{more}{words}{winner.sample}"


def _order(winner: Winner) -> tuple[tuple[str, ...], int | None]:
    """Return the labels tied with the best, and the first entry that is not; None if all are tied."""
    level = winner.tied
    tied = tuple(label for label in level if label != winner.entries[0][0])
    rest = [k for k, entry in enumerate(winner.entries) if entry[0] not in level]
    return tied, rest[0] if rest else None


def _place(winner: Winner, rank: int) -> Place:
    label, middle, low, high = winner.entries[rank]
    share = winner.unit == "%"
    value, interval = written("share" if share else "precise" if low == high else "number", middle, low, high)
    return Place(label, f"{value} {winner.unit}".rstrip(), interval)


def winners_table(run: Run) -> Table | None:
    """Return the winners as a table for other formats."""
    rows: list[dict[str, Cell]] = []
    for winner in winners(run):
        label, *value = winner.entries[0]
        tied, second = _order(winner)
        few = f"ranked by value{winner.sample}" if winner.is_too_few else ""
        row: dict[str, Cell] = {
            "question": winner.question, "best": label, "value": (value[0], value[1], value[2]), "unit": winner.unit,
            "tied": listed(tied),
            "note": "; ".join(words for words in (winner.note, winner.how, few) if words),
        }  # fmt: skip
        if second is not None:
            other, *ends = winner.entries[second]
            row |= {"second": other, "second_value": (ends[0], ends[1], ends[2])}
        rows.append(row)
    return Table("winners", "Best method by question", WINNER_COLUMNS, tuple(rows)) if rows else None


# ---------------------------------------------------------------- the head of the page


def overview(run: Run) -> dict[str, Any]:
    """Return subjects, scope and key findings of the comparison."""
    started = [b.block for b in run.blocks_with_rows]
    own = [words for kind in run.suite.kinds for words in load_report(kind).findings(run)]
    best = won(run)
    return {
        "title": run.suite.title,
        "suite": run.suite.name,
        "complete": bool(run.manifest.get("complete")),
        "failed": failure_words(run),
        "created": run.manifest["provenance"].get("created", ""),
        "robots": [(short_name(name), _axes(run, name)) for name in run.suite.robots],
        "subjects": _subjects(run),
        "missing": [block.title for _, block in run.suite.pairs() if block not in started],
        "findings": [*map(_finding, best[:MOST_FINDINGS]), *filter(None, own)],
        "paper": {"title": PAPER_TITLE, "method": PAPER_METHOD, "verdict": _verdicts(run)} if run.on_paper else None,
        "won": best,
    }


def _axes(run: Run, name: str) -> str:
    try:
        return f"{run.robot(name).n} joints"
    except UnknownName:  # a robot that this version has no longer
        return "not in this version"


def _subjects(run: Run) -> str:
    """Describe the compared subjects; one that is part of a more specific subject is left out."""
    found = dict.fromkeys(
        words for kind in run.suite.kinds for words in load_report(kind).subjects(run.suite.of(kind.name))
    )
    own = [words for words in found if not any(other != words and other.startswith(words) for other in found)]
    return ", and ".join(own) + ("," if len(own) > 1 else "")


def _verdicts(run: Run) -> str:
    """Describe how many claims hold."""
    verdicts = Counter(PARTLY if f.verdict.startswith(PARTLY) else f.verdict for f in run.findings)
    words = {
        "holds": ("holds", "hold"), PARTLY: ("holds under a condition", "hold under a condition"),
        "does not hold": ("does not hold", "do not hold"), "not tested": ("is not tested here", "are not tested here"),
    }  # fmt: skip
    parts = [f"{verdicts[v]} {one if verdicts[v] == 1 else many}" for v, (one, many) in words.items() if v in verdicts]
    return f"of its {sum(verdicts.values())} claims, " + ", ".join(parts) + "."


# ---------------- the report as one self-contained HTML page


PAGE = "report.html"
"""Name of the page in the run folder."""


@forbid_code()
def write_report(folder: RunFolder) -> Path:
    """Write ``report.html`` into a run folder: one file that opens offline."""
    folder.write_text(PAGE, render(Run(folder)))
    return folder.path / PAGE


def render(run: Run) -> str:
    """Return the page as text."""
    environment = Environment(
        loader=PackageLoader("benchmarks.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "percent": percent, "strict": strict, "variable": variable}
    environment.filters["shown"] = shown_rows
    environment.filters["dot"] = lambda label: variable(run.colour(label)) if label in run.labels else ""
    environment.filters["packed"] = lambda board: packed(board, run.labels)
    placed = {place: built(run, place) for place in ("top", "terms", "summary", "section")}
    return environment.get_template("page.html.j2").render(
        head=overview(run),
        **placed,
        template_of=lambda piece: _template(environment, piece),
        style=_asset("page.css"),
        script=_asset("page.js"),
        plotly=_plotly(),
        look={"template": template().to_plotly_json(), "variables": {value: name for name, value in THEME.items()}},
    )


def _template(environment: Environment, section: Section) -> Template:
    """Return the template of a section: its file, or its text."""
    text = section.template.read_text(encoding="utf-8") if isinstance(section.template, Path) else section.template
    return environment.from_string(text)


def _asset(name: str) -> Markup:
    return Markup(files("benchmarks.report").joinpath("templates", name).read_text(encoding="utf-8"))


@cache
def _plotly() -> Markup:
    """Return Plotly's library, compressed: the same for every page of this process."""
    from plotly.offline import get_plotlyjs

    return Markup(squeeze(get_plotlyjs().encode()))
