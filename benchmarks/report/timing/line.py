"""The motion that a block shows in detail: its rows, the arm that plays along the line (Fig. 5 and 6), and the clearance."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.entries import JOINT_LIMITS
from benchmarks.records import rows_file
from benchmarks.report import boards
from benchmarks.report.base import Run
from benchmarks.report.boards import Board, Control, Json, add, axis, colour, figure, line, noise_floor, squeeze
from benchmarks.report.tables import Column, Table, number, ratio
from optik.arm.robot import Robot
from optik.registry import short_name
from optik.types import Array
from optik.view.page import embed_arm
from optik.view.show import Track, thin
from planners.limits import FIELD_LIMITS, LOADED, MotionLimits, sides

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter3d


# ---------------- the motion that a block shows in detail


DEFAULT_LAW = "optimal"
"""The law that a control selects first: the default of `planners.plan`."""


def law_control(laws: Sequence[str], *more: str) -> Control:
    """Return the control of laws; it selects the default law first, if the run has it."""
    return Control.of("law", "Time law", (*laws, *more), DEFAULT_LAW if DEFAULT_LAW in laws else "")


def detailed(run: Run) -> BlockRows | None:
    """Return the first block that shows a motion in detail."""
    return next((b for b in run.of("timing") if b.block.detail), None)


def arm_of(run: Run, b: BlockRows) -> Robot:
    """Return the arm of the motion, with its payload."""
    part = b.block.example_set
    arm = run.robot(part.robot)
    return arm if part.payload is None else arm.with_payload(part.payload)


def limits_of(run: Run, b: BlockRows) -> MotionLimits:
    """Return the limits of the motion."""
    part = next(part for part in b.block.limits if part.label == b.block.example.limits)
    limits: MotionLimits = part.of(arm_of(run, b))
    return limits


def detail_rows(b: BlockRows) -> list[dict[str, Any]]:
    """Return the rows of the motion by our laws: for each IK method, every law."""
    part, chosen = b.block.example_set, b.block.example
    index = 0 if part.path else chosen.index
    rows = b.rows.filter(robot=part.arm, kind=part.label, index=index, limits=chosen.limits, entry="law")
    solvers, labels = list(map(short_name, b.block.solvers)), b.block.labels
    return sorted(rows.to_dicts(), key=lambda row: (solvers.index(row["solver"]), labels.index(row["method"])))


def first_solver(b: BlockRows) -> str:
    """Return the first IK method with a motion; the first of all if none has one."""
    solved = [str(row["solver"]) for row in detail_rows(b) if row["solved"]]
    return solved[0] if solved else short_name(b.block.solvers[0])


def solved_of(b: BlockRows) -> list[dict[str, Any]]:
    """Return the rows with a motion, by the first IK method that has some."""
    solver = first_solver(b)
    return [row for row in detail_rows(b) if row["solved"] and row["solver"] == solver]


def broken_limits(row: dict[str, Any]) -> list[str]:
    """Describe the limits that a motion violates, enforced or not; empty if there are none."""
    found = [
        f"{field.replace('_', ' ')} " + ("∞" if np.isinf(row[field]) else f"{ratio(row[field])}×")
        for field in JOINT_LIMITS
        if row[field] is not None and row[field] > 1.0
    ]
    return found + (["joint range"] if "position" in row["breaks"] else [])


LAW_COLUMNS = (
    Column("label", "Time law", show="text"),
    Column("duration", "duration", "s", "less", "precise", among="place"),
    Column("broken", "limits exceeded", show="text"),
    *(Column(field, f"{field.replace('_', ' ')} / limit", show="text") for field in JOINT_LIMITS),
    Column("distance", "path deviation", "µm", "less"),
    Column("ms_plan", "planning", "ms", "less"),
    Column("place", "rank", show="text", aside=True),
    *(
        Column(f"{field}_at", f"{field.replace('_', ' ')}: joint and time", show="text", aside=True)
        for field in JOINT_LIMITS
    ),
    Column("energy", "energy without recovery", "J", aside=True),
    Column("power", "peak power", "W", aside=True),
    Column("clearance", "clearance to the scene, proved", "mm", "more"),
    Column("own_clearance", "clearance between links, proved", "mm", "more"),
    Column("sampled_jerk", "sampled jerk", "rad/s³", aside=True),
    Column("angle", "path deviation", "µrad", aside=True),
    Column("tool_speed", "tool speed", "mm/s", aside=True),
    Column("continuous", "continuity", show="text", aside=True),
    Column("rest", "rest at start, end", show="text", aside=True),
    Column("enforced", "enforces", show="text", aside=True),
    Column("holds", "certificate valid", show="text", aside=True),
    Column("end_error", "end error", "rad", aside=True),
)
"""Columns of the table of time laws; those of torque, energy and clearance only where a motion has them."""

_OPTIONAL = {*LOADED, *(f"{field}_at" for field in LOADED), "energy", "power", "clearance", "own_clearance"}
_SCALES = {"distance": 1e6, "angle": 1e6, "tool_speed": 1e3, "clearance": 1e3, "own_clearance": 1e3}
"""From fields to the units of the table."""


def law_table(run: Run, b: BlockRows) -> Table:
    """Return the table of the time laws, planned with the first IK method that solved the motion."""
    solver, solved = first_solver(b), solved_of(b)
    within = sorted((row for row in solved if not broken_limits(row)), key=lambda row: row["duration"])
    ranks = {row["method"]: str(k) for k, row in enumerate(within, start=1)}
    rows = [
        _row(row, b.entries[row["method"]]["enforced"]) | {"place": ranks.get(row["method"])}
        for row in detail_rows(b)
        if row["solver"] == solver
    ]
    columns = [c for c in LAW_COLUMNS if c.key not in _OPTIONAL or any(row.get(c.key) is not None for row in rows)]
    note = (
        f"{b.block.title}: {number(1e3 * solved[0]['length'])} mm, inverse kinematics by {solver}. "
        f"Limits: {describe_limits(limits_of(run, b), arm_of(run, b).n)}. "
        "Ratios to the limits are exact, also between samples; ∞: the acceleration is discontinuous. A motion that exceeds a "
        "limit is not ranked. The path deviation is a proved bound. Planning time includes the certificate, "
        f"median of {b.block.rounds}. Sampled jerk: differences of the accelerations at a controller's rate."
        if solved
        else ""
    )
    return Table("laws", "Time laws along the line", tuple(columns), tuple(rows), note)


def _row(row: dict[str, Any], enforced: Sequence[str]) -> dict[str, Any]:
    if not row["solved"]:
        words = f"no motion: {row['status'].replace('_', ' ')}: {row['reason']}"
        return {"label": row["method"], "ms_plan": row["ms_plan"], "broken": words}
    found = row | {name: scale * row[name] for name, scale in _SCALES.items() if row[name] is not None}
    for field in (field for field in JOINT_LIMITS if row[field] is not None):
        found |= {field: ratio(row[field]), f"{field}_at": f"{row[f'{field}_joint']}, {row[f'{field}_time']:.3f} s"}
    valid = "yes" if enforced else "nothing enforced"
    return found | {
        "label": row["method"], "broken": ", ".join(broken_limits(row)) or "none", "continuous": f"C{row['continuous']}",
        "enforced": ", ".join(enforced) or "nothing", "holds": valid if row["holds"] else f"no: {row['broken']}",
    }  # fmt: skip


SAME_DURATION = 1e-9
"""Relative difference of durations up to which two motions count as equally long: rounding of a longer computation."""


def ik_matters(b: BlockRows) -> str:
    """Describe in one sentence how much the motions depend on the IK method."""
    solved = pl.DataFrame([row for row in detail_rows(b) if row["solved"]], infer_schema_length=None)
    if solved.is_empty() or solved["solver"].n_unique() < 2:
        return ""
    by_law = solved.group_by("method", maintain_order=True).agg(
        spread=pl.col("duration").max() / pl.col("duration").min() - 1.0,
        off=pl.col("distance").max() - pl.col("distance").min(),
    )
    law, spread, _ = by_law.sort("spread", descending=True).row(0)
    others = ", ".join(name for name in solved["solver"].unique(maintain_order=True) if name != first_solver(b))
    much = f"by at most {number(100 * spread, 2)} % ({law})" if spread > SAME_DURATION else "not at all"
    return (
        f"With {others} in place of {first_solver(b)}, durations change {much}, and path deviations by at most "
        f"{_small(1e6 * float(by_law['off'].to_numpy().max()))} µm: Newton polishing refines every sample after the IK method."
    )


def _small(micrometres: float) -> str:
    """Format a length; below the least result, as an upper bound."""
    floor = noise_floor("µm")
    return number(floor, 1).removeprefix("1·") if micrometres <= floor else number(micrometres, 2)


def describe_limits(limits: MotionLimits, n: int) -> str:
    """Describe limits with their values on n joints: one value where all joints have the same."""
    words = []
    for kind in (kind for kind in FIELD_LIMITS if limits.value(kind.name) is not None):
        lower, upper = sides(limits.bounds(n)[kind.name])
        values = [
            "free" if np.isinf(high) else f"{high:g}" if low == -high else f"{low:g} to {high:g}"
            for low, high in zip(np.broadcast_to(lower, upper.shape), upper, strict=True)
        ]
        same = len(set(values)) == 1
        text = values[0] if same else ", ".join(values)
        on = " on every joint" if same else " (joint by joint)"
        words.append(
            f"{kind.name.replace('_', ' ')} {text} {kind.units[0]}" + (on if kind.name in JOINT_LIMITS else "")
        )
    return "; ".join(words)


# ---------------- sections


ARM_INSTANTS = 251
"""Number of instants of a motion of the arm; the viewer interpolates cubics between them."""


def line_in_space(run: Run) -> dict[str, Any] | None:
    """Show the path with its samples, and the arm along it under the time law that the reader chooses."""
    example = detailed(run)
    rows, tool = (None, None) if example is None else (example.table("joints"), example.table("tool"))
    if rows is None or tool is None or example is None:
        return None
    robot, samples = arm_of(run, example), example.block.samples
    laws = law_control(rows["law"].unique(maintain_order=True).to_list())
    names = sorted((law for law, _ in laws.options), key=lambda law: law != laws.value)
    motions = {law: read_track(rows.filter(pl.col("law") == law), robot.n) for law in names}
    one = tool.filter(pl.col("law") == names[0])
    path, s = one.select("x", "y", "z").to_numpy(), one["s"].to_numpy()
    at = np.linspace(s[0], s[-1], samples)
    along = np.stack([np.interp(at, s, path[:, k]) for k in range(3)], axis=1)
    words = [", ".join(number(1e3 * x, 4) for x in point) for point in along[[0, -1]]]
    board = Board(
        "line-board", (_straight(1e3 * along),), (),
        f"The line with its {samples} samples, in the base frame. Drag to turn.",
    )  # fmt: skip
    return {
        "words": [f"From ({words[0]}) mm to ({words[1]}) mm."], "boards": [board],
        "arm_title": "The arm along the line (Fig. 6)", "arm": squeeze(json.dumps(embed_arm(robot, motions, along)).encode()),
    }  # fmt: skip


def read_track(rows: pl.DataFrame, n: int) -> Track:
    """Return a motion for the viewer, from a row for each instant and joint."""
    t, q, dq = (rows[name].to_numpy().reshape(-1, n) for name in ("t", "q", "dq"))
    return thin(Track(t[:, 0], q, dq), ARM_INSTANTS)


def _straight(along: Array) -> Figure:
    """Plot the line alone, by its samples [mm]."""
    scene = {"aspectmode": "cube", **{f"{a}axis": _axis_in_space(a, 5) for a in "xyz"}}
    plot = figure(
        "straight", "The straight line in Cartesian coordinates (Fig. 5)", height=520, scene=scene,
        margin=dict.fromkeys("lrtb", 0),
    )  # fmt: skip
    add(plot, _points(along, "line", mode="lines", line={"color": colour(1), "width": 4}))
    add(plot, _points(along, "samples", marker={"color": colour(0), "size": 2}))
    add(plot, _points(along[:1], "start", marker={"color": colour(2), "size": 6, "symbol": "circle"}))
    add(plot, _points(along[-1:], "goal", marker={"color": colour(3), "size": 6, "symbol": "diamond"}))
    return plot


def _points(points: Array, name: str, mode: str = "markers", **options: Any) -> Scatter3d:
    hover = f"{name}<br>%{{x:.1f}}, %{{y:.1f}}, %{{z:.1f}} mm"
    return boards.line_3d(*points.T, mode=mode, name=name, hover=hover, **options)


# ---------------------------------------------------------------- clearance


def draw_clearance(run: Run) -> dict[str, Any] | None:
    """Show clearance over time and in space, for every law."""
    found = detailed(run)
    rows = None if found is None else found.table("clearance")
    if rows is None or found is None:
        return None
    facts = run.folder.read_json(rows_file("timing", found.block.id, "clearance.json"))
    pairs = _left_out(facts[0]["left_out"])
    left_out = f" Pairs not examined: {pairs}." if pairs else ""
    return {
        "boards": [_over_time(rows, facts, found.block.margin, run)],
        "notes": [f"{one['law']}: {one['words']}." for one in facts],
        "after": ["The shapes are capsules that enclose the links, so real clearances are larger." + left_out],
    }


def _left_out(pairs: Sequence[Sequence[str]]) -> str:
    """Return the pairs that were not examined, by reason."""
    by_reason: dict[str, list[str]] = {}
    for first, second, why in pairs:
        by_reason.setdefault(why, []).append(f"{first} and {second}")
    return "; ".join(f"{', '.join(dict.fromkeys(names))} ({why})" for why, names in by_reason.items())


def _over_time(rows: pl.DataFrame, facts: Sequence[Json], margin: float, run: Run) -> Board:
    """Plot the least distance of all pairs and that between links, with the proved bounds."""
    laws = rows["law"].unique(maintain_order=True).to_list()
    margin *= 1e3
    below = boards.band(-1e4, margin, "nearer to the scene than the margin" if margin else "contact")
    most = 1e3 * float(np.nanmax(rows.select(pl.max_horizontal("scene", "own")).to_numpy().astype(float)))
    plot = figure(
        "clearance-time", "Clearance over time", axis("t [s]", rangemode="tozero"),
        axis("distance [mm]", range=[min(-0.04 * most, margin - 0.1 * most), 1.06 * most]), 380, shapes=[below],
    )  # fmt: skip
    for law in laws:
        part = rows.filter(pl.col("law") == law)
        for column, words, dash in (("scene", "arm and scene", "solid"), ("own", "between links", "dot")):
            kept = part.filter(pl.col(column).is_not_null())
            if kept.is_empty():
                continue
            trace = line(
                kept["t"], 1e3 * kept[column].to_numpy(), digits=5, **{"name": law} if dash == "solid" else {},
                line={"color": run.colour(law), "width": 2, "dash": dash},
                hover=f"{words}, {law}<br>%{{x:.3f}} s: %{{y:.4g}} mm",
            )  # fmt: skip
            add(plot, trace, {"law": [law]})
    for one in facts:
        times, distances = np.array(one["marks"]).T
        mark = line(
            times, 1e3 * distances, digits=5, mode="markers", name="least, from the certificate",
            marker={"color": boards.ALARM_COLOUR, "size": 10, "symbol": "diamond"},
            hover="least, from the certificate<br>%{x:.3f} s: %{y:.4g} mm",
        )  # fmt: skip
        add(plot, mark, {"law": [one["law"]]})
    for words, dash in (("arm and scene", "solid"), ("between links", "dot")):
        add(plot, boards.entry(words, boards.MUTED_COLOUR, dash))
    return Board(
        "clearance-time-board", (plot,), (law_control(laws),) if laws[1:] else (),
        "Least distance of the examined pairs at sampled instants, for the shapes of arm and scene. The bound of the "
        "certificate is for every instant.",
    )  # fmt: skip


def axes_in_space(gravity: Array, points: Array) -> Json:
    """Return axes with equal scales that contain everything, with z upwards."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.05 * (high - low).max()
    axes = {f"{a}axis": _axis_in_space(a, 6, range=[low[i] - room, high[i] + room]) for i, a in enumerate("xyz")}
    up = dict(zip("xyz", boards.lean(-gravity).tolist(), strict=True))
    camera = {"up": up, "eye": {"x": 1.0, "y": -1.2, "z": 0.6}, "center": {"x": 0.0, "y": 0.0, "z": -0.12}}
    return {"aspectmode": "data", "camera": camera, **axes}


def _axis_in_space(name: str, ticks: int, **options: Any) -> Json:
    return options | {"title": {"text": f"{name.upper()} [mm]"}, "nticks": ticks}
