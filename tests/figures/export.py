"""200 random invalid motions through files, messages and drives, without `allow=`, with the right word, with all others.

Inputs: motions of a panda with capsules, seeded by kind and case (tests/planners/invalid.py), each with one violation that
dense sampling confirms by its own formulas: a sphere that the arm enters, a straight line that a joint motion leaves, limits
that are exceeded, part of a path. Ways: `to_ros`, `save` in a random format, and the drives ideal, mujoco and ros (a dry run
against the rosbridge stand-in). Every fourth case also writes a valid motion beside a sphere as straight lines at 20 Hz; what
is written must be free of contact by sampling.
"""

from __future__ import annotations

import atexit
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import planners
from optik.errors import InvalidMotion
from planners.cell.drives import make_drive
from planners.certificate.violation import ALLOWANCES
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import panda
from tests.planners.invalid import KINDS, SAMPLES, interpolated_contact, invalid, to_point
from tests.planners.test_ros_drive import SERVER, address, drive_on

COUNT = 200
WAYS = ("to_ros", "save", "ideal", "mujoco", "ros")


@cache
def port() -> int:
    server = subprocess.Popen([sys.executable, str(SERVER)], stdout=subprocess.PIPE, text=True)
    atexit.register(server.kill)
    assert server.stdout is not None
    return int(server.stdout.readline())


def passes(way: str, plan: Any, folder: Path, allow: Sequence[str], case: int) -> bool:
    """Whether the motion is written or executed."""
    if way in ("to_ros", "save"):
        file = folder / ("motion.yaml" if way == "to_ros" else f"motion.{('json', 'npz', 'csv')[case % 3]}")
        write: Callable[..., Any] = planners.to_ros if way == "to_ros" else planners.save
        try:
            write(plan, file, allow=allow)
        except InvalidMotion as error:
            assert not file.exists() and set(error.allow) <= set(ALLOWANCES)
            return False
        written = file.exists()
        file.unlink()
        return written
    if way == "ros":
        drive = drive_on(address(port(), "ok", plan), plan, patience=20.0)
        with drive.transport:
            done = drive.execute(plan, allow=allow)
    else:
        done = make_drive(way, plan.robot).execute(plan, allow=allow)
    assert (done.status == "refused") == (done.motion is None and done.status != "dry_run")
    return done.status != "refused"


def measure(case: int) -> Row:
    one = invalid(KINDS[case % 4], case // 4)
    row: Row = {"word": one.word, "confirmed": one.found > 1.0}
    others = [word for word in ALLOWANCES if word != one.word]
    with tempfile.TemporaryDirectory() as name:
        for way in WAYS:
            row[way] = [passes(way, one.plan, Path(name), allow, case) for allow in ((), others, (one.word,))]
        if KINDS[case % 4] == "contact":
            row["lines"] = _lines(case, Path(name) / "lines.json")
    return row


def _lines(case: int, file: Path) -> str:
    """What becomes of a valid motion that is written as straight lines at 20 Hz: refused, free or touching."""
    plan = interpolated_contact(np.random.default_rng([22, case]))
    if plan is None or plan.scene is None:
        return "none drawn"
    try:
        planners.to_ros(plan, file, rate=20.0, interpolation="linear")
    except InvalidMotion:
        return "refused"
    sent = planners.load_trajectory(file, panda())
    centre, radius = plan.scene.spheres[0]
    t = np.linspace(0.0, sent.end, SAMPLES)
    return "free" if to_point(panda(), sent(t), np.asarray(centre)).min() > radius else "touching"


def judge(rows: list[Row]) -> list[Value]:
    count = len(rows)
    confirmed = sum(row["confirmed"] for row in rows)
    values = [Value("violations confirmed by sampling", f"{count}", f"{confirmed}", confirmed == count)]
    asked = (("without allow=", 0), ("with every other word", 0), ("with the right word", count))
    for way in WAYS:
        for k, (what, wanted) in enumerate(asked):
            passed = sum(row[way][k] for row in rows)
            values.append(Value(f"{way}, {what}: written or executed", f"{wanted}", f"{passed}", passed == wanted))
    lines = [row["lines"] for row in rows if "lines" in row]
    words = ", ".join(f"{lines.count(kind)} {kind}" for kind in ("refused", "free", "none drawn", "touching"))
    values.append(Value("valid motions as lines at 20 Hz", "0 touching", words, "touching" not in lines))
    return values


if __name__ == "__main__":
    main("export", measure, COUNT, judge)
