"""`optik plan`: motions along a line, an arc, a polyline or in joint space, timed and certified."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

import optik
from benchmarks.cli.shared import AsJson, RobotName, arm_of, configuration, out_console, print_json
from optik.errors import InvalidInput
from optik.registry import names

plan_app = typer.Typer(help="Plan a motion and certify it.", no_args_is_help=True)

START = "20,-35,40,25,50,-30"
"""Where a plan starts if nobody says, for arms with as many joints."""
ROS = (".yaml", ".yml")
FILES = (*(f".{name}" for name in names("planners.files")), *ROS)

Start = Annotated[
    str, typer.Option(help="Start configuration [degrees, mm], comma separated; empty: middle of the ranges.")
]
IK = Annotated[str, typer.Option(help=f"IK method, one of: {', '.join(optik.ik.solvers())}.")]
Timing = Annotated[str, typer.Option(help=f"Time law, one of: {', '.join(names('planners.timing'))}.")]
Samples = Annotated[int, typer.Option(help="Samples of the path.")]
Velocity = Annotated[
    float | None, typer.Option(help="Limit on every joint [rad/s, sliding m/s]; the robot's own if left out.")
]
Acceleration = Annotated[float | None, typer.Option(help="Likewise [rad/s², sliding m/s²].")]
Jerk = Annotated[float | None, typer.Option(help="Likewise [rad/s³, sliding m/s³].")]
ToolSpeed = Annotated[float | None, typer.Option(help="Greatest speed of the tool's point [m/s].")]
RotationSpeed = Annotated[float | None, typer.Option(help="Greatest speed of the tool's rotation [rad/s].")]
Branch = Annotated[str | None, typer.Option(help="start: keep the start's branch; best: choose for the whole path.")]
Duration = Annotated[float | None, typer.Option(help="Seconds that the motion shall take.")]
Strict = Annotated[bool, typer.Option("--strict", help="Refuse a motion that a slow-down would have to repair.")]
Out = Annotated[Path | None, typer.Option(help="Write the motion: .json, .npz, .csv, or .yaml for ROS.")]
PLACE = "x,y,z[,roll,pitch,yaw] in the base frame [m, degrees]; without angles the tool keeps its orientation."


@dataclass(frozen=True)
class Wish:
    """What all plans are asked for, as it was typed."""

    ik: str
    timing: str
    samples: int
    velocity: float | None
    acceleration: float | None
    jerk: float | None
    tool_speed: float | None
    rotation_speed: float | None
    branch: str | None
    duration: float | None
    strict: bool
    out: Path | None
    as_json: bool


@plan_app.command("line")
def plan_line(
    move: Annotated[tuple[float, float, float], typer.Option(help="Goal minus start, in the base frame [m].")] = (
        -0.12,
        0.0,
        0.20,
    ),
    turn_deg: Annotated[
        tuple[float, float, float], typer.Option(help="Rotation vector of the turn on the way, base frame [degrees].")
    ] = (0.0, 0.0, 0.0),
    start_deg: Start = START,
    robot: RobotName = "paper6r",
    ik: IK = "lm",
    timing: Timing = "optimal",
    samples: Samples = 151,
    velocity: Velocity = None,
    acceleration: Acceleration = None,
    jerk: Jerk = None,
    tool_speed: ToolSpeed = None,
    rotation_speed: RotationSpeed = None,
    branch: Branch = None,
    duration: Duration = None,
    strict: Strict = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Move the tool along a straight line, time it, and say what the motion keeps.

    Exit status 0 where there is a motion and its certificate holds; 1 where not, and nothing is written.
    """
    import planners
    from optik import se3

    arm = arm_of(robot)
    q = start_of(arm, start_deg)
    start = arm.fk(q)
    if np.linalg.norm(turn_deg) > 180.0:
        raise InvalidInput("--turn-deg", turn_deg, "a rotation vector of at most 180°: a line turns the shortest way")
    goal = se3.pose(se3.exp_so3(np.deg2rad(turn_deg)) @ start[:3, :3], start[:3, 3] + move)
    planned(
        arm,
        planners.Line(start, goal),
        q,
        Wish(
            ik,
            timing,
            samples,
            velocity,
            acceleration,
            jerk,
            tool_speed,
            rotation_speed,
            branch,
            duration,
            strict,
            out,
            as_json,
        ),
    )


