"""The command line as people type it: vectors, the default start, orientations, meshes in packages, rates, the version."""

from __future__ import annotations

import csv
import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.main import get_command

import optik
import planners
from benchmarks.cli.app import app
from benchmarks.cli.command import translate
from benchmarks.cli.runs import FEWEST_PARTS, make_progress, update_progress
from optik.arm.library import read_home, robot_from_toml
from optik.arm.model import unit_factors
from optik.errors import InvalidInput
from optik.registry import names
from optik.scene.contact import find_contact
from planners.certificate.violation import ALLOWANCES
from tests.oracles import REPOSITORY
from tests.seeds import shift_seed


def write(file: Path, text: str) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


# ---------------------------------------------------------------- vectors


@pytest.mark.parametrize("move", ["-0.12,0,0.2", "-0.12 0 0.2", "-0.12, 0, 0.2"])
@pytest.mark.parametrize("joined", [True, False], ids=["--move=…", "--move …"])
def test_a_vector_is_one_argument_with_commas_or_spaces(typed: Any, tmp_path: Path, move: str, joined: bool) -> None:
    out = str(tmp_path / "line.json")
    option = [f"--move={move}"] if joined else ["--move", move]
    status, _, said = typed("plan", "line", *option, "--timing", "quintic", "--out", out)
    assert status == 0, said
    path = planners.load_motion(out).path
    np.testing.assert_allclose(path.pose(path.end)[:3, 3] - path.pose(0.0)[:3, 3], [-0.12, 0.0, 0.2], atol=1e-12)


@pytest.mark.parametrize(
    "words",
    [
        "plan line --move -0.12 0 0.2", "plan line --move=-0.12 0 0.2", "plan arc --centre 0 0 0.2 --angle-deg 20",
        "plan polyline --via 0.1 0.2 0.3", "plan joints --to-deg 1 2 3 4 5 6", "ik --xyz 0.1 -0.3 0.2",
        "fk 20 -35 40 25 50 -30", "fk --robot irb910sc -10 20 30 4", "fk -10 20 30 4 -r irb910sc",
    ],
)  # fmt: skip
def test_the_numbers_of_a_vector_may_be_several_arguments(typed: Any, words: str) -> None:
    one = re.sub(r"(?<=\d) (?=-?\d)", ",", words)
    assert one.count(" ") < words.count(" ")
    status, out, said = typed(*words.split())
    assert typed(*one.split()) == (status, out, said) and status in (0, 1), said


@pytest.mark.parametrize("text", ["", "a,b,c", "1,2", "1,2,3,4", "1,,x", "0.1;0.2;0.3"])
def test_what_is_no_vector_is_named(typed: Any, text: str) -> None:
    status, _, said = typed("ik", "--xyz", text)
    assert status == 2
    assert said.startswith("error: --xyz: expected 3 numbers, such as 1,-2.5,3; got ")


# ---------------------------------------------------------------- the default start


@pytest.mark.parametrize("name", optik.robots())
def test_every_arm_has_a_home_that_is_regular_and_free(name: str) -> None:
    arm = optik.load(name)
    home = read_home(name)
    assert home is not None
    q = home / unit_factors(arm)
    room = np.minimum(q - arm.limits.lower, arm.limits.upper - q)
    assert (room > 0.05 * np.minimum(arm.limits.upper - arm.limits.lower, 1.0) * ~arm.prismatic).all()
    assert arm.singular_values(q)[-1] > 0.1
    if arm.shapes is not None:
        assert find_contact(arm, optik.Scene(), q).distance > 0.0


def test_a_home_is_a_configuration_of_the_arm(tmp_path: Path) -> None:
    text = 'convention = "dh"\njoints = [{ a_mm = 300, range_deg = [-90, 90] }, { type = "prismatic", range_mm = [0, 100] }]\n'
    file = write(tmp_path / "arm.toml", f"home_deg = [10, 50]\n{text}")
    assert read_home(file).tolist() == [10.0, 50.0]
    assert read_home(write(tmp_path / "other.toml", text)) is None
    for home in ("[10]", "[100, 50]", "[10, 101]", '"x"'):
        with pytest.raises(InvalidInput, match="home_deg"):
            robot_from_toml(write(tmp_path / "wrong.toml", f"home_deg = {home}\n{text}"))


