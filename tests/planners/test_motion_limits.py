"""A limit is one object: kinds made up here, outside the package, are judged, kept, filed and scaled like ours."""

import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import planners
from optik.errors import InvalidInput, NoSolution, UnknownName
from optik.plugins.files import import_file
from optik.registry import short_name
from optik.types import Array
from planners import Motion, MotionLimits, certify, load_motion, plan, save, stretch_to_limits
from planners.certificate.analysis import MotionAnalysis
from planners.limits import ALL_LIMITS, FIELD_LIMITS, DerivativeLimit, Extreme, PathPoints, kind_of, kinds, register
from planners.limits.inputs import LimitedMotion
from planners.limits.record import RecordLimit
from planners.motion.motion import find_stretch_factor
from tests.oracles import REPOSITORY
from tests.outside import everything
from tests.planners.cases import START, default_joint_path, default_line, paper6r

OUR = MotionLimits(2.0, 10.0, 100.0)
EXAMPLE = import_file(REPOSITORY / "examples" / "plugins" / "weighted_speed.py")


class Loaded(DerivativeLimit):
    """Greatest |q̈| + 1 of every joint: like a torque, it has a part that no slowing takes away."""

    name: ClassVar[str] = "loaded_acceleration"
    units: ClassVar[tuple[str, str]] = ("rad/s²", "m/s²")
    order: ClassVar[int] = 2

    def judge(self, motion: LimitedMotion, limit: Array) -> Extreme:
        found = motion.trajectory.extrema(2)
        return Extreme(found.worst + 1.0, (found.worst + 1.0) / limit, found.t_worst)

    def stretch_factor(self, motion: LimitedMotion, limit: Array) -> float:
        if (limit <= 1.0).any():
            return np.inf
        return planners.limits.scale_of(float((motion.trajectory.extrema(2).worst / (limit - 1.0)).max()), 2)


