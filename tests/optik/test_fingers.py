"""Links beside the chain: enclosed at every value of their joints, held at a value, and cached."""

import json
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import optik
from optik.arm.shapes import cache
from optik.arm.shapes.enclosure import MOST_SWEPT, Capsule, SweepStep, sweep_capsules, turn_points
from optik.errors import EnclosureWarning, InvalidInput
from optik.scene.contact import find_clearances, find_nearest_pairs, find_pairs
from tests.oracles.hands import MeshContact, write_hand
from tests.oracles.shapes import distances

FINGER = """<robot name="claw"><link name="base"><collision><geometry><sphere radius=".05"/></geometry></collision></link>
<link name="upper"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 .1"/><geometry><capsule radius=".02" length=".16"/></geometry></collision></link>
<link name="lower"><collision><origin xyz="0 0 .1"/><geometry><capsule radius=".02" length=".16"/></geometry></collision></link>
<link name="hand"><collision><geometry><sphere radius=".03"/></geometry></collision></link>
<link name="tip"/>
<link name="left"><inertial><origin xyz="0 0 .1"/><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0"
iyz="0"/></inertial>
<collision><origin xyz="0 0 .05"/><geometry><capsule radius=".01" length=".08"/></geometry></collision></link>
<link name="right"><collision><origin xyz="0 0 .05"/><geometry><capsule radius=".01" length=".08"/></geometry></collision>
</link>
<link name="nail"><collision><geometry><sphere radius=".01"/></geometry></collision></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2"/></joint>
<joint name="j2" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 .2"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5"/></joint>
<joint name="j3" type="revolute"><parent link="lower"/><child link="hand"/><origin xyz="0 0 .2"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1"/></joint>
<joint name="tool" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="0 0 .1"/></joint>
<joint name="grip" type="revolute"><parent link="hand"/><child link="left"/><origin xyz=".02 0 .02"/><axis xyz="0 1 0"/>
<limit lower="-.1" upper="1.2"/></joint>
<joint name="follow" type="revolute"><parent link="hand"/><child link="right"/><origin xyz="-.02 0 .02"/><axis xyz="0 1 0"/>
<mimic joint="grip" multiplier="-1" offset=".05"/><limit lower="-1.2" upper=".2"/></joint>
<joint name="slide" type="prismatic"><parent link="left"/><child link="nail"/><origin xyz="0 0 .1"/><axis xyz="1 0 0"/>
<limit lower="0" upper=".02"/></joint></robot>"""


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "optik" / "enclosures"


def claw(**options):
    return optik.Robot.from_urdf(FINGER, "tip", shapes=True, **options)


pytestmark = pytest.mark.filterwarnings("ignore:.*read without")


# ---------------------------------------------------------------- the space of a finger
@pytest.mark.parametrize("seed", range(12))
def test_every_position_of_a_capsule_is_inside_one_that_encloses_its_sweep(seed):
    """Random chains of one to four joints, which follow one or two drivers, against rotations by SciPy."""
    rng = np.random.default_rng(seed)
    capsules = [
        Capsule(*rng.normal(scale=0.05, size=(2, 3)), rng.uniform(0.005, 0.02), 0.0) for _ in range(1 + seed % 2)
    ]
    ranges = np.sort(rng.normal(scale=(0.4, 1.0, 3.0)[seed % 3], size=(1 + seed % 2, 2)), axis=1)
    steps = []
    for _ in range(1 + seed % 4):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.normal(scale=0.05, size=3)
        axis, slides = rng.normal(size=3), bool(rng.integers(2))
        step = SweepStep(
            T, slides, axis / np.linalg.norm(axis), rng.integers(len(ranges)), rng.normal(), 0.1 * rng.normal()
        )
        steps.append(step._replace(factor=0.02 * step.factor) if slides else step)
    found = sweep_capsules(capsules, steps, ranges)
    assert len(found) <= MOST_SWEPT
    for _ in range(200):
        x = np.where(rng.uniform(size=len(ranges)) < 0.3, ranges[:, rng.integers(2)], rng.uniform(*ranges.T))
        for c in capsules:
            points = c.a + np.linspace(0.0, 1.0, 7)[:, None] * (c.b - c.a)
            for step in steps:
                value = step.factor * x[step.driver] + step.offset
                turn = np.eye(3) if step.slides else Rotation.from_rotvec(value * step.axis).as_matrix()
                points = points @ turn.T + (value * step.axis if step.slides else 0.0)
                points = points @ step.T[:3, :3].T + step.T[:3, 3]
            assert min(distances(points, o.a, o.b, o.radius).max() for o in found) <= -c.radius + 1e-12


