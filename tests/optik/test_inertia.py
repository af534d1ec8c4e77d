"""Masses, payloads and torque limits as data: checked, equal by content, copied, and read from and written to files."""

import json
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import optik
from optik import Inertia, JointLimits, Robot
from optik.arm.inertia import Payload, join_bodies, transform_body
from optik.arm.library import robot_from_toml
from optik.errors import InvalidInput, OptikError, RobotModelError
from tests import oracles

BOX = np.diag([0.02, 0.03, 0.015])
seeds = st.integers(0, 2**32 - 1)


def inertia(n: int = 2, **changes: Any) -> Inertia:
    values: dict[str, Any] = {"mass": np.full(n, 2.0), "com": np.zeros((n, 3)), "tensor": np.tile(BOX, (n, 1, 1))}
    return Inertia(**(values | changes))


def second(tensor: Any) -> Any:
    """Tensors of two links, the second as given."""
    return np.array([BOX, tensor])


# ---------------------------------------------------------------- bodies
@given(seeds, st.integers(1, 4))
def test_bodies_are_joined_as_their_points_are(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    clouds = [(rng.uniform(0.1, 1.0, 6), rng.normal(size=(6, 3))) for _ in range(count)]

    def body(mass: Any, points: Any) -> Any:
        com = mass @ points / mass.sum()
        d = points - com
        tensor = np.einsum("k,kij->ij", mass, (d**2).sum(1)[:, None, None] * np.eye(3) - d[:, :, None] * d[:, None, :])
        return mass.sum(), com, tensor

    whole = body(np.concatenate([m for m, _ in clouds]), np.concatenate([p for _, p in clouds]))
    nothing = (0.0, np.ones(3), np.zeros((3, 3)))
    for one, other in zip(join_bodies([nothing, *(body(*cloud) for cloud in clouds)]), whole, strict=True):
        assert np.abs(one - other).max() < 1e-13
    T = oracles.pose(*rng.normal(size=(2, 3)))
    moved = body(clouds[0][0], clouds[0][1] @ T[:3, :3].T + T[:3, 3])
    for one, other in zip(transform_body(body(*clouds[0]), T), moved, strict=True):
        assert np.abs(one - other).max() < 1e-13


# ---------------------------------------------------------------- what is refused
BAD: dict[str, tuple[dict[str, Any], str]] = {
    "a negative mass": ({"mass": [2.0, -1.0]}, "mass of link 2: .*≥ 0"),
    "a mass that is NaN": ({"mass": [np.nan, 1.0]}, "mass of link 1: .*nan"),
    "an infinite mass": ({"mass": [np.inf, 1.0]}, "mass of link 1"),
    "a mass in grams": ({"mass": [2.0, 20000.0]}, "mass of link 2: .*grams"),
    "a mass of 0 with an inertia": ({"mass": [2.0, 0.0]}, "inertia of link 2: .*mass of 0"),
    "a place in millimetres": (
        {"com": [[0.0] * 3, [0.0, -120.0, 3.0]]},
        "centre of mass of link 2: .*millimetres.*120 m",
    ),
    "a place that is NaN": ({"com": [[np.nan] * 3, [0.0] * 3]}, "centre of mass of link 1: .*finite"),
    "an inertia in kg·mm²": ({"tensor": second(BOX * 1e6)}, "inertia of link 2: .*kg·mm².*radius of gyration of 122"),
    "an infinite inertia": ({"tensor": second(np.full((3, 3), np.inf))}, "inertia of link 2: .*finite"),
    "a negative moment": ({"tensor": second(np.diag([0.02, -0.01, 0.02]))}, "inertia of link 2: .*moments -0.01"),
    "products that are too large": (
        {"tensor": second([[0.02, 0.05, 0.0], [0.05, 0.02, 0.0], [0.0, 0.0, 0.02]])},
        "inertia of link 2: .*moments -0.03",
    ),
    "a moment above the two others": (
        {"tensor": second(np.diag([0.01, 0.01, 0.03]))},
        "inertia of link 2: .*moments 0.01, 0.01 and 0.03",
    ),
    "an asymmetric tensor": (
        {"tensor": second([[0.02, 1e-3, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.015]])},
        "inertia of link 2: .*xy = yx",
    ),
    "masses in rows": ({"mass": [[2.0, 1.0]]}, r"inertia\.mass: .*\(n,\)"),
    "no masses": ({"mass": []}, r"inertia\.mass"),
    "one place too few": ({"com": [[0.0] * 3]}, r"inertia\.com: .*\(2, 3\).*\(1, 3\)"),
    "moments only": ({"tensor": [[1.0, 1.0, 1.0]] * 2}, r"inertia\.tensor: .*\(2, 3, 3\)"),
    "a tensor of words": ({"tensor": "heavy"}, r"inertia\.tensor"),
    "a negative motor": ({"motor": -0.1}, r"inertia\.motor: .*≥ 0"),
    "friction that is NaN": ({"viscous": [0.1, np.nan]}, r"inertia\.viscous"),
    "friction of three joints": ({"coulomb": [0.1] * 3}, r"inertia\.coulomb: .*2 of them"),
    "a source that is none": ({"source": 3}, r"inertia\.source"),
}
BAD_PAYLOADS: dict[str, tuple[tuple[Any, ...], str]] = {
    "a negative mass": ((-1.0,), r"payload\.mass: .*-1"),
    "NaN": ((np.nan,), r"payload\.mass: .*nan"),
    "an infinite mass": ((np.inf,), r"payload\.mass: .*inf"),
    "a word": (("3 kg",), r"payload\.mass"),
    "three masses": (((1.0, 2.0, 3.0),), r"payload\.mass: .*lightest, heaviest"),
    "an interval the wrong way round": (((3.0, 1.0),), r"payload\.mass: .*3 to 1 kg"),
    "an interval from below 0": (((-1.0, 1.0),), r"payload\.mass: .*-1"),
    "a place in millimetres": ((3.0, (0.0, 0.0, 80.0)), "centre of mass of payload: .*millimetres.*80 m"),
    "a place in the plane": ((3.0, (0.0, 0.1)), r"payload\.com: .*\(3,\)"),
    "an inertia in kg·mm²": ((3.0, (0, 0, 0), np.eye(3) * 1e4), "inertia of payload: .*kg·mm²"),
    "an impossible inertia": (
        (3.0, (0, 0, 0), np.diag([1.0, 0.1, 0.1])),
        "inertia of payload: .*moments 0.1, 0.1 and 1",
    ),
    "moments only": ((3.0, (0, 0, 0), [0.1, 0.1, 0.1]), r"payload\.inertia: .*\(3, 3\)"),
}


@pytest.mark.parametrize(("changes", "word"), BAD.values(), ids=BAD.keys())
def test_masses_that_cannot_be_are_refused_in_one_line_that_names_the_link(changes: dict[str, Any], word: str) -> None:
    with pytest.raises(InvalidInput, match=word) as caught:
        inertia(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("payload", "word"), BAD_PAYLOADS.values(), ids=BAD_PAYLOADS.keys())
def test_a_payload_that_cannot_be_is_refused_in_one_line(payload: Any, word: str) -> None:
    with pytest.raises(InvalidInput, match=word) as caught:
        optik.load("panda").with_payload(*payload)
    assert "\n" not in str(caught.value)


def test_rounded_and_measured_figures_are_no_impossible_bodies() -> None:
    plate = np.diag([0.333, 0.333, 0.667])  # a plate's moments, of which the third is the sum of the others
    inertia(tensor=second(plate))
    inertia(tensor=second(np.diag([0.066, 0.086, 0.0125])))  # as measured on a Puma
    rod = np.array([[0.02, 1e-9, 0.0], [2e-9, 0.02, 0.0], [0.0, 0.0, -1e-9]])
    kept = inertia(tensor=second(rod)).tensor[1]
    assert (kept == kept.T).all()
    assert inertia(mass=[2.0, 0.0], tensor=second(np.zeros((3, 3)))).mass[1] == 0.0


MISUSE: dict[str, tuple[Any, str]] = {
    "a payload on unknown masses": (lambda r: optik.load("kr6").with_payload(2.0), "'kr6'.*2 kg.*unknown"),
    "friction of unknown masses": (lambda r: optik.load("kr6").with_inertia(motor=1.0), "inertia: .*'kr6'"),
    "masses of another arm": (lambda r: r.with_inertia(inertia()), "7 joints but masses of 2 links"),
    "masses that are none": (lambda r: r.with_inertia(3.0), "inertia: "),
    "a field that does not exist": (lambda r: r.with_inertia(damping=3.0), "inertia: .*got damping"),
    "negative gravity": (lambda r: r.with_gravity(magnitude=-9.8), "gravity_magnitude"),
    "gravity without a direction": (lambda r: r.with_gravity([0.0, 0.0, 0.0]), "no|not a direction"),
    "a torque limit of 0": (lambda r: r.with_limits(torque=0.0), "torque: .*above 0"),
    "a torque rate of three joints": (lambda r: r.with_limits(torque_rate=[1.0] * 3), "torque_rate"),
    "a payload that is none": (lambda r: replace(r, payload=3.0), "payload: "),
    "frames of another arm": (lambda r: r.inertia.transform(np.eye(4)), "poses"),
    "loads of unknown masses": (lambda r: optik.load("kr6").loads, "robot: .*'kr6'"),
}


@pytest.mark.parametrize(("use", "word"), MISUSE.values(), ids=MISUSE.keys())
def test_misuse_is_refused_by_name(use: Any, word: str) -> None:
    with pytest.raises((InvalidInput, RobotModelError), match=word) as caught:
        use(optik.load("panda"))
    assert "\n" not in str(caught.value)


# ---------------------------------------------------------------- content and copies
def test_a_payload_replaces_the_one_before_and_none_removes_it() -> None:
    robot = optik.load("panda")
    loaded = robot.with_payload(3.0, (0.0, 0.0, 0.1))
    assert loaded.payload == Payload(3.0, np.array([0.0, 0.0, 0.1]))
    assert loaded.with_payload(2.0) == robot.with_payload(2.0) != loaded
    assert loaded.with_payload(None) == loaded.with_payload(0) == loaded.with_payload((0, 0)) == robot
    assert robot.with_payload((2, 2)) == robot.with_payload(2.0)
    assert loaded.with_tool(np.eye(4)).payload == loaded.payload
    assert robot.payload is None


def test_a_payload_of_any_mass_is_two_loads() -> None:
    robot = optik.load("panda").with_payload((1.0, 4.0), (0.0, 0.1, 0.0), BOX)
    assert robot.payload.mass == (1.0, 4.0)
    light, heavy = robot.loads
    for load, mass in ((light, 1.0), (heavy, 4.0)):
        one = robot.with_payload(mass, (0.0, 0.1, 0.0), BOX * mass / 4.0).loads
        assert len(one) == 1
        for part, expected in zip(load.bodies, one[0].bodies, strict=True):
            assert np.abs(part - expected).max() < 1e-15
            assert not part.flags.writeable
    assert robot.loads is robot.loads
    empty = optik.load("panda").with_payload((0.0, 4.0)).loads[0].bodies
    for part, expected in zip(empty, optik.load("panda").loads[0].bodies, strict=True):
        assert (part == expected).all()


def test_masses_are_of_the_content_and_what_is_unknown_leaves_the_fingerprint_as_it_was() -> None:
    assert optik.load("kr6").fingerprint == "98b80423bbbde5da"
    robot = optik.load("panda")
    bare = replace(robot, inertia=None, shapes=None, limits=robot.limits.replace(torque=None, torque_rate=None))
    assert bare.fingerprint == "c1aa0f9604181606"
    other = [
        bare, robot.with_limits(torque=80.0), robot.with_limits(torque_rate=None), robot.with_inertia(motor=0.1),
        robot.with_inertia(mass=robot.inertia.mass * 1.01), robot.with_gravity(magnitude=9.81), robot.with_payload(1.0),
        robot.with_payload(2.0), robot.with_payload((1.0, 2.0)), robot,
    ]  # fmt: skip
    assert len({r.fingerprint for r in other}) == len(set(other)) == len(other)
    assert robot.with_inertia(source="elsewhere") == robot
    assert robot.with_inertia(robot.inertia) == robot.with_inertia() == robot.with_gravity() == robot


ROBOTS = [
    optik.load("panda").with_payload(3.0, (0.0, 0.0, 0.1), BOX),
    optik.load("puma560").with_payload((0.0, 2.0)).with_gravity(magnitude=1.62),
    optik.load("ur5e").with_limits(torque=[150.0, np.inf, 150.0, 28.0, 28.0, 28.0], torque_rate=1e3),
]


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_masses_come_back_to_the_last_bit(robot: Robot) -> None:
    data = json.loads(json.dumps(robot.to_dict(), allow_nan=False))
    for back in (Robot.from_dict(data), pickle.loads(pickle.dumps(robot))):
        assert back == robot
        assert back.fingerprint == robot.fingerprint
        assert back.inertia.source == robot.inertia.source
        assert back.payload == robot.payload
        assert back.gravity_magnitude == robot.gravity_magnitude
        assert not back.inertia.mass.flags.writeable


def test_data_from_before_there_were_masses_is_read() -> None:
    data = optik.load("kr6").to_dict()
    assert not {"inertia", "payload", "gravity_magnitude"} & set(data)
    assert not {"torque", "torque_rate"} & set(data["limits"])
    back = Robot.from_dict(data)
    assert (back.inertia, back.payload, back.limits.torque) == (None, None, None)
    assert back.gravity_magnitude == 9.80665


WRONG: dict[str, tuple[Any, str]] = {
    "a mass too few": (lambda d: d["inertia"]["mass"].pop(), r"robot\.inertia\.mass"),
    "a key too few": (lambda d: d["inertia"].pop("motor"), "motor missing"),
    "a key too many": (lambda d: d["inertia"].update(colour="red"), "colour unknown"),
    "a negative mass": (lambda d: d["inertia"]["mass"].__setitem__(0, -1.0), "mass of link 1"),
    "no payload": (lambda d: d.update(payload=None), r"robot\.payload"),
    "a payload of three masses": (lambda d: d["payload"].update(mass=[1.0, 2.0, 3.0]), r"robot\.payload\.mass"),
    "gravity in words": (lambda d: d.update(gravity_magnitude="strong"), r"robot\.gravity_magnitude"),
    "a torque of 0": (lambda d: d["limits"].update(torque=[0.0] * 7), "torque"),
}


@pytest.mark.parametrize(("damage", "word"), WRONG.values(), ids=WRONG.keys())
def test_data_that_holds_no_masses_is_refused_by_name(damage: Any, word: str) -> None:
    data = json.loads(json.dumps(ROBOTS[0].to_dict()))
    damage(data)
    with pytest.raises(OptikError, match=word):
        Robot.from_dict(data)


# ---------------------------------------------------------------- tables
FILE = """
convention = "{convention}"
gravity_magnitude = 9.81
joints = [
  {{ a_mm = 300.0, alpha_deg = 90.0, d_mm = 100.0, range_deg = [-90.0, 90.0] }},
  {{ type = "prismatic", a_mm = 200.0, range_mm = [0.0, 100.0] }},
]
[dynamic_limits]
torque = [40.0, 500.0]
torque_rate = 1000.0
[inertia]
source = "weighed"
[[inertia.links]]
mass_kg = 4.0
com_mm = [-100.0, 10.0, 20.0]
inertia = [0.02, 0.03, 0.04, 0.001, 0.002, 0.003]
motor = 0.5
viscous = 0.6
coulomb = 0.7
[[inertia.links]]
mass_kg = 1.0
"""


def test_a_table_states_masses_in_its_own_frames(tmp_path: Any) -> None:
    for convention, alpha in (("dh", np.pi / 2), ("mdh", 0.0)):
        file = tmp_path / f"{convention}.toml"
        file.write_text(FILE.format(convention=convention), encoding="utf-8")
        robot = robot_from_toml(file)
        # the table's frame, seen from the joint's: (a, alpha) behind it in a standard table, the same in a modified one
        T = oracles.pose((alpha, 0.0, 0.0), (0.3 if alpha else 0.0, 0.0, 0.0))
        tensor = np.array([[0.02, 0.001, 0.002], [0.001, 0.03, 0.003], [0.002, 0.003, 0.04]])
        assert np.abs(robot.inertia.com[0] - (T @ [-0.1, 0.01, 0.02, 1.0])[:3]).max() < 1e-15
        assert np.abs(robot.inertia.tensor[0] - T[:3, :3] @ tensor @ T[:3, :3].T).max() < 1e-16
        assert robot.inertia.mass.tolist() == [4.0, 1.0]
        assert robot.inertia.motor.tolist() == [0.5, 0.0]
        assert (robot.inertia.viscous[0], robot.inertia.coulomb[0], robot.inertia.source) == (0.6, 0.7, "weighed")
        assert (robot.inertia.tensor[1] == 0.0).all()
        assert robot.limits.torque.tolist() == [40.0, 500.0]
        assert robot.limits.torque_rate.tolist() == [1000.0, 1000.0]
        assert robot.gravity_magnitude == 9.81
        given = Robot.from_dh if alpha else Robot.from_mdh
        rows = [{"a": 0.3, "alpha": np.pi / 2, "d": 0.1}, {"a": 0.2, "prismatic": True}]
        weights = Inertia([4.0, 1.0], [[-0.1, 0.01, 0.02], [0.0] * 3], [tensor, np.zeros((3, 3))])
        built = given(rows, JointLimits([-1, 0], [1, 0.1]), inertia=weights, gravity_magnitude=9.81)
        q = np.array([0.3, 0.05])
        assert np.abs(built.gravity_torques(q) - robot.gravity_torques(q)).max() < 1e-13


BAD_FILES: dict[str, tuple[str, str, str]] = {
    "a link too few": ("[[inertia.links]]\nmass_kg = 1.0", "", r"inertia\.links: .*2 rows.*1 rows"),
    "no links": ("[[inertia.links]]", "[[inertia.rows]]", "inertia: .*links missing; rows unknown"),
    "an unknown key": ("motor", "rotor", r"inertia\.links\[0\].*rotor"),
    "a negative mass": ("mass_kg = 1.0", "mass_kg = -1.0", r"inertia\.links\[1\]\.mass_kg"),
    "three moments": (", 0.001, 0.002, 0.003]", "]", r"inertia\.links\[0\]\.inertia: .*6"),
    "an impossible inertia": ("0.02, 0.03, 0.04", "0.02, 0.03, 0.4", "inertia of link 1"),
    "metres for millimetres": ("-100.0, 10.0", "-100000.0, 10.0", "centre of mass of link 1"),
    "a source that is none": ('source = "weighed"', "source = 3", r"inertia\.source"),
    "negative friction": ("coulomb = 0.7", "coulomb = -0.7", r"inertia\.links\[0\]\.coulomb"),
    "a torque of 0": ("[40.0, 500.0]", "[0.0, 500.0]", r"dynamic_limits\.torque"),
    "negative gravity": ("= 9.81", "= -9.81", "gravity_magnitude"),
}


@pytest.mark.parametrize(("before", "after", "word"), BAD_FILES.values(), ids=BAD_FILES.keys())
def test_a_table_of_no_masses_is_refused_in_one_line(before: str, after: str, word: str, tmp_path: Any) -> None:
    text, file = FILE.format(convention="dh"), tmp_path / "mine.toml"
    assert before in text
    file.write_text(text.replace(before, after), encoding="utf-8")
    with pytest.raises(InvalidInput, match=word) as caught:
        robot_from_toml(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", optik.robots())
def test_masses_and_torque_limits_of_our_arms_have_a_source_and_hold_them_up(name: str) -> None:
    robot = optik.load(name)
    if robot.inertia is None:
        assert robot.limits.torque is None
        return
    assert robot.inertia.source
    assert robot.limits.torque is not None
    q = robot.limits.sample(np.random.default_rng(0), 300)
    assert (np.abs(robot.gravity_torques(q)) < 0.7 * robot.limits.torque).all()
