"""What a page plots of a motion: accelerations, torques, limits, distances and their pairs; and the arm in another page."""

import base64
import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import optik
from optik.arm.robot import Robot
from optik.scene import Scene
from optik.scene.contact import find_contact
from optik.types import Array
from optik.view.page import describe_show, embed_arm, list_plots, make_page
from optik.view.show import Show
from planners.cell.drives import make_drive
from planners.cell.show import show_execution, show_outcome, thin_execution
from planners.limits import MotionLimits
from planners.motion.show import plot_limits, sample_track, show_motion
from tests.oracles.torques import Torques
from tests.planners import contacts
from tests.planners.contacts import COAL_ERROR, Oracle
from tests.planners.motions import planned
from tests.planners.test_view_page import EVIL, data_of, numbers, task


def show(robot: Robot, scene: Scene | None = None, seed: int = 1, **options: Any) -> Show:
    track = sample_track(contacts.drawn_motion(np.random.default_rng(seed), 1))
    return Show(robot, "motion", track, robot.fk(track.q)[:, :3, 3], scene=scene, **options)


def data_of_show(given: Show) -> Any:
    return data_of(make_page(given))


def values(packed: Any) -> Array:
    """Rows of 16-bit integers, each column in its own unit."""
    rows = np.frombuffer(base64.b64decode(packed["values"]), "<i2").reshape(-1, len(packed["scale"]))
    return rows * np.array(packed["scale"])


def pairs(data: Any, name: str) -> list[list[Any]]:
    """The pair of each kind at every instant."""
    t = numbers(data[name]["t"])
    found = []
    for changes in data[name]["nearest"]:
        begins = np.array([k for k, _ in changes])
        at = np.searchsorted(begins, np.arange(t.size), side="right") - 1
        found.append([data["clearance"]["pairs"][changes[k][1]] for k in at])
    return found


@pytest.mark.parametrize("seed", range(2))
def test_distances_are_those_of_coal_and_pairs_are_the_nearest(seed: int) -> None:
    robot, scene = contacts.panda(), replace(contacts.drawn(np.random.default_rng(seed)), margin=0.02)
    shown = show(robot, scene, seed)
    data, q = data_of_show(shown), shown.planned.q
    assert data["clearance"]["kinds"] == ["to the scene", "between links"]
    assert data["clearance"]["least"] == [0.02, 0.0]
    got, rounding = values(data["planned"]["clearance"]), np.array(data["planned"]["clearance"]["scale"])
    near = Oracle(robot, scene).near(q, np.inf, np.inf)
    for column, wanted, step in zip(got.T, near, rounding, strict=True):
        apart = wanted > 0.0
        assert np.abs(column - wanted)[apart].max(initial=0.0) <= step + COAL_ERROR
        assert (column[~apart] <= step + COAL_ERROR).all()
    assert (np.array(near) > 0.0).any()
    rooms, of_pairs = got - data["clearance"]["least"], pairs(data, "planned")
    objects = {"boxes": 0, "rounds": len(scene.boxes)}
    objects["planes"] = objects["rounds"] + len(scene.spheres) + len(scene.capsules)
    objects["cylinders"] = objects["planes"] + len(scene.planes)
    objects["meshes"] = objects["cylinders"] + len(scene.cylinders)
    for k in range(0, len(q), 7):
        pair, contact = of_pairs[int(rooms[k].argmin())][k], find_contact(robot, scene, q[k])
        assert tuple(pair["names"]) == contact.pair
        assert pair["names"][0] == robot.shapes.names[pair["capsule"]]
        own, number = pair["kind"] == "own", pair["object"]
        name = robot.shapes.names[number] if own else scene.names[objects[pair["kind"]] + number]
        assert pair["names"][1] == name


def test_the_pair_of_an_object_that_is_not_drawn_has_no_number() -> None:
    robot = contacts.panda()
    spheres = [((0.02 * k % 3.0 - 1.5, 3.0, 4e-4 * k), 0.001) for k in range(2500)] + [((0.35, 0.0, 0.9), 0.02)]
    shown = replace(show(robot, Scene(spheres=spheres)), path=np.array([[0.0, 3.0, 0.0], [0.0, 3.0, 0.1]]))
    near, _ = pairs(data_of_show(shown), "planned")
    assert {pair["object"] for pair in near if pair["names"][1] == "sphere2501"} == {None}
    assert any(pair["names"][1] == "sphere2501" for pair in near)


