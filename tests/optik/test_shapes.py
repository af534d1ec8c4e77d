"""Shapes of arms: checks, pairs that are examined, copies, files, payloads, and the robots that come with optik."""

import itertools
import json
import pickle

import numpy as np
import pytest

import optik
from optik import se3
from optik.arm.library import robot_from_toml
from optik.errors import InvalidInput, OptikError, RobotModelError
from tests.oracles.shapes import distances
from tests.seeds import shift_seed

SHAPED = (
    "fr3", "gen3lite", "iiwa14", "panda", "panda_hand", "paper6r", "puma560",
    "ur10e", "ur16e", "ur20", "ur3e", "ur5", "ur5e", "wx200",
)  # fmt: skip
BARE = {"gen3lite": 6}
"""Links without a shape: of gen3lite only the gripper, which is left out, moves with joint 6."""
ROWS = [(0, (0, 0, 0), (0, 0, 0.1), 0.06), (1, (0, 0, 0), 0.1), (3, (0, 0, 0), (0, 0, 0.1), 0.06), (5, (0, 0, 0), 0.05)]


def test_the_four_arrays_of_capsules_are_read_only_and_of_one_layout():
    link, a, b, radius = optik.Shapes(ROWS).capsules
    assert link.tolist() == [0, 1, 3, 5]
    assert a.tolist() == [[0, 0, 0]] * 4
    assert b.tolist() == [[0, 0, 0.1], [0, 0, 0], [0, 0, 0.1], [0, 0, 0]]
    assert radius.tolist() == [0.06, 0.1, 0.06, 0.05]
    assert link.dtype == np.int64
    for x in (link, a, b, radius):
        assert x.flags.c_contiguous
        assert not x.flags.writeable
    assert optik.Shapes((link, a, b, radius)) == optik.Shapes(ROWS)


