"""URDF in and out: against products of SciPy's rotations and against Pinocchio, and what is refused, by name."""

import contextlib
import shutil
import subprocess
import sys
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import optik
from optik import DHRow, JointLimits, Robot, errors
from optik.arm.urdf_writer import roll_pitch_yaw
from optik.errors import DegreesWarning, InvalidInput, OptikError, RobotModelError, RobotModelWarning
from tests import oracles
from tests.robots import BOUNDED

pytestmark = pytest.mark.filterwarnings("ignore:.*velocity 0 of joint")
"""A joint whose velocity is unknown, among others."""
LIMIT = '<limit lower="-2" upper="3" effort="1" velocity="1.5"/>'
PLAIN = f"""<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/><link name="upper"/><link name="lower"/><link name="tool0"/><link name="camera"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.3" rpy="0 0 0.5"/><axis xyz="0 1 0"/>{LIMIT}</joint>
  <joint name="slide" type="prismatic"><parent link="upper"/><child link="lower"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.4" effort="1" velocity="0"/></joint>
  <joint name="mount" type="fixed"><parent link="lower"/><child link="tool0"/><origin xyz="0.1 0 0"/></joint>
  <joint name="eye" type="fixed"><parent link="upper"/><child link="camera"/></joint>
</robot>"""


def arm(*joints, links=4, name="arm", rest=""):
    """URDF of a chain: link0 to link{n}, and joints as given."""
    inside = "".join(f'<link name="link{i}"/>' for i in range(links)) + "".join(joints) + rest
    return f'<robot name="{name}">{inside}</robot>'


def joint(i, kind="revolute", inside=LIMIT, name=None, parent=None, child=None):
    ends = f'<parent link="{parent or f"link{i}"}"/><child link="{child or f"link{i + 1}"}"/>'
    return f'<joint name="{name or f"j{i}"}" type="{kind}">{ends}{inside}</joint>'


def one(inside, kind="revolute", name="j0"):
    return arm(joint(0, kind, inside, name), links=2)


# ---------------------------------------------------------------- the chain
numbers = st.floats(-2, 2) | st.sampled_from([0.0, 1.0, -1.0])
angles = st.floats(-4, 4) | st.sampled_from([0.0, pi / 2, -pi / 2, pi])
triples = st.tuples(numbers, numbers, numbers)
axes = triples.filter(lambda v: np.linalg.norm(v) > 1e-3)
links = st.tuples(
    st.sampled_from(["revolute", "continuous", "prismatic", "fixed"]), triples, st.tuples(angles, angles, angles), axes
)


def words(v):
    return " ".join(map(repr, v))


def written(chain):
    joints = []
    for i, (kind, xyz, rpy, axis) in enumerate(chain):
        inside = f'<origin xyz="{words(xyz)}" rpy="{words(rpy)}"/>'
        inside += "" if kind == "fixed" else f'<axis xyz="{words(axis)}"/>'
        joints.append(joint(i, kind, inside + (LIMIT if kind in ("revolute", "prismatic") else "")))
    return arm(*joints, links=len(chain) + 1)


