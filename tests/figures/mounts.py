"""Gravity torques of arms behind random mounts, loaded with and without a base, against Pinocchio on the same URDF.

Every second mount has a joint that moves; it stands at 0, as do all joints outside the chain. The same arm is also read from a
TOML and a JSON file and built in MuJoCo with another base, and is compared with itself loaded from the root.
"""

from __future__ import annotations

import json
import tempfile
import warnings
from pathlib import Path

import mujoco
import numpy as np

import optik
from optik.arm.mjcf_writer import mujoco_model
from optik.errors import MovingMountWarning
from tests.figures.figure import Row, Value, main
from tests.oracles.mounts import MountedGravity, random_mounted

COUNT, CONFIGURATIONS, TOLERANCE = 200, 20, 1e-10


def measure(case: int) -> Row:
    """Largest differences of the torques [N·m], whether the warning names the moving joints, and the comparison."""
    rng, moving = np.random.default_rng((52, case)), case % 2 == 1
    arm = random_mounted(rng, moving=moving)
    oracle, whole = MountedGravity(arm.urdf), optik.Robot.from_urdf(arm.urdf, arm.tip)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = optik.Robot.from_urdf(arm.urdf, arm.tip, arm.base)
    named = [w.category for w in caught] == [MovingMountWarning] * moving
    named = named and all(name in str(w.message) for w in caught for name in arm.moving)
    with tempfile.TemporaryDirectory() as folder:
        toml, data = Path(folder, "arm.toml"), Path(folder, "arm.json")
        toml.write_text(arm.table, encoding="utf-8")
        data.write_text(json.dumps(robot.to_dict()), encoding="utf-8")
        files = optik.load(toml), optik.load(data)
    turned = robot.with_base(optik.se3.pose(optik.se3.exp_so3(rng.normal(size=3)), rng.normal(size=3)))
    model = mujoco_model(turned)
    state, worst = mujoco.MjData(model), dict.fromkeys(("base", "root", "files", "mjcf"), 0.0)
    for q in rng.uniform(-3.0, 3.0, (CONFIGURATIONS, robot.n)):
        state.qpos[:] = q
        mujoco.mj_forward(model, state)
        every = np.concatenate([rng.uniform(-3.0, 3.0, len(arm.moving)), q])
        held = oracle.torques(arm.joints, q)
        errors = {
            "base": robot.gravity_torques(q) - held,
            "root": whole.gravity_torques(every) - oracle.torques(whole.joint_names, every),
            "files": [other.gravity_torques(q) - held for other in files],
            "mjcf": state.qfrc_bias - held,
        }
        worst = {name: max(value, float(np.abs(errors[name]).max())) for name, value in worst.items()}
    found = [robot.compare(other) for other in ((*files, turned) if moving else (*files, turned, whole))]
    lost = robot.compare(robot.with_gravity((0.0, 0.0, -1.0)))
    angle = float(np.arccos(np.clip(-robot.gravity[2], -1.0, 1.0)))
    kept = all(f.explained and f.gravity == 0.0 for f in found) and abs(lost.gravity - angle) < 1e-6
    return {**worst, "named": named, "kept": kept}


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    ways = {"base": "with base=", "root": "without base=", "files": "read from TOML and JSON", "mjcf": "in MuJoCo"}
    largest = {name: max(row[name] for row in rows) for name in ways}
    return [
        *(
            Value(f"gravity torque {words}, against Pinocchio", "≤ 1e-10 N·m", f"{largest[name]:.1e} N·m",
                  largest[name] <= TOLERANCE)
            for name, words in ways.items()
        ),
        Value("one warning that names the moving joints, else none", f"{len(rows)}", f"{sum(r['named'] for r in rows)}",
              all(r["named"] for r in rows)),
        Value("compare finds the same gravity, and names another", f"{len(rows)}", f"{sum(r['kept'] for r in rows)}",
              all(r["kept"] for r in rows)),
    ]  # fmt: skip


if __name__ == "__main__":
    main("mounts", measure, COUNT, judge)