def test_the_default_start_is_printed_and_can_be_typed(typed: Any) -> None:
    status, out, said = typed("ik", "-r", "panda", "--xyz", "0.4,0.1,0.5", "--json")
    assert status == 0
    found = re.search(r"start of panda, its home_deg: --start-deg (\S+)", said)
    assert found
    assert found[1] == "0,-45,0,-135,0,90,45"
    _, again, quiet = typed("ik", "-r", "panda", "--xyz", "0.4,0.1,0.5", "--start-deg", found[1], "--json")
    assert json.loads(again) == json.loads(out)
    assert "start of" not in quiet


WALL = """<robot name="wall"><link name="world"/><link name="plate"/><link name="arm"/>
<joint name="mount" type="fixed"><parent link="world"/><child link="plate"/><origin rpy="1.5707963267948966 0 0"/></joint>
<joint name="j" type="revolute"><parent link="plate"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-200" upper="200" velocity="2"/></joint></robot>"""


@pytest.mark.parametrize(("options", "gravity"), [((), (0, -1, 0)), (("--gravity", "2,0 0"), (1, 0, 0))])
@pytest.mark.filterwarnings("default")
def test_gravity_is_that_of_the_root_link_or_the_typed_one(
    typed: Any, tmp_path: Path, options: tuple[str, ...], gravity: tuple[int, ...]
) -> None:
    robot = ["-r", str(write(tmp_path / "wall.urdf", WALL)), "--base", "plate", *options]
    limits = ["--acceleration", "5", "--jerk", "50", "--start-deg", "0"]
    status, _, said = typed("plan", "joints", *robot, "--to-deg", "20", *limits, "--out", str(tmp_path / "motion.json"))
    assert status == 0, said
    assert said.startswith("warning: robot 'wall': ")  # one line, of the limits
    assert "at joint 'j' (200); were degrees meant?" in said
    np.testing.assert_allclose(planners.load_motion(tmp_path / "motion.json").robot.gravity, gravity, atol=1e-15)
    assert typed("bench", "new", str(tmp_path / "own.toml"), *robot)[0] == 0
    named = re.search(r'robot = "(.*)"', (tmp_path / "own.toml").read_text())
    assert named
    np.testing.assert_allclose(optik.load(str(tmp_path / named[1])).gravity, gravity, atol=1e-15)


def test_a_direction_of_gravity_that_cannot_be_meant_is_refused_by_its_option(typed: Any, tmp_path: Path) -> None:
    for text in ("0,0", "0,0,0", "down"):
        status, _, said = typed("fk", "0,0,0,0,0,0", "-r", "ur5e", "--gravity", text)
        assert (status, said.split(":")[1]) == (2, " --gravity")
    said = typed("bench", "new", str(tmp_path / "own.toml"), "-r", "ur5e", "--gravity", "0,0,1")[2]
    assert "--gravity: expected the gravity of the robot's file" in said


def test_a_position_alone_is_a_position_for_arms_with_fewer_joints_than_a_pose(typed: Any) -> None:
    place = ("ik", "-r", "wx200", "--xyz", "0.2,0.1,0.2")
    status, out, said = typed(*place, "--json")
    assert status == 0
    assert "wx200 has 5 joints and no orientation is given: --task position" in said
    np.testing.assert_allclose(optik.load("wx200").fk(json.loads(out)["q"])[:3, 3], [0.2, 0.1, 0.2], atol=1e-6)
    status, out, said = typed(*place, "--rpy-deg", "10,20,30")
    assert status == 1
    assert "not solved: 5 joints; a pose has 6 components: task position or axis_z" in said
    assert typed(*place, "--task", "pose")[0] == 1
    assert "--task" not in typed("ik", "-r", "ur5e", "--xyz", "0.3,0.2,0.4")[2]


