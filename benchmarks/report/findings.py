"""Sections: the claims with their verdicts, the misprints, the limitations, the acceptance targets, the provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, Finding
from benchmarks.experiments.counterparts import PAPER_TITLE
from benchmarks.records import slug
from benchmarks.report.base import load_report
from benchmarks.report.run import Run
from benchmarks.report.tables import target_row
from optik.registry import short_name

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


def misprints(run: Run) -> dict[str, Any] | None:
    """Show the paper's misprints with their evidence; nothing if the run only measures speed."""
    if not run.on_paper:
        return None
    from benchmarks.experiments.misprints import evidence

    return {"misprints": evidence(run.folder)}


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
    return {"words": words, "targets": [target_row(o) for o in found]}


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
