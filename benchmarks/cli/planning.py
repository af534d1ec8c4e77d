"""Options common to all commands of `optik plan`, and the steps from a path to a printed certificate."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import numpy as np
import typer

import optik
from benchmarks.cli.carried import add_payload, read_torque_limit
from benchmarks.cli.certificate import check_motion, print_certificate
from benchmarks.cli.shared import (
    NUMBERS,
    Allowed,
    AsJson,
    Base,
    NumbersCommand,
    PackageDir,
    RobotName,
    StartDeg,
    Tip,
    err_console,
    format_numbers,
    load_arm,
    out_console,
    print_json,
    print_start,
    read_allowed,
    read_numbers,
    read_start,
)
from optik.arm.units import unit_factors
from optik.check import check_number
from optik.errors import InvalidInput
from optik.file_io import write_atomically
from optik.plugins.files import split_links
from optik.registry import load_method, names, short_name

TYPICAL = {"velocity": 1, "acceleration": 10, "jerk": 50}
"""Examples of limits, for messages."""

plan_app = typer.Typer(help="Plan a motion and certify it.", no_args_is_help=True)

SILENT_START = 1e-4
"""Largest difference [rad, m] between the given start and that of the motion for which no line is printed."""
ROS = (".yaml", ".yml")
"""Suffixes of ROS messages."""
FILES = (*(f".{name}" for name in names("planners.files")), *ROS)
"""Suffixes of files that a plan can be written to without ``--format``."""


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """Options of all commands of `optik plan`."""

    start_deg: StartDeg = ""
    robot: RobotName = "paper6r"
    tip: Tip = None
    base: Base = None
    package_dir: PackageDir = None
    solver: Annotated[
        str, typer.Option(help=f"IK method, one of: {', '.join(optik.ik.solvers())}; or a file: ./jt.py.")
    ] = "lm"
    timing: Annotated[
        str, typer.Option(help=f"Time law, one of: {', '.join(names('planners.timing'))}; or a file: ./law.py.")
    ] = "optimal"
    samples: Annotated[int, typer.Option(help="Number of samples of the path for inverse kinematics.")] = 151
    velocity: Annotated[
        float | None, typer.Option(help="Velocity limit of every joint [rad/s, sliding m/s]; by default the robot's.")
    ] = None
    acceleration: Annotated[
        float | None,
        typer.Option(help="Acceleration limit of every joint [rad/s², sliding m/s²]; by default the robot's."),
    ] = None
    jerk: Annotated[
        float | None, typer.Option(help="Jerk limit of every joint [rad/s³, sliding m/s³]; by default the robot's.")
    ] = None
    tool_speed: Annotated[
        str | None,
        typer.Option(
            metavar=NUMBERS,
            help="Limit on the speed of the tool point [m/s]; for a polyline also one per segment: 0.1,0.3.",
        ),
    ] = None
    rotation_speed: Annotated[
        str | None,
        typer.Option(
            metavar=NUMBERS,
            help="Limit on the angular speed of the tool [rad/s]; for a polyline also one per segment.",
        ),
    ] = None
    torque: Annotated[
        str | None,
        typer.Option(
            metavar=NUMBERS,
            help="Torque limits [N·m, sliding N]: robot (default), none, or numbers: 87,87,12.",
        ),
    ] = None
    torque_rate: Annotated[
        str | None,
        typer.Option(
            metavar=NUMBERS, help="Torque rate limits [N·m/s, sliding N/s]: robot (default), none, or numbers."
        ),
    ] = None
    payload: Annotated[str | None, typer.Option(help="Mass of the payload [kg], or an interval: 0:3.")] = None
    scene: Annotated[
        str | None,
        typer.Option(help="File of obstacles: .toml, .json or .urdf; or self, to check collisions between links only."),
    ] = None
    margin: Annotated[
        float | None, typer.Option(help="Least distance between arm and scene at every instant [m]; with --scene.")
    ] = None
    branch: Annotated[
        str | None,
        typer.Option(
            help="start: the branch of the start configuration (default); best: the best branch for the whole path "
            "(default if the start configuration is not on the path)."
        ),
    ] = None
    duration: Annotated[float | None, typer.Option(help="Duration of the motion [s]; by default the shortest.")] = None
    allow: Allowed = None
    strict: Annotated[
        bool, typer.Option("--strict", help="Fail instead of stretching the duration to meet the limits.")
    ] = False
    out: Annotated[Path | None, typer.Option(help="File for the motion: .json, .npz, .csv, or .yaml for ROS.")] = None
    out_failed: Annotated[
        Path | None,
        typer.Option(help="File for a failed plan, FILE.json, for `optik view`; drives refuse it."),
    ] = None
    rate: Annotated[
        float | None, typer.Option(help="Points per second in --out FILE.yaml or .csv; by default one at each knot.")
    ] = None
    format: Annotated[
        str | None,
        typer.Option(help=f"File format of --out, one of: {', '.join(names('planners.files'))}; or a file: ./tsv.py."),
    ] = None
    as_json: AsJson = False


def plan_command(name: str) -> Callable[[Callable[..., Any]], Callable[..., None]]:
    """Return a decorator that adds a command to `optik plan`: it plans the path that the decorated function builds."""
    named = {field.name: field for field in fields(PlanOptions)}
    hints = get_type_hints(PlanOptions, include_extras=True)

    def register(build: Callable[..., Any]) -> Callable[..., None]:
        own = [p for p in signature(build, eval_str=True).parameters.values() if p.name not in ("arm", "q")]

        def run(**given: Any) -> None:
            options = PlanOptions(**{key: given.pop(key) for key in named})
            arm = add_payload(load_arm(options.robot, options.tip, options.base, options.package_dir), options.payload)
            q, words = read_start(arm, options.robot, options.start_deg)
            run_plan(arm, build(arm, q, **given), q, options, words)

        shared = [
            Parameter(key, Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[key])
            for key, field in named.items()
        ]
        parameters = [*(p.replace(kind=Parameter.KEYWORD_ONLY) for p in own), *shared]
        run.__signature__ = Signature(parameters)  # type: ignore[attr-defined] # typer makes the options from it
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        plan_app.command(name, cls=NumbersCommand, help=build.__doc__)(run)
        return run

    return register


def run_plan(arm: optik.Robot, path: Any, q: Any, options: PlanOptions, words: str = "") -> None:
    """Plan, write and print; exit with status 1 without a motion, or if ``--allow`` does not permit its violations."""
    import planners
    from planners.certificate.certificate import find_forbidden
    from planners.certificate.violation import LIMIT_WORDS, words_for

    check_out(options)
    allow = read_allowed(options.allow)
    law = planners.make_law(options.timing)
    plan = planners.plan(
        arm, path, q, solver=options.solver, timing=law, limits=read_limits(arm, options, law), samples=options.samples,
        branch=options.branch or choose_branch(arm, path, q), duration=options.duration, strict=options.strict,
        scene=load_scene(arm, options), allow=[word for word in allow if word in LIMIT_WORDS],
    )  # fmt: skip
    refused = find_forbidden(plan.certificate, allow) if plan.has_motion else ()
    valid = plan.has_motion and not refused
    if valid and options.out is not None:
        if options.out.suffix.lower() in ROS and options.format is None:
            planners.to_ros(plan, options.out, rate=options.rate, allow=allow)
        else:
            plan.save(options.out, format=options.format, rate=options.rate, allow=allow)
    if not valid and options.out_failed is not None:
        write_failed(plan, options.out_failed)
    print_start(words)
    if options.as_json:
        print_json(plan.to_dict())
        raise typer.Exit(0 if valid else 1)
    check_motion(plan)
    print_certificate(plan)
    if not valid:
        words = ",".join(words_for(refused, allow))
        out_console.print(
            f"not written; --allow {words} permits this motion"
            if options.out
            else f"--allow {words} permits this motion",
            highlight=False,
        )
        raise typer.Exit(1)
    begin = plan.trajectory(0.0)
    if np.abs(begin - q).max() > SILENT_START:
        out_console.print(
            f"start of the motion: --start-deg {format_numbers(begin * unit_factors(arm))}", highlight=False
        )
    if options.out is not None:
        out_console.print(f"written to {options.out}", highlight=False)


def choose_branch(arm: optik.Robot, path: Any, q: Any) -> str:
    """Return the default of ``--branch``: the start's branch, or the best branch if the path begins elsewhere."""
    from planners.following.follow import START_TOLERANCE

    return "start" if np.abs(arm.pose_errors(q, path.pose(0.0))).max() <= START_TOLERANCE else "best"


