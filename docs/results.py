"""The published results: ``make results`` runs every part that is not finished and writes benchmarks/results anew.

``python -m docs.results --page`` only writes the tables and plots of benchmarks/results/README.md and the table of README.md,
from the CSV files that are there. ``numbers.csv`` has the source of each number of both tables.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.provenance import provenance

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results"
PAGE, README = RESULTS / "README.md", ROOT / "README.md"
OURS = {
    "lm", "sqp", "ipopt", "closed_form", "quintic", "smooth", "ruckig", "optimal", "path and time", "own, rounded", "stream",
    "stream, nearest",
}  # fmt: skip
"""Labels that are no peers."""
BRANCHES, BATCH = "branches/tables/branches.csv", "branches/tables/batch.csv"
REGULAR, TORQUE = "timing/tables/timing-lines-regular.csv", "torque/tables/timing-torque-joints.csv"
PANDA = "chunks/tables/chunks-panda.csv"
SPHERES, RULES, WORLDS = (
    "obstacles/tables/motion-peers.csv",
    "obstacles/tables/motion-curobo.csv",
    "worlds/tables/worlds.csv",
)
OBSTACLES = {
    "obstacles: MotionBenchMaker's Panda on VAMP's spheres": SPHERES,
    "obstacles: the same after cuRobo's rules": RULES,
    "worlds of provably safe planners (ARMOUR, SPARROWS)": WORLDS,
}
"""Files of several rows and plots."""
ENOUGH = 99.0
"""Least success rate [%] of the best peer of IK, if any has it: then the fastest one is the best."""

# ---------------------------------------------------------------- measurements


class Part(NamedTuple):
    """A part of the results: its folder, a suite, and a file without which it is not run."""

    name: str
    suite: str
    needs: str = ""


PARTS = (
    Part("ik-speed", "ik-speed"),
    Part("seven", str(RESULTS / "seven.toml")),
    Part("timing", "timing"),
    Part("torque", str(RESULTS / "torque.toml")),
    Part("chunks", "chunks"),
    Part("obstacles", "obstacles.toml", "panda.tar.bz2"),
    Part("seams", "seams"),
)
"""The parts that are suites."""


def run_parts(out: Path) -> None:
    """Run the parts that are not finished, then publish all; a part without its data is left out, and says so.

    Nothing is published before the end, so that the checkout is that of the commit in all parts.
    """
    made = list[str]()
    for part in PARTS:
        begin = time.monotonic()
        if part.needs and not Path(part.needs).exists():
            print(f"not run: {part.name}, which needs {part.needs} in the working folder")
            continue
        if part.needs:  # files in a suite are relative to it
            shutil.copy(RESULTS / part.suite, part.suite)
        bench = [sys.executable, "-P", "-m", "benchmarks.cli", "bench"]
        env = os.environ | {"PYTHONPATH": str(ROOT)}
        for words in (
            ["run", part.suite, "--out", str(out / part.name)],
            ["report", str(out / part.name), "--format", "csv"],
        ):
            if subprocess.run([*bench, *words], env=env, check=False).returncode not in (0, 1):
                sys.exit(f"{part.name}: stopped; repeat the command to resume")
        print(f"{part.name}: {time.monotonic() - begin:.0f} s", flush=True)
        made.append(part.name)
    if not (out / "branches").exists():
        measure_branches(out / "branches.part")
        (out / "branches.part").rename(out / "branches")
    made.append("branches")
    if "RIVALS" in os.environ:
        measure_worlds(out / "worlds")
        made.append("worlds")
    else:
        print("not run: worlds, whose data RIVALS names (tests/figures/rivals.py, hjcd.py)")
    for name in made:
        publish(out / name, name)


def publish(run: Path, name: str) -> None:
    """Copy the manifest, without the working folder, and the tables of a run."""
    shutil.rmtree(RESULTS / name / "tables", ignore_errors=True)
    shutil.copytree(run / "tables", RESULTS / name / "tables")
    words = (run / "run.json").read_text(encoding="utf-8")
    words = re.sub(r'(?<=[" ])/[^" ]*/', "", words)  # no path of this machine
    (RESULTS / name / "run.json").write_text(words, encoding="utf-8")


def measure_branches(out: Path, count: int = 1000) -> None:
    """Time all branches of random poses of the paper6r, filtered by the limits, and batches on all cores."""
    import optik
    from benchmarks.peers.ik.eaik import EAIK
    from benchmarks.peers.ik.ssik import SSIK, _module  # the generated module, without a limit on the solutions
    from benchmarks.problems.random_reachable import METHOD as RandomReachable
    from optik.ik import make_solver

    robot, cores = optik.load("paper6r"), len(os.sched_getaffinity(0))
    targets = RandomReachable(robot, 2026, count=10_000).targets
    low, high = robot.limits.lower, robot.limits.upper
    eaik, ssik = EAIK(robot), _module(SSIK(robot).arm).solve
    closed, lm = make_solver(robot, "closed_form"), make_solver(robot, "lm")

    def keep(q: np.ndarray) -> np.ndarray:
        q = np.remainder(np.asarray(q).reshape(-1, robot.n) + np.pi, 2.0 * np.pi) - np.pi
        return q[((q >= low) & (q <= high)).all(axis=1)]

    def of_eaik(target: np.ndarray) -> np.ndarray:
        found = eaik.call(target)
        return keep(found.Q[~np.asarray(found.is_LS)] if len(found.Q) else np.empty((0, robot.n)))

    ways: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "closed_form": lambda target: closed.branches(target).q,
        "EAIK": of_eaik,
        "ssik": lambda target: np.array([one.q for one in ssik(target)]).reshape(-1, robot.n),
    }
    rows, taken = [], {label: np.empty((3, count)) for label in ways}
    answers: dict[str, list[np.ndarray]] = {}
    for turn in range(3):
        for label, call in ways.items():
            call(targets[0])
            answers[label] = []
            for k, target in enumerate(targets[:count]):
                begin = time.perf_counter()
                q = call(target)
                taken[label][turn, k] = time.perf_counter() - begin
                answers[label].append(q)
    for label, found in answers.items():
        good = [int((np.abs(robot.pose_errors(q, T)).max(axis=1) < 1e-6).sum()) if len(q) else 0
                for q, T in zip(found, targets, strict=False)]  # fmt: skip
        median = 1e6 * float(np.median(np.median(taken[label], axis=0)))
        rows.append({"label": label, "count": count, "branches": sum(good), "median [µs]": median})
    start = np.tile(robot.limits.clip(np.full(robot.n, 0.1)), (len(targets), 1))
    batches = []
    for size in (1, 100, 10_000):
        for label, solve in {
            "lm": lambda size=size: lm.solve_batch(targets[:size], start[:size], threads=cores),
            "EAIK": lambda size=size: eaik.arm.IK_batched(targets[:size], cores),
        }.items():
            solve()
            seconds = []
            for _ in range(10):  # the first one starts the threads
                begin = time.perf_counter()
                solve()
                seconds.append(time.perf_counter() - begin)
            batches.append(
                {
                    "label": label,
                    "targets": size,
                    "cores": cores,
                    "per target [µs]": 1e6 * min(seconds[1:]) / size,
                }
            )
    write_table(out / "tables/branches.csv", rows)
    write_table(out / "tables/batch.csv", batches)
    (out / "run.json").write_text(json.dumps({"suite": "branches", "provenance": provenance(2026, 1)}, indent=1))


def measure_worlds(out: Path) -> None:
    """Plan in the worlds of ARMOUR and SPARROWS, and solve the goals of HJCD-IK, by the scripts of these figures."""
    out.mkdir(parents=True, exist_ok=True)
    rows = {}
    for name in ("rivals", "hjcd"):
        env = os.environ | {"PYTHONPATH": str(ROOT), "FIGURES": str(out)}
        subprocess.run([sys.executable, "-W", "ignore", "-m", f"tests.figures.{name}"], env=env, cwd=ROOT, check=False)
        rows[name] = [json.loads(line) for line in (out / f"{name}.jsonl").read_text().splitlines()]
    worlds = [row for row in rows["rivals"] if "ends" in row]
    keys = ("name", "boxes", "ends", "valid", "cpu", "T", "contacts", "torque", "speed")
    write_table(out / "tables/each-world.csv", [{key: row.get(key, "") for key in keys} for row in worlds])
    keys = (*keys[:1], *keys[3:4], *keys[5:], "why")
    guides = [{key: row.get(key, "") for key in keys} for row in rows["rivals"] if "ends" not in row]
    write_table(out / "tables/guide-motions.csv", guides)
    free = [row for row in worlds if row["ends"]]
    write_table(out / "tables/worlds.csv", [{
        "label": "path and time", "problems": len(free),
        "solved [%]": 100.0 * sum(row["valid"] for row in free) / len(free),
        "median_ms [ms]": 1e3 * float(np.median([row["cpu"] for row in free])),
        "median_duration [s]": float(np.median([row["T"] for row in free if row["valid"]])),
    }])  # fmt: skip
    goals = rows["hjcd"]
    write_table(out / "tables/hjcd.csv", [{
        "label": "lm", "problems": len(goals), "solved": sum(row["solved"] for row in goals),
        "median [µs]": float(np.median([row["us"] for row in goals])),
        "median, random goals [µs]": float(np.median([row["random_us"] for row in goals])),
    }])  # fmt: skip
    outside = [
        {"goal": row["case"], "least widening of all ranges [rad]": row["excess"]} for row in goals if not row["solved"]
    ]
    write_table(out / "tables/hjcd-outside.csv", outside)
    (out / "run.json").write_text(json.dumps({"suite": "worlds", "provenance": provenance(2026, 1)}, indent=1))


def write_table(file: Path, rows: list[dict]) -> None:
    """Write a CSV file."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