def test_all_pairs_are_examined_but_neighbours_and_those_with_a_reason():
    shapes = optik.Shapes(ROWS, names=("foot", "waist", "arm", "hand"))
    assert shapes.pairs.tolist() == [[0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]
    assert shapes.left_out == (("foot", "waist", "neighbours"),)
    fewer = shapes.with_apart([("foot", "arm", "never reached"), (1, 5, "by numbers of links")])
    assert fewer.pairs.tolist() == [[0, 3], [1, 2], [2, 3]]
    assert fewer.left_out[1:] == (("foot", "arm", "never reached"), ("waist", "hand", "by numbers of links"))
    pairs = (
        '<disable_collisions link1="arm" link2="foot" reason="Never"/>',
        '<disable_collisions link1="arm" link2="x"/>',
    )
    srdf = f"<robot name='r'>{''.join(pairs)}</robot>"
    assert shapes.with_srdf(srdf).left_out[1:] == (("foot", "arm", "Never"),)
    for bad in ("<a/>", "<robot><disable_collisions link1='a'/></robot>", "<robot", "missing.srdf"):
        with pytest.raises(InvalidInput, match="srdf"):
            shapes.with_srdf(bad)


@pytest.mark.parametrize(
    ("rows", "options", "words"),
    [
        ([], {}, "1 to 4096"), (3, {}, "a list of"), ([(0, (0, 0, 0))], {}, r"\(link, a, b, radius\)"),
        ([(0, (0, 0, 0), 300.0)], {}, "millimetres"), ([(0, (0, 0, 400.0), 0.1)], {}, "millimetres"),
        ([(0, (0, 0, np.nan), 0.1)], {}, "finite"), ([(0, (0, 0, 0), 0.0)], {}, "above 0"),
        ([(-1, (0, 0, 0), 0.1)], {}, "link"), ([(0.5, (0, 0, 0), 0.1)], {}, "link"),
        (ROWS, {"names": ("a",)}, "one for each"),
        (ROWS, {"names": tuple("abcd"), "apart": [("a", "x", "r")]}, "a name of capsules"),
        (ROWS, {"apart": [(0, 1)]}, "apart"), (ROWS, {"excess": -0.1}, "excess"),
        (ROWS, {"excess": [0.1, 0.2]}, "excess"), (ROWS, {"source": 3}, "source"),
    ],
)  # fmt: skip
def test_bad_shapes_are_one_clear_line(rows, options, words):
    with pytest.raises(InvalidInput, match=words) as caught:
        optik.Shapes(rows, **options)
    assert "\n" not in str(caught.value)


def test_an_arm_carries_shapes_and_without_them_is_the_arm_that_it_was():
    bare = optik.load("panda").with_shapes(None)
    assert bare.shapes is None
    assert "shapes" not in bare.to_dict()
    robot = bare.with_shapes(optik.Shapes(ROWS))
    assert robot.shapes.names == ("base", "joint1", "joint3", "joint5")
    assert (robot == bare, robot.fingerprint == bare.fingerprint) == (False, False)
    assert robot.with_shapes(None) == bare
    assert robot.with_shapes(None).fingerprint == bare.fingerprint
    assert pickle.loads(pickle.dumps(robot)) == robot
    again = optik.Robot.from_dict(json.loads(json.dumps(robot.to_dict())))
    assert again == robot
    assert again.shapes == robot.shapes
    with pytest.raises(RobotModelError, match="link 9"):
        bare.with_shapes(optik.Shapes([(9, (0, 0, 0), 0.1)]))
    with pytest.raises(InvalidInput, match="shapes"):
        bare.with_shapes([(0, (0, 0, 0), 0.1)])


def test_a_new_base_moves_the_capsules_of_the_base_only():
    T = se3.from_xyz_rpy((0.0, 0.0, 1.0), (90.0, 0.0, 0.0))
    robot = optik.load("panda").with_shapes(optik.Shapes(ROWS)).with_base(T)
    assert np.abs(robot.shapes.capsules[2][0] - (0.0, -0.1, 1.0)).max() <= 1e-15
    assert robot.shapes.capsules[2][1:].tolist() == [[0, 0, 0], [0, 0, 0.1], [0, 0, 0]]


def test_a_payload_has_a_shape_in_the_tools_frame_that_goes_with_it():
    n = 7
    masses = optik.Inertia(np.ones(n), np.zeros((n, 3)), np.tile(0.1 * np.eye(3), (n, 1, 1)))
    robot = optik.load("panda").with_inertia(masses)
    box = se3.from_xyz_rpy((0.0, 0.0, 0.2), (0.0, 0.0, 0.0)), (0.04, 0.04, 0.1)
    loaded = robot.with_payload(1.0, shapes=[((0, 0, 0.1), 0.05), ((0, 0, 0), (0, 0, 0.1), 0.02), box])
    mine = loaded.shapes.find_capsules("payload")
    link, a, b, radius = (column[mine] for column in loaded.shapes.capsules)
    assert set(link.tolist()) == {n}
    assert np.abs(a[:2] - [(0, 0, 0.207), (0, 0, 0.107)]).max() <= 1e-12  # the flange is 107 mm from joint 7
    corners = np.array(list(itertools.product((-0.02, 0.02), (-0.02, 0.02), (0.257, 0.357))))
    inside = [distances(corners, *c) <= 0.0 for c in zip(a[2:], b[2:], radius[2:], strict=True)]
    assert np.any(inside, axis=0).all()
    assert (loaded.shapes.excess[mine[:2]] == 0.0).all()
    assert (loaded.shapes.excess[mine[2:]] > 0.0).all()
    longer = loaded.with_tool(se3.from_xyz_rpy((0.0, 0.0, 0.1)), add=True)
    assert np.abs(longer.shapes.capsules[1][mine] - a - (0, 0, 0.1)).max() <= 1e-12
    assert loaded.with_payload(None) == robot
    assert loaded.with_payload(2.0).shapes == robot.shapes
    for bad in (3, [], ["x"], [(1, 2)], [((0, 0, 0), -1)], [(np.eye(4), (1, 1, 0))], [((0, 0, 300.0), 0.1)]):
        with pytest.raises(InvalidInput):
            robot.with_payload(1.0, shapes=bad)
    with pytest.raises(InvalidInput, match="with_shapes"):
        robot.with_shapes(None).with_payload(1.0, shapes=[((0, 0, 0), 0.1)])


# ---------------------------------------------------------------- the robots that come with optik
def gaps(robot, q):
    """Distances between all capsules of an arm (m, m), by 40 points on each segment: a few millimetres too large."""
    link, a, b, radius = robot.shapes.capsules
    poses = np.concatenate((np.eye(4)[None], robot.frames(q)))[link]
    ends = [np.einsum("mij,mj->mi", poses[:, :3, :3], x) + poses[:, :3, 3] for x in (a, b)]
    points = ends[0][:, None] + np.linspace(0.0, 1.0, 40)[:, None] * (ends[1] - ends[0])[:, None]
    far = np.array([[distances(p, ends[0][j], ends[1][j], 0.0).min() for j in range(len(link))] for p in points])
    return far - radius - radius[:, None]


@pytest.mark.parametrize("name", SHAPED)
def test_the_links_of_an_arm_hang_together_and_it_has_room_to_move(name):
    robot = optik.load(name)
    shapes = robot.shapes
    assert shapes.source
    links = set(range(robot.n + 1)) - {BARE.get(name)}
    assert set(shapes.capsules[0].tolist()) == links
    rng = np.random.default_rng(shift_seed(5))
    limits = robot.limits
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    free = 0
    for _ in range(12):
        gap = gaps(robot, rng.uniform(lower, upper))
        for i in range(len(links) - 1):  # the capsules of consecutive links meet at their joint
            assert gap[np.ix_(shapes.find_capsules(i), shapes.find_capsules(i + 1))].min() <= 0.01, (name, i)
        free += bool((gap[tuple(shapes.pairs.T)] > 0.0).all())
    assert free >= 4


TABLE = """
convention = "{convention}"
joints = [ {{ a_mm = 100.0, alpha_deg = 90.0, range_deg = [-90.0, 90.0] }}, {{ range_deg = [-90.0, 90.0] }} ]
[shapes]
capsules = [
  {{ link = "base", centre_mm = [0.0, 0.0, 0.0], radius_mm = 50.0 }},
  {{ link = 1, a_mm = [0.0, 0.0, 0.0], b_mm = [0.0, 0.0, 10.0], radius_mm = 50.0, excess_mm = 5.0, name = "motor" }},
  {{ link = "joint2", centre_mm = [0.0, 0.0, 0.0], radius_mm = 50.0 }},
]
apart = [ {{ links = ["base", "joint2"], reason = "never" }} ]
"""


def test_a_capsule_is_stated_in_the_tables_frame(tmp_path):
    file = tmp_path / "arm.toml"
    file.write_text(TABLE.format(convention="dh"), encoding="utf-8")
    robot = robot_from_toml(file)
    shapes = robot.shapes
    assert shapes.names == ("base", "motor", "joint2")
    assert shapes.left_out[-1] == ("base", "joint2", "never")
    assert (np.isnan(shapes.excess).tolist(), shapes.excess[1]) == ([True, False, True], 0.005)
    # The frame of row 1 stands 100 mm and 90° behind joint 1, so its z axis is −y of the joint's frame.
    assert np.abs(shapes.capsules[1][1] - (0.1, 0.0, 0.0)).max() <= 1e-15
    assert np.abs(shapes.capsules[2][1] - (0.1, -0.01, 0.0)).max() <= 1e-15
    file.write_text(TABLE.format(convention="mdh"), encoding="utf-8")
    assert robot_from_toml(file).shapes.capsules[2][1].tolist() == [0.0, 0.0, 0.01]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('link = "base"', 'link = "elbow"', "elbow"), ("link = 1", "link = 3", "link"),
        ("b_mm", "c_mm", "c_mm unknown"), ("b_mm = [0.0, 0.0, 10.0], ", "", "a_mm and b_mm"),
        ("[0.0, 0.0, 10.0]", "[0.0, 10.0]", "b_mm"), ("radius_mm = 50.0", "radius_mm = 0.0", "radius"),
        ('["base", "joint2"]', '["base", "joint9"]', "joint9"), ("capsules =", "balls =", "capsules missing"),
    ],
)  # fmt: skip
def test_a_bad_table_of_shapes_is_named(tmp_path, old, new, words):
    file = tmp_path / "arm.toml"
    file.write_text(TABLE.format(convention="dh").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(OptikError, match=words):
        robot_from_toml(file)


SPHERES = """<robot name="beads"><link name="base"><collision><geometry><sphere radius=".08"/></geometry></collision></link>
<link name="arm"><collision><origin xyz="0 0 .1"/><geometry><sphere radius=".06"/></geometry></collision>
<collision><origin xyz="0 .03 .2" rpy="1 2 3"/><geometry><sphere radius=".05"/></geometry></collision></link>
<link name="tip"/>
<joint name="a" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 .3"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="b" type="fixed"><parent link="arm"/><child link="tip"/></joint></robot>"""


def test_a_sphere_model_of_an_arm_is_read_exactly(tmp_path):
    (tmp_path / "beads.urdf").write_text(SPHERES, encoding="utf-8")
    shapes = optik.Robot.from_urdf(tmp_path / "beads.urdf", shapes=True).shapes
    link, a, b, radius = shapes.capsules
    assert (link.tolist(), shapes.names, radius.tolist()) == ([0, 1, 1], ("base", "arm", "arm"), [0.08, 0.06, 0.05])
    assert (a == b).all() and (shapes.excess == 0.0).all()
    np.testing.assert_allclose(a, [(0.0, 0.0, 0.0), (0.0, 0.0, 0.1), (0.0, 0.03, 0.2)], rtol=0, atol=1e-15)
