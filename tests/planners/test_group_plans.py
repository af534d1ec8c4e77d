"""Plans of groups: seams on a table, pieces in two hands, one clock; each judged by the members alone and by Pinocchio."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import optik
import planners
from optik import Group, JointLimits, Robot, Scene, se3
from optik.arm.shapes.enclosure import complete_frame
from optik.errors import InvalidInput, InvalidMotion
from planners import (
    Arc,
    Line,
    MotionLimits,
    Part,
    Plan,
    Program,
    certify,
    combine,
    free,
    load_motion,
    make_law,
    plan,
    to_ros,
)
from planners.limits import OpenContainer
from planners.limits.member import MemberValue
from planners.motion.show import show_motion
from planners.trajectory import cut_after
from tests.figures import groups_seams
from tests.planners.chains import draw_seam

TILT, TURN = np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]]), np.pi
RATES = {"velocity": np.full(6, 2.0), "acceleration": np.full(6, 10.0), "jerk": np.full(6, 100.0)}
TORCH = se3.pose(se3.exp_so3([0.0, np.deg2rad(40.0), 0.0]), [0.05, 0.0, 0.3])


def table() -> Robot:
    """A table that tilts about x and turns about z."""
    limits = JointLimits([-1.5, -12.0], [1.5, 12.0], velocity=[1.5, 2.5], acceleration=[3.0, 5.0], jerk=[30.0, 50.0])
    fixed = np.array([se3.pose(p=[0.6, 0.0, 0.15]) @ TILT, se3.inverse(TILT)])
    return Robot("table", fixed, np.zeros(2, bool), se3.pose(p=[0.0, 0.0, 0.05]), limits, ("tilt", "turn"))


def welding() -> Group:
    """An arm with a torch, and the table."""
    return Group(arm=optik.load("ur5e").with_tool(TORCH, add=True).with_limits(**RATES), table=table())


def carrying(bar: float = 0.5) -> Group:
    """Two arms that face each other, with the frame of a bar between their hands as the tool of both."""
    arm, turned = optik.load("ur5e").with_limits(**RATES), se3.pose(se3.exp_so3([0.0, 0.0, np.pi]), [1.5, 0.0, 0.0])
    grasps = (se3.pose(se3.exp_so3([0.0, side * np.pi / 2, 0.0]), [-side * bar / 2, 0.0, 0.0]) for side in (1.0, -1.0))
    left, right = (arm.with_tool(se3.inverse(grasp), add=True) for grasp in grasps)
    return Group(left=left, right=right.with_base(turned))


def lift() -> Line:
    """A line of the bar that also turns it."""
    return Line(se3.pose(p=[0.75, -0.1, 0.3]), se3.pose(se3.exp_so3([0.1, 0.2, -0.3]), [0.78, 0.15, 0.5]))


@pytest.mark.parametrize("seed", range(3))
def test_a_seam_is_followed_on_a_moving_table(seed: int) -> None:
    import pinocchio as pin

    group, seam = welding(), draw_seam(np.random.default_rng([seed, 3]), 0.7)
    found = plan(group, seam, tool="arm", frame="table")
    assert found and found.certificate.path_error.distance < 1e-8
    models = {name: pin.buildModelFromXML(robot.to_urdf()) for name, robot in group.members.items()}
    trees = {name: (model, model.createData(), model.getFrameId("tool")) for name, model in models.items()}
    for t in np.linspace(0.0, found.duration, 40):
        poses = {}
        for name, q in group.split(found.trajectory(t)).items():
            model, data, tool = trees[name]
            pin.framesForwardKinematics(model, data, np.ascontiguousarray(q))
            poses[name] = data.oMf[tool]
        seen = (poses["table"].inverse() * poses["arm"]).homogeneous
        assert se3.error(seen, seam.pose(seam.nearest(seen[None])[0])) == pytest.approx(np.zeros(6), abs=1e-8)
    for name, motion in found.members.items():
        alone = certify(motion.robot, None, motion.trajectory, motion.limits)
        assert motion.certificate.is_valid and alone.is_valid
        for limit in ("velocity", "acceleration", "jerk"):
            joints = [found.chain_plan.robot.joint_names.index(f"{name}/{joint}") for joint in motion.robot.joint_names]
            whole = getattr(found.certificate, limit).ratio[joints]
            assert getattr(alone, limit).ratio == pytest.approx(whole, abs=1e-9)


def test_the_redundancy_of_a_group_shortens_its_motion_and_laws_know_the_members_limits() -> None:
    group, seam = welding(), draw_seam(np.random.default_rng([1, 3]), 0.7)
    usual, faster = (plan(group, one, tool="arm", frame="table") for one in (seam, free(seam, elbow=True)))
    assert usual and faster and faster.duration < 0.95 * usual.duration
    limits = {"path": MotionLimits(tool_speed=0.2)}
    limited = plan(group, seam, tool="arm", frame="table", limits=limits)
    assert limited and limited.certificate.tool_speed.ratio == pytest.approx(1.0, abs=0.01)
    slow = plan(group, seam, tool="arm", frame="table", timing=make_law("constant_speed", speed=0.05))
    assert slow and slow.duration == pytest.approx(seam.end / 0.05, rel=0.2)


def test_a_table_that_stands_still_is_tried_too() -> None:
    group, stood = welding(), list[tuple[planners.Path, dict[str, optik.types.Array], float]]()
    arm, frame = group.members["arm"], group.members["table"]
    for seed in (3, 13):
        seam = draw_seam(np.random.default_rng([seed, 3]), 0.7)
        turned = [se3.inverse(frame.fk([0.0, k * np.pi / 4])) for k in range(8)]
        alone = [one.duration for T in turned if (one := plan(arm.with_base(T), seam))]
        for path in (seam, free(seam, elbow=True)):
            found = plan(group, path, tool="arm", frame="table")
            assert found and found.duration <= 1.003 * min(alone, default=np.inf)
            assert (found.chain_plan.freedom is None) == (path is seam)
            q = group.split(found.trajectory(np.linspace(0.0, found.duration, 50)))
            if (np.ptp(q["table"], axis=0) == 0.0).all():
                stood.append((seam, {name: joints[0] for name, joints in q.items()}, found.duration))
    assert stood
    seam, start, least = stood[0]
    assert plan(group, seam, start, tool="arm", frame="table").duration <= 1.003 * least


@pytest.mark.parametrize("case", [6, 18])
def test_a_table_at_rest_from_which_the_seam_is_out_of_reach_hides_no_better_one(case: int) -> None:
    name, axes = list(groups_seams.ARMS)[case % 4], 2 - (case // 4) % 2
    group = groups_seams.make_group(name, axes)
    seam = draw_seam(np.random.default_rng([case, 58]), groups_seams.ARMS[name][1])
    arm, frame, ends = group.members["arm"], group.members["table"], np.eye(axes)[-1] * np.pi / 4
    alone = [plan(arm.with_base(se3.inverse(frame.fk(k * ends))), seam) for k in range(8)]
    assert any(alone) and not all(alone)
    found = plan(group, seam, tool="arm", frame="table")
    assert found and found.duration <= 1.003 * min(one.duration for one in alone if one)


def test_a_container_is_judged_over_ground_not_in_the_frame_of_the_table() -> None:
    arm = optik.load("ur5e").with_limits(**RATES).with_payload(0.5)
    group = Group(arm=arm, table=table())
    q = np.array([3.0, -1.6, 2.0, -1.97, -1.57, 0.0])
    tool = np.linalg.inv(arm.fk(q)[:3, :3]) @ (0.0, 0.0, 1.0)
    container = OpenContainer(np.deg2rad(2.0), axis=tuple(tool))
    start, goal = {"arm": q, "table": [0.0, 0.0]}, {"arm": np.append(q[0] + 0.5, q[1:]), "table": [1.0, 2.0]}
    limits = {"arm": MotionLimits.of(arm, open_container=container)}
    found = plan(group, goal, start, limits=limits)
    alone = certify(arm, None, found.members["arm"].trajectory, limits["arm"])
    assert (
        found
        and alone.is_valid
        and found.certificate.extra["arm.open_container"].ratio
        == pytest.approx(alone.extra["open_container"].ratio, abs=1e-9)
    )
    assert found.certificate.extra["arm.open_container"].ratio > 0.9
    with pytest.raises(InvalidInput, match="gravity"):
        certify(
            group.chain("table", "arm"), None, found.chain_plan.trajectory, MotionLimits(extra={"open_container": 0.3})
        )


def test_limits_of_one_member_with_two_masses_are_judged_each_by_its_own() -> None:
    arm = optik.load("ur5e").with_limits(**RATES)
    loads = {"light": arm.with_payload(0.5), "heavy": arm.with_payload(4.0)}
    torques = {
        f"{name}.torque": MemberValue(robot, tuple(range(6)), np.full(6, 150.0)) for name, robot in loads.items()
    }
    q = np.deg2rad([0.0, -70.0, 70.0, -90.0, -90.0, 0.0])
    found = plan(arm, q + 0.3, q, limits=MotionLimits.of(arm, extra=torques))
    assert found
    for name, robot in loads.items():
        alone = certify(robot, None, found.trajectory, MotionLimits(torque=150.0))
        assert found.certificate.extra[f"{name}.torque"].ratio == pytest.approx(alone.torque.ratio, abs=1e-9)
    assert np.abs(np.subtract(*(found.certificate.extra[f"{name}.torque"].ratio for name in loads))).max() > 0.01


def test_a_piece_in_two_hands_is_held() -> None:
    group, path = carrying(), lift()
    found = plan(group, path, tool=("left", "right"), scene=Scene())
    assert found and found.held.distance < 1e-8 and found.held.angle < 1e-8
    each = [plan(robot, path) for robot in group.members.values()]
    assert found.duration <= 1.05 * max(one.duration for one in each)
    t = np.linspace(0.0, found.duration, 500)
    hands = group.fk(found.trajectory(t))
    off = np.linalg.norm(hands["left"][:, :3, 3] - hands["right"][:, :3, 3], axis=1)
    assert off.max() <= found.held.distance and found.members["left"].certificate.path_error.distance < 1e-8
    late = group.members["right"].fk(group.split(found.trajectory(np.maximum(t - 1e-3, 0.0)))["right"])
    apart = np.linalg.norm(hands["left"][:, :3, 3] - late[:, :3, 3], axis=1).max()
    assert 0.9 * found.held.distance_per_ms < apart <= found.held.distance_per_ms + found.held.distance
    with pytest.raises(InvalidInput, match="in the world"):
        plan(group, path, tool=("left", "right"), frame="left")


def test_the_torques_of_both_hands_limit_the_motion_for_every_fraction_of_the_mass() -> None:
    usual, group = carrying(), carrying().with_payload(4.0, inertia=0.1 * np.eye(3), fraction=(0.4, 0.6))
    first = plan(group, lift(), tool=("left", "right"))
    q = group.split(first.trajectory(np.linspace(0.0, first.duration, 200)))
    factor = {}
    for name, robot in group.members.items():
        weight = max(
            np.abs(
                robot.with_payload(m, inertia=m / 4.0 * 0.1 * np.eye(3)).gravity_torques(q[name]) / robot.limits.torque
            ).max()
            for m in (1.6, 2.4)
        )
        factor[name] = 0.5 * (weight + float(np.nanmax(first.certificate.extra[f"{name}.torque"].ratio)))
    limits = {
        name: MotionLimits.of(robot, torque=factor[name] * robot.limits.torque) for name, robot in group.members.items()
    }
    found = plan(group, lift(), tool=("left", "right"), limits=limits)
    assert found and found.duration > first.duration
    ratios = [0.0]
    t = np.linspace(0.0, found.duration, 300)
    for m in (1.6, 1.8, 2.0, 2.2, 2.4):
        for name, robot in usual.members.items():
            loaded = robot.with_payload(m, inertia=m / 4.0 * 0.1 * np.eye(3))
            states = [group.split(found.trajectory(t, order))[name] for order in range(3)]
            ratios.append(np.abs(loaded.torques(*states) / limits[name].torque).max())
    assert 0.97 < max(ratios) <= 1.0


def test_a_piece_that_is_too_heavy_names_member_and_joint() -> None:
    group = carrying().with_payload(8.0, fraction=(0.4, 0.6))
    limits = {name: MotionLimits.of(robot, torque=25.0) for name, robot in group.members.items()}
    found = plan(group, lift(), tool=("left", "right"), limits=limits)
    assert not found and found.failure.joint == "left/joint2" and "at any speed" in found.failure.reason


def test_a_bump_of_one_hand_is_within_the_proved_distance() -> None:
    from scipy.interpolate import PPoly

    from planners.certificate.held import prove_held
    from planners.trajectory import Trajectory

    group = carrying()
    found, rng = plan(group, lift(), tool=("left", "right")), np.random.default_rng(5)
    chain, motion = group.chain("left", "right"), found.chain_plan.trajectory
    for size in (1e-6, 1e-3, 0.1):
        c = motion.padded[:, ::8].copy()[:, :3]
        knots = np.array([0.0, 0.1, 0.3, 0.5])
        c[:5] += size * rng.normal(size=c[:5].shape)
        bumpy = Trajectory(PPoly(c, knots))
        held = prove_held(chain, bumpy, np.ones(2))
        poses = chain.fk(
            np.concatenate([bumpy(np.linspace(a + 1e-9, b - 1e-9, 400)) for a, b in itertools.pairwise(knots)])
        )
        most = np.linalg.norm(poses[:, :3, 3], axis=1).max()
        assert most <= held.distance <= 1.06 * most


def facing(turn: float, lift: float) -> list[Plan]:
    """Motions of two arms that face each other and turn through the space between them."""
    arm, base = optik.load("ur5e").with_limits(**RATES), np.array([np.pi, lift, 1.6, -1.9, -1.57, 0.0])
    start, goal = base + np.array([turn, 0, 0, 0, 0, 0]), base - np.array([turn, 0, 0, 0, 0, 0])
    other = arm.with_base(se3.pose(se3.exp_so3([0.0, 0.0, np.pi]), [0.8, 0.0, 0.0]))
    return [plan(one, goal, start, scene=Scene()) for one in (arm, other)]


def test_two_arms_on_one_clock_wait_where_it_helps() -> None:
    each = facing(1.0, -1.9)
    both = combine(*each)
    assert both and both.chain_plan.waits["left"] > 0.3 and both.chain_plan.waits["right"] == 0.0
    assert both.clearances["left and right"].proved
    for name, own in zip(("left", "right"), each, strict=True):
        t, wait = np.linspace(0.0, both.duration, 50), both.chain_plan.waits[name]
        seen = both.group.split(both.trajectory(t))[name]
        assert seen == pytest.approx(own.trajectory(np.clip(t - wait, 0.0, own.duration)), abs=1e-9)
        assert both.members[name].certificate.is_valid
    with pytest.raises(InvalidInput, match=r"plan\.members"):
        both.save("both.json")


def test_motions_that_meet_or_are_not_valid_are_not_combined() -> None:
    first, second = facing(0.6, -1.6)
    both = combine(first, second)
    assert (
        not both
        and both.status == "contact"
        and {name.split("/")[0] for name in both.certificate.clearance.nearest.pair} == {"left", "right"}
    )
    fast = first.with_motion(first.trajectory.stretched(0.5))
    with pytest.raises(InvalidMotion, match="velocity"):
        combine(fast.motion, second)
    moving = replace(first.motion, trajectory=cut_after(first.trajectory, 0.5 * first.duration))
    with pytest.raises(InvalidInput, match="rest"):
        combine(moving, second)


def test_goals_of_members_are_reached_around_each_other() -> None:
    group = Group(
        left=optik.load("ur5e").with_limits(**RATES),
        right=optik.load("ur5e")
        .with_limits(**RATES)
        .with_base(se3.pose(se3.exp_so3([0.0, 0.0, np.pi]), [0.8, 0.0, 0.0])),
    )
    start = {name: np.array([np.pi, -1.9, 1.9, -1.6, -1.57, 0.0]) for name in ("left", "right")}
    pose = group.members["right"].fk(start["right"] + np.array([0.4, 0.1, 0, 0, 0, 0]))
    found = plan(
        group, {"left": start["left"] + np.array([0.3, 0, 0, 0, 0, 0]), "right": pose}, start, scene=Scene(), avoid=True
    )
    assert found and group.fk(found.trajectory(found.duration))["right"] == pytest.approx(pose, abs=1e-6)
    assert found.clearances["left and right"].proved
    with pytest.raises(InvalidInput, match="q_start"):
        plan(group, {"left": start["left"]})


def test_of_many_shapes_the_first_way_that_is_proved_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    arm, turned = optik.load("ur5e").with_limits(**RATES), se3.exp_so3([0.0, 0.0, np.pi])
    group = Group(left=arm, right=arm.with_base(se3.pose(turned, [0.8, 0.0, 0.0])))
    q = np.array([np.pi, -1.6, 1.6, -1.9, -1.57, 0.0])
    start, goal = ({name: q + side * np.eye(6)[0] for name in group.members} for side in (0.6, -0.6))
    best = plan(group, goal, start, scene=Scene(), avoid=True)
    monkeypatch.setattr("planners.choice.ways.MOST_OPTIMISED_PAIRS", 100)
    first = plan(group, goal, start, scene=Scene(), avoid=True)
    assert best and "not optimised" not in best.chain_plan.freedom.outcome and best.chain_plan.search.rounds
    assert first and "not optimised" in first.chain_plan.freedom.outcome and not first.chain_plan.search.rounds
    assert first.clearances["left and right"].proved and first.duration > best.duration
    monkeypatch.setattr("planners.choice.first_paths.MOST_ROUNDINGS", 1)
    pushed = plan(group, goal, start, scene=Scene(), avoid=True)
    assert pushed and pushed.chain_plan.search.rounds


def test_motions_of_groups_are_stored_and_sent(tmp_path: Path) -> None:
    group = welding()
    found = plan(
        group, Arc.about(se3.pose(np.diag([1.0, -1, -1]), [0.1, 0, 0.05]), [0, 0, 0.05], [0, 0, 1.0], 1.0), tool="arm"
    )
    assert found
    found.save(tmp_path / "seam.json")
    read = load_motion(tmp_path / "seam.json")
    assert read.robot == found.chain_plan.robot and read.certificate.is_valid
    assert (read.trajectory.coefficients == found.chain_plan.trajectory.coefficients).all()
    assert read.certificate.extra["arm.torque"].ratio == pytest.approx(found.certificate.extra["arm.torque"].ratio)
    to_ros(found, tmp_path / "weld.yaml", controllers={"arm": "/arm_controller", "table": "/table_controller"})
    each = {
        name: planners.load_trajectory(tmp_path / f"weld.{name}.yaml", robot) for name, robot in group.members.items()
    }
    assert each["arm"].knots.tolist() == each["table"].knots.tolist()
    for t in np.linspace(0.0, found.duration, 20):
        for name, joints in group.split(found.trajectory(t)).items():
            assert each[name](t) == pytest.approx(joints, abs=1e-6)
    with pytest.raises(InvalidInput, match="table and arm"):
        to_ros(found, tmp_path / "weld.yaml", controllers={"torch": "x"})


def test_a_program_in_the_frame_of_the_table_is_planned_and_its_members_are_programs(tmp_path: Path) -> None:
    group, weld = welding(), Arc.about(se3.pose(np.diag([1.0, -1, -1]), [0.1, 0, 0.05]), [0, 0, 0.05], [0, 0, 1.0], 1.0)
    away = Line(end := weld.pose(weld.end), end @ se3.pose(p=[0.0, 0.0, -0.1]))
    start = plan(group, weld, tool="arm").trajectory(0.0)
    found = plan(group, Program([Part(weld), Part(away)]), start, tool="arm", frame="table")
    assert (
        found and found.chain_plan.path.robots[0] == group.chain("table", "arm") and len(found.chain_plan.sections) == 2
    )
    assert all(motion.certificate.is_valid for motion in found.members.values())
    found.save(tmp_path / "program.json")
    assert load_motion(tmp_path / "program.json").certificate.is_valid


def test_arguments_of_groups_are_checked() -> None:
    group, seam = welding(), draw_seam(np.random.default_rng(0), 0.7)
    wrong = {
        "arm or table": {"tool": "torch"}, "other than": {"frame": "world"}, "torch": {"limits": {"torch": MotionLimits()}},
        "tool_speed": {"limits": {"path": MotionLimits(velocity=1.0)}}, "carry": {"tool": ("arm", "arm")},
    }  # fmt: skip
    for word, options in wrong.items():
        with pytest.raises(InvalidInput, match=word):
            plan(group, seam, **options)
    with pytest.raises(InvalidInput, match="Group"):
        plan(group.members["arm"], seam, frame="table")


def capsules_at(robot: Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Links (m,), ends (k, m, 3) each in the world, and radii (m,) of an arm's capsules at configurations."""
    link, a, b, radius = robot.shapes.capsules
    frames = np.concatenate([np.broadcast_to(np.eye(4), (len(q), 1, 4, 4)), robot.frames(q)[:, :-1]], axis=1)[:, link]
    ends = [np.einsum("kmij,mj->kmi", frames[..., :3, :3], x) + frames[..., :3, 3] for x in (a, b)]
    return link, *ends, radius


