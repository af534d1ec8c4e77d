"""CPU time of the same work by this code and by that of an earlier commit, in two processes in turn.

``KIND=certify`` certifies plans of all laws and paths anew; ``avoid`` plans MotionBenchMaker's problems (``MBM`` as in
`tests.figures.search`); ``stop`` stops on polylines of 6 to 120 points, and ``long_stop`` on curves of 1,000 points, of ur5e,
and of panda with limits on its torques; ``line`` plans the paper's line. Each case runs three times in turn; the least time
counts.
The earlier code is extracted by ``git archive``, and compiles its kernels once. Run it alone on the machine.
"""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import tarfile
from collections.abc import Callable
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

KINDS = {
    "certify": ("c6dd5570", 200, (0.5, np.inf)), "avoid": ("d3dcf0de", 280, (0.5, np.inf)),
    "stop": ("d3dcf0de", 200, (0.55, 0.55)), "long_stop": ("d3dcf0de", 100, (0.3, 0.3)),
    "line": ("c6dd5570", 20, (0.85, np.inf)),
}  # fmt: skip
"""The earlier commit, the number of cases, and the ratios of the median and of the 99th percentile that were asked."""
KIND, PER_PLAN, REPEATS = os.environ.get("KIND", "certify"), 10, 3


@lru_cache(maxsize=1)
def seam_plan(number: int, points: int) -> Any:
    """A valid plan on a polyline, or on a smooth curve of 1,000 points."""
    import optik
    from planners import MotionLimits, Polyline, plan, replan
    from tests.figures.moving import seam, span

    robot = optik.load(("ur5e", "panda")[number % 2])
    robot = robot.with_payload(2.0) if number % 2 else robot
    low, high = span(robot)
    for trial in range(100):
        rng = np.random.default_rng([12, number, points, trial])
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        length, scale = float(rng.uniform(0.1, 0.4)), 10.0 ** rng.uniform(-0.3, 0.3, 2)
        poses = seam(robot.fk(q), min(points, 120), length, rng)
        if points > 120:
            at = np.linspace(0.0, len(poses) - 1.0, points)
            dense = np.repeat(poses[:1], points, axis=0)
            for i in range(3):
                dense[:, i, 3] = np.interp(at, np.arange(len(poses)), poses[:, i, 3])
            poses = dense
        path = Polyline(poses, blend=0.3 * length / points, blend_rotation=0.01)
        limits = MotionLimits(2.0, *([10.0, 100.0] * scale))
        if number % 2:
            limits = MotionLimits(robot.limits.velocity, None, 2000.0 * scale[1], torque=robot.limits.torque)
        try:
            made = plan(robot, path, q, limits=limits)
        except ValueError:
            continue
        if made:
            for warm in (0.2, 0.6):
                replan(made, warm * made.trajectory.duration, stop=True, time_limit=0.0)
            return made
    raise AssertionError("no plan")


@lru_cache(maxsize=1)
def drawn_plans() -> list[Any]:
    """Valid plans of many arms, paths, laws and limits, half of them with torque or a constant tool speed."""
    from tests.contract.test_replans import drawn
    from tests.planners import stops

    return [*itertools.islice(drawn(7), 100), *itertools.islice(stops.drawn(7), 100)]


