"""`optik certify`: judge a motion of another program against limits, a path and a scene."""

from __future__ import annotations

import hashlib
import platform
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import typer
from rich.table import Table

from benchmarks.cli import command
from benchmarks.cli.command import LimitsCommand, TableCommand, argument, numbers, option, out_console, print_json
from benchmarks.cli.motion import read_motion
from benchmarks.cli.plan import SceneCommand, print_facts
from benchmarks.cli.readers import read_configuration, read_number_list
from benchmarks.provenance import version_here
from optik.arm.model import unit_factors, unit_names
from optik.arm.motors import have_same_matrix
from optik.check import format_ratio
from optik.errors import InvalidInput
from optik.file_io import check_suffix, read_bytes
from optik.ik.base import Tolerance
from optik.plugins.files import split_links
from optik.tables import read_table
from optik.types import Array

if TYPE_CHECKING:
    import optik
    from planners import Certificate, Motion, Trajectory
    from planners import Path as ToolPath

NOT_JUDGED = "not judged"
"""Word for what is not known or not given."""
VERSIONS = ("optik-toolkit", "numpy", "scipy", "numba")
"""Packages that compute a certificate."""


class GivenPath(NamedTuple):
    """The path that the tool must follow, or the waypoints of a polyline, and the tolerance; an angle of π is not judged."""

    path: ToolPath | Array
    tolerance: Tolerance


