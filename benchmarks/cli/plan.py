"""`optik plan`: timed and certified motions along the paths of `benchmarks.cli.paths`, and certificates in print."""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer
from rich.table import Table

import optik
from benchmarks.cli import command
from benchmarks.cli.command import RobotCommand, Start, numbers, option, out_console, translate
from benchmarks.cli.group import GroupCommand, format_joints
from benchmarks.cli.readers import ALLOW_HELP, read_allowed, read_bound, read_number_list
from optik.check import check_number, describe_ratio, format_count, format_ratio
from optik.errors import InvalidInput
from optik.file_io import write_atomically
from optik.plugins.files import split_links
from optik.registry import names
from optik.types import Array

if TYPE_CHECKING:
    import planners


# ---------------- certificates as the command line prints them


MOST_CORNERS = 8
"""Corners of a program that are listed."""


def describe_effort(proof: Any, robot: Any, robots: Sequence[Any] = ()) -> str:
    """Describe the mass model of a motion, its energy and its power."""
    payload = robot.payload
    net = round(proof.energy.net, 9) + 0.0  # neither rounding errors nor −0
    loads = list(dict.fromkeys(str(arm.payload or "none") for arm in robots))  # of a program
    load = "without payload" if payload is None else f"with {payload}"
    load = f"with payloads {', '.join(loads)}" if loads[1:] else load
    words = (
        f"for this mass model, {load}: energy {proof.energy.drawn:.3g} J ({net:.3g} J if braking returns energy), "
        f"peak power {round(proof.energy.power, 9):.3g} W"
    )
    if proof.friction_steps:
        most = max(proof.friction_steps, key=lambda step: step.size)
        unit = "N" if robot.prismatic[robot.joint_names.index(most.joint)] else "N·m"
        steps = f"which steps {len(proof.friction_steps)} times by up to {most.size:.3g} {unit}"
        words += f"; torque rates exclude Coulomb friction, {steps}"
    return words


def print_facts(proof: Any, robot: Any, robots: Sequence[Any] = ()) -> None:
    """Print path error, tool speed, singular value, clearance, energy and power of a motion."""
    from planners.certificate.certificate import fact_lines

    lines = [*fact_lines(proof), *([] if proof.energy is None else [describe_effort(proof, robot, robots)])]
    if proof.clearance is not None:
        lines.append(
            f"{len(proof.clearance.left_out)} pairs of links are not checked; --json lists them with the reasons"
        )
    for line in lines:
        out_console.print(translate(line))


def print_certificate(plan: Any, by_law: tuple[str, ...]) -> None:
    """Print a plan's certificate; `by_law` are the limits that its time law enforces."""
    from planners.certificate.certificate import describe_scope, summary_lines
    from planners.limits import ALL_LIMITS, DERIVATIVES

    proof = plan.certificate
    limits = (*ALL_LIMITS, *proof.extra)
    way = f"{1e3 * plan.path.end:.1f} mm" if plan.path.unit == "m" else f"{np.degrees(plan.path.end):.4g}°"
    arms, parts = getattr(plan.path, "robots", (plan.robot,)), getattr(plan, "parts", ())
    way = f"{format_count(len(parts), 'part')} in {format_count(len(arms), 'section')}" if parts else way
    way += plan.describe_idle() if parts else ""
    title = f"{plan.solver} + {plan.law}: {way} in {proof.duration:.4f} s"
    table = Table("", "peak / limit", "joint", "time, s", f"enforced by {plan.law}", title=title)
    for field in limits:
        ratio, joint, t = proof.worst(field)
        name = field.replace("_", " ")
        required = "yes" if field in by_law else "no, but given" if field in proof.enforced else "no"
        if not np.isnan(ratio):
            table.add_row(name, format_ratio(ratio), joint, f"{t:.3f}", required)
        elif field in DERIVATIVES:
            table.add_row(name, "no limit", "", "", required)
    out_console.print(table)
    for name in proof.exempt:
        out_console.print(f"limit on {name.replace('_', ' ')}{describe_scope(proof, name)}")
    if plan.least_duration:
        out_console.print(f"least duration {plan.least_duration:.4f} s: the slowest joint alone, from rest to rest")
    print_facts(proof, plan.robot, arms)
    beyond = [f for f in limits if f not in proof.enforced and proof.worst(f)[0] > 1.0]
    if beyond:
        words = ", ".join(f"{f.replace('_', ' ')} {describe_ratio(proof.worst(f)[0])}" for f in beyond)
        out_console.print(f"exceeded, since not enforced by {plan.law}: {words}", style="yellow")
    verdict = summary_lines(proof)[0] if proof.is_valid else f"certificate NOT valid: {'; '.join(proof.reasons)}"
    out_console.print(translate(verdict), style="green" if proof.is_valid else "yellow")


