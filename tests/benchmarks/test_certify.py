"""`optik certify`: motions with known faults and without, limits of MoveIt, waypoints, and what is not judged."""

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik.check import describe_ratio, format_ratio
from optik.types import Array

pytestmark = pytest.mark.filterwarnings("ignore:.*no units in the header:optik.errors.AssumptionWarning")
NAMES = tuple(f"joint{i + 1}" for i in range(6))
HOME = np.deg2rad([0.0, -70.0, 70.0, -90.0, -90.0, 0.0])


def write_table(file: Path, t: Array, q: Array, *rates: Array, names: tuple[str, ...] = NAMES) -> None:
    """A table with positions and, if given, velocities and accelerations, with the columns of the joints in this order."""
    at = [NAMES.index(name) for name in names]
    header = ["t", *(f"{kind}{name}" for kind in ("", "dq_", "ddq_")[: 1 + len(rates)] for name in names)]
    rows = np.column_stack([t, *(x[:, at] for x in (q, *rates))])
    file.write_text("\n".join([",".join(header), *(",".join(f"{x:.17g}" for x in row) for row in rows)]) + "\n")


def one_joint(joint: int, values: Any) -> Array:
    """Values of one joint, the others at 0."""
    rows = np.zeros((len(values), 6))
    rows[:, joint] = values
    return rows


# The file, the limits, and by hand: the limit that is exceeded, its ratio, joint and time [s].
Bad = tuple[Callable[[Path], None], list[str], tuple[str, float, int, float]]


def between(joint: int, T: float, way: float, limit: float) -> Bad:
    """From rest to rest through two points: the cubic's velocity peaks in the middle at 1.5 way / T."""
    peak = 1.5 * abs(way) / T / limit

    def write(file: Path) -> None:
        still = np.zeros((2, 6))
        write_table(file, np.array([0.0, T]), HOME + one_joint(joint, [0.0, way]), still)

    return write, ["--velocity", f"{limit}"], ("velocity", peak, joint, T / 2.0)


def hurried(joint: int, factor: float, limit: float) -> Bad:
    """A motion with constant velocity whose times from 1 s on are a fraction of what was meant."""

    def write(file: Path) -> None:
        t = np.array([0.0, 1.0, 1.0 + 1.0 / factor])
        write_table(file, t, HOME + one_joint(joint, [0.0, 0.5, 1.0]))

    return write, ["--velocity", f"{limit}"], ("velocity", 0.5 * factor / limit, joint, 1.0)


def jump(joint: int, size: float, dt: float, limit: float) -> Bad:
    """Standstill, a jump of the position within one period, and standstill."""

    def write(file: Path) -> None:
        t = np.array([0.0, 1.0, 1.0 + dt, 2.0])
        write_table(file, t, HOME + one_joint(joint, [0.0, 0.0, size, size]))

    return write, ["--velocity", f"{limit}"], ("velocity", abs(size) / dt / limit, joint, 1.0)


def wrapped(joint: int, dt: float, limit: float) -> Bad:
    """A joint that turns on, written as an angle in (−π, π]."""

    def write(file: Path) -> None:
        q = np.tile(HOME, (4, 1))
        q[:, joint] = [3.0, 3.1, 3.2 - 2.0 * np.pi, 3.3 - 2.0 * np.pi]
        write_table(file, dt * np.arange(4), q)

    return write, ["--velocity", f"{limit}"], ("velocity", (2.0 * np.pi - 0.1) / dt / limit, joint, dt)


BAD: list[Bad] = [
    *(between(j, T, way, limit) for j, T, way, limit in ((0, 1.0, 1.0, 1.2), (1, 0.5, 0.5, 1.0), (3, 2.0, 1.0, 0.7),
                                                         (4, 0.8, -0.5, 0.9), (5, 0.2, 0.3, 1.5))),
    *(hurried(j, factor, limit) for j, factor, limit in ((0, 2.0, 0.8), (2, 3.0, 1.0), (3, 10.0, 3.0), (4, 1.5, 0.7),
                                                        (5, 100.0, 3.0))),
    *(jump(j, size, dt, limit) for j, size, dt, limit in ((0, 0.1, 0.004, 3.0), (1, -0.2, 0.01, 3.0), (2, 0.02, 0.001, 2.0),
                                                         (4, 1.0, 0.1, 3.0), (5, -0.05, 0.008, 3.0))),
    *(wrapped(j, dt, limit) for j, dt, limit in ((0, 0.1, 3.0), (3, 0.05, 3.0), (4, 0.2, 2.0), (5, 0.1, 1.1), (0, 0.5, 3.0))),
]  # fmt: skip


