"""Sections of the report on the executed cell: spots, their errors in space and on each axis (Fig. 10 to 13), and a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.block import Of, count, largest, median
from benchmarks.blocks.cell import WITHIN, WITHIN_M, Noise
from benchmarks.experiments.claims import executed_claims
from benchmarks.records import slug
from benchmarks.report import boards
from benchmarks.report.base import QUESTION, KindReport, Run, Section
from benchmarks.report.boards import INK_COLOUR, Board, Control, add, colour, figure, iterations, line_3d
from benchmarks.report.budgets.accuracy import chosen
from benchmarks.report.page import claims_of
from benchmarks.report.tables import Column, Group, Table, table_of
from benchmarks.report.timing.line import axes_in_space
from benchmarks.statistics import quantiles
from optik.types import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter


# ---------------- table of the executed cell


NOISE_WORDS = {
    "laser_angle": ("σ of the laser's pan and tilt", 1e3, "mrad"), "laser_range": ("σ of its range", 1e3, "mm"),
    "laser_position": ("σ of each coordinate of its calibrated position", 1e3, "mm"),
    "laser_rotation": ("σ of each component of its calibrated orientation", 1e3, "mrad"),
    "friction": ("friction of each joint, uniform ±", 1e2, "%"), "payload": ("payload, uniform ±", 1e2, "%"),
    "encoder_counts": ("encoder resolution", 1.0, "counts per turn"),
    "encoder_angle": ("σ of encoder readings", 1e6, "µrad"),
}  # fmt: skip
"""Random quantities of a trial in words, with the factor to their unit."""


ENDED_TRIAL = pl.col("position_error").is_not_null()
"""Whether a trial was executed."""


def _mm(column: str, level: float = 0.5) -> Of:
    """Return the computation of a quantile [mm] over the executed trials; None without any."""

    def of(rows: pl.DataFrame) -> float | None:
        ends = rows.filter(ENDED_TRIAL)
        return 1e3 * quantiles(ends[column].to_numpy(), (level,))[0] if len(ends) else None

    return of


SPOT_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("budget", "iterations", show="text"),
    Column("within", "within 2 mm on each axis", "%", "more", "share", of=WITHIN),
    Column("count", "trials", show="count", of=len),
    Column("error", "median error", "mm", "less", of=_mm("position_error")),
    Column("p95", "p95 error", "mm", "less", of=_mm("position_error", 0.95)),
    *(Column(name.lower(), name, "mm", of=_mm(f"{name.lower()}_error")) for name in ("laser", "IK", "path", "servo")),
    Column("tracking", "largest tracking error", "mm", "less", of=largest("tracking_m", 1e3, among=ENDED_TRIAL)),
    Column("torque", "largest torque / bound", "", "", "limit", of=largest("torque_ratio", among=ENDED_TRIAL)),
    Column("duration", "median duration", "s", aside=True, of=median("duration", among=ENDED_TRIAL)),
    Column("failed", "not executed", show="count", of=count(~ENDED_TRIAL)),
)
"""Columns of a table of spots; the parts of the error are medians of lengths."""


def noise_words(noise: Noise) -> str:
    """Describe the random quantities of a trial."""
    words = []
    for name in NOISE_WORDS:
        value = getattr(noise, name)
        what, scale, unit = NOISE_WORDS[name]
        if value:
            gap = "" if what.endswith("±") else " "
            words.append(f"{what}{gap}{scale * value:.7g}{' ' + unit if unit else ''}")
    return ", ".join(words)


def drives_of(b: BlockRows) -> str:
    """Describe the drive of a block."""
    names = b.rows["drive"].drop_nulls().unique().sort().to_list()
    ideal = " (without masses: no servo error, torque or energy; friction and payload have no effect)"
    return " and ".join(name + (ideal if name == "ideal" else "") for name in names)


def tables(run: Run) -> Sequence[Table]:
    """Return all tables of the executed cell."""
    return [spots_table(b) for b in run.of("cell")]


def _budget_words(budget: Any, along: bool) -> str:
    """Say how many iterations were made, and where."""
    return "the whole line" if budget is None else f"{budget} at each pose" if along else f"{budget} from the start"


def spots_table(b: BlockRows) -> Table:
    """Return spots by method and budget."""
    groups: list[Group] = [
        ({"label": str(setting), "budget": _budget_words(budget, part["along"][0])}, part)
        for (setting, budget), part in b.rows.filter("known").group_by("setting", "budget", maintain_order=True)
    ]
    note = (
        "Spots with a known solution. The parts of the error are median lengths of vectors at the end of the motion: laser "
        "(target − spot), IK (tool at the method's answer − target), path (planned − answer), servo (executed − planned). If "
        "the answer is the start, there is no motion and no servo error. A trial that was not executed counts as a miss and "
        "has no error. Torque: simulated peak / certificate's bound for the nominal arm. Other friction and payload may "
        "exceed the bound, and so may single steps in which the servo responds to the resolution and noise of its encoders."
    )
    return table_of(f"cell-spots-{slug(b.block.id)}", b.block.title, SPOT_COLUMNS, groups, note)


# ---------------- sections on spots


PART_WORDS = {
    "laser": "laser: target − spot", "ik": "IK: its answer − target", "path": "path: planned − answer",
    "servo": "servo: executed − planned",
}  # fmt: skip
"""Parts of the error in words."""

PART_COLOURS = dict(zip(PART_WORDS, (colour(0), colour(1), colour(2), colour(3)), strict=True))
"""Their colours."""

TOTAL_COLOUR = INK_COLOUR
"""Colour of the total error."""

WHOLE = "whole"
"""Text in place of a budget for methods with default settings."""


def done(b: BlockRows) -> pl.DataFrame:
    """Return the rows of executed spots with a known solution."""
    rows = b.rows.filter(pl.col("known") & pl.col("position_error").is_not_null())
    return rows.with_columns(after=pl.col("budget").cast(pl.String).fill_null(WHOLE))


def settings_of(blocks: Sequence[BlockRows], *, whole: bool | None = None) -> list[str]:
    """Return the labels of the methods of some blocks, each once."""
    return list(dict.fromkeys(m.label for b in blocks for m in b.block.methods if whole is None or m.whole is whole))


def after_control(b: BlockRows) -> Control:
    """Return the choice of a budget, available if a method with budgets is selected."""
    options = tuple((str(k), iterations(k)) for k in b.block.budgets)
    return Control("after", "After", options, when={"method": settings_of([b], whole=False)})


def shown_at(setting: str, after: str) -> dict[str, list[str]]:
    """Return the values of the controls that select one method at one budget."""
    return {"method": [setting]} | ({} if after == WHOLE else {"after": [after]})


def millimetres(values: pl.Series) -> np.ndarray:
    """Return lengths in millimetres for a plot."""
    return 1e3 * values.to_numpy()


SPOT_COLOUR, PLANNED_COLOUR, BEAM_COLOUR = colour(1), colour(2), boards.ALARM_COLOUR
"""Colours of the spot, the planned path and the beam; the executed path has the colour of text."""


EYE = {"x": 1.7, "y": -2.0, "z": 1.0}
"""Position of the eye, in units of the scene: far enough to see the laser unit and all spots."""


def space(run: Run) -> dict[str, Any] | None:
    """Show a picture in space of every block of spots."""
    shown = [_space_board(b, run) for b in run.of("cell") if not _kept(b).is_empty()]
    return {"words": (), "boards": shown, "tables": ()} if shown else None


def _kept(b: BlockRows) -> pl.DataFrame:
    return done(b).filter(pl.col("planned").is_not_null()).sort("distance")


def _everywhere(rows: pl.DataFrame, labels: list[str]) -> list[int]:
    """Return the spots to which every method has a path, the nearest first; all spots if there is none."""
    every = rows.group_by("problem", maintain_order=True).agg(pl.col("setting").n_unique())
    found: list[int] = every.filter(pl.col("setting") == len(labels))["problem"].to_list()
    return found or every["problem"].to_list()


def _points(values: Any) -> Array:
    """Return flat numbers as points (k, 3) [mm]."""
    return 1e3 * np.array(values, dtype=float).reshape(-1, 3)


def _space_board(b: BlockRows, run: Run) -> Board:
    rows, name, labels = _kept(b), slug(b.block.id), settings_of([b])
    everything = np.vstack([_points(v) for column in ("planned", "tool", "beam") for v in rows[column]])
    all_spots = 1e3 * done(b).unique("problem").sort("problem").select("x", "y", "z").to_numpy()
    scene = axes_in_space(run.robot(b.block.robot).gravity, np.vstack([everything, all_spots]))
    scene["camera"] |= {"eye": EYE, "center": dict.fromkeys("xyz", 0.0)}
    plot = figure(
        f"cell-space-{name}", "Planned and executed paths of the tool", height=560, scene=scene,
        margin=dict.fromkeys("lrtb", 0),
    )  # fmt: skip
    others = {"size": 2, "color": boards.MUTED_COLOUR}
    add(plot, line_3d(*all_spots.T, digits=5, mode="markers", name="other spots", marker=others, hover="another spot"))
    problems = _everywhere(rows, labels)
    for row in rows.iter_rows(named=True):
        when = shown_at(row["setting"], row["after"]) | {"spot": [str(row["problem"])]}
        for column, words, drawn, width in (
            ("beam", "laser beam, measured", BEAM_COLOUR, 2), ("planned", "planned path", PLANNED_COLOUR, 7),
            ("tool", "executed path", INK_COLOUR, 3),
        ):  # fmt: skip
            look = {"color": drawn, "width": width}
            add(plot, line_3d(*_points(row[column]).T, digits=5, name=words, line=look, hover=words), when)
    marker = {"size": 6, "color": SPOT_COLOUR, "symbol": "diamond", "line": {"color": boards.MUTED_COLOUR, "width": 1}}
    for (problem,), part in rows.group_by("problem", maintain_order=True):
        spot = 1e3 * np.array(part.select("x", "y", "z").row(0))[:, None]
        trace = line_3d(*spot, digits=5, mode="markers", name="true spot", marker=marker, hover="true spot")
        add(plot, trace, {"spot": [str(problem)]})
    far = dict(rows.select("problem", "distance").iter_rows())
    spots = Control("spot", "Spot", tuple((str(p), f"{1e3 * far[p]:.0f} mm away") for p in problems), str(problems[-1]))
    methods = Control.of("method", "Method", labels, next(iter(settings_of([b], whole=True)), labels[0]))
    return Board(
        f"cell-space-board-{name}", (plot,), (methods, after_control(b), spots),
        "Base frame, equal scales; drag to turn. With a budget of iterations the planned path is a move in joint space to the "
        "answer, so it is not straight.",
    )  # fmt: skip


SPLIT_BINS = 8
"""Bins of equal count over the distance."""

MOST_REASONS = 4
"""Number of reasons that are named for trials without an execution: the most frequent ones."""

LEAST_MM = 1e-6
"""Least value of a plot [mm]: no plant is exact to a nanometre, and the axis must end somewhere."""

SPLIT_COLUMNS = {**{part: f"{part}_error" for part in PART_WORDS}, "total": "position_error"}
"""Columns of the lengths of the parts and of the total error."""


def draw_error_parts(run: Run) -> dict[str, Any] | None:
    """Show the parts of the error of every block of spots."""
    blocks = [b for b in run.of("cell") if not done(b).is_empty()]
    if not blocks:
        return None
    words = [
        f"{b.block.title}: {b.rows['problem'].n_unique()} spots, each shown {_times(b.block.repeats)}, executed on the drive "
        f"{drives_of(b)}, set-points every {1e3 * b.block.period:g} ms{_load_words(b)}. What varies from trial to trial: "
        f"{noise_words(b.block.noise) or 'nothing'}. With a budget of iterations the arm moves in joint space to the method's "
        "best iterate. A whole line uses the planning pipeline from laser to execution."
        for b in blocks
    ]
    worst = max(float(np.nanmax(b.rows["split_rest"].to_numpy())) for b in blocks)
    words += [lost for b in blocks if (lost := _not_executed(b))]
    words.append(f"In every trial the four vectors add up to the total error within {worst:.1e} m.")
    return {"words": words, "boards": [_split_board(b) for b in blocks], "tables": [spots_table(b) for b in blocks]}


def _load_words(b: BlockRows) -> str:
    return "" if b.block.payload is None else f", {b.block.payload:g} kg in the tool"


def _not_executed(b: BlockRows) -> str:
    """Describe how many trials of each method were not executed, and why, without the place of the failure."""
    lost = b.rows.filter(pl.col("known") & pl.col("position_error").is_null())
    if lost.is_empty():
        return ""
    why = lost.with_columns(why=pl.col("reason").str.split(" at s = ").list.first())
    counts = why.group_by("setting", "why", maintain_order=True).len().sort("len", descending=True)
    words = [f"{count} of {setting}: {reason}" for setting, reason, count in counts.head(MOST_REASONS).iter_rows()]
    trials = "1 trial was" if len(lost) == 1 else f"{len(lost)} trials were"
    return f"{b.block.title}: {trials} not executed. {'; '.join(words)}."


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _split_board(b: BlockRows) -> Board:
    rows, name = done(b), slug(b.block.id)
    labels = settings_of([b])
    low = {"range": [np.log10(LEAST_MM) - 0.3, 3.0]}
    budgets = figure(
        f"split-budget-{name}", "Against the iteration budget", boards.axis("iteration budget", type="category"),
        boards.log_axis("median length [mm]", **low), 400,
    )  # fmt: skip
    far = figure(
        f"split-distance-{name}", "Against the distance of the spot", "distance from the start [mm]",
        boards.log_axis("median length [mm]", **low), 400,
    )  # fmt: skip
    for label in labels:
        part = rows.filter(pl.col("setting") == label)
        _by_budget(budgets, part, label)
        for (after,), at in part.group_by("after", maintain_order=True):
            _by_distance(far, at, label, str(after))
    controls = (Control.of("method", "Method", labels), after_control(b))
    return Board(
        f"split-{name}", (budgets, far), controls,
        "Median lengths of the vectors over the executed trials. The vectors add up, their lengths do not. Lengths below a "
        "nanometre are shown as a nanometre: a move in joint space ends exactly at the answer, and if no iterate is better "
        "than the start, nothing is executed.",
    )  # fmt: skip


def _medians(rows: pl.DataFrame) -> dict[str, float]:
    return {
        part: max(1e3 * quantiles(rows[column].to_numpy(), (0.5,))[0], LEAST_MM)
        for part, column in SPLIT_COLUMNS.items()
    }


def _by_budget(plot: Figure, rows: pl.DataFrame, label: str) -> None:
    at = [(str(after), _medians(part)) for (after,), part in rows.group_by("after", maintain_order=True)]
    x = ["the whole line" if after == WHOLE else after for after, _ in at]
    for part in SPLIT_COLUMNS:
        add(plot, _line(part, x, [found[part] for _, found in at]), {"method": [label]})


def _by_distance(plot: Figure, rows: pl.DataFrame, label: str, after: str) -> None:
    order = np.argsort(rows["distance"].to_numpy(), kind="stable")
    parts = [rows[i.tolist()] for i in np.array_split(order, SPLIT_BINS) if len(i)]
    x = 1e3 * np.array([float(np.median(p["distance"].to_numpy())) for p in parts])
    medians = [_medians(p) for p in parts]
    for part in SPLIT_COLUMNS:
        add(plot, _line(part, x, [found[part] for found in medians]), shown_at(label, after))


def _line(part: str, x: Any, y: list[float]) -> Scatter:
    total = part == "total"
    return boards.line(
        x, y, mode="lines+markers", marker={"size": 6},
        line={"color": TOTAL_COLOUR if total else PART_COLOURS[part], "width": 2, "dash": "dot" if total else "solid"},
        name="total: executed − spot" if total else PART_WORDS[part],
        hover=f"{'all' if total else PART_WORDS[part]}<br>%{{y:.3g}} mm",
    )  # fmt: skip


FIGURES = {"x": 11, "y": 12, "z": 13}
"""The paper's figure of each axis."""