def _print_corners(plan: Any) -> None:
    """Print the rounded corners of a program, and those that are narrower than their zone, or stops."""
    corners = getattr(plan, "corners", ())
    if corners:
        away, turned = (max(corner.deviation[k] for corner in corners) for k in (0, 1))
        rounded = format_count(sum(corner.end > corner.begin for corner in corners), "rounded corner")
        most = f"at most {1e3 * away:.3g} mm and {np.degrees(turned):.3g}° from the sharp path (proved)"
        out_console.print(f"{rounded}, {most}", soft_wrap=True)
    reduced = [corner for corner in corners if corner.reduced]
    for corner in reduced[:MOST_CORNERS]:
        name = plan.parts[corner.part].name
        what = (
            f"{1e3 * corner.deviation[0]:.3g} of {1e3 * corner.zone[0]:.3g} mm"
            if corner.end > corner.begin
            else "a stop"
        )
        words = f"  after part {corner.part + 1}{f' {name!r}' if name else ''}: {what}: {corner.reduced}"
        out_console.print(words, soft_wrap=True)
    if len(reduced) > MOST_CORNERS:
        out_console.print(f"  and {len(reduced) - MOST_CORNERS} more; --json lists them")


def print_choice(plan: Any) -> None:
    """Print what a plan chose, and how it avoided obstacles."""
    from planners.paths.free_path import FreePath
    from planners.paths.point_to_point import PointToPoint

    search = plan.search
    _print_corners(plan)
    for line in plan.remarks:
        out_console.print(translate(line))
    if search is not None:
        words = f"{format_count(search.rounds, 'round')} of path and timing"
        if not isinstance(plan.path, FreePath):  # which is not searched
            paths = format_count(search.paths, "initial path")
            words = f"{search.planner} with {search.samples} random configurations, {paths}, {words}"
        out_console.print(f"search: {words}", soft_wrap=True)
    if isinstance(plan.path, PointToPoint) and plan.path.vias and plan:
        away, turned = plan.path.via_errors.max(axis=0)
        words = f"at most {1e3 * away:.3g} mm and {np.degrees(turned):.3g}° away"
        out_console.print(f"via points: {len(plan.path.vias)}, passed in order, {words}", soft_wrap=True)


# ---------------- `optik plan`


SILENT_START = 1e-4
"""Largest difference [rad, m] between the given start and that of the motion for which no line is printed."""
SILENT_STRETCH = 1e-6
"""Relative difference of the durations of a message and its plan up to which no words are printed."""
MOTION_SUFFIXES = ", ".join(f".{name}" for name in names("planners.files"))
"""Suffixes of motions in files, for messages."""

AVOID_HELP = (
    "Search a way around the obstacles of --scene, for joints, ptp, and paths of the tool with --free. Path and timing are "
    "then chosen together."
)
"""Help of ``--avoid``."""
MASS = "a mass [kg] such as 3, or an interval such as 0:3"
"""Values of ``--payload``."""
SLOWED_TO = ("rms_torque", "cycle", "stopping_time", "stopping_distance")
"""Options to which the whole motion is slowed."""
LAWS_WITH = {"speed": "constant_speed", "quiet": "optimal"}
"""Options of time laws, and the law that has each."""
TORQUE_UNITS = {"torque": "[N·m, prismatic N]", "torque_rate": "[N·m/s, prismatic N/s]"}
"""Units of torque limits, for messages."""


@dataclass(frozen=True, kw_only=True)
class SceneCommand(RobotCommand):
    """A command with a scene of obstacles."""

    scene: str | None = option(
        "Scene",
        "File of obstacles: .toml, .json, .urdf, .yaml or .scene; or self, to check collisions between links only.",
    )
    margin: float | None = option("Scene", "Least distance between arm and scene at every instant [m]; with --scene.")

    def load_scene(self, arm: optik.Robot) -> optik.Scene | None:
        """Return the scene of ``--scene``."""
        if self.margin is not None and not 0.0 <= self.margin <= 1.0:
            raise InvalidInput("--margin", self.margin, "a distance from 0 to 1 [m]", advice="10 mm are typed as 0.01")
        if self.scene is None:
            if self.margin is not None:
                advice = "add --scene FILE, or --scene self"
                raise InvalidInput("--margin", f"{self.margin:g} without --scene", "a scene", advice=advice)
            return None
        if arm.shapes is None:
            advice = ""
            if split_links(self.robot)[0].lower().endswith((".urdf", ".xml", ".xacro")):
                typed = f"--robot '{self.robot}{'&' if '#' in self.robot else '#'}shapes=yes'"
                advice = f"{typed} reads shapes from <collision> (package://: --package-dir FOLDER)"
            raise InvalidInput("--scene", f"none for {arm.name}", "an arm with shapes", advice=advice)
        scene = optik.Scene() if self.scene == "self" else optik.Scene.load(self.scene, robot=arm)
        return scene if self.margin is None else replace(scene, margin=self.margin)


