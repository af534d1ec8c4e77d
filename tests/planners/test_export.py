"""Motions in files: written and read back to the last bit, certified the same, and every damage named."""

from __future__ import annotations

import csv
import io
import json
import pickle
import tracemalloc
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

import optik
from optik import JointLimits, Robot, se3
from optik.errors import InvalidInput, NoSolution, OptikError, OutputError
from optik.files import parsed
from planners import Line, MotionLimits, Plan, Trajectory, plan
from planners.files import motion_file
from planners.files.motion_file import load_motion, save
from planners.limits import ALL_LIMITS
from planners.motion import Motion, motion_of
from tests import oracles
from tests.planners import cases
from tests.planners.cases import MOVE, START, default_line, moved, paper6r

SUFFIXES = (".npz", ".json", ".csv")
each_format = pytest.mark.parametrize("suffix", SUFFIXES)


@cache
def planned(law: str = "ruckig") -> Plan:
    return plan(paper6r(), default_line(), START, timing=law)


@cache
def small() -> Motion:
    """Two pieces near the default start."""
    base = cases.random_trajectory(np.random.default_rng(4), pieces=2, n=6, smooth=2)
    c = 0.02 * base.coefficients
    c[5] += START
    return Motion(paper6r(), default_line(), MotionLimits(2.0, jerk=[9.0] * 6), Trajectory(PPoly(c, base.knots)))


def same_bits(a: Any, b: Any) -> bool:
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    return a.shape == b.shape and a.tobytes() == b.tobytes()


def is_same(a: Motion, b: Motion) -> bool:
    """Whether nothing of two motions differs, to the last bit."""
    limits = all(
        (getattr(a.limits, f) is None) == (getattr(b.limits, f) is None)
        and (getattr(a.limits, f) is None or same_bits(getattr(a.limits, f), getattr(b.limits, f)))
        for f in ALL_LIMITS
    )
    return (
        limits
        and a.robot == b.robot
        and a.robot.source == b.robot.source
        and (a.law, a.keeps, a.tolerance) == (b.law, b.keeps, b.tolerance)
        and same_bits(a.trajectory.knots, b.trajectory.knots)
        and same_bits(a.trajectory.coefficients, b.trajectory.coefficients)
        and type(a.path) is type(b.path)
        and a.path.to_dict() == b.path.to_dict()
        and same_bits(a.path.end, b.path.end)
    )


# ---------------------------------------------------------------- there and back