# ---------------------------------------------------------------- the table


class Number(NamedTuple):
    """A number of the table: its text, and where it is from: file, condition on the row, and column."""

    text: str
    file: str
    where: str
    column: str
    value: float


class Line(NamedTuple):
    """A row of the table; without numbers it was not run."""

    what: str
    unit: str = ""
    ours: tuple[Number, ...] = ()
    peer: str = ""
    theirs: tuple[Number, ...] = ()
    problems: str = ""
    section: str = ""


def read_table(file: str) -> list[dict[str, str]]:
    """Read a CSV file of the results; empty where it is missing."""
    path = RESULTS / file
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines())) if path.is_file() else []


def show(value: float) -> str:
    """Return a number with three digits, and a number near 1 or 100 with what differs from it."""
    if 0.99 < value < 1.01 and value != 1.0:
        return f"{value:.4f}"
    if 99.0 < value < 100.0:
        return f"{value:.4g}" if value < 99.99 else f"{value:.6g}"
    if value == int(value):
        return f"{value:,.0f}"
    if value >= 100.0:
        return f"{float(f'{value:.3g}'):,.0f}"
    return f"{value:.3g}" if value >= 0.1 else f"{value:.2g}"


def number(file: str, column: str, **where: str) -> Number | None:
    """Return a number of a table: of the row whose columns have some values."""
    for row in read_table(file):
        if all(row[key] == value for key, value in where.items()) and row[column] not in ("", "NaN"):
            value = float(row[column])
            return Number(show(value), file, "; ".join(f"{k}={v}" for k, v in where.items()), column, value)
    return None