@dataclass(frozen=True, kw_only=True)
class PlanCommand(GroupCommand, SceneCommand):
    """A command that plans a motion along a path, certifies it, and writes it."""

    payload: str | None = option("Robot", "Mass of the payload [kg], or an interval: 0:3.")
    samples: int = option("Method", "Number of samples of the path for inverse kinematics.", 151)
    branch: str | None = option(
        "Method",
        "start: the branch of the start configuration (default); best: the best branch for the whole path (default if no "
        "start is typed and the robot has no home, or if the start is not on the path).",
    )
    speed: float | None = option(
        "Method", "Constant speed of the tool [m/s; rad/s if it only turns], with --timing constant_speed."
    )
    duration: float | None = option("Method", "Duration of the motion [s]; by default the shortest.")
    strict: bool = option("Method", "Fail instead of stretching the duration to meet the limits.", False, "--strict")
    quiet: float | None = option(
        "Method", "Frequency [1/s] of an elastic mode that the motion leaves at rest, with --timing optimal."
    )
    tool_speed: str | None = numbers(
        "Limits", "Limit on the speed of the tool point [m/s]; for a polyline also one per segment: 0.1,0.3."
    )
    rotation_speed: str | None = numbers(
        "Limits", "Limit on the angular speed of the tool [rad/s]; for a polyline also one per segment."
    )
    torque: str | None = numbers(
        "Limits", "Torque limits [N·m, prismatic N]: robot (default), none, or numbers: 87,87,12."
    )
    torque_rate: str | None = numbers(
        "Limits", "Torque rate limits [N·m/s, prismatic N/s]: robot (default), none, or numbers."
    )
    rms_torque: str | None = numbers(
        "Limits", "Greatest rms torques over a cycle [N·m, prismatic N]; the whole motion is slowed."
    )
    cycle: float | None = option("Limits", "Duration of that cycle [s]: the motion and rest at its end.")
    stopping_time: float | None = option("Limits", "Greatest duration of a stop [s]; the whole motion is slowed.")
    stopping_distance: float | None = option("Limits", "Greatest way of a stop along the path [m, or rad].")
    allow: list[str] | None = option("Limits", ALLOW_HELP)
    avoid: bool = option("Scene", AVOID_HELP, False, "--avoid")
    out: Path | None = option("Output", f"File for the motion: {MOTION_SUFFIXES}, or .yaml for ROS.")
    out_failed: Path | None = option("Output", "File for a failed plan, FILE.json, for `optik view`; drives refuse it.")
    rate: float | None = option(
        "Output", "Points per second in --out FILE.yaml, FILE.csv and others with points; by default one at each knot."
    )
    format: str | None = option(
        "Output", f"File format of --out, one of: {', '.join(names('planners.files'))}; or a file: ./tsv.py."
    )

    @abstractmethod
    def make_path(self, start: Start) -> planners.Path | Array:
        """Return the typed path, or joints as goal [rad, m]."""

    def choose_winding(self) -> str:
        """Return how joints without limits reach joints as goal."""
        return "nearest"

    def resolution(self) -> dict[str, Any]:
        """Return the typed options of the resolution of the whole path."""
        return {}

    def choose_branch(self, start: Start, path: Any) -> str | None:
        """Return the typed branch, or the default."""
        return self.branch or choose_branch(start, path)

    def plan(self, start: Start, path: Any, law: planners.timing.TimeLaw, words: list[str]) -> Any:
        """Return the plan; the words permit violations."""
        import planners

        arm, members = start.arm, (self.tool or "").split(",")
        return planners.plan(
            self.group or arm, self.group.split(path) if self.group is not None and isinstance(path, np.ndarray) else path,
            self.find_joints(start), tool=tuple(members) if len(members) > 1 else self.tool, frame=self.frame,
            solver=self.solver, timing=law, limits=self.read_limits(arm, law), samples=self.samples,
            branch=self.choose_branch(start, path), duration=self.duration, strict=self.strict, scene=self.load_scene(arm),
            allow=words, avoid=self.avoid, winding=self.choose_winding(), **self.resolution(),
        )  # fmt: skip

    def run(self) -> None:
        """Plan, write and print; exit with status 1 without a motion, or if ``--allow`` does not permit its violations."""
        from planners.certificate.certificate import find_forbidden
        from planners.certificate.violation import LIMIT_WORDS, words_for

        start = self.load_start()
        self._check()
        path = self.make_path(start)
        allow, law, group = read_allowed(self.allow), self.make_law(), self.group
        arm = start.arm if group is None else group.as_robot()
        planned: Any = self.plan(start, path, law, [word for word in allow if word in LIMIT_WORDS])
        of_path, plan = getattr(planned, "paths", {}), planned if group is None else planned.chain_plan
        typed: dict[str, Any] = {name: value for name in SLOWED_TO if (value := getattr(self, name)) is not None}
        if self.rms_torque is not None:
            typed["rms_torque"] = read_bound(self.rms_torque, "--rms-torque")
        if plan and typed:
            planned = plan = plan.slowed_to(**typed)
        proofs = [plan.certificate, *(planned.members[name].certificate for name in of_path)] if plan.has_motion else []
        refused = tuple(one for proof in proofs for one in find_forbidden(proof, allow))
        valid = plan.has_motion and not refused
        sent = None
        if valid and self.out is not None:
            sent = planned.save(self.out, format=self.format, rate=self.rate, allow=allow)
        if not valid and self.out_failed is not None:
            _write_failed(plan, self.out_failed)
        joints = self.find_joints(start)
        begin = planned.trajectory(0.0) if plan.has_motion else joints
        begins_elsewhere = group is not None if joints is None else np.abs(begin - joints).max() > SILENT_START
        if not begins_elsewhere:
            start.print_default()
        if self.as_json:
            command.print_json(plan.to_dict())
            raise typer.Exit(0 if valid else 1)
        print_certificate(plan, law.list_enforced(plan.motion.limits))  # raises NoSolution without a motion
        print_choice(plan)
        for line in () if group is None else planned.remarks:
            out_console.print(translate(line), soft_wrap=True)
        if not valid:
            permission = f"--allow {','.join(words_for(refused, allow))} permits this motion"
            out_console.print(f"not written; {permission}" if self.out else permission)
            raise typer.Exit(1)
        if begins_elsewhere:
            out_console.print(f"start of the motion: --start-deg {format_joints(arm, begin)}", soft_wrap=True)
        if plan.path.configurations(plan.robot, np.zeros(1)) is not None:
            goal = plan.goal if group is None else planned.trajectory(plan.duration)
            out_console.print(f"goal of the motion: {format_joints(arm, goal)} [degrees, prismatic mm]", soft_wrap=True)
        if self.out is not None:
            words = _describe_export(sent, plan) if sent or self.rate is None else _describe_points(plan, self.rate)
            each = planned.members if sent and group is not None else ()
            files = " and ".join(str(self.out.with_suffix(f".{name}{self.out.suffix}")) for name in each) or self.out
            out_console.print(f"written to {files}{words}", soft_wrap=True)

    def make_law(self) -> planners.timing.TimeLaw:
        """Return the time law, at the typed speed."""
        import planners

        typed = {name: value for name in LAWS_WITH if (value := getattr(self, name)) is not None}
        try:
            return planners.make_law(self.timing, **typed)
        except InvalidInput as error:
            if error.argument == "options":
                name, value = next((one, value) for one, value in typed.items() if LAWS_WITH[one] != self.timing)
                expected = f"a law with this option: --timing {LAWS_WITH[name]}"
                raise InvalidInput(f"--{name}", f"{value:g} with --timing {self.timing}", expected) from None
            raise

    def load(self, name: str = "") -> optik.Robot:
        """Load the robot with its payload."""
        arm, payload = super().load(name), self.payload
        if payload is None or self.group is not None:
            return arm
        if arm.inertia is None:
            raise InvalidInput(
                "--payload", f"{payload} on {arm.name}", "an arm with masses in its file, or no --payload"
            )
        try:
            return arm.with_payload(read_bound(payload.replace(":", ","), "--payload"))
        except InvalidInput as error:
            raise InvalidInput("--payload", f"{payload!r}: {error.got}", MASS) from None

    def read_typed_limits(self, arm: optik.Robot) -> dict[str, Any]:
        """Return the typed limits by name."""
        typed = super().read_typed_limits(arm)
        for name in ("tool_speed", "rotation_speed"):
            if (text := getattr(self, name)) is not None:
                typed[name] = read_bound(text, f"--{name.replace('_', '-')}")
        for name in TORQUE_UNITS:
            if (text := getattr(self, name)) is not None:
                typed |= _read_torque_limit(arm, name, text)
        return typed

    def _check(self) -> None:
        """Check before planning that options fit together, and that the motion can be written in the requested format."""
        from planners.files import check_output

        if self.avoid and self.scene is None:
            advice = "add --scene FILE, or --scene self to avoid contact between links"
            raise InvalidInput("--avoid", "no --scene", "a scene", advice=advice)
        if self.out_failed is not None and self.out_failed.suffix.lower() != ".json":
            raise InvalidInput("--out-failed", self.out_failed, "a name that ends in .json")
        if self.rate is not None:
            check_number(self.rate, "--rate", "points per second, above 0", above=0.0)
        for name, value in (("--rate", self.rate), ("--format", self.format)):
            if value is not None and self.out is None:
                raise InvalidInput(name, f"{value} without --out", "a file", advice="add --out FILE")
        try:
            if self.out is not None:
                check_output(self.out, format=self.format, rate=self.rate)
        except InvalidInput as error:
            if error.argument == "options":
                came, advice = f"{self.rate:g} with --out {self.out}", "add --out FILE.yaml or --out FILE.csv"
                raise InvalidInput("--rate", came, "a file of points", advice=advice) from None
            if error.argument != "file":
                raise
            raise InvalidInput("--out", error.got, error.expected, advice="for another name add --format") from None


