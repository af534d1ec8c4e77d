"""What all commands of `optik plan` share: their options, written once, and the way from a path to a certificate."""

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
from benchmarks.cli.carried import carrying, torque_limit
from benchmarks.cli.certificate import print_certificate
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
    allowed_words,
    arm_of,
    err_console,
    numbers,
    out_console,
    print_json,
    print_start,
    start_of,
)
from optik.arm.units import unit_factors
from optik.check import check_number
from optik.errors import InvalidInput
from optik.file_io import write_atomically
from optik.plugins.files import split_links
from optik.registry import load_method, names, short_name

plan_app = typer.Typer(help="Plan a motion and certify it.", no_args_is_help=True)

SILENT_START = 1e-4
"""Largest distance [rad, m] between the start of a motion and the given one at which no line is printed."""
ROS = (".yaml", ".yml")
"""Endings of files that hold a ROS message."""
FILES = (*(f".{name}" for name in names("planners.files")), *ROS)
"""Endings of files that a plan can be written to; the format of a plug-in is named by ``--format``."""


@dataclass(frozen=True, kw_only=True)
class Wish:
    """What every plan can be asked for: each field is an option of all commands of `optik plan`."""

    start_deg: StartDeg = ""
    robot: RobotName = "paper6r"
    tip: Tip = None
    base: Base = None
    package_dir: PackageDir = None
    ik: Annotated[
        str, typer.Option(help=f"IK method, one of: {', '.join(optik.ik.solvers())}; or a file: ./jt.py.")
    ] = "lm"
    timing: Annotated[
        str, typer.Option(help=f"Time law, one of: {', '.join(names('planners.timing'))}; or a file: ./law.py.")
    ] = "optimal"
    samples: Annotated[int, typer.Option(help="Samples of the path.")] = 151
    velocity: Annotated[
        float | None, typer.Option(help="Limit on every joint [rad/s, sliding m/s]; the robot's own if left out.")
    ] = None
    acceleration: Annotated[float | None, typer.Option(help="Limit on every joint [rad/s², sliding m/s²].")] = None
    jerk: Annotated[float | None, typer.Option(help="Limit on every joint [rad/s³, sliding m/s³].")] = None
    tool_speed: Annotated[
        str | None,
        typer.Option(
            metavar=NUMBERS,
            help="Greatest speed of the tool's point [m/s]; of a polyline also one for each segment: 0.1,0.3.",
        ),
    ] = None
    rotation_speed: Annotated[
        str | None,
        typer.Option(
            metavar=NUMBERS,
            help="Greatest speed of the tool's rotation [rad/s]; of a polyline also one for each segment.",
        ),
    ] = None
    torque: Annotated[
        str | None,
        typer.Option(
            metavar=NUMBERS,
            help="Limit on torques [N·m, sliding N]: robot (its own, where it has any), none, or numbers: 87,87,12.",
        ),
    ] = None
    torque_rate: Annotated[
        str | None,
        typer.Option(metavar=NUMBERS, help="Limit on torque rates [N·m/s, sliding N/s]: robot, none, or numbers."),
    ] = None
    payload: Annotated[
        str | None, typer.Option(help="Mass in the tool [kg], or from the lightest to the heaviest: 0:3.")
    ] = None
    scene: Annotated[
        str | None,
        typer.Option(
            help="File of what stands around the arm, which it must not touch: .toml, .json, .urdf; self: its own links."
        ),
    ] = None
    margin: Annotated[
        float | None, typer.Option(help="Distance that arm and scene shall keep at every instant [m]; with --scene.")
    ] = None
    branch: Annotated[
        str | None,
        typer.Option(
            help="start: keep the branch of the start (default); best: choose it for the whole path (default if the "
            "path begins elsewhere)."
        ),
    ] = None
    duration: Annotated[float | None, typer.Option(help="Seconds that the motion shall take.")] = None
    allow: Allowed = None
    strict: Annotated[bool, typer.Option("--strict", help="Refuse a motion that a slow-down would have to repair.")] = (
        False
    )
    out: Annotated[Path | None, typer.Option(help="Write the motion: .json, .npz, .csv, or .yaml for ROS.")] = None
    out_failed: Annotated[
        Path | None,
        typer.Option(help="If planning fails, write the failed plan for `optik view`; no drive accepts it: FILE.json."),
    ] = None
    rate: Annotated[
        float | None, typer.Option(help="Points per second in --out FILE.yaml or .csv; by default points at the knots.")
    ] = None
    format: Annotated[
        str | None,
        typer.Option(help=f"File format of --out, one of: {', '.join(names('planners.files'))}; or a file: ./tsv.py."),
    ] = None
    as_json: AsJson = False