def some(*found: Number | None) -> tuple[Number, ...]:
    """Return the numbers, or none if one is missing."""
    return tuple(one for one in found if one) if all(found) else ()


def best_of(file: str, column: str, rate: str = "") -> str:
    """Return the label of the peer with the least value, among those with enough success; else the most successful one."""
    rows = [row for row in read_table(file) if row["label"] not in OURS and row[column] not in ("", "NaN", "inf")]
    if rate and rows:
        most = max(float(row[rate]) for row in rows)
        rows = [row for row in rows if float(row[rate]) >= min(ENOUGH, most)]
    return min(rows, key=lambda row: float(row[column]))["label"] if rows else ""


def ik_line(what: str, six: str, seven: str) -> Line:
    """Return a row of single calls: arms with six and with seven joints."""
    ours, theirs, peers, counts = [], [], [], []
    for file in (six, seven):
        peer = best_of(file, "median [µs]", "solved [%]")
        rows = {row["label"]: row for row in read_table(file)}
        if peer:
            ours.append(some(*(number(file, key, label="lm") for key in ("solved [%]", "median [µs]"))))
            theirs.append(some(*(number(file, key, label=peer) for key in ("solved [%]", "median [µs]"))))
            peers.append(peer)
            counts.append(f"{int(rows[peer]['count']):,}")
    return Line(
        what, "%, µs", sum(ours, ()), " / ".join(peers), sum(theirs, ()), " / ".join(counts), "inverse-kinematics"
    )


def lines() -> list[Line]:
    """Return the rows of the table."""
    ik = "ik-speed/tables/calls-"
    peer, keys, sizes = best_of(BRANCHES, "median [µs]"), ("branches", "median [µs]"), ("1", "10000")
    of_all = [some(*(number(BRANCHES, k, label=one) for k in keys)) for one in ("closed_form", peer)]
    batches = [some(*(number(BATCH, "per target [µs]", label=one, targets=n) for n in sizes)) for one in ("lm", "EAIK")]
    return [
        ik_line("IK, initial guess near the solution", f"{ik}warm.csv", "seven/tables/calls-warm.csv"),
        ik_line("IK, far initial guess", f"{ik}cold.csv", f"{ik}panda-cold.csv"),
        ik_line("IK, singular or at joint limits", f"{ik}hard-cold.csv", "seven/tables/calls-hard.csv"),
        Line("all branches of 1,000 poses", "branches, µs a pose", of_all[0], peer, of_all[1], "1,000", "all-branches"),
        Line("batch on all cores, 1 / 10,000 targets", "µs a target", batches[0], "EAIK, all branches, no limits", batches[1],
             "1 / 10,000", "batches"),
        law_line("time laws on lines", REGULAR, "time-laws"),
        law_line("time laws within torque limits", TORQUE, "torque"),
        *(obstacle_line(what, file) for what, file in OBSTACLES.items()),
        seam_line(),
        stream_line(),
    ]  # fmt: skip


