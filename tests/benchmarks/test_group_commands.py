"""Groups as people type them: a file with members as --robot, and members named by --tool, --frame and --limit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import optik
import planners
from optik.arm.model import unit_factors

ARM = """robot = "ur5e"
tool = { xyz_mm = [50.0, 0.0, 300.0], rpy_deg = [0.0, 40.0, 0.0] }
dynamic_limits = { acceleration = 10.0, jerk = 100.0 }
"""
CELL = f"""[members.arm]
{ARM}payload_kg = 0.5
[members.table]
robot = "./table.toml"
base = {{ xyz_mm = [600.0, 0.0, 150.0] }}
"""
TABLE = """convention = "mdh"
joint_names = ["tilt", "turn"]
base = { rpy_deg = [90.0, 0.0, 90.0] }
tool = { xyz_mm = [0.0, 0.0, 50.0] }
joints = [ { range_deg = [-90, 90], speed_deg = 90 }, { alpha_deg = -90, range_deg = [-720, 720], speed_deg = 150 } ]
[dynamic_limits]
acceleration = [3.0, 5.0]
jerk = [30.0, 50.0]
[shapes]
capsules = [ { link = 2, a_mm = [-150, 0, 0], b_mm = [150, 0, 0], radius_mm = 30 } ]
"""
PAIR = """[members.left]
robot = "ur5e"
tool = { xyz_mm = [0, 0, 250], rpy_deg = [0, -90, 0] }
dynamic_limits = { acceleration = 10.0, jerk = 100.0 }
[members.right]
robot = "ur5e"
base = { xyz_mm = [1500, 0, 0], rpy_deg = [0, 0, 180] }
tool = { xyz_mm = [0, 0, 250], rpy_deg = [0, 90, 0] }
dynamic_limits = { acceleration = 10.0, jerk = 100.0 }
"""
START = "-24.2,-97.6,-145,38.1,-75.7,56.8,69.5,-136.5"
LINE = ("plan", "line", "--robot", "cell.toml", "--tool", "arm", "--start-deg", START, "--move", "0,0.05,0")


@pytest.fixture(autouse=True)
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, text in (("cell", CELL), ("table", TABLE), ("pair", PAIR)):
        (tmp_path / f"{name}.toml").write_text(text)
    (tmp_path / "three.toml").write_text(CELL + '[members.third]\nrobot = "ur5e"\nbase = { xyz_mm = [0, 900, 0] }\n')
    (tmp_path / "post.toml").write_text(
        '[[boxes]]\nname = "post"\nxyz_mm = [600, 500, 300]\nedges_mm = [200, 100, 600]\n'
    )
    monkeypatch.chdir(tmp_path)


def test_a_line_on_a_table_is_planned_written_shown_and_sent(typed: Any) -> None:
    status, out, said = typed(*LINE, "--scene", "post.toml", "--limit", "arm.torque=60", "--out", "line.json")
    assert (status, said) == (0, "") and "clearance of arm and table between links" in out and "table/t" in out
    group, motion = optik.Group.load("cell.toml"), planners.load_motion("line.json")
    whole = group.as_robot("arm")
    assert motion.limits.value("arm.torque").value == 60.0 and motion.certificate.is_valid
    assert motion.robot.joint_names[:2] == ("table/turn", "table/tilt") and group.members["arm"].payload.masses == (
        0.5,
    )
    start = motion.trajectory(0.0)[group.places(motion.robot)]
    assert start * unit_factors(whole) == pytest.approx([float(x) for x in START.split(",")], abs=1e-9)
    assert np.linalg.norm(np.diff(motion.robot.fk(motion.trajectory([0.0, motion.trajectory.end]))[:, :3, 3], axis=0)) == (
        pytest.approx(0.05, abs=1e-6)
    )  # fmt: skip
    assert typed("view", "line.json", "--html", "line.html")[0] == 0
    assert typed("certify", "line.json", "--html", "judged.html")[0] == 0
    for page in ("line.html", "judged.html"):
        text = Path(page).read_text()
        assert (
            '"arm/joint1","arm/joint2"' in text and '"table/tilt","table/turn"' in text
        )  # in the world, as in the file
    status, _, said = typed("drive", "line.json", "--on", "ideal")
    assert status == 2 and "plan.members[NAME]" in said  # a chain has not the gravity of its arms
    status, out, _ = typed(*LINE, "--out", "line.yaml", "--rate", "125")
    assert status == 0 and "line.arm.yaml and line.table.yaml" in out
    assert planners.load_trajectory("line.table.yaml", group.members["table"]).n == 2


def test_joints_of_three_members_and_a_program_are_typed_in_the_order_of_the_file(typed: Any) -> None:
    more, to = ",0,-90,90,-90,-90,0", START.replace("-24.2", "-20").replace("69.5", "60")
    words = ("--robot", "three.toml", "--jerk", "50", "--acceleration", "5", "--start-deg", START + more)
    assert typed("plan", "joints", *words, "--to-deg", to + more, "--scene", "self", "--out", "j.json")[0] == 0
    motion = planners.load_motion("j.json")
    goal = motion.trajectory(motion.trajectory.end) * unit_factors(motion.robot)
    assert goal == pytest.approx([float(x) for x in (to + more).split(",")], abs=1e-9)
    assert typed("view", "j.json", "--html", "j.html")[0] == 0
    Path("p.toml").write_text(f"[[part]]\nvector_mm = [0, 0, -20]\n[[part]]\njoints = [{to}]\n")
    status, out, _ = typed("program", "check", "p.toml", "--robot", "cell.toml", "--tool", "arm")
    assert status == 0 and "joints to -20, -97.6" in " ".join(out.split())
    status, out, _ = typed(
        "plan", "program", "p.toml", "--robot", "cell.toml", "--tool", "arm", "--start-deg", START, "--out", "p.json"
    )
    motion = planners.load_motion("p.json")
    ends = motion.trajectory(motion.trajectory.end)[optik.Group.load("cell.toml").places(motion.robot)]
    assert status == 0 and np.degrees(ends) == pytest.approx([float(x) for x in to.split(",")], abs=1e-6)


def test_two_arms_carry_a_piece(typed: Any) -> None:
    Path("way.csv").write_text("x_mm,y_mm,z_mm,roll_deg,pitch_deg,yaw_deg\n750,-100,300,0,0,0\n780,150,500,0,0,0\n")
    words = ("plan", "polyline", "--waypoints", "way.csv", "--robot", "pair.toml", "--tool", "left,right")
    status, out, _ = typed(*words, "--payload", "4")
    assert status == 0 and "held: at most" in out and "left: certificate valid" in out and "start of the motion" in out
    assert "right.torque" in out


def test_a_group_is_listed_and_shown(typed: Any) -> None:
    out = typed("robots", "./cell.toml")[1]
    assert "Group(arm='ur5e', table='table'; 8 joints)" in out and "arm: Robot" in out
    assert set(json.loads(typed("robots", "./cell.toml", "--json")[1])["members"]) == {"arm", "table"}
    for words in (("cell.toml", "--start-deg", START), ("post.toml", "--robot", "cell.toml", "--start-deg", START)):
        assert typed("view", *words, "--html", "page.html")[0] == 0
        text = Path("page.html").read_text()
        assert '"table/tilt","table/turn"' in text and ('"boxes":""' not in text) == (words[0] == "post.toml")


WRONG = {
    "--tool: expected arm or table; got 'torch'": ("--tool", "torch"),
    "--frame: expected a member other than 'arm'; got 'world'": ("--frame", "world"),
    "--limit: expected MEMBER.NAME=VALUE with a member: arm or table; got 'torque'": ("--limit", "torque=3"),
    "arm: torque: expected a positive number or 6 of them": ("--limit", "arm.torque=3,4"),
    "--tip: expected none for a group": ("--tip", "tool0"),
    "--torque: expected none for a group": ("--torque", "87"),
    "table/tilt within [-90, 90]°": ("--start-deg", "0,0,0,0,0,0,200,0"),
    "--start-deg: expected 8 joint values": ("--start-deg", "0,0,0"),
    "group: expected two members, for a plan; got 3 members": ("--robot", "three.toml"),
    "--tool: expected none for one arm: it names a member of a group": ("--robot", "ur5e"),
    "'nix.toml', which is no file": ("--robot", "nix.toml"),
}


@pytest.mark.parametrize("words", WRONG)
def test_a_wrong_word_for_a_group_is_one_short_line(typed: Any, words: str) -> None:
    status, _, said = typed(*LINE, *WRONG[words])
    assert status == 2 and words in said and said.count("\n") == 1 and len(said) <= 200


def test_a_group_is_refused_where_one_arm_is_meant(typed: Any) -> None:
    said = typed("plan", "line", "--robot", "cell.toml")[2]
    assert said.startswith("error: --tool: expected the member whose tool follows the path: arm or table")
    for words in (
        ("fk", "--robot", "cell.toml", "1,2"),
        ("plan", "ptp", "--robot", "cell.toml", "--waypoints", "x.csv"),
    ):
        status, _, said = typed(*words)
        assert status == 2 and "a group" in said and len(said) <= 200