def around_a_table() -> Group:
    """Three arms that look at the same place."""
    arm, turns = optik.load("ur5e").with_limits(**RATES), 2.0 * np.pi / 3.0 * np.arange(3)
    bases = (se3.pose(se3.exp_so3([0.0, 0.0, a]), [-0.48 * np.cos(a), -0.48 * np.sin(a), 0.0]) for a in turns)
    return Group({name: arm.with_base(base) for name, base in zip("abc", bases, strict=True)})


def test_three_members_reach_their_goals_on_one_clock() -> None:
    group, q = around_a_table(), np.array([np.pi, -1.9, 1.9, -1.6, -1.57, 0.0])
    start, floor = dict.fromkeys("abc", q), Scene(boxes=[(se3.pose(p=[0.0, 0.0, -0.1]), (2.0, 2.0, 0.05))])
    pose = group.members["b"].fk(q + np.array([0.4, 0.1, 0, 0, 0, 0]))
    found = plan(group, {"a": q + np.array([0.5, 0, 0, 0, 0, 0]), "b": pose}, start, scene=floor)
    assert found and group.fk(found.trajectory(found.duration))["b"] == pytest.approx(pose, abs=1e-6)
    assert set(found.clearances) == {"a", "b", "c", "a and b", "a and c", "b and c"}
    assert all(one.proved for one in found.clearances.values())
    assert found.members["c"].trajectory(found.duration) == pytest.approx(q, abs=1e-12)
    for name, motion in found.members.items():
        alone = certify(group.members[name], None, motion.trajectory, motion.limits, scene=floor)
        assert alone.is_valid and motion.certificate.is_valid
        for limit in ("velocity", "acceleration", "jerk"):
            whole = getattr(found.certificate, limit).ratio[group.columns(name)]
            assert getattr(alone, limit).ratio == pytest.approx(whole, abs=1e-9)
        whole = found.certificate.extra[f"{name}.torque"].ratio
        assert alone.torque.ratio == pytest.approx(whole, abs=1e-9)
    with pytest.raises(InvalidInput, match="two members"):
        plan(group, lift(), tool="a")