def law_line(what: str, file: str, section: str) -> Line:
    """Return a row of time laws: stretched to meet all limits, and their computing times."""
    peer = best_of(file, "slowed_down")
    both = [some(*(number(file, k, label=one) for k in ("slowed_down", "ms [ms]"))) for one in ("optimal", peer)]
    count = next((row["count"] for row in read_table(file) if row["label"] == peer), "0")
    return Line(what, "× shortest known, ms", both[0], peer, both[1], f"{int(count):,}", section)


OBSTACLE_KEYS = ("solved [%]", "median_ms [ms]", "median_duration [s]")
"""Columns of a table on obstacles: valid motions [%], median CPU time [ms], median duration [s]."""


def obstacle_line(what: str, file: str) -> Line:
    """Return a row on obstacles; of the peers with limits on the jerk the one with most valid motions."""
    rows = {row["label"]: row for row in read_table(file)}
    peers = [row for name, row in rows.items() if name not in OURS and "toppra" not in name]
    peer = max(peers, key=lambda row: float(row["solved [%]"]))["label"] if peers else ""
    ours, theirs = (
        some(*(number(file, key, label=label) for key in OBSTACLE_KEYS)) for label in ("path and time", peer)
    )
    problems = next((f"{int(row['problems']):,}" for row in rows.values()), "")
    peer = peer.replace("OMPL, rounded", "OMPL's search, our rounding")
    return Line(what, "% valid, ms, s", ours, peer, theirs, problems, "obstacles")


def seam_line() -> Line:
    """Return the row on seams of two arms whose tool may turn, beside the same seams followed pose by pose."""
    files = [f"seams/tables/seams-{name}.csv" for name in ("panda-turn", "ur5e")]
    ours, theirs = (
        [number(file, "certified [%]", label=one) for file in files] for one in ("whole path, free", "local, free")
    )
    count = " / ".join(row["seams"] for file in files for row in read_table(file)[:1])
    return Line(
        "seams among boxes, panda with a free turn / ur5e",
        "% certified",
        some(*ours),
        "pose by pose (ours)",
        some(*theirs),
        count,
        "seams",
    )


def stream_line() -> Line:
    """Return the row on streams: set-points outside the limits, lag and distance of the best rule within them."""
    ours, theirs, peers, count = [], [], [], 0
    for name in ("panda", "ur3e"):
        file = f"chunks/tables/chunks-{name}.csv"
        inside = [row for row in read_table(file) if row["label"] not in OURS and int(row["outside"]) == 0]
        if inside:
            peers.append(min(inside, key=lambda row: float(row["distance [mrad]"]))["label"])
            ours.append(some(*(number(file, key, label="stream") for key in ("outside", "distance [mrad]"))))
            theirs.append(some(*(number(file, key, label=peers[-1]) for key in ("outside", "distance [mrad]"))))
            count += int(inside[0]["setpoints"])
    return Line("streams of a policy, align=clock, panda / ur3e", "set-points outside limits, mrad", sum(ours, ()),
                " / ".join(dict.fromkeys(peers)), sum(theirs, ()), f"{count:,} set-points", "streams")  # fmt: skip


def cells(line: Line) -> list[str]:
    """Return the cells of a row: what, ours, best peer, ratio, problems."""
    unit = f"{line.what} [{line.unit.replace(', ', ' · ')}]"
    if not line.ours or not line.theirs:
        shown = f"**{' · '.join(one.text for one in line.ours)}**" if line.ours else "not run"
        return [unit if line.ours else line.what, shown, "not run", "–", line.problems or "–"]
    step = len(line.unit.split(", ")) if len(line.ours) > 1 else 1
    ours, theirs = (" / ".join(" · ".join(one.text for one in side[k : k + step]) for k in range(0, len(side), step))
                    for side in (line.ours, line.theirs))  # fmt: skip
    pairs = list(zip(line.ours, line.theirs, strict=True))[step - 1 :: step]
    pairs = [(b, a) for a, b in pairs] if line.unit == "% certified" else pairs  # more is better
    ratios = [show(b.value / a.value) if a.value else "–" for a, b in pairs]
    return [
        unit,
        f"**{ours}**",
        f"{line.peer}: {theirs}",
        " / ".join(ratios),
        line.problems,
    ]


