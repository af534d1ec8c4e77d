"""Motions between free configurations of an arm in a scene, each judged by the proof and by sampling."""

from __future__ import annotations

import time
from typing import Any
from zlib import crc32

import numpy as np
import polars as pl

from benchmarks.blocks._scenes import scene_named
from benchmarks.blocks.base import Tell
from benchmarks.blocks.timing.clearance.sampling import CoalSampling
from benchmarks.blocks.timing.clearance.settings import PROOF, ClearanceBlock, sampling_label
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.registry import short_name
from optik.scene import Scene
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from planners.certificate.clearance import clearance
from planners.curve import quintic_through
from planners.trajectory import Trajectory

END_CLEARANCE = 0.01
"""Distance that both ends of a motion keep beyond the margin [m]: whoever asks for a motion starts and ends it free."""

MOST_END_DRAWS = 100_000
"""Configurations drawn after which a scene counts as one without free ones."""

USUAL_SPEED, USUAL_ACCELERATION = 2.0, 10.0
"""Limits of a motion [rad/s, rad/s², or metres] of an arm that states none."""

TOUCHING = 2e-6
"""Distance by coal up to which a contact that was proved is confirmed [m]: what its iterations may be off."""

ROW_TYPES = {
    "motion": pl.Int64, "method": pl.String, "says": pl.String, "time": pl.Float64, "pair": pl.String,
    "proved": pl.Float64, "found": pl.Float64, "duration": pl.Float64, "samples": pl.Int64, "ms": pl.Float64,
    "contact": pl.Boolean, "missed": pl.Boolean, "false_contact": pl.Boolean,
}  # fmt: skip
"""Columns of the rows."""


def measure(block: ClearanceBlock, seed: int, tell: Tell) -> pl.DataFrame:
    """Judge every motion of a block by every method."""
    arm, scene = load(block.robot), scene_named(block.scene, block.margin)
    try:
        coal = CoalSampling(arm, scene)
    except ModuleNotFoundError:
        coal = None
    judged(block, arm, scene, coal, draw(block, arm, scene, seed, 0))  # compiles, and is not counted
    rows: list[dict[str, Any]] = []
    for number in range(block.count):
        if number % 20 == 0:
            tell(f"{block.id}: motion {number + 1:,} of {block.count:,}")
        found = judged(block, arm, scene, coal, draw(block, arm, scene, seed, number))
        rows += [row | {"motion": number} for row in found]
    return pl.DataFrame(rows, schema=ROW_TYPES)


def draw(block: ClearanceBlock, arm: Robot, scene: Scene, seed: int, number: int) -> Trajectory:
    """Draw a motion: one quintic from rest to rest between two free configurations."""
    keys = (crc32(short_name(text).encode()) for text in (block.robot, block.scene))
    rng = np.random.default_rng((seed, *keys, number))
    ends: list[Array] = []
    for _ in range(MOST_END_DRAWS):
        q = arm.limits.sample(rng, 1)
        if find_nearest_pairs(arm, scene, q)[0][0] > END_CLEARANCE:
            ends.append(q[0])
        if len(ends) == 2:
            break
    else:
        raise InvalidInput(
            "scene", f"{block.scene}: no free configuration of {arm.name} in {MOST_END_DRAWS:,} draws", "room"
        )
    way = np.abs(ends[1] - ends[0])
    speed = USUAL_SPEED if arm.limits.velocity is None else arm.limits.velocity
    acceleration = USUAL_ACCELERATION if arm.limits.acceleration is None else arm.limits.acceleration
    T = max((1.875 * way / speed).max(), float(np.sqrt(10.0 / np.sqrt(3.0) * way / acceleration).max()))
    still = np.zeros((2, arm.n))
    return Trajectory(quintic_through(np.array([0.0, T]), np.array(ends), still, still))


def judged(
    block: ClearanceBlock, arm: Robot, scene: Scene, coal: CoalSampling | None, motion: Trajectory
) -> list[dict[str, Any]]:
    """Judge one motion by every method."""
    begin = time.perf_counter()
    proof = clearance(arm, motion, scene)
    rows: list[dict[str, Any]] = [
        {
            "method": PROOF, "says": "free" if proof.proved else "contact" if proof.touches else "undecided",
            "ms": 1e3 * (time.perf_counter() - begin), "time": proof.time, "pair": " and ".join(proof.pair),
            "proved": proof.value if np.isfinite(proof.value) else None, "found": proof.found, "samples": None,
        }
    ]  # fmt: skip
    if coal is not None:
        rows += [_sampled(coal, motion, label, count) for label, count in _counts(block, motion)]
        contact = any(row["says"] == "contact" for row in rows[1:])
        if proof.touches and not contact:
            contact = coal.room(motion(proof.time)) <= TOUCHING
    else:
        contact = proof.touches
    for row in rows:
        row |= {
            "contact": contact, "missed": contact and row["says"] == "free",
            "false_contact": row["says"] == "contact" and not contact, "duration": motion.duration,
        }  # fmt: skip
    return rows


def _counts(block: ClearanceBlock, motion: Trajectory) -> list[tuple[str, int]]:
    """Label and number of intervals of every sampling."""
    way = float(np.abs(motion(motion.end) - motion(0.0)).max())
    found = [(sampling_label(step, "rad"), way / step) for step in block.joint_steps]
    found += [(sampling_label(rate, "Hz"), motion.duration * rate) for rate in block.rates]
    return [(label, max(1, int(np.ceil(intervals)))) for label, intervals in found]


def _sampled(coal: CoalSampling, motion: Trajectory, label: str, count: int) -> dict[str, Any]:
    """Row of one sampling: at equal distances in joint space, or at equal times."""
    begin = time.perf_counter()
    if label.endswith("rad"):
        start, goal = motion(np.array([0.0, motion.end]))
        q = start + np.linspace(0.0, 1.0, count + 1)[:, None] * (goal - start)
    else:
        q = motion(np.linspace(0.0, motion.end, count + 1))
    first = coal.touches(q)
    return {
        "method": label, "says": "free" if first < 0 else "contact", "ms": 1e3 * (time.perf_counter() - begin),
        "time": None, "pair": None, "proved": None, "found": None, "samples": count + 1,
    }  # fmt: skip