@pytest.mark.parametrize("span", [0.1, 0.49, 0.51, 2.0, 4.0])
def test_the_hull_of_the_corners_around_an_arc_contains_the_arc(span):
    rng = np.random.default_rng(int(100 * span))
    for _ in range(5):
        frame, low = Rotation.random(random_state=rng), rng.uniform(-3.0, 3.0)
        radius, height = rng.uniform(0.01, 1.0), rng.normal()
        point = frame.apply((radius, 0.0, height))
        corners = frame.inv().apply(turn_points(point[None], frame.apply((0.0, 0.0, 1.0)), low, low + span))
        np.testing.assert_allclose(corners[:, 2], height, rtol=0, atol=1e-12)
        turn = np.linspace(low, low + span, 101)
        arc = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        hull = ConvexHull(corners[:, :2]).equations
        assert (arc @ hull[:, :2].T + hull[:, 2]).max() <= 1e-12
        assert np.linalg.norm(corners[:, :2], axis=1).max() <= 1.04 * radius, "of use"


@pytest.mark.parametrize(("kind", "seed"), [("one revolute", 1), ("two jointed", 2)])
def test_free_and_touching_configurations_are_those_of_the_true_meshes_at_every_value_of_the_fingers(
    tmp_path, kind, seed
):
    hand = write_hand(tmp_path / "arm", [7, seed], kind)
    robot, oracle = optik.Robot.from_urdf(hand.file, "tip", shapes=True), MeshContact(hand)
    q = robot.limits.sample(np.random.default_rng(seed), 60)
    values = np.linspace(*hand.limits, 9)
    free = np.array([not any(oracle.touches(x, value) for value in values) for x in q])
    ours = find_nearest_pairs(robot, optik.Scene(), q)[0] > 0.0
    assert not (ours & ~free).any() and (~free).any()
    assert (ours & free).sum() >= 0.9 * free.sum()
    held = optik.Robot.from_urdf(hand.file, "tip", shapes=True, values={"finger1": hand.limits[1]})
    touching = np.array([oracle.touches(x, hand.limits[1]) for x in q])
    apart = find_nearest_pairs(held, optik.Scene(), q)[0] > 0.0
    assert not (apart & touching).any() and held.shapes.m < robot.shapes.m
    assert np.isfinite(held.shapes.excess).all()
    room = find_nearest_pairs(held, optik.Scene(), q)[0] - find_nearest_pairs(robot, optik.Scene(), q)[0]
    assert np.mean(room >= -0.002) > 0.95, "held fingers take less space"


# ---------------------------------------------------------------- held joints
def test_a_held_joint_holds_those_that_follow_it_and_moves_their_masses():
    value = 0.7
    held = claw(values={"grip": value, "slide": 0.01})
    left, right, nail = (held.shapes.capsules[1][held.shapes.find_capsules(name)] for name in ("left", "right", "nail"))
    ends = {name: held.shapes.capsules[2][held.shapes.find_capsules(name)] for name in ("left", "right")}
    turn, at = Rotation.from_euler("y", value), np.array([0.02, 0.0, 0.02])
    for a, b, angle, x in ((left, ends["left"], value, 0.02), (right, ends["right"], 0.05 - value, -0.02)):
        far = np.array([x, 0.0, 0.02]) + Rotation.from_euler("y", angle).apply([(0.0, 0.0, 0.01), (0.0, 0.0, 0.09)])
        np.testing.assert_allclose(np.vstack([a, b]), far, rtol=0, atol=1e-12)
    np.testing.assert_allclose(nail, [at + turn.apply((0.01, 0.0, 0.1))], rtol=0, atol=1e-12)
    assert held.inertia.mass[2] == 1.0
    com = at + turn.apply((0.0, 0.0, 0.1))
    np.testing.assert_allclose(held.inertia.com[2], com, rtol=0, atol=1e-12)
    free = claw()
    assert free.inertia != held.inertia and np.isnan(free.shapes.excess[free.shapes.find_capsules("left")]).all()
    assert claw(values={}) == free
    assert optik.Robot.from_urdf(FINGER, "tip", values={"grip": value}).inertia == held.inertia


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"gripp": 0.3}, "'gripp'.*|grip, follow, slide"), ({"j2": 0.3}, "'j2', a joint of the chain"),
        ({"tool": 0.0}, "grip, follow, slide"), ({"follow": 0.3}, "'follow', which follows 'grip' .*hold 'grip'"),
        ({"grip": 1.3}, r"grip = 1.3 rad.*|within its limits \[-0.1, 1.2\] rad"), ({"slide": -0.01}, r"\[0, 0.02\] m"),
        ({"grip": np.nan}, "values"), ({"grip": "0.3"}, "values"), (["grip"], "values"), ({3: 0.1}, "values"),
    ],
)  # fmt: skip
def test_a_joint_that_cannot_be_held_is_named(values, words):
    with pytest.raises(InvalidInput, match=words) as caught:
        claw(values=values)
    assert "\n" not in str(caught.value)