def draw_tables() -> tuple[str, str]:
    """Return the table of the results and the shorter one of README."""
    long = ["| | optik | best peer | peer / optik | problems | section |", "|---|---|---|---|---|---|"]
    short = ["| | optik | best peer | peer / optik |", "|---|---|---|---|"]
    for line in lines():
        row = cells(line)
        long.append("| " + " | ".join([*row, f"[{line.section}](#{line.section})"]) + " |")
        if line.ours and line.theirs:
            short.append("| " + " | ".join(row[:4]) + " |")
    return "\n".join(long), "\n".join(short)


def draw_plot(title: str, bars: list[tuple[str, float]]) -> str:
    """Return bars on a logarithmic axis as SVG: the least value is the best."""
    values = [value for _, value in bars if value > 0.0]
    low = 10.0 ** np.floor(np.log10(min(values)) - 0.2)
    span = np.log10(max(values) * 1.2 / low)
    rows = [f'<text x="8" y="22" font-weight="bold">{escape(title)} (logarithmic; blue: optik)</text>']
    for k, (label, value) in enumerate(bars):
        y, width = 44 + 26 * k, 360.0 * max(np.log10(max(value, low) / low) / span, 0.005)
        colour = "#1f5fa8" if label in OURS else "#9aa5b1"
        rows.append(f'<text x="200" y="{y + 13}" text-anchor="end">{escape(label)}</text>')
        rows.append(f'<rect x="208" y="{y}" width="{width:.1f}" height="18" fill="{colour}"/>')
        rows.append(f'<text x="{214 + width:.1f}" y="{y + 13}">{show(value)}</text>')
    height = 52 + 26 * len(bars)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 660 {height}" font-family="sans-serif" font-size="13">'
    )
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *rows, "</svg>", ""])


PLOTS = {
    "warm.svg": (
        "Near initial guess, six joints: median time [µs]",
        "ik-speed/tables/calls-warm.csv",
        "label",
        "median [µs]",
    ),
    "laws.svg": ("Straight lines: duration / shortest known", REGULAR, "label", "slowed_down"),
    "branches.svg": ("All branches inside the limits: median time [µs]", BRANCHES, "label", "median [µs]"),
    "batch.svg": ("10,000 targets on all cores: time per target [µs]", BATCH, "label", "per target [µs]"),
    "torque.svg": ("Within torque limits: duration / shortest known", TORQUE, "label", "slowed_down"),
    "chunks.svg": ("Panda: largest acceleration / limit", PANDA, "label", "acceleration"),
    "obstacles.svg": ("VAMP's set, the first 70: median duration [s]", SPHERES, "label", "median_duration [s]"),
}
"""Plots of the sections: title, file, and columns of the label and the value."""


def write_pages() -> None:
    """Write the tables, the plots and the sources of all numbers."""
    for page, table in zip((PAGE, README), draw_tables(), strict=True):
        page.write_text(fill(page.read_text(encoding="utf-8"), table), encoding="utf-8")
    (RESULTS / "plots").mkdir(exist_ok=True)
    for name, (title, file, label, value) in PLOTS.items():
        rows = [row for row in read_table(file) if row.get("targets", "10000") == "10000"]
        bars = [(row[label], float(row[value])) for row in rows if row[value] not in ("", "NaN", "inf")]
        if bars:
            (RESULTS / "plots" / name).write_text(draw_plot(title, bars), encoding="utf-8")
    write_table(RESULTS / "numbers.csv", [
        {"row": line.what, "side": side, "text": one.text, "file": one.file, "where": one.where, "column": one.column}
        for line in lines()
        for side, of in (("ours", line.ours), ("peer", line.theirs))
        for one in of
    ])  # fmt: skip


def fill(text: str, table: str) -> str:
    """Return a page with the table between its marks."""
    return re.sub(r"(<!-- results -->\n).*?(?=<!-- end -->)", lambda found: f"{found[1]}{table}\n", text, flags=re.S)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m docs.results", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / ".results", help="folder of the runs (default %(default)s)")
    parser.add_argument("--page", action="store_true", help="only write the pages")
    given = parser.parse_args()
    if not given.page:
        run_parts(given.out)
    write_pages()