@pytest.mark.parametrize("case", range(len(BAD)))
def test_a_fault_is_found_with_its_limit_ratio_joint_and_time(case: int, tmp_path: Path, typed: Any) -> None:
    write, limits, (field, ratio, joint, t) = BAD[case]
    write(file := tmp_path / "motion.csv")
    status, out, _ = typed("certify", str(file), "--robot", "ur5e", *limits, "--json")
    found = json.loads(out)
    worst = int(np.argmax([x or 0.0 for x in found[field]["ratio"]]))
    assert status == 1 and not found["is_valid"]
    assert (worst, found[field]["ratio"][worst]) == (joint, pytest.approx(ratio, rel=1e-9))
    assert found[field]["time"][worst] == pytest.approx(t, abs=1e-9)
    much = f"{ratio:.3g} {'times' if ratio >= 2.0 else 'of'} its limit at t"
    assert any(f"{field} of {NAMES[joint]} is {much}" in words for words in found["reasons"])
    status, out, _ = typed("certify", str(file), "--robot", "ur5e", *limits)
    verdict, between, *reasons = out.partition("┏")[0].splitlines()[:-1]
    assert verdict == "certificate NOT valid"
    assert re.match(r"between its points the motion is (linear, as in|cubic$)", between)
    assert any(f"{field} of {NAMES[joint]} is {much}" in words for words in reasons)
    row = next(line for line in out.splitlines() if line.startswith(f"│ {field} "))
    assert status == 1 and NAMES[joint] in row and "exceeded" in row and f"{t:.3f}" in row


GOOD = [(seed, form) for seed in range(5) for form in ("csv", "shuffled", "yaml", "json")]