def product(chain, q):
    """Tool pose by SciPy's rotations, joint after joint."""
    T, values = np.eye(4), iter(q)
    for kind, xyz, rpy, axis in chain:
        origin, motion = np.eye(4), np.eye(4)
        origin[:3, :3], origin[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
        unit = np.array(axis) / np.linalg.norm(axis)
        if kind == "prismatic":
            motion[:3, 3] = next(values) * unit
        elif kind != "fixed":
            motion[:3, :3] = Rotation.from_rotvec(next(values) * unit).as_matrix()
        T = T @ origin @ motion
    return T


@st.composite
def chains(draw):
    chain = draw(st.lists(links, min_size=1, max_size=8).filter(lambda c: any(k[0] != "fixed" for k in c)))
    n = sum(k[0] != "fixed" for k in chain)
    return chain, np.array(draw(st.lists(st.floats(-3, 3), min_size=n, max_size=n)))


@given(chains())
def test_a_chain_is_the_product_of_its_origins_and_joints(case):
    chain, q = case
    robot = Robot.from_urdf(written(chain))
    kinds = [k[0] for k in chain if k[0] != "fixed"]
    assert robot.n == len(kinds)
    assert robot.prismatic.tolist() == [k == "prismatic" for k in kinds]
    assert np.abs(robot.fk(q) - product(chain, q)).max() < 1e-13


@given(chains())
def test_a_chain_is_pinocchios(case):
    pin = pytest.importorskip("pinocchio")
    chain, q = case
    model = pin.buildModelFromXML(written(chain))
    data = model.createData()
    pin.framesForwardKinematics(model, data, pin.integrate(model, pin.neutral(model), q))
    theirs = data.oMf[model.getFrameId(f"link{len(chain)}")].homogeneous
    assert np.abs(Robot.from_urdf(written(chain)).fk(q) - theirs).max() < 1e-12


def test_names_limits_and_velocities_are_the_files():
    robot = Robot.from_urdf(PLAIN, "tool0")
    assert robot.name == "arm"
    assert robot.joint_names == ("shoulder", "slide")
    assert robot.prismatic.tolist() == [False, True]
    assert robot.limits.lower.tolist() == [-2, 0]
    assert robot.limits.upper.tolist() == [3, 0.4]
    assert robot.limits.velocity.tolist() == [1.5, np.inf]  # 0 is no speed at all: it is not known
    assert robot.limits.acceleration is None
    assert robot.source == "URDF 'arm', from base to tool0"
    assert (robot.gravity == (0, 0, -1)).all()


def test_a_part_of_the_tree_is_an_arm_too():
    whole = Robot.from_urdf(PLAIN, "tool0", name="mine", gravity=(0, 9.81, 0))
    assert (whole.name, whole.gravity.tolist()) == ("mine", [0, 1, 0])
    upper = Robot.from_urdf(PLAIN, tip="camera")
    assert upper.joint_names == ("shoulder",)
    with pytest.warns(errors.MovingMountWarning, match="'upper'"):  # gravity is that of the shoulder's zero position
        lower = Robot.from_urdf(PLAIN, base="upper", tip="tool0")
    assert lower.joint_names == ("slide",)
    assert np.abs(upper.fk([0.7]) @ lower.fk([0.2]) - whole.fk([0.7, 0.2])).max() < 1e-15


def test_a_file_is_read_as_its_text(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(PLAIN)
    for source in (file, str(file), PLAIN, "\ufeff\n" + PLAIN):
        assert Robot.from_urdf(source, "tool0") == Robot.from_urdf(PLAIN, "tool0")
    named = PLAIN.replace('"arm"', '"Ärm"').replace("?>", ' encoding="latin-1"?>')
    file.write_bytes(named.encode("latin-1"))
    assert Robot.from_urdf(file, "tool0").name == "Ärm"
    assert Robot.from_urdf(named, "tool0").name == "Ärm"
    file.write_bytes(PLAIN.encode("utf-16"))
    assert Robot.from_urdf(file, "tool0").name == "arm"


def test_what_is_not_of_the_chain_is_not_read():
    rest = """<transmission name="t"><joint name="j0"><hardwareInterface>x</hardwareInterface></joint></transmission>
      <gazebo reference="link0"><joint name="j0"/></gazebo><ros2_control><joint name="j0"/></ros2_control>
      <link name="finger"/><link name="thumb"/><link name="ball"/>"""
    rest += joint(9, "prismatic", LIMIT + '<mimic joint="j0"/>', "grip", "link1", "finger")
    rest += joint(9, "floating", "", "free", "link1", "ball") + joint(9, "revolute", "", "bad", "link1", "thumb")
    inside = LIMIT + '<safety_controller soft_lower_limit="-0.1" soft_upper_limit="0.1" k_velocity="1"/>'
    with pytest.warns(
        RobotModelWarning, match=r"soft limits of <safety_controller> are not used: 'j0' \[-0.1, 0.1\] rad"
    ):
        robot = Robot.from_urdf(arm(joint(0, inside=inside), links=2, rest=rest), "link1")
    assert robot == Robot.from_urdf(one(LIMIT))
    for soft in ('soft_lower_limit="-9" soft_upper_limit="9" ', ""):  # wider, or none
        assert Robot.from_urdf(one(f'{LIMIT}<safety_controller {soft}k_velocity="1"/>')) == robot


@pytest.mark.parametrize("text", ["inf", "+Infinity", "0"])
def test_a_limit_may_be_infinite(text: str) -> None:
    limits = Robot.from_urdf(
        one(f'<limit lower="-1" upper="1" velocity="{text}" effort="{text}" acceleration="{text}"/>')
    ).limits
    assert limits.velocity is None and limits.torque is None and limits.acceleration is None


def test_a_default_namespace_is_no_obstacle():
    text = PLAIN.replace("<robot ", '<robot xmlns="http://drake.mit.edu" ')
    assert Robot.from_urdf(text, "tool0") == Robot.from_urdf(PLAIN, "tool0")


def test_what_urdf_leaves_out_has_urdfs_defaults():
    robot = Robot.from_urdf(one('<limit upper="1" effort="1"/>'))
    assert (robot.limits.lower[0], robot.limits.upper[0], robot.limits.velocity) == (0.0, 1.0, None)
    assert np.abs(robot.fk([0.4]) - oracles.rot_x(0.4)).max() < 1e-15
    free = Robot.from_urdf(one("", "continuous")).limits
    assert (free.lower[0], free.upper[0]) == (-np.inf, np.inf)
    assert Robot.from_urdf(one('<limit effort="1" velocity="2"/>', "continuous")).limits.velocity.tolist() == [2]


@pytest.mark.parametrize("axis", ["1e200 0 1e200", "1e-200 0 1e-200", "7 0 7", "0.5 0 0.5"])
def test_axes_of_any_length_are_directions(axis):
    robot = Robot.from_urdf(one(f'<axis xyz="{axis}"/>' + LIMIT))
    expected = Rotation.from_rotvec(0.6 * np.array([1, 0, 1]) / np.sqrt(2)).as_matrix()
    assert np.abs(robot.fk([0.6])[:3, :3] - expected).max() < 1e-15


def test_a_real_description_is_read_as_its_table():
    # what xacro makes of the joints in ros-industrial/abb, abb_irb120_support/urdf/irb120_3_58_macro.xacro
    rows = [("0 0 0", "0 0 1"), ("0 0 0.29", "0 1 0"), ("0 0 0.27", "0 1 0"), ("0 0 0.07", "1 0 0")]
    rows += [("0.302 0 0", "0 1 0"), ("0.072 0 0", "1 0 0")]
    joints = [
        joint(i, inside=f'<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/>{LIMIT}')
        for i, (xyz, axis) in enumerate(rows)
    ]
    joints.append(joint(6, "fixed", f'<origin xyz="0 0 0" rpy="0 {pi / 2!r} 0"/>'))
    robot, table = Robot.from_urdf(arm(*joints, links=8)), optik.load("irb120")
    q = oracles.configurations(oracles.table("irb120"), 50, 1)
    assert np.abs(robot.fk(q) - table.fk(q)).max() < 1e-14


# ---------------------------------------------------------------- back again
positions = st.floats(-1, 1)
turns = st.floats(-7, 7) | st.integers(-4, 4).map(lambda k: k * pi / 2)
rows = st.builds(DHRow, a=positions, alpha=turns, d=positions, theta=turns, prismatic=st.booleans())
ranges = st.tuples(st.floats(-5, 5), st.floats(-5, 5)).map(sorted).filter(lambda r: r[0] < r[1])
speeds = st.floats(1e-3, 1e3) | st.just(np.inf)
poses = st.builds(oracles.pose, st.tuples(turns, turns, turns), st.tuples(positions, positions, positions))


@st.composite
def robots(draw):
    table = draw(st.lists(rows, min_size=1, max_size=8))
    bounds = [draw(ranges if r.prismatic else ranges | st.just([-np.inf, np.inf])) for r in table]
    speed = draw(st.none() | st.lists(speeds, min_size=len(table), max_size=len(table)))
    limits = JointLimits(*np.array(bounds, dtype=float).T, speed)
    build = draw(st.sampled_from([Robot.from_mdh, Robot.from_dh]))
    robot = build(
        table, limits, base=draw(poses), tool=draw(poses), name=draw(st.sampled_from(["arm", "a <&> \"b'\n"]))
    )
    return robot, np.array(draw(st.lists(st.floats(-3, 3), min_size=robot.n, max_size=robot.n)))


@given(robots())
def test_a_robot_written_and_read_is_the_same_arm(case):
    robot, q = case
    back = Robot.from_urdf(robot.to_urdf())
    assert np.abs(back.fk(q) - robot.fk(q)).max() < 1e-13
    assert np.abs(back.jacobian(q) - robot.jacobian(q)).max() < 1e-12
    assert (back.limits.lower == robot.limits.lower).all()
    assert (back.limits.upper == robot.limits.upper).all()
    if robot.limits.velocity is None or np.isinf(robot.limits.velocity).all():
        assert back.limits.velocity is None
    else:
        assert (back.limits.velocity == robot.limits.velocity).all()
    assert (back.name, back.joint_names) == (robot.name, robot.joint_names)
    assert (back.prismatic == robot.prismatic).all()


@pytest.mark.parametrize("name", BOUNDED)
def test_what_is_written_is_read_by_pinocchio(name):
    pin = pytest.importorskip("pinocchio")
    robot = optik.load(name)
    model = pin.buildModelFromXML(robot.to_urdf())
    data, tool = model.createData(), model.getFrameId("tool")
    assert list(model.names)[1:] == list(robot.joint_names)
    assert (model.lowerPositionLimit == robot.limits.lower).all()
    assert (model.upperPositionLimit == robot.limits.upper).all()
    for q in oracles.configurations(oracles.table(name), 20, 5):
        pin.framesForwardKinematics(model, data, q)
        assert np.abs(data.oMf[tool].homogeneous - robot.fk(q)).max() < 1e-12


CHECK_URDF = shutil.which("check_urdf", path=str(Path(sys.executable).parent))


@pytest.mark.skipif(CHECK_URDF is None, reason="check_urdf comes with pin")
@pytest.mark.parametrize("name", optik.robots())
def test_what_is_written_passes_check_urdf(name, tmp_path):
    optik.load(name).to_urdf(tmp_path / "arm.urdf")
    done = subprocess.run([CHECK_URDF, tmp_path / "arm.urdf"], capture_output=True, text=True, check=True)
    assert "Successfully Parsed XML" in done.stdout
    other = [line for line in done.stderr.splitlines() if "Ignoring" not in line and "joint.cpp" not in line]
    assert other == []  # it ignores accelerations and jerks of files before version 1.2


tiny = st.sampled_from([0.0, 1e-16, -1e-12, 1e-9, -1e-8, 1e-6])


@given(turns, st.sampled_from([-pi / 2, pi / 2]) | turns, tiny, turns)
def test_roll_pitch_and_yaw_make_the_rotation_again_at_the_gimbals_lock_too(roll, pitch, off, yaw):
    R = Rotation.from_euler("xyz", [roll, pitch + off, yaw]).as_matrix()
    assert np.abs(Rotation.from_euler("xyz", roll_pitch_yaw(R)).as_matrix() - R).max() < 2e-15


def test_to_urdf_returns_what_it_writes(tmp_path):
    robot = optik.load("irb910sc")
    text = robot.to_urdf(tmp_path / "scara.urdf")
    assert (tmp_path / "scara.urdf").read_text() == text == robot.to_urdf()
    assert 'effort="0" velocity="1.02"' in text
    assert [f.name for f in tmp_path.iterdir()] == ["scara.urdf"]
    with pytest.raises(errors.OutputError):
        robot.to_urdf(tmp_path / "missing" / "scara.urdf")


def test_a_joint_may_be_called_as_the_fixed_one_is():
    robot = Robot.from_mdh([DHRow(), DHRow(a=0.1)], JointLimits([0, 0], [1, 1]), joint_names=("flange", "base"))
    assert Robot.from_urdf(robot.to_urdf()).joint_names == ("flange", "base")


ONE = JointLimits([-1.0], [1.0])
UNWRITABLE = {
    "a slide without limits": (Robot.from_mdh([DHRow(prismatic=True)], JointLimits([-np.inf], [np.inf])), "joint1"),
    "a limit on one side": (Robot.from_mdh([DHRow()], JointLimits([-np.inf], [1.0])), "joint1"),
    "a locked joint": (Robot.from_mdh([DHRow()], JointLimits([0.5], [0.5])), "'joint1': lower = upper = 0.5"),
    "no name": (Robot.from_mdh([DHRow()], ONE, name=""), "''"),
    "a name with a bell": (Robot.from_mdh([DHRow()], ONE, name="ding\a"), "ding"),
    "a joint without a name": (Robot.from_mdh([DHRow()], ONE, joint_names=("",)), "''"),
}


@pytest.mark.parametrize(("robot", "word"), UNWRITABLE.values(), ids=UNWRITABLE.keys())
def test_what_urdf_cannot_say_is_not_written(robot, word):
    with pytest.raises(RobotModelError, match=word):
        robot.to_urdf()


# ---------------------------------------------------------------- what is refused
BOMB = '<!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
XACRO = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="x"/></robot>'
BAD_SOURCES = {
    "no such file": ("no_such_file.urdf", "no_such_file.urdf"),
    "a NUL": ("arm\0.urdf", "path of a URDF file"),
    "a name too long": ("a" * 5000, "path of a URDF file"),
    "None": (None, "None"),
    "bytes": (PLAIN.encode(), "path of a URDF file"),
    "an empty name": ("", "path of a URDF file"),
    "no XML": ("<robot", "XML"),
    "cut short": (PLAIN[:-20], "XML"),
    "a lone surrogate": ("<robot name='\ud800", "XML"),
    "an unknown encoding": ('<?xml version="1.0"?><robot>\x01</robot>', "XML"),
    "another root": ("<sdf><model/></sdf>", "<sdf>"),
    "HTML": ("<!DOCTYPE html><html></html>", "DOCTYPE"),
    "a DOCTYPE": (BOMB.split(" [")[0] + ">" + PLAIN.partition("?>")[2], "DOCTYPE"),
    "an entity bomb": (BOMB + '<robot name="&b;"/>', "DOCTYPE"),
    "an outside entity": ('<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="&x;"/>', "DOCTYPE"),
    "an undeclared entity": ('<robot name="&x;"/>', "XML"),
    "xacro": (XACRO, "xacro in.xacro > out.urdf"),
    "xacro undeclared": ("<robot><xacro:macro/></robot>", "xacro in.xacro > out.urdf"),
    "a xacro file": ("arm.urdf.xacro", "xacro in.xacro > out.urdf"),
    "a xacro expression": (one('<limit lower="${-pi}" upper="1"/>'), "xacro in.xacro > out.urdf"),
}


@pytest.mark.parametrize(("source", "word"), BAD_SOURCES.values(), ids=BAD_SOURCES.keys())
def test_what_is_no_urdf_is_refused_by_name(source, word):
    with pytest.raises(InvalidInput) as caught:
        Robot.from_urdf(source)
    assert caught.value.argument == "source"
    assert word in str(caught.value)
    assert len(str(caught.value)) < 400


def loop(*ends):
    return "".join(joint(i, name=f"r{i}", parent=a, child=b) for i, (a, b) in enumerate(ends))


BAD_ARMS = {
    "no links": ("<robot name='a'/>", {}, "no links"),
    "only a link": (arm(links=1), {}, "no joint between base and tip moves"),
    "nothing moves": (one("", "fixed"), {}, "no joint between base and tip moves"),
    "the tip is the base": (PLAIN, {"tip": "upper", "base": "upper"}, "no joint between base and tip moves"),
    "two arms": (
        arm(joint(0), joint(1, parent="link0", child="link2"), links=3),
        {},
        "possible tips are link1 (1 joint), link2 (1 joint); for the first: tip='link1'",
    ),
    "no such tip": (PLAIN, {"tip": "hand"}, "tip='hand' names no link; there are: base, upper"),
    "no such base": (PLAIN, {"tip": "tool0", "base": "world"}, "base='world' names no link"),
    "the tip above the base": (PLAIN, {"tip": "base", "base": "tool0"}, "'base' is not below link 'tool0'"),
    "the tip beside the base": (PLAIN, {"tip": "camera", "base": "lower"}, "above it are: upper, base"),
    "a link without a name": ("<robot><link/></robot>", {}, "a <link> has no name"),
    "a joint without a name": (arm('<joint type="fixed"/>'), {}, "a <joint> has no name"),
    "two links of a name": (arm(joint(0), rest='<link name="link1"/>'), {}, "two links are named 'link1'"),
    "two joints of a name": (arm(joint(0), joint(1, name="j0"), links=3), {}, "two joints are named 'j0'"),
    "two parents": (
        arm(joint(0), joint(1, parent="link0", child="link1"), links=2),
        {},
        "link 'link1' has two parents, by the joints 'j0' and 'j1'",
    ),
    "a missing link": (arm(joint(0), joint(1), links=2), {}, "joint 'j1': its child link 'link2' does not exist"),
    "a missing parent": (arm(joint(0, parent="x"), links=2), {}, "its parent link 'x' does not exist"),
    "no parent": (arm('<joint name="j" type="fixed"><child link="link0"/></joint>'), {}, "joint 'j': no <parent>"),
    "no child's name": (
        arm('<joint name="j"><parent link="link0"/><child/></joint>'),
        {},
        "joint 'j': its <child> has no link",
    ),
    "two trees": (arm(joint(0), links=4), {}, "3 links have no parent, expected one: link0, link2, link3"),
    "a cycle": (arm(loop(("link0", "link1"), ("link1", "link0")), links=2), {}, "a cycle of links: link0, link1"),
    "a cycle aside": (
        arm(loop(("link0", "link1"), ("link2", "link3"), ("link3", "link2"))),
        {"tip": "link1"},
        "a cycle of links: link2, link3",
    ),
    "a link its own parent": (arm(loop(("link0", "link0")), links=1), {}, "a cycle of links: link0"),
    "floating": (one("", "floating"), {}, "joint 'j0': type 'floating', expected fixed, revolute"),
    "planar": (one("", "planar"), {}, "type 'planar'"),
    "no type": (one("", ""), {}, "type ''"),
    "a mimic of nobody": (
        arm(joint(0), joint(1, inside=LIMIT + '<mimic joint="j9" multiplier="-1"/>'), links=3),
        {},
        "joint 'j1': follows joint 'j9', which does not exist",
    ),
    "no limit": (one(""), {}, "joint 'j0': no <limit>, which URDF requires of a revolute joint"),
    "a slide without limit": (one("", "prismatic"), {}, "requires of a prismatic joint"),
    "an empty limit": (one('<limit effort="1" velocity="1"/>'), {}, "without lower and upper"),
    "a locked joint": (one('<limit lower="0.2" upper="0.2"/>'), {}, "joint 'j0' (lower = upper = 0.2) cannot move"),
    "locked joints of a CAD program": (
        arm(*[joint(i, inside='<limit lower="0" upper="0" effort="0" velocity="0"/>') for i in range(3)]),
        {},
        "joint 'j0' (lower = upper = 0), 'j1' (lower = upper = 0), 'j2' (lower = upper = 0) cannot move",
    ),
    "crossed limits": (one('<limit lower="1" upper="-1"/>'), {}, "lower limit 1 above upper -1"),
    "crossed by default": (one('<limit lower="1"/>'), {}, "lower limit 1 above upper 0"),
    "NaN limit": (one('<limit lower="nan" upper="1"/>'), {}, "lower limit is 'nan'"),
    "infinite limit": (one('<limit lower="-1" upper="inf"/>'), {}, "upper limit is 'inf'"),
    "a word": (one('<limit lower="-1" upper="far"/>'), {}, "upper limit is 'far', expected a finite number"),
    "Python's number": (one('<limit lower="-1" upper="1_0"/>'), {}, "upper limit is '1_0'"),
    "backwards": (one('<limit lower="-1" upper="1" velocity="-1"/>'), {}, "velocity -1, expected a number ≥ 0"),
    "NaN velocity": (one('<limit lower="-1" upper="1" velocity="NaN"/>'), {}, "velocity is 'NaN'"),
    "no axis": (one('<axis xyz="0 0 0"/>' + LIMIT), {}, "joint 'j0': axis 0 0 0 has no direction"),
    "half an axis": (one('<axis xyz="0 1"/>' + LIMIT), {}, "axis xyz is '0 1', expected three numbers"),
    "an axis without xyz": (one("<axis/>" + LIMIT), {}, "axis xyz is ''"),
    "NaN axis": (one('<axis xyz="0 nan 1"/>' + LIMIT), {}, "axis xyz is 'nan'"),
    "NaN origin": (one('<origin xyz="nan 0 0"/>' + LIMIT), {}, "origin xyz is 'nan'"),
    "infinite rpy": (one('<origin rpy="0 1e999 0"/>' + LIMIT), {}, "origin rpy is '1e999'"),
    "four numbers": (one('<origin xyz="0 0 0 0"/>' + LIMIT), {}, "origin xyz is '0 0 0 0'"),
    "a far origin": (one('<origin xyz="1e300 0 0"/>' + LIMIT), {}, "origin 1e+300 m away"),
}


@pytest.mark.parametrize(("text", "options", "word"), BAD_ARMS.values(), ids=BAD_ARMS.keys())
def test_what_is_no_arm_is_refused_and_says_why(text, options, word):
    with pytest.raises(RobotModelError) as caught:
        Robot.from_urdf(text, **options)
    assert word in str(caught.value)


@pytest.mark.parametrize("options", [{"tip": 3}, {"base": b"base"}, {"name": 5}, {"gravity": "down"}, {"gravity": 1.0}])
def test_options_that_cannot_be_meant_are_refused(options):
    with pytest.raises(OptikError, match=next(iter(options))):
        Robot.from_urdf(PLAIN, **{"tip": "tool0"} | options)


def test_a_folder_and_junk_and_a_flood_are_refused(tmp_path):
    file = tmp_path / "arm.urdf"
    junk = np.random.default_rng(0).bytes(10_000_000)
    for content in (junk, b"<" + junk, b"", b"<a>" * 300_000, b"<robot>" + b"x" * 40_000_000, PLAIN.encode()[:300]):
        file.write_bytes(content)
        with pytest.raises(InvalidInput, match=r"^source: "):
            Robot.from_urdf(file)
    for source in (tmp_path, str(tmp_path)):
        with pytest.raises(InvalidInput, match=r"^source: "):
            Robot.from_urdf(source)
    file.write_bytes(b'<?xml version="1.0" encoding="klingon"?><robot/>')
    with pytest.raises(InvalidInput, match="XML"):
        Robot.from_urdf(file)
    file.write_bytes(b"<robot>" + b"<a>" * 100_000 + b"</a>" * 100_000 + b"</robot>")
    with pytest.raises(RobotModelError, match="no links"):
        Robot.from_urdf(file)


def test_ten_thousand_links_are_read():
    n = 10_000
    joints = [joint(i, "fixed" if i % 1000 else "revolute", LIMIT) for i in range(n)]
    assert Robot.from_urdf(arm(*joints, links=n + 1)).n == 10


@given(st.data())
@settings(max_examples=200)
def test_a_description_gone_wrong_somewhere_is_an_arm_or_our_error(data):
    text = PLAIN
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text)))
        end = min(len(text), start + data.draw(st.integers(0, 30)))
        text = (
            text[:start]
            + data.draw(st.text(max_size=5) | st.sampled_from(['"', "<", "/>", "nan", "&lt;"]))
            + text[end:]
        )
    if not text.lstrip("\ufeff \t\r\n").startswith("<"):
        text = "<" + text
    with contextlib.suppress(InvalidInput, RobotModelError):
        Robot.from_urdf(text, "tool0")


