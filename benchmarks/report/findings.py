"""Sections: the claims with their verdicts, the misprints, what limits all this, and where it comes from."""

from __future__ import annotations

from typing import Any

from benchmarks.experiments.base import FAILS, HOLDS, PARTLY
from benchmarks.report.run import Run

BADGES = {HOLDS: "good", FAILS: "bad", PARTLY: "partly"}


def claims(run: Run) -> dict[str, Any] | None:
    """Every claim of the paper and what this run says of it; nothing where it only measures speed."""
    if not run.suite.blocks and run.suite.line is None:
        return None
    return {"findings": [(f, badge(f.verdict)) for f in run.findings]}


def badge(verdict: str) -> str:
    """Look of a verdict."""
    return next(
        (look for words, look in BADGES.items() if verdict == words or (words == PARTLY and verdict.startswith(words))),
        "none",
    )


def misprints(run: Run) -> dict[str, Any] | None:
    """The paper's misprints with what computing them shows; nothing where the run only measures speed."""
    if not run.suite.blocks and run.suite.line is None:
        return None
    from benchmarks.experiments.misprints import evidence

    return {"misprints": evidence(run.folder)}


def limitations(run: Run) -> dict[str, Any]:
    """What a reader should know before quoting."""
    provenance = run.manifest["provenance"]
    workers, cores = provenance.get("workers"), provenance.get("cores")
    robots = sorted(run.suite.robots)
    sparse = [b for b in run.blocks if b.paired["problem"].n_unique() < b.problems()[0]]
    items = [
        f"One arm only: {robots[0]}." if len(robots) == 1 else f"Only these arms: {', '.join(robots)}.",
        f"Times were taken with {workers} worker process{'es' if workers != 1 else ''} on {cores} cores of one machine "
        f"({provenance.get('cpu')}) that may have had other work; they include the call from Python. Ratios between methods "
        "say more than microseconds.",
        "An iteration of one method is not the work of another's: compare iterations within a method, and times between them.",
        "Rates are of these targets and this start; the Wilson intervals say how well the number of targets determines them, "
        "not what other targets would give.",
    ]
    if run.suite.blocks:
        items += [
            "A run that ends by itself before its budget is timed once and counted for every larger budget.",
            "In blocks with iteration budgets every method gets one attempt from the given start: no restarts, which the "
            "paper's iteration does not have.",
        ]
    if run.suite.speed:
        items += [
            "Calls are timed in a loop over different targets, with code and tables in the processor's caches: a call that "
            "comes alone after other work takes longer. Timing runs with the garbage collector off.",
            "Closed-form peers look for every branch, ours for one answer near the start; a peer that races threads of its own "
            "is timed with them. Peers have the settings that served them best on the paper's arm, as their rows say.",
        ]
    if any(b.block.set == "graph_paper" for b in run.blocks):
        items.append(
            "“No known solution” means that a reference solve with restarts found none, nor any method here. It is no proof "
            "that the target is out of reach. Graph-paper targets all have the start's orientation."
        )
    if sparse:
        items.append(
            "Some methods were run on a part of the problems. The tables compare on the problems that all were run on; plots "
            "that do otherwise say so."
        )
    if run.solved_plans:
        items += [
            "The tool's distance from the line is a bound that holds at every instant, at most 5 % (or a nanometre) above the "
            "largest value found. Worst velocities, accelerations and jerks are exact, from the roots of "
            "the polynomials' derivatives.",
            "The joints' velocity, acceleration and jerk limits are the robot file's; the paper gives none. No dynamics, no "
            "torque limits, no controller, no measured arm.",
        ]
    if run.suite.timing:
        items += [
            "T* is the shortest motion known, not a proved optimum: another law could be shorter still.",
            "Lines are drawn so that the whole line can be followed inside the joint limits; none passes nearer to a "
            "singularity than a smallest singular value of 0.02. The limits are the suite's, the same on every joint, not the "
            "robots' own.",
            "Peers time the joint path that our follower made, with its exact derivatives where they take them; what they "
            "answer is judged as it is, never slowed until it keeps the limits, while ours are.",
        ]
    if any(p["law"] == "toppra" for p in run.solved_plans):
        items.append(
            "TOPP-RA sets its limits at the points of its grid: between them a ratio may be a few millionths above 1, less on "
            "a finer grid. It has no jerk limit by design."
        )
    return {"items": items}


def provenance(run: Run) -> dict[str, Any]:
    """Where the numbers come from, and how to get them again."""
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
    ]
    command = run.manifest.get("command") or f"optik bench run {run.manifest['suite']} --out RUN"
    return {"rows": rows, "command": command, "report": "optik bench report RUN"}