def planning(name: str) -> Callable[[Callable[..., Any]], Callable[..., None]]:
    """Decorate a function that builds a path as a command of `optik plan`, with the options of `Wish` after its own."""
    wished = {field.name: field for field in fields(Wish)}
    hints = get_type_hints(Wish, include_extras=True)

    def register(build: Callable[..., Any]) -> Callable[..., None]:
        own = [p for p in signature(build, eval_str=True).parameters.values() if p.name not in ("arm", "q")]

        def run(**given: Any) -> None:
            wish = Wish(**{key: given.pop(key) for key in wished})
            arm = carrying(arm_of(wish.robot, wish.tip, wish.base, wish.package_dir), wish.payload)
            q, words = start_of(arm, wish.robot, wish.start_deg)
            planned(arm, build(arm, q, **given), q, wish, words)

        shared = [
            Parameter(key, Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[key])
            for key, field in wished.items()
        ]
        parameters = [*(p.replace(kind=Parameter.KEYWORD_ONLY) for p in own), *shared]
        run.__signature__ = Signature(parameters)  # type: ignore[attr-defined] # typer makes the options from it
        run.__annotations__ = {p.name: p.annotation for p in parameters}
        plan_app.command(name, cls=NumbersCommand, help=build.__doc__)(run)
        return run

    return register


def planned(arm: optik.Robot, path: Any, q: Any, wish: Wish, words: str = "") -> None:
    """Plan, write and print; exit status 1 if there is no motion, or if ``--allow`` does not permit its violations."""
    import planners
    from planners.certificate.violation import LIMIT_WORDS, forbidden, words_for

    check_out(wish)
    allow = allowed_words(wish.allow)
    law = planners.make_law(wish.timing)
    plan = planners.plan(
        arm, path, q, ik=wish.ik, timing=law, limits=limits_of(arm, wish, law), samples=wish.samples,
        branch=wish.branch or branch_from(arm, path, q), duration=wish.duration, strict=wish.strict, scene=scene_of(arm, wish),
        allow=[word for word in allow if word in LIMIT_WORDS],
    )  # fmt: skip
    refused = forbidden(plan.certificate, allow) if plan.has_motion else ()
    valid = plan.has_motion and not refused
    if valid and wish.out is not None:
        if wish.out.suffix.lower() in ROS and wish.format is None:
            planners.to_ros(plan, wish.out, rate=wish.rate, allow=allow)
        else:
            plan.save(wish.out, format=wish.format, rate=wish.rate, allow=allow)
    if not valid and wish.out_failed is not None:
        write_failed(plan, wish.out_failed)
    print_start(words)
    if wish.as_json:
        print_json(plan.to_dict())
        raise typer.Exit(0 if valid else 1)
    print_certificate(plan)  # raises NoSolution with the reason where there is no motion
    if not valid:
        words = ",".join(words_for(refused, allow))
        out_console.print(f"--allow {words} permits this motion", highlight=False)
        raise typer.Exit(1)
    begin = plan.trajectory(0.0)
    if np.abs(begin - q).max() > SILENT_START:
        out_console.print(
            f"begins at {', '.join(f'{x:.6g}' for x in begin * unit_factors(arm))} [degrees, mm]", highlight=False
        )
    if wish.out is not None:
        out_console.print(f"written to {wish.out}", highlight=False)


def branch_from(arm: optik.Robot, path: Any, q: Any) -> str:
    """Return the default of ``--branch``: the start's branch, or the best branch if the path begins elsewhere."""
    from planners.following.follow import START_TOLERANCE

    return "start" if np.abs(arm.pose_errors(q, path.pose(0.0))).max() <= START_TOLERANCE else "best"