@pytest.mark.parametrize(("seed", "form"), GOOD)
def test_a_motion_within_its_limits_is_valid_in_every_format(seed: int, form: str, tmp_path: Path, typed: Any) -> None:
    rng = np.random.default_rng(seed)
    goal, T = HOME + rng.uniform(-0.5, 0.5, 6), rng.uniform(0.8, 2.0)
    u = np.linspace(0.0, 1.0, 51)[:, None]
    q = HOME + (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5) * (goal - HOME)
    dq = (30.0 * u**2 - 60.0 * u**3 + 30.0 * u**4) * (goal - HOME) / T
    ddq = (60.0 * u - 180.0 * u**2 + 120.0 * u**3) * (goal - HOME) / T**2
    t, file = T * u[:, 0], tmp_path / f"motion.{'csv' if form == 'shuffled' else form}"
    if file.suffix == ".csv":
        order = tuple(rng.permutation(NAMES).tolist()) if form == "shuffled" else NAMES
        write_table(file, t, q, dq, ddq, names=order)
    elif form == "json":
        data = {"joint_names": NAMES, "times": t.tolist(), "positions": q.tolist()}
        file.write_text(json.dumps(data | {"velocities": dq.tolist(), "accelerations": ddq.tolist()}))
    else:
        points = [
            {"positions": a, "velocities": b, "accelerations": c,
             "time_from_start": {"sec": int(x // 1), "nanosec": round(x % 1 * 1e9)}}
            for a, b, c, x in zip(q.tolist(), dq.tolist(), ddq.tolist(), t.tolist(), strict=True)
        ]  # fmt: skip
        file.write_text(json.dumps({"joint_names": NAMES, "points": points}))  # JSON is YAML
    peak = [np.abs(goal - HOME).max() * x for x in (1.875 / T, 5.7735027 / T**2, 61.0 / T**3)]
    limits = [
        word for name, x in zip(("velocity", "acceleration", "jerk"), peak, strict=True)
        for word in (f"--{name}", f"{1.001 * x:.9g}")
    ]  # fmt: skip
    status, out, _ = typed("certify", str(file), "--robot", "ur5e", *limits)
    assert status == 0 and "certificate valid" in out, out
    tight = [*limits[:1], f"{0.99 * peak[0]:.9g}", *limits[2:]]
    assert typed("certify", str(file), "--robot", "ur5e", *tight)[0] == 1


# ---------------------------------------------------------------- limits of MoveIt


LIMITS = """
joint_limits:
  joint1: {has_velocity_limits: true, max_velocity: 1.0, has_position_limits: true, min_position: -0.5, max_position: 0.5}
  joint2: {max_velocity: 1.0, max_acceleration: 4.0, has_acceleration_limits: true, max_jerk: 30.0}
  joint3: {has_velocity_limits: false, max_velocity: 0.1}
  finger: {max_velocity: 0.1}
default_velocity_scaling_factor: 0.1
"""


@pytest.mark.filterwarnings("always::optik.errors.AssumptionWarning")
@pytest.mark.parametrize("around", ["{}", "/**:\n  ros__parameters:\n    robot_description_planning:\n      {}"])
def test_limits_of_moveit_replace_the_robots(around: str, tmp_path: Path, typed: Any) -> None:
    indent = " " * (len(around.splitlines()[-1]) - 2)
    (limits := tmp_path / "joint_limits.yaml").write_text(around.format(LIMITS.strip().replace("\n", f"\n{indent}")))
    arm = optik.load("ur5e")
    limited, found = planners.load_limits(limits, arm)
    np.testing.assert_array_equal(limited.limits.lower, [-0.5, *arm.limits.lower[1:]])
    np.testing.assert_array_equal(limited.limits.upper, [0.5, *arm.limits.upper[1:]])
    own = arm.limits.velocity
    assert own is not None
    np.testing.assert_array_equal(found.velocity, [1.0, 1.0, np.inf, *own[3:]])
    np.testing.assert_array_equal(found.acceleration, [np.inf, 4.0, np.inf, np.inf, np.inf, np.inf])
    np.testing.assert_array_equal(found.jerk, [np.inf, 30.0, np.inf, np.inf, np.inf, np.inf])
    assert found.given_names == ("velocity", "acceleration", "jerk")
    write_table(file := tmp_path / "m.csv", np.array([0.0, 2.0]), HOME + one_joint(0, [0.0, 0.6]), np.zeros((2, 6)))
    status, out, said = typed("certify", str(file), "--robot", "ur5e", "--limits", str(limits))
    assert "no joints of ur5e: finger; not read: default_velocity_scaling_factor" in said and said.count("warning") == 1
    assert status == 1 and re.search(r"position .*5\.73° outside .*joint1 .*2\.000 .*exceeded", out), out
    assert re.search(r"acceleration .*respected \(joint1,", out) and re.search(r"torque rate .*not judged", out)
    typed_again = ["--velocity", "0.3"]  # the option replaces the value of the file
    data = json.loads(
        typed("certify", str(file), "--robot", "ur5e", "--limits", str(limits), *typed_again, "--json")[1]
    )
    assert data["velocity"]["ratio"][0] == pytest.approx(1.5)
    assert data["inputs"]["limits"] == {"name": limits.name, "sha256": hashlib.sha256(limits.read_bytes()).hexdigest()}
    assert data["inputs"]["file"]["sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()
    assert data["versions"]["numpy"] == np.__version__ and data["robot"]["fingerprint"] == limited.fingerprint


def test_a_plan_respects_limits_of_moveit_with_other_joint_names(tmp_path: Path, typed: Any) -> None:
    names = ("pan", "lift", "elbow", "w1", "w2", "w3")
    rows = "\n".join(f"  {name}: {{max_velocity: 0.7, max_acceleration: 3.0, max_jerk: 40.0}}" for name in names)
    (limits := tmp_path / "joint_limits.yaml").write_text(f"joint_limits:\n{rows}\n")
    given = [
        "plan",
        "line",
        "--robot",
        "ur5e",
        "--start-deg",
        "0,-70,70,-90,-90,0",
        "--move",
        "0,0,-0.1",
        "--limits",
        str(limits),
    ]
    status, _, said = typed(*given)
    assert status == 2 and "pan" in said and said.strip().count("\n") == 0
    out = tmp_path / "line.json"
    status, text, said = typed(*given, "--joint-names", ",".join(names), "--out", str(out))
    assert status == 0, text + said
    motion = planners.load_motion(out)
    np.testing.assert_array_equal(motion.limits.bounds(6)["jerk"], np.full(6, 40.0))
    assert motion.certify().is_valid


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("limits: {}", "no joint_limits"), ("joint_limits: {joint1: 3}", "joint1: expected a mapping"),
        ("joint_limits: {joint1: {max_velocity: -1}}", "joint1, max_velocity"),
        ("joint_limits: {joint1: {min_position: 1, max_position: 0}}", "min_position ≤ max_position"),
        ("joint_limits: {joint1: {has_velocity_limits: maybe}}", "true or false"),
        ("joint_limits: {a: {}}", "got limits of a; --joint-names gives the names in the file"),
    ],
)  # fmt: skip
def test_wrong_limits_are_refused_in_one_line(text: str, words: str, tmp_path: Path, typed: Any) -> None:
    (limits := tmp_path / "joint_limits.yaml").write_text(text)
    write_table(file := tmp_path / "m.csv", np.array([0.0, 2.0]), HOME + one_joint(0, [0.0, 0.6]), np.zeros((2, 6)))
    status, _, said = typed("certify", str(file), "--robot", "ur5e", "--limits", str(limits))
    assert status == 2 and words in said and said.strip().count("\n") == 0, said


# ---------------------------------------------------------------- path, scene, page


@pytest.fixture(name="seam")
def _seam(tmp_path: Path) -> tuple[Path, Path]:
    """A motion of another program, as a table, and the waypoints of its path: corners cut by 0.5 mm."""
    arm = optik.load("ur5e")
    start = arm.fk(HOME)
    points = start[:3, 3] + np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0]])
    path = planners.Polyline([optik.se3.pose(start[:3, :3], p) for p in points], blend=5e-4)
    plan = planners.plan(arm, path, HOME, limits=planners.MotionLimits(2.0, 10.0, 100.0))
    plan.save(tmp_path / "seam.csv", rate=250.0)
    lines = [",".join(f"{x:.12g}" for x in p) for p in points]
    (tmp_path / "way.csv").write_text("\n".join(["x,y,z", *lines]) + "\n")
    plan.save(tmp_path / "seam.json")
    return tmp_path / "seam.csv", tmp_path / "way.csv"