def choose_branch(start: Start, path: Any) -> str:
    """Return the default of ``--branch``: the start's branch, or the best one if the path begins elsewhere or anywhere."""
    from planners.following.follow import START_TOLERANCE

    if start.q is None:  # the path has its own
        return "best"
    if isinstance(path, np.ndarray):
        return "start"
    if start.is_random:
        return "best"
    return "start" if np.abs(start.arm.pose_errors(start.q, path.pose(0.0))).max() <= START_TOLERANCE else "best"


def _describe_export(sent: Any, plan: planners.Plan) -> str:
    """Describe by how much a message lasts longer than its plan."""
    if sent is None or not sent.trajectory.duration > plan.trajectory.duration * (1.0 + SILENT_STRETCH):
        return ""
    percent = 100.0 * (sent.trajectory.duration / plan.trajectory.duration - 1.0)
    why = "whole periods, and the limits after controller interpolation; all speeds are lower by this factor"
    return f": {sent.trajectory.duration:.4f} s, {percent:.3g} % longer than the plan, for {why}"


def _describe_points(plan: planners.Plan, rate: float) -> str:
    """Describe by how much a motion through the points of a file at a rate exceeds limits."""
    from planners import MotionLimits, certify
    from planners.limits import DERIVATIVES
    from planners.trajectory import simulate_controller

    limits = MotionLimits(**{name: plan.limits.value(name) for name in DERIVATIVES})
    proof = certify(plan.robot, None, simulate_controller(plan.trajectory, rate, "quintic"), limits)
    beyond = [
        f"{name} is {describe_ratio(proof.worst(name)[0])}" for name in DERIVATIVES if proof.worst(name)[0] > 1.0 + 1e-9
    ]
    return f": interpolated between its points, the motion exceeds limits: {', '.join(beyond)}" if beyond else ""