@pytest.fixture(autouse=True)
def made_up(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(kinds, "_ADDED", {})
    for kind in (EXAMPLE.METHOD(), Loaded()):
        register(kind)
    yield


def weighted(trajectory: Any) -> float:
    """Largest weighted speed at dense instants."""
    t = np.linspace(0.0, trajectory.end, 20001)
    return float((np.abs(trajectory(t, 1)) @ EXAMPLE.WEIGHTS).max())


@pytest.mark.parametrize("law", ["optimal", "smooth", "ruckig", "toppra", "constant_speed"])
def test_laws_keep_a_limit_from_outside_and_certificates_prove_it(law: str) -> None:
    free = plan(paper6r(), default_line(), START, limits=OUR, timing=law)
    bound = 0.8 * weighted(free.trajectory)
    limits = MotionLimits(2.0, 10.0, 100.0, extra={"weighted_speed": bound})
    found = plan(paper6r(), default_line(), START, limits=limits, timing=law, allow="jerk")
    assert found
    proof = found.certificate
    assert "weighted_speed" in proof.enforced
    assert 0.97 < weighted(found.trajectory) / bound <= proof.worst("weighted_speed")[0] * (1.0 + 1e-9) <= 1.0 + 1e-9
    assert proof.worst("weighted_speed")[1] == "arm"
    assert proof.to_dict()["weighted_speed"]["value"] == proof.extra["weighted_speed"].value
    if law != "smooth":  # whose speed has one peak
        assert "weighted_speed" in proof.binding.limit
    assert free.certificate.extra == {}


def test_the_optimum_uses_its_rows_and_does_not_only_slow_down() -> None:
    free = plan(paper6r(), default_line(), START, limits=OUR)
    bound = 0.7 * weighted(free.trajectory)
    limits = MotionLimits(2.0, 10.0, 100.0, extra={"weighted_speed": bound})
    found = plan(paper6r(), default_line(), START, limits=limits)
    slowed = free.trajectory.duration / 0.7
    assert found.trajectory.duration < 0.95 * slowed


NUMBERS = [one for one in everything("planners.limits") if not isinstance(kind_of(one), RecordLimit)]
"""Limits whose bound is a number; test_limit_records.py has the others."""


@pytest.mark.parametrize("limit", NUMBERS, ids=short_name)
def test_every_limit_scales_with_time_and_is_kept(limit: str) -> None:
    kind, law = kind_of(limit), plan(paper6r(), default_line(), START, limits=OUR).trajectory
    one = MotionLimits(extra={limit: 1.0})
    fast, slow = (
        certify(paper6r(), default_line(), motion, one).worst(kind.name)[0] for motion in (law, law.stretched(2.0))
    )
    if kind.homogeneous:
        assert fast == pytest.approx(slow * 2.0**kind.order, rel=1e-6)
    found = plan(paper6r(), default_line(), START, limits=MotionLimits(2.0, 10.0, 100.0, extra={limit: 0.5 * fast}))
    assert found and 0.9 < found.certificate.worst(kind.name)[0] <= 1.0
    at = PathPoints(found.joint_path, found.certificate.s)
    speed = np.linalg.norm(found.trajectory(found.certificate.t, 1), axis=1) / np.linalg.norm(at.q(1), axis=1)
    if kind.order == 1:  # at the knots the rows give the value, which the judgement bounds
        ratios = found.limits.ratios(kind.name, at, [speed])
        assert 0.9 < ratios.max() <= found.certificate.worst(kind.name)[0] * (1.0 + 1e-6)


def test_a_limit_of_a_file_is_given_by_its_path_and_then_has_its_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(kinds, "_ADDED", {})
    file = REPOSITORY / "examples" / "plugins" / "weighted_speed.py"
    limits = MotionLimits(2.0, 10.0, 100.0, extra={str(file): 3.0})
    assert limits.names[-1] == planners.limits.limit_names()[-1] == "weighted_speed"
    assert limits == MotionLimits(2.0, 10.0, 100.0, extra={"weighted_speed": 3.0})
    assert MotionLimits.from_plain(limits.to_plain(), 6) == limits
    taken = tmp_path / "jerk.py"
    taken.write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    with pytest.raises(InvalidInput, match="a name that no other limit has"):
        MotionLimits(extra={str(taken): 3.0})


def test_a_violation_is_named() -> None:
    law = plan(paper6r(), default_line(), START, limits=OUR).trajectory
    limits = MotionLimits(2.0, 10.0, 100.0, extra={"weighted_speed": 0.5 * weighted(law), "loaded_acceleration": 5.0})
    proof = certify(paper6r(), default_line(), law, limits)
    assert not proof.is_valid
    assert any("weighted_speed of arm is 2.0" in words for words in proof.reasons)
    assert any(words.startswith("loaded_acceleration of joint") for words in proof.reasons)
    only = certify(paper6r(), default_line(), law, limits, enforced=ALL_LIMITS)
    assert only.is_valid
    assert only.worst("weighted_speed")[0] > 1.9
    with pytest.raises(InvalidInput, match="weighted_speed"):
        only.worst("snap")
    with pytest.raises(InvalidInput, match="weighted_speed"):
        certify(paper6r(), default_line(), law, limits, enforced=("snap",))


@pytest.mark.parametrize("suffix", [".json", ".npz", ".csv"])
def test_files_hold_it_under_its_name(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    limits = MotionLimits(2.0, 10.0, 100.0, extra={"weighted_speed": 7.5, "loaded_acceleration": np.arange(12.0, 18.0)})
    motion = plan(paper6r(), default_line(), START, limits=limits).motion
    file = tmp_path / f"motion{suffix}"
    save(motion, file)
    again = load_motion(file)
    assert again.limits == limits
    assert again.enforced == motion.enforced == (*ALL_LIMITS, "weighted_speed", "loaded_acceleration")
    assert again.certify().worst("weighted_speed") == motion.certify().worst("weighted_speed")
    monkeypatch.setattr(kinds, "_ADDED", {})
    with pytest.raises(InvalidInput, match="weighted_speed, loaded_acceleration unknown"):
        load_motion(file)


def test_fit_scales_by_what_the_limit_says() -> None:
    fast = plan(paper6r(), default_line(), START, limits=OUR).trajectory
    worst = float(fast.extrema(2).worst.max())
    limits = MotionLimits(extra={"loaded_acceleration": 1.0 + worst / 4.0})
    assert find_stretch_factor(MotionAnalysis(paper6r(), fast), limits) == pytest.approx(2.0, rel=1e-12)
    slow = stretch_to_limits(paper6r(), fast, limits)
    assert slow.duration / fast.duration == pytest.approx(2.0, rel=1e-9)
    assert find_stretch_factor(MotionAnalysis(paper6r(), slow), limits) <= 1.0
    assert find_stretch_factor(MotionAnalysis(paper6r(), fast), limits, ("velocity",)) == 0.0
    with pytest.raises(NoSolution, match="any speed"):
        stretch_to_limits(paper6r(), fast, MotionLimits(extra={"loaded_acceleration": 0.9}))
    never = plan(
        paper6r(), default_line(), START, limits=MotionLimits(2.0, 10.0, 100.0, extra={"loaded_acceleration": 0.9})
    )
    assert never.status == "timing_infeasible"


def test_limits_with_extra_ones_are_values() -> None:
    limits = MotionLimits(2.0, tool_speed=0.5, extra={"weighted_speed": 7.5, "loaded_acceleration": [2.0] * 6})
    assert limits == pickle.loads(pickle.dumps(limits)) == limits.scale(1.0)
    assert hash(limits) == hash(limits.scale(1.0))
    assert limits != limits.scale(2.0) != MotionLimits(2.0, tool_speed=0.5)
    assert limits.scale(2.0).value("weighted_speed") == 15.0
    assert limits.scale(2.0, ("tool_speed",)).value("weighted_speed") == 7.5
    assert limits.select(("velocity",)) == MotionLimits(2.0)
    assert limits.names == (*ALL_LIMITS, "weighted_speed", "loaded_acceleration")
    assert limits.to_dict(6)["weighted_speed"] == 7.5
    assert set(MotionLimits(2.0).to_dict(6)) == set(ALL_LIMITS)
    assert MotionLimits(extra={"weighted_speed": None}) == MotionLimits()


def test_what_cannot_be_a_limit_is_refused() -> None:
    for extra, kind in (
        ({"velocity": 1.0}, InvalidInput),
        ({"snap": 1.0}, UnknownName),
        ({"weighted_speed": -1.0}, InvalidInput),
    ):
        with pytest.raises(kind):
            MotionLimits(extra=extra)
    with pytest.raises(InvalidInput, match="loaded_acceleration"):
        MotionLimits(extra={"loaded_acceleration": [1.0, 2.0]}).bounds(6)

    class Jerk(Loaded):
        name: ClassVar[str] = "jerk"

    class Other(Loaded):
        name: ClassVar[str] = "weighted_speed"

    for kind_of_limit in (Jerk(), Other(), EXAMPLE.METHOD):
        with pytest.raises(InvalidInput, match="kind"):
            register(kind_of_limit)
    register(EXAMPLE.METHOD())  # again: the same kind


def test_rows_are_the_chain_rule() -> None:
    """Against differences of q(s(t)) for a cubic s(t)."""
    joint_path, h = default_joint_path(), 3e-4
    s0, v, a, j = 0.4 * joint_path.end, 0.4, 2.0, -3.0
    s = [s0 + t * (v + t * (0.5 * a + t * j / 6.0)) for t in h * np.arange(-3, 4)]
    q = joint_path(np.array(s))
    first = (q[4] - q[2]) / (2 * h)
    second = (q[4] - 2 * q[3] + q[2]) / h**2
    third = (q[0] - 8 * q[1] + 13 * q[2] - 13 * q[4] + 8 * q[5] - q[6]) / (8 * h**3)
    at = PathPoints(joint_path, np.array([s0]))
    rates = tuple(np.array([x]) for x in (v, a, j))
    for name, expected, error in (("velocity", first, 1e-5), ("acceleration", second, 1e-5), ("jerk", third, 1e-3)):
        ratio = OUR.ratios(name, at, rates)[0]
        expected = np.abs(expected) / OUR.bounds(6)[name]
        assert np.abs(ratio - expected).max() <= error * expected.max()


def test_each_limit_says_its_name_units_and_order() -> None:
    assert tuple((k.name, k.units, k.order, k.subject) for k in FIELD_LIMITS) == (
        ("velocity", ("rad/s", "m/s"), 1, None),
        ("acceleration", ("rad/s²", "m/s²"), 2, None),
        ("jerk", ("rad/s³", "m/s³"), 3, None),
        ("tool_speed", ("m/s", "m/s"), 1, "tool"),
        ("rotation_speed", ("rad/s", "rad/s"), 1, "tool"),
        ("torque", ("N·m", "N"), 2, None),
        ("torque_rate", ("N·m/s", "N/s"), 3, None),
    )
    assert all(kind_of(k.name) is k for k in FIELD_LIMITS)


def test_a_motion_promises_only_what_its_limits_have() -> None:
    found = plan(paper6r(), default_line(), START, limits=OUR)
    with pytest.raises(InvalidInput, match="enforced"):
        Motion(paper6r(), default_line(), OUR, found.trajectory, enforced=("weighted_speed",))


def test_the_robot_s_limits_with_changes_are_those_of_the_command_line() -> None:
    from benchmarks.cli.paths import LineCommand
    from optik.arm.library import load
    from planners import make_law

    panda = load("panda")
    own = MotionLimits.of(panda)
    assert own.torque is not None
    given = MotionLimits.of(panda, acceleration=5.0, jerk=50.0)
    assert given == LineCommand(acceleration=5.0, jerk=50.0).read_limits(panda, make_law("optimal"))
    np.testing.assert_array_equal(given.torque, own.torque)
    assert MotionLimits.of(panda, torque=None).torque is None
    assert MotionLimits(acceleration=5.0).torque is None
    with pytest.raises(UnknownName, match="torque or torque_rate"):
        MotionLimits.of(panda, torques=1.0)