def check_out(wish: Wish) -> None:
    """Check before planning that the motion can be written in the requested format."""
    if wish.out_failed is not None and wish.out_failed.suffix.lower() != ".json":
        raise InvalidInput("--out-failed", str(wish.out_failed), "a name that ends in .json")
    if wish.rate is not None:
        check_number(wish.rate, "--rate", "points per second, above 0", above=0.0)
        if wish.out is None or wish.out.suffix.lower() not in (*ROS, ".csv"):
            raise InvalidInput(
                "--rate", f"{wish.rate:g} with --out {wish.out}", "--rate with --out FILE.yaml or FILE.csv"
            )
    if wish.format is not None:
        if wish.out is None:
            raise InvalidInput("--format", wish.format, "--out FILE with it")
        load_method("planners.files", wish.format, "file format")
    elif wish.out is not None:
        known = [f".{name}" for name in names("planners.files")]
        if wish.out.suffix.lower() not in (*known, *ROS):
            expected = f"a name that ends in {', '.join((*known, *ROS))}, or --format with it"
            raise InvalidInput("--out", str(wish.out), expected)


def write_failed(plan: Any, file: Path) -> None:
    """Write a failed plan for `optik view`, marked as failed, and name the file on the error stream."""
    from planners.cell.view.recorded import failed_plan_data

    text = json.dumps(failed_plan_data(plan), allow_nan=False) + "\n"
    write_atomically(file, lambda part: part.write_text(text, encoding="utf-8"))
    words = f"failed plan written to {file}; to see it: optik view {file}"
    err_console.print(words, highlight=False, markup=False, soft_wrap=True)


def scene_of(arm: optik.Robot, wish: Wish) -> Any:
    """The scene that was asked for."""
    if wish.margin is not None and not wish.margin >= 0.0:
        raise InvalidInput("--margin", wish.margin, "a distance of 0 or more [m]")
    if wish.scene is None:
        if wish.margin is not None:
            raise InvalidInput("--margin", f"{wish.margin:g} without a scene", "--scene FILE with it, or --scene self")
        return None
    if arm.shapes is None:
        expected = "an arm whose file has shapes"
        if split_links(wish.robot)[0].lower().endswith((".urdf", ".xml")):
            typed = f"--robot '{wish.robot}{'&' if '#' in wish.robot else '#'}shapes=yes'"
            expected = f"its <collision> elements: {typed} (for package:// meshes: --package-dir FOLDER)"
        raise InvalidInput("--scene", f"{wish.scene} for {arm.name}, which has no shapes", expected)
    scene = optik.Scene() if wish.scene == "self" else optik.Scene.load(wish.scene)
    return scene if wish.margin is None else replace(scene, margin=wish.margin)


def limits_of(arm: optik.Robot, wish: Wish, law: Any) -> Any:
    """The limits that were typed, the robot's own where none was."""
    import planners

    own = planners.MotionLimits.of(arm)
    joints = ("velocity", "acceleration", "jerk")
    typed: dict[str, Any] = {f: getattr(wish, f) for f in joints if getattr(wish, f) is not None}
    torques = {f: torque_limit(arm, f, getattr(wish, f), getattr(own, f)) for f in ("torque", "torque_rate")}
    speeds = {f: _speeds(getattr(wish, f), f"--{f.replace('_', '-')}") for f in ("tool_speed", "rotation_speed")}
    limits = planners.MotionLimits.of(arm, **typed, **torques, **speeds)
    by_torque = law.counts_torque and limits.torque is not None  # then the acceleration may be free
    for field in joints:
        if field in law.enforced and limits.value(field) is None and not (field == "acceleration" and by_torque):
            nothing = f"nothing, and {arm.name} has no limit of its own"
            raise InvalidInput(f"--{field}", nothing, f"a limit, for {short_name(wish.timing)}")
    return limits


def _speeds(text: str | None, option: str) -> Any:
    """Return one number or several; None for an option that was not typed."""
    if text is None:
        return None
    found = numbers(text, option)
    return found if len(found) > 1 else found[0]