FINE_SCALE, WHOLE_SCALE = "near", "all"
"""Choices of the scale of errors."""

NEAR_MM = 6.0
"""End of the fine scale: three times the paper's 2 mm [mm]."""


def axes(run: Run) -> dict[str, Any] | None:
    """Show Fig. 11 to 13 of every block of spots."""
    blocks = [b for b in run.of("cell") if not done(b).is_empty() and settings_of([b], whole=False)]
    if not blocks:
        return None
    words = [
        "The paper plots the difference of laser point and robot end on X, Y and Z for several numbers of iterations over the "
        "workspace (Fig. 11 to 13). It prints no values. These plots have the same axes and the values of this simulation: "
        "executed tool − spot, in the base frame."
    ]
    return {"words": words, "boards": [_errors(b) for b in blocks], "tables": ()}


def _errors(b: BlockRows) -> Board:
    """Plot the error on each axis against the distance, for several budgets."""
    rows, name, labels = done(b), slug(b.block.id), settings_of([b], whole=False)
    budgets = chosen(b.block.budgets)
    colours = dict(zip(budgets, boards.shades(len(budgets)), strict=True))
    plots = []
    for a, printed in FIGURES.items():
        plot = figure(
            f"cell-error-{a}-{name}", f"{a.upper()} error (Fig. {printed})",
            boards.axis("distance from the start [mm]", rangemode="tozero"), f"error in {a.upper()} [mm]", 360,
            shapes=[boards.level(1e3 * WITHIN_M, "± 2 mm"), boards.level(-1e3 * WITHIN_M)],
        )  # fmt: skip
        boards.vary(plot, {"scale": [FINE_SCALE]}, {"yaxis": {"range": [-NEAR_MM, NEAR_MM]}})
        for label in labels:
            for budget in budgets:
                part = rows.filter((pl.col("setting") == label) & (pl.col("budget") == budget))
                trace = boards.line(
                    millimetres(part["distance"]), millimetres(part[f"error_{a}"]), mode="markers",
                    marker={"size": 5, "color": colours[budget]}, name=iterations(budget),
                    hover=f"{iterations(budget)}<br>%{{x:.0f}} mm away: %{{y:.3g}} mm",
                )  # fmt: skip
                add(plot, trace, {"method": [label]})
        plots.append(plot)
    scale = Control("scale", "Scale", ((FINE_SCALE, f"± {NEAR_MM:g} mm"), (WHOLE_SCALE, "all errors")))
    return Board(
        f"cell-errors-{name}", tuple(plots), (Control.of("method", "Method", labels), scale),
        "Fig. 11, 12 and 13 as executed, one point for each trial. The fine scale clips larger errors.",
    )  # fmt: skip


