"""Detailed view of one line: its phase plane with the curves that bound it, and the active constraints along it."""

from __future__ import annotations

import numpy as np
import polars as pl

from benchmarks.blocks._arms import arm_label
from benchmarks.blocks._torques import JOINT_LIMITS
from benchmarks.blocks.timing.laws.rows import LawRows
from benchmarks.report.active import ACTIVE, active_plot, limit_colour
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.figures import BAND_COLOUR, HOVER, INK_COLOUR, MUTED_COLOUR, axis, lean, line, log_axis
from benchmarks.report.run import Run
from benchmarks.report.words import quoted
from optik.registry import short_name
from planners.limits import ALL_LIMITS, DERIVATIVES, LOADED

_METRES, _RADIANS = (1e3, "mm"), (1.0, "rad")
"""Scale and unit of the places on a path, of the tool and in joint space."""

FAR = 1e3
"""Curves that bound the speed are cut at this multiple of the speed of the fastest motion."""


def example_boards(b: LawRows, run: Run) -> list[Board]:
    """The phase plane of all laws, and the active constraints of each."""
    motions, binding, curve = (b.example(name) for name in ("motions", "binding", "curve"))
    if motions is None or binding is None or curve is None or curve.is_empty():
        return []
    words = _which(b)
    unit = _RADIANS if b.block.example.kind == "joints" else _METRES
    return [_phase(b, run, motions, curve, words, unit), _constraints(b, motions, binding, words, unit)]


def _which(b: LawRows) -> str:
    """Which path is shown, in words; paths count from 1."""
    chosen, arm = b.block.example, arm_label(b.block.example.robot, b.block.example.payload)
    within = f"on {arm}, within the limits {quoted(chosen.limits)}"
    if chosen.path:
        return f"path {short_name(chosen.path)} {within}"
    counts = [part.count for part in b.block.lines if (part.arm, part.kind) == (arm, chosen.kind)]
    of = f" of {counts[0]}" if counts and chosen.index < counts[0] else ""
    return f"{chosen.kind.replace('_', '-')} path number {chosen.index + 1}{of} {within}"


def _phase(
    b: LawRows, run: Run, motions: pl.DataFrame, curve: pl.DataFrame, words: str, of: tuple[float, str]
) -> Board:
    scale, unit = of
    laws = motions["law"].unique(maintain_order=True).to_list()
    fastest = float(motions["speed"].to_numpy().max())
    plot = Plot(
        "timing-phase", "Speed along the path and its limit curves",
        {"xaxis": axis(f"s [{unit}]"), "yaxis": axis(f"ds/dt [{unit}/s]", range=[0, 1.25 * scale * fastest])}, 440,
    )  # fmt: skip
    at = f"<br>%{{y:.4g}} {unit}/s at %{{x:.4g}} {unit}{HOVER}"
    bounds = (
        ("velocity", {"color": INK_COLOUR, "width": 1.6, "dash": "dash"}, "velocity limit of %{text}"),
        (
            "acceleration",
            {"color": MUTED_COLOUR, "width": 1.6, "dash": "dot"},
            "acceleration limits, for any path acceleration",
        ),
    )
    for field, look, meaning in bounds:
        trace = line(
            x=lean(scale * curve["s"].to_numpy()), y=lean(scale * np.minimum(curve[field].to_numpy(), FAR * fastest)),
            name=f"{field} limits", text=curve["velocity_joint"].to_list(), line=look, hovertemplate=meaning + at,
        )  # fmt: skip
        plot.add(trace)
    for law in laws:
        part = motions.filter(pl.col("law") == law)
        plot.add(
            line(
                x=lean(scale * part["s"].to_numpy(), 5), y=lean(scale * part["speed"].to_numpy()), name=law,
                line={"color": run.colour(law), "width": 2}, hovertemplate=law + at,
            )
        )  # fmt: skip
    legend = [Key(law, run.colour(law)) for law in laws]
    legend += [
        Key("limit curve of the joint velocities", INK_COLOUR, "dashed"),
        Key("limit curve of the joint accelerations", MUTED_COLOUR, "dashed"),
    ]
    return Board(
        f"{b.block.id}-phase", (plot,), (), tuple(legend),
        f"The {words}. The dashed curves are the maximum-velocity curves: every motion above one of them exceeds a limit.",
    )  # fmt: skip


def _constraints(b: LawRows, motions: pl.DataFrame, binding: pl.DataFrame, words: str, of: tuple[float, str]) -> Board:
    """The active constraints of every law along the line, and how near its joints come to their limits."""
    laws = motions["law"].unique(maintain_order=True).to_list()
    near = binding.filter(pl.col("ratio") >= ACTIVE)
    drawn = [name for name in LOADED if name in motions.columns and motions[name].is_not_nan().any()]
    used = [name for name in ALL_LIMITS if name in DERIVATIVES or name in drawn or name in set(near["limit"])]
    legend = [Key(field.replace("_", " "), limit_colour(field)) for field in used] + [
        Key("beyond the limit", BAND_COLOUR, "fill")
    ]
    initial = next((law for law in laws if law == b.block.plan), laws[0])
    return Board(
        f"{b.block.id}-who", (active_plot("timing-who", near, laws, *of), _ratios(motions, laws, of)),
        (Control.of("law", "Time law", laws, initial),), tuple(legend),
        f"The {words}. First plot: where a joint is within {100 * (1 - ACTIVE):.0f} % of a limit, from the certificate. "
        "Second plot: the jerk of a law without a jerk limit is far above 1. Where its acceleration is discontinuous the jerk "
        "is infinite; the plot shows it between these points.",
    )  # fmt: skip


def _ratios(motions: pl.DataFrame, laws: list[str], of: tuple[float, str]) -> Plot:
    """The worst value over limit of every derivative along the line."""
    scale, unit = of
    beyond = {
        "type": "rect", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1e6, "layer": "below", "fillcolor": BAND_COLOUR,
        "line": {"width": 0},
    }  # fmt: skip
    layout = {
        "xaxis": axis(f"s [{unit}]"),
        "yaxis": log_axis("value / limit", dtick=1, range=[-2.3, 3.2]),
        "shapes": [beyond],
    }
    plot = Plot("timing-ratios", "Largest value / limit of any joint", layout, 340)
    for law in laws:
        part = motions.filter(pl.col("law") == law)
        for field in (name for name in JOINT_LIMITS if name in part.columns and part[name].is_not_nan().any()):
            words = field.replace("_", " ")
            trace = line(
                x=lean(scale * part["s"].to_numpy(), 5), y=lean(np.maximum(part[field].to_numpy(), 1e-4)), name=words,
                line={"color": limit_colour(field), "width": 1.6},
                hovertemplate=f"{words} %{{y:.4g}} of its limit at %{{x:.4g}} {unit}{HOVER}",
            )  # fmt: skip
            plot.add(trace, {"law": [law]})
    return plot