def test_a_file_is_loaded_with_held_joints_and_only_a_urdf_has_some(tmp_path):
    (tmp_path / "claw.urdf").write_text(FINGER, encoding="utf-8")
    assert optik.load(f"{tmp_path}/claw.urdf#tip=tip&shapes=yes", values={"grip": 0.3}) == claw(values={"grip": 0.3})
    assert optik.load(f"{tmp_path}/claw.urdf#tip=tip", values={"grip": 0.3}, shapes=True) == claw(values={"grip": 0.3})
    assert optik.load(f"{tmp_path}/claw.urdf#tip=tip", values={"grip": 0.3}, shapes=False).shapes is None
    (tmp_path / "claw.json").write_text(json.dumps(claw().to_dict()), encoding="utf-8")
    for name in ("panda", tmp_path / "claw.json"):
        with pytest.raises(InvalidInput, match="values"):
            optik.load(name, values={"grip": 0.3})


# ---------------------------------------------------------------- wrong enclosures
def test_links_that_touch_in_every_configuration_are_named_with_the_joint_to_hold():
    wide = FINGER.replace('lower="-.1" upper="1.2"', 'lower="-3" upper="3"').replace('length=".08"', 'length=".4"')
    with pytest.warns(EnclosureWarning, match=r"'lower' and 'left'|'upper' and 'left'") as caught:
        robot = optik.Robot.from_urdf(wide, "tip", shapes=True)
    warning = next(w.message for w in caught if isinstance(w.message, EnclosureWarning))
    assert "values={'grip': 0.0" in str(warning)
    assert str(pickle.loads(pickle.dumps(warning))) == str(warning)
    q = robot.limits.sample(np.random.default_rng(3), 100)
    for pair in warning.pairs:
        of = [i for i, names in enumerate(find_pairs(robot, optik.Scene()).names) if set(names) == set(pair)]
        assert len(of) > 0
    assert (find_clearances(robot, optik.Scene(), q)[0][:, 1] <= 0.0).all()
    apart = "".join(f'<disable_collisions link1="{a}" link2="{b}"/>' for a, b in warning.pairs)
    with warnings.catch_warnings():
        warnings.simplefilter("error", EnclosureWarning)
        optik.Robot.from_urdf(wide, "tip", shapes=True, srdf=f"<robot name='r'>{apart}</robot>")
        optik.Robot.from_urdf(wide, "tip", shapes=True, values={"grip": 0.0})
        claw()


# ---------------------------------------------------------------- cache
def boxed() -> str:
    return FINGER.replace('<sphere radius=".05"/>', '<box size=".1 .2 .05"/>')


def test_enclosures_are_computed_once_and_damage_is_noticed(own_cache, monkeypatch):
    first = optik.Robot.from_urdf(boxed(), "tip", shapes=True)
    files = sorted(own_cache.iterdir())
    assert files
    with monkeypatch.context() as patch:
        for name in ("urdf.enclose_body", "enclosure._sweep"):  # nothing is enclosed again
            patch.setattr(f"optik.arm.shapes.{name}", None)
        again = optik.Robot.from_urdf(boxed(), "tip", shapes=True)
    assert again == first and again.shapes.excess.tobytes() == first.shapes.excess.tobytes()
    for file, damaged in zip(
        files, (b"", b"\0" * 96, files[-1].read_bytes()[:-1], b"x" + files[-1].read_bytes()), strict=False
    ):
        file.write_bytes(damaged)
    assert optik.Robot.from_urdf(boxed(), "tip", shapes=True) == first
    assert sorted(own_cache.iterdir()) == files
    other = FINGER.replace('<sphere radius=".05"/>', '<box size=".1 .2 .06"/>')
    assert optik.Robot.from_urdf(other, "tip", shapes=True) != first, "another content is another enclosure"


def test_the_cache_is_bounded_and_a_folder_that_cannot_be_written_is_none(own_cache, tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "MOST_FILES", 10)
    for i in range(25):
        cache.enclose_once(lambda: [Capsule(np.zeros(3), np.ones(3), 0.1)], i)
        assert len(list(own_cache.iterdir())) <= 10
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert claw() == claw()