# ---------------- sections of the report on the executed cell


def claims(run: Run) -> dict[str, Any] | None:
    """Show the paper's claims as executed, for every block of spots."""
    found = [f for b in run.of("cell") for f in executed_claims(b.rows)]
    return claims_of(found) if found else None


def findings(run: Run) -> Sequence[str]:
    """Return verdicts as executed, one sentence for each claim of each block."""
    found = [f for b in run.of("cell") for f in executed_claims(b.rows)]
    return [f"As executed, claim ({f.key}) {f.verdict}: {f.summary}" for f in found]


def limitations(run: Run) -> Sequence[str]:
    """Say that nothing is measured; the section on the sources of the error describes the simulation."""
    return ["Every execution is simulated; nothing was measured on a real arm."]


REPORT = KindReport(
    (
        Section("The paper's claims, as executed", "cell-claims", claims, QUESTION.with_name("claims.html.j2"), 61),
        Section("The task in space", "cell-space", space, order=62),
        Section("Sources of the error", "cell-split", draw_error_parts, order=63),
        Section("Errors on each axis, as executed (Fig. 11 to 13)", "cell-axes", axes, order=64),
    ),
    lambda blocks: ("executed motions of the laser cell",),
    tables=tables,
    findings=findings,
    limitations=limitations,
    labels=lambda block: [m.label for m in block.methods],
)