def test_the_written_arm_is_not_the_read_one_with_another_tool():
    robot = optik.load("kr6")
    assert Robot.from_urdf(robot.with_tool(robot.tool @ oracles.trans(z=0.1)).to_urdf()) != Robot.from_urdf(
        robot.to_urdf()
    )
    slower = replace(robot.limits, velocity=1.0)
    assert replace(robot, limits=slower).to_urdf() != robot.to_urdf()


@pytest.mark.parametrize(
    "geometry", ['<box size="1 1e300 1"/>', '<sphere radius="1e300"/>', '<cylinder radius="1" length="1e200"/>',
                 f'<mesh filename="{"a" * 5000}.stl"/>', '<mesh filename="cube.obj" scale="1e300 1 1"/>']
)  # fmt: skip
def test_shapes_without_bound_are_not_read_and_named(tmp_path, geometry):
    (tmp_path / "cube.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    file = tmp_path / "arm.urdf"
    rest = f'<link name="end"><collision><geometry>{geometry}</geometry></collision></link>'
    file.write_text(arm(joint(0), joint(1, child="end"), links=2, rest=rest))
    with pytest.warns(errors.UnreadShapeWarning, match="link 'end'") as caught:
        assert Robot.from_urdf(file, shapes=True).shapes.m == 0
    assert len(str(caught[0].message)) < 2100


def test_limits_that_seem_to_be_degrees_are_named_in_one_warning():
    def limit(size):
        return f'<axis xyz="0 0 1"/><limit lower="-{size!r}" upper="{size!r}" velocity="2"/>'

    joints = [joint(0, inside=limit(170)), joint(1, "prismatic", limit(170)), joint(2, inside=limit(20 * pi))]
    with pytest.warns(DegreesWarning, match=r"joint 'j0' \(170\), 'j2' \(62.8319\); were degrees meant") as caught:
        robot = Robot.from_urdf(arm(*joints))
    assert (len(caught), caught[0].filename) == (1, __file__)
    assert issubclass(DegreesWarning, RobotModelWarning)
    assert robot.limits.upper.tolist() == [170.0, 170.0, 20 * pi]
    Robot.from_urdf(arm(joint(0, inside=limit(62.83)), joint(1, "continuous", limit(170)), links=3))  # neither is


def test_limits_beyond_any_turn_make_a_joint_free():
    """Exporters write 1e16 for a joint without limits."""
    for size in ("1e300", "1e16", "1.1e5"):
        robot = Robot.from_urdf(one(f'<limit lower="-{size}" upper="{size}" velocity="1"/>'))
        assert (robot.limits.lower[0], robot.limits.upper[0]) == (-np.inf, np.inf)
        assert optik.solve_ik(robot, robot.fk([0.3]), [0.0])
    with pytest.warns(DegreesWarning, match="j0"):
        assert Robot.from_urdf(one('<limit lower="-1e5" upper="1e5" velocity="1"/>')).limits.upper[0] == 1e5
    with pytest.raises(OptikError, match="infinity"):
        JointLimits([-1e300], [1e300])


def test_the_text_of_an_error_is_bounded_and_its_end_is_kept():
    with pytest.raises(RobotModelError, match=r"does not exist$") as caught:
        Robot.from_urdf(arm(joint(0, parent="x" * 10**6), links=2))
    assert len(str(caught.value)) <= 2000
    assert caught.value.problem.count("x") >= 10**6