def check_out(options: PlanOptions) -> None:
    """Check before planning that the motion can be written in the requested format."""
    if options.out_failed is not None and options.out_failed.suffix.lower() != ".json":
        raise InvalidInput("--out-failed", str(options.out_failed), "a name that ends in .json")
    if options.rate is not None:
        check_number(options.rate, "--rate", "points per second, above 0", above=0.0)
        if options.out is None or options.out.suffix.lower() not in (*ROS, ".csv"):
            raise InvalidInput(
                "--rate",
                f"{options.rate:g} with --out {options.out}" if options.out else f"{options.rate:g} without --out",
                "--out FILE.yaml or FILE.csv with it",
            )
    if options.format is not None:
        if options.out is None:
            raise InvalidInput("--format", options.format, "--out FILE with it")
        load_method("planners.files", options.format, "file format")
    elif options.out is not None and options.out.suffix.lower() not in FILES:
        raise InvalidInput("--out", str(options.out), f"a name that ends in {', '.join(FILES)}, or --format with it")


def write_failed(plan: Any, file: Path) -> None:
    """Write a failed plan for `optik view`, marked as failed, and name the file on the error stream."""
    from planners.cell.view.recorded import failed_plan_data

    text = json.dumps(failed_plan_data(plan), allow_nan=False) + "\n"
    write_atomically(file, lambda part: part.write_text(text, encoding="utf-8"))
    words = f"failed plan written to {file}; to see it: optik view {file}"
    err_console.print(words, highlight=False, markup=False, soft_wrap=True)


