"""Masses, friction and torque limits of URDF: against Pinocchio's reading, written and read again, and what is left out."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import Robot
from optik.errors import RobotModelError

BODY = '<inertial><mass value="2"/><inertia ixx="0.02" iyy="0.03" izz="0.015"/></inertial>'


def joint(name: str, parent: str, child: str, inside: str = "", kind: str = "revolute", effort: float = 5.0) -> str:
    limit = f'<limit lower="-1" upper="1" effort="{effort}" velocity="1"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<axis xyz="0 1 0"/>{limit}{inside}</joint>'


def arm(first: str = BODY, second: str = "", inside: str = "", effort: float = 5.0) -> str:
    links = f'<link name="base">{BODY}</link><link name="a">{first}</link><link name="b">{second}</link>'
    joints = joint("one", "base", "a", inside, effort=effort) + joint("two", "a", "b", effort=0.0)
    return f'<robot name="arm">{links}{joints}</robot>'


def words(values: Any) -> str:
    return " ".join(map(repr, map(float, values)))


def inertial(rng: np.random.Generator) -> str:
    d = rng.normal(size=(5, 3)) * 0.1
    I = 0.3 * ((d**2).sum() * np.eye(3) - d.T @ d)
    numbers = " ".join(f'i{"xyz"[i]}{"xyz"[k]}="{I[i, k]!r}"' for i in range(3) for k in range(i, 3))
    numbers = numbers.replace("np.float64(", "").replace(")", "")
    place = f'<origin xyz="{words(rng.normal(size=3) * 0.1)}" rpy="{words(rng.normal(size=3))}"/>'
    return f'<inertial>{place}<mass value="{rng.uniform(0.5, 4.0)}"/><inertia {numbers}/></inertial>'


def tree(seed: int) -> str:
    """A chain of six joints, some fixed, with links on its sides, some without masses; no two joints have one effort."""
    rng = np.random.default_rng(seed)
    kinds = [*rng.permutation(["revolute", "prismatic", "fixed", "revolute", "fixed"]), "revolute"]
    links = [(f"l{i}", inertial(rng) if rng.random() < 0.8 else "") for i in range(7)]
    links += [(f"s{i}", inertial(rng)) for i in range(3)]
    ends = [(f"l{i}", f"l{i + 1}", kind) for i, kind in enumerate(kinds)]
    ends += [("l2", "s0", "fixed"), ("l3", "s1", "revolute"), ("s1", "s2", "fixed")]
    text = "".join(f'<link name="{name}">{inside}</link>' for name, inside in links)
    for parent, child, kind in ends:
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
        text += (
            f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{words(rng.normal(size=3) * 0.3)}" rpy="{words(rng.normal(size=3))}"/>'
            f'<axis xyz="{words(axis)}"/><limit lower="-2" upper="2" effort="{rng.integers(2) * len(text)}" velocity="1"/>'
            f'<dynamics damping="{rng.random()}" friction="{rng.random()}"/></joint>'
        )
    return f'<robot name="any">{text}</robot>'


@given(st.integers(0, 2**32 - 1))
def test_what_is_read_and_what_is_written_have_pinocchios_torques(seed: int) -> None:
    import pinocchio as pin

    text, rng = tree(seed), np.random.default_rng(seed)
    whole = pin.buildModelFromXML(text)
    model = pin.buildReducedModel(whole, [whole.getJointId("to_s1")], pin.neutral(whole))
    model.gravity.linear = np.array([0.0, 0.0, -9.80665])
    data = model.createData()
    robot = Robot.from_urdf(text, "l6")
    assert robot.joint_names == tuple(model.names)[1:]
    q, dq, ddq = rng.normal(size=(3, robot.n))
    torques = pin.rnea(model, data, q, dq, ddq) + model.damping * dq + model.friction * np.sign(dq)
    M = np.triu(pin.crba(model, data, q))
    M += np.triu(M, 1).T
    loaded = robot.with_inertia(motor=rng.random(robot.n)).with_payload(1.5, (0.1, 0.0, 0.2))
    for one, other in ((robot, torques), (Robot.from_urdf(robot.to_urdf()), torques)):
        assert np.abs(one.torques(q, dq, ddq) - other).max() <= 1e-12 * np.abs(torques).max()
        assert np.abs(one.mass_matrix(q) - M).max() <= 1e-12 * np.abs(M).max()
        effort = model.upperEffortLimit
        known = np.full(robot.n, np.inf) if one.limits.torque is None else one.limits.torque
        assert (known == np.where(effort > 0.0, effort, np.inf)).all()
    back = Robot.from_urdf(loaded.to_urdf())  # with motors, and the payload as a mass of the tool
    expected = loaded.torques(q, dq, ddq)
    assert np.abs(back.torques(q, dq, ddq) - expected).max() <= 1e-12 * np.abs(expected).max()


@pytest.mark.parametrize("name", ["panda", "puma560", "paper6r"])
def test_our_arms_are_written_with_their_masses(name: str) -> None:
    robot = optik.load(name).with_gravity([0.0, 0.0, -1.0]).with_payload(2.0, (0.0, 0.05, 0.1), np.eye(3) * 0.01)
    back = Robot.from_urdf(robot.to_urdf())
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 20, robot.n))
    expected = robot.torques(q, dq, ddq)
    assert np.abs(back.torques(q, dq, ddq) - expected).max() <= 1e-12 * np.abs(expected).max()
    assert (back.limits.torque == robot.limits.torque).all()
    again = Robot.from_urdf(back.to_urdf())
    assert again.inertia.mass.tolist() == back.inertia.mass.tolist()


def test_a_link_without_masses_has_none_and_a_file_without_masses_has_none_at_all() -> None:
    some = Robot.from_urdf(arm())
    assert some.inertia.mass.tolist() == [2.0, 0.0]  # not the base's, which stands still
    assert some.inertia.source == "URDF 'arm'"
    assert some.limits.torque.tolist() == [5.0, np.inf]
    assert Robot.from_urdf(arm("", "", '<dynamics damping="3"/>')).inertia is None
    assert Robot.from_urdf(arm(effort=0.0)).limits.torque is None
    moved = Robot.from_urdf(arm(inside='<dynamics damping="0.3" friction="0.2" armature="0.1"/>')).inertia
    assert (moved.viscous[0], moved.coulomb[0], moved.motor[0]) == (0.3, 0.2, 0.1)


IMPOSSIBLE: dict[str, tuple[str, str]] = {
    "a negative mass": (arm(BODY.replace('"2"', '"-2"')), "mass of link 'a'"),
    "a mass that is no number": (arm(BODY.replace('"2"', '"two"')), "link 'a': mass is 'two'"),
    "no mass": (arm(BODY.replace('<mass value="2"/>', "")), "link 'a': .*without <mass>"),
    "an inertia without a mass": (arm(BODY.replace('"2"', '"0"')), "inertia of link 'a'"),
    "a moment above the others": (arm(second=BODY.replace("0.03", "0.3")), "inertia of link 'b'"),
    "grams and millimetres": (arm(BODY.replace("0.0", "20000.0")), "inertia of link 'a'.*kg·mm²"),
    "negative damping": (arm(inside='<dynamics damping="-1"/>'), "joint 'one': damping -1"),
}


@pytest.mark.parametrize(("text", "word"), IMPOSSIBLE.values(), ids=IMPOSSIBLE.keys())
def test_impossible_masses_are_left_out_with_one_line_and_the_kinematics_are_read(text: str, word: str) -> None:
    with pytest.warns(UserWarning, match=word) as caught:
        robot = Robot.from_urdf(text)
    assert len(caught) == 1
    assert "\n" not in str(caught[0].message)
    assert caught[0].filename == __file__
    assert robot.inertia is None
    assert robot.limits.torque is not None
    assert (robot.fk([0.1, 0.2]) == Robot.from_urdf(arm()).fk([0.1, 0.2])).all()


def test_a_negative_effort_is_left_out_with_one_line() -> None:
    with pytest.warns(UserWarning, match="joint 'one': effort -5"):
        robot = Robot.from_urdf(arm(effort=-5.0))
    assert robot.limits.torque is None
    assert robot.inertia is not None


def test_a_payload_of_any_mass_is_not_written() -> None:
    with pytest.raises(RobotModelError, match=r"1 to 2 kg.*one mass"):
        optik.load("panda").with_payload((1.0, 2.0)).to_urdf()


def test_a_negligible_inertia_drops_no_masses() -> None:
    """Exporters leave entries of 1e-20 on links without mass, and on one axis of small parts."""
    for second in ('<mass value="0"/><inertia ixx="1e-20"/>', '<mass value="1e-9"/><inertia ixy="1e-20"/>'):
        robot = optik.Robot.from_urdf(arm(second=f"<inertial>{second}</inertial>"))
        assert robot.inertia.mass[0] == 2.0


@pytest.mark.parametrize("effort", ["inf", "Infinity", "+INF"])
def test_an_infinite_effort_is_an_unknown_one_and_the_others_are_kept(effort: str) -> None:
    text = arm().replace('effort="0.0"', f'effort="{effort}"')
    robot = optik.Robot.from_urdf(text)
    assert robot.limits.torque.tolist() == [5.0, np.inf]
