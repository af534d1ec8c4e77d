"""`optik stream`: chunks of joint targets from a file, as a policy would emit them, on a simulated arm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from benchmarks.cli.command import LimitsCommand, TableCommand, argument, option, out_console, print_json
from benchmarks.cli.motion import DRIVE_HELP
from benchmarks.cli.readers import read_configuration
from optik.errors import InvalidInput

if TYPE_CHECKING:
    from planners.retarget import Setpoint
    from planners.retarget.chunk import Chunk


@dataclass(frozen=True, kw_only=True)
class StreamCommand(LimitsCommand, TableCommand):
    """Join chunks of joint targets while the arm moves, every time within the limits, and execute them on a simulated arm.

    The file has the columns observed [s], index, and the joints (q1_deg,… or their names). Rows with the same time of
    observation are one chunk. The exit status is 0 if the arm followed to the end at rest.
    """

    file: Path = argument("FILE", "Table of the chunks, FILE.csv.")
    on: str = option("Options", f"{DRIVE_HELP}.", "ideal")
    rate: float = option("Options", "Targets of a chunk per second [1/s].", 20.0)
    latency: float = option("Options", "Time from the observation of a chunk to its arrival [s].", 0.1)
    pace: float = option("Options", "Largest rate of the chunks, over their own; above 1 to be faster.", 1.0)
    tolerance: float = option("Options", "Largest distance of a smoothed target [rad, prismatic m].", 0.005)
    start_deg: str | None = option("Robot", "Start [degrees, prismatic mm]; by default the first target.")
    out: Path | None = option("Output", "File for set-points and measured positions, FILE.csv.")

    def run(self) -> None:
        """Stream, execute, and print."""
        from planners import MotionLimits, stream
        from planners.cell.drives import make_drive
        from planners.retarget.chunk import load_chunks

        if self.out is not None and self.out.suffix.lower() != ".csv":
            raise InvalidInput("--out", self.out, "a name that ends in .csv")
        if not (np.isfinite(self.latency) and self.latency >= 0.0):
            raise InvalidInput("--latency", self.latency, "seconds, at least 0")
        arm = self.load()
        chunks = load_chunks(self.file, arm, self.rate, columns=self.columns)
        limits = MotionLimits.of(arm, **self.read_typed_limits(arm))
        first = np.asarray(chunks[0].points)[0]
        start = first if self.start_deg is None else read_configuration(arm, self.start_deg)
        drive = make_drive(self.on, arm)
        source = _Recording(chunks, self.latency)
        options: dict[str, Any] = {"limits": limits, "pace": self.pace, "tolerance": self.tolerance}
        flow = stream(
            arm, source, start, rate=1.0 / drive.period, realtime=False, silence=source.longest_gap, **options
        )
        done = drive.follow(flow)
        if self.out is not None:
            header = ",".join(["t", *arm.joint_names, *(f"measured_{name}" for name in arm.joint_names)])
            np.savetxt(
                self.out, np.column_stack([done.t, done.setpoints, done.q]), "%.9g", ",", header=header, comments=""
            )
        if self.as_json:
            print_json(
                {
                    "report": done.report._asdict(),
                    "error": done.error.tolist(),
                    "fault": done.fault,
                    "end": float(done.t[-1]),
                }
            )
        else:
            report = str(done.report).replace("tolerance=", "--tolerance ")
            out_console.print(f"{len(chunks)} chunks on {self.on}, {done.t[-1]:.3g} s\n{report}", highlight=False)
            out_console.print(f"largest distance from the set-points: {1e3 * done.error.max():.3g} mrad (or mm)")
            if done.fault:
                out_console.print(f"stopped: {done.fault}", style="red")
            if self.out is not None:
                out_console.print(f"written to {self.out}")
        raise typer.Exit(0 if done else 1)


class _Recording:
    """A source that gives each chunk a time after its observation."""

    def __init__(self, chunks: list[Chunk], latency: float) -> None:
        self._waiting = [(chunk.observed + latency, chunk) for chunk in chunks]
        times = np.array([0.0, *(t for t, _ in self._waiting)])
        self.longest_gap = float(np.diff(times).max()) + 0.1

    def __call__(self, now: Setpoint) -> Chunk | None:
        """Return the chunk that has come last, if one has."""
        come = [chunk for t, chunk in self._waiting if t <= now.t]
        self._waiting = self._waiting[len(come) :]
        return come[-1] if come else None