def _write_failed(plan: planners.Plan, file: Path) -> None:
    """Write a failed plan for `optik view`, marked as failed, and name the file on the error stream."""
    from planners.planning.failed import failed_plan_data

    data = failed_plan_data(plan)
    text = json.dumps(data, allow_nan=False) + "\n"
    write_atomically(file, lambda part: part.write_text(text, encoding="utf-8"))
    seen = f"; to see it: optik view {file}" if data["t"] else ", without a configuration"
    command.err_console.print(f"failed plan written to {file}{seen}", soft_wrap=True)


def _read_torque_limit(arm: optik.Robot, field: str, text: str) -> dict[str, Any]:
    """Return a typed limit on torques or torque rates by its name; nothing for the robot's own."""
    name, unit = f"--{field.replace('_', '-')}", TORQUE_UNITS[field]
    if text == "none":
        return {field: None}
    if text == "robot":
        from planners import MotionLimits

        if getattr(MotionLimits.of(arm), field) is None:
            raise InvalidInput(name, f"robot, but {arm.name} has no such limit", f"numbers {unit}, or none")
        return {}
    try:
        values = read_number_list(text, name, infinite=True)
    except InvalidInput:
        values = []
    if len(values) not in (1, arm.n):
        raise InvalidInput(name, repr(text), f"robot, none, one number or {arm.n} numbers {unit}")
    if arm.inertia is None:
        raise InvalidInput(name, f"{text} for {arm.name}, whose masses are unknown", "an arm with masses, or none")
    return {field: values if len(values) > 1 else values[0]}
