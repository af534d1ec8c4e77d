"""The sections of the page in their order: those of the kinds that were run, and those that every page has."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path, PurePath
from typing import Any

from benchmarks.blocks.base import Kind
from benchmarks.experiments.base import FAILS, HOLDS, PAPER_TITLE, PARTLY, Finding
from benchmarks.records import slug
from benchmarks.report.base import Run, Section, load_report
from benchmarks.report.numbers import listed
from benchmarks.report.tables import Cell, Column, Table
from optik.registry import short_name

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


def asked(run: Run) -> dict[str, Any] | None:
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


def provenance(run: Run) -> dict[str, Any]:
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


def failures(run: Run) -> dict[str, Failures]:
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
    for one in failures(run).get(kind.name, []):
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
    labels = dict.fromkeys(str(one["label"]) for found in failures(run).values() for one in found)
    return f"Failures or crashes: {listed(labels)}." if labels else ""


# ---------------------------------------------------------------- the page

CLOSING = (
    Section("The paper's claims", "claims", claims, _TEMPLATES / "claims.html.j2", 100),
    Section("Known limitations", "limitations", limitations, _TEMPLATES / "limitations.html.j2", 120),
    Section("Acceptance targets", "asked", asked, order=125),
    Section("Provenance", "provenance", provenance, _TEMPLATES / "provenance.html.j2", 130),
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
