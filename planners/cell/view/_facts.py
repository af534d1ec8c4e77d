"""Facts of a motion, an execution and a task of the cell as rows of a viewer's table."""

from __future__ import annotations

import numpy as np

from optik.arm.robot import Robot
from optik.registry import load_method
from planners.cell.drives import drives
from planners.cell.drives.base import Execution
from planners.cell.outcome import Outcome
from planners.certificate.certificate import Certificate
from planners.limits import ALL_LIMITS
from planners.motion import Motion


def motion_facts(motion: Motion) -> tuple[tuple[str, str], ...]:
    """Return the arm, law, path and scene of a motion as rows."""
    robot, path = motion.robot, motion.path
    shapes = (
        "no shapes, shown as lines between its joint frames" if robot.shapes is None else f"{robot.shapes.m} capsules"
    )
    turn = f"{np.degrees(path.end):.4g}° of rotation" if path.turns_only else f"{path.end:.4g} rad"
    way = f"{1e3 * path.end:.4g} mm" if path.unit == "m" else turn
    rows = [
        ("Arm", f"{robot.name}, {robot.n} joints, {shapes}"),
        ("Path", f"{path.name}, {way}"),
        ("Law", motion.law or "not stated"),
        ("Duration", f"{motion.trajectory.duration:.4f} s"),
        *payload_facts(robot),
    ]
    if motion.speed is not None:
        unit = "rad/s" if path.turns_only else "m/s"
        rows.append(("Requested tool speed", f"{motion.speed:.4g} {unit}"))
    if motion.scene is not None:
        rows.append(("Scene", f"{len(motion.scene.names)} objects, margin {1e3 * motion.scene.margin:.4g} mm"))
    return tuple(rows)


def payload_facts(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Return the payload of an arm as rows."""
    if robot.payload is None:
        return ()
    centre = ", ".join(f"{1e3 * x:.4g}" for x in robot.payload.com)
    return (("Payload", f"{robot.payload}, centre of mass at ({centre}) mm in the tool's frame"),)


def certificate_facts(proof: Certificate) -> tuple[tuple[str, str], ...]:
    """Return the certificate of a motion as rows."""
    rows = [("Certificate", "valid" if proof.is_valid else f"NOT valid: {'; '.join(proof.reasons)}")]
    for name in ALL_LIMITS:
        ratio, joint, t = proof.worst(name)
        if not np.isnan(ratio):
            enforced = "" if name in proof.enforced else ", not enforced by the law"
            much = f"{100 * ratio:.4g} % of its limit" if ratio < 10.0 else f"{ratio:.3g} times its limit"
            words = f"{much} at {t:.3f} s, {joint}{enforced}"
            rows.append((f"Largest {name.replace('_', ' ')}", words))
    if proof.clearance is not None:
        rows += [(f"Clearance {words}", kind.describe()) for words, kind in proof.clearance.kinds.items()]
    return tuple(rows)


def execution_facts(execution: Execution, unread: int) -> tuple[tuple[str, str], ...]:
    """Return the end of an execution as rows."""
    rows = [("Drive", drive_words(execution.drive)), ("Execution", str(execution.status).replace("_", " "))]
    if execution.reason:
        rows.append(("Reason", execution.reason))
    if execution.advice:
        rows.append(("Advice", execution.advice))
    if execution.late:
        rows.append(("Late set-points", str(execution.late)))
    rows += [*unread_facts(unread), *(("Note", note) for note in execution.notes)]
    return tuple(rows)


def drive_words(name: str) -> str:
    """Return the name of a drive, marked if it is simulated."""
    kind = load_method("planners.cell.drives", name, "drive") if name in drives() else None
    return f"{name} (simulated)" if getattr(kind, "simulated", False) else name


def outcome_facts(outcome: Outcome) -> tuple[tuple[str, str], ...]:
    """Return a task of the cell as rows: status, error and its parts, rounds, steps and notes."""
    rows = [("Task", str(outcome.status).replace("_", " "))]
    if outcome.failed is not None:
        rows += [("Failed step", outcome.failed.name), ("Reason", outcome.reason), ("Advice", outcome.advice)]
    if outcome.error is not None:
        norms = {name: _millimetres(float(size)) for name, size in outcome.error.norms.items()}
        rows.append(("Error at the end", norms.pop("total")))
        rows.append(("Parts of the error", ", ".join(f"{name} {size}" for name, size in norms.items())))
    for k, each in enumerate(outcome.rounds):
        what = f"Correction {k}" if k else "First motion"
        rows.append((what, f"{_millimetres(float(np.linalg.norm(each.error)))} from the spot"))
    if outcome.executions:
        rows.append(("Drive", drive_words(outcome.executions[0].drive)))
    rows += payload_facts(outcome.robot)
    rows.append(("Steps", ", ".join(f"{step.name} {'done' if step.ok else 'failed'}" for step in outcome.steps)))
    return (*rows, *(("Note", note) for note in outcome.notes))


def _millimetres(length: float) -> str:
    """Return a length [m] as text; below a nanometre it is rounding."""
    return f"{1e3 * length:.3g} mm" if length >= 1e-9 else "below 1 nm"


def unread_facts(unread: int) -> tuple[tuple[str, str], ...]:
    """Return the number of instants that are not drawn as rows."""
    words = f"{unread} instants without an encoder reading of every joint"
    return (("Not drawn", words),) if unread else ()