def load_scene(arm: optik.Robot, options: PlanOptions) -> Any:
    """Return the scene of ``--scene``."""
    if options.margin is not None and not options.margin >= 0.0:
        raise InvalidInput("--margin", options.margin, "a distance of 0 or more [m]")
    if options.scene is None:
        if options.margin is not None:
            raise InvalidInput(
                "--margin", f"{options.margin:g} without --scene", "--scene FILE or --scene self with it"
            )
        return None
    if arm.shapes is None:
        expected = "an arm whose file has shapes"
        if split_links(options.robot)[0].lower().endswith((".urdf", ".xml")):
            typed = f"--robot '{options.robot}{'&' if '#' in options.robot else '#'}shapes=yes'"
            expected = f"its <collision> elements: {typed} (for package:// meshes: --package-dir FOLDER)"
        raise InvalidInput("--scene", f"{options.scene} for {arm.name}, which has no shapes", expected)
    scene = optik.Scene() if options.scene == "self" else optik.Scene.load(options.scene)
    return scene if options.margin is None else replace(scene, margin=options.margin)


def read_limits(arm: optik.Robot, options: PlanOptions, law: Any) -> Any:
    """Return the typed limits, and the robot's own for the others."""
    import planners

    own = planners.MotionLimits.of(arm)
    joints = ("velocity", "acceleration", "jerk")
    typed: dict[str, Any] = {f: getattr(options, f) for f in joints if getattr(options, f) is not None}
    for field, value in typed.items():
        check_number(value, f"--{field}", "a limit above 0", above=0.0)
    torques = {f: read_torque_limit(arm, f, getattr(options, f), getattr(own, f)) for f in ("torque", "torque_rate")}
    speeds = {f: _speeds(getattr(options, f), f"--{f.replace('_', '-')}") for f in ("tool_speed", "rotation_speed")}
    limits = planners.MotionLimits.of(arm, **typed, **torques, **speeds)
    by_torque = law.counts_torque and limits.torque is not None  # then the acceleration may be free
    for field in joints:
        if field in law.enforced and limits.value(field) is None and not (field == "acceleration" and by_torque):
            missing = f"no limit, because {arm.name} has none"
            raise InvalidInput(
                f"--{field}",
                missing,
                f"a {field} limit for {short_name(options.timing)}, such as --{field} {TYPICAL[field]}",
            )
    return limits


def _speeds(text: str | None, option: str) -> Any:
    """Return one number or several; None for an option that was not typed."""
    if text is None:
        return None
    found = read_numbers(text, option)
    return found if len(found) > 1 else found[0]