def test_the_tool_is_judged_along_waypoints(seam: tuple[Path, Path], typed: Any) -> None:
    file, way = seam
    given = ["certify", str(file), "--robot", "ur5e", "--path", str(way), "--tolerance"]
    status, out, _ = typed(*given, "0.6,0.5")
    assert status == 0 and re.search(r"path distance .*0\.8[345]\d? .*respected", out), out
    assert re.search(r"path angle .*not judged", out)  # the file has no orientations
    status, out, _ = typed(*given, "0.4,0.5")
    assert status == 1 and re.search(r"path distance .* 1\.2[5-9] .*exceeded", out) and "off its path" in out, out
    status, _, said = typed(*given, "0.4")
    assert status == 2 and "--tolerance" in said
    turned = way.with_name("turned.csv")
    rows = way.read_text().splitlines()
    turned.write_text("\n".join([rows[0] + ",qx,qy,qz,qw", *(row + ",0,0,0,1" for row in rows[1:])]))
    status, out, _ = typed(*given[:-2], str(turned), "--tolerance", "0.6,0.5")
    assert status == 1 and re.search(r"path angle .*exceeded", out)


def test_the_tool_is_judged_along_the_path_of_a_motion(seam: tuple[Path, Path], typed: Any) -> None:
    file = seam[0]
    status, out, _ = typed("certify", str(file), "--robot", "ur5e", "--path", str(file.with_suffix(".json")))
    assert status == 0 and re.search(r"path angle .*respected", out)
    status, _, said = typed("certify", str(file), "--robot", "ur5e", "--path", str(file.with_name("none.json")))
    assert status == 2 and "--path" in said


def test_contact_and_a_page(seam: tuple[Path, Path], tmp_path: Path, typed: Any) -> None:
    file, page = seam[0], tmp_path / "page.html"
    tool = optik.load("ur5e").fk(HOME)[:3, 3] + [0.1, 0.1, 0.0]
    (scene := tmp_path / "scene.toml").write_text(
        f"[[spheres]]\ncentre_mm = {(1e3 * tool).tolist()}\nradius_mm = 20.0\n"
    )
    status, out, said = typed(
        "certify", str(file), "--robot", "ur5e", "--scene", str(scene), "--html", str(page), "--velocity", "0.1"
    )
    assert status == 1 and "contact" in out and "velocity" in out, out + said
    text = page.read_text(encoding="utf-8")
    assert re.search(r'seam\.csv</h1><p class="bad">certificate NOT valid: velocity of joint\d is', text)
    assert "Between points" in text and "velocity" in text and len(text) < 1_000_000
    status, _, said = typed("certify", str(file), "--robot", "ur5e", "--html", str(tmp_path / "page.pdf"))
    assert status == 2 and "--html" in said and said.strip().count("\n") == 0


