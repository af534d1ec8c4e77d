"""Groups: chains through two members are those of Pinocchio's trees, with all pairs of links and the objects of the world."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import optik
from optik import Group, JointLimits, Robot, Scene, se3
from optik.arm.shapes import Shapes
from optik.errors import InvalidInput, UnknownName
from optik.scene.contact import find_clearances
from optik.scene.distance import segment_segment
from optik.scene.world import chain_in_scene

PAIRS = [
    ("panda", "ur5e"),
    ("panda", "panda"),
    ("irb910sc", "ur10e"),
    ("ur5e", "irb910sc"),
    ("fr3", "iiwa14"),
    ("wx200", "kr6"),
]


def placed(name: str, rng: np.random.Generator) -> Robot:
    """An arm anywhere in the world, with a tool."""
    base, tool = (se3.pose(se3.exp_so3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(2))
    return optik.load(name).with_base(base).with_tool(tool)


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_a_chain_is_the_second_tool_in_the_frame_of_the_first(first: str, second: str) -> None:
    import pinocchio as pin

    rng = np.random.default_rng([7, *first.encode()])
    group = Group(a=placed(first, rng), b=placed(second, rng))
    chain, trees = group.chain("a", "b"), {}
    for name, robot in group.members.items():
        model = pin.buildModelFromXML(
            robot.with_limits(lower=np.full(robot.n, -3.0), upper=np.full(robot.n, 3.0)).to_urdf()
        )
        trees[name] = model, model.createData(), model.getFrameId("tool")
    for q in group.limits.sample(rng, 20):
        poses = {}
        for name, (model, data, tool) in trees.items():
            pin.framesForwardKinematics(model, data, group.split(q)[name])
            poses[name] = data.oMf[tool]
        both = (poses["a"].inverse() * poses["b"]).homogeneous
        assert chain.fk(q[group.order("a", "b")]) == pytest.approx(both, abs=1e-12)
    assert chain.limits.contains(group.limits.sample(rng, 20)[:, group.order("a", "b")]).all()
    assert Robot.from_dict(chain.to_dict()) == chain and chain.gravity_magnitude == 0.0


def members(gap: float = 0.7) -> Group:
    """Two arms that face each other."""
    turned = se3.pose(se3.exp_so3([0.0, 0.0, np.pi]), [gap, 0.0, 0.0])
    return Group(left=optik.load("ur5e"), right=optik.load("panda").with_base(turned))


def around() -> Scene:
    """An object of each kind."""
    rng, z = np.random.default_rng(3), np.array([0.0, 0.0, 1.0])
    near = np.array([0.3, 0.5, 0.4])
    return Scene(
        boxes=[(se3.pose(se3.exp_so3([0.3, 0.2, 0.1]), near), (0.3, 0.1, 0.2)), (se3.pose(p=[0, 0, -30]), (90.0, 90.0, 59.0))],
        spheres=[(near * (1, -1, 1), 0.1)], capsules=[(near, near + 0.3, 0.05)], planes=[(-0.6 * z, z)],
        cylinders=[(near * (1, -1.5, 0), near * (1, -1.5, 2), 0.08)], meshes=[near + rng.uniform(-0.2, 0.2, (12, 3))],
        clouds=[(near + rng.uniform(-0.1, 0.1, (300, 3)), 0.01)], margin=0.01,
    )  # fmt: skip


def test_rooms_of_a_chain_are_those_of_its_members_in_the_world() -> None:
    group, scene, rng = members(), around(), np.random.default_rng(1)
    q = group.limits.sample(rng, 120)
    rooms = find_clearances(chain_in_scene(group, "left", "right", scene), Scene(), q[:, group.order("left", "right")])[
        0
    ][:, 1]
    alone, ends = np.full(len(q), np.inf), []
    for name, robot in group.members.items():
        joints = group.split(q)[name]
        scene_room, own = find_clearances(robot, scene, joints)[0].T
        alone = np.minimum(alone, np.minimum(scene_room - scene.margin, own))
        link, a, b, radius = robot.shapes.capsules
        frames = np.concatenate([np.broadcast_to(np.eye(4), (len(q), 1, 4, 4)), robot.frames(joints)[:, :-1]], axis=1)[
            :, link
        ]
        ends.append(
            [np.einsum("kmij,mj->kmi", frames[..., :3, :3], x) + frames[..., :3, 3] for x in (a, b)] + [link, radius]
        )
    for k in range(len(q)):
        for i, j in np.ndindex(len(ends[0][2]), len(ends[1][2])):
            if ends[0][2][i] or ends[1][2][j]:  # two bases stand still
                parts = [tuple(x[k, m]) for x, m in zip((*ends[0][:2], *ends[1][:2]), (i, i, j, j), strict=True)]
                alone[k] = min(alone[k], segment_segment(*parts)[0] - ends[0][3][i] - ends[1][3][j])
    free = alone > 0.0
    assert 10 < free.sum() < 110 and ((rooms > 0.0) == free).all()
    assert (rooms[free] <= alone[free] + 1e-9).all() and rooms[free] == pytest.approx(alone[free], abs=3e-3)


@pytest.mark.parametrize("tool", ["a", "b", "c"])
def test_all_members_are_one_robot_in_the_world(tool: str) -> None:
    rng = np.random.default_rng(4)
    group = Group(a=placed("panda", rng), b=placed("irb910sc", rng), c=placed("ur5e", rng))
    robot, q = group.as_robot(tool), group.limits.sample(rng, 30)
    assert robot.joint_names == group.joint_names and Robot.from_dict(robot.to_dict()) == robot
    assert robot.fk(q) == pytest.approx(group.fk(q)[tool], abs=1e-12) and robot.limits.contains(q).all()
    with pytest.raises(InvalidInput, match="a or b or c"):
        group.as_robot("d")


def test_rooms_of_one_robot_in_the_world_are_those_of_the_chain() -> None:
    group, scene, rng = members(), around(), np.random.default_rng(1)
    q = group.limits.sample(rng, 120)
    chain = chain_in_scene(group, "left", "right", scene)
    rooms = find_clearances(chain, Scene(), q[:, group.order("left", "right")])[0][:, 1]
    for tool in group.members:
        robot = group.as_robot(tool)
        to_scene, own = find_clearances(robot, scene, q)[0].T
        assert ((np.minimum(to_scene - scene.margin, own) > 0.0) == (rooms > 0.0)).all()
        pairs = [{frozenset((s.names[i], s.names[j])) for i, j in s.pairs}
                 for s in (robot.shapes, group.chain("left", "right").shapes)]  # fmt: skip
        assert pairs[0] == pairs[1]


def test_neighbours_are_links_of_one_mechanism() -> None:
    group = members()
    names = group.chain("left", "right").shapes.names
    pairs = {frozenset((names[i], names[j])) for i, j in group.chain("left", "right").shapes.pairs}
    for one, other in (("left/base", "right/joint1"), ("left/joint1", "right/base"), ("left/joint1", "right/joint1")):
        assert any({one, other} <= {name.split(" ")[0] for name in pair} for pair in pairs)
    own = {
        frozenset((f"left/{a}", f"left/{b}"))
        for a, b in ((s.names[i], s.names[j]) for s in [group.members["left"].shapes] for i, j in s.pairs)
    }
    assert own <= pairs
    with pytest.raises(InvalidInput, match="mechanism"):
        Shapes([(0, (0, 0, 0), 0.1), (1, (0, 0, 1), 0.1)], mechanism=(0,))


def test_a_body_that_carries_both_arms_is_one_body() -> None:
    def arm(side: float, radius: float = 0.25) -> Robot:
        robot = optik.load("ur5e").with_base(se3.pose(p=[0.0, 0.3 * side, 0.0]))
        return robot.with_shapes(robot.shapes.with_part("torso", 0, [((0, 0, -0.5), (0, 0, 0.3), radius)]))

    def pairs(group: Group) -> set[frozenset[str]]:
        names = [name.split(" ")[0] for name in group.chain("left", "right").shapes.names]
        return {frozenset((names[i], names[j])) for i, j in group.chain("left", "right").shapes.pairs}

    found = pairs(Group(left=arm(1.0), right=arm(-1.0)))
    assert frozenset(("left/joint3", "left/torso")) in found and frozenset(("right/joint3", "right/torso")) in found
    assert frozenset(("left/joint3", "right/base")) in found and frozenset(("left/joint3", "right/joint3")) in found
    assert not any({"left/torso", "right/torso"} & pair and len({name[0] for name in pair}) > 1 for pair in found)
    other = pairs(Group(left=arm(1.0), right=arm(-1.0, 0.2)))
    assert frozenset(("left/joint3", "right/torso")) in other and frozenset(("right/joint1", "left/torso")) in other


def test_allowed_pairs_name_links_of_members() -> None:
    group = members()
    scene = Scene(
        boxes=[(np.eye(4), (0.1, 0.1, 0.1))], names=["box"], allow=[("left/joint2", "box"), ("right/joint1", "box")]
    )
    chain = chain_in_scene(group, "left", "right", scene)
    pairs = {frozenset((chain.shapes.names[i], chain.shapes.names[j])) for i, j in chain.shapes.pairs}
    assert frozenset(("left/joint3", "box")) in pairs and frozenset(("left/joint2", "box")) not in pairs
    with pytest.raises(UnknownName, match="left/joint9"):
        chain_in_scene(group, "left", "right", Scene(boxes=scene.boxes, names=["box"], allow=[("left/joint9", "box")]))


def test_joints_are_those_of_the_members_in_their_order() -> None:
    group = members()
    q = {"left": np.arange(6.0), "right": np.arange(7.0)}
    assert group.stack(q).tolist() == [*range(6), *range(7)] and group.joint_names[6] == "right/joint1"
    assert group.stack(q)[group.order("left", "right")].tolist() == [5, 4, 3, 2, 1, 0, *range(7)]
    assert group.fk(group.stack(q))["right"] == pytest.approx(group.members["right"].fk(q["right"]), abs=0)
    assert group.chain("world", "left") is group.members["left"]
    for call, word in ((lambda: group.chain("left", "left"), "frame"), (lambda: group.columns("arm"), "left or right"),
                       (lambda: group.stack({"left": q["left"]}), "right"), (lambda: Group(a=group.members["left"]), "two"),
                       (lambda: Group(world=group.members["left"], b=group.members["left"]), "world")):  # fmt: skip
        with pytest.raises(InvalidInput, match=word):
            call()


def test_a_group_is_stored(tmp_path: Path) -> None:
    group = members().with_payload(2.0, fraction=(0.3, 0.8))
    assert pickle.loads(pickle.dumps(group)) == Group.from_dict(group.to_dict()) == group
    assert group.members["right"].payload.masses == pytest.approx((0.4, 1.4))
    optik.load("ur5e").to_urdf(tmp_path / "arm.urdf")
    (tmp_path / "cell.toml").write_text(
        '[members.arm]\nrobot = "./arm.urdf"\nbase = { xyz_mm = [0.0, 0.0, 400.0] }\ntool = { rpy_deg = [0.0, 90.0, 0.0] }\n'
        '[members.table]\nrobot = "ur5e"\n'
    )
    read = Group.load(tmp_path / "cell.toml")
    assert read.members["arm"].fk(np.zeros(6))[2, 3] == pytest.approx(
        0.4 + optik.load("ur5e").fk(np.zeros(6))[2, 3], abs=1e-9
    )
    assert "arm: Robot" in str(read) and "table" in read._repr_html_()
    (tmp_path / "cell.toml").write_text("[members.arm]\nrobot = 3\n")
    with pytest.raises(InvalidInput, match=r"members\.arm\.robot"):
        Group.load(tmp_path / "cell.toml")


def test_an_arm_on_a_slide_is_one_robot() -> None:
    ends = JointLimits([-1.0], [1.0], velocity=[1.0], acceleration=[3.0])
    sphere = Shapes([(1, (0.0, 0.0, 0.0), 0.1)])
    rail = Robot(
        "rail",
        se3.pose(p=[0, 0, 0.2])[None],
        np.array([True]),
        se3.pose(p=[0.1, 0, 0]),
        ends,
        ("slide",),
        shapes=sphere,
    )
    arm = optik.load("ur5e")
    both, rng = rail.with_arm(arm), np.random.default_rng(2)
    for q in both.limits.sample(rng, 10):
        assert both.fk(q) == pytest.approx(rail.fk(q[:1]) @ arm.fk(q[1:]), abs=1e-12)
        tools = both.frames(q)[1:-1]
        assert tools == pytest.approx(rail.fk(q[:1]) @ arm.frames(q[1:])[:-1], abs=1e-12)
    assert (
        both.joint_names == ("slide", *arm.joint_names) and both.shapes.m == arm.shapes.m + 1 and both.inertia is None
    )
    heavy = rail.with_inertia(optik.Inertia([5.0], [[0, 0, 0]], [np.eye(3)])).with_arm(arm)
    q = heavy.limits.sample(rng, 1)[0]
    assert heavy.gravity_torques(q)[1:] == pytest.approx(arm.gravity_torques(q[1:]), abs=1e-9)
    assert arm.with_arm(arm).joint_names[6] == "ur5e_2/joint1"