def test_three_members_that_are_proved_apart_do_not_touch_by_coal() -> None:
    coal = pytest.importorskip("coal")
    group, rng = around_a_table(), np.random.default_rng(5)
    middle, spread = np.array([np.pi, -1.9, 1.9, -1.6, -1.57, 0.0]), np.array([0.6, 0.3, 0.3, 0.3, 0.3, 0.3])

    def place(a: np.ndarray, b: np.ndarray, radius: float) -> tuple[object, object]:
        length = float(np.linalg.norm(b - a))
        z = (b - a) / length
        turn = np.column_stack([*complete_frame(z), z])
        return coal.Capsule(radius, length), coal.Transform3s(turn, 0.5 * (a + b))

    seen = set()
    for k in range(12):
        ends = [{name: middle + spread * rng.normal(size=6) for name in "abc"} for _ in range(2)]
        if k not in (0, 11):  # two of the draws are enough: one whose straight motion is free, and one whose is not
            continue
        found, least, is_free = (
            plan(group, ends[1], ends[0]),
            np.inf,
            bool(plan(group, ends[1], ends[0], scene=Scene())),
        )
        moved = group.split(found.trajectory(np.linspace(0.0, found.duration, int(1e3 * found.duration))))
        arms = [capsules_at(group.members[name], joints) for name, joints in moved.items()]
        for (_, a, b, r), (_, c, d, w) in itertools.combinations(arms, 2):
            for i, j in np.ndindex(len(r), len(w)):
                size = 0.5 * sum(np.linalg.norm(y[0] - x[0]) for x, y in ((a[:, i], b[:, i]), (c[:, j], d[:, j])))
                far = 0.5 * np.linalg.norm(a[:, i] + b[:, i] - c[:, j] - d[:, j], axis=1) - size - r[i] - w[j]
                for t in np.flatnonzero(far < min(least, 0.05)):
                    pair = place(a[t, i], b[t, i], r[i]), place(c[t, j], d[t, j], w[j])
                    distance = coal.distance(*pair[0], *pair[1], coal.DistanceRequest(), coal.DistanceResult())
                    least = min(least, float(distance))
        proved = min(one.own.value for name, one in found.clearances.items() if " and " in name)
        assert proved <= least + 1e-6 and (least > 0.0) == is_free
        seen.add(is_free)
    assert seen == {True, False}


def test_a_plan_is_shown_in_the_world(tmp_path: Path) -> None:
    group, weld = welding(), Arc.about(se3.pose(np.diag([1.0, -1, -1]), [0.1, 0, 0.05]), [0, 0, 0.05], [0, 0, 1.0], 1.0)
    limits = {"table": MotionLimits.of(table(), velocity=[0.5, 1.5])}
    found = plan(group, weld, tool="arm", frame="table", limits=limits)
    found.save(tmp_path / "seam.json")
    for shown in map(show_motion, (found, load_motion(tmp_path / "seam.json"))):
        joints = found.trajectory(shown.planned.t)
        assert shown.robot.joint_names == group.joint_names and shown.planned.q == pytest.approx(joints, abs=1e-9)
        assert shown.robot.fk(shown.planned.q) == pytest.approx(group.fk(joints)["arm"], abs=1e-12)
        assert shown.path == pytest.approx(group.fk(joints)["arm"][:, :3, 3], abs=1e-9)
        assert shown.limits["dq"][1].tolist() == [*RATES["velocity"], 0.5, 1.5]
    both = combine(*facing(1.0, -1.9)).show()
    assert all(word in both.html for word in ("left/joint6", "right/joint6"))
