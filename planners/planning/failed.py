"""A failed plan as plain data, as the content of a viewer, and as a figure: the reason, and the motion before the failure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from optik.arm.plain import read_numbers, read_record, read_word
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik.start import choose_start
from optik.scene import Scene
from optik.scene.contact import find_contact, find_nearest_pairs
from optik.types import Array
from optik.view.show import Show, Track
from planners.certificate.certificate import shorten_text
from planners.motion.show import plot_positions, sample_path, sample_track
from planners.paths import path_of

FAILED_PLAN = "optik-failed-plan/2"
"""Value of the key ``format`` in the file of a failed plan; no reader of motions accepts it."""
JOINT_PATH_SAMPLES = 400
"""Number of configurations that are written for the part of a path before the failure."""
SHOWN_SPEED = 0.5
"""Largest joint speed [rad/s, m/s] at which a viewer plays a joint path without times."""


def failed_plan_data(plan: Any) -> dict[str, Any]:
    """Return a failed plan as plain data: why it failed, the configurations before the failure, and the nearest pair there."""
    failure, t, q = plan.failure, *_sample_before_failure(plan)
    data: dict[str, Any] = {
        "format": FAILED_PLAN, "failed": True, "status": str(plan.status), "s": failure.s, "joint": failure.joint,
        "reason": failure.reason, "advice": failure.advice, "solver": plan.solver, "law": plan.law,
        "robot": plan.robot.to_dict(), "path": plan.path.to_dict(), "t": t.tolist(), "q": q.tolist(),
    }  # fmt: skip
    if plan.scene is not None:
        data["scene"] = plan.scene.to_dict()
        if len(q):
            near = find_contact(plan.robot, plan.scene, q[np.argmin(find_nearest_pairs(plan.robot, plan.scene, q)[0])])
            data["nearest"] = {"pair": list(near.pair), "distance": near.distance}
    return data


def _sample_before_failure(plan: Any) -> tuple[Array, Array]:
    """Return times (k,) [s] and configurations (k, n) [rad, m] of the invalid motion, or of the path before the failure."""
    if plan.has_motion:
        track = sample_track(plan.trajectory)
        return track.t, track.q
    parts = getattr(plan, "parts", ())[: plan.failure.part]  # of a program
    pieces = [(part.joint_path, part.joint_path.end) for part in parts]
    if plan.prefix is not None:
        pieces.append((plan.prefix, min(plan.prefix.end, plan.failure.s)))
    if not pieces and not plan.path.in_joints:
        return np.zeros(0), np.zeros((0, plan.robot.n))
    q = np.concatenate([piece(np.linspace(0.0, end, JOINT_PATH_SAMPLES if end > 0.0 else 1)) for piece, end in pieces]
                       or [plan.path.configurations(plan.robot, np.zeros(1))])  # fmt: skip
    steps = np.maximum(np.abs(np.diff(q, axis=0)).max(axis=1), 1e-6)
    return np.concatenate([[0.0], np.cumsum(steps) / SHOWN_SPEED]), q


def plot_failed_plan(plan: Any) -> Any:
    """Return a figure of the joint positions before the failure, in the order of the path: the plan has no times."""
    t, q = _sample_before_failure(plan)
    where = f"s = {plan.failure.s:.4g} of {plan.path.end:.4g} {plan.path.unit}"
    words = f"{plan.robot.name}: plan FAILED, {str(plan.status).replace('_', ' ')} at {where}"
    return plot_positions(plan.robot, t, q, f"t [s] at {SHOWN_SPEED:g} rad/s: the plan has no times", words)


def show_failed_plan(data: Mapping[str, Any]) -> Show:
    """Return the content of a viewer for a failed plan; where it has no configuration, the arm stands beside its path."""
    missing = [key for key in ("robot", "path", "status", "reason", "advice", "t", "q") if key not in data]
    if missing:
        raise InvalidInput("PLAN", f"no {missing[0]}", "a failed plan, written by `optik plan`")
    robot = Robot.from_dict(data["robot"])
    path = path_of(data["path"], robot)
    status, reason, advice = (read_word(data[key], key) for key in ("status", "reason", "advice"))
    t, q = check_samples(data["t"] or [0.0], data["q"] or [choose_start(robot).tolist()], robot.n, "q")
    rows = [("Plan", f"FAILED: {status.replace('_', ' ')}"), ("Reason", reason), ("Advice", advice)]
    rows += [] if data["t"] else [("Shown arm", "at any configuration: none is known on the path")]
    if isinstance(data.get("s"), float | int):
        rows.append(("Failed at", f"s = {data['s']:.4g} of {path.end:.4g} {path.unit}"))
    if isinstance(data.get("nearest"), Mapping):
        near = read_record(data["nearest"], ("pair", "distance"), "nearest")
        pair, distance = " and ".join(map(str, near["pair"])), float(read_numbers(near["distance"], (), "distance"))
        rows.append(("Contact pair" if distance <= 0.0 else "Nearest pair", f"{pair}, {1e3 * distance:.3g} mm"))
    scene = None if data.get("scene") is None else Scene.from_dict(data["scene"])
    title = f"{robot.name}: plan FAILED, {status.replace('_', ' ')}"
    return Show(
        robot,
        title,
        make_track(t, q),
        sample_path(path),
        None,
        scene,
        facts=tuple(rows),
        verdict=shorten_text(reason, 160),
    )


def check_samples(t: Any, q: Any, n: int, name: str) -> tuple[Array, Array]:
    """Return increasing times (k,) and rows (k, n); None stands for a missing value."""
    try:
        times, rows = np.array(t, dtype=np.float64), np.array(q, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInput(name, "something else", "lists of numbers") from None
    if times.ndim != 1 or rows.shape != (times.size, n) or not times.size or not (np.diff(times) > 0.0).all():
        raise InvalidInput(
            name, f"shape {rows.shape} at {times.size} times", f"{n} numbers at each of some increasing times"
        )
    return times, rows


def make_track(t: Array, q: Array) -> Track:
    """Return a track of configurations, with velocities from finite differences."""
    if not np.isfinite(q).all():
        raise InvalidInput("q", "numbers that are not finite", "finite set-points")
    return Track(t, q, np.gradient(q, t, axis=0) if len(t) > 1 else np.zeros_like(q))