def test_a_urdf_starts_where_the_library_does(typed: Any, tmp_path: Path) -> None:
    arm = optik.load("ur5e")
    arm.to_urdf(tmp_path / "arm.urdf")
    _, _, said = typed("ik", "-r", str(tmp_path / "arm.urdf"), "--xyz", "0.3,0.2,0.4")
    found = re.search(r"has no home_deg: --start-deg (\S+)", said)
    assert found
    q = np.array([float(x) for x in found[1].split(",")]) / unit_factors(arm)
    np.testing.assert_allclose(q, optik.choose_start(optik.load(tmp_path / "arm.urdf")), atol=1e-12)


def test_ik_names_the_orientation_of_the_start_and_turns_no_joint_by_a_whole_turn(typed: Any, tmp_path: Path) -> None:
    arm = optik.load("ur5e")
    arm.to_urdf(tmp_path / "arm.urdf")
    words = ("ik", "-r", str(tmp_path / "arm.urdf"))
    q = optik.choose_start(arm)
    for x, y, z in arm.fk(arm.limits.sample(np.random.default_rng(2), 4))[:, :3, 3]:
        typed_place = (*words, "--xyz", f"{x:.3f},{y:.3f},{z:.3f}")
        _, out, _ = typed(*typed_place)
        taken = re.search(r"orientation: that of the start, --rpy-deg (\S+)", out)
        assert taken
        R = Rotation.from_euler("xyz", [float(a) for a in taken[1].split(",")], degrees=True).as_matrix()
        np.testing.assert_allclose(R, arm.fk(q)[:3, :3], atol=2e-5)
        found = np.deg2rad([float(a) for a in re.findall(r"│ ([-+]\d+\.\d+)°", out)])
        assert found.size == arm.n and np.abs(found - q).max() <= np.pi + 1e-6
    assert "orientation:" not in typed(*typed_place, "--rpy-deg", "0,0,0")[1]
    assert "orientation:" not in typed(*typed_place, "--task", "position")[1]


# ---------------------------------------------------------------- fk and ik


@pytest.mark.parametrize("orientation", ["rpy-deg", "quat"])
def test_ik_takes_what_fk_prints(typed: Any, orientation: str) -> None:
    arm, rng = optik.load("ur5e"), np.random.default_rng(4)
    for q in arm.limits.sample(rng, 4):
        _, shown, _ = typed("fk", "-r", "ur5e", ",".join(map(str, np.degrees(q))))
        options = dict(re.findall(r"--(xyz|rpy-deg|quat) (\S+)", shown))
        status, out, _ = typed(
            "ik", "-r", "ur5e", "--xyz", options["xyz"], f"--{orientation}={options[orientation]}", "--json"
        )
        assert status == 0
        T = arm.fk(json.loads(out)["q"])
        np.testing.assert_allclose(T, arm.fk(q), atol=3e-6)


def test_fk_prints_the_same_for_programs(typed: Any) -> None:
    from scipy.spatial.transform import Rotation

    _, out, _ = typed("fk", "20,-35,40,25,50,-30", "--json")
    data = json.loads(out)
    q = np.deg2rad([20, -35, 40, 25, 50, -30])
    np.testing.assert_allclose(data["pose"], optik.load("paper6r").fk(q), atol=1e-12)
    R = np.array(data["pose"])[:3, :3]
    np.testing.assert_allclose(Rotation.from_euler("xyz", data["rpy_deg"], degrees=True).as_matrix(), R, atol=1e-12)
    np.testing.assert_allclose(Rotation.from_quat(data["quat"], scalar_first=True).as_matrix(), R, atol=1e-12)
    assert data["xyz"] == [row[3] for row in data["pose"][:3]]


def test_one_orientation_of_length_one(typed: Any) -> None:
    assert typed("ik", "--xyz", "0.1,0.3,0.2", "--quat", "1,0,0,0", "--rpy-deg", "0,0,0")[2].startswith(
        "error: --quat:"
    )
    assert "a unit quaternion" in typed("ik", "--xyz", "0.1,0.3,0.2", "--quat", "1,1,0,0")[2]


# ---------------------------------------------------------------- meshes, rates, the version