@pytest.mark.parametrize("mass", [None, 2.0, (0.5, 4.0)], ids=["bare", "payload", "interval"])
def test_torques_are_those_of_the_load_that_needs_more(mass: Any) -> None:
    robot = optik.load("panda")
    if mass is not None:
        robot = robot.with_payload(mass, (0.0, 0.02, 0.1))
    shown = show(robot, limits=plot_limits(MotionLimits.of(robot), robot.n))
    data, track = data_of_show(shown), shown.planned
    assert track.ddq is not None and robot.inertia is not None
    each = []
    for load in robot.loads:
        by = Torques(robot.fixed, robot.prismatic, load)
        rigid = [by.torque(*row) for row in zip(track.q, track.dq, track.ddq, strict=True)]
        each.append(np.array(rigid) + load.coulomb * np.sign(track.dq))
    wanted = np.where(np.abs(each[0]) > np.abs(each[-1]), each[0], each[-1])
    step = np.array(data["planned"]["torque"]["scale"])
    assert (np.abs(values(data["planned"]["torque"]) - wanted).max(axis=0) <= step + 1e-9).all()
    acceleration = values(data["planned"]["ddq"])
    assert (np.abs(acceleration - track.ddq).max(axis=0) <= np.array(data["planned"]["ddq"]["scale"])).all()
    if mass is not None:
        assert data["payload"]["com"] == [0.0, 0.02, 0.1]
        assert ("4 kg" if mass == (0.5, 4.0) else "2 kg") in data["payload"]["words"]


def test_limits_are_those_of_robot_and_motion() -> None:
    robot = optik.load("panda")
    limits = MotionLimits.of(robot, velocity=(-1.0, 2.0), acceleration=None, torque=[50.0] * 6 + [np.inf])
    data = data_of_show(show(robot, limits=plot_limits(limits, robot.n)))
    assert data["limits"]["q"] == [robot.limits.lower.tolist(), robot.limits.upper.tolist()]
    assert data["limits"]["dq"] == [[-1.0] * 7, [2.0] * 7]
    assert data["limits"]["ddq"] == [[None] * 7, [None] * 7]
    assert data["limits"]["torque"] == [[-50.0] * 6 + [None], [50.0] * 6 + [None]]
    assert set(data_of_show(show(robot))["limits"]) == {"q"}


def test_what_a_motion_does_not_have_is_absent() -> None:
    whole = show(optik.load("panda"), Scene(planes=[((0.0, 0.0, -0.1), (0.0, 0.0, 1.0))]))
    path = replace(whole, planned=whole.planned._replace(ddq=None, jerk=None))
    massless = replace(whole, robot=replace(whole.robot, inertia=None))
    for given, names in (
        (whole, ["q", "dq", "ddq", "jerk", "torque", "clearance"]),
        (path, ["q", "dq", "clearance"]),
        (massless, ["q", "dq", "ddq", "jerk", "clearance"]),
        (replace(whole, scene=None), ["q", "dq", "ddq", "jerk", "torque"]),
        (replace(whole, robot=whole.robot.with_shapes(None), scene=None), ["q", "dq", "ddq", "jerk", "torque"]),
    ):
        data, _ = describe_show(given)
        assert [name for name, _, _ in list_plots(given.robot, data)] == names
        assert make_page(given).count('class="plot"') == len(names)
        assert (data["clearance"] is None) == ("clearance" not in names)


def test_executions_have_measured_torques_and_tasks_join_accelerations() -> None:
    done = make_drive("mujoco", planned().robot).execute(planned())
    shown = show_execution(done)
    assert shown.limits["dq"][1].tolist() == planned().limits.velocity.tolist()
    assert shown.executed is not None and shown.executed.torque is not None and done.torque is not None
    np.testing.assert_array_equal(shown.executed.torque[-1], done.torque[-1])
    track = show_motion(planned()).planned
    np.testing.assert_array_equal(track.ddq, planned().trajectory(track.t, 2))
    joined = show_outcome(task())
    assert joined.planned.ddq.shape == joined.planned.q.shape
    assert joined.executed is not None and joined.executed.torque is None
    torque = np.full_like(done.q, 2.0)
    torque[5] = np.nan
    thinned, _ = thin_execution(done.t, done.q, done.dq, torque)
    assert thinned is not None and thinned.torque is None


# ---------------------------------------------------------------- the arm in another page
def test_another_page_gets_one_script_and_the_data_of_its_motions() -> None:
    robot, motions = planned().robot, {name: sample_track(planned(name).trajectory) for name in ("ruckig", "toppra")}
    arm = embed_arm(robot, motions, robot.fk(motions["ruckig"].q)[:, :3, 3])
    data = json.loads(arm.data)
    assert list(data["motions"]) == ["ruckig", "toppra"]
    for name, track in motions.items():
        np.testing.assert_array_equal(numbers(data["motions"][name]["q"]).reshape(-1, 6), track.q)
    assert embed_arm(robot, {EVIL: motions["ruckig"]}, np.zeros((0, 3))).script == arm.script
    for text in (arm.script, arm.data, embed_arm(robot, {EVIL: motions["ruckig"]}, np.zeros((0, 3))).data):
        assert "</" not in text
    assert re.findall(r"https?://|url\(|@import|\bsrc=|fetch\(|import\(", arm.script) == []