def work_of(case: int) -> Callable[[], tuple[float, bool]] | None:
    """The work of a case: it returns a duration and whether the result is valid; None for a problem in contact."""
    from planners import certify, plan, replan

    if KIND == "certify":
        from planners.trajectory import Trajectory

        made = drawn_plans()[case]
        given = {"law": made.law, "enforced": made.certificate.enforced, "tolerance": made.certificate.tolerance}

        def proof() -> tuple[float, bool]:
            fresh = Trajectory(made.trajectory._polynomial, made.trajectory.s)
            found = certify(made.robot, made.path, fresh, made.limits, **given)
            return found.duration, found.is_valid

        return proof
    if KIND == "avoid":
        from tests.figures.motionbench import find_reason, limits_of
        from tests.figures.search import KINDS as SCENES
        from tests.figures.search import arm, problem

        name, kind, number = ("panda_hand", "ur5")[case % 2], SCENES[case // 2 % 7], 1 + 5 * (case // 14)
        scene, start, goal = tuple(problem(name, kind, number))[:3]
        if find_reason(name, scene, (start, goal)):
            return None
        work = lambda: plan(arm(name), goal, start, limits=limits_of(name), scene=scene, avoid=True)  # noqa: E731
    elif KIND == "line":
        from planners import MotionLimits
        from tests.planners.cases import START, default_line, paper6r

        work = lambda: plan(paper6r(), default_line(), START, limits=MotionLimits(2.0, 10.0, 100.0))  # noqa: E731
    else:
        number = case // PER_PLAN
        made = seam_plan(number, 1000 if KIND == "long_stop" else (6, 15, 40, 120)[number // 2 % 4])
        at = float(np.random.default_rng([13, case]).uniform(0.02, 0.98)) * made.trajectory.duration
        work = lambda: replan(made, at, stop=True, time_limit=0.0)  # noqa: E731

    def result() -> tuple[float, bool]:
        found = work()
        return (found.trajectory.duration if found else 0.0), bool(found)

    result()  # compiles
    return result


def answer() -> None:
    """Answer cases by the CPU time of their work, the duration, and whether the result is valid."""
    kept: dict[int, Any] = {}
    for line in sys.stdin:
        case = int(line)
        if case not in kept:
            kept.clear()
            kept[case] = work_of(case)
        begin = process_time()
        found = None if kept[case] is None else kept[case]()
        print(json.dumps(None if found is None else [process_time() - begin, *found]), flush=True)


@lru_cache(maxsize=1)
def processes() -> tuple[subprocess.Popen[str], subprocess.Popen[str]]:
    """The processes of the earlier and of the present code."""
    root, commit = Path(__file__).resolve().parents[2], KINDS[KIND][0]
    earlier = Path(os.environ.get("FIGURES", root / ".figures")).absolute() / commit
    if not earlier.exists():
        packed = subprocess.run(["git", "archive", commit], cwd=root, capture_output=True, check=True).stdout
        with tarfile.open(fileobj=BytesIO(packed)) as archive:
            archive.extractall(earlier, filter="data")
    first, second = (
        subprocess.Popen(
            [sys.executable, __file__, "answer"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": str(tree)},
        )
        for tree in (earlier, root)
    )  # fmt: skip
    return first, second


def measure(case: int) -> dict[str, Any]:
    """One case by both codes."""
    row: dict[str, Any] = {}
    for _ in range(REPEATS):
        for name, process in zip(("earlier", "now"), processes(), strict=True):
            assert process.stdin is not None and process.stdout is not None
            process.stdin.write(f"{case}\n")
            process.stdin.flush()
            found = json.loads(process.stdout.readline())
            if found is None:
                return {"out": True}
            row[name] = min(row.get(name, np.inf), found[0])
            row |= {f"{name}_duration": found[1], f"{name}_valid": found[2]}
    return row


def judge(rows: list[dict[str, Any]]) -> list[Any]:
    """The figures."""
    from tests.figures.figure import Value

    rows, (commit, _, asked) = [row for row in rows if "out" not in row], KINDS[KIND]
    before, after = (np.array([row[name] for row in rows]) for name in ("earlier", "now"))
    total, ratios = float(after.sum() / before.sum()), after / before
    late = float(np.quantile(after, 0.99) / np.quantile(before, 0.99))
    middle = float(np.median(ratios) if KIND == "avoid" else np.median(after) / np.median(before))
    both = [row for row in rows if row["now_valid"] and row["earlier_valid"]]
    longer = np.array([row["now_duration"] / row["earlier_duration"] for row in both])
    lost = sum(row["earlier_valid"] and not row["now_valid"] for row in rows)
    return [
        Value(f"{KIND}: CPU time over that of {commit}, median", f"≤ {asked[0]}", f"{middle:.3g}", middle <= asked[0]),
        Value(f"{KIND}: its 99th percentile", f"≤ {asked[1]}", f"{late:.3g}", late <= asked[1]),
        Value(f"{KIND}: its sum", "≤ 0.55" if KIND == "avoid" else "stated", f"{total:.3g}", KIND != "avoid" or total <= 0.55),
        Value(f"{KIND}: no longer valid", "0", f"{lost} of {len(rows)}", not lost),
        Value(f"{KIND}: duration over the earlier one, median, range", "stated",
              f"{np.median(longer):.4g}, {longer.min():.4g} to {longer.max():.4g}", True),
    ]  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:] == ["answer"]:
        answer()
    else:
        from tests.figures.figure import main

        main(f"earlier_{KIND}", measure, KINDS[KIND][1], judge, part=0.2 if KIND == "avoid" else 1.0)