URDF = """<robot name="two">
<link name="base"><collision><geometry><mesh filename="package://parts/bar.stl"/></geometry></collision></link>
<link name="tool"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="tool"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""

STL = "solid bar\n" + "".join(
    "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners) + "endloop\nendfacet\n"
    for corners in (
        ((0, 0, 0), (0.01, 0, 0), (0, 0.01, 0)), ((0, 0, 0), (0.01, 0, 0), (0, 0, 0.01)),
        ((0, 0, 0), (0, 0.01, 0), (0, 0, 0.01)), ((0.01, 0, 0), (0, 0.01, 0), (0, 0, 0.01)),
    )
) + "endsolid bar\n"  # fmt: skip


@pytest.mark.filterwarnings("default")
def test_meshes_of_packages_are_found_and_the_way_to_shapes_is_said(typed: Any, tmp_path: Path) -> None:
    arm = write(tmp_path / "robot" / "arm.urdf", URDF)
    write(tmp_path / "ws" / "parts" / "bar.stl", STL)
    words = [
        "plan", "joints", "-r", str(arm), "--start-deg=-20", "--to-deg", "30", "--acceleration", "5", "--jerk", "50",
        "--scene", "self",
    ]  # fmt: skip
    status, _, said = typed(*words)
    assert status == 2
    assert f"--robot '{arm}#shapes=yes'" in said
    assert "--package-dir FOLDER" in said
    words[3] = f"{arm}#shapes=yes"
    warned, said = typed(*words)[2].splitlines()[:2]
    for line in (warned, said):
        assert (
            "link 'base'" in line and "bar.stl" in line and "--package-dir " in line and "--without-shape base" in line
        )
        assert "without_shape=" not in line and "package_dirs=" not in line
    assert typed(*words, "--without-shape", "base")[0] == 0
    start = [word for word in words if not word.startswith("--start")][:-2]
    assert typed(*start)[0] == 0  # its start is a sample, of an arm that is not checked
    suite = tmp_path / "own.toml"
    assert typed("bench", "new", str(suite), "-r", str(arm), "--without-shape", "base")[0] == 0
    assert "arm.urdf#without_shape=base" in suite.read_text()
    status, _, said = typed(*words, "--package-dir", str(tmp_path / "ws"))
    assert status == 0, said
    words[3] = str(arm)
    assert typed(*words, "--package-dir", str(tmp_path / "ws"))[0] == 0
    assert "is no URDF" in typed("plan", "line", "--package-dir", str(tmp_path))[2]


TWO_ENDS = """<robot name="two"><link name="base"/><link name="arm"/><link name="tool0"/><link name="ee"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1"/></joint>
<joint name="a" type="fixed"><parent link="arm"/><child link="tool0"/><origin xyz="0.5 0 0"/></joint>
<joint name="b" type="fixed"><parent link="arm"/><child link="ee"/><origin xyz="0.7 0 0"/></joint></robot>"""


def test_one_line_says_which_tip_was_taken_or_how_to_take_one(typed: Any, tmp_path: Path) -> None:
    arm = write(tmp_path / "two.urdf", TWO_ENDS)
    for options, x, line in (
        ((), 0.5, "URDF 'two', from base to tool0, chosen by its name; --tip selects another\n"),
        (("--tip", "ee"), 0.7, ""),
    ):
        status, out, said = typed("fk", "0", "-r", str(arm), "--json", *options)
        assert (status, said, json.loads(out)["xyz"]) == (0, line, [x, 0.0, 0.0])
    write(arm, TWO_ENDS.replace("tool0", "tip"))
    status, _, said = typed("fk", "0", "-r", str(arm))
    assert (status, said) == (
        2, f"error: robot 'two' in {arm}: possible tips are tip (1 joint), ee (1 joint); for the first: --tip tip\n"
    )  # fmt: skip
    assert "--tip hand names no link" in typed("fk", "0", "-r", str(arm), "--tip", "hand")[2]
    assert "#tip=LINK&base=LINK" in typed("fk", "0", "-r", f"{arm}#end=tip")[2]  # these follow a path


def test_a_joint_beside_the_arm_is_held_and_one_that_cannot_be_is_named(typed: Any, tmp_path: Path) -> None:
    finger = (
        '<link name="finger"><collision><origin xyz="0 0 .1"/><geometry><sphere radius=".02"/></geometry></collision></link>'
        '<joint name="grip" type="revolute"><parent link="{}"/><child link="finger"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    text = optik.load("kr6").to_urdf()
    arm = write(tmp_path / "arm.urdf", text.replace("</robot>", finger.format("link6")))
    words = (
        "plan", "joints", "-r", f"{arm}#shapes=yes&tip=tool", "--to-deg", "0,-80,90,0,0,0", "--start-deg", "0,-90,90,0,0,0",
        "--acceleration", "5", "--jerk", "50",
    )  # fmt: skip
    out = tmp_path / "motion.json"
    status, _, said = typed(*words, "--hold", "grip=0.5", "--out", str(out))
    assert status == 0, said
    held = planners.load_motion(out).robot.shapes
    assert held.m == 1 and held == optik.load(f"{arm}#shapes=yes&tip=tool", values={"grip": 0.5}).shapes
    suite = tmp_path / "own.toml"
    assert typed("bench", "new", str(suite), *words[2:4], "--hold", "grip=0.5")[0] == 0
    named = re.search(r'robot = "\./(.*)"', suite.read_text())
    assert named and optik.load(str(tmp_path / named[1])).shapes == held
    with pytest.raises(optik.errors.InvalidInput, match="hold: expected JOINT:VALUE"):
        optik.load(f"{arm}#tip=tool&hold=grip")
    for text, part in (
        ("grip=30", "[-1, 1] rad; got grip = 30 rad"),  # as the option
        ("grp=0", "grip"),
        ("grip", "JOINT=VALUE"),
        ("joint2=0", "expected joints beside the chain: grip; got 'joint2', a joint of the chain"),
    ):
        status, _, said = typed(*words, "--hold", text)
        assert status == 2 and "--hold" in said and part in said and said.strip().count("\n") == 0, said


@pytest.mark.parametrize("rate", [50.0, 333.0])
def test_a_csv_at_a_rate_is_a_table_at_that_rate_and_the_same_motion(typed: Any, tmp_path: Path, rate: float) -> None:
    out, exact = tmp_path / "line.csv", tmp_path / "line.npz"
    assert typed("plan", "line", "--out", str(out), "--rate", str(rate))[0] == 0
    assert typed("plan", "line", "--out", str(exact))[0] == 0
    motion = planners.load_motion(out)
    np.testing.assert_array_equal(motion.trajectory.coefficients, planners.load_motion(exact).trajectory.coefficients)
    assert motion.certify().is_valid
    rows = list(csv.reader(line for line in out.read_text().splitlines() if not line.startswith("# ")))[1:]
    table = np.array(rows, dtype=float)
    np.testing.assert_allclose(table[:-1, 0], np.arange(len(table) - 1) / rate)
    assert table[-1, 0] == motion.trajectory.end
    np.testing.assert_allclose(table[:, 1:7], motion.trajectory(table[:, 0]))


def test_a_rate_is_for_tables(typed: Any, tmp_path: Path) -> None:
    yaml = tmp_path / "line.yaml"
    assert typed("plan", "line", "--out", str(yaml), "--rate", "100")[0] == 0
    periods = np.diff(
        [float(s) + 1e-9 * float(n) for s, n in re.findall(r"sec: (\d+)\s+nanosec: (\d+)", yaml.read_text())]
    )
    np.testing.assert_allclose(periods[periods > 0.0], 0.01, atol=2e-9)
    for words in (["--rate", "100"], ["--rate", "100", "--out", "x.npz"], ["--rate", "nan", "--out", "x.csv"]):
        assert "--rate" in typed("plan", "line", *words)[2]
    assert "at most" in typed("plan", "line", "--out", str(tmp_path / "x.csv"), "--rate", "1e9")[2]


# ---------------------------------------------------------------- help


def commands(group: Any = None, words: str = "optik") -> dict[str, Any]:
    """Every command by what is typed for it."""
    found = {}
    for name, command in (get_command(app) if group is None else group).commands.items():
        inner = getattr(command, "commands", None)
        found |= commands(command, f"{words} {name}") if inner else {f"{words} {name}": command}
    return found


@pytest.mark.parametrize("words", commands())
def test_the_help_of_a_command_ends_with_an_example_that_can_be_typed(words: str) -> None:
    command = commands()[words]
    example = command.epilog.removeprefix("Example: `").removesuffix("`")
    assert example.startswith(words)
    command.make_context(words, shlex.split(example)[len(words.split()) :])  # raises for a wrong option or value


def test_the_help_of_a_plan_is_in_panels_and_explains_every_word_of_allow(typed: Any) -> None:
    _, out, _ = typed("plan", "line", "--help")
    titles = [line.split()[1] for line in out.splitlines() if line.startswith("╭─")]
    assert titles == ["Path", "Robot", "Method", "Limits", "Scene", "Output"]
    assert "[m]" in out and "[rad/s³" in out
    assert all(re.search(rf"\b{word} \(", " ".join(out.replace("│", "").split())) for word in ALLOWANCES)


def test_messages_are_in_degrees_millimetres_and_options() -> None:
    words = "a leaves [-1.5708, 1.5708] rad, b its range [0, 0.18] m, by 2e-3 rad at 3 rad/s; or allow=('jerk', 'path')"
    assert translate(words) == (
        "a leaves [-90, 90]°, b its range [0, 180] mm, by 0.1146° at 3 rad/s; or --allow jerk,path"
    )
    best = 'branch="best", which reaches the end of the path from the start configuration [1, -0.5] rad; or a path'
    assert translate(best) == (
        "--branch best, which reaches the end of the path from the start configuration [57.3, -28.65]°; or a path"
    )
    advice = "timing='optimal' with tool_speed=0.25, which slows; a law with tool_speed= or rotation_speed= as limits"
    assert translate(advice) == (
        "--timing optimal with --tool-speed 0.25, which slows; a law with --tool-speed or --rotation-speed as limits"
    )
    assert translate("reconfigurations=2: a way; avoid=True, which searches; (package_dirs=)") == (
        "--reconfigurations 2: a way; --avoid, which searches; (--package-dir)"
    )
    assert translate("hold joints (values={'grip': 0.5, 'b c': -1}), without_shape=('a', 'b')") == (
        "hold joints (--hold grip=0.5 --hold b c=-1), --without-shape a,b"
    )
    assert translate("got 'jerk=1'; arm.urdf#tip=LINK&base=LINK; [1, 2] rad/s, [1, 2] m/s") == (
        "got 'jerk=1'; arm.urdf#tip=LINK&base=LINK; [1, 2] rad/s, [1, 2] m/s"
    )
    assert translate("within its time_limit: a longer one") == "within its --time-limit: a longer one"
    assert translate("'j0' [-1, 1] rad; with_limits sets them") == "'j0' [-57.3, 57.3]°; only <limit> is read"


def test_an_error_says_what_to_type(typed: Any) -> None:
    for words, advice in (
        (["--rate", "100", "--out", "x.npz"], "--out FILE.yaml"),
        (["--margin", "0.1"], "--scene self"),
        (["--format", "npz"], "--out FILE"),
        (["-r", "ur5e"], "--jerk 50"),
    ):
        status, _, said = typed("plan", "line", *words)
        assert status == 2
        assert advice in said.partition("; got ")[2].partition("; ")[2]


@pytest.mark.parametrize(
    ("words", "option", "group", "form"),
    [
        ("optik plan line", "--timing", "planners.timing", "{}"),
        ("optik plan line", "--out", "planners.files", ".{}"),
        ("optik plan line", "--format", "planners.files", "{}"),
        ("optik plan line", "--limit", "planners.limits", "{}"),
        ("optik plan line", "--solver", "optik.ik", "{}"),
        ("optik plan line", "--free", "planners.freedom", "{}"),
        ("optik drive", "PLAN", "planners.files", ".{}"),
        ("optik drive", "--on", "planners.cell.drives", "{}"),
        ("optik cell", "--drive", "planners.cell.drives", "{}"),
        ("optik plan path", "PATH", "planners.paths", "{}"),
    ],
)
def test_the_help_names_every_file_of_a_folder(words: str, option: str, group: str, form: str) -> None:
    (found,) = (p for p in commands()[words].params if option in (*p.opts, p.metavar))
    missing = [
        name for name in names(group) if not re.search(rf"(?<![\w.]){re.escape(form.format(name))}\b", found.help)
    ]
    assert not missing, f"{words} --help: {option} does not name {', '.join(missing)} of {group}"


def test_a_limit_of_a_file_is_kept_and_printed(typed: Any, tmp_path: Path) -> None:
    limit, file = REPOSITORY / "examples" / "plugins" / "weighted_speed.py", tmp_path / "line.json"
    status, out, said = typed("plan", "line", "--limit", f"{limit}=0.8", "--out", str(file))
    assert status == 0, said
    assert re.search(r"weighted speed │ 1 +│ arm", out)
    assert planners.load_motion(file).limits.extra == {"weighted_speed": 0.8}
    for text, words in (("0.8", "got '0.8'"), ("weighted=1", "unknown limit 'weighted'"), ("jerk=1", "type --jerk 1")):
        status, _, said = typed("plan", "line", "--limit", text)
        assert status == 2 and words in said


def test_the_version_is_the_package_s(typed: Any) -> None:
    assert typed("--version") == (0, f"optik {optik.__version__}\n", "")


# ---------------------------------------------------------------- the time left, the cell


@pytest.mark.parametrize("seed", range(5))
def test_the_time_left_is_within_a_third_of_the_truth_though_the_first_part_compiles(seed: int) -> None:
    rng = np.random.default_rng([shift_seed(0), seed])
    total, now, shown = 120, 0.0, []
    progress = make_progress(lambda: now)
    assert update_progress(progress, 0, 1, "problem sets") is None
    assert update_progress(progress, 0, total, "part") is None
    ends = 25.0 + np.cumsum(rng.uniform(0.2, 0.6, total))  # 25 s of compiling, then 48 s of work
    for done, now in enumerate(ends, 1):
        if (found := update_progress(progress, done, total, "part")) is not None:
            shown.append((found, ends[-1] - now))
    estimates, truths = np.array(shown[:-10]).T
    assert len(shown) == total - FEWEST_PARTS + 1
    assert np.abs(estimates / truths - 1.0).max() < 0.6
    assert np.median(np.abs(estimates / truths - 1.0)) < 0.2


def test_a_run_that_goes_on_is_not_fast_for_what_was_done_before() -> None:
    now = 0.0
    progress = make_progress(lambda: now)
    found = []
    for done, seconds in ((1000, 0.0), (1001, 9.0), (1002, 10.0), (1003, 11.0), (1004, 12.0)):
        now = seconds
        found.append(update_progress(progress, done, 1014, "part"))
    assert found == [None, None, None, 11.0, 10.0]


@pytest.mark.parametrize("seed", range(4))
def test_corrections_of_the_readme_reduce_the_error(typed: Any, tmp_path: Path, seed: int) -> None:
    line = next(line for line in (REPOSITORY / "README.md").read_text().splitlines() if line.startswith("optik cell "))
    words = line.partition("#")[0].split()[1:]
    out = str(tmp_path / "cell.html")
    status, printed, said = typed(*words, "--drive", "ideal", "--seed", str(seed), "--out", out, "--json")
    assert status == 0, said
    errors = [float(np.linalg.norm(each["error"])) for each in json.loads(printed)["rounds"]]
    assert errors[-1] < 0.1 * errors[0]


def test_corrections_below_the_noise_say_so(typed: Any, tmp_path: Path) -> None:
    words = ("cell", "--drive", "ideal", "--corrections", "1", "--readings", "10", "--out", str(tmp_path / "c.html"))
    assert "corrections cannot reduce it" in typed(*words)[1]
    assert "corrections cannot reduce it" not in typed(*words, "--miscalibration", "3,5")[1]