@dataclass(frozen=True, kw_only=True)
class CertifyCommand(LimitsCommand, SceneCommand, TableCommand):
    """Judge a motion that another program made: its limits, and with --path and --scene its path error and clearance.

    All bounds hold between the points, too. What is unknown reads "not judged". The exit status is 0 if everything that is
    judged is respected. It is 1 if a limit is exceeded, the tool leaves the path, the arm touches the scene, or one of these
    is not proved.
    """

    file: Path = argument(
        "FILE", "A table .csv, or .json, .yaml or .yml with a table or a ROS message; or a saved motion."
    )
    path: Path | None = option(
        "Path", "Path that the tool must follow: waypoints in a .csv as for `optik plan polyline`, or a saved motion."
    )
    tolerance: str = numbers("Path", "Largest distance [mm] and angle [degrees] of the tool from --path.", "1,0.5")
    start_deg: str | None = numbers(
        "Path", "Configuration at 0 s [degrees, prismatic mm], if the first point is later."
    )
    unwrap: str | None = option(
        "Path", "Joints whose jumps by whole turns are removed, comma-separated; none accepts them."
    )
    interpolation: str | None = option("Path", "Interpolation: linear, cubic, quintic, or spline (through positions).")
    unit: str | None = option(
        "Path", "Units that FILE does not state, such as ms,deg: of s, ms, us, ns; rad, deg; m, mm."
    )
    html: Path | None = option("Output", "Also write a page with the motion and its plots, FILE.html.")

    def run(self) -> None:
        """Read, certify, and print or write."""
        import planners

        arm, saved, program_path = self._load_arm()
        if self.html is not None:  # before a motion takes its time
            from optik.view.page import PAGE_SUFFIXES

            check_suffix(self.html, PAGE_SUFFIXES, "--html")
        stated = {} if saved is None else {name: saved.limits.value(name) for name in saved.limits.names}
        trajectory = self._read_trajectory(arm)
        limits = planners.MotionLimits.of(arm, **(stated | self.read_typed_limits(arm)))
        reference, scene = self._read_path(arm, trajectory, saved), self.load_scene(arm)
        if saved is not None and self.scene is None:
            scene = saved.scene
        if reference is None and scene is None and all(limits.value(name) is None for name in limits.names):
            advice = "add --limits joint_limits.yaml, or for example --velocity 2"
            raise InvalidInput(
                "--limits", f"none, and {arm.name} has none of its own", "at least one limit", advice=advice
            )
        path, tolerance = (program_path, None) if reference is None else reference
        proof = planners.certify(arm, path, trajectory, limits, scene=scene, tolerance=tolerance)
        if self.html is not None:
            self._write_page(arm, trajectory, proof, limits, scene, None if saved is None else saved.world)
        if self.as_json:
            print_json(proof.to_dict() | {"notes": list(trajectory.notes), **self._describe_inputs(arm)})
        else:
            _print_verdict(proof, trajectory)
            _print(arm, proof, reference, self.file.name, program_path)
            if self.html is not None:
                out_console.print(f"written to {self.html}")
        raise typer.Exit(0 if proof.is_valid else 1)

    def _load_arm(self) -> tuple[optik.Robot, Motion | None, ToolPath | None]:
        """Return the typed arm; for a saved motion of it the motion, and its path if payloads change on it."""
        from planners.files.setpoints import read_saved

        recorded, warning = read_saved(self.file), ""
        if recorded is None:
            return self.load(), None, None
        saved, is_exact = recorded
        arm = self.load() if self.robot != command.RobotCommand.robot else saved.robot
        robots = dict.fromkeys(getattr(saved.path, "robots", ()))
        if not (same := _is_same(arm, saved.robot)):
            robots = {}
            warning = f"--robot {self.robot} is not the arm of the file: judged without the payload of the file"
        else:
            arm = self.limit_ranges(saved.robot)
            if len(robots) > 1 and not is_exact:
                robots = {}
                warning = f"points at a rate do not say when the payload changes: judged with {arm.payload or 'none'}"
        if warning:
            command.err_console.print(f"warning: {warning}", style="yellow", soft_wrap=True)
        return arm, saved if same and is_exact else None, saved.path if robots else None

    def _read_trajectory(self, arm: optik.Robot) -> Trajectory:
        """Return the motion of the file."""
        import planners

        start = read_configuration(arm, self.start_deg) if self.start_deg is not None else None
        unwrap = () if self.unwrap == "none" else self.unwrap
        return planners.load_trajectory(
            self.file, arm, joint_names=self.read_joint_names(arm), start=start, unwrap=unwrap,
            interpolation=self.interpolation, columns=self.columns, ignore=self.ignore,
            unit=self.unit,
        )  # fmt: skip

    def _read_path(self, arm: optik.Robot, trajectory: Trajectory, saved: Motion | None) -> GivenPath | None:
        """Return the path of ``--path``, or of a saved motion, with its tolerance; without orientations, of positions alone."""
        from planners.paths.waypoints import read_waypoints

        position, rotation = np.multiply(read_number_list(self.tolerance, "--tolerance", 2), (1e-3, np.pi / 180.0))
        if not (position > 0.0 and 0.0 < rotation <= np.pi):
            expected = "a distance above 0 [mm], and an angle above 0 and up to 180 [degrees]"
            raise InvalidInput("--tolerance", self.tolerance, expected)
        if self.path is None:
            follows = saved is not None and trajectory.knots.size == saved.trajectory.knots.size
            return GivenPath(saved.path, saved.tolerance) if saved is not None and saved.tolerance and follows else None
        if self.path.suffix.lower() != ".csv" or read_bytes(self.path).startswith(b"# format"):
            return GivenPath(read_motion(self.path, "--path").path, Tolerance(position, rotation))
        table = read_table(self.path)
        try:
            return GivenPath(read_waypoints(table, None, arm, None), Tolerance(position, rotation))
        except InvalidInput as error:
            if error.argument != "orientation":
                raise
        turned = arm.fk(trajectory(0.0))[:3, :3]
        return GivenPath(read_waypoints(table, turned, arm, None), Tolerance(position, np.pi))

    def _write_page(
        self, arm: optik.Robot, trajectory: Trajectory, proof: Certificate, limits: Any, scene: Any, world: Any
    ) -> None:
        """Write the page of ``--html``."""
        from dataclasses import replace

        from optik.view.page import write_page
        from planners.motion.show import show_trajectory

        assert self.html is not None
        show = show_trajectory(arm, trajectory, proof, limits, scene, world)
        facts = (("Between points", _describe_interpolation(proof, trajectory)), *show.facts)
        write_page(replace(show, title=f"{arm.name}: {self.file.name}", facts=facts), self.html)

    def _describe_inputs(self, arm: optik.Robot) -> dict[str, Any]:
        """Return the SHA-256 of all files that were read, and the versions."""
        given = {"file": self.file, "limits": self.limits, "path": self.path, "scene": self.scene, "srdf": self.srdf}
        given["robot"] = split_links(self.robot)[0]
        files = {key: Path(name) for key, name in given.items() if name is not None and Path(name).is_file()}
        inputs = {
            key: {"name": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
            for key, file in files.items()
        }
        versions = {"python": platform.python_version()} | {name: version_here(name) for name in VERSIONS}
        return {"inputs": inputs, "robot": {"name": arm.name, "fingerprint": arm.fingerprint}, "versions": versions}


# ---------------------------------------------------------------- the table


def _is_same(one: optik.Robot, other: optik.Robot) -> bool:
    """Return whether two arms have the same links, motors and masses; tools, payloads and limits may differ."""
    same = one.joint_names == other.joint_names and np.array_equal(one.fixed, other.fixed)
    same = same and have_same_matrix(one.motors, other.motors) and one.linkage == other.linkage
    masses = [None if arm.inertia is None else arm.inertia.content for arm in (one, other)]
    return same and masses[0] == masses[1]


def _print_verdict(proof: Certificate, trajectory: Trajectory) -> None:
    """Print the verdict, how the motion is interpolated, and the reasons."""
    good = proof.is_valid
    words = "valid: everything that is judged is respected at every instant" if good else "NOT valid"
    out_console.print(f"certificate {words}", style="green" if good else "yellow")
    out_console.print(f"between its points the motion is {_describe_interpolation(proof, trajectory)}", soft_wrap=True)
    for reason in proof.reasons:
        out_console.print(f"  {command.translate(reason)}", style="yellow", soft_wrap=True)


def _describe_interpolation(proof: Certificate, trajectory: Trajectory) -> str:
    """Describe the motion between its points, and what to do if it is straight lines that are not valid."""
    high, low = (trajectory.padded[part].any() for part in (slice(2), slice(2, 4)))
    advice = ", as in ros2_controllers for positions alone; --interpolation spline judges a spline through them"
    return "quintic" if high else "cubic" if low else f"linear{'' if proof.is_valid else advice}"


def _print(arm: optik.Robot, proof: Certificate, reference: GivenPath | None, title: str, path: Any = None) -> None:
    """Print what was judged."""
    table = Table("", "peak / limit", "joint", "time, s", "", title=f"{title}: {proof.duration:.4f} s")
    for row in (_position_row(arm, proof), *_limit_rows(proof), *_path_rows(proof, reference)):
        table.add_row(*row)
    if proof.clearance is None:
        table.add_row("clearance", "", "", "", NOT_JUDGED)
    out_console.print(table)
    print_facts(proof, arm, getattr(path, "robots", ()))


def _position_row(arm: optik.Robot, proof: Certificate) -> tuple[str, ...]:
    """Return the row of the joint ranges."""
    i = int(np.argmin(proof.position_margin))
    margin, times = proof.position_margin[i], proof.t_position_margin
    if not np.isfinite(margin):
        return "position", "", "", "", NOT_JUDGED
    free = [name for name, x in zip(arm.joint_names, proof.position_margin, strict=True) if not np.isfinite(x)]
    verdict = _verdict(bool(margin >= -1e-9), "exceeded", free)
    size = f"{abs(margin) * unit_factors(arm)[i]:.3g}{unit_names(arm)[i]} {'inside' if margin >= 0.0 else 'outside'}"
    return "position", size, arm.joint_names[i], f"{0.0 if times is None else times[i]:.3f}", verdict


def _limit_rows(proof: Certificate) -> list[tuple[str, ...]]:
    """Return the rows of all kinds of limits."""
    rows: list[tuple[str, ...]] = []
    from planners.limits import ALL_LIMITS

    for field in (*ALL_LIMITS, *proof.extra):
        (ratio, joint, t), name = proof.worst(field), field.replace("_", " ")
        if np.isnan(ratio):
            rows.append((name, "", "", "", NOT_JUDGED))
            continue
        every = np.atleast_1d(proof.extreme(field).ratio)
        free = [n for n, x in zip(proof.joint_names, every, strict=False) if every.size > 1 and np.isnan(x)]
        within = not any(v.words.startswith(f"{field} of ") for v in proof.violations)
        rows.append((name, format_ratio(ratio), joint, f"{t:.3f}", _verdict(within, "exceeded", free)))
    return rows


def _path_rows(proof: Certificate, reference: GivenPath | None) -> list[tuple[str, ...]]:
    """Return the rows of the path error, with the proved bounds over the tolerance."""
    if reference is None:
        return [("path", "", "", "", NOT_JUDGED)]
    off, tolerance = proof.path_error, reference.tolerance
    each = (("path distance", off.distance, off.found_distance, off.t_distance, tolerance.position),
            ("path angle", off.angle, off.found_angle, off.t_angle, tolerance.rotation))  # fmt: skip
    rows: list[tuple[str, ...]] = []
    for name, bound, found, t, allowed in each:
        if allowed == np.pi or (name == "path angle" and proof.asked == "point"):
            rows.append((name, "", "", "", NOT_JUDGED))
            continue
        ratio = bound / allowed
        wrong = "exceeded" if found > allowed else "not proved"
        rows.append((name, format_ratio(ratio), "tool", f"{t:.3f}", _verdict(ratio <= 1.0, wrong)))
    return rows


def _verdict(within: bool, wrong: str, free: list[str] | None = None) -> str:
    """Return the last cell of a row; `free` are joints without a limit."""
    words = "respected" if within else wrong
    return f"{words} ({', '.join(free)} {NOT_JUDGED})" if free else words