@plan_app.command("arc")
def plan_arc(
    via: Annotated[str, typer.Option(help="A point on the way, x,y,z [m]; with --to.")] = "",
    to: Annotated[str, typer.Option(help=f"The end: {PLACE}")] = "",
    centre: Annotated[str, typer.Option(help="A point on the axis, x,y,z [m]; with --axis and --angle-deg.")] = "",
    axis: Annotated[str, typer.Option(help="Direction of the axis, x,y,z.")] = "0,0,1",
    angle_deg: Annotated[float, typer.Option(help="By the right hand about the axis [degrees].")] = 90.0,
    start_deg: Start = START,
    robot: RobotName = "paper6r",
    ik: IK = "lm",
    timing: Timing = "optimal",
    samples: Samples = 151,
    velocity: Velocity = None,
    acceleration: Acceleration = None,
    jerk: Jerk = None,
    tool_speed: ToolSpeed = None,
    rotation_speed: RotationSpeed = None,
    branch: Branch = None,
    duration: Duration = None,
    strict: Strict = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Move the tool along part of a circle: through a point to an end, or about an axis by an angle."""
    import planners

    arm = arm_of(robot)
    q = start_of(arm, start_deg)
    start = arm.fk(q)
    if bool(centre) == bool(via and to) or bool(via) != bool(to):
        given = [name for name, text in (("--via", via), ("--to", to), ("--centre", centre)) if text]
        raise InvalidInput("arc", " and ".join(given) or "nothing", "--via and --to, or --centre")
    if centre:
        angle = float(np.deg2rad(angle_deg))
        path = planners.Arc.about(start, numbers(centre, "--centre", 3), numbers(axis, "--axis", 3), angle)
    else:
        path = planners.Arc.through(start, numbers(via, "--via", 3), place(to, "--to", start))
    planned(
        arm,
        path,
        q,
        Wish(
            ik,
            timing,
            samples,
            velocity,
            acceleration,
            jerk,
            tool_speed,
            rotation_speed,
            branch,
            duration,
            strict,
            out,
            as_json,
        ),
    )


@plan_app.command("polyline")
def plan_polyline(
    via: Annotated[list[str], typer.Option(help=f"A waypoint, once or more; the last is the end: {PLACE}")],
    blend: Annotated[float, typer.Option(help="Largest distance from a corner [m].")] = 1e-3,
    start_deg: Start = START,
    robot: RobotName = "paper6r",
    ik: IK = "lm",
    timing: Timing = "optimal",
    samples: Samples = 151,
    velocity: Velocity = None,
    acceleration: Acceleration = None,
    jerk: Jerk = None,
    tool_speed: ToolSpeed = None,
    rotation_speed: RotationSpeed = None,
    branch: Branch = None,
    duration: Duration = None,
    strict: Strict = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Move the tool along straight lines from waypoint to waypoint, the corners blended."""
    import planners

    arm = arm_of(robot)
    q = start_of(arm, start_deg)
    waypoints = [arm.fk(q)]
    for text in via:
        waypoints.append(place(text, "--via", waypoints[-1]))
    planned(
        arm,
        planners.Polyline(np.stack(waypoints), blend=blend),
        q,
        Wish(
            ik,
            timing,
            samples,
            velocity,
            acceleration,
            jerk,
            tool_speed,
            rotation_speed,
            branch,
            duration,
            strict,
            out,
            as_json,
        ),
    )


@plan_app.command("joints")
def plan_joints(
    to_deg: Annotated[str, typer.Option(help="Goal configuration [degrees, mm], comma separated.")],
    start_deg: Start = START,
    robot: RobotName = "paper6r",
    ik: IK = "lm",
    timing: Timing = "optimal",
    samples: Samples = 151,
    velocity: Velocity = None,
    acceleration: Acceleration = None,
    jerk: Jerk = None,
    tool_speed: ToolSpeed = None,
    rotation_speed: RotationSpeed = None,
    branch: Branch = None,
    duration: Duration = None,
    strict: Strict = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Move from one configuration to another, straight in joint space."""
    import planners

    arm = arm_of(robot)
    q = start_of(arm, start_deg)
    if not to_deg.strip():
        raise InvalidInput("--to-deg", "nothing", f"{arm.n} joint values [degrees, mm], comma separated")
    goal = configuration(arm, to_deg, "--to-deg")
    planned(
        arm,
        planners.JointLine(arm, q, goal),
        q,
        Wish(
            ik,
            timing,
            samples,
            velocity,
            acceleration,
            jerk,
            tool_speed,
            rotation_speed,
            branch,
            duration,
            strict,
            out,
            as_json,
        ),
    )


def planned(arm: optik.Robot, path: Any, q: Any, wish: Wish) -> None:
    """Plan, write and print; exit status 1 where there is no motion, or one whose certificate does not hold."""
    import planners

    if wish.out is not None and wish.out.suffix.lower() not in FILES:
        raise InvalidInput("--out", str(wish.out), f"a name that ends in {', '.join(FILES)}")
    law = planners.make_law(wish.timing)
    plan = planners.plan(
        arm, path, q, ik=wish.ik, timing=law, limits=limits_of(arm, wish, law), samples=wish.samples,
        branch=wish.branch, duration=wish.duration, strict=wish.strict,
    )  # fmt: skip
    if plan and wish.out is not None:
        if wish.out.suffix.lower() in ROS:
            planners.to_ros(plan, wish.out)
        else:
            plan.save(wish.out)
    if wish.as_json:
        print_json(plan.to_dict())
        raise typer.Exit(0 if plan else 1)
    print_certificate(plan)  # raises NoSolution with the reason where there is no motion
    if not plan:
        raise typer.Exit(1)
    if wish.out is not None:
        out_console.print(f"written to {wish.out}", highlight=False)


def start_of(arm: optik.Robot, degrees: str) -> Any:
    """The start that was typed; nobody's start is that of an arm of six joints.

    Raises
    ------
    InvalidInput
        None was typed, and the arm has another number of joints; or as `configuration`.
    """
    if degrees == START and arm.n != len(START.split(",")):
        raise InvalidInput(
            "--start-deg", "nothing", f"{arm.n} joint values of {arm.name} [degrees, mm], comma separated"
        )
    return configuration(arm, degrees)


def limits_of(arm: optik.Robot, wish: Wish, law: Any) -> Any:
    """The limits that were typed, the robot's own where none was.

    Raises
    ------
    InvalidInput
        One that the law needs and nobody gave.
    """
    import planners

    own = planners.MotionLimits.of(arm)
    joints = ("velocity", "acceleration", "jerk")
    found = {f: getattr(own, f) if getattr(wish, f) is None else getattr(wish, f) for f in joints}
    for field in joints:
        if field in law.keeps and found[field] is None:
            nothing = f"nothing, and {arm.name} has no limit of its own"
            raise InvalidInput(f"--{field}", nothing, f"a limit, for {wish.timing}")
    return planners.MotionLimits(**found, tool_speed=wish.tool_speed, rotation_speed=wish.rotation_speed)


def numbers(text: str, option: str, *counts: int) -> list[float]:
    """Numbers separated by commas, as many as one of the counts.

    Raises
    ------
    InvalidInput
        Something else.
    """
    expected = f"{' or '.join(map(str, counts))} numbers, comma separated"
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        raise InvalidInput(option, repr(text), expected) from None
    if len(values) not in counts:
        raise InvalidInput(option, repr(text), expected)
    return values


def place(text: str, option: str, before: Any) -> Any:
    """Pose (4, 4) of x,y,z, which keeps the orientation before it, or of x,y,z,roll,pitch,yaw."""
    from optik import se3

    values = numbers(text, option, 3, 6)
    return se3.from_xyz_rpy(values[:3], values[3:]) if values[3:] else se3.pose(before[:3, :3], values)


def much(ratio: float) -> str:
    """How far a ratio is beyond 1."""
    return f"{ratio:.3g} times its limit" if np.isfinite(ratio) else "without bound"


SMOOTH = {
    -1: "positions jump",
    0: "velocities jump",
    1: "accelerations jump",
    2: "accelerations continuous",
    3: "jerks continuous",
}


def print_certificate(planned: Any) -> None:
    """Print what a plan keeps, for people."""
    from planners.limits import ALL_LIMITS, DERIVATIVES

    proof, off = planned.certificate, planned.certificate.path_error
    way = f"{1e3 * planned.path.end:.1f} mm" if planned.path.unit == "m" else f"{planned.path.end:.4g} rad"
    table = Table(
        "", "worst / limit", "joint", "at, s", "promised",
        title=f"{planned.ik} + {planned.law}: {way} in {proof.duration:.4f} s",
    )  # fmt: skip
    for field in ALL_LIMITS:
        ratio, joint, t = proof.worst(field)
        name, promised = field.replace("_", " "), "yes" if field in proof.keeps else "no"
        if not np.isnan(ratio):
            table.add_row(name, f"{ratio:.8g}", joint, f"{t:.4f}", promised)
        elif field in DERIVATIVES:
            table.add_row(name, "no limit", "", "", promised)
    out_console.print(table)
    out_console.print(
        f"tool off the path at most {1e6 * off.distance:.3g} µm and {1e6 * off.angle:.3g} µrad (proved for every instant), "
        f"tool speed at most {proof.tool_speed.value:.3g} m/s, smallest singular value {proof.singular_value:.3g} "
        f"at {proof.t_singular_value:.3f} s, {SMOOTH[proof.continuous]}",
        highlight=False,
    )
    if planned.slowed > 1.0:
        slowed = f"slowed by {planned.slowed:.9g} until it kept what the law promises"
        out_console.print(slowed, highlight=False)
    beyond = [f for f in ALL_LIMITS if f not in proof.keeps and proof.worst(f)[0] > 1.0]
    if beyond:
        words = ", ".join(f"{f.replace('_', ' ')} {much(proof.worst(f)[0])}" for f in beyond)
        out_console.print(f"not promised by {planned.law}, and exceeded: {words}", style="yellow", highlight=False)
    if proof.holds:
        kept = (
            "all that the law promises is kept exactly"
            if proof.keeps
            else f"joint ranges and path; {planned.law} promises no more"
        )
        out_console.print(f"the certificate holds: {kept}", style="green", highlight=False)
    else:
        out_console.print("the certificate does NOT hold: " + "; ".join(proof.broken), style="yellow", highlight=False)