def test_without_any_limit_there_is_nothing_to_judge(tmp_path: Path, typed: Any) -> None:
    (arm := tmp_path / "two.urdf").write_text(
        '<robot name="two"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    (file := tmp_path / "m.csv").write_text("t,j,dq_j\n0,0,0\n1,1,0\n")
    status, _, said = typed("certify", str(file), "--robot", str(arm))
    assert status == 2 and "--limits" in said and "--velocity 2" in said and said.strip().count("\n") == 0
    status, out, _ = typed("certify", str(file), "--robot", str(arm), "--velocity", "1.6")
    assert status == 0 and re.search(r"position .*not judged", out) and re.search(r"velocity .*0\.938 .*respected", out)


def test_a_table_of_positions_names_the_interpolation(tmp_path: Path, typed: Any) -> None:
    t = np.linspace(0.0, 2.0, 41)
    q = HOME + one_joint(0, 0.25 * (1.0 - np.cos(np.pi * t / 2.0)))
    write_table(file := tmp_path / "m.csv", t, q)
    given = ["certify", str(file), "--robot", "ur5e", "--velocity", "2"]
    status, out, _ = typed(*given)
    assert status == 1 and "--interpolation spline" in out
    status, out, _ = typed(*given, "--interpolation", "spline")
    assert status == 0, out


def test_a_saved_motion_is_read_exactly_with_its_payloads(tmp_path: Path, typed: Any) -> None:
    arm = optik.load("ur5e").with_payload(2.0)
    limits = planners.MotionLimits.of(arm, acceleration=10.0, jerk=100.0)
    items = [
        planners.Part(planners.program.Move([0.0, 0.0, 0.1])),
        planners.program.ToolChange(payload=1.0),
        planners.Part(HOME),
    ]
    plan = planners.plan(arm, planners.Program(items), HOME, limits=limits)
    given = ["--acceleration", "10", "--jerk", "100"]
    for name in ("m.csv", "m.json"):
        plan.save(tmp_path / name)
        read = planners.load_trajectory(tmp_path / name, arm)
        np.testing.assert_array_equal(read.coefficients, plan.trajectory.coefficients)
        status, out, said = typed("certify", str(tmp_path / name), *given)
        assert status == 0 and "with payloads 2 kg, 1 kg" in " ".join(out.split()) and not said, out + said
    status, out, said = typed("certify", str(tmp_path / "m.csv"), "--robot", "ur10e", *given)
    assert "without the payload of the file" in said and "without payload" in out
    status, _, said = typed("certify", str(tmp_path / "m.json"), "--robot", "panda", *given)
    assert status == 2 and "joint_names: expected those of panda, joint1, " in said
    (tmp_path / "f.json").write_text('{"format": "optik-failed-plan/2"}')
    status, _, said = typed("certify", str(tmp_path / "f.json"), *given)
    assert status == 2 and "got 'optik-failed-plan/2'; optik view" in said


def test_points_at_a_rate_say_by_how_much_they_exceed_the_limits(tmp_path: Path, typed: Any) -> None:
    given = ["--robot", "ur5e", "--acceleration", "10", "--jerk", "100"]
    plan = [
        "plan",
        "joints",
        "--to-deg",
        "10,-80,90,-90,-90,0",
        *given,
        "--payload",
        "2",
        "--out",
        str(tmp_path / "m.csv"),
    ]
    status, out, _ = typed(*plan, "--rate", "250")
    found = re.search(
        r"exceeds limits: (?:acceleration is \S+ of its limit, )?jerk is (\S+) of its", " ".join(out.split())
    )
    assert status == 0 and found, out
    status, out, _ = typed("certify", str(tmp_path / "m.csv"), *given)
    judged = re.search(r"jerk of \S+ is (\S+) of its limit", out)
    assert status == 1 and judged and "with 2 kg" in " ".join(out.split())
    assert judged[1] == found[1]
    assert "exceeds" not in typed(*plan)[1] and typed("certify", str(tmp_path / "m.csv"), *given)[0] == 0


@pytest.mark.parametrize(
    ("ratio", "number", "words"),
    [
        (0.3141, "0.314", "0.314 of its limit"),
        (0.99996, "0.99996", "0.99996 of its limit"),
        (1.0 - 5e-7, "1", "1 of its limit"),
        (1.0, "1", "1 of its limit"),
        (1.0 + 5e-13, "1", "1 of its limit"),  # rounding of exact extrema
        (1.0 + 3e-12, "1.000000000003", "1.000000000003 of its limit"),
        (1.0004, "1.0004", "1.0004 of its limit"),
        (1.3141, "1.31", "1.31 of its limit"),
        (2.886, "2.89", "2.89 times its limit"),
        (np.inf, "unbounded", "unbounded"),
    ],
)
def test_a_ratio_has_three_digits_or_those_that_tell_it_from_1(ratio: float, number: str, words: str) -> None:
    assert (format_ratio(ratio), describe_ratio(ratio)) == (number, words)
