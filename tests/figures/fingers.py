"""Arms with a finger beside the tip: free and touching configurations against the true meshes, and loads from the cache.

A case is an arm with a random hand, written as a URDF with meshes. Pinocchio and coal judge the meshes at sampled values of the
fingers. A configuration is free if its links are apart at all of them.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import optik
from optik.scene.contact import find_nearest_pairs
from tests.figures.figure import ROOT, Row, Value, main
from tests.oracles.hands import KINDS, MeshContact, write_hand

SEED = 20261126
ARMS, CONFIGURATIONS, VALUES = 10, 400, 25
"""Arms of each kind, configurations of each arm, and values of its fingers."""
LOAD = """import sys, time, optik
optik.load("panda")  # once in a process, Numba takes a second
begin = time.process_time()
optik.Robot.from_urdf(sys.argv[1], "tip", shapes=True)
print(time.process_time() - begin)"""


def measure(case: int) -> Row:
    """One arm."""
    kind, number = KINDS[case % len(KINDS)], case // len(KINDS)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = f"{folder}/cache"
        hand = write_hand(Path(folder), [SEED, case], kind)
        begin = time.process_time()
        robot = optik.Robot.from_urdf(hand.file, "tip", shapes=True)
        first = time.process_time() - begin
        command = [sys.executable, "-W", "ignore", "-c", LOAD, str(hand.file)]
        again = float(subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout)
        oracle = MeshContact(hand)
        q = robot.limits.sample(np.random.default_rng([SEED, number]), CONFIGURATIONS)
        values = np.linspace(*hand.limits, VALUES)
        free = np.array([not any(oracle.touches(x, value) for value in values) for x in q])
    ours = find_nearest_pairs(robot, optik.Scene(), q)[0] > 0.0
    return {
        "kind": kind, "free": int(free.sum()), "both": int((free & ours).sum()), "missed": int((ours & ~free).sum()),
        "touching": int((~free).sum()), "first": first, "again": again, "capsules": robot.shapes.m,
    }  # fmt: skip


def judge(rows: list[Row]) -> Sequence[Value]:
    """Rates of each kind and of each arm, contacts that were missed, and the slowest second load."""
    found = []
    for kind in KINDS:
        some = [row for row in rows if row["kind"] == kind]
        if some:
            rate, least = (
                sum(r["both"] for r in some) / sum(r["free"] for r in some),
                min(r["both"] / r["free"] for r in some),
            )
            said = f"{100 * rate:.1f} % of {sum(r['free'] for r in some):,}, at least {100 * least:.1f} % for one arm"
            found.append(Value(f"free like the meshes, {kind}", "≥ 90 %", said, rate >= 0.9))
    missed, touching = sum(r["missed"] for r in rows), sum(r["touching"] for r in rows)
    found.append(Value("contacts of meshes that are missed", "0", f"{missed} of {touching:,}", missed == 0))
    again, first = max(r["again"] for r in rows), float(np.median([r["first"] for r in rows]))
    said = f"{again:.2f} s at most, the first {first:.1f} s (median)"
    found.append(Value("second load, in a new process, CPU", "≤ 1 s", said, again <= 1.0))
    return found


if __name__ == "__main__":
    main("fingers", measure, ARMS * len(KINDS), judge)
