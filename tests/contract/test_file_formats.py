"""Contract of the file formats: each one writes motions and reads them back to the last bit, and refuses damage by name."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from optik import JointLimits, Robot, se3
from optik.errors import InvalidInput, NoSolution, UnknownName
from optik.registry import load_method, short_name
from planners import Line, MotionLimits, Trajectory, load_motion, plan, save
from planners.files import formats
from planners.files.base import Format
from planners.motion import Motion, get_motion
from planners.ros.export import YAML_SUFFIXES
from tests import oracles
from tests.outside import outside
from tests.planners.cases import MOVE, START, moved, paper6r
from tests.planners.motions import is_same, planned, readable_or_refused, small, write
from tests.seeds import shift_seed

SUFFIXES = tuple(f".{name}" for name in formats())
each_format = pytest.mark.parametrize("suffix", SUFFIXES)


def test_the_formats_are_found_by_their_names() -> None:
    assert set(formats()) >= {"csv", "json", "npz"}
    assert not set(SUFFIXES) & set(YAML_SUFFIXES), "`planners.save` keeps these suffixes for messages of ROS"
    for name in formats():
        assert issubclass(load_method("planners.files", name, "file format"), Format)


@each_format
@pytest.mark.parametrize("law", ["quintic", "ruckig", "toppra"])
def test_a_plan_comes_back_to_the_last_bit_with_the_same_certificate(law: str, suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"motion{suffix}"
    save(planned(law), file)
    back = load_motion(str(file))
    assert is_same(back, get_motion(planned(law)))
    first, second = planned(law).certificate.to_dict(), back.certify().to_dict()
    # A file has no path parameters of the law: the positions along the path are searched, and equal but for rounding.
    (bind0, off0, covered0), (bind1, off1, covered1) = (
        tuple(proof.pop(key) for key in ("binding", "path_error", "coverage")) for proof in (first, second)
    )
    for key, value in bind0.items():
        same = np.allclose(value, bind1[key], rtol=0.0, atol=1e-6) if key in ("s", "speed") else value == bind1[key]
        assert same, key
    for name in ("distance", "angle"):
        assert off0[name] == pytest.approx(off1[name], rel=0.05, abs=2e-9)
    assert covered0["end"] == pytest.approx(covered1["end"], abs=1e-9)
    assert first == second
    again = tmp_path / f"again{suffix}"
    save(back, again)
    assert is_same(load_motion(again), back)
    assert suffix == ".npz" or again.read_bytes() == file.read_bytes()


number = st.floats(-1e6, 1e6, allow_subnormal=True)
limit = st.one_of(st.none(), st.floats(1e-300, exclude_min=True), st.lists(st.floats(1e-3), min_size=3, max_size=3))
side = st.floats(1e-3, 1e9)
pair = st.tuples(side.map(lambda x: -x), side) | st.tuples(
    st.lists(side.map(lambda x: -x), min_size=3, max_size=3), side
)
text = st.text(st.characters(codec=None), min_size=1, max_size=12)  # lone surrogates, line ends, commas and quotes too


@each_format
@given(data=st.data())
def test_any_motion_comes_back_to_the_last_bit(suffix: str, tmp_path: Path, data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    pieces, degree = data.draw(st.integers(1, 4)), data.draw(st.integers(1, 6))
    knots = np.concatenate([[0.0], np.cumsum(rng.uniform(1e-9, 2.0, pieces))])
    c = np.array(data.draw(st.lists(number, min_size=3 * pieces, max_size=3 * pieces))).reshape(1, pieces, 3)
    c = np.concatenate([c, rng.normal(size=(degree - 1, pieces, 3)) * 10.0 ** rng.integers(-9, 7)])
    free = JointLimits([-np.inf, -1.0, -2.0], [np.inf, 1.0, 2.0], velocity=[np.inf, 1.0, 0.1])
    names = data.draw(st.lists(text, min_size=3, max_size=3, unique=True))
    T = np.array([se3.pose(se3.exp_so3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(4)])
    robot = Robot(data.draw(text), T[:3], [True, False, True], T[3], free, tuple(names), rng.normal(size=3), 'a, "b"\n')
    limits = MotionLimits(
        *(data.draw(one) for one in (limit | pair, limit | pair, limit)),
        tool_speed=data.draw(st.none() | st.floats(1e-9, 1e9)),
    )
    path = Line(oracles.random_pose(rng), oracles.random_pose(rng))
    motion = Motion(
        robot, path, limits, Trajectory(PPoly(c, knots)), data.draw(text), data.draw(st.sampled_from([(), ("jerk",)]))
    )
    file = tmp_path / f"motion{suffix}"
    write(motion, file)
    assert is_same(load_motion(file), motion)


@each_format
@pytest.mark.parametrize(
    "names",
    [("\ud800", 'a,"b"', "# c", "d\r\n# e: 3", "\0", "ä "), ("\r", "a\rb", "c\nd", "e\r\nf", '"', ",")],
    ids=["words", "line ends"],
)
def test_names_that_no_file_expects_come_back(names: tuple[str, ...], suffix: str, tmp_path: Path) -> None:
    robot = Robot("\udfff", small().robot.fixed, small().robot.prismatic, np.eye(4), small().robot.limits, names)
    motion = Motion(robot, small().path, small().limits, small().trajectory, "\ud800 law")
    write(motion, tmp_path / f"motion{suffix}")
    assert is_same(load_motion(tmp_path / f"motion{suffix}"), motion)


@each_format
def test_a_truncated_file_is_refused(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"motion{suffix}"
    write(small(), file)
    whole = file.read_bytes()
    for size in {0, 1, 2, 10, *range(3, len(whole) - 20, len(whole) // 60)}:
        assert readable_or_refused(file, whole[:size]), f"{size} bytes of {len(whole)}"
    for size in range(len(whole) - 20, len(whole)):
        readable_or_refused(file, whole[:size])


@each_format
def test_damaged_bytes_are_refused_or_do_not_matter(suffix: str, tmp_path: Path) -> None:
    file, rng = tmp_path / f"motion{suffix}", np.random.default_rng(shift_seed(8))
    write(small(), file)
    whole = file.read_bytes()
    refused = 0
    for place in rng.integers(0, len(whole), 250):
        damaged = bytearray(whole)
        damaged[place] ^= int(rng.integers(1, 256))
        refused += readable_or_refused(file, bytes(damaged))
    assert refused > 150


@each_format
@pytest.mark.parametrize(
    "junk",
    [
        b"", b"\x00" * 50, b"[" * 100_000, b"\xff\xfe", b"null", b"3", b"{}", b'{"format": 1e999}', b"# a\n",
        b"# a: b\nt\n",
    ],
    ids=["nothing", "zeros", "nesting", "no text", "null", "3", "empty", "infinite", "comment", "no JSON"],
)  # fmt: skip
def test_junk_is_refused(suffix: str, junk: bytes, tmp_path: Path) -> None:
    assert readable_or_refused(tmp_path / f"motion{suffix}", junk)


@each_format
def test_a_plan_that_failed_has_no_motion_to_write(suffix: str, tmp_path: Path) -> None:
    start = paper6r().fk(START)
    failed = plan(paper6r(), Line(start, moved(start, 5.0 * MOVE)), START)
    with pytest.raises(NoSolution) as caught:
        save(failed, tmp_path / f"motion{suffix}")
    assert (caught.value.s, caught.value.reason) == (failed.failure.s, failed.failure.reason)
    assert list(tmp_path.iterdir()) == []


@each_format
def test_a_format_can_be_named_for_a_file_of_any_suffix(suffix: str, tmp_path: Path) -> None:
    named, file = tmp_path / f"motion{suffix}", tmp_path / "motion.part1"
    write(small(), file, format=suffix[1:])
    write(small(), named)
    assert file.read_bytes() == named.read_bytes()
    assert is_same(load_motion(file, format=suffix[1:]), small())
    with pytest.raises(InvalidInput, match="file: expected a name that ends in"):
        load_motion(file)
    other = next(name for name in formats() if name != suffix[1:])
    with pytest.raises(InvalidInput, match=r"motion\.part1"):
        load_motion(file, format=other)
    planned().save(file, format=suffix[1:])
    assert is_same(load_motion(file, format=suffix[1:]), planned().motion)


def test_a_format_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    for use in (lambda name: write(small(), tmp_path / "a", format=name), lambda name: load_motion("a", format=name)):
        with pytest.raises(UnknownName, match="json"):
            use("jsom")
        for wrong in ("base", "_ros", "_reading"):
            with pytest.raises(UnknownName):
                use(wrong)
        with pytest.raises(InvalidInput, match="file format"):
            use(3)
    with pytest.raises(InvalidInput, match="file: expected a path"):
        load_motion(3, format="json")


@pytest.mark.parametrize("file", outside("planners.files"), ids=short_name)
def test_a_format_from_outside_keeps_the_contract(file: str, tmp_path: Path) -> None:
    write(small(), tmp_path / "motion", format=file)
    assert is_same(load_motion(tmp_path / "motion", format=file), small())
    made, content = load_method("planners.files", file)(), (tmp_path / "motion").read_bytes()
    for damaged in (b"", content[:-5], content[:40] + b"0" + content[41:]):
        with pytest.raises(InvalidInput):
            made.from_bytes(damaged)