@each_format
@pytest.mark.parametrize("law", ["quintic", "ruckig", "toppra"])
def test_a_plan_comes_back_to_the_last_bit_with_the_same_certificate(law: str, suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"motion{suffix}"
    save(planned(law), file)
    back = load_motion(str(file))
    assert is_same(back, motion_of(planned(law)))
    assert back.certify().to_dict() == planned(law).certificate.to_dict()
    again = tmp_path / f"again{suffix}"
    save(back, again)
    assert is_same(load_motion(again), back)
    assert suffix == ".npz" or again.read_bytes() == file.read_bytes()


number = st.floats(-1e300, 1e300, allow_subnormal=True)
limit = st.one_of(st.none(), st.floats(1e-300, exclude_min=True), st.lists(st.floats(1e-3), min_size=3, max_size=3))
text = st.text(st.characters(codec=None), min_size=1, max_size=12)  # lone surrogates, line ends, commas and quotes too


@each_format
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_motion_comes_back_to_the_last_bit(suffix: str, tmp_path: Path, data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    pieces, degree = data.draw(st.integers(1, 4)), data.draw(st.integers(1, 6))
    knots = np.concatenate([[0.0], np.cumsum(rng.uniform(1e-9, 2.0, pieces))])
    c = np.array(data.draw(st.lists(number, min_size=3 * pieces, max_size=3 * pieces))).reshape(1, pieces, 3)
    c = np.concatenate([c, rng.normal(size=(degree - 1, pieces, 3)) * 10.0 ** rng.integers(-9, 9)])
    if suffix == ".csv":
        c = np.clip(c, -1e60, 1e60)  # its table of q, q̇, q̈ must not overflow
    free = JointLimits([-np.inf, -1.0, -2.0], [np.inf, 1.0, 2.0], velocity=[np.inf, 1.0, 0.1])
    names = data.draw(st.lists(text, min_size=3, max_size=3, unique=True))
    T = np.array([se3.pose(se3.exp_so3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(4)])
    robot = Robot(data.draw(text), T[:3], [True, False, True], T[3], free, tuple(names), rng.normal(size=3), 'a, "b"\n')
    limits = MotionLimits(*(data.draw(limit) for _ in range(3)), tool_speed=data.draw(st.none() | st.floats(1e-9, 1e9)))
    path = Line(oracles.random_pose(rng), oracles.random_pose(rng))
    motion = Motion(
        robot, path, limits, Trajectory(PPoly(c, knots)), data.draw(text), data.draw(st.sampled_from([(), ("jerk",)]))
    )
    file = tmp_path / f"motion{suffix}"
    save(motion, file)
    assert is_same(load_motion(file), motion)


@each_format
def test_names_that_no_file_expects_come_back(suffix: str, tmp_path: Path) -> None:
    names = ("\ud800", 'a,"b"', "# c", "d\r\n# e: 3", "\0", "ä ")
    robot = Robot("\udfff", small().robot.fixed, small().robot.prismatic, np.eye(4), small().robot.limits, names)
    motion = Motion(robot, small().path, small().limits, small().trajectory, "\ud800 law")
    save(motion, tmp_path / f"motion{suffix}")
    assert is_same(load_motion(tmp_path / f"motion{suffix}"), motion)


def test_a_csv_is_a_table_for_other_programs(tmp_path: Path) -> None:
    motion = motion_of(planned())
    save(motion, tmp_path / "motion.csv")
    table = pl.read_csv(tmp_path / "motion.csv", comment_prefix="#")
    kinds = [f"{kind}_joint{i + 1}" for kind in ("q", "dq", "ddq") for i in range(6)]
    assert table.columns == ["t", *kinds]
    t = motion.trajectory.knots
    expected = np.hstack([t[:, None], *(motion.trajectory(t, order) for order in range(3))])
    np.testing.assert_allclose(table.to_numpy(), expected, rtol=1e-15)


def test_a_json_is_strict_json_and_an_npz_holds_plain_arrays(tmp_path: Path) -> None:
    motion = motion_of(planned())
    save(motion, tmp_path / "motion.json")
    data = json.loads((tmp_path / "motion.json").read_text(), parse_constant=pytest.fail)
    assert data["format"] == "optik-motion/1"
    assert same_bits(data["coefficients"], motion.trajectory.coefficients)
    assert Robot.from_dict(data["robot"]) == motion.robot
    save(motion, tmp_path / "motion.NPZ")
    with np.load(tmp_path / "motion.NPZ", allow_pickle=False) as archive:
        assert same_bits(archive["knots"], motion.trajectory.knots)
        assert same_bits(archive["coefficients"], motion.trajectory.coefficients)
        assert json.loads(str(archive["header"]))["robot"] == data["robot"]


# ---------------------------------------------------------------- damage


def content(file: Path) -> dict[str, Any]:
    """Keys and values of a file, without the digest, so that a change is seen for itself."""
    if file.suffix == ".json":
        data = json.loads(file.read_text())
    elif file.suffix == ".csv":
        lines = [line[2:].split(": ", 1) for line in file.read_text().splitlines() if line.startswith("# ")]
        data = {key: json.loads(value) for key, value in lines}
    else:
        with np.load(file) as archive:
            data = json.loads(str(archive["header"]))
            data |= {k: archive[k].tolist() for k in ("knots", "coefficients")}
    assert len(data.pop("sha256")) == 64
    return dict(data)


def rewrite(file: Path, data: dict[str, Any]) -> None:
    """Write what may be no motion."""
    if file.suffix == ".json":
        file.write_text(json.dumps(data))
    elif file.suffix == ".csv":
        table = [line for line in file.read_text().splitlines() if not line.startswith("# ")]
        file.write_text("\n".join([*(f"# {k}: {json.dumps(v)}" for k, v in data.items()), *table]))
    else:
        arrays = {k: np.array(data[k]) for k in ("knots", "coefficients") if k in data}
        header = {k: v for k, v in data.items() if k not in arrays}
        np.savez(file, header=np.array(json.dumps(header)), **arrays)


def set_to(*keys: Any, value: Any) -> Callable[[dict[str, Any]], None]:
    """Change of one entry."""

    def change(data: Any) -> None:
        for key in keys[:-1]:
            data = data[key]
        data[keys[-1]] = value

    return change


NAN, INF = float("nan"), float("inf")
KEYS = ("format", "robot", "path", "limits", "law", "keeps", "knots", "coefficients")
WRONG: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    **{f"no {key}": (lambda d, key=key: d.pop(key), key) for key in KEYS},
    "a key too many": (set_to("colour", value=1), "colour unknown"),
    "another format": (set_to("format", value="optik-plan/1"), "expected 'optik-motion/1'; got 'optik-plan/1'"),
    "a later format": (set_to("format", value="optik-motion/2"), "optik-motion/2"),
    "no robot": (set_to("robot", value=None), "robot"),
    "a robot without a tool": (lambda d: d["robot"].pop("tool"), "tool missing"),
    "a robot of five joint names": (lambda d: d["robot"]["joint_names"].pop(), "robot.prismatic"),
    "a robot that is none": (set_to("robot", "fixed", 2, 0, 0, value=7.0), "joint 3"),
    "two joints of a name": (set_to("robot", "joint_names", 1, value="joint1"), "different names"),
    "crossed limits": (set_to("robot", "limits", "lower", 0, value=99.0), "lower ≤ upper"),
    "a path of no kind": (set_to("path", "path", value="spiral"), "path"),
    "a path without its goal": (lambda d: d["path"].pop("goal"), "goal"),
    "a path from no pose": (set_to("path", "start", value=[[1.0]]), "start"),
    "no path": (set_to("path", value=[]), "path"),
    "limits of another name": (set_to("limits", "force", value=1.0), "force unknown"),
    "a limit below 0": (set_to("limits", "velocity", value=-1.0), "velocity"),
    "a limit in words": (set_to("limits", "velocity", value="fast"), "limits.velocity"),
    "limits of two joints": (set_to("limits", "jerk", value=[1.0, 1.0]), "limits.jerk"),
    "a tool speed for each joint": (set_to("limits", "tool_speed", value=[1.0] * 6), "limits.tool_speed"),
    "a law that is no word": (set_to("law", value=3), "law"),
    "a promise that does not exist": (set_to("keeps", value=["snap"]), "keeps"),
    "promises that are no list": (set_to("keeps", value="jerk"), "keeps"),
    "no time": (set_to("knots", value=[]), "knots"),
    "times that do not start at 0": (set_to("knots", 0, value=0.1), "knot 0 at 0.1 s"),
    "times that repeat": (lambda d: set_to("knots", 1, value=d["knots"][2])(d), "knot 2"),
    "times that go back": (set_to("knots", 1, value=-1.0), "knot"),
    "a time that is none": (set_to("knots", 1, value=NAN), "knots|NaN is no number"),
    "a time too few": (lambda d: d["knots"].pop(), r"coefficients.*shape \(1 to 6, 1, 6\)"),
    "a coefficient that is NaN": (set_to("coefficients", 2, 1, 0, value=NAN), "coefficients|NaN is no number"),
    "a coefficient that is infinite": (set_to("coefficients", 2, 1, 0, value=INF), "coefficients|Infinity is no number"),
    "pieces for five joints": (lambda d: [p.pop() for c in d["coefficients"] for p in c], r"shape \(6, 2, 5\)"),
    "seven powers": (lambda d: d["coefficients"].append(d["coefficients"][0]), r"shape \(7, 2, 6\)"),
    "no powers": (set_to("coefficients", value=[]), "coefficients"),
    "empty pieces": (set_to("coefficients", value=[[[]]]), "coefficients"),
}  # fmt: skip


@each_format
@pytest.mark.parametrize(("change", "named"), WRONG.values(), ids=WRONG.keys())
def test_a_file_that_holds_no_motion_is_refused_by_its_name_and_what_is_wrong(
    change: Callable[[dict[str, Any]], Any], named: str, suffix: str, tmp_path: Path
) -> None:
    file = tmp_path / f"motion{suffix}"
    save(small(), file)
    data = content(file)
    rewrite(file, data)
    assert is_same(load_motion(file), small())
    change(data)
    rewrite(file, data)
    with pytest.raises(InvalidInput, match=named) as caught:
        load_motion(file)
    assert str(file) in str(caught.value)


@each_format
def test_a_changed_figure_is_not_the_motion_that_was_written(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"motion{suffix}"
    save(small(), file)
    data = content(file)
    digest = "0" * 64
    rewrite(file, data | {"sha256": digest})
    with pytest.raises(InvalidInput, match="sha256: expected a file that nobody changed"):
        load_motion(file)
    for keys in (("coefficients", 3, 1, 2), ("knots", 1), ("robot", "tool", 0, 3), ("limits", "velocity")):
        save(small(), file)
        sha = _digest_in(file)
        changed = content(file)
        set_to(*keys, value=np.nextafter(_at(changed, keys), 9.0))(changed)
        rewrite(file, changed | {"sha256": sha})
        with pytest.raises(InvalidInput, match="sha256"):
            load_motion(file)


def _at(data: Any, keys: tuple[Any, ...]) -> Any:
    for key in keys:
        data = data[key]
    return data


def _digest_in(file: Path) -> str:
    if file.suffix == ".npz":
        with np.load(file) as archive:
            return str(json.loads(str(archive["header"]))["sha256"])
    return next(w for w in file.read_text().replace('"', " ").split() if len(w) == 64)


def readable_or_refused(file: Path, content: bytes) -> bool:
    """Whether damaged bytes are refused by name; what is read all the same must be the motion."""
    file.write_bytes(content)
    try:
        back = load_motion(file)
    except InvalidInput as error:
        assert str(file) in str(error)
        return True
    assert is_same(back, small())
    return False


@each_format
def test_a_truncated_file_is_refused(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"motion{suffix}"
    save(small(), file)
    whole = file.read_bytes()
    for size in {0, 1, 2, 10, *range(3, len(whole) - 20, len(whole) // 60)}:
        assert readable_or_refused(file, whole[:size]), f"{size} bytes of {len(whole)}"
    for size in range(len(whole) - 20, len(whole)):
        readable_or_refused(file, whole[:size])


@each_format
def test_damaged_bytes_are_refused_or_do_not_matter(suffix: str, tmp_path: Path) -> None:
    file, rng = tmp_path / f"motion{suffix}", np.random.default_rng(8)
    save(small(), file)
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
        b"",
        b"\x00" * 50,
        b"[" * 100_000,
        b"\xff\xfe",
        b"null",
        b"3",
        b"{}",
        b'{"format": 1e999}',
        b"# a\n",
        b"# a: b\nt\n",
    ],
    ids=["nothing", "zeros", "nesting", "no text", "null", "3", "empty", "infinite", "comment", "no JSON"],
)
def test_junk_is_refused(suffix: str, junk: bytes, tmp_path: Path) -> None:
    assert readable_or_refused(tmp_path / f"motion{suffix}", junk)


@pytest.mark.parametrize("word", ["NaN", "[Infinity]", '{"a": -Infinity}'])
def test_what_json_has_no_number_for_is_refused(word: str) -> None:
    with pytest.raises(InvalidInput, match="is no number in JSON"):
        parsed(word, "x")


def test_the_table_of_a_csv_must_show_its_polynomials(tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    save(small(), file)
    lines = file.read_text().splitlines()
    rows = list(csv.reader(io.StringIO("\n".join(lines[-3:]))))
    for (i, k), value, named in (
        ((1, 2), "0.5", "table, row 1, q_joint2"),
        ((0, 0), "1e-3", "table, row 0, t"),
        ((2, 9), "nan", "table, row 2, dq_joint3"),
        ((2, 18), "inf", "table, row 2, ddq_joint6"),
        ((1, 1), "", "table, row 1"),
        ((1, 1), "fast", "table, row 1"),
    ):
        changed = [list(row) for row in rows]
        changed[i][k] = value
        file.write_text("\n".join(lines[:-3] + [",".join(row) for row in changed]))
        with pytest.raises(InvalidInput, match=named):
            load_motion(file)
    for cut, named in (
        (lines[:-1], "2 rows"),
        (lines[:-4] + lines[-3:], "the columns t, q_joint1"),
        ([*lines, "1,2"], "4 rows"),
    ):
        file.write_text("\n".join(cut))
        with pytest.raises(InvalidInput, match=named):
            load_motion(file)


class Bomb:
    """What unpickling would run."""

    def __reduce__(self) -> Any:
        return pytest.fail, ("a file was unpickled",)


def test_nothing_is_ever_unpickled(tmp_path: Path) -> None:
    file = tmp_path / "motion.npz"
    save(small(), file)
    with np.load(file) as archive:
        arrays = dict(archive)
    bomb = np.array([Bomb()], dtype=object)
    for name in arrays:
        np.savez(file, **(arrays | {name: bomb}))  # type: ignore[arg-type]
        with pytest.raises(InvalidInput, match=r"motion\.npz"):
            load_motion(file)
    file.write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(InvalidInput, match=r"motion\.npz"):
        load_motion(file)
    np.save(file.with_suffix(".npy"), arrays["knots"])
    assert readable_or_refused(file, file.with_suffix(".npy").read_bytes())


def test_an_archive_that_would_unpack_to_gigabytes_is_not_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "motion.npz"
    save(small(), file)
    with np.load(file) as archive:
        arrays: dict[str, Any] = dict(archive)
    monkeypatch.setattr(motion_file, "UNPACKED", 2**20)
    np.savez_compressed(file, **(arrays | {"knots": np.zeros(2**20)}))
    assert file.stat().st_size < 2**15
    tracemalloc.start()
    with pytest.raises(InvalidInput, match="arrays of 8 MB"):
        load_motion(file)
    assert tracemalloc.get_traced_memory()[1] < 2**22
    tracemalloc.stop()


@pytest.mark.parametrize("held", [8, 8 * 2**40])
def test_an_array_that_is_not_as_long_as_it_says_is_refused(held: int, tmp_path: Path) -> None:
    file, whole = tmp_path / "motion.npz", io.BytesIO()
    save(small(), file)
    with np.load(file) as archive:
        arrays: dict[str, Any] = dict(archive)
    header = {"descr": "<f8", "fortran_order": False, "shape": (held // 8,)}
    np.lib.format.write_array_header_1_0(whole, header)  # type: ignore[no-untyped-call]
    np.savez(file, header=arrays["header"], coefficients=arrays["coefficients"])
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("knots.npy", whole.getvalue() + np.zeros(2).tobytes())
    with pytest.raises(InvalidInput, match=r"motion\.npz: knots\.npy: expected a whole array"):
        load_motion(file)


@pytest.mark.parametrize("kind", ["f4", "i8", "c16", "U8", "O"])
def test_arrays_of_another_kind_are_refused(kind: str, tmp_path: Path) -> None:
    file = tmp_path / "motion.npz"
    save(small(), file)
    with np.load(file) as archive:
        arrays: dict[str, Any] = dict(archive)
    np.savez(file, **(arrays | {"knots": arrays["knots"].astype(kind)}))
    with pytest.raises(InvalidInput, match=r"knots|content"):
        load_motion(file)


def test_arrays_of_the_other_byte_order_are_read(tmp_path: Path) -> None:
    file = tmp_path / "motion.npz"
    save(small(), file)
    with np.load(file) as archive:
        arrays: dict[str, Any] = dict(archive)
    np.savez_compressed(file, **(arrays | {"knots": arrays["knots"].astype(">f8")}))
    assert is_same(load_motion(file), small())


# ---------------------------------------------------------------- files that are none, plans that failed


@pytest.mark.parametrize("file", ["motion", "motion.txt", "motion.json.gz", "", 3, None, b"motion.json"])
def test_a_name_of_no_format_is_refused(file: Any) -> None:
    for use in (lambda: save(small(), file), lambda: load_motion(file)):
        with pytest.raises(InvalidInput, match=r"file: expected a name that ends in \.npz, \.json, \.csv"):
            use()


def test_what_cannot_be_read_or_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "folder.json").mkdir()
    for name in ("missing.json", "folder.json", "no\0name.json", "none/motion.csv"):
        with pytest.raises(InvalidInput, match="readable file"):
            load_motion(tmp_path / name)
        if name != "missing.json":
            with pytest.raises(OutputError):
                save(small(), tmp_path / name)


@each_format
def test_a_plan_that_failed_has_no_motion_to_write(suffix: str, tmp_path: Path) -> None:
    start = paper6r().fk(START)
    failed = plan(paper6r(), Line(start, moved(start, 5.0 * MOVE)), START)
    assert failed.stop is not None
    with pytest.raises(NoSolution) as caught:
        save(failed, tmp_path / f"motion{suffix}")
    assert (caught.value.s, caught.value.reason) == (failed.stop.s, failed.stop.reason)
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_motion_is_refused(tmp_path: Path) -> None:
    for thing in (None, planned().trajectory, {}, 3):
        with pytest.raises(InvalidInput, match="a Motion or a Plan"):
            save(thing, tmp_path / "motion.json")  # type: ignore[arg-type]
    motion = small()
    for field, wrong in (
        ("robot", "paper6r"),
        ("robot", optik.load("wx200")),
        ("path", None),
        ("limits", 2.0),
        ("limits", MotionLimits([1.0, 2.0])),
        ("trajectory", None),
        ("law", None),
        ("keeps", ["jerk"]),
        ("keeps", ("snap",)),
    ):
        fields = {k: getattr(motion, k) for k in ("robot", "path", "limits", "trajectory", "law", "keeps")}
        with pytest.raises(OptikError):
            Motion(**(fields | {field: wrong}))
